"""Detection explorer: how windows, margins, recipes and models change what is found in one frame, stage by stage."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from lanelib import draw, search, threshold, windows
from lanelib.channels import as_bgr
from lanelib.draw.palette import bgr
from lanelib.explore.kit import Explorer, choice, counter, slider
from lanelib.explore.look import WIDTH_PX, Look, Reading
from lanelib.finder import LaneFinder, implausible
from lanelib.lane import Lane, check_lane
from lanelib.result import LaneResult
from lanelib.rig import Rig, View

MARGIN_M = 0.6  # to both sides of a window's middle, as in ``windows.find_pixels``
WAYS = ("sliding windows", "around the last lane")
TALL, LOW = 286, 150  # heights of the two rows of pictures, px


class Frame:
    """One frame and what does not depend on the controls, each made once: undistorted, masks, bird's-eye view."""

    def __init__(self, frame_bgr: np.ndarray, rig: Rig):
        self.bgr = as_bgr(frame_bgr)
        self.view = View(rig.scaled((self.bgr.shape[1], self.bgr.shape[0])))
        self.undistorted = self.view.rig.camera.undistort(self.bgr)
        self.above = self.view.metric.warp(self.undistorted)
        self.mask = lru_cache(maxsize=8)(lambda recipe: threshold.recipe_by_name(recipe).function(self.undistorted))
        self.mask_view = lru_cache(maxsize=8)(lambda recipe: self.view.metric.warp(self.mask(recipe)))


def minimum_by_default(frame: Frame, n_windows: int = search.N_WINDOWS, margin_m: float = MARGIN_M) -> int:
    """Pixels that recentre a window where nothing is said: the fraction of its area that `search` takes."""
    grid = frame.view.metric.grid
    area = 2 * margin_m / grid.column_m * len(grid.y_m) / n_windows
    return max(1, round(search.MINIMUM_FRACTION * area))


def by_windows(
    frame: Frame, *, recipe: str, way: str, n_windows: int, margin_m: float, minimum_pixels: float
) -> tuple[LaneResult, search.LanePixels]:
    """The classic measurement with every number free: pixels of a mask, one parabola a line, the sanity checks."""
    mask, grid, view = frame.mask_view(recipe), frame.view.metric.grid, frame.view
    margin_px = margin_m / grid.column_m
    pixels = search.sliding_windows(
        mask, n_windows=n_windows, margin_px=margin_px, minimum_pixels=minimum_pixels, centre=float(grid.column_of(0.0))
    )
    left, right = windows.fit_lines(pixels, grid)
    if way == WAYS[1] and left and right:
        around = (windows.pixel_coefficients(line, grid) for line in (left, right))
        pixels = search.search_around(mask, *around, margin_px=margin_px)
        left, right = windows.fit_lines(pixels, grid)
    if not left or not right:
        reason = pixels.reason or next(line.reason for line in (left, right) if not line)
        return LaneResult(None, "none", reason, size_wh=view.rig.size_wh), pixels
    lane = Lane(left, right)
    checks = check_lane(lane)
    failed = not all(check.ok for check in checks)
    reason = implausible(checks) if failed else ""
    lines = view.lines_px(lane)
    return LaneResult(lane, "none" if failed else "measured", reason, 0.0, checks, *lines, view.rig.size_wh), pixels


