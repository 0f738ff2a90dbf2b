"""Warp explorer: four corners on the frame make the bird's-eye view; what metres and angles follow from them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lanelib import draw
from lanelib.birdseye import CLASSIC_SOURCE, BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.channels import as_bgr
from lanelib.draw.panels import pixels_of_road
from lanelib.errors import LanelibError
from lanelib.explore.kit import Explorer, button, slider, tick
from lanelib.explore.look import Look, Reading
from lanelib.explore.quad import Quad, plain
from lanelib.finder import LaneFinder
from lanelib.labels import line_points
from lanelib.rig import Rig

VIEW_WH = (400, 500)
ACROSS_M = 5.5  # the view's half width: the lane and a part of its neighbours
CLASSIC_LENGTH_M = 30.0  # what everyone assumes the trapezoid to be long
LANE_WIDTH_M = 3.66  # 12 ft
AHEAD_M = 25.0  # length of the rectangle with which the rig's own corners begin


def warp_look(
    undistorted_bgr: np.ndarray,
    camera: Camera,
    corners_px,
    *,
    lane_width_m: float = LANE_WIDTH_M,
    length_m: float | None = None,
    lines_px=None,
    mounting: Mapping | None = None,
) -> Look:
    """The bird's-eye view through four corners (far left, far right, near right, near left; undistorted pixels).

    The corners are a rectangle on the road as wide as the lane. Where its sides meet tells pitch and yaw, the lane's
    width then tells the height (`BirdsEye.from_straight_lines`), and with them its length is *derived*; ``length_m``
    assumes another one instead. ``lines_px``: the undistorted lane lines, by which parallelism is judged;
    ``mounting``: the true one. Raises LanelibError where the corners are no road.
    """
    corners = np.asarray(corners_px, float).reshape(4, 2)
    far_left, far_right, near_right, near_left = corners
    derived = BirdsEye.from_straight_lines(
        camera, [near_left, far_left], [near_right, far_right], lane_width_m=lane_width_m
    )
    y_m = derived.road_from_points(corners)[:, 1]
    near_m, derived_m = float(y_m[2:].mean()), float(y_m[:2].mean() - y_m[2:].mean())
    if not (np.isfinite(y_m).all() and derived_m > 1 and near_m > 0):
        raise LanelibError("the far corners must lie above the near ones and below the horizon; drag them apart")
    if derived_m > 400:
        raise LanelibError(f"the far corners are {derived_m:.0f} m away, nearly on the horizon; drag them down")
    length = derived_m if length_m is None else length_m
    x = lane_width_m / 2
    rectangle = [(-x, near_m + length), (x, near_m + length), (x, near_m), (-x, near_m)]
    grid = Grid.uniform(
        x_range_m=(-ACROSS_M, ACROSS_M),
        y_range_m=(max(0.5, near_m - 0.06 * length), near_m + 1.06 * length),
        size_wh=VIEW_WH,
    )
    view = BirdsEye.from_points(corners, rectangle, camera.size_wh, grid)
    picture = draw.birdseye(view.warp(undistorted_bgr), grid)
    picture = draw.draw_line(picture, pixels_of_road(grid, rectangle), "window", width_px=2, closed=True, dashed=True)
    parallel = widths = None
    if lines_px is not None:
        for line, colour in zip(lines_px, ("left", "right"), strict=True):
            on = pixels_of_road(grid, view.road_from_points(line))
            picture = draw.draw_line(picture, on, colour, width_px=2, outline=True)
        parallel = view.parallelism(*lines_px)
        widths = [_width_at(view, lines_px, at) for at in (near_m, near_m + length)]
    at = derived.mounting(camera)
    true = mounting or {}
    readings = [
        Reading("lane widens by", None if parallel is None else 100 * parallel, "cm in 30 m", 1, signed=True),
        Reading("lane at near edge", None if widths is None else widths[0], "m"),
        Reading("lane at far edge", None if widths is None else widths[1], "m"),
        Reading("length, derived", derived_m, "m", 1),
        Reading("length, used", length, "m", 1),
        Reading("metres a pixel, across", grid.column_m, "m", 4),
        Reading("metres a pixel, along", grid.row_m, "m", 4),
        Reading("camera height", at["height_m"], "m", 2, true.get("height_m")),
        Reading("pitch", at["pitch_deg"], "°", 2, true.get("pitch_deg"), signed=True),
        Reading("yaw", at["yaw_deg"], "°", 2, true.get("yaw_deg"), signed=True),
        Reading("horizon, row", derived.horizon_row_px, "px", 1),
    ]
    return Look(picture, tuple(readings))


def _width_at(view: BirdsEye, lines_px, y_m: float) -> float:
    """Distance of the two lines along x at ``y_m``, each a straight line through its points; m."""
    ends = []
    for points in lines_px:
        x, y = view.road_from_points(points).T
        seen = np.isfinite(x)
        ends.append(np.polyval(np.polyfit(y[seen], x[seen], 1), y_m))
    return float(ends[1] - ends[0])


def rig_corners(rig: Rig, *, lane_width_m: float = LANE_WIDTH_M, length_m: float = AHEAD_M) -> np.ndarray:
    """The undistorted pixels (4, 2) of a rectangle on the rig's road, from 1 m beyond the nearest road seen."""
    x, near = lane_width_m / 2, rig.near_m + 1
    rectangle = [(-x, near + length_m), (x, near + length_m), (x, near), (-x, near)]
    width, height = rig.size_wh
    return np.clip(rig.birdseye.points_from_road(rectangle), 0, (width - 1, height - 1))


