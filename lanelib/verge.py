"""Where the road ends: warm ground beside it, on a wider strip than any paint.

Asphalt and concrete are grey; soil, dry grass and fallen leaves beside them are warmer: yellower than the road in the
same row of the bird's-eye view. Where a line is hidden or worn several lanes explain the paint almost equally well, and
the one that runs through the leaves is the least likely. So warm ground says where a lane is not, never where it is:
many roads have no warm verge, and leaves lie on lines.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanelib.birdseye import Grid
from lanelib.jointfit import JointFit, distance, line_x

WARMER = 10.0  # grey levels of (R + G) / 2 - B above the road's: grey surfaces in sun and shade differ by a few
STRIP_M = 0.7  # so wide at least: two yellow lines and their gap are up to 0.55 m wide (``doubleline``)
COVERED_M = 0.3  # leaves and dust lie on a line and a little further in; only what reaches further counts
ROAD_M = 1.8  # what the middle of the lane shows over this width is road
SHINE = 1.25  # where a low sun shines back from it a road is brighter, and yellower a little more than in proportion
FAR_M = 30.0  # there the strip is a dozen pixels wide in the colour planes of a video
# A row of 112 objects as much as half a row of paint on a well-painted line says (``jointfit.paint_value``), together
# at most as much as the same lane with a better pitch needs to take over (``tracking.BETTER_ENERGY``)
ROW_VALUE, MOST_VALUE = 0.15, 3.0
OUTWARD = np.array([[-1], [1]])  # left and right


def verge_rows(brightness: np.ndarray, yellow: np.ndarray, grid: Grid, fit: JointFit) -> tuple[int, int]:
    """In how many rows of the grid warm ground reaches over the left and the right line into the lane ``fit``.

    ``brightness``, ``yellow``: (H, W) uint8 of the bird's-eye picture of ``grid``, see ``paint.paint_channels``. Where
    the strip is brighter than the road it may be yellower in proportion: then it is of the same colour.
    """
    y = distance(1 / grid.y_m, fit.mean, fit.height_m)
    rows = np.flatnonzero(y < FAR_M)
    if len(rows) == 0:
        return 0, 0
    edge_x = line_x(y[rows], fit.mean, OUTWARD) - OUTWARD * COVERED_M
    road_x = line_x(y[rows], fit.mean, 0)
    edge, road = (np.rint(grid.column_of(x / y[rows] * grid.y_m[rows])).astype(np.intp) for x in (edge_x, road_x))
    strip, columns = round(STRIP_M / grid.column_m), yellow.shape[1]
    edge[0] -= strip - 1  # the first column of the strip
    seen = (edge >= 0) & (edge < columns) & (road >= 0) & (road < columns)
    edge, road, row = edge % columns, road % columns, rows - rows[0]

    bright, warm = brightness[rows[0] :], yellow[rows[0] :]
    beyond = {"anchor": (0, 0), "borderType": cv2.BORDER_CONSTANT}
    least_warm = cv2.erode(warm, np.ones((1, strip), np.uint8), borderValue=0, **beyond)[row, edge]
    strip_bright = cv2.blur(bright, (strip, 1), **beyond)[row, edge]
    middle = round(ROAD_M / grid.column_m) | 1, 1
    road_warm, road_bright = (cv2.blur(channel, middle)[row, road] for channel in (warm, bright))
    brighter = np.maximum(SHINE * strip_bright / np.maximum(road_bright, 1), 1)
    left, right = (seen & (least_warm > road_warm * brighter + WARMER)).sum(axis=1).tolist()
    return left, right


def verge_objection(brightness: np.ndarray, yellow: np.ndarray, grid: Grid, fit: JointFit) -> float:
    """What the ground beside the road objects to a lane, in the unit of ``JointFit.energy``."""
    return min(ROW_VALUE * max(verge_rows(brightness, yellow, grid, fit)), MOST_VALUE)
