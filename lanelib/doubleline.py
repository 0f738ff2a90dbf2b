"""Double lines: the boundary of the lane is the inner one.

From some way off two painted lines and their gap are one stripe, and the joint fit follows its middle. Near the car
the stripe's width is measured: all rows are laid on top of each other along the line, and the averaged profile shows
where the paint ends.
"""

from __future__ import annotations

import numpy as np

from lanelib.birdseye import Grid
from lanelib.jointfit import JointFit, distance, line_x

# half the width of one painted line; the width from which a stripe is two lines with a gap
SINGLE_LINE_M = 0.12  # one painted line; the middle of the inner one lies half of it within the stripe's edge
# stripes of this width are two lines; a worn single one comes out up to 0.23 m
DOUBLE_FROM_M, DOUBLE_TO_M = 0.25, 0.55
CLEAR = 0.2  # rows with at least this much paint on the line are looked at: of worn lines, too
REACH_M, FAR_M, MOST_ROWS = 0.6, 25.0, 40  # beyond 25 m the gap is finer than the pixels
OFFSETS_M = np.arange(-24, 25) * (REACH_M / 24)
FLANKS = np.flatnonzero(np.abs(OFFSETS_M) > REACH_M - 0.15)  # the road on both sides
SECOND_LINE = 1 / 3  # of two lines one may be worn: so bright it must be, of the other; edges are at half its height
GAP = 5  # samples, 12.5 cm: the dark gap between the two lines


def stripe_edges(picture: np.ndarray, x_m: np.ndarray, grid: Grid) -> tuple[float, float]:
    """Where the bright stripe along ``x_m`` begins and ends, left and right of it, in metres; equal where there is
    none.

    ``picture`` (H, W): rows of a bird's-eye picture of ``grid``'s columns; ``x_m`` (H,): where the line crosses them.
    """
    column = grid.column_of(x_m[:, None] + OFFSETS_M)
    low = np.minimum(np.maximum(column.astype(np.intp), 0), picture.shape[1] - 2)
    part = column - low
    index = low + np.arange(len(x_m))[:, None] * picture.shape[1]
    flat = picture.ravel()
    profile = (flat[index] * (1 - part) + flat[index + 1] * part).mean(axis=0)
    profile -= np.median(profile[FLANKS])
    top = 16 + int(np.argmax(profile[16:33]))  # within 0.2 m of the line
    if profile[top] <= 1.0:  # grey levels: nothing there
        return 0.0, 0.0
    bright = np.flatnonzero(profile > SECOND_LINE * profile[top]).tolist()
    first = last = top  # of the bright samples around the top, across gaps
    for i in reversed(bright):
        first = i if 0 < first - i <= GAP else first
    for i in bright:
        last = i if 0 < i - last <= GAP else last
    values, half = profile.tolist(), (OFFSETS_M[1] - OFFSETS_M[0]) / 2
    return float(OFFSETS_M[edge(values, first, 1)] - half), float(OFFSETS_M[edge(values, last, -1)] + half)


def edge(values: list[float], begin: int, step: int) -> int:
    """Where the stripe that begins at ``begin`` and goes on by ``step`` has half of its height."""
    top = begin
    while 0 <= top + step < len(values) and values[top + step] > values[top]:
        top += step
    while values[begin] <= values[top] / 2:
        begin += step
    return begin


def inward(fit: JointFit, picture: np.ndarray, grid: Grid) -> tuple[float, float]:
    """How much further in than the fitted stripes the boundaries lie (m, left and right); 0 for single lines."""
    y = distance(1 / grid.y_m, fit.mean, fit.height_m)
    shifts = []
    for side, support in zip((-1, 1), fit.support, strict=True):
        rows = np.flatnonzero((support > CLEAR) & (y < FAR_M))
        rows = rows[:: len(rows) // MOST_ROWS + 1]
        if len(rows) < 8:
            shifts.append(0.0)
            continue
        x = line_x(y[rows], fit.mean, side) / y[rows] * grid.y_m[rows]  # where the line appears on the flat plane
        left, right = stripe_edges(picture[rows], x, grid)
        inner = (right if side < 0 else -left) - SINGLE_LINE_M / 2
        shifts.append(max(inner, 0.0) if DOUBLE_FROM_M < right - left < DOUBLE_TO_M else 0.0)
    return shifts[0], shifts[1]
