"""Where could a lane be? Starting points for the joint fit when nothing is known.

A line x = c + b y + a y^2 is seen at the bearing U = x / y = c q + b + a / q with q = 1 / y: linear in its three
numbers, and pitch only shifts b.
So every paint point votes for single lines (Hough 1962, Duda and Hart 1972) over (a, b, c); the strongest lines
are drawn onto their points;
and for each a partner is looked for, parallel to it, over all lane widths and pitches.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanelib.jointfit import (
    CENTRE,
    NEIGHBOURS,
    PITCH,
    UNKNOWN_ROAD,
    WIDTH,
    Points,
    Prior,
    bearing_std,
    differ,
    energy_of,
    supported_rows,
)


def _curvatures() -> np.ndarray:
    """Curvatures to try, 1/m: steps that shift the line by a paint's width or two where such a curve leaves the
    view."""
    radius = np.array(
        [3000, 1500, 1000, 700, 500, 400, 320, 260, 210, 170, 140, 115, 95, 80, 67, 57, 49, 42, 36, 31, 26, 22, 19, 16]
    )
    return np.concatenate([-1 / radius[::-1], [0], 1 / radius])


BENDS = _curvatures() / 2
BEARINGS = np.arange(-0.32, 0.321, 0.01)  # heading plus what pitch makes of it; half a step is 0.2 m at 40 m
X_STEP_M, X_REACH_M = 0.1, 4.0
NEAREST_X_M = 0.3  # a line closer to the car's middle is none of its lane's
WIDTHS = np.arange(2.6, 4.65, 0.1)
PITCHES = np.deg2rad(np.arange(-2.4, 2.41, 0.2))
FARTHEST_M = 45.0  # beyond, a bearing step is wider than the paint; the fit looks further


def votes(points: Points) -> np.ndarray:
    """Hough accumulator (bends, bearings, x bins) of single lines: U = x q0 + bearing + bend / q0."""
    use = points.inverse > 1 / FARTHEST_M
    q, bearing, weight = points.inverse[use], points.bearing[use], points.weight[use]
    n_x = int(round(2 * X_REACH_M / X_STEP_M))
    table = np.zeros((len(BENDS), len(BEARINGS), n_x), np.float32)
    y = 1 / q
    for i, bend in enumerate(BENDS):
        near = y * abs(2 * bend) < 0.7  # beyond 35 degrees of turn a parabola is no arc
        x = (bearing[near] - bend * y[near]) * y[near]
        bins = (x[None, :] - BEARINGS[:, None] * y[None, near] + X_REACH_M) / X_STEP_M
        index = bins.astype(np.int32)
        inside = (bins >= 0) & (index < n_x)
        index += np.arange(len(BEARINGS), dtype=np.int32)[:, None] * n_x
        w = np.broadcast_to(weight[near], index.shape)
        table[i] = np.bincount(index[inside], w[inside], len(BEARINGS) * n_x).reshape(len(BEARINGS), n_x)
    return table


def single_lines(points: Points, *, count: int = 5) -> list[tuple[int, np.ndarray]]:
    """The ``count`` strongest different lines beside the car: (side, (d, a, b, c)) with U = d / q0^2 + a / q0 + b
    + c q0."""
    table = votes(points)
    n_b, n_k, n_x = table.shape
    smooth = cv2.sepFilter2D(
        table.reshape(n_b * n_k, n_x), -1, np.array([0.6, 1, 0.6]), np.ones(1), borderType=cv2.BORDER_CONSTANT
    )
    x_of = -X_REACH_M + X_STEP_M * (np.arange(n_x) + 0.5)
    smooth[:, np.abs(x_of) < NEAREST_X_M] = 0
    peaks = np.where(smooth >= cv2.dilate(smooth, np.ones((3, 3))), smooth, 0).ravel()
    order = np.argpartition(-peaks, 400)[:400]
    order = order[np.argsort(-peaks[order])]
    bend, bearing, x = BENDS[order // (n_k * n_x)], BEARINGS[order // n_x % n_k], x_of[order % n_x]
    near, far = x + bearing * 8 + bend * 64, x + bearing * 20 + bend * 400
    found: list[int] = []
    for i in range(len(order)):
        if peaks[order[i]] < 2.0 or len(found) == count:
            break
        if all(abs(near[i] - near[j]) > 0.3 or abs(far[i] - far[j]) > 1.0 for j in found):
            found.append(i)
    lines = [refined_line(points, np.array([0, bend[i], bearing[i], x[i]])) for i in found]
    return [(1 if x[i] > 0 else -1, line) for i, line in zip(found, lines)]


def refined_line(points: Points, line: np.ndarray) -> np.ndarray:
    """A single line (d, a, b, c) drawn onto the paint points by reweighted least squares, reaching further step by
    step."""
    q, sigma = points.inverse, bearing_std(points)
    design = np.column_stack([q**-2, 1 / q, np.ones_like(q), q])
    prior = np.diag(np.array([3e-5, 0.01, 0.1, 1.0]) ** -2.0)
    base = np.array([0.0, line[1], line[2], line[3]])
    for gate, far in ((15, 30), (10, 40), (6, 55), (5, 70)):
        z = (points.bearing - design @ line) / sigma
        w = (
            np.where(q > 1 / far, points.weight * np.square(np.maximum(1 - np.square(z / gate), 0)), 0)
            / NEIGHBOURS
            / sigma**2
        )
        line = np.linalg.solve((design * w[:, None]).T @ design + prior, design.T @ (w * points.bearing) + prior @ base)
    return line


def partner(points: Points, side: int, line: np.ndarray, prior: Prior) -> list[np.ndarray]:
    """Lanes (7,) that have ``line`` as their left (-1) or right (+1) boundary: where else is paint, parallel to
    it? Over all widths
    and pitches, U - U_line = -side width (q0 + pitch / height) sqrt(1 + slope^2). The two best, and the usual
    width."""
    q, h = points.inverse, points.height_m
    use = q > 1 / FARTHEST_M
    q, sigma, weight = q[use], bearing_std(points)[use], points.weight[use]
    d, a, b, c = line
    apart = (points.bearing[use] - (d / q**2 + a / q + b + c * q)) * -side
    slope = b + 2 * a / q + 3 * d / q**2
    apart = apart / np.sqrt(1 + slope**2)
    sideways = (apart > 1.5 * q) & (apart < 6 * q)
    q, apart, sigma, weight = q[sideways], apart[sideways], sigma[sideways], weight[sideways]
    std = np.sqrt(np.diag(prior.covariance))
    grid = np.array([(w, p) for w in WIDTHS for p in PITCHES])
    z = (apart - grid[:, :1] * (q + grid[:, 1:] / h)) / sigma
    score = np.maximum(1 - np.square(z / 4), 0) @ weight if len(q) else np.zeros(len(grid))
    centre = c - side * grid[:, 0] / 2
    for value, i in ((grid[:, 0], WIDTH), (grid[:, 1], PITCH), (centre, CENTRE)):
        score = score - 0.5 * ((value - prior.mean[i]) / std[i]) ** 2
    chosen = [int(np.argmax(score))]
    away = np.abs(grid[:, 0] - grid[chosen[0], 0]) + np.abs(grid[:, 1] - grid[chosen[0], 1]) * 40 > 0.5
    chosen.append(int(np.argmax(np.where(away, score, -np.inf))))
    pairs = [*grid[chosen], (prior.mean[WIDTH], prior.mean[PITCH])]
    return [np.array([c - side * w / 2, b - c * p / h, a, d, w, p, 0.0]) for w, p in pairs]


def hypotheses(points: Points, *, prior: Prior = UNKNOWN_ROAD, count: int = 4) -> list[np.ndarray]:
    """The ``count`` most promising different lanes around the car, as means (7,), best first."""
    if len(points) < 4:
        return []
    means = [m for side, line in single_lines(points) for m in partner(points, side, line, prior)]
    means = [m for m in means if 2.2 < m[WIDTH] < 5.2 and abs(m[CENTRE]) < 2.5]
    energies = [energy_of(m, supported_rows(points, m, gate=6.0)[0], prior) for m in means]
    found: list[np.ndarray] = []
    for i in np.argsort(energies)[::-1]:
        if len(found) < count and all(differ(means[i], other) for other in found):
            found.append(means[i])
    return found
