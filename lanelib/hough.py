"""Single lines among the paint points: the Hough transform, for curves and from above.

A line x = c + b y + a y^2 is seen at the bearing U = x / y = c q + b + a / q with q = 1 / y: linear in its three
numbers, and pitch only shifts b. So every paint point votes for single lines (Hough 1962, Duda and Hart 1972) over
(a, b, c); the best ones are chosen one after the other, on either side of the car; and they are drawn onto their
points.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanelib.jointfit import BEND, CENTRE, HEADING, NEIGHBOURS, PITCH, UNKNOWN_ROAD, WIDTH, Points, Prior

# Radii to try, m: each bends a line away from the next by two or three paint widths where such a curve leaves the view.
RADII_M = np.array([2000, 900, 550, 380, 280, 210, 160, 125, 98, 77, 61, 48, 38, 30, 24, 18])
BENDS = np.concatenate([-0.5 / RADII_M[::-1], [0], 0.5 / RADII_M])
BEARINGS = 0.03 * np.arange(-10, 11)  # heading plus what pitch makes of it; half a step is 0.2 m at 13 m
X_STEP_M, X_REACH_M = 0.2, 4.0
X_BINS_M = -X_REACH_M + X_STEP_M * (np.arange(round(2 * X_REACH_M / X_STEP_M)) + 0.5)
NEAREST_X_M, MOST_X_M = 0.3, 3.6  # lines closer to the car's middle, or further away, are none of its lane's
FARTHEST_M = 45.0  # beyond, a bearing step is much wider than the paint; the fit looks further
LEAST_WEIGHT, MOST_VOTERS = 0.1, 75  # more voters cost time and change nothing
STRIP_M, STRIP_VOTERS = 1.0, 10  # strips along the road; points beyond so many in one have less and less to say
LEAST_VOTES, MOST_PEAKS = 2.0, 200
PER_SIDE = 4  # lines: ours, that of the next lane, other readings of them
ON_LINE_M = 0.3  # a point so near to a line votes for it
PLACES_M = 8.0, 20.0  # where lines are told apart
SAME_LINE_M = 0.3, 1.0  # those that are nearer to each other there are one
DRAWN_TOGETHER_M = 0.06, 0.2  # once drawn onto their points, those that are nearer
STEPS = (15, 30), (8, 45), (5, 70)  # widths of the biweight in standard deviations, and how far they look, m


def voters(points: Points) -> np.ndarray:
    """Which points vote, (V,) int: the strongest, but of a strip along the road with many of them not all, so that a
    solid line beside the next lane leaves room for the dashes of our own."""
    use = np.flatnonzero((points.inverse > 1 / FARTHEST_M) & (points.weight > LEAST_WEIGHT))
    if len(use) <= MOST_VOTERS:
        return use
    weight = points.weight[use]
    strip = np.round(points.bearing[use] / (STRIP_M * points.inverse[use]))
    order = np.argsort(2 * strip - weight)  # strip by strip, the strongest first (weights are at most 1)
    strip, place = strip[order], np.arange(len(use))
    is_first = np.r_[True, strip[1:] != strip[:-1]]
    rank = place - np.maximum.accumulate(place * is_first)
    use, value = use[order], weight[order] / (1 + rank / STRIP_VOTERS)
    return use[np.argpartition(-value, MOST_VOTERS)[:MOST_VOTERS]]


def votes(points: Points) -> np.ndarray:
    """Hough accumulator (bends, bearings, x bins) float32 of single lines, U = x q + bearing + bend / q, by these
    points."""
    y = (1 / points.inverse).astype(np.float32)
    bends, bearings = BENDS[:, None].astype(np.float32), BEARINGS[:, None].astype(np.float32)
    x = (points.bearing.astype(np.float32) - bends * y) * y
    x[np.abs(2 * bends) * y > 0.7] = -1e6  # beyond 40 degrees of turn a parabola is no arc
    n, lines = len(X_BINS_M), len(BENDS) * len(BEARINGS)
    bins = (x + X_REACH_M)[:, None] - bearings * y  # (bends, bearings, points)
    bins *= np.float32(1 / X_STEP_M)
    bins += 1  # bins 0 and n + 1 take what lies outside
    index = np.clip(bins, 0, n + 1, out=bins).reshape(lines, -1).astype(np.intp)
    index += np.arange(0, lines * (n + 2), n + 2)[:, None]
    table = np.bincount(index.ravel(), np.tile(points.weight, lines), lines * (n + 2))
    return table.reshape(len(BENDS), len(BEARINGS), n + 2)[..., 1:-1].astype(np.float32)


def peaks(table: np.ndarray, objected: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bend, bearing and x, (K,) each, of the highest local maxima of the accumulator, each bin less what is
    ``objected`` to it; otherwise the solid lines of other lanes would take all the places."""
    n_bearings, n_x = table.shape[1:]
    flat: np.ndarray = cv2.sepFilter2D(
        table.reshape(-1, n_x), -1, np.array([0.6, 1, 0.6]), np.ones(1), borderType=cv2.BORDER_CONSTANT
    )
    flat[:, np.abs(X_BINS_M) < NEAREST_X_M] = 0
    clear = flat > LEAST_VOTES
    bins = flat.reshape(table.shape)
    bins -= objected
    at = np.flatnonzero(clear & (flat >= cv2.dilate(flat, np.ones((3, 3)))))
    at = at[np.argsort(-flat.ravel()[at], kind="stable")[:MOST_PEAKS]]
    return BENDS[at // (n_bearings * n_x)], BEARINGS[at // n_x % n_bearings], X_BINS_M[at % n_x]


def objection(prior: Prior, height_m: float, bend, bearing, x) -> np.ndarray:
    """What ``prior`` objects to these lines as boundaries of a lane of the usual width: half the squared Mahalanobis
    distance. A camera ``height_m`` above the road that pitches turns the bearing of a line beside it."""
    centre = x - np.copysign(prior.mean[WIDTH] / 2, x) - prior.mean[CENTRE]
    turn = prior.covariance[HEADING, HEADING] + np.square(x / height_m) * prior.covariance[PITCH, PITCH]
    across = 0.5 * (np.square(centre) / prior.covariance[CENTRE, CENTRE] + np.square(bearing) / turn)
    bent = 0.5 * np.square(bend) / prior.covariance[BEND, BEND]
    return across.astype(np.float32) + bent.astype(np.float32)


def single_lines(points: Points, *, prior: Prior = UNKNOWN_ROAD, count: int = PER_SIDE) -> np.ndarray:
    """Lines that could bound our lane, (M, 4), each (d, a, b, c): U = d / q^2 + a / q + b + c q; at most ``count`` of
    each side of the car.

    One after the other: the line with most votes, less the ``objection`` of the prior. The points of a chosen line
    count half from then on, or all would be variants of the strongest.
    """
    seen = points.some(voters(points))
    every = BENDS[:, None, None], BEARINGS[:, None], X_BINS_M
    bend, bearing, x = peaks(votes(seen), objection(prior, points.height_m, *every))
    if len(x) == 0:
        return np.empty((0, 4))
    y, seen_bearing = (1 / seen.inverse).astype(np.float32), seen.bearing.astype(np.float32)
    lines = np.column_stack([bend, bearing, x]).astype(np.float32)
    on = np.abs(lines @ np.stack([y * y, y, np.ones_like(y)]) - seen_bearing * y) < ON_LINE_M
    on = on.astype(np.float32)
    objected = objection(prior, points.height_m, bend, bearing, x)
    place = np.column_stack([x + y * (bearing + y * bend) for y in PLACES_M]) / SAME_LINE_M
    found, weight = [], seen.weight.astype(np.float32)
    for side in (x < 0, x > 0):
        worth = np.where(side, on @ weight - objected, 0)
        for _ in range(count):
            best = int(worth.argmax())
            if worth[best] <= 0:
                break
            found.append(best)
            half = on[best] * weight / 2
            weight -= half
            worth -= on @ half
            worth[np.abs(place - place[best]).max(axis=1) < 1] = 0
    lines = refined_lines(points, np.column_stack([np.zeros(len(x)), bend, bearing, x])[found])
    lines = lines[np.abs(lines[:, 3]) < MOST_X_M]
    place = lines @ np.vander(PLACES_M, 4).T  # readings of one line are drawn to the same place
    return lines[first_apart(place, np.array(DRAWN_TOGETHER_M), len(lines))]


def refined_lines(points: Points, lines: np.ndarray) -> np.ndarray:
    """Single lines (M, 4), each d, a, b, c, drawn onto the paint points by reweighted least squares, reaching further
    step by step; weakly held where the votes put them, so that a dash alone does not swing a line round."""
    q = points.inverse
    design = np.stack([q**-2, 1 / q, np.ones_like(q), q])
    prior = np.diag(np.array([3e-5, 0.01, 0.1, 1.0]) ** -2.0)
    base = lines @ prior
    scale = 1 / points.std
    weight = points.weight / NEIGHBOURS * scale**2
    for gate, far in STEPS:
        off = (points.bearing - lines @ design) * (scale / gate)
        w = np.square(np.maximum(1 - off * off, 0)) * (weight * (q > 1 / far))
        weighted = w[:, None, :] * design
        normal = weighted @ design.T + prior
        lines = np.linalg.solve(normal, (weighted @ points.bearing + base)[..., None])[..., 0]
    return lines


def first_apart(places: np.ndarray, least_m: np.ndarray, count: int) -> list[int]:
    """Indices of the first ``count`` rows of (K, N) that differ from all chosen before by more than ``least_m`` (N,) in
    a column."""
    found: list[int] = []
    others = np.arange(len(places))
    while len(others) and len(found) < count:
        found.append(others[0])
        others = others[(np.abs(places[others] - places[others[0]]) > least_m).any(axis=1)]
    return found
