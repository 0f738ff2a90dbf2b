"""Every intermediate picture of one frame, by name: what the pipeline saw on its way.

The finder itself never makes most of these: it goes from the raw frame to the small view in one step. Here the
textbook's order is spelled out, so that a person can look at each step; the lane drawn is the finder's own.
"""

from __future__ import annotations

from copy import copy

import cv2
import numpy as np

from lanelib import draw, windows
from lanelib.channels import as_bgr
from lanelib.errors import LanelibError
from lanelib.paint import STRONG_Z, evidence_of

NAMES = ("frame", "undistorted", "mask", "evidence", "birdseye", "birdseye_mask", "windows", "fit", "lane")
EVIDENCE_WH = (640, 360)  # the scan, 301 x 112 with rows spaced by perspective, enlarged to a frame's proportions


def stages(frame_bgr: np.ndarray, finder, result=None) -> dict[str, np.ndarray]:
    """Pictures of one frame by the names of ``NAMES``, in that order; all uint8, BGR (masks: (H, W) 0/255).

    ``finder``: a `finder.LaneFinder`; its state over time is not touched. ``result``: what it said about this frame;
    without it the frame is looked at on its own. Raises LanelibError for a frame that the rig does not fit.
    """
    frame = as_bgr(frame_bgr)
    view = finder.view((frame.shape[1], frame.shape[0]))
    rig = view.rig
    if result is None:
        result = without_memory(finder).process(frame)
    z = evidence_of(*view.paint_channels(frame), column_m=view.grid.column_m)
    undistorted = rig.camera.undistort(frame)
    mask = finder.mask(frame, view)
    grid = view.metric.grid
    birdseye = view.metric.warp(undistorted)
    birdseye_mask = np.where(view.metric.warp(mask) > 127, np.uint8(255), np.uint8(0))
    points, _ = finder.points(frame, view)
    metres = np.column_stack([points.bearing, np.ones(len(points))]) / points.inverse[:, None]
    fit = draw.birdseye(
        birdseye, grid, lane=result.lane, points_m=metres, weights=points.weight, held=result.status == "held"
    )
    return {
        "frame": frame,
        "undistorted": undistorted,
        "mask": mask,
        "evidence": draw.heat(cv2.resize(z, EVIDENCE_WH), top=STRONG_Z),
        "birdseye": birdseye,
        "birdseye_mask": birdseye_mask,
        "windows": draw.draw_windows(birdseye_mask, windows.find_pixels(birdseye_mask, grid)),
        "fit": fit,
        "lane": draw.overlay(frame, result),
    }


def stage(name: str, frame_bgr: np.ndarray, finder, result=None) -> np.ndarray:
    """One picture of `stages`. Raises LanelibError for a name that is not in ``NAMES``."""
    if name not in NAMES:
        raise LanelibError(f"a stage must be one of {', '.join(NAMES)}, found {name!r}")
    return stages(frame_bgr, finder, result)[name]


def without_memory(finder):
    """A finder with the tables of this one that looks at each frame on its own and leaves this one's state alone."""
    alone = copy(finder)
    alone.track = False
    return alone


def diagnostic(frame_bgr: np.ndarray, finder, result=None, *, size_wh: tuple[int, int] = (1280, 720)) -> np.ndarray:
    """`draw.diagnostic` of a frame with all its stages; of a frame that the rig does not fit, with the reason alone."""
    if result is None:
        result = without_memory(finder).process(frame_bgr)
    try:
        pictures = stages(frame_bgr, finder, result)
    except LanelibError:
        pictures = {}
    return draw.diagnostic(frame_bgr, pictures, result, size_wh=size_wh)


def birdseye(frame_bgr: np.ndarray, finder, result=None, *, size_wh: tuple[int, int] = (1280, 720)) -> np.ndarray:
    """The road from above with metre rulers and the lane, and the frame beside it (`draw.birdseye_beside`)."""
    frame = as_bgr(frame_bgr)
    if result is None:
        result = without_memory(finder).process(frame)
    try:
        view = finder.view((frame.shape[1], frame.shape[0]))
        above = view.metric.warp(view.rig.camera.undistort(frame))
        above = draw.birdseye(above, view.metric.grid, lane=result.lane, held=result.status == "held")
    except LanelibError:
        above = np.zeros((720, 480, 3), np.uint8)
    return draw.birdseye_beside(above, frame, result, size_wh=size_wh)
