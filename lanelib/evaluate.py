"""How good is a lane: predictions against labels in pixels, and against exact truth in metres.

Pixels: TuSimple's criterion (https://github.com/TuSimple/tusimple-benchmark): a labelled point counts as found when the
prediction in its row is nearer than 20 px / cos(slope of the line), in a frame 1280 px wide; "strict" asks for 5 px.
Metres: the truth knows camera, mounting and the lines on the road, so the prediction's pixels are mapped to the road and
compared there. Any tool's predictions can be judged: nothing is needed of them but `raw_file`, `h_samples` and `lanes`.
"""

import json
import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.truth import load_truth, load_truth_camera

LOOSE_PX, STRICT_PX = 20.0, 5.0  # TuSimple's criterion, and a quarter of it
LINE_SHARE = 0.85  # a line with this share of its points found counts as found (TuSimple's limit)
DISTANCES_M = (5.0, 10.0, 20.0, 30.0)
BEND_1PM = 1e-3  # bends tighter than R 1000 m have an error in per cent; in wider ones per cent mean nothing
WRONG_M = 0.5  # a line this far off at 10 m is wrong: four widths of a line's paint
MAX_FILE_BYTES = 500_000_000  # half a million frames; more is not a file of predictions
NAN = math.nan


@dataclass(frozen=True, eq=False)
class FrameScore:
    """One labelled frame. Errors are predicted minus true; NaN where nothing can be said.

    `errors_px`: per labelled line (N,) |dx| cos(slope) at 1280 px width, NaN where not predicted. `lateral_m`: (2, 4) of
    left and right line at `DISTANCES_M`; `centre_m` (4,) the lane's true centre there. `bend_1pm`: true curvature.
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
        off = np.abs(self.lateral_m[:, DISTANCES_M.index(10.0)])
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


@dataclass(frozen=True)
class ClipScore:
    """Behaviour over time. `jitter_m`: root mean square of the change of the centre's error at 10 m from frame to frame;
    `lag_s`: the delay at which predicted and true centre at 20 m agree best (NaN where the truth hardly moves);
    `reset_s`: the longest time from where a lane begins to the first right one; `wrong_s`: the longest time on a wrong one."""

    clip: str
    frames: int
    jitter_m: float
    lag_s: float
    reset_s: float
    wrong_s: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that `evaluate` found; prints as tables."""

    frames: tuple[FrameScore, ...]
    pixels: PixelScore
    metric: bool

    def by_tag(self) -> dict[str, tuple[FrameScore, ...]]:
        """Frames by tag, "all" first."""
        tags = sorted({tag for frame in self.frames for tag in frame.tags})
        return {"all": self.frames} | {t: tuple(f for f in self.frames if t in f.tags) for t in tags}

    def clips(self) -> tuple[ClipScore, ...]:
        """Measures over time of every clip."""
        names = dict.fromkeys(frame.clip for frame in self.frames if frame.clip)
        return tuple(clip_score([f for f in self.frames if f.clip == name]) for name in names)

    def to_dict(self) -> dict:
        """Plain numbers for JSON; null where a number is not known."""
        tags = {
            tag: vars(pixel_score(frames)) | (vars(metric_score(frames)) if self.metric else {})
            for tag, frames in self.by_tag().items()
        }
        return _without_nan({"tags": tags, "clips": [vars(clip) for clip in self.clips()]})

    def __str__(self) -> str:
        """A table by tag, and one by clip where there are clips."""
        rows = [_pixel_head() + (_metric_head() if self.metric else [])]
        for tag, frames in self.by_tag().items():
            rows.append(_pixel_row(tag, pixel_score(frames), frames) + (_metric_row(frames) if self.metric else []))
        text = table(rows)
        if clips := self.clips():
            head = ["clip", "frames", "jitter cm", "lag s", "reset s", "wrong for s"]
            text += "\n\n" + table(
                [head]
                + [
                    [
                        c.clip,
                        str(c.frames),
                        _cm(c.jitter_m),
                        _fixed(c.lag_s, 2),
                        _fixed(c.reset_s, 2),
                        _fixed(c.wrong_s, 2),
                    ]
                    for c in clips
                ]
            )
        return text


