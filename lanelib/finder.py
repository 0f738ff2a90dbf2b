"""LaneFinder: a frame in, a LaneResult out. The whole pipeline in the order that makes it fast.

    raw frame -> one table (distortion and homography together) -> small bird's-eye view -> paint points -> joint fit -> lane

The textbook order (undistort, threshold, warp, windows) is the same functions in another order; ``LaneFinder(order="textbook")``
runs it, for the lesson, for the classic recipes and for comparison.
"""

from __future__ import annotations

import json
import math
import os
import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from lanelib import jointfit, search, threshold
from lanelib.birdseye import BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.jointfit import JointFit, Points
from lanelib.lane import Check, Lane, Line, NoLine, check_lane, fit_line
from lanelib.paint import PaintPoints, paint_channels, paint_evidence, paint_points
from lanelib.tracking import LaneTracker

RIG_FORMAT = "lanelib-rig/1"
SCAN_COLUMN_M, SCAN_REACH_M, SCAN_ROWS = 0.05, 9.6, 136
FAR_ROW_M = 10.0  # the farthest scan row is where one pixel of a 1280-wide frame covers 10 m of road


# ---------------------------------------------------------------------------------------------- rig
@dataclass(frozen=True)
class Rig:
    """A camera and how it sees the road: everything the finder must know, and nothing about the road itself. One readable file."""

    camera: Camera
    birdseye: BirdsEye
    name: str = "rig"
    notes: str = ""

    @property
    def size_wh(self) -> tuple[int, int]:
        return self.camera.size_wh

    @cached_property
    def mounting(self) -> dict:
        """height_m, pitch_deg, yaw_deg, roll_deg of the camera."""
        return self.birdseye.mounting(self.camera)

    @cached_property
    def near_m(self) -> float:
        """Distance of the road that the middle of the lowest row shows."""
        w, h = self.size_wh
        return float(self.birdseye.road_from_points(self.camera.undistort_points([[(w - 1) / 2, h - 1.0]]))[0, 1])

    @cached_property
    def scan_grid(self) -> Grid:
        """The small bird's-eye view the finder works on: 5 cm columns; rows closer together far away, where they
        are worth more: equal steps of 1/sqrt(y), between equal metres and equal pixels of the frame."""
        focal_720p = self.camera.camera_matrix[1, 1] * 1280 / self.size_wh[0]
        far = math.sqrt(FAR_ROW_M * focal_720p * self.mounting["height_m"])
        if not 0 < self.near_m < far:
            raise LanelibError(f"the rig {self.name!r} sees no road: its lowest row looks {self.near_m:.1f} m ahead; make the rig again")
        n = int(round(SCAN_REACH_M / SCAN_COLUMN_M))
        rows = np.linspace(1 / math.sqrt(far), 1 / math.sqrt(self.near_m), SCAN_ROWS) ** -2
        return Grid(np.arange(-n, n + 1) * SCAN_COLUMN_M, rows)

    def scaled(self, size_wh) -> Rig:
        """The same rig for another resolution of the same camera; LanelibError where the aspect ratio differs."""
        if tuple(size_wh) == tuple(self.size_wh):
            return self
        return replace(self, camera=self.camera.scaled(size_wh), birdseye=self.birdseye.scaled(size_wh))

    def to_dict(self) -> dict:
        return {"format": RIG_FORMAT, "name": self.name, "camera": self.camera.to_dict(),
                "road_from_image": self.birdseye.road_from_image.tolist(), "notes": self.notes}

    @classmethod
    def from_dict(cls, numbers: dict) -> Rig:
        camera = Camera.from_dict(numbers["camera"])
        birdseye = BirdsEye(np.array(numbers["road_from_image"], float), camera.size_wh)
        return cls(camera, birdseye, str(numbers.get("name", "rig")), str(numbers.get("notes", "")))

    def save(self, path) -> Path:
        path = Path(path)
        part = path.with_name(path.name + ".part")
        try:
            part.write_text(json.dumps(self.to_dict(), indent=1) + "\n")
            os.replace(part, path)
        except OSError as error:
            raise LanelibError(f"cannot write the rig {path}: {error.strerror}; choose another place") from None
        return path

    @classmethod
    def load(cls, path) -> Rig:
        path = Path(path)
        try:
            numbers = json.loads(path.read_text())
            if numbers["format"] != RIG_FORMAT:
                raise KeyError(numbers["format"])
            return cls.from_dict(numbers)
        except OSError as error:
            raise LanelibError(f"cannot read the rig {path}: {error.strerror}; make one with `lanelib rig`") from None
        except LanelibError as error:
            raise LanelibError(f"{path}: {error}") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise LanelibError(f"{path} is not a rig file ({RIG_FORMAT}); make one with `lanelib rig`") from None