def detect_look(
    frame: Frame,
    *,
    recipe: str = threshold.DEFAULT_RECIPE,
    model: str = "windows",
    way: str = WAYS[0],
    n_windows: int = search.N_WINDOWS,
    margin_m: float = MARGIN_M,
    minimum_pixels: float | None = None,
    truth=None,
) -> Look:
    """Lane on the frame, pixels found and fitted lane from above, mask and histogram; the numbers at the car.

    ``model``: "windows", to which the numbers apply, or "joint". A lane that fails a sanity check is drawn all the
    same, and the check named. ``truth``: the frame's entry of `truth.load_truth`.
    """
    view, grid = frame.view, frame.view.metric.grid
    mask_view = frame.mask_view(recipe)
    points = {}
    if model == "joint":
        finder = LaneFinder(view.rig, recipe=recipe, model="joint", track=False)
        result = finder.process(frame.bgr)
        on_road, _ = finder.points(frame.bgr, view)
        metres = np.column_stack([on_road.bearing, np.ones(len(on_road))]) / on_road.inverse[:, None]
        points = {"points_m": metres, "weights": on_road.weight}
        beside = ("paint points", draw.birdseye(frame.above, grid, **points))
        counts = [
            Reading(f"rows of paint, {side}", None if result.fit is None else float(result.fit.support[i].sum()), "", 1)
            for i, side in enumerate(("left", "right"))
        ]
    else:
        if minimum_pixels is None:
            minimum_pixels = minimum_by_default(frame, n_windows, margin_m)
        result, pixels = by_windows(
            frame, recipe=recipe, way=way, n_windows=n_windows, margin_m=margin_m, minimum_pixels=minimum_pixels
        )
        beside = (way, draw.draw_windows(mask_view, pixels))
        counts = [
            Reading(f"pixels, {side}", len(xy), digits=0)
            for side, xy in (("left", pixels.left_xy), ("right", pixels.right_xy))
        ]
    fit = draw.birdseye(frame.above, grid, lane=result.lane, held=result.status == "none")
    top = draw.side_by_side(
        [draw.overlay(frame.bgr, result, text=False), beside[1], fit],
        ["lane on the frame", beside[0], "fitted lane"],
        height=TALL,
        cap_px=10,
    )
    mask = cv2.resize(
        frame.mask(recipe), (round(LOW * frame.bgr.shape[1] / frame.bgr.shape[0]), LOW), interpolation=cv2.INTER_AREA
    )
    chart = draw.histogram_panel(
        mask_view, (max(200, top.shape[1] - mask.shape[1] - 36), LOW), centre=float(grid.column_of(0))
    )
    low = draw.side_by_side(
        [mask, chart],
        [f"mask of {recipe!r}", "mask pixels per column, lower half of the view from above"],
        height=LOW,
        cap_px=10,
    )
    return Look(stacked([top, low]), tuple(lane_readings(result, truth) + counts))


def lane_readings(result: LaneResult, truth=None) -> list[Reading]:
    """What a result says about the lane at the car, beside the truth where it is given."""
    true = truth or {}
    bend = None if result.curvature_1pm is None else 1000 * result.curvature_1pm
    true_bend = None if true.get("curvature_1pm") is None else 1000 * true["curvature_1pm"]
    radius = true.get("radius_m", float("inf") if true else None)
    radius = float("inf") if true and true.get("lanes") and radius is None else radius
    return [
        Reading("outcome", result.status),
        Reading("curvature", bend, "/km", 2, true_bend, signed=True),
        Reading("radius", result.radius_m, "m", 0, radius),
        Reading("offset", result.offset_m, "m", 2, true.get("offset_m"), signed=True),
        Reading("lane width", result.width_m, "m", 2, true.get("lane_width_m")),
        *([Reading("reason", result.reason)] if result.reason else []),
    ]


def stacked(rows: list[np.ndarray]) -> np.ndarray:
    """Pictures one above the other on the desk, all as wide as the widest (at most shrunk to WIDTH_PX)."""
    width = max(row.shape[1] for row in rows)
    colour = bgr("desk")
    rows = [cv2.copyMakeBorder(r, 0, 0, 0, width - r.shape[1], cv2.BORDER_CONSTANT, value=colour) for r in rows]
    picture = np.vstack(rows)
    if width <= WIDTH_PX:
        return picture
    return cv2.resize(picture, (WIDTH_PX, round(len(picture) * WIDTH_PX / width)), interpolation=cv2.INTER_AREA)


def detect(frame_bgr: np.ndarray, rig: Rig, truth=None) -> Explorer:
    """Explore how the lane of one frame (H, W, 3) uint8 BGR is found. ``truth``: its entry of `truth.load_truth`."""
    frame = Frame(frame_bgr, rig)
    start = minimum_by_default(frame)
    way = choice("search", WAYS, WAYS[0], tip="from nothing, or near the lane that the windows found")
    n_windows = counter("windows", search.N_WINDOWS, 2, 24, tip="windows a line")
    margin = slider("margin, m", MARGIN_M, 0.1, 2.0, 0.05, tip="metres to both sides of a window's middle")
    # steps that can be seen: a dash has hundreds of pixels
    low, tip = start % 50, "pixels in a window that recentre the next one"
    minimum = counter("least pixels", start, low, low + 1000, step=50, tip=tip)

    def make(**state) -> Look:
        for control in (way, n_windows, margin, minimum):
            control.disabled = state["model"] == "joint"
        return detect_look(frame, truth=truth, **state)

    controls = {
        "model": choice("model", (("sliding windows", "windows"), ("joint fit", "joint")), "windows"),
        "recipe": choice("recipe", tuple(threshold.RECIPES), threshold.DEFAULT_RECIPE),
        "way": way,
        "n_windows": n_windows,
        "margin_m": margin,
        "minimum_pixels": minimum,
    }
    return Explorer("Detection explorer", make, controls, alt="stages of lane detection side by side")
