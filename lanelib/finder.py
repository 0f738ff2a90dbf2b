"""LaneFinder: a frame in, a LaneResult out. The whole pipeline, in two orders.

    finder's order    raw frame -> one table -> small bird's-eye view -> paint points -> joint fit -> lane
    textbook order    raw frame -> undistort -> threshold -> warp -> sliding windows or search around -> two fits
    -> lane

The first is the default. The second is what notebooks 01-04 walk through; the classic recipes run in it. With the
project's own recipe and the joint fit it weighs its points with the response of ``threshold.paint_response`` instead
of the mask: the same measure of paint as in the first order, taken in the frame.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import cv2
import numpy as np

from lanelib import jointfit, threshold, windows
from lanelib.channels import as_bgr
from lanelib.doubleline import inward
from lanelib.errors import LanelibError
from lanelib.hypotheses import hypotheses
from lanelib.jointfit import JointFit, Points, Prior, confidence_of, landmarks
from lanelib.lane import Check, Lane, check_lane, check_size
from lanelib.neighbours import MOST_LANES, find_neighbours
from lanelib.paint import evidence_of, paint_channels, paint_points
from lanelib.result import LaneResult, line_at_rows
from lanelib.rig import SCAN_COLUMN_M, Rig, View
from lanelib.tracking import FPS, LaneTracker
from lanelib.verge import MOST_VALUE, verge_objection

__all__ = ["LaneFinder", "LaneResult", "Rig", "View", "confidence_of", "line_at_rows"]

MINIMUM_ENERGY = 7.0  # of the joint fit; pictures of noise reach 3 (tests/test_finder.py)
MINIMUM_ROWS = 6.5  # of clear paint on both lines together, of 112: a dash further away; 1000 pictures of noise reach 6
# Where a lane begins with less than one row on one line, the other needs so many: cracks and stains of bare roads make
# up to 12, and never two lines
ONE_LINE_ROWS = 13.0
MINIMUM_CONFIDENCE = 0.08  # lanes in glare and forest have 0.1 and more, specks on a road without paint 0.05
MODELS = ("joint", "windows")
ANOTHER_LANE_M = 0.1  # starts that lead to the same lane end nearer to each other than that, at 6 and at 20 m
Channels = tuple[np.ndarray, np.ndarray]  # brightness and yellowness, (H, W) uint8 each


class Verdict(NamedTuple):
    """What becomes of a frame's measurement: the ``fit`` that passes every test, or None and the ``reason`` why there
    is none; and the sanity checks, as far as they were made."""

    fit: JointFit | None
    reason: str = ""
    checks: tuple[Check, ...] = ()


class LaneFinder:
    """Finds the ego lane in frames of one rig.

    ``recipe``: "paint" (the project's own) or one of the classic recipes of ``threshold.RECIPES``. ``model``: "joint"
    (one lane) or "windows" (sliding windows, two lines apart; what the classic recipes use by default). ``order``:
    "finder" (warp first) or "textbook" (undistort, threshold, warp). ``track=False`` looks at each frame on its own.
    ``smoothing``: see ``tracking``. ``neighbours``: how many lanes to look for on each side of the ego lane, 0-2; they
    cost a few milliseconds a frame and do not change the ego lane. ``fps``: how many frames a second are tracked.
    Raises LanelibError for an unknown name, and for a rate that is not above 0.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        recipe: str = "paint",
        model: str | None = None,
        order: str | None = None,
        track: bool = True,
        smoothing: str = "kalman",
        neighbours: int = 0,
        fps: float = FPS,
    ):
        self.rig, self.track, self.neighbours = rig, track, int(neighbours)
        self.recipe = threshold.recipe_by_name(recipe)
        own = recipe == threshold.DEFAULT_RECIPE
        self.model = model or ("joint" if own else "windows")
        orders = ("finder", "textbook") if own and self.model == "joint" else ("textbook",)
        self.order = order or orders[0]
        if self.model not in MODELS:
            raise LanelibError(f"a model must be one of {', '.join(MODELS)}, found {self.model!r}")
        if self.order not in orders:
            raise LanelibError(
                f"order {self.order!r} does not go with recipe {recipe!r}, model {self.model!r}; use order='textbook'"
            )
        if not 0 <= self.neighbours <= MOST_LANES:
            raise LanelibError(f"neighbours must be 0 to {MOST_LANES} lanes on each side, found {neighbours}")
        self.tracker = LaneTracker(smoothing=smoothing, fps=fps)
        self._views: dict[tuple[int, int], View] = {}

    def reset(self) -> None:
        """Forget what was seen so far, as before the first frame of another clip."""
        self.tracker = self.tracker.fresh()

    def view(self, size_wh: tuple[int, int]) -> View:
        """The rig prepared for frames of this size; kept for the next frame. LanelibError where the aspect ratio
        does not fit the rig."""
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
            return self._unusable(str(error))
        return self._outcome(frame, view, begin)

    def process_yuv420(self, frame_yuv: np.ndarray) -> LaneResult:
        """The same for a YUV420p frame (H * 3 / 2, W) uint8 as video decoders give it (Y, then U, then V), without
        converting it; H and W even."""
        begin = time.perf_counter()
        try:
            if not isinstance(frame_yuv, np.ndarray) or frame_yuv.dtype != np.uint8 or frame_yuv.ndim != 2:
                raise LanelibError("a YUV420p frame must be a 2-D array of uint8 (H * 3 / 2, W); see video.read_frames")
            height, width = frame_yuv.shape[0] * 2 // 3, frame_yuv.shape[1]
            if height % 2 or width % 2 or frame_yuv.shape[0] != height * 3 // 2 or frame_yuv.size == 0:
                raise LanelibError(f"a YUV420p frame has an even width and height, found {width}x{height}")
            view = self.view((width, height))
        except LanelibError as error:
            return self._unusable(str(error))
        if self.order != "finder":
            return self._outcome(cv2.cvtColor(frame_yuv, cv2.COLOR_YUV2BGR_I420), view, begin)
        return self._outcome(frame_yuv, view, begin)

    def _unusable(self, reason: str) -> LaneResult:
        """A frame that cannot be looked at is a missed one: what was known ages."""
        if self.track:
            self.tracker.update(None, reason)
        return LaneResult(None, "none", reason)

    def stages(self, frame_bgr: np.ndarray) -> dict[str, np.ndarray]:
        """Every intermediate picture by name; see ``stages.stages``. Does not change the tracker."""
        from lanelib.stages import stages  # drawn only on request

        return stages(frame_bgr, self)

    # ------------------------------------------------------------------ the joint model
    def points(self, frame: np.ndarray, view: View) -> tuple[Points, Channels]:
        """Paint points of a frame (BGR, or YUV420p where 2-D), in the finder's or the textbook order, and brightness
        and yellowness, (H, W) uint8 each, of the bird's-eye picture in which they were seen."""
        if self.order == "finder":
            channels = view.paint_channels(frame)
            return view.points(paint_points(evidence_of(*channels, column_m=SCAN_COLUMN_M))), channels
        if self.recipe.name != threshold.DEFAULT_RECIPE:
            mask = view.scan_undistorted(self.mask(frame, view))
            return view.points_of_mask(mask), (mask, np.zeros_like(mask))
        undistorted, horizon = view.rig.camera.undistort(as_bgr(frame)), view.rig.birdseye.horizon_row_px
        response = threshold.paint_response(undistorted, horizon_row=horizon, camera_height_m=view.height_m)
        z = cv2.blur(view.scan_undistorted(response), (3, 3))
        return view.points(paint_points(z)), paint_channels(view.scan_undistorted(undistorted))

    def mask(self, frame: np.ndarray, view: View) -> np.ndarray:
        """The recipe's mask (H, W) uint8 0/255 of the undistorted frame; the project's own recipe is told the rig's
        horizon and how wide paint is below it."""
        undistorted = view.rig.camera.undistort(frame)
        if self.recipe.name != threshold.DEFAULT_RECIPE:
            return self.recipe.function(undistorted)
        slope = threshold.NARROWEST_PAINT_M / view.height_m
        steps = threshold.paint_steps(undistorted, horizon_row=view.rig.birdseye.horizon_row_px, paint_slope=slope)
        return list(steps.values())[-1]

    def _measure_joint(self, frame: np.ndarray, view: View) -> Verdict:
        prediction = self.tracker.predict() if self.track else None
        return self._search(frame, view) if prediction is None else self._track(frame, view, prediction)

    def _search(self, frame: np.ndarray, view: View) -> Verdict:
        """The best lane anywhere, as before the first frame."""
        return self._best(*self.points(frame, view), view)

    def _best(
        self, points: Points, channels: Channels, view: View, *, least_energy: float = -math.inf, known=None
    ) -> Verdict:
        """The best of `_candidates` that passes every test; where none does, why the first one fails."""
        verdicts, bright = [], cv2.add(*channels)  # in which all paint is bright
        for fit in self._candidates(points, channels, view, least_energy, known):
            verdicts.append(self._judge(replace(fit, inward_m=inward(fit, bright, view.grid)), begins=True))
            if verdicts[-1].fit is not None:
                return verdicts[-1]
        return verdicts[0] if verdicts else self._judge(None)

    def _candidates(
        self, points: Points, channels: Channels, view: View, least_energy: float, known: np.ndarray | None
    ) -> list[JointFit]:
        """Lanes around the car that these paint points can be, best first; starts estimated below ``least_energy``,
        and those that lead to the lane that is ``known`` (7,), are not followed."""
        prior = self.tracker.background
        starts = hypotheses(points, prior=prior, least_energy=least_energy, known=known)
        fits = [fit for fit in jointfit.fits(points, starts, prior=prior) if jointfit.holds_car(fit.mean, beside_m=0.0)]
        fits.sort(key=lambda fit: -fit.energy)
        close = [fit.mean for fit in fits if fit.energy > fits[0].energy - MOST_VALUE]
        unsure = len(close) > 1 and np.ptp(landmarks(np.array(close)), axis=0).max() > ANOTHER_LANE_M
        if unsure or known is not None:  # paint alone does not decide
            fits = [replace(fit, objection=verge_objection(*channels, view.grid, fit)) for fit in fits]
            fits.sort(key=lambda fit: -fit.worth)
        return fits

    def _track(self, frame: np.ndarray, view: View, prediction: Prior) -> Verdict:
        """The lane near where it is predicted; now and then, and in doubt, a fresh search challenges it."""
        around = view.around(prediction.mean)
        points, channels = self.points(frame, around)
        prior, gates, reach_m = self.tracker.fit_prior(prediction), jointfit.TRACK_GATES, jointfit.TRACK_REACH_M
        fit = jointfit.fit(points, prediction.mean, prior=prior, gates=gates, reach_m=reach_m)
        inward_m = self.tracker.recall_inward() or inward(fit, cv2.add(*channels), around.grid)
        fit = replace(fit, inward_m=inward_m) if any(inward_m) else fit
        tracked = self._judge(fit)
        lost = tracked.fit is None
        if self.tracker.decide_to_search(fit, lost=lost):
            if lost:  # all of the frame is looked at once more
                fresh = self._search(frame, view)
            else:
                fit = replace(fit, objection=verge_objection(*channels, around.grid, fit))
                least = self.tracker.start_needed(fit)
                fresh = self._best(points, channels, around, least_energy=least, known=fit.mean)
            if self.tracker.challenge(fit, fresh.fit, lost=lost):
                return fresh
        return tracked

    def _judge(self, fit: JointFit | None, *, begins: bool = False) -> Verdict:
        """Whether the fit is a lane; ``begins``: it continues none."""
        if fit is None:
            return Verdict(None, "no paint that could be a pair of lane lines")
        rows = sum(fit.rows)
        if rows < MINIMUM_ROWS or fit.energy < MINIMUM_ENERGY:
            needed = f"{MINIMUM_ROWS:.1f} needed in likely places"
            return Verdict(None, f"too little paint: {rows:.1f} rows on both lines, {needed}")
        if begins and min(fit.rows) < 1 and rows < ONE_LINE_ROWS:
            return Verdict(None, f"too little paint: {rows:.1f} rows on one line alone, {ONE_LINE_ROWS:.0f} needed")
        if confidence_of(fit) < MINIMUM_CONFIDENCE:
            return Verdict(None, f"what paint there is does not lie on two lines ({fit.rms_px:.0f} px off on average)")
        # parallel curves by construction: of the sanity checks these two can fail
        checks = check_size(fit.width_m, fit.curvature_1pm)
        if not all(check.ok for check in checks):
            return Verdict(None, implausible(checks), checks)
        return Verdict(fit, checks=checks)

    # ------------------------------------------------------------------ the classic model
    def _measure_windows(self, frame: np.ndarray, view: View) -> Verdict:
        mask = view.metric.warp(self.mask(frame, view))
        last = view.lane(self.tracker.fit) if self.track and self.tracker.fit is not None else None
        grid = view.metric.grid
        pixels = windows.find_pixels(mask, grid, (last.left, last.right) if last else None)
        left, right = windows.fit_lines(pixels, grid)
        if not left or not right:
            return Verdict(None, pixels.reason or next(line.reason for line in (left, right) if not line))
        checks = check_lane(Lane(left, right), last)
        if not all(check.ok for check in checks):
            return Verdict(None, implausible(checks), checks)
        return Verdict(windows.joint_state(left, right, pixels, grid, view.height_m, view.grid.y_m), checks=checks)

    # ------------------------------------------------------------------ the outcome
    def _outcome(self, frame: np.ndarray, view: View, begin: float) -> LaneResult:
        """Measure and track; ``begin``: when the work on this frame began (``time.perf_counter``)."""
        fit, reason, checks = (self._measure_joint if self.model == "joint" else self._measure_windows)(frame, view)
        status, trust = ("measured" if fit is not None else "none"), 1.0
        if self.track:
            status = self.tracker.update(fit, reason).status
            fit, trust = self.tracker.shown, 1 - self.tracker.missed / (self.tracker.hold_frames + 1)
        if fit is None:
            spent = milliseconds_since(begin)
            return LaneResult(None, "none", reason, 0.0, checks, size_wh=view.rig.size_wh, milliseconds=spent)
        lane = view.lane(fit)
        if self.track:
            lane = self.tracker.at_car(lane, measured=status == "measured")
        lines_px = cache(partial(view.lines_px, lane))  # in metres it is known now; in pixels when someone asks
        left, right = (lambda: lines_px()[0]), (lambda: lines_px()[1])
        confidence = confidence_of(fit) * trust
        beside = self.neighbours and status == "measured"
        neighbours = find_neighbours(frame, view, fit, lanes=self.neighbours) if beside else ()
        spent = milliseconds_since(begin)
        return LaneResult(
            lane, status, reason, confidence, checks, left, right, view.rig.size_wh, spent, fit, neighbours
        )


def implausible(checks: tuple[Check, ...]) -> str:
    """The reason of a lane that failed one of its sanity checks."""
    return f"implausible lane: {next(check for check in checks if not check.ok).reason}"


def milliseconds_since(begin: float) -> float:
    """Wall time since ``begin``, as ``time.perf_counter`` gave it."""
    return (time.perf_counter() - begin) * 1e3
