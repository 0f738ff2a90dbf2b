"""How good one frame is, in pixels and in metres, and many frames together.

Pixels: TuSimple's criterion (https://github.com/TuSimple/tusimple-benchmark): a labelled point counts as found when the
prediction in its row is nearer than 20 px / cos(slope of the line), in a frame 1280 px wide; "strict" asks for 5 px.
Metres: the truth knows camera, mounting and the lines on the road, so the prediction's pixels are mapped to the road
and compared there. Nothing is needed of a prediction but `raw_file`, `h_samples` and `lanes`, so that any tool's can be
judged.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.labels import line_points, x_at

LOOSE_PX, STRICT_PX = 20.0, 5.0  # TuSimple's criterion, and a quarter of it
LINE_SHARE = 0.85  # a line with this share of its points found counts as found (TuSimple's limit)
DISTANCES_M = (5.0, 10.0, 20.0, 30.0)
AT_10_M, AT_20_M = DISTANCES_M.index(10.0), DISTANCES_M.index(20.0)
BEND_1PM = 1e-3  # bends tighter than R 1000 m have an error in per cent; in wider ones per cent mean nothing
WRONG_M = 0.5  # a line this far off at 10 m is wrong: four widths of a line's paint
NAN = math.nan


@dataclass(frozen=True, eq=False)
class FrameScore:
    """One labelled frame. Errors are predicted minus true; NaN where nothing can be said.

    `errors_px`: per labelled line (N,) |dx| cos(slope) at 1280 px width, NaN where not predicted. `lateral_m`: (2, 4)
    of left and right line at `DISTANCES_M`; `centre_m` (4,) the lane's true centre there. `bend_1pm`: true curvature.
    """

    name: str
    tags: tuple[str, ...] = ()
    has_lane: bool = True
    claimed: bool = False
    errors_px: tuple[np.ndarray, ...] = ()
    lateral_m: np.ndarray = field(default_factory=lambda: np.full((2, len(DISTANCES_M)), NAN))
    centre_m: np.ndarray = field(default_factory=lambda: np.full(len(DISTANCES_M), NAN))
    offset_m: float = NAN
    width_m: float = NAN
    heading_rad: float = NAN
    curvature_1pm: float = NAN
    bend_1pm: float = NAN
    clip: str = ""
    time_s: float = NAN

    @property
    def wrong(self) -> bool:
        """A lane is claimed where there is none, or a line is off by more than `WRONG_M` at 10 m."""
        off = np.abs(self.lateral_m[:, AT_10_M])
        return self.claimed and (not self.has_lane or bool(np.any(off > WRONG_M)))


@dataclass(frozen=True)
class PixelScore:
    """Shares 0..1 and pixels over all labelled points; see the module's text. The names are those of `score.py`."""

    frames: int
    points: int
    tusimple: float
    strict: float
    lanes: float
    seen: float
    mean_px: float
    p95_px: float


@dataclass(frozen=True)
class MetricScore:
    """Medians of absolute errors over frames with a lane; `lateral_m` at `DISTANCES_M`; `curvature` is relative, in
    bends tighter than 1000 m; `curvature_1pm` in the others. `found`: share of frames with a lane in which one is
    claimed; `false_lanes`: number of frames without a lane in which one is claimed, of `empty`."""

    frames: int
    found: float
    empty: int
    false_lanes: int
    lateral_m: tuple[float, ...]
    offset_m: float
    width_m: float
    heading_rad: float
    curvature: float
    curvature_1pm: float


def frame_score(label: Mapping, prediction: Mapping | None, camera: Camera | None = None) -> FrameScore:
    """One frame; in metres too where the label has them and `camera` is given."""
    width = camera.size_wh[0] if camera else label.get("size", [1280, 720])[0]
    errors = tuple(e for lane in (0, 1) if len(e := _line_errors_px(label, prediction, lane, width)))
    claimed = prediction is not None and any(len(line_points(prediction, lane)[0]) >= 2 for lane in (0, 1))
    clip, _, frame = label["raw_file"].rpartition(":")
    about = {
        "name": label["raw_file"],
        "tags": tuple(label.get("tags", ())),
        "has_lane": bool(label["lanes"]),
        "claimed": claimed,
        "errors_px": errors,
        "time_s": NAN if label.get("time_s") is None else label["time_s"],
        "clip": clip if clip and frame.isdigit() else "",
    }
    if camera is None or not label["lanes"] or "lanes_road_m" not in label:
        return FrameScore(**about)
    return FrameScore(**about, **_metric_errors(label, prediction if claimed else None, camera))


def _line_errors_px(label: Mapping, prediction: Mapping | None, lane: int, width: int) -> np.ndarray:
    y, x = line_points(label, lane)
    if len(y) < 2 or np.ptp(y) == 0:
        return np.empty(0)
    slope = np.polyfit(y - y.mean(), x, 1)[0]
    found = np.full(len(y), NAN) if prediction is None else x_at(prediction, lane, y)
    return np.abs(found - x) * (1280 / width) * math.cos(math.atan(slope))


