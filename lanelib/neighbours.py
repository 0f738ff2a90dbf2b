"""The lanes beside the ego lane: the next painted line to the left and to the right, where there is one.

The ego lane is known, and the lines of a road are parallel. So the road is looked at once more, straightened along the
ego lane (``straighten``): the ego lane's lines are two columns there, and any other line of the road is a third.

A column is the far boundary of a lane when
- it lies a lane's width beyond the ego lane's line, and lanes side by side are of similar width;
- there is paint on enough rows of it: ``MINIMUM_ROWS``, and ``MARGIN`` times as many as other columns have by chance
  (grass, a wall or traffic give some to every column);
- the stripe looks like paint: as wide as one line or two, clearly brighter or yellower than what is beside it, and
  with the same ground on both sides. A kerb, the road's edge, a guard rail or a barrier has another ground behind it.

A strip between two yellow lines is a median or a turning lane, not a lane to change to. Beyond a single yellow line
traffic may be oncoming: ``Neighbour.across`` is the colour of the line in between, for whoever decides. Each frame
speaks for itself; nothing is remembered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanelib.jointfit import CUBIC_OF_SAMPLES, NEIGHBOURS, POWERS, SAMPLES, WIDTH, JointFit, line_x
from lanelib.lane import Limits, Line
from lanelib.rig import View
from lanelib.straighten import FAR_M, Paint, Straightened, paint_of, straightened

MOST_LANES = 2  # on each side: the line beyond those is seen only where it is far away
LEAST_FAR_M = 25.0  # looked at even where the ego lane was seen less far: nearer, a neighbour is hardly in the frame
BOTH_SIDES = ((0, -1), (1, 1))  # place in pairs, and sign across the road
SIMILAR = (0.78, 1.3)  # a lane's width to the ego lane's; shoulders (2.4 m of 3.7) and cycle lanes are narrower
STEP_M = 0.05  # between offsets tried: a third of a line's width
# dx/dy tried. Parallel lines are tilted by d times what the ego lane leaves open of the car's nod, over the camera's
# height: 0.1 degree is 0.008 at 5.5 m; of a fit of both lines half of that
TILTS = np.arange(-3, 4) * 0.004
TILT_STD = 0.004
GATE = 3.0  # standard deviations, as in jointfit.supported_rows
MINIMUM_ROWS = 4.0  # rows of clear paint: less than a dash at 20 m (5 rows), more than one at 40 m (2)
MARGIN = 2.5  # times the rows of chance columns: beside traffic these are up to 4, and three dashes 10
CHANCE = 0.8  # quantile of the columns aside; more than one fifth of them are never paint
ASIDE_M = 0.4  # columns nearer to the candidate are not "aside"
ENOUGH_ROWS = 8.0  # three dashes: a confidence of 0.6
CLEAR = 0.2  # rows with at least this much paint are looked at across
# change of cross slope from lane to lane (AASHTO Green Book: 1.5-2 %, breaking at crowns): what lies lower than the ego
# lane's plane by z appears nearer by z / height, so a neighbour's width is known no better than that
CROWN = 0.01
# width of a stripe from 4-inch paint, thinned by wear, to a line seen from 50 m; double lines, which are yellow, with
# their gap. Guard rails and the foot of walls are 0.4-0.5 m wide
STRIPE_M = {"white": (0.07, 0.35), "yellow": (0.07, 0.55)}
SIDE_M = 0.25  # how much ground on each side of the stripe is looked at
STEP_SHARE = 0.5  # the two grounds differ by at most this share of the stripe's contrast
CONTRAST_SHARE = 0.25  # of the contrast of the ego lane's clearer line: the same paint, driven over more or less
LEAST_CONTRAST = 5.0  # grey levels: more than noise, averaged along the line
YELLOW_SHARE = 0.35  # of a stripe's contrast is yellowness rather than brightness: white 0-0.1, yellow 0.45-1


@dataclass(frozen=True, eq=False)
class Neighbour:
    """A lane beside the ego lane, by its far boundary.

    ``side``: -1 left, +1 right. ``place``: 1 next to the ego lane, 2 the one beyond. ``line``: the far boundary in
    metres, parallel to the ego lane's lines. ``points_px`` (N, 2): the same in pixels of the frame as given, near to
    far, where it is in the picture. ``width_m``: of this lane, and its standard deviation. ``colour`` of the far
    boundary, and of the line ``across`` which the lane lies: "white" or "yellow". ``confidence`` 0..1, given the ego
    lane: 1 - exp(-rows / 8), less the share that chance has.
    """

    side: int
    place: int
    line: Line
    points_px: np.ndarray
    width_m: float
    width_std_m: float
    colour: str
    across: str
    confidence: float

    def to_dict(self) -> dict:
        """What a row of JSON says about it (see docs/ARCHITECTURE.md)."""
        return {
            "side": "left" if self.side < 0 else "right",
            "place": self.place,
            "width_m": round(self.width_m, 3),
            "colour": self.colour,
            "across": self.across,
            "confidence": round(self.confidence, 3),
        }

    def __repr__(self):
        side = "left" if self.side < 0 else "right"
        return f"Neighbour({side}, {self.width_m:.2f} m, {self.colour} beyond {self.across}, {self.confidence:.2f})"


def find_neighbours(frame: np.ndarray, view: View, fit: JointFit, *, lanes: int = 1) -> tuple[Neighbour, ...]:
    """Up to ``lanes`` lanes on each side of the ego lane ``fit``: left ones first, from near to far.

    ``frame``: the one that was fitted, (H, W, 3) uint8 BGR or YUV420p (H * 3 / 2, W) uint8. No boundary is looked for
    beyond an ego line that was not seen itself: where it lies is then only assumed.
    """
    half = fit.mean[WIDTH] / 2
    far = min(max(view.lane(fit).y_range_m[1], LEAST_FAR_M), FAR_M)
    road = straightened(view, fit, reach_m=half + lanes * Limits().width_m[1] + 1.0, far_m=far)
    if len(road.y_m) < 2 * MINIMUM_ROWS:
        return ()
    paint = paint_of(frame, road, view.focal_px)
    support = fit.support[:, -len(road.y_m) :]
    own = [stripe_across(paint, np.full(len(road.y_m), side * half), support[i]) for i, side in BOTH_SIDES]
    contrast = max(LEAST_CONTRAST, CONTRAST_SHARE * max(stripe.contrast for stripe in own))
    found = []
    for i, side in BOTH_SIDES:
        # of a double line the outer one; the fit follows the middle of both
        inner, colour = half + fit.inward_m[i], own[i].colour
        for place in range(1, lanes + 1):
            if fit.support[i].sum() < MINIMUM_ROWS:
                break
            boundary = next_boundary(paint, side, inner, 2 * half, contrast)
            if boundary is None or colour == boundary.colour == "yellow":
                break
            found.append(_neighbour(boundary, side, place, inner, colour, road, fit))
            inner, colour = inner + boundary.offset_m, boundary.colour
    return tuple(found)


# ---------------------------------------------------------------------------------------------- is it a boundary?
@dataclass(frozen=True)
class Boundary:
    """A line of paint: ``offset_m`` beyond the line before it, at the car, with its variance; ``tilt`` dx/dy against
    it; ``far_m`` of its last paint; ``rows`` of paint, and the rows that other columns have by ``chance``."""

    offset_m: float
    variance: float
    tilt: float
    far_m: float
    rows: float
    chance: float
    colour: str


def next_boundary(paint: Paint, side: int, inner_m: float, width_m: float, contrast: float) -> Boundary | None:
    """The next line beyond the one at ``inner_m`` (> 0) to the ``side``, or None.

    ``width_m``: of the ego lane; ``contrast``: the least that counts as paint, grey levels.
    """
    road = paint.road
    paint = paint.beyond(side, inner_m)
    out = side * paint.d_m - inner_m
    (least_m, most_m), (smaller, larger) = Limits().width_m, SIMILAR
    low, high = max(least_m, smaller * width_m), min(most_m, larger * width_m)
    offsets = np.arange(2 * ASIDE_M, road.d_m[-1] - inner_m - 2 * ASIDE_M, STEP_M)
    rows = rows_of_paint(paint, out, offsets)
    likely = np.where((offsets >= low) & (offsets <= high), rows.max(axis=1), 0)
    best = int(np.argmax(likely))
    if likely[best] < MINIMUM_ROWS:
        return None
    (offset, tilt), covariance = refined_line(paint, out, offsets[best], TILTS[np.argmax(rows[best])])
    z = np.square((out - offset - tilt * paint.y_m) / (GATE * paint.std_m))
    support = np.zeros(len(road.y_m))
    np.maximum.at(support, paint.row, paint.weight * np.maximum(1 - z, 0))
    total, chance = support.sum(), np.quantile(rows.max(axis=1)[np.abs(offsets - offset) > ASIDE_M], CHANCE)
    if not low <= offset <= high or total < max(MINIMUM_ROWS, MARGIN * chance):
        return None
    stripe = stripe_across(paint, side * (inner_m + offset + tilt * road.y_m), support)
    thinnest, widest = STRIPE_M[stripe.colour]
    if not thinnest <= stripe.width_m <= widest or stripe.contrast < contrast:
        return None
    if stripe.step > STEP_SHARE * stripe.contrast:
        return None
    far = float(road.y_m[np.flatnonzero(support > CLEAR)[0]])
    variance = float(covariance[0, 0])
    return Boundary(float(offset), variance, float(tilt), far, float(total), float(chance), stripe.colour)


def rows_of_paint(paint: Paint, out_m: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """Rows of paint (offsets, tilts) on each of the lines out = offset + tilt y; ``out_m``: the points' place (N,)."""
    off = out_m - offsets_m[:, None, None] - TILTS[:, None] * paint.y_m
    return np.maximum(1 - np.square(off / (GATE * paint.std_m)), 0) @ paint.weight


