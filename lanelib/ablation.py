"""What each idea gains: the same frames with one idea taken away at a time, in other light, and with a wrong rig.

    variants        VARIANTS, from the textbook's pipeline to the project's own, with and without each idea
    conditions      CONDITIONS, what light, sensor and codec do to a frame
    error budget    from perfect paint and a perfect rig to real ones, one source of error at a time

All of it is finders of different make over the same frames, judged by `evaluate`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from lanelib import jointfit
from lanelib.birdseye import Grid
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.evaluate import DISTANCES_M, Evaluation, fixed, score, table
from lanelib.finder import LaneFinder
from lanelib.hypotheses import hypotheses
from lanelib.jointfit import HILL, PITCH, Points, Prior
from lanelib.labels import line_points
from lanelib.lane import Lane
from lanelib.paint import evidence_of, paint_points
from lanelib.result import LaneResult
from lanelib.rig import SCAN_ROWS, Rig, View
from lanelib.scores import AT_10_M, FrameScore, metric_score, pixel_score
from lanelib.tracking import LaneTracker

LATERAL_HEAD = [f"cm at {d:.0f} m" for d in DISTANCES_M[AT_10_M:]]  # the tables begin at 10 m
# As good as known: a hundredth of what cars do. Zero would leave the prior's covariance without an inverse.
KNOWN_PITCH_RAD, KNOWN_HILL_1PM = math.radians(0.007), 1 / 600_000


# ---------------------------------------------------------------------------------------------- variants
class FlatRoadTracker(LaneTracker):
    """A tracker that takes the rig's flat plane for the road: no nod of the car, no hill."""

    @property
    def background(self) -> Prior:
        """The unknown road, but flat."""
        base = super().background
        mean, spread = base.mean.copy(), np.sqrt(np.diag(base.covariance))
        mean[[PITCH, HILL]] = 0
        spread[[PITCH, HILL]] = KNOWN_PITCH_RAD, KNOWN_HILL_1PM
        return Prior(mean, np.diag(spread**2))


class FlatRoadFinder(LaneFinder):
    """A finder that does not estimate pitch and hill: what the joint fit is without them."""

    def __init__(self, rig: Rig, **options):
        super().__init__(rig, **options)
        self.tracker = FlatRoadTracker(smoothing=self.tracker.smoothing, fps=self.tracker.fps)


@dataclass(frozen=True)
class Variant:
    """A way to build the finder.

    ``options``: of `LaneFinder`; ``flat``: without pitch and hill; ``idea``: what it adds to the one before, in words.
    """

    name: str
    idea: str
    options: Mapping[str, Any] = field(default_factory=dict)
    flat: bool = False

    def finder(self, rig: Rig, *, track: bool, smoothing: str = "kalman") -> LaneFinder:
        """A fresh finder of this make."""
        make = FlatRoadFinder if self.flat else LaneFinder
        return make(rig, track=track, smoothing=smoothing, **self.options)


CLASSIC = "sobel-or-colour"  # of the three classic recipes the one that loses fewest of the shipped frames
VARIANTS = (
    Variant("textbook", "a threshold recipe, sliding windows, two lines apart", {"recipe": CLASSIC}),
    Variant("paint, two lines", "ridges in place of bright pixels, the rest as before", {"model": "windows"}),
    Variant("textbook's mask, joint lane", "one lane in place of two lines, the mask as in the first",
            {"recipe": CLASSIC, "model": "joint"}, flat=True),
    Variant("paint, joint lane", "both, and a weight for every point in place of yes or no", flat=True),
    Variant("with pitch and hill", "the car nods, the road is not flat: estimated, too"),
)


@dataclass(frozen=True, eq=False)
class Run:
    """What a finder said about frames: its scores and its rows by name (`LaneResult.to_row`)."""

    evaluation: Evaluation
    rows: Mapping[str, dict]

    def failures(self) -> list[tuple[FrameScore, str]]:
        """Frames with a lane that is missed or wrong, or a lane claimed where there is none; each with the reason."""
        found = []
        for frame in self.evaluation.frames:
            row = self.rows[frame.name]
            if frame.wrong:
                off = np.abs(frame.lateral_m[:, AT_10_M])
                what = f"a line {np.nanmax(off):.2f} m off at 10 m" if frame.has_lane else "a lane where there is none"
                found.append((frame, f"wrong: {what}"))
            elif frame.has_lane and not frame.claimed:
                found.append((frame, f"missed: {row['reason']}"))
        return found

    @property
    def right(self) -> float:
        """Share of the frames on which nothing is wrong and nothing missed."""
        return 1 - len(self.failures()) / len(self.evaluation.frames)


def run(finder: LaneFinder, frames: Iterable[tuple[str, np.ndarray]], truth: Mapping[str, dict], camera: Camera) -> Run:
    """The finder over (name, frame_bgr) pairs, in order, from a fresh start; scored against ``truth`` by name.

    ``camera``: the true one, of the frames' size. Raises LanelibError where a frame has no truth.
    """
    finder.reset()
    rows = {name: finder.process(frame).to_row(name) for name, frame in frames}
    unknown = [name for name in rows if name not in truth]
    if unknown or not rows:
        found = f"none for {unknown[0]!r}" if unknown else "no frame"
        raise LanelibError(f"an ablation needs frames and the truth of each, found {found}; give the set's own truth")
    return Run(score({name: truth[name] for name in rows}, rows, camera), rows)


