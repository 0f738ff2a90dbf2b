"""One lane, not two lines: both boundaries, and the surface under them, estimated together.

The two lines of a lane share its heading and its curvature and are a lane width apart, so a strong line carries a
weak one, a dash carries the gap, and a seam cannot pull one side. Seven numbers describe the lane and how the road
departs from the rig's flat plane:

    centre    x of the lane's centre at the car, m          heading   dx/dy of the lane at the car
    bend      A in x = ... + A y^2, 1/m                     rate      D in x = ... + D y^3, 1/m^2
    width     of the lane, m                                pitch     extra pitch of the camera, rad
    hill      vertical curvature of the road, 1/m

    centre line  xc(y) = centre + heading y + bend y^2 + rate y^3
    lines        x(y)  = xc(y) -+ width / 2 * sqrt(1 + xc'(y)^2)       (parallel curves: the width is measured across)

What is measured is the bearing U = x / y at which a paint point is seen, because its error, one or two pixels, is the
same near and far. On the rig's flat plane the point appears at y0 = 1 / q0; the real distance y follows from q0, pitch
and hill (``distance``).

``fit`` is an iteratively reweighted Gauss-Newton on all seven numbers with a prior, from a starting point: one of
``hypotheses.hypotheses``, or the last frame's lane. With the last lane as prior it is the measurement update of an
iterated extended Kalman filter (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
sec. 10.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lanelib.lane import Lane, Line, Surface

NAMES = ("centre", "heading", "bend", "rate", "width", "pitch", "hill")
CENTRE, HEADING, BEND, RATE, WIDTH, PITCH, HILL = range(7)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed before looking: mean (7,) and covariance (7, 7) in the order of ``NAMES``."""

    mean: np.ndarray
    covariance: np.ndarray


# A road of which nothing is known. Spread: half a lane of offset; 3.4 degrees of heading; R > 80 m; clothoids
# of motorways (6 D = change of curvature per metre, 2e-4 on a winding road); lanes of 3.3-4 m; 0.7 degrees of nod;
# crests of 6 km radius.
UNKNOWN_ROAD = Prior(
    np.array([0, 0, 0, 0, 3.65, 0, 0]),
    np.diag(np.square([0.8, 0.06, 0.006, 3e-5, 0.25, np.deg2rad(0.7), 1 / 6000])),
)

LOCATION_STD_PX = 1.0  # how well a crest is located in the frame ...
LOCATION_STD_M = 0.03  # ... and on the road: paint has ragged edges, the line in it is a convention
ENOUGH_ROWS = 34.0  # so many rows of paint settle a line; more add little
# crests along one line share their error (wear, a kink in the paint): so many count as one measurement
NEIGHBOURS = 7.0


@dataclass(frozen=True, eq=False)
class Points:
    """Paint points as the fit sees them. ``bearing`` U = x / y and ``inverse`` q0 = 1 / y0 on the rig's flat plane;
    ``row`` of the grid, ``weight`` 0..1; ``focal_px`` turns bearings into pixels, ``height_m`` is the camera's;
    ``n_rows`` of the grid."""

    bearing: np.ndarray
    inverse: np.ndarray
    row: np.ndarray
    weight: np.ndarray
    focal_px: float
    height_m: float
    n_rows: int

    def __len__(self):
        return len(self.row)


@dataclass(frozen=True, eq=False)
class JointFit:
    """The estimate: ``mean`` (7,), ``covariance`` (7, 7); ``support`` (2, n_rows): per line and grid row the weight
    of the paint on it; ``energy``: support less what the prior objects."""

    mean: np.ndarray
    covariance: np.ndarray
    support: np.ndarray
    energy: float
    height_m: float
    rms_px: float
    # a double line is fitted as one stripe: its inner line lies this much further in
    inward_m: tuple[float, float] = (0.0, 0.0)

    def lane(self, near_m: float, y0_of_row: np.ndarray) -> Lane:
        """The estimate as two lines in metres, seen from ``near_m`` to the farthest row with paint."""
        surface = Surface(self.height_m, float(self.mean[PITCH]), float(self.mean[HILL]))
        mean = self.mean.copy()
        mean[CENTRE] += (self.inward_m[0] - self.inward_m[1]) / 2
        mean[WIDTH] -= sum(self.inward_m)
        reach = [farthest_paint(s, y0_of_row, self.mean, self.height_m, near_m) for s in self.support]
        length = max(*reach, 10.0)
        scale = length ** -np.arange(3.0, -0.5, -1)
        lines = []
        for i, side in enumerate((-1, 1)):
            coefficients = (CUBIC_OF_SAMPLES @ line_x(length * SAMPLES, mean, side)) * scale
            # the line's own first-order error: x = centre + heading y + bend y^2 + rate y^3 + side width / 2
            take = np.zeros((4, 7))
            take[[3, 2, 1, 0], [CENTRE, HEADING, BEND, RATE]] = 1
            take[3, WIDTH] = side / 2
            covariance = take @ self.covariance @ take.T
            lines.append(Line(coefficients, (near_m, reach[i]), covariance, float(self.support[i].sum())))
        std = np.sqrt(np.diag(self.covariance)).tolist()
        names = {"offset_m": CENTRE, "heading_rad": HEADING, "width_m": WIDTH, "pitch_rad": PITCH}
        spread = {name: std[i] for name, i in names.items()} | {"curvature_1pm": 2 * std[BEND]}
        return Lane(lines[0], lines[1], surface, spread)


