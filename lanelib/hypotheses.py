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
    apart,
    holds_car,
    landmarks,
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
GROUPS = 11  # the bends vote in so many groups: their arrays then stay in the processor's cache
LEAST_WEIGHT, MOST_VOTERS = 0.1, 75  # the strongest points decide; more of them cost time and change nothing
PARTNERS = 4  # a dash of our lane, of the next one, a speck: with few points the best of them is not always ours
WIDTHS_PITCHES = np.array([(w, np.deg2rad(p)) for w in np.arange(2.6, 4.65, 0.1) for p in np.arange(-2.4, 2.41, 0.3)])
APART_M = 0.25, 0.25, 0.6, 0.6  # starts whose landmarks are nearer than that lead to the same fit, as a rule
ALIKE = np.abs(WIDTHS_PITCHES[:, None] - WIDTHS_PITCHES) @ (1, 40) <= 0.5  # which of them would lead to the same fit


def votes(points: Points) -> np.ndarray:
    """Hough accumulator (bends, bearings, x bins) float32 of single lines, U = x q + bearing + bend / q."""
    use = np.flatnonzero((points.inverse > 1 / FARTHEST_M) & (points.weight > LEAST_WEIGHT))
    if len(use) > MOST_VOTERS:
        use = use[np.argpartition(-points.weight[use], MOST_VOTERS)[:MOST_VOTERS]]
    y = (1 / points.inverse[use]).astype(np.float32)
    bends, bearings = BENDS[:, None].astype(np.float32), BEARINGS[:, None].astype(np.float32)
    x = (points.bearing[use].astype(np.float32) - bends * y) * y
    x[np.abs(2 * bends) * y > 0.7] = -1e6  # beyond 40 degrees of turn a parabola is no arc
    n, step = len(X_BINS_M), np.float32(X_STEP_M)
    first, further = (x + X_REACH_M) / step + 1, bearings * y / step  # bins 0 and n + 1 take what lies outside
    table = np.empty((GROUPS, len(BENDS) // GROUPS * len(BEARINGS), n), np.float32)
    lines = table.shape[1]
    start, weight = np.arange(0, lines * (n + 2), n + 2)[:, None], np.tile(points.weight[use], lines)
    for i, group in enumerate(np.split(first[:, None, :], GROUPS)):
        bins = group - further
        index = np.clip(bins, 0, n + 1, out=bins).reshape(lines, -1).astype(np.intp)
        index += start
        table[i] = np.bincount(index.ravel(), weight, lines * (n + 2)).reshape(lines, -1)[:, 1:-1]
    return table.reshape(len(BENDS), len(BEARINGS), n)


def single_lines(points: Points, *, count: int = 4) -> list[np.ndarray]:
    """The ``count`` strongest different lines beside the car, as (d, a, b, c): U = d / q^2 + a / q + b + c q."""
    table = votes(points)
    n_bearings, n_x = table.shape[1:]
    flat = table.reshape(-1, n_x)
    flat = cv2.sepFilter2D(flat, -1, np.array([0.6, 1, 0.6]), np.ones(1), borderType=cv2.BORDER_CONSTANT)
    flat[:, np.abs(X_BINS_M) < NEAREST_X_M] = 0
    peaks = np.flatnonzero((flat > 2.0) & (flat >= cv2.dilate(flat, np.ones((3, 3)))))
    order = peaks[np.argsort(-flat.ravel()[peaks], kind="stable")[:200]]
    bend, bearing, x = BENDS[order // (n_bearings * n_x)], BEARINGS[order // n_x % n_bearings], X_BINS_M[order % n_x]
    near, far = x + bearing * 8 + bend * 64, x + bearing * 20 + bend * 400
    found, others = [], np.arange(len(order))
    while len(others) and len(found) < count:
        best = others[0]
        found.append(best)
        others = others[(np.abs(near - near[best])[others] > 0.3) | (np.abs(far - far[best])[others] > 1.0)]
    return refined_lines(points, np.column_stack([np.zeros(len(order)), bend, bearing, x])[found])


def refined_lines(points: Points, lines: np.ndarray) -> np.ndarray:
    """Single lines (M, 4), each d, a, b, c, drawn onto the paint points by reweighted least squares, reaching further
    step by step; weakly held where the votes put them, so that a dash alone does not swing a line round."""
    q = points.inverse
    design = np.stack([q**-2, 1 / q, np.ones_like(q), q])
    prior = np.diag(np.array([3e-5, 0.01, 0.1, 1.0]) ** -2.0)
    base = lines @ prior
    scale = 1 / points.std
    weight = points.weight / NEIGHBOURS * scale**2
    for gate, far in ((15, 30), (10, 40), (6, 55), (5, 70)):
        off = (points.bearing - lines @ design) * (scale / gate)
        w = np.square(np.maximum(1 - off * off, 0)) * (weight * (q > 1 / far))
        weighted = w[:, None, :] * design
        normal = weighted @ design.T + prior
        lines = np.linalg.solve(normal, (weighted @ points.bearing + base)[..., None])[..., 0]
    return lines


def partners(points: Points, lines: np.ndarray, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
    """Lanes with one of ``lines`` (M, 4) as boundary: where is more paint, parallel to it? Energies (K,) and means
    (K, 7) of the best ones of each line and of lanes of the usual width with no paint on their other side.

    Over all widths and pitches U - U_line = -side width (q + pitch / height) sqrt(1 + slope^2).
    """
    d, a, b, c = lines.T
    side = np.where(c > 0, 1.0, -1.0)
    q, scale = points.inverse, 1 / (4 * points.std)
    y = 1 / q
    off = points.bearing - lines @ np.stack([y * y, y, np.ones_like(q), q])
    own = np.maximum(1 - np.square(off * scale), 0) @ points.weight
    slope = b[:, None] + y * (2 * a[:, None] + 3 * d[:, None] * y)
    apart = -side[:, None] * off / np.sqrt(1 + slope * slope)
    usable = (apart > 1.5 * q) & (apart < 6 * q) & (q > 1 / FARTHEST_M)
    width, pitch = WIDTHS_PITCHES.T
    # z = (apart - width (q + pitch / height)) / (4 sigma), for all widths and pitches (rows) and points (columns)
    factors = np.column_stack([np.ones_like(width), -width, -width * pitch / points.height_m]).astype(np.float32)
    terms = (np.stack([apart, np.broadcast_to(q, apart.shape), np.ones_like(apart)]) * scale).astype(np.float32)
    weight = points.weight.astype(np.float32)
    other = np.empty((len(lines), len(width)), np.float32)
    for i in range(len(lines)):
        z = factors @ terms[:, i, usable[i]]
        np.multiply(z, z, out=z)
        np.maximum(np.subtract(1, z, out=z), 0, out=z)
        np.matmul(z, weight[usable[i]], out=other[i])
    centre = c[:, None] - side[:, None] * width / 2
    energy = paint_value(own)[:, None] + paint_value(other)
    for value, i in ((width, WIDTH), (pitch, PITCH), (centre, CENTRE)):
        energy -= 0.5 * np.square(value - prior.mean[i]) / prior.covariance[i, i]
    every, found = np.arange(len(lines)), [(paint_value(own), prior.mean[WIDTH] + 0 * c, prior.mean[PITCH] + 0 * c)]
    for _ in range(PARTNERS):
        best = energy.argmax(axis=1)
        found.append((energy[every, best], width[best], pitch[best]))
        for i, lane in enumerate(best):
            energy[i, ALIKE[lane]] = -np.inf
    energy, width, pitch = np.hstack(found)
    a, b, c, d, side = (np.tile(of_line, len(found)) for of_line in (a, b, c, d, side))
    centre, heading = c - side * width / 2, b - c * pitch / points.height_m
    return energy, np.column_stack([centre, heading, a, d, width, pitch, np.zeros_like(c)])


def hypotheses(
    points: Points, *, prior: Prior = UNKNOWN_ROAD, count: int = 4, least_energy: float = -np.inf
) -> list[np.ndarray]:
    """The ``count`` most promising different lanes around the car, as means (7,), best first; only those estimated to
    have at least ``least_energy``."""
    if len(points) < 4:
        return []
    energy, means = partners(points, single_lines(points), prior)
    order = np.argsort(-energy, kind="stable")
    means = means[order[energy[order] >= least_energy]]
    means = means[holds_car(means)]
    places = landmarks(means)
    found: list[int] = []
    for i in range(len(means)):
        if len(found) < count and all(apart(places[i], places[j], least_m=APART_M) for j in found):
            found.append(i)
    return list(means[found])
