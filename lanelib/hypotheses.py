"""Where could a lane be? Starting points for the joint fit when nothing is known.

For each of the strongest single lines (``hough``) a partner is looked for, parallel to it, over all lane widths and
pitches; the most promising pairs with the car between them are where the fit begins.
"""

from __future__ import annotations

import numpy as np

from lanelib.hough import FARTHEST_M, first_apart, single_lines
from lanelib.jointfit import (
    CENTRE,
    HEADING,
    PITCH,
    UNKNOWN_ROAD,
    WIDTH,
    Points,
    Prior,
    holds_car,
    landmarks,
    paint_value,
)

PARTNERS = 4  # a dash of our lane, of the next one, a speck: with few points the best of them is not always ours
WIDTHS_PITCHES = np.array([(w, np.deg2rad(p)) for w in np.arange(2.6, 4.65, 0.15) for p in np.arange(-2.4, 2.41, 0.3)])
# which of them would lead to the same fit: within 0.5 m of width, or 0.7 degrees of pitch, or a part of each
ALIKE = np.abs(WIDTHS_PITCHES[:, None] - WIDTHS_PITCHES) @ (1, 40) <= 0.5
# starts whose landmarks (and pitches) are nearer than that lead to the same fit, as a rule
APART_M, APART_PITCH = np.array([0.25, 0.25, 0.6, 0.6]), np.deg2rad(0.3)
HOPELESS = 15.0  # starts estimated to be worth so much less than the best one do not win


def rows_beside(points: Points, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of paint on each of ``lines`` (M, 4), and on its partner for every one of `WIDTHS_PITCHES`: (M,), (M, P).

    The partner of a line is seen at U - U_line = -side width (q + pitch / height) sqrt(1 + slope^2).
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
    return own, other


def partners(points: Points, lines: np.ndarray, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
    """Lanes with one of ``lines`` (M, 4) as boundary: where is more paint, parallel to it? Energies (K,) and means
    (K, 7) of the best ones of each line and of lanes of the usual width with no paint on their other side.
    """
    d, a, b, c = lines.T
    side = np.where(c > 0, 1.0, -1.0)
    width, pitch = WIDTHS_PITCHES.T
    own, other = rows_beside(points, lines)
    centre = c[:, None] - side[:, None] * width / 2
    heading = b[:, None] - c[:, None] * pitch / points.height_m
    energy = paint_value(own)[:, None] + paint_value(other)
    for value, i in ((width, WIDTH), (pitch, PITCH), (centre, CENTRE), (heading, HEADING)):
        energy -= 0.5 * np.square(value - prior.mean[i]) / prior.covariance[i, i]
    each = np.arange(len(lines))
    # first of all the line alone
    found = [(paint_value(own), np.full(len(lines), prior.mean[WIDTH]), np.full(len(lines), prior.mean[PITCH]))]
    for _ in range(PARTNERS):
        best = energy.argmax(axis=1)
        found.append((energy[each, best], width[best], pitch[best]))
        for i, lane in enumerate(best):
            energy[i, ALIKE[lane]] = -np.inf
    energy, width, pitch = np.hstack(found)
    a, b, c, d, side = (np.tile(of_line, len(found)) for of_line in (a, b, c, d, side))
    centre, heading = c - side * width / 2, b - c * pitch / points.height_m
    return energy, np.column_stack([centre, heading, a, d, width, pitch, np.zeros_like(c)])


def hypotheses(
    points: Points,
    *,
    prior: Prior = UNKNOWN_ROAD,
    count: int = 3,
    least_energy: float = -np.inf,
    known: np.ndarray | None = None,
) -> list[np.ndarray]:
    """The ``count`` most promising different lanes around the car, as means (7,), best first; only those estimated to
    have at least ``least_energy``, and none that would lead to the lane that is ``known`` (7,)."""
    if len(points) < 4:
        return []
    energy, means = partners(points, single_lines(points, prior=prior), prior)
    order = np.argsort(-energy, kind="stable")
    means = means[order[energy[order] >= max(least_energy, energy.max(initial=-np.inf) - HOPELESS)]]
    means = means[holds_car(means)]
    if known is not None and len(means):
        another = (np.abs(landmarks(means) - landmarks(known)) > APART_M).any(axis=1)
        means = means[another | (np.abs(means[:, PITCH] - known[PITCH]) > APART_PITCH)]
    return [*means[first_apart(landmarks(means), APART_M, count)]]