def ablate(
    rig: Rig,
    frames: Mapping[str, np.ndarray],
    truth: Mapping[str, dict],
    *,
    track: bool = False,
    variants: Sequence[Variant] = VARIANTS,
) -> dict[str, Run]:
    """Every variant over the same frames (name: frame_bgr); ``track``: they are a clip, in order."""
    camera = rig.scaled(next(iter(frames.values())).shape[1::-1]).camera if frames else rig.camera
    return {v.name: run(v.finder(rig, track=track), frames.items(), truth, camera) for v in variants}


def comparison(runs: Mapping[str, Run]) -> str:
    """Runs as a Markdown table: shares right, TuSimple, strict; cm at 10, 20, 30 m, offset; a clip's jitter."""
    over_time = any(r.evaluation.clips() for r in runs.values())
    head = ["", "frames right", "TuSimple", "strict", *LATERAL_HEAD, "offset cm"]
    rows = [head + ["jitter cm", "longest wrong s"] * over_time]
    for name, one in runs.items():
        metric, pixels = metric_score(one.evaluation.frames), one.evaluation.pixels
        row = [name, fixed(one.right, 2), fixed(pixels.tusimple, 2), fixed(pixels.strict, 2)]
        row += [fixed(100 * m, 1) for m in (*metric.lateral_m[AT_10_M:], metric.offset_m)]
        if over_time:
            clip = one.evaluation.clips()[0]
            row += [fixed(100 * clip.jitter_m, 2), fixed(clip.wrong_s, 2)]
        rows.append(row)
    return table(rows)


def by_tag(one: Run) -> str:
    """A run as a Markdown table with a row per tag: frames, share right, TuSimple, cm at 10, 20, 30 m."""
    rows = [["tag", "frames", "right", "TuSimple", *LATERAL_HEAD]]
    for tag, frames in one.evaluation.by_tag().items():
        part = Run(replace(one.evaluation, frames=frames, pixels=pixel_score(frames)), one.rows)
        lateral = metric_score(frames).lateral_m
        row = [tag, str(len(frames)), fixed(part.right, 2), fixed(part.evaluation.pixels.tusimple, 2)]
        rows.append(row + [fixed(100 * m, 1) for m in lateral[AT_10_M:]])
    return table(rows)


# ---------------------------------------------------------------------------------------------- conditions
def lit(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    """Less (or more) light: every grey level times ``factor``, cut off at 255."""
    return lambda frame: cv2.convertScaleAbs(frame, alpha=factor)


def warm(frame: np.ndarray) -> np.ndarray:
    """Evening light, or a wrong white balance: blue down by 15 %, red up by 15 %."""
    return np.clip(frame * np.array([0.85, 1.0, 1.15]), 0, 255).astype(np.uint8)


def noisy(frame: np.ndarray) -> np.ndarray:
    """A small sensor at dusk: Gaussian noise of 12 grey levels, the same every time."""
    noise = np.random.default_rng(0).standard_normal(frame.shape, np.float32) * 12
    return np.clip(frame + noise, 0, 255).astype(np.uint8)


def blurred(frame: np.ndarray) -> np.ndarray:
    """Out of focus, or a drop on the lens: sigma 2.5 px."""
    return cv2.GaussianBlur(frame, (0, 0), 2.5)


def compressed(frame: np.ndarray) -> np.ndarray:
    """A cheap dash cam's stream: JPEG at quality 20."""
    coded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 20])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))


CONDITIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as it is": lambda frame: frame,
    "light x 0.35": lit(0.35),
    "light x 0.7": lit(0.7),
    "light x 1.4": lit(1.4),
    "warm": warm,
    "noise 12": noisy,
    "blur 2.5 px": blurred,
    "JPEG 20": compressed,
}


# ---------------------------------------------------------------------------------------------- the error budget
def believed_error_m(lane: Lane | None, truth: Mapping, at_m: Sequence[float] = DISTANCES_M) -> np.ndarray:
    """(2, n): x of left and right line as the car believes it, in metres, minus the true one; NaN where unknown.

    Not the same as an error in pixels: a wrong pitch puts the right pixels at wrong metres.
    """
    at = np.asarray(at_m, float)
    if lane is None or len(truth["lanes_road_m"]) != 2:
        return np.full((2, len(at)), math.nan)
    errors = []
    for line, points in zip((lane.left, lane.right), truth["lanes_road_m"], strict=True):
        x, y = np.asarray(points, float).T
        errors.append(line.x(at) - np.interp(at, y, x, left=math.nan, right=math.nan))
    return np.array(errors)