# ---------------------------------------------------------------------------------------------- files
def read_rows(path: str | Path) -> dict[str, dict]:
    """JSON lines in the TuSimple layout, by `raw_file`. LanelibError names the file, the line and what is wrong."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise LanelibError(f"{path}: needed at most {MAX_FILE_BYTES >> 20} MB of JSON lines, found more; split it")
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise LanelibError(f"{path}: needed a file of JSON lines, found: {error.strerror}; check the name") from None
    except UnicodeDecodeError:
        raise LanelibError(f"{path}: needed JSON lines, found something that is no text; check the name") from None
    rows = {}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            row = json.loads(line, parse_constant=_no_constant)
            _check_row(row)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
            raise LanelibError(f"{path}:{number}: needed an object with raw_file, h_samples, lanes: {what}") from None
        rows[row["raw_file"]] = row
    if not rows:
        raise LanelibError(f"{path}: needed at least one line of JSON, found an empty file; check the name")
    return rows


def read_labels(path: str | Path) -> tuple[dict[str, dict], Camera | None]:
    """Labels by `raw_file`: JSON lines, or a `truth.json` (or its folder), which brings its camera."""
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.name == "truth.json":
        return load_truth(folder), Camera.from_dict(load_truth_camera(folder))
    return read_rows(path), None


def _check_row(row: dict) -> None:
    if not isinstance(row, dict):
        raise ValueError("found no object")
    if (
        not isinstance(row["raw_file"], str)
        or not isinstance(row["h_samples"], list)
        or not isinstance(row["lanes"], list)
    ):
        raise ValueError("found raw_file that is no text, or h_samples or lanes that are no lists")
    length = len(_finite(row["h_samples"]))
    extra = row["extrap"] if "extrap" in row else []
    if any(len(_finite(line)) != length for line in [*row["lanes"], *extra]):
        raise ValueError("found a line of another length than h_samples")
    if "extrap" in row and len(extra) < min(len(row["lanes"]), 2):
        raise ValueError("found an extrap of fewer lines than lanes")
    size = _finite(row.get("size", [1280, 720]))
    if len(size) != 2 or not size.min() > 0:
        raise ValueError("found a size that is not [width, height]")


def _finite(values: list) -> np.ndarray:
    array = np.asarray(values, float)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError("found something else than a list of finite numbers")
    return array


def _no_constant(text: str) -> float:
    raise ValueError(f"found {text}, which is not a number")


# ---------------------------------------------------------------------------------------------- scores
def evaluate(labels: str | Path, predictions: str | Path) -> Evaluation:
    """Score a file of predictions against a file of labels or a `truth.json`; a frame that is not predicted is missed."""
    rows, camera = read_labels(labels)
    return score(rows, read_rows(predictions), camera)


def score(labels: Mapping[str, dict], predictions: Mapping[str, dict], camera: Camera | None = None) -> Evaluation:
    """The same of rows by `raw_file`. Names match whole, else by the file's name alone where that is unique."""
    if labels and all("rvec" in row for row in labels.values()):
        raise LanelibError("evaluate: needed labels of lanes, found the truth of chessboards; name another file")
    by_name: dict[str, dict | None] = {}
    for name, row in predictions.items():
        by_name[Path(name).name] = None if Path(name).name in by_name else row
    frames = tuple(
        frame_score(row, predictions.get(name) or by_name.get(Path(name).name), camera) for name, row in labels.items()
    )
    if not any(name in predictions or by_name.get(Path(name).name) for name in labels):
        raise LanelibError(
            f"evaluate: needed predictions for the labelled frames (such as {next(iter(labels), '')!r}), "
            f"found others (such as {next(iter(predictions), '')!r}); are these the same pictures?"
        )
    return Evaluation(frames, pixel_score(frames), camera is not None)


def frame_score(label: Mapping, prediction: Mapping | None, camera: Camera | None = None) -> FrameScore:
    """One frame; in metres too where the label has them and `camera` is given."""
    width = camera.size_wh[0] if camera else label.get("size", [1280, 720])[0]
    errors = tuple(e for lane in (0, 1) if len(e := _line_errors_px(label, prediction, lane, width)))
    claimed = prediction is not None and any(len(_line(prediction, lane)[0]) >= 2 for lane in (0, 1))
    clip, _, frame = label["raw_file"].rpartition(":")
    about = {
        "name": label["raw_file"],
        "tags": tuple(label.get("tags", ())),
        "has_lane": bool(label["lanes"]),
        "claimed": claimed,
        "errors_px": errors,
        "time_s": label.get("time_s", NAN),
        "clip": clip if clip and frame.isdigit() else "",
    }
    if camera is None or not label["lanes"] or "lanes_road_m" not in label:
        return FrameScore(**about)
    return FrameScore(**about, **_metric_errors(label, prediction if claimed else None, camera))


def _line(row: Mapping, lane: int) -> tuple[np.ndarray, np.ndarray]:
    """(y, x) of the seen points of a line, ascending in y."""
    if lane >= len(row["lanes"]):
        return np.empty(0), np.empty(0)
    y, x = np.asarray(row["h_samples"], float), np.asarray(row["lanes"][lane], float)
    seen = x >= 0
    if "extrap" in row:  # rows in which the labeller only prolonged the line
        seen &= np.asarray(row["extrap"][lane]) == 0
    order = np.argsort(y[seen], kind="stable")
    return y[seen][order], x[seen][order]


