"""Where could a lane be? Starting points for the joint fit when nothing is known.

A line x = c + b y + a y^2 is seen at the bearing U = x / y = c q + b + a / q with q = 1 / y: linear in its three
numbers, and pitch only shifts b. So every paint point votes for single lines (Hough 1962, Duda and Hart 1972) over
(a, b, c); the strongest lines are drawn onto their points; and for each a partner is looked for, parallel to it, over
all lane widths and pitches.
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
    paint_value,
)

# Radii to try, m: each bends a line away from the next by two or three paint widths where such a curve leaves the view.
RADII_M = np.array([2000, 900, 550, 380, 280, 210, 160, 125, 98, 77, 61, 48, 38, 30, 24, 18])
BENDS = np.concatenate([-0.5 / RADII_M[::-1], [0], 0.5 / RADII_M])
BEARINGS = np.arange(-0.325, 0.326, 0.025)  # heading plus what pitch makes of it; half a step is 0.2 m at 16 m
X_STEP_M, X_REACH_M = 0.2, 4.0
X_BINS_M = -X_REACH_M + X_STEP_M * (np.arange(round(2 * X_REACH_M / X_STEP_M)) + 0.5)
NEAREST_X_M = 0.3  # a line closer to the car's middle is none of its lane's
FARTHEST_M = 45.0  # beyond, a bearing step is much wider than the paint; the fit looks further
LEAST_WEIGHT, MOST_VOTERS = 0.1, 110  # the strongest points decide; more of them cost time and change nothing
WIDTHS_PITCHES = np.array([(w, np.deg2rad(p)) for w in np.arange(2.6, 4.65, 0.1) for p in np.arange(-2.4, 2.41, 0.3)])


def votes(points: Points) -> np.ndarray:
    """Hough accumulator (bends, bearings, x bins) float32 of single lines, U = x q + bearing + bend / q."""
    use = np.flatnonzero((points.inverse > 1 / FARTHEST_M) & (points.weight > LEAST_WEIGHT))
    if len(use) > MOST_VOTERS:
        use = use[np.argpartition(-points.weight[use], MOST_VOTERS)[:MOST_VOTERS]]
    y = (1 / points.inverse[use]).astype(np.float32)
    bends, bearings = BENDS[:, None].astype(np.float32), BEARINGS[:, None].astype(np.float32)
    x = (points.bearing[use].astype(np.float32) - bends * y) * y
    x[np.abs(2 * bends) * y > 0.7] = -1e6  # beyond 40 degrees of turn a parabola is no arc
    bins = ((x + X_REACH_M)[:, None, :] - bearings * y) / np.float32(X_STEP_M)
    n = len(X_BINS_M)
    lines = len(BENDS) * len(BEARINGS)
    index = np.minimum(np.maximum(bins, -1), n).astype(np.int32) + 1  # bins 0 and n + 1 take what lies outside
    index += (np.arange(lines, dtype=np.int32) * (n + 2)).reshape(len(BENDS), len(BEARINGS), 1)
    weight = np.broadcast_to(points.weight[use], index.shape)
    table = np.bincount(index.ravel(), weight.ravel(), lines * (n + 2)).reshape(lines, n + 2)
    return table[:, 1:-1].astype(np.float32).reshape(len(BENDS), len(BEARINGS), n)


def single_lines(points: Points, *, count: int = 4) -> list[np.ndarray]:
    """The ``count`` strongest different lines beside the car, as (d, a, b, c): U = d / q^2 + a / q + b + c q."""
    table = votes(points)
    n_bearings, n_x = table.shape[1:]
    flat = table.reshape(-1, n_x)
    flat = cv2.sepFilter2D(flat, -1, np.array([0.6, 1, 0.6]), np.ones(1), borderType=cv2.BORDER_CONSTANT)
    flat[:, np.abs(X_BINS_M) < NEAREST_X_M] = 0
    peaks = np.where(flat >= cv2.dilate(flat, np.ones((3, 3))), flat, 0).ravel()
    order = np.argpartition(-peaks, 200)[:200]
    order = order[np.argsort(-peaks[order])]
    order = order[peaks[order] > 2.0]
    bend, bearing, x = BENDS[order // (n_bearings * n_x)], BEARINGS[order // n_x % n_bearings], X_BINS_M[order % n_x]
    near, far = (x + bearing * 8 + bend * 64).tolist(), (x + bearing * 20 + bend * 400).tolist()
    found: list[int] = []
    for i in range(len(order)):
        if all(abs(near[i] - near[j]) > 0.3 or abs(far[i] - far[j]) > 1.0 for j in found):
            found.append(i)
            if len(found) == count:
                break
    return [refined_line(points, np.array([0.0, bend[i], bearing[i], x[i]])) for i in found]


def refined_line(points: Points, line: np.ndarray) -> np.ndarray:
    """A single line (d, a, b, c) drawn onto the paint points by reweighted least squares, reaching further step by
    step; weakly held where the votes put it, so that a dash alone does not swing it round."""
    q, sigma = points.inverse, bearing_std(points)
    design = np.stack([q**-2, 1 / q, np.ones_like(q), q])
    prior = np.diag(np.array([3e-5, 0.01, 0.1, 1.0]) ** -2.0)
    base = prior @ line
    base_weight = points.weight / (NEIGHBOURS * sigma**2)
    for gate, far in ((15, 30), (10, 40), (6, 55), (5, 70)):
        w = np.square(np.maximum(1 - np.square((points.bearing - line @ design) / (gate * sigma)), 0))
        weighted = design * (w * base_weight * (q > 1 / far))
        line = np.linalg.solve(weighted @ design.T + prior, weighted @ points.bearing + base)
    return line


def partner(points: Points, line: np.ndarray, prior: Prior) -> list[tuple[float, np.ndarray]]:
    """Lanes with ``line`` as one boundary: where is more paint, parallel to it? (energy, mean (7,)) of the two best and
    of a lane of the usual width with no paint on its other side.

    Over all widths and pitches U - U_line = -side width (q + pitch / height) sqrt(1 + slope^2).
    """
    d, a, b, c = line
    side = 1.0 if c > 0 else -1.0
    q, sigma = points.inverse, bearing_std(points)
    off = points.bearing - line @ np.stack([q**-2, 1 / q, np.ones_like(q), q])
    own = float(points.weight @ np.maximum(1 - np.square(off / (4 * sigma)), 0))
    apart = -side * off / np.sqrt(1 + np.square(b + 2 * a / q + 3 * d / q**2))
    use = np.flatnonzero((apart > 1.5 * q) & (apart < 6 * q) & (q > 1 / FARTHEST_M))
    q, apart, sigma, weight = q[use], apart[use], sigma[use], points.weight[use]
    width, pitch = WIDTHS_PITCHES.T
    z = (apart - width[:, None] * (q + pitch[:, None] / points.height_m)) / (4 * sigma)
    other = np.maximum(1 - np.square(z), 0) @ weight
    energy = paint_value(own) + paint_value(other)
    for value, i in ((width, WIDTH), (pitch, PITCH), (c - side * width / 2, CENTRE)):
        energy = energy - 0.5 * np.square(value - prior.mean[i]) / prior.covariance[i, i]
    best = int(np.argmax(energy))
    away = np.abs(width - width[best]) + 40 * np.abs(pitch - pitch[best]) > 0.5
    second = int(np.argmax(np.where(away, energy, -np.inf)))
    pairs = [(energy[i], width[i], pitch[i]) for i in (best, second)]
    pairs.append((paint_value(own), prior.mean[WIDTH], prior.mean[PITCH]))
    h = points.height_m
    return [(float(e), np.array([c - side * w / 2, b - c * p / h, a, d, w, p, 0.0])) for e, w, p in pairs]


def hypotheses(points: Points, *, prior: Prior = UNKNOWN_ROAD, count: int = 3) -> list[np.ndarray]:
    """The ``count`` most promising different lanes around the car, as means (7,), best first."""
    if len(points) < 4:
        return []
    lanes = [lane for line in single_lines(points) for lane in partner(points, line, prior)]
    found: list[np.ndarray] = []
    for _, mean in sorted(lanes, key=lambda lane: -lane[0]):
        if len(found) < count and abs(mean[CENTRE]) < 2.5 and all(differ(mean, other) for other in found):
            found.append(mean)
    return found