def lines_of(frame_bgr: np.ndarray, rig: Rig | None, camera: Camera, truth=None):
    """The undistorted lane lines of a frame, two (N, 2): from its truth, else as the finder sees them; None without."""
    if truth is not None and len(truth["lanes"]) == 2:
        given = [np.column_stack(line_points(truth, i)[::-1]) for i in (0, 1)]
    elif rig is not None and (result := LaneFinder(rig, track=False).process(frame_bgr)):
        given = [result.left_px, result.right_px]
    else:
        return None
    lines = [camera.undistort_points(points) for points in given]
    lines = [points[np.isfinite(points).all(axis=1)] for points in lines]
    return lines if min(len(points) for points in lines) >= 2 else None


def warp(frame_bgr: np.ndarray, rig: Rig | Camera, truth=None) -> Explorer:
    """Explore the bird's-eye view of one frame (H, W, 3) uint8 BGR as given by the camera.

    ``rig``: a `Rig`, with whose corners one begins, or a `Camera` alone, with the classic trapezoid. ``truth``: the
    frame's entry of `truth.load_truth`.
    """
    frame = as_bgr(frame_bgr)
    size_wh = (frame.shape[1], frame.shape[0])
    rig = rig.scaled(size_wh) if isinstance(rig, Rig) else rig
    camera = rig.camera if isinstance(rig, Rig) else rig.scaled(size_wh)
    own = rig if isinstance(rig, Rig) else None
    undistorted = camera.undistort(frame)
    lines = lines_of(frame, own, camera, truth)
    classic = CLASSIC_SOURCE * size_wh
    quad = Quad(undistorted, classic if own is None else rig_corners(own), label="corners of the bird's-eye view")
    quad.layout.flex, quad.layout.width = "1 1 0", "0"
    assumed = slider("assumed length", CLASSIC_LENGTH_M, 5, 100, 0.5, digits=1, tip="length of the rectangle in metres")

    def make(corners, width_m, derive, length_m) -> Look:
        assumed.disabled = derive
        return warp_look(
            undistorted,
            camera,
            corners,
            lane_width_m=width_m,
            length_m=None if derive else length_m,
            lines_px=lines,
            mounting=truth and truth.get("mounting"),
        )

    controls = {
        "corners": quad,
        "width_m": slider("lane width", LANE_WIDTH_M, 2.6, 4.6, 0.01, tip="true width of the lane in metres"),
        "derive": tick("derive the length from the camera", True),
        "length_m": assumed,
    }
    buttons = [
        button("Classic corners", lambda: explorer.set(corners=plain(classic)), tip="the trapezoid everyone copies")
    ]
    if own is not None:
        of_rig = plain(rig_corners(own))
        tip = "a rectangle on the road as the rig sees it"
        buttons.append(button("Rig's corners", lambda: explorer.set(corners=of_rig), tip=tip))
    explorer = Explorer(
        "Warp explorer: drag the corners, or Tab to one and use the arrow keys",
        make,
        controls,
        hidden=("corners",),
        buttons=buttons,
        beside=quad,
        alt="bird's-eye view with metres",
    )
    explorer.pane.layout.width, explorer.pane.layout.flex, explorer.pane.layout.margin = "31%", "0 0 31%", "0 0 0 10px"
    return explorer