# ---------------------------------------------------------------------------------------------- result
@dataclass(frozen=True, eq=False)
class LaneResult:
    """What one frame said. ``status``: "measured", "held" (from frames before) or "none"; then ``reason`` says why.

    ``left_px``, ``right_px``: (N, 2) pixels of the frame as given, from near to far, over the part where the lane was seen.
    """

    lane: Lane | None
    status: str
    reason: str = ""
    confidence: float = 0.0
    checks: tuple[Check, ...] = ()
    left_px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    right_px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    size_wh: tuple[int, int] = (0, 0)
    milliseconds: float = 0.0
    fit: JointFit | None = None

    def __bool__(self):
        return self.lane is not None

    @property
    def radius_m(self) -> float | None:
        return self.lane.radius_m if self.lane else None

    @property
    def curvature_1pm(self) -> float | None:
        return self.lane.curvature_1pm if self.lane else None

    @property
    def offset_m(self) -> float | None:
        return self.lane.offset_m if self.lane else None

    @property
    def width_m(self) -> float | None:
        return float(self.lane.width_m()) if self.lane else None

    def to_row(self, raw_file: str, *, step_px: int = 10) -> dict:
        """This result as one line of the TuSimple layout (see docs/ARCHITECTURE.md), over the rows where the lane was seen."""
        w, h = self.size_wh
        lines = [line_at_rows(p, np.arange(0, h, step_px), w) for p in (self.left_px, self.right_px)]
        seen = [i for i in range(len(lines[0])) if lines[0][i] >= 0 or lines[1][i] >= 0]
        rows = range(seen[0], seen[-1] + 1) if seen else range(0)
        number = lambda v, digits: None if v is None or not math.isfinite(v) else round(float(v), digits)  # noqa: E731
        return {
            "raw_file": raw_file, "h_samples": [i * step_px for i in rows], "lanes": [[line[i] for i in rows] for line in lines] if seen else [],
            "run_time": round(self.milliseconds, 3), "status": self.status, "reason": self.reason, "confidence": round(self.confidence, 3),
            "radius_m": number(self.radius_m, 1), "curvature_1pm": number(self.curvature_1pm, 7), "offset_m": number(self.offset_m, 3),
            "lane_width_m": number(self.width_m, 3)}

    def __repr__(self):
        return f"LaneResult({self.status}, confidence {self.confidence:.2f}, {self.lane or self.reason})"


def line_at_rows(points_px: np.ndarray, rows: np.ndarray, width: int) -> list[float]:
    """x of a line (N, 2), near to far, at picture rows; -2 outside the line or the picture (the TuSimple convention)."""
    if len(points_px) < 2:
        return [-2] * len(rows)
    falling = np.flatnonzero(np.diff(points_px[:, 1]) >= 0)  # from near to far a line climbs; beyond a crest it would turn back
    points_px = points_px[: falling[0] + 1] if len(falling) else points_px
    if len(points_px) < 2:
        return [-2] * len(rows)
    x = np.interp(rows, points_px[::-1, 1], points_px[::-1, 0], left=-2, right=-2)
    return [round(float(v), 2) if 0 <= v <= width - 1 else -2 for v in x]


