"""Every intermediate picture of one frame, by name: what the pipeline saw on its way.

The finder itself never makes most of these: it goes from the raw frame to the small view in one step. Here the textbook's order is
spelled out, so that a person can look at each step; the lane drawn is the finder's own.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from lanelib import draw, search, threshold
from lanelib.birdseye import BirdsEye, Grid
from lanelib.channels import as_bgr
from lanelib.errors import LanelibError
from lanelib.paint import STRONG_Z, paint_evidence, paint_points

NAMES = ("frame", "undistorted", "mask", "evidence", "birdseye", "birdseye_mask", "windows", "fit", "lane")
HALF_WIDTH_M, LENGTH_M = 6.0, 40.0  # the lane and half of each neighbour; 13 dashes' periods of a motorway are 12 m each
VIEW_WH = (360, 720)


def map_grid(rig) -> Grid:
    """The metric view that is shown to people: equal steps, from the nearest road the camera sees to 40 m beyond."""
    return Grid.uniform(x_range_m=(-HALF_WIDTH_M, HALF_WIDTH_M), y_range_m=(rig.near_m, rig.near_m + LENGTH_M), size_wh=VIEW_WH)


def stages(frame_bgr: np.ndarray, finder, result=None) -> dict[str, np.ndarray]:
    """Pictures of one frame by the names of ``NAMES``, in that order; all uint8, BGR (masks: (H, W) 0/255).

    ``finder``: a `finder.LaneFinder`; its state over time is not touched. ``result``: what it said about this frame; without it
    the frame is looked at on its own. Raises LanelibError for a frame that the rig does not fit.
    """
    frame = as_bgr(frame_bgr)
    view = finder.view((frame.shape[1], frame.shape[0]))
    rig = view.rig
    if result is None:
        alone = copy(finder)  # shares the tables, keeps no memory of this frame
        alone.track = False
        result = alone.process(frame)
    evidence = paint_evidence(view.scan(frame), column_m=view.grid.column_m)
    undistorted = rig.camera.undistort(frame)
    mask = threshold.RECIPES[finder.recipe].function(undistorted)
    grid = map_grid(rig)
    warp = BirdsEye(rig.birdseye.road_from_image, rig.birdseye.size_wh, grid).warp
    birdseye = warp(undistorted)
    birdseye_mask = np.where(warp(mask) > 127, np.uint8(255), np.uint8(0))
    found = search.sliding_windows(birdseye_mask, centre=float(grid.column_of(0.0)))
    textbook = finder.order == "textbook"
    points = view.points_of_mask(view.scan_undistorted(mask)) if textbook else view.points(paint_points(*evidence))
    metres = np.column_stack([points.bearing, np.ones(len(points))]) / points.inverse[:, None]
    fit = draw.birdseye(birdseye, grid, lane=result.lane, points_m=metres, weights=points.weight, held=result.status == "held")
    return {
        "frame": frame, "undistorted": undistorted, "mask": mask,
        "evidence": draw.heat(evidence[0], top=STRONG_Z), "birdseye": birdseye, "birdseye_mask": birdseye_mask,
        "windows": draw.draw_windows(birdseye_mask, found), "fit": fit, "lane": draw.overlay(frame, result),
    }


def stage(name: str, frame_bgr: np.ndarray, finder, result=None) -> np.ndarray:
    """One picture of `stages`. Raises LanelibError for a name that is not in ``NAMES``."""
    if name not in NAMES:
        raise LanelibError(f"a stage must be one of {', '.join(NAMES)}, found {name!r}")
    return stages(frame_bgr, finder, result)[name]