SAMPLES = np.linspace(0, 1, 24)  # where a parallel curve is sampled to be written as a cubic ...
CUBIC_OF_SAMPLES = np.linalg.pinv(np.vander(SAMPLES, 4))  # ... by least squares


def farthest_paint(support, y0_of_row, mean, height_m, near_m) -> float:
    """Distance of the farthest row with clear paint on a line (two rows together: a speck does not count)."""
    solid = np.flatnonzero((support[:-1] > 0.25) & (support[1:] > 0.25))
    return max(near_m, float(distance(1 / y0_of_row[solid[0]], mean, height_m))) if len(solid) else near_m


def line_x(y, mean, side):
    """x of the left (``side`` -1) or right (+1) line at distance ``y`` (metres)."""
    slope = mean[HEADING] + y * (2 * mean[BEND] + 3 * y * mean[RATE])
    centre = mean[CENTRE] + y * (mean[HEADING] + y * (mean[BEND] + y * mean[RATE]))
    return centre + side * mean[WIDTH] / 2 * np.sqrt(1 + slope * slope)


def distance(inverse, mean, height_m):
    """Real distance y of a point that appears at 1 / ``inverse`` on the rig's flat plane.

    The inverse of ``Surface.flat_from_road``: 1 / y - hill y / (2 height) = q, with q = inverse + pitch / height, is
    a quadratic equation in y; of its two roots the nearer, y = 2 / (q + sqrt(q^2 + 2 hill / height)).
    """
    q = inverse + mean[PITCH] / height_m
    return 2 / np.maximum(q + np.sqrt(np.maximum(q * q + 2 * mean[HILL] / height_m, 0)), 0.006)


def bearing_std(points: Points) -> np.ndarray:
    """Standard deviation of each point's bearing: pixels of the frame and ragged paint."""
    return np.sqrt(LOCATION_STD_PX**2 + (LOCATION_STD_M * points.focal_px * points.inverse) ** 2) / points.focal_px


def differ(a, b) -> bool:
    """Two lanes are different when one of their lines differs by 0.4 m at 6 m or by 1 m at 20 m."""
    return any(abs(line_x(y, a, s) - line_x(y, b, s)) > far for s in (-1, 1) for y, far in ((6.0, 0.4), (20.0, 1.0)))


SEARCH_GATES = (27, 16, 10, 7, 5, 4, 4)  # widths of the biweight in standard deviations, step by step
SEARCH_REACH_M = (35, 45, 60, 85, 120, 140)  # from near to far: a bend shows its sign before its size
TRACK_GATES = (9, 5, 4)


def fit(
    points: Points, start: np.ndarray, *, prior: Prior = UNKNOWN_ROAD, gates=SEARCH_GATES, reach_m=SEARCH_REACH_M
) -> JointFit:
    """Robust Gauss-Newton from ``start`` (7,) under ``prior``; always returns an estimate, ``energy`` says what it
    is worth."""
    information = np.linalg.inv(prior.covariance)
    rate_variance = prior.covariance[RATE, RATE]
    rate_information = information[RATE, RATE] - 1 / rate_variance
    mean = np.array(start, float)
    q0, height = points.inverse, points.height_m
    sigma = bearing_std(points)
    weight, scale = points.weight / NEIGHBOURS, 1 / sigma
    jacobian = np.empty((7, len(points)))
    normal = information
    for step, gate in enumerate(gates):
        information[RATE, RATE] = rate_information + 1 / min(rate_variance, rate_std(mean) ** 2)
        y, slope, middle, half = seen_lane(points, mean)
        off = points.bearing - middle
        side = np.where(off > 0, 1.0, -1.0)  # each point belongs to the nearer line
        z = (off - side * half) * scale
        w = weight * np.square(np.maximum(1 - np.square(z / gate), 0))
        w *= (q0 > 1 / reach_m[min(step, len(reach_m) - 1)]) & (np.abs(slope) < 1)
        # du/dparameter, with x = centre line + lean: (7, N)
        lean = side * (mean[WIDTH] / 2) * slope / np.sqrt(1 + slope * slope)
        jacobian[CENTRE] = 1 / y
        jacobian[HEADING] = 1 + lean / y
        jacobian[BEND] = y + 2 * lean
        jacobian[RATE] = (y + 3 * lean) * y
        jacobian[WIDTH] = side * half / mean[WIDTH]
        x_slope = slope + lean * (2 * mean[BEND] + 6 * y * mean[RATE])
        jacobian[PITCH] = (middle + side * half - x_slope) * y / height  # du/dy dy/dpitch, dy/dpitch = -y^2 / height
        jacobian[HILL] = jacobian[PITCH] * y / 2
        jacobian *= scale
        weighted = jacobian * w
        normal = weighted @ jacobian.T + information
        mean += np.linalg.solve(normal, weighted @ z + information @ (prior.mean - mean))
        mean[RATE] = min(max(mean[RATE], -2e-4), 2e-4)
        mean[WIDTH] = min(max(mean[WIDTH], 2.0), 6.0)
    support, rms = supported_rows(points, mean)
    return JointFit(mean, np.linalg.inv(normal), support, energy_of(mean, support, prior), height, rms)


