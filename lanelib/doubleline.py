"""Double lines: the boundary of the lane is the inner one.

From some way off two painted lines and their gap are one stripe, and the joint fit follows its middle. Near the car
the stripe's width is measured: all rows are laid on top of each other along the line, and the averaged profile
shows where the paint ends.
"""

from __future__ import annotations

import numpy as np

from lanelib.jointfit import JointFit, distance, line_x

# half the width of one painted line; the width from which a stripe is two lines with a gap
SINGLE_LINE_M = (0.06, 0.25)
PROFILE_REACH_M, PROFILE_FAR_M = 0.6, 25.0


def stripe_width(picture: np.ndarray, x_m: np.ndarray, grid_x0_m: float, column_m: float) -> tuple[float, float, float]:
    """Width at half height of the bright stripe that runs along ``x_m``.

    ``picture`` (H, W): rows of a bird's-eye picture; ``x_m`` (H,): where the line crosses them. The rows are laid
    on top of each other along
    the line and averaged. Returns (left edge, right edge) relative to the line, in metres, and the contrast in
    grey levels; zeros where no stripe is.
    """
    step = 0.025
    d = np.arange(-PROFILE_REACH_M, PROFILE_REACH_M + step / 2, step)
    column = (x_m[:, None] + d[None, :] - grid_x0_m) / column_m
    low = np.clip(column.astype(int), 0, picture.shape[1] - 2)
    rows = np.arange(len(x_m))[:, None]
    part = column - low
    values = picture[rows, low] * (1 - part) + picture[rows, low + 1] * part
    profile = values.mean(axis=0)
    outside = np.abs(d) > PROFILE_REACH_M - 0.15
    profile = profile - np.median(profile[outside])
    middle = np.abs(d) < 0.2
    peak = float(profile[middle].max())
    if peak <= 1.0:
        return 0.0, 0.0, 0.0
    above = profile > peak / 2
    top = int(np.argmax(np.where(middle, profile, -np.inf)))
    gap = int(round(0.125 / step))  # the dark gap of a double line may fall below half height: bridge it
    left = right = top
    while left > 0 and above[max(left - gap, 0) : left].any():
        left -= 1
    while right < len(d) - 1 and above[right + 1 : right + 1 + gap].any():
        right += 1
    return float(d[left]) - step / 2, float(d[right]) + step / 2, peak


def inward(fit: JointFit, picture: np.ndarray, grid) -> tuple[float, float]:
    """How much further in than the fitted stripes the boundaries lie (m, left and right): 0 for single lines. For
    a double line the
    boundary is the middle of its inner line: half a painted line within the stripe's inner edge."""
    y = distance(1 / grid.y_m, fit.mean, fit.height_m)
    shifts = []
    for side, support in zip((-1, 1), fit.support, strict=True):
        rows = np.flatnonzero((support > 0.4) & (y < PROFILE_FAR_M))
        if len(rows) < 8:
            shifts.append(0.0)
            continue
        x = line_x(y[rows], fit.mean, side) / y[rows] * grid.y_m[rows]  # where the line appears on the flat plane
        left, right, _ = stripe_width(picture[rows].astype(np.float32), x, grid.x_m[0], grid.column_m)
        inner = right if side < 0 else -left
        double = SINGLE_LINE_M[1] < right - left < 0.55 and inner > SINGLE_LINE_M[0]
        shifts.append(inner - SINGLE_LINE_M[0] if double else 0.0)
    return shifts[0], shifts[1]
