"""Where the paint of the ego lane is, pixel by pixel, from a frame of a truth file; precision and recall against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from lanelib.draw import bgr
from lanelib.errors import LanelibError
from lanelib.labels import x_at

PAINT_WIDTH_M = 0.12  # lines are 4 to 6 inches wide (MUTCD, sec. 3A.06)
BLUR_PX = 1.0  # a line far away is not thinner than what lens and sampling make of it
OUTSIDE_M = 1.0  # so far beyond the two lines a lane search would look; other lanes' paint is neither right nor wrong


@dataclass(frozen=True, eq=False)
class PaintTruth:
    """``paint``: (H, W) bool, painted pixels of both lines. ``road``: (H, W) bool, where a mask is judged: between
    the lines and a metre beyond, without the rows in which a dash begins or ends (the truth tells every tenth row)."""

    paint: np.ndarray
    road: np.ndarray

    def score(self, mask: np.ndarray) -> tuple[float, float]:
        """Precision and recall, 0..1, of a mask (H, W) of the frame as given; NaN where there is nothing to judge."""
        on = (np.asarray(mask) != 0) & self.road
        hits, found, painted = int((on & self.paint).sum()), int(on.sum()), int(self.paint.sum())
        return hits / found if found else float("nan"), hits / painted if painted else float("nan")


def paint_truth(truth, size_wh: tuple[int, int]) -> PaintTruth:
    """Rasterise a frame of `truth.load_truth` (a mapping), or take a mask (H, W) of painted pixels as it is.

    Between two rows of the truth lines are straight; a line's width follows from the lane's, which is known in metres.
    """
    width, height = size_wh
    if isinstance(truth, np.ndarray):
        if truth.shape != (height, width):
            raise LanelibError(
                f"a paint mask of {width}x{height} is needed, found shape {truth.shape}; use the frame's"
            )
        return PaintTruth(truth != 0, np.ones((height, width), bool))
    if not isinstance(truth, Mapping) or "h_samples" not in truth or "lanes" not in truth:
        raise LanelibError("truth must be a frame of load_truth(folder) or a mask (H, W), found something else")
    paint, road = np.zeros((height, width), bool), np.zeros((height, width), bool)
    if len(truth["lanes"]) != 2:
        return PaintTruth(paint, road)
    samples = np.asarray(truth["h_samples"], float)
    rows = np.arange(max(0, int(samples.min())), min(height - 1, int(samples.max())) + 1)
    left, right = (x_at(truth, i, rows) for i in (0, 1))
    px_per_m = (right - left) / float(truth.get("lane_width_m") or 3.66)
    columns = np.arange(width)
    with np.errstate(invalid="ignore"):
        outside = OUTSIDE_M * px_per_m
        road[rows] = (columns >= (left - outside)[:, None]) & (columns <= (right + outside)[:, None])
        half = np.maximum(PAINT_WIDTH_M * px_per_m, BLUR_PX) / 2 + BLUR_PX / 2
        for i, x in enumerate((left, right)):
            near = np.abs(columns - x[:, None]) <= half[:, None]
            seen = np.interp(rows, samples, np.asarray(truth["visible"][i], float)) if "visible" in truth else 1.0
            seen = np.broadcast_to(seen, rows.shape)
            paint[rows] |= near & (seen == 1)[:, None]
            unsure = np.abs(columns - x[:, None]) <= 2 * half[:, None] + 2
            road[rows] &= ~(unsure & ((seen > 0) & (seen < 1))[:, None])
    return PaintTruth(paint & road, road)


def coloured(mask: np.ndarray, truth: PaintTruth | None, under_bgr: np.ndarray) -> np.ndarray:
    """A mask over a smaller, darkened copy of the frame: hits green, missed paint blue, false alarms vermillion;
    what is not judged, white. Colours as in ``figures.thresholds``."""
    on, size_wh = mask != 0, (under_bgr.shape[1], under_bgr.shape[0])
    layers = [(on, "text")]
    if truth is not None:
        judged = on & truth.road
        layers = [
            (on & ~truth.road, "text"),
            (judged & ~truth.paint, "none"),
            (truth.paint & ~on, "accent"),
            (judged & truth.paint, "estimate"),
        ]
    out = under_bgr.astype(np.float32) * 0.45
    for where, colour in layers:
        share = cv2.resize(where.astype(np.uint8) * 255, size_wh, interpolation=cv2.INTER_AREA)
        share = np.minimum(share.astype(np.float32) * (2.5 / 255), 1)[..., None]  # thin lines must not fade away
        out += (np.array(bgr(colour), np.float32) - out) * share
    return np.round(out).astype(np.uint8)