def perfect_points(view: View, truth: Mapping) -> Points:
    """Paint points exactly where the truth sees each line: what a perfect threshold would find, one per row."""
    rows, metres = [], []
    for side in (0, 1):
        v, u = line_points(truth, side)
        if len(v) < 2:
            continue
        every = np.arange(v[0], v[-1] + 0.5)
        pixels = np.column_stack([np.interp(every, v, u), every])
        flat = view.rig.birdseye.road_from_points(view.rig.camera.undistort_points(pixels))
        inside = (flat[:, 1] > view.grid.y_m[-1]) & (flat[:, 1] < view.grid.y_m[0])
        metres.append(flat[inside])
        rows.append(np.abs(view.grid.y_m[:, None] - flat[inside, 1]).argmin(axis=0))
    x, y = np.concatenate(metres).T if metres else np.empty((2, 0))
    row = np.concatenate(rows) if rows else np.empty(0, int)
    return Points(x / y, 1 / y, row, np.ones(len(y)), view.focal_px, view.height_m, len(view.grid.y_m))


def perfect_lane(view: View, truth: Mapping) -> Lane | None:
    """The joint fit of `perfect_points`: what is left is the fit's own error. None where no lane comes of them."""
    return best_lane(view, perfect_points(view, truth))


def best_lane(view: View, points: Points) -> Lane | None:
    """The lane that explains most of these paint points, or None: a fresh search without any test of what it finds."""
    best = max(jointfit.fits(points, hypotheses(points)), key=lambda fit: fit.energy, default=None)
    return None if best is None else view.lane(best)


def nodded(rig: Rig, pitch_deg: float) -> Rig:
    """The rig as it is wrong when the car nods by ``pitch_deg`` (nose down): it still believes the pitch before.

    The frames stay; the rig turns the other way.
    """
    return replace(rig, birdseye=rig.birdseye.pitched(rig.camera, -math.radians(pitch_deg)))


def without_lens(rig: Rig) -> Rig:
    """The rig with the distortion left out."""
    return replace(rig, camera=replace(rig.camera, distortion=np.zeros(5)))


def error_budget(
    rig: Rig,
    frames: Mapping[str, np.ndarray],
    truth: Mapping[str, dict],
    *,
    calibrated: Camera | None = None,
    nod_deg: float = 0.3,
) -> dict[str, np.ndarray]:
    """Median error in metres (n,) at `DISTANCES_M` of what the car believes, by what is wrong.

    From the true ``rig`` and perfect paint on, one source at a time; ``calibrated``: a camera of one's own boards
    in place of the true one (mounting as before). ``nod_deg``: 0.3 degrees is a braking car.
    """
    view = View(rig)
    perfect = [believed_error_m(perfect_lane(view, truth[n]), truth[n]) for n in frames]
    budget = {"the fit alone, on perfect paint": _median(perfect)}
    rigs = {"paint as found": (rig, False)}
    if calibrated is not None:
        # the plane's pixels keep their rays: K_true^-1 u_true = K_own^-1 u_own
        turn = rig.camera.camera_matrix @ np.linalg.inv(calibrated.camera_matrix)
        own = replace(rig.birdseye, road_from_image=rig.birdseye.road_from_image @ turn)
        rigs["camera from the boards"] = (replace(rig, camera=calibrated, birdseye=own), False)
    rigs |= {
        "distortion ignored": (without_lens(rig), False),
        f"nod of {nod_deg:g} deg, pitch estimated": (nodded(rig, nod_deg), False),
        f"nod of {nod_deg:g} deg, pitch taken as known": (nodded(rig, nod_deg), True),
    }
    for name, (wrong, flat) in rigs.items():
        finder = (FlatRoadFinder if flat else LaneFinder)(wrong, track=False)
        lanes: dict[str, LaneResult] = {n: finder.process(f) for n, f in frames.items()}
        budget[name] = _median([believed_error_m(lanes[n].lane, truth[n]) for n in frames])
    return budget


# ---------------------------------------------------------------------------------------------- the size of the view
def view_of_size(rig: Rig, *, column_m: float, rows: int) -> View:
    """The rig's small bird's-eye view with another number of columns and rows over the same piece of road."""
    whole = rig.scan_grid
    n = round(whole.x_m[-1] / column_m)
    y = np.linspace(whole.y_m[0] ** -0.5, whole.y_m[-1] ** -0.5, rows) ** -2  # spaced as the rig's own
    sized = replace(rig)
    sized.__dict__["scan_grid"] = Grid(np.arange(-n, n + 1) * column_m, y)  # in place of what the rig would work out
    return View(sized)


def lane_in_view(view: View, frame_bgr: np.ndarray) -> Lane | None:
    """The best lane of one frame (H, W, 3) uint8 BGR as this view sees it, or None. Rows count by the road they cover,
    so that a view with few of them is not at a disadvantage."""
    z = evidence_of(*view.paint_channels(frame_bgr), column_m=view.grid.column_m)
    points = view.points(paint_points(z))
    return best_lane(view, replace(points, weight=points.weight * SCAN_ROWS / points.n_rows))


def _median(errors: Sequence[np.ndarray]) -> np.ndarray:
    """Median of absolute values over frames and lines, NaN left out."""
    columns = [column[np.isfinite(column)] for column in np.abs(np.concatenate(errors)).T]
    return np.array([np.median(column) if len(column) else math.nan for column in columns])