# ---------------------------------------------------------------------------------------------- finder
MINIMUM_ENERGY = 14.0  # noise pictures reach 5, the faintest labelled lane 40 (see tests/test_finder.py)
MINIMUM_ROWS = 10.0  # rows of clear paint on both lines together, of 136
CLEAR_ROWS = 6.0  # with at least so many rows of paint on the weaker line the tracked lane is beyond doubt
FADING = 0.8  # less paint than this share of the last second's: the lane may have left the prediction behind
LOOK_AGAIN = 2  # in doubt, every second frame is searched afresh ...
RIVAL_ENERGY = 3.0  # ... and another lane takes over when it is worth this much more, twice in succession
FARTHEST_M = 160.0  # beyond, a pixel row of a 1280-wide frame covers more than 15 m of road
EXTEND = 2.0  # lines are reported to twice the distance of the last paint: half the way that is left to the horizon in the picture


class LaneFinder:
    """Finds the ego lane in frames of one rig.

    ``recipe``: "paint" (the project's own) or one of the classic recipes of ``threshold.RECIPES``, which run in the textbook order with
    sliding windows. ``track=False`` looks at each frame on its own. ``smoothing``: see ``tracking``.
    """

    def __init__(self, rig: Rig, *, recipe: str = "paint", track: bool = True, smoothing: str = "kalman", order: str | None = None):
        if recipe not in threshold.RECIPES:
            raise LanelibError(f"recipe must be one of {', '.join(threshold.RECIPES)}, found {recipe!r}")
        self.rig, self.recipe, self.track = rig, recipe, track
        self.order = order or ("finder" if recipe == "paint" else "textbook")
        if self.order not in ("finder", "textbook") or (self.order == "finder" and recipe != "paint"):
            raise LanelibError(f"the order must be 'finder' (recipe paint only) or 'textbook', found {self.order!r} with recipe {recipe!r}")
        self.tracker = LaneTracker(smoothing=smoothing)
        self._views: dict[tuple[int, int], View] = {}
        self._doubts, self._rival, self._usual_rows = 0, None, 0.0

    def reset(self) -> None:
        """Forget what was seen so far."""
        self.tracker = LaneTracker(smoothing=self.tracker.smoothing)
        self._doubts, self._rival, self._usual_rows = 0, None, 0.0

    def view(self, size_wh) -> View:
        """The rig prepared for frames of this size (kept for the next frame)."""
        if size_wh not in self._views:
            if len(self._views) > 3:
                self._views.clear()
            self._views[size_wh] = View(self.rig.scaled(size_wh))
        return self._views[size_wh]

    def process(self, frame_bgr: np.ndarray) -> LaneResult:
        """The lane in ``frame_bgr`` (H, W, 3) uint8 BGR; grey and BGRA are taken too. Never raises for a uint8 array:
        a frame that cannot be used gives status "none" and the reason."""
        begin = time.perf_counter()
        try:
            frame = as_bgr(frame_bgr)
            view = self.view((frame.shape[1], frame.shape[0]))
        except LanelibError as error:
            return LaneResult(None, "none", str(error))
        points, picture = self.points(frame, view)
        fit, reason, checks = self._measure(points, view)
        if fit is not None and picture is not None:
            fit = replace(fit, inward_m=jointfit.inward(fit, picture, view.grid))
        result = self._result(fit, reason, checks, view)
        return replace(result, milliseconds=(time.perf_counter() - begin) * 1e3)

    def points(self, frame: np.ndarray, view: View) -> tuple[Points, np.ndarray]:
        """Paint points of a frame, in the finder's or the textbook order, and the picture (H, W) of brightness plus yellow
        in which they were seen."""
        if self.order == "finder":
            scan = view.scan(frame)
            return view.points(paint_points(*paint_evidence(scan, column_m=SCAN_COLUMN_M))), cv2.add(*paint_channels(scan))
        mask = view.scan_undistorted(threshold.RECIPES[self.recipe].function(view.rig.camera.undistort(frame)))
        return view.points_of_mask(mask), mask

    def _measure(self, points: Points, view: View):
        """A fit that passes every test, or None and why not."""
        prior = self.tracker.fit_prior() if self.track else None
        if prior is None:
            self._rival = None
            fresh = self._accept(self._search(points), view)
            self._usual_rows = fresh[0].support.sum() if fresh[0] else 0.0
            return fresh
        fit = jointfit.fit(points, self.tracker.predict().mean, prior=prior, gates=jointfit.TRACK_GATES, reach_m=(140,))
        tracked = self._accept(fit, view)
        rows = fit.support.sum()
        fading = rows < FADING * self._usual_rows
        self._usual_rows += 0.1 * (rows - self._usual_rows)
        if tracked[0] is not None and is_clear(fit) and not fading:
            self._doubts, self._rival = 0, None
            return tracked
        self._doubts += 1
        if self._doubts % LOOK_AGAIN != 1:
            return tracked
        fresh = self._accept(self._search(points), view)
        if fresh[0] is None or not self._outdoes(fresh[0], fit, tracked[0] is None):
            self._rival = None
            return tracked
        confirmed = self._rival is not None and not jointfit.differ(fresh[0].mean, self._rival)
        self._rival = fresh[0].mean
        if not confirmed:
            return tracked
        self._rival, self._doubts, self._usual_rows = None, 0, fresh[0].support.sum()
        self.tracker.reset()
        return fresh

    def _outdoes(self, fresh: JointFit, tracked: JointFit, lost: bool) -> bool:
        """A fresh search found another lane that explains the frame better than the tracked one does."""
        if not jointfit.differ(fresh.mean, tracked.mean):
            return lost
        background = self.tracker.background
        return fresh.energy > jointfit.energy_of(tracked.mean, tracked.support, background) + (0 if lost else RIVAL_ENERGY)

    def _accept(self, fit: JointFit | None, view: View):
        """(fit or None, reason, checks)."""
        reason, checks = self._judge(fit, view)
        return (None if reason else fit), reason, checks

    def _search(self, points: Points) -> JointFit | None:
        prior = self.tracker.background
        fits = [jointfit.fit(points, start, prior=prior) for start in jointfit.hypotheses(points, prior=prior)]
        return max(fits, key=lambda f: f.energy, default=None)

    def _judge(self, fit: JointFit | None, view: View) -> tuple[str, tuple[Check, ...]]:
        if fit is None:
            return "no paint that could be a pair of lane lines", ()
        if fit.support.sum() < MINIMUM_ROWS or fit.energy < MINIMUM_ENERGY:
            return f"too little paint: {fit.support.sum():.0f} rows of it on both lines together, {MINIMUM_ROWS:.0f} needed", ()
        checks = check_lane(view.lane(fit))
        failed = [c for c in checks if not c.ok]
        return (f"implausible lane: {failed[0].name} {failed[0].value:.3g}, allowed {failed[0].limit}" if failed else ""), checks

    def _result(self, fit, reason, checks, view: View) -> LaneResult:
        if self.track:
            event = self.tracker.update(fit, reason)
            fit, status = self.tracker.fit, event.status
        else:
            status = "measured" if fit is not None else "none"
        if fit is None:
            return LaneResult(None, "none", reason, 0.0, checks, size_wh=view.rig.size_wh)
        lane = view.lane(fit)
        left, right = view.lines_px(lane)
        confidence = confidence_of(fit) * (1 - self.tracker.missed / (self.tracker.hold_frames + 1) if self.track else 1)
        return LaneResult(lane, status, reason, confidence, checks, left, right, view.rig.size_wh, 0.0, fit)