def seen_lane(points: Points, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """At the distance of each point, (N,) each: y in m, slope of the centre line, bearing of the centre line and half
    the bearing between the two lines."""
    y = distance(points.inverse, mean, points.height_m)
    slope = mean[HEADING] + y * (2 * mean[BEND] + 3 * y * mean[RATE])
    middle = mean[CENTRE] / y + mean[HEADING] + y * (mean[BEND] + y * mean[RATE])
    return y, slope, middle, (mean[WIDTH] / 2) * np.sqrt(1 + slope * slope) / y


def rate_std(mean: np.ndarray) -> float:
    """How fast the curvature of a road like this may change: standard deviation of ``rate``, 1/m^2.

    Roads are laid out so that a driver feels neither more than about 2 m/s^2 of lateral acceleration nor more than 1
    m/s^3 of jerk (AASHTO Green Book, ch. 3, spiral curves). With curvature k that speed is v = sqrt(2 / k), so the
    curvature changes by at most 1 / v^3 = (k / 2)^(3/2) a metre: 1e-5 on a bend of R 1 km, 8e-4 at R 60 m. One
    standard deviation is a third of it, and rate a sixth.
    """
    sharpest = max(abs(mean[BEND]), abs(mean[BEND] + 90 * mean[RATE])) * 2  # at the car and 30 m ahead
    return 3e-7 + sharpest**1.5 / 2**1.5 / 18


def nearby(points: Points, mean: np.ndarray, *, gate: float) -> Points:
    """The points within ``gate`` standard deviations of either line of ``mean``: all that tracking needs."""
    _, _, middle, half = seen_lane(points, mean)
    near = np.flatnonzero(np.abs(np.abs(points.bearing - middle) - half) < gate * bearing_std(points))
    chosen = (array[near] for array in (points.bearing, points.inverse, points.row, points.weight))
    return replace(points, **dict(zip(("bearing", "inverse", "row", "weight"), chosen, strict=True)))


def paint_value(rows):
    """What ``rows`` of paint on a line are worth: the first say more than the last."""
    return ENOUGH_ROWS * (1 - np.exp(-2 * rows / ENOUGH_ROWS))


def energy_of(mean: np.ndarray, support: np.ndarray, prior: Prior) -> float:
    """What a lane is worth: the paint on both lines, less what ``prior`` objects (half the squared Mahalanobis
    distance).

    Counted line by line, so that a lane with some paint on both lines beats one with all of it on one.
    """
    difference = mean - prior.mean
    objection = 0.5 * difference @ np.linalg.solve(prior.covariance, difference)
    return float(paint_value(support.sum(axis=1)).sum() - objection)


def supported_rows(points: Points, mean: np.ndarray, *, gate: float = 3.0) -> tuple[np.ndarray, float]:
    """Per line and grid row the weight of the best paint point within ``gate`` standard deviations (2, n_rows);
    weighted rms in px."""
    _, _, middle, half = seen_lane(points, mean)
    off = points.bearing - middle
    error = np.abs(off) - half  # outward
    z = np.square(error / (gate * bearing_std(points)))
    on = np.flatnonzero(z < 1)
    weight = points.weight[on]
    support = np.zeros(2 * points.n_rows)
    np.maximum.at(support, points.row[on] + points.n_rows * (off[on] > 0), weight * (1 - z[on]))
    rms = points.focal_px * math.sqrt(float(weight @ np.square(error[on])) / max(float(weight.sum()), 1e-9))
    return support.reshape(2, -1), rms