def _metric_errors(truth: Mapping, prediction: Mapping | None, camera: Camera) -> dict:
    """Errors on the road, through the truth's camera and mounting."""
    birdseye = BirdsEye.from_mounting(camera, **truth["mounting"])
    at = np.array(DISTANCES_M)
    true_m = np.array([_x_of_distance(line, at) for line in truth["lanes_road_m"]])
    bend = float(truth["curvature_1pm"])
    result = {"centre_m": true_m.mean(axis=0), "bend_1pm": bend}
    if prediction is None:
        return result

    def on_road(points_px):
        return birdseye.road_from_points(camera.undistort_points(points_px))

    def road_x(columns, rows):
        return on_road(np.column_stack([columns, rows]))[:, 0]

    lateral = np.full(true_m.shape, NAN)
    for lane in (0, 1):
        rows = camera.distort_points(birdseye.points_from_road(np.column_stack([true_m[lane], at])))[:, 1]
        seen = [x_at(truth, k, rows) for k in (0, 1)]
        # On a hill the flat plane has another scale in that row than the road; the lane's true width sets it right.
        scale = (true_m[1] - true_m[0]) / (road_x(seen[1], rows) - road_x(seen[0], rows))
        scale = np.where(np.isfinite(scale), scale, 1.0)
        lateral[lane] = (road_x(x_at(prediction, lane, rows), rows) - road_x(seen[lane], rows)) * scale
    pose = _pose_of(prediction, on_road)
    for key, name in (("offset_m", "offset_m"), ("lane_width_m", "width_m"), ("curvature_1pm", "curvature_1pm")):
        value = prediction.get(key)
        result[name] = (pose[key] if value is None else float(value)) - float(truth[key])
    result["heading_rad"] = pose["heading_rad"] - float(truth["heading_rad"])
    return result | {"lateral_m": lateral}


def _x_of_distance(line_m: list, at_m: np.ndarray) -> np.ndarray:
    """x of a true line [[x, y], …] at distances ahead; NaN beyond its ends."""
    x, y = np.asarray(line_m, float).reshape(-1, 2).T
    turned = np.flatnonzero(np.diff(y) <= 0)  # a hairpin comes back: only the part before
    n = turned[0] + 1 if len(turned) else len(y)
    return np.interp(at_m, y[:n], x[:n], left=NAN, right=NAN) if n >= 2 else np.full(len(at_m), NAN)


def _pose_of(prediction: Mapping, on_road: Callable[[np.ndarray], np.ndarray], *, far_m: float = 30.0) -> dict:
    """Offset, heading, curvature and width of the predicted pixels alone; ``on_road``: pixels (N, 2) to metres (N, 2).

    x = C_left or C_right + slope y + A y^2 + B y^3 (a clothoid): least squares over both lines to `far_m`, each
    point weighted with 1 / y, because a pixel is y / focal length wide there.
    """
    nothing = dict.fromkeys(("offset_m", "lane_width_m", "curvature_1pm", "heading_rad"), NAN)
    rows, values = [], []
    for lane in (0, 1):
        y_px, x_px = line_points(prediction, lane)
        x, y = on_road(np.column_stack([x_px, y_px])).reshape(-1, 2).T
        good = np.isfinite(x) & (y > 0) & (y < far_m)
        if good.sum() < 3:
            return nothing
        design = np.column_stack([np.full(len(y), lane == 0), np.full(len(y), lane == 1), y, y**2, y**3])
        rows.append((design / y[:, None])[good])
        values.append((x / y)[good])
    left, right, slope, a, _ = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return {
        "offset_m": -(left + right) / 2,
        "lane_width_m": (right - left) / math.hypot(1, slope),
        "curvature_1pm": -2 * a / (1 + slope**2) ** 1.5,
        "heading_rad": math.atan(slope),
    }


def pixel_score(frames: Iterable[FrameScore]) -> PixelScore:
    """TuSimple's measures over all labelled points of `frames`."""
    labelled = [frame.errors_px for frame in frames if frame.errors_px]
    lines = [errors for frame in labelled for errors in frame]
    if not lines:
        return PixelScore(0, 0, NAN, NAN, NAN, NAN, NAN, NAN)
    errors = np.concatenate(lines)
    seen = np.isfinite(errors)
    return PixelScore(
        frames=len(labelled),
        points=len(errors),
        tusimple=float(np.mean(errors < LOOSE_PX)),
        strict=float(np.mean(errors < STRICT_PX)),
        lanes=float(np.mean([np.mean(line < LOOSE_PX) >= LINE_SHARE for line in lines])),
        seen=float(seen.mean()),
        mean_px=float(errors[seen].mean()) if seen.any() else NAN,
        p95_px=float(np.percentile(errors[seen], 95)) if seen.any() else NAN,
    )


def metric_score(frames: Iterable[FrameScore]) -> MetricScore:
    """Medians of the absolute errors in metres."""
    frames = list(frames)
    lanes, empty = [f for f in frames if f.has_lane], [f for f in frames if not f.has_lane]
    bends = [f for f in lanes if abs(f.bend_1pm) > BEND_1PM]
    straights = [f for f in lanes if abs(f.bend_1pm) <= BEND_1PM]
    return MetricScore(
        frames=len(frames),
        found=float(np.mean([f.claimed for f in lanes])) if lanes else NAN,
        empty=len(empty),
        false_lanes=sum(f.claimed for f in empty),
        lateral_m=tuple(_median(f.lateral_m[:, i] for f in lanes) for i in range(len(DISTANCES_M))),
        offset_m=_median(f.offset_m for f in lanes),
        width_m=_median(f.width_m for f in lanes),
        heading_rad=_median(f.heading_rad for f in lanes),
        curvature=_median(f.curvature_1pm / f.bend_1pm for f in bends),
        curvature_1pm=_median(f.curvature_1pm for f in straights),
    )


def _median(values) -> float:
    """Median of absolute values, NaN apart."""
    flat = np.abs(np.concatenate([np.atleast_1d(v) for v in values] or [np.empty(0)]))
    flat = flat[np.isfinite(flat)]
    return float(np.median(flat)) if len(flat) else NAN