def refined_line(paint: Paint, out_m: np.ndarray, offset_m: float, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """Offset and tilt (2,) of a line drawn onto its points by reweighted least squares, and their covariance (2, 2);
    the tilt is held near 0, because lines of a road are parallel."""
    line, start = np.array([offset_m, tilt]), np.array([offset_m, 0.0])
    design = np.stack([np.ones_like(paint.y_m), paint.y_m])
    information = np.diag([1.0, TILT_STD**-2])
    for gate in (6.0, 4.0, 4.0):
        w = np.square(np.maximum(1 - np.square((out_m - line @ design) / (gate * paint.std_m)), 0))
        weighted = design * (w * paint.weight / NEIGHBOURS / paint.std_m**2)
        normal = weighted @ design.T + information
        line = np.linalg.solve(normal, weighted @ out_m + information @ start)
    return line, np.linalg.inv(normal)


@dataclass(frozen=True)
class Stripe:
    """The road across a line, averaged along it: ``width_m`` of the stripe, its ``contrast`` over the brighter ground
    beside it, the ``step`` between the two grounds (grey levels of brightness plus yellowness), and its colour."""

    width_m: float = 0.0
    contrast: float = 0.0
    step: float = 0.0
    colour: str = "white"


ACROSS_STEP_M = 0.025
ACROSS_M = np.arange(-32, 33) * ACROSS_STEP_M  # the widest stripe and the ground on both sides
MIDDLE = slice(24, 41)  # of these samples: within 0.2 m of the line
EDGE = 3  # samples: the blurred edges of the paint are left out


def stripe_across(paint: Paint, d_m: np.ndarray, weight: np.ndarray) -> Stripe:
    """The stripe along ``d_m`` (H,), where there is paint on it: ``weight`` (H,) 0..1 of each row."""
    rows = np.flatnonzero(weight > CLEAR)
    if not len(rows):
        return Stripe()
    at = d_m[rows, None] + ACROSS_M
    bright, yellow = (
        np.average(paint.road.along(channel, at, rows), axis=0, weights=weight[rows])
        for channel in (paint.brightness, paint.yellow)
    )
    both = bright + yellow
    top = MIDDLE.start + int(np.argmax(both[MIDDLE]))
    above = both > (both[top] + np.median(both)) / 2
    left = top - int(np.argmin(above[top::-1])) + 1 if not above[: top + 1].all() else 0
    right = top + int(np.argmin(above[top:])) - 1 if not above[top:].all() else len(both) - 1
    n = round(SIDE_M / ACROSS_STEP_M)
    beyond = np.arange(right + EDGE + 1, right + EDGE + n + 1)
    sides = np.arange(max(left - EDGE - n, 0), max(left - EDGE, 1)), np.minimum(beyond, len(both) - 1)
    ground = [both[s].mean() for s in sides]
    more = [max(c[top] - np.mean([c[s].mean() for s in sides]), 0.0) for c in (yellow, bright)]
    colour = "yellow" if more[0] > YELLOW_SHARE * max(sum(more), 1e-6) else "white"
    return Stripe(ACROSS_STEP_M * (right - left + 1), both[top] - max(ground), abs(ground[0] - ground[1]), colour)


def _neighbour(
    boundary: Boundary, side: int, place: int, inner_m: float, across: str, road: Straightened, fit: JointFit
) -> Neighbour:
    """A boundary as the lane that it ends."""
    width_m, outer_m = boundary.offset_m, inner_m + boundary.offset_m
    mean = fit.mean.copy()
    mean[WIDTH] = 2 * outer_m
    x = line_x(FAR_M * SAMPLES, mean, side)
    points = road.pixels(side * (outer_m + boundary.tilt * road.y_m))
    near = float(road.y_m[-1])
    line = Line((CUBIC_OF_SAMPLES @ x) * FAR_M**-POWERS, (near, boundary.far_m), None, boundary.rows)
    confidence = float((1 - np.exp(-boundary.rows / ENOUGH_ROWS)) * (1 - boundary.chance / boundary.rows))
    std = float(np.hypot(boundary.variance**0.5, outer_m * CROWN * width_m / fit.height_m))
    return Neighbour(side, place, line, points, width_m, std, boundary.colour, across, confidence)
