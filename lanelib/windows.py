"""The classic way to measure a lane: pixels of a mask, by windows or around the last lane, and a parabola a line.

The two lines are fitted on their own, which is what makes this way weak (a seam takes one of them away) and worth
teaching. To be smoothed and compared like the joint fit, the outcome is put into the same seven numbers.
"""

from __future__ import annotations

import numpy as np

from lanelib import search
from lanelib.birdseye import Grid
from lanelib.jointfit import BEND, CENTRE, HEADING, HILL, PITCH, RATE, UNKNOWN_ROAD, WIDTH, JointFit
from lanelib.lane import Line, NoLine, fit_line
from lanelib.search import LanePixels


def pixel_coefficients(line: Line, grid: Grid) -> np.ndarray:
    """A second-order line in metres as x = a y^2 + b y + c in pixels of a uniform grid.

    With x = x0 + u sx and y = y0 - v sy (u, v pixels; sx, sy metres a pixel), inserted into x = A y^2 + B y + C.
    """
    a, b, c = line.coefficients[-3:]
    sx, sy, x0, y0 = grid.column_m, grid.row_m, grid.x_m[0], grid.y_m[0]
    return np.array([a * sy**2, -(2 * a * y0 + b) * sy, a * y0**2 + b * y0 + c - x0]) / sx


def find_pixels(
    mask_view: np.ndarray, grid: Grid, previous: tuple[Line, Line] | None = None, *, margin_m: float = 0.6
) -> LanePixels:
    """Pixels of both lines in a bird's-eye mask: around the ``previous`` lines if there are any, else by windows."""
    if previous is not None:
        around = search.search_around(
            mask_view, *(pixel_coefficients(line, grid) for line in previous), margin_px=margin_m / grid.column_m
        )
        if not around.reason:
            return around
    return search.sliding_windows(mask_view, margin_px=margin_m / grid.column_m, centre=float(grid.column_of(0.0)))


def fit_lines(pixels: LanePixels, grid: Grid) -> tuple[Line | NoLine, Line | NoLine]:
    """One robust parabola a side, in metres."""
    lines = []
    for xy, weights in ((pixels.left_xy, pixels.left_weights), (pixels.right_xy, pixels.right_weights)):
        step = max(1, len(xy) // 1500)  # 1500 to 3000 points are more than settle three numbers
        x, y = grid.x_of(xy[::step, 0]), grid.y_m[xy[::step, 1].astype(int)] if len(xy) else np.empty(0)
        lines.append(fit_line(x, y, weights[::step]))
    return lines[0], lines[1]


def joint_state(
    left: Line, right: Line, pixels: LanePixels, grid: Grid, height_m: float, scan_y_m: np.ndarray
) -> JointFit:
    """Two separate lines as the joint fit's seven numbers.

    Heading and bend are the means of both lines. Lines that drift apart are taken for pitch: x_right - x_left =
    (x_right - x_left at the car) (1 + pitch y / height).
    """
    (al, bl, cl), (ar, br, cr) = left.coefficients, right.coefficients
    apart, centre = cr - cl, (cl + cr) / 2  # along x
    pitch = height_m * (br - bl) / max(apart, 0.5)
    heading = (bl + br) / 2 - centre * pitch / height_m
    across = 1 / np.sqrt(1 + heading**2)  # the width is measured across the lane
    mean = np.zeros(7)
    mean[CENTRE], mean[WIDTH], mean[PITCH] = centre, apart * across, pitch
    mean[HEADING], mean[BEND] = heading, (al + ar) / 2
    assert left.covariance is not None and right.covariance is not None
    variance = (np.diag(left.covariance) + np.diag(right.covariance)) / 4
    unknown = np.diag(UNKNOWN_ROAD.covariance)
    # in the order of jointfit.NAMES
    of_lane = [variance[2], variance[1], variance[0], unknown[RATE], 4 * variance[2] * across**2]
    covariance = np.diag([*of_lane, unknown[PITCH], unknown[HILL]])
    edges = np.concatenate([[np.inf], (scan_y_m[1:] + scan_y_m[:-1]) / 2, [-np.inf]])[::-1]
    support = np.zeros((2, len(scan_y_m)))
    for i, xy in enumerate((pixels.left_xy, pixels.right_xy)):
        count = np.histogram(grid.y_m[xy[:, 1].astype(int)], edges)[0][::-1]
        area = np.maximum(-np.gradient(scan_y_m), grid.row_m) / grid.row_m  # rows of this grid in one scan row
        support[i] = np.clip(count / (area * 4), 0, 1)  # four pixels across are paint
    return JointFit(mean, covariance, support, float(support.sum()), height_m, 0.0)