def is_clear(fit: JointFit) -> bool:
    """Both lines have paint of their own."""
    return bool(fit.support.sum(axis=1).min() >= CLEAR_ROWS)


def confidence_of(fit: JointFit) -> float:
    """0..1 from how many rows of paint each line has: 1 - exp(-rows / 12), the stronger line counting double
    (it carries the weaker one), times how sharply the points agree."""
    weak, strong = sorted(1 - np.exp(-fit.support.sum(axis=1) / 12))
    return float((2 * strong + weak) / 3 * np.exp(-((fit.rms_px / 6) ** 2)))


def as_bgr(frame: np.ndarray) -> np.ndarray:
    """Any uint8 picture as (H, W, 3) BGR; LanelibError for what is none."""
    if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8:
        found = f"dtype {frame.dtype}" if isinstance(frame, np.ndarray) else type(frame).__name__
        raise LanelibError(f"a frame must be a numpy array of uint8, found {found}; convert it first")
    if frame.ndim == 3 and frame.shape[2] == 1:
        frame = frame[:, :, 0]
    if frame.size == 0 or frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] not in (3, 4)):
        raise LanelibError(f"a frame must be (H, W), (H, W, 3) or (H, W, 4), found shape {frame.shape}")
    if frame.ndim == 2:
        return cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR)
    return np.ascontiguousarray(frame[:, :, :3])


