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
FAR_M = 30.0  # the strip is a dozen pixels of a frame wide there
# A row of 112 objects as much as half a row of paint on a well-painted line says (``jointfit.paint_value``), together
# at most as much as the same lane with a better pitch needs to take over (``tracking.BETTER_ENERGY``)
ROW_VALUE, MOST_VALUE = 0.15, 3.0


def verge_rows(yellow: np.ndarray, grid: Grid, fit: JointFit) -> tuple[int, int]:
    """In how many rows of the grid warm ground reaches over the left and the right line into the lane ``fit``.

    ``yellow`` (H, W) uint8: yellowness of the bird's-eye picture of ``grid``, see ``paint.paint_channels``.
    """
    y = distance(1 / grid.y_m, fit.mean, fit.height_m)
    rows = np.flatnonzero(y < FAR_M)
    if len(rows) == 0:
        return 0, 0
    x = line_x(y[rows], fit.mean, np.array([[0], [-1], [1]])) + np.array([[0], [COVERED_M], [-COVERED_M]])
    column = np.rint(grid.column_of(x / y[rows] * grid.y_m[rows])).astype(np.intp)
    strip = round(STRIP_M / grid.column_m)
    column[1] -= strip - 1  # the strip's first column
    near = yellow[rows[0] :]
    kernel, beyond = np.ones((1, strip), np.uint8), {"borderType": cv2.BORDER_CONSTANT, "borderValue": 0}
    least = cv2.erode(near, kernel, anchor=(0, 0), **beyond)
    road = cv2.blur(near, (round(ROAD_M / grid.column_m) | 1, 1))
    seen = (column >= 0) & (column < yellow.shape[1])
    column, row = np.where(seen, column, 0), rows - rows[0]
    warm = least[row, column[1:]] > road[row, column[0]] + WARMER
    left, right = (warm & seen[1:] & seen[0]).sum(axis=1).tolist()
    return left, right


def verge_objection(yellow: np.ndarray, grid: Grid, fit: JointFit) -> float:
    """What the ground beside the road objects to a lane, in the unit of ``JointFit.energy``."""
    return min(ROW_VALUE * max(verge_rows(yellow, grid, fit)), MOST_VALUE)
