"""Double lines: the boundary of the lane is the inner one.

From some way off two painted lines and their gap are one stripe, and the joint fit follows its middle. Near the car
the stripe's width is measured: all rows are laid on top of each other along the line, and the averaged profile shows
where the paint ends.
"""

from __future__ import annotations

import numpy as np

from lanelib.birdseye import Grid
from lanelib.jointfit import JointFit, distance, line_x

SINGLE_LINE_M = 0.12  # one painted line; the middle of the inner one lies half of it within the stripe's edge
# stripes of this width are two lines; a worn single one comes out up to 0.23 m
DOUBLE_FROM_M, DOUBLE_TO_M = 0.25, 0.55
CLEAR = 0.2  # rows with at least this much paint on the line are looked at: of worn lines, too
REACH_M, FAR_M, MOST_ROWS = 0.6, 25.0, 40  # beyond 25 m the gap is finer than the pixels
OFFSETS_M = np.arange(-24, 25) * (REACH_M / 24)
MIDDLE = slice(16, 33)  # of these samples: within 0.2 m of the line
FLANKS = np.flatnonzero(np.abs(OFFSETS_M) > REACH_M - 0.15)  # the road on both sides
LEAST_LEVELS = 1.0  # grey levels above the road: averaged over so many rows, less is no paint
SECOND_LINE = 1 / 3  # of two lines one may be worn: so bright it must be, of the other; edges are at half its height
GAP, WIDEST = 5, 8  # samples: at most 4 dark ones (10 cm) between the lines; the other one is no wider than 20 cm


def profile_across(picture: np.ndarray, x_m: np.ndarray, grid: Grid) -> np.ndarray:
    """Grey levels above the road, (49,), at `OFFSETS_M` to the right of the line ``x_m``, averaged along it.

    ``picture`` (H, W): rows of a bird's-eye picture of ``grid``'s columns; ``x_m`` (H,): where the line crosses them.
    """
    column = grid.column_of(x_m[:, None] + OFFSETS_M)
    low = np.minimum(np.maximum(column.astype(np.intp), 0), picture.shape[1] - 2)
    part = column - low
    index = low + np.arange(len(x_m))[:, None] * picture.shape[1]
    flat = picture.ravel()
    profile = (flat[index] * (1 - part) + flat[index + 1] * part).mean(axis=0)
    return profile - np.median(profile[FLANKS])


def stripe_edges(picture: np.ndarray, x_m: np.ndarray, grid: Grid) -> tuple[float, float]:
    """Where the bright stripe along ``x_m`` begins and ends, in metres to the right of it; equal where there is none.

    ``picture``, ``x_m``, ``grid``: see `profile_across`.
    """
    profile = profile_across(picture, x_m, grid)
    top = MIDDLE.start + int(np.argmax(profile[MIDDLE]))
    if profile[top] <= LEAST_LEVELS:
        return 0.0, 0.0
    values, half = profile.tolist(), (OFFSETS_M[1] - OFFSETS_M[0]) / 2
    first, last = around(values, top)
    inner = range(1, len(values) - 1)
    peaks = [i for i in inner if values[i] > SECOND_LINE * values[top] and values[i - 1] < values[i] >= values[i + 1]]
    for peak in sorted(peaks, key=lambda i: abs(i - top)):
        begin, end = around(values, peak)
        valley = min(range(min(peak, top), max(peak, top) + 1), key=values.__getitem__)
        begin, end = (begin, min(end, valley)) if peak < top else (max(begin, valley), end)
        if end - begin < WIDEST and begin - last <= GAP and first - end <= GAP:
            first, last = min(first, begin), max(last, end)
    return float(OFFSETS_M[first] - half), float(OFFSETS_M[last] + half)


def around(values: list[float], peak: int) -> tuple[int, int]:
    """The first and the last sample around a peak that are above half of it."""
    first = last = peak
    while first > 0 and values[first - 1] > values[peak] / 2:
        first -= 1
    while last < len(values) - 1 and values[last + 1] > values[peak] / 2:
        last += 1
    return first, last


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