def _x_at(row: Mapping, lane: int, rows_px) -> np.ndarray:
    """x of a line at rows, between its points only; NaN elsewhere."""
    y, x = _line(row, lane)
    return np.interp(rows_px, y, x, left=NAN, right=NAN) if len(y) >= 2 else np.full(np.shape(rows_px), NAN)


def _line_errors_px(label: Mapping, prediction: Mapping | None, lane: int, width: int) -> np.ndarray:
    y, x = _line(label, lane)
    if len(y) < 2 or np.ptp(y) == 0:
        return np.empty(0)
    slope = np.polyfit(y - y.mean(), x, 1)[0]
    found = np.full(len(y), NAN) if prediction is None else _x_at(prediction, lane, y)
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

    def road_x(columns, rows):
        return birdseye.road_from_points(camera.undistort_points(np.column_stack([columns, rows])))[:, 0]

    lateral = np.full(true_m.shape, NAN)
    for lane in (0, 1):
        pixels = camera.distort_points(birdseye.points_from_road(np.column_stack([true_m[lane], at])))
        rows = pixels[:, 1]
        seen = [_x_at(truth, k, rows) for k in (0, 1)]
        # On a hill the flat plane shows another scale than the road has in that row; the lane's true width sets it right.
        scale = (true_m[1] - true_m[0]) / (road_x(seen[1], rows) - road_x(seen[0], rows))
        scale = np.where(np.isfinite(scale), scale, 1.0)
        lateral[lane] = (road_x(_x_at(prediction, lane, rows), rows) - road_x(seen[lane], rows)) * scale
    pose = _pose_of(prediction, road_from=lambda points: birdseye.road_from_points(camera.undistort_points(points)))
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


def _pose_of(prediction: Mapping, road_from, *, far_m: float = 30.0) -> dict:
    """Offset, heading, curvature and width of the predicted pixels alone: x = C_left or C_right + slope y + A y^2.

    Least squares over both lines to `far_m`, each point weighted with 1 / y: a pixel is y / focal length wide on the road.
    """
    nothing = dict.fromkeys(("offset_m", "lane_width_m", "curvature_1pm", "heading_rad"), NAN)
    rows, values = [], []
    for lane in (0, 1):
        y_px, x_px = _line(prediction, lane)
        x, y = road_from(np.column_stack([x_px, y_px])).reshape(-1, 2).T
        good = np.isfinite(x) & (y > 0) & (y < far_m)
        if good.sum() < 3:
            return nothing
        design = np.column_stack([np.full(len(y), lane == 0), np.full(len(y), lane == 1), y, y**2])
        rows.append((design / y[:, None])[good])
        values.append((x / y)[good])
    left, right, slope, a = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
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
        len(labelled),
        len(errors),
        float(np.mean(errors < LOOSE_PX)),
        float(np.mean(errors < STRICT_PX)),
        float(np.mean([np.mean(line < LOOSE_PX) >= LINE_SHARE for line in lines])),
        float(seen.mean()),
        float(errors[seen].mean()) if seen.any() else NAN,
        float(np.percentile(errors[seen], 95)) if seen.any() else NAN,
    )


def metric_score(frames: Iterable[FrameScore]) -> MetricScore:
    """Medians of the absolute errors in metres."""
    frames = list(frames)
    lanes, empty = [f for f in frames if f.has_lane], [f for f in frames if not f.has_lane]
    bends = [f for f in lanes if abs(f.bend_1pm) > BEND_1PM]
    straights = [f for f in lanes if abs(f.bend_1pm) <= BEND_1PM]
    lateral = tuple(_median(f.lateral_m[:, i] for f in lanes) for i in range(len(DISTANCES_M)))
    return MetricScore(
        len(frames),
        float(np.mean([f.claimed for f in lanes])) if lanes else NAN,
        len(empty),
        sum(f.claimed for f in empty),
        lateral,
        _median(f.offset_m for f in lanes),
        _median(f.width_m for f in lanes),
        _median(f.heading_rad for f in lanes),
        _median(f.curvature_1pm / f.bend_1pm for f in bends),
        _median(f.curvature_1pm for f in straights),
    )


def _median(values) -> float:
    """Median of absolute values, NaN apart."""
    flat = np.abs(np.concatenate([np.atleast_1d(v) for v in values] or [np.empty(0)]))
    flat = flat[np.isfinite(flat)]
    return float(np.median(flat)) if len(flat) else NAN