class View:
    """A rig prepared for one frame size: the look-up table and the geometry of the scan grid, computed once."""

    def __init__(self, rig: Rig):
        self.rig, self.grid = rig, rig.scan_grid
        self._table = rig.birdseye.table(rig.camera, self.grid)
        self.height_m = rig.mounting["height_m"]
        self.focal_px = float(rig.camera.camera_matrix[0, 0] * 1280 / rig.size_wh[0])  # in pixels of a 1280-wide frame

    @cached_property
    def _undistorted_table(self):
        camera = self.rig.camera
        return self.rig.birdseye.table(replace(camera, distortion=np.zeros(5)), self.grid)

    def scan(self, frame: np.ndarray) -> np.ndarray:
        """The small bird's-eye view of a frame as given."""
        return cv2.remap(frame, *self._table, cv2.INTER_LINEAR)

    def scan_undistorted(self, picture: np.ndarray) -> np.ndarray:
        """The same of an undistorted picture or mask."""
        return cv2.remap(picture, *self._undistorted_table, cv2.INTER_LINEAR)

    def points(self, paint: PaintPoints) -> Points:
        inverse = 1 / self.grid.y_m[paint.row]
        return Points(self.grid.x_of(paint.column) * inverse, inverse, paint.row, paint.weight, self.focal_px, self.height_m,
                      len(self.grid.y_m), paint.yellow)

    def points_of_mask(self, mask: np.ndarray) -> Points:
        """Points of a 0/255 mask on the scan grid: the middles of what is white."""
        z = cv2.blur(mask.astype(np.float32), (5, 3)) * (6.0 / 255)
        return self.points(paint_points(z))

    def lane(self, fit: JointFit) -> Lane:
        return fit.lane(self.rig.near_m, self.grid.y_m)

    def lines_px(self, lane: Lane, *, count: int = 64) -> tuple[np.ndarray, np.ndarray]:
        """Both lines in pixels of the frame as given, from the lower edge to where the lane is known."""
        near, far = 0.8 * self.rig.near_m, min(EXTEND * lane.y_range_m[1], FARTHEST_M)
        y = 1 / np.linspace(1 / near, 1 / max(far, 2 * near), count)
        lines = []
        for line in (lane.left, lane.right):
            flat = lane.surface.flat_from_road(np.column_stack([line.x(y), y]))
            pixels = self.rig.camera.distort_points(self.rig.birdseye.points_from_road(flat))
            lines.append(pixels[np.isfinite(pixels).all(axis=1)])
        return lines[0], lines[1]
