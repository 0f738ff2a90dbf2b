"""What a lens does to a ray, and how to take it back: the Brown-Conrady model in normalised coordinates.

A point (X, Y, Z) in camera axes (x right, y down, z forward) lies at x = X/Z, y = Y/Z. The lens moves it to

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)        r^2 = x^2 + y^2
    y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

with coefficients (k1, k2, p1, p2, k3) in OpenCV's order (D. C. Brown, "Close-Range Camera Calibration", 1971).
"""

import math

import numpy as np

NEWTON_STEPS = 20  # 4-6 reach the last digit inside a usual frame; close to the fold, where the slope vanishes, more
SOLVED = 1e-7  # how near undistorting must come, in focal lengths: 1e-4 px at 1000 px


def fold_radius(coefficients: np.ndarray) -> float:
    """The radius r at which the radial polynomial stops growing, d r_d / d r = 0; inf if it never does.

    Points further out would come back towards the picture's centre; the real lens does not show them.
    """
    k1, k2, _, _, k3 = coefficients
    # d/dr (r + k1 r^3 + k2 r^5 + k3 r^7) = 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 with s = r^2
    slope = np.array([7 * k3, 5 * k2, 3 * k1, 1.0])
    roots = np.roots(np.where(np.abs(slope) < 1e-12, 0, slope))  # so small a term folds nothing within r = 100
    s = roots[(np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))) & (roots.real > 0)].real
    return math.sqrt(s.min()) if s.size else math.inf


def distort(xy: np.ndarray, coefficients: np.ndarray, *, r_max: float = math.inf) -> np.ndarray:
    """Where the lens shows the points (N, 2), normalised; NaN from radius `r_max` on (pass the `fold_radius`)."""
    seen = np.hypot(xy[:, 0], xy[:, 1]) < r_max  # False for NaN
    return _equations(np.where(seen[:, None], xy, np.nan), coefficients)[0]


def undistort(xy_d: np.ndarray, coefficients: np.ndarray, *, r_max: float = math.inf) -> np.ndarray:
    """The inverse of `distort`, (N, 2), by Newton's method; NaN where no point within `r_max` leads there.

    (OpenCV's `undistortPoints` stops after five fixed-point steps: 1.5 px off in a corner of the shipped camera.)
    """
    xy = np.array(xy_d, dtype=np.float64)  # a start short of the root for a barrel, beyond it for a pincushion
    with np.errstate(all="ignore"):  # points without a solution may run away; they are dropped at the end
        for _ in range(NEWTON_STEPS):
            found, (a, b, d) = _equations(xy, coefficients)
            ex, ey = (found - xy_d).T
            # step = [a b; b d]^-1 (ex, ey)
            step = np.stack([d * ex - b * ey, a * ey - b * ex], axis=1) / (a * d - b * b)[:, None]
            xy -= step
            if not (np.abs(step) > 1e-12).any():
                break
        missed = np.hypot(*(_equations(xy, coefficients)[0] - xy_d).T)
        solved = (missed < SOLVED) & (np.hypot(xy[:, 0], xy[:, 1]) < r_max)
    xy[~solved] = np.nan
    return xy


def _equations(xy: np.ndarray, coefficients: np.ndarray):
    """The equations at the head of this file and their symmetric Jacobian (dx_d/dx, dx_d/dy = dy_d/dx, dy_d/dy)."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = xy[:, 0], xy[:, 1]
    rr = x * x + y * y
    radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
    x_d = x * radial + 2 * p1 * x * y + p2 * (rr + 2 * x * x)
    y_d = y * radial + p1 * (rr + 2 * y * y) + 2 * p2 * x * y
    slope = 2 * (k1 + rr * (2 * k2 + rr * 3 * k3))  # d radial / dx = x * slope
    a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    b = x * y * slope + 2 * p1 * x + 2 * p2 * y
    d = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return np.stack([x_d, y_d], axis=1), (a, b, d)