# ---------------------------------------------------------------------------------------------- time
def clip_score(frames: Iterable[FrameScore]) -> ClipScore:
    """Jitter, lag, reset time and time on a wrong lane of one clip's frames (with `time_s`)."""
    frames = sorted(frames, key=lambda f: f.time_s if math.isfinite(f.time_s) else 0.0)
    if not frames:
        raise LanelibError("clip_score: needed frames of a clip, found none")
    time_s = np.array([f.time_s for f in frames])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frame with neither line has no mean: NaN is right
        centre = np.array([np.nanmean(f.lateral_m, axis=0) for f in frames])
    steps = np.diff(centre[:, DISTANCES_M.index(10.0)])
    steps = steps[np.isfinite(steps)]
    far = DISTANCES_M.index(20.0)
    truth = np.array([f.centre_m[far] for f in frames])
    return ClipScore(
        frames[0].clip,
        len(frames),
        float(np.sqrt(np.mean(steps**2))) if len(steps) else NAN,
        lag_s(time_s, truth, truth + centre[:, far]),
        _reset_s(frames, time_s),
        _longest_s([f.wrong for f in frames], time_s),
    )


def lag_s(
    time_s: np.ndarray, truth: np.ndarray, found: np.ndarray, *, longest_s: float = 1.0, moving: float = 0.05
) -> float:
    """The delay (s) by which `found` (N,) follows `truth` (N,): where found(t) - truth(t - delay) varies least.

    Delays of -0.2 .. `longest_s` in steps of 10 ms are tried. NaN for fewer than 25 common samples, and where the truth
    moves (standard deviation) by less than `moving`: then any delay fits.
    """
    known = np.isfinite(time_s) & np.isfinite(truth)
    if known.sum() < 25 or np.std(truth[known]) < moving:
        return NAN
    delays = np.arange(-0.2, longest_s + 0.005, 0.01)
    inside = np.isfinite(found) & (time_s > time_s[known][0] + longest_s) & (time_s < time_s[known][-1] - 0.2)
    if inside.sum() < 25:
        return NAN
    spread = [np.std(found[inside] - np.interp(time_s[inside] - d, time_s[known], truth[known])) for d in delays]
    return float(round(delays[int(np.argmin(spread))], 2))


def _reset_s(frames: list[FrameScore], time_s: np.ndarray) -> float:
    """The longest time from the begin of a lane (or of the clip) to the first right lane."""
    waits, begin = [], None
    for i, frame in enumerate(frames):
        if not frame.has_lane:
            begin = None
        elif begin is None and (i == 0 or not frames[i - 1].has_lane):
            begin = time_s[i]
        if begin is not None and frame.claimed and not frame.wrong:
            waits.append(time_s[i] - begin)
            begin = None
    if begin is not None:
        waits.append(time_s[-1] - begin)
    return float(max(waits, default=NAN))


def _longest_s(flags: list[bool], time_s: np.ndarray) -> float:
    """The longest time for which the flag stays, each frame counting until the next one."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    longest = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        longest = max(longest, run)
    return longest * step


# ---------------------------------------------------------------------------------------------- tables
def table(rows: list[list[str]]) -> str:
    """Rows of texts as a Markdown table: the first row is its head, the first column to the left, the others right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| "
        + " | ".join(t.rjust(w) if i else t.ljust(w) for i, (t, w) in enumerate(zip(row, widths, strict=True)))
        + " |"
        for row in rows
    ]
    rule = "|" + "|".join("-" * (w + 1) + (":" if i else "-") for i, w in enumerate(widths)) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def _pixel_head() -> list[str]:
    return ["frames", "n", "TuSimple", "strict", "lanes", "seen", "mean px", "p95 px"]


def _pixel_row(tag: str, s: PixelScore, frames) -> list[str]:
    shares = [_fixed(v, 3) for v in (s.tusimple, s.strict, s.lanes, s.seen)]
    return [tag, str(len(frames)), *shares, _fixed(s.mean_px, 2), _fixed(s.p95_px, 1)]


def _metric_head() -> list[str]:
    return [
        "found",
        "false",
        *(f"cm at {d:.0f} m" for d in DISTANCES_M),
        "offset cm",
        "width cm",
        "heading mrad",
        "bend %",
        "straight 1/km",
    ]


def _metric_row(frames) -> list[str]:
    s = metric_score(frames)
    return [
        _fixed(s.found, 3),
        f"{s.false_lanes}/{s.empty}",
        *(_cm(v) for v in s.lateral_m),
        _cm(s.offset_m),
        _cm(s.width_m),
        _fixed(s.heading_rad * 1e3, 1),
        _fixed(s.curvature * 100, 1),
        _fixed(s.curvature_1pm * 1e3, 2),
    ]


def _fixed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _cm(value_m: float) -> str:
    return _fixed(value_m * 100, 1)


def _without_nan(value):
    if isinstance(value, dict):
        return {key: _without_nan(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
