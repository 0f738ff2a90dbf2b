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
from functools import cached_property

import numpy as np

from lanelib.lane import Lane, Line, Surface

NAMES = ("centre", "heading", "bend", "rate", "width", "pitch", "hill")
CENTRE, HEADING, BEND, RATE, WIDTH, PITCH, HILL = range(7)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed before looking: mean (7,) and covariance (7, 7) in the order of ``NAMES``."""

    mean: np.ndarray
    covariance: np.ndarray

    @cached_property
    def information(self) -> np.ndarray:
        """The inverse of the covariance."""
        return np.linalg.inv(self.covariance)


# A road of which nothing is known. Spread: half a lane of offset; 3.4 degrees of heading; R > 80 m; clothoids
# of motorways (6 D = change of curvature per metre, 2e-4 on a winding road); lanes of 3.3-4 m, narrow
# ones of 2.9; 0.7 degrees of nod; crests of 6 km radius.
UNKNOWN_ROAD = Prior(
    np.array([0, 0, 0, 0, 3.65, 0, 0]),
    np.diag(np.square([0.8, 0.06, 0.006, 3e-5, 0.35, np.deg2rad(0.7), 1 / 6000])),
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

    def some(self, chosen: np.ndarray) -> Points:
        """Only these points, by their indices or a mask."""
        names = ("bearing", "inverse", "row", "weight")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    @cached_property
    def std(self) -> np.ndarray:
        """Standard deviation of each point's bearing: pixels of the frame and ragged paint."""
        metres = (LOCATION_STD_M * self.focal_px) * self.inverse
        return np.sqrt(LOCATION_STD_PX**2 + metres * metres) / self.focal_px


@dataclass(frozen=True, eq=False)
class JointFit:
    """The estimate: ``mean`` (7,), ``covariance`` (7, 7); ``support`` (2, n_rows): per line and grid row the weight
    of the paint on it; ``energy``: support less what the prior objects; ``height_m`` of the camera; ``rms_px``: how far
    the points on the lines are off them, pixels of a frame 1280 wide."""

    mean: np.ndarray
    covariance: np.ndarray
    support: np.ndarray
    energy: float
    height_m: float
    rms_px: float
    # a double line is fitted as one stripe: its inner line lies this much further in
    inward_m: tuple[float, float] = (0.0, 0.0)
    objection: float = 0.0  # of the ground beside the road, where it was asked (``verge``)

    @property
    def worth(self) -> float:
        """The energy less the objection: by it the lanes of one frame are compared."""
        return self.energy - self.objection

    @cached_property
    def rows(self) -> tuple[float, float]:
        """Rows of paint on the left and on the right line: the support added up."""
        left, right = self.support.sum(axis=1).tolist()
        return left, right

    @property
    def width_m(self) -> float:
        """Width of the lane between the inner lines."""
        return float(self.mean[WIDTH]) - sum(self.inward_m)

    @property
    def curvature_1pm(self) -> float:
        """Signed curvature of the centre line at the car, positive to the left."""
        return centre_curvature(self.mean, (0.0,))[0]

    def lane(self, near_m: float, y0_of_row: np.ndarray) -> Lane:
        """The estimate as two lines in metres, seen from ``near_m`` to the farthest row with paint."""
        surface = Surface(self.height_m, float(self.mean[PITCH]), float(self.mean[HILL]))
        mean = self.mean.copy()
        mean[CENTRE] += (self.inward_m[0] - self.inward_m[1]) / 2
        mean[WIDTH] = self.width_m
        reach = farthest_paint(self.support, y0_of_row, self.mean, self.height_m, near_m)
        length = max(*reach, 10.0)
        cubics = line_x(length * SAMPLES, mean, SIDES) @ CUBIC_OF_SAMPLES.T / length**POWERS
        covariances = FIRST_ORDER @ self.covariance @ FIRST_ORDER.transpose(0, 2, 1)
        left, right = map(Line, cubics, ((near_m, far) for far in reach), covariances, self.rows)
        std = np.sqrt(self.covariance.diagonal()).tolist()
        names = {"offset_m": CENTRE, "heading_rad": HEADING, "width_m": WIDTH, "pitch_rad": PITCH}
        spread = {name: std[i] for name, i in names.items()} | {"curvature_1pm": 2 * std[BEND]}
        return Lane(left, right, surface, spread)


def confidence_of(fit: JointFit) -> float:
    """0..1 from how many rows of paint each line has: 1 - exp(-rows / 10), the stronger line counting double
    (it carries the weaker one), times how sharply the points agree."""
    weak, strong = sorted(1 - math.exp(-rows / 10) for rows in fit.rows)
    return (2 * strong + weak) / 3 * math.exp(-((fit.rms_px / 6) ** 2))


SAMPLES = np.linspace(0, 1, 24)  # where a parallel curve is sampled to be written as a cubic ...
CUBIC_OF_SAMPLES = np.linalg.pinv(np.vander(SAMPLES, 4))  # ... by least squares
POWERS = np.arange(3.0, -1, -1)  # of its coefficients
SIDES = np.array([[-1.0], [1.0]])  # left and right, below each other
# What the coefficients of the two lines are in first order, (2, 4, 7): rate, bend, heading, centre + side width / 2
FIRST_ORDER = np.zeros((2, 4, 7))
FIRST_ORDER[:, [0, 1, 2, 3], [RATE, BEND, HEADING, CENTRE]] = 1
FIRST_ORDER[:, 3, WIDTH] = SIDES[:, 0] / 2


def centre_curvature(mean: np.ndarray, y_m) -> list[float]:
    """Signed curvature of a joint fit's centre line at several distances, 1/m, positive to the left."""
    _, heading, bend, rate = mean[: RATE + 1].tolist()
    slopes = [heading + y * (2 * bend + 3 * rate * y) for y in y_m]
    return [-(2 * bend + 6 * rate * y) * (1 + slope * slope) ** -1.5 for y, slope in zip(y_m, slopes, strict=True)]


SOLID = 0.25  # so much weight in a row is clear paint


def farthest_paint(support, y0_of_row, mean, height_m, near_m) -> list[float]:
    """Distance of the farthest row with clear paint on either line (two rows together: a speck does not count)."""
    clear = support > SOLID
    solid = clear[:, :-1] & clear[:, 1:]
    y = distance(1 / y0_of_row[solid.argmax(axis=1)], mean, height_m)
    return np.where(solid.any(axis=1), np.maximum(y, near_m), near_m).tolist()


def line_x(y, mean, side):
    """x of the left (``side`` -1) or right (+1) line at distance ``y`` (metres)."""
    centre, heading, bend, rate, width = mean[: WIDTH + 1]
    slope = heading + y * (2 * bend + 3 * rate * y)
    return centre + y * (heading + y * (bend + rate * y)) + side * (width / 2) * np.sqrt(1 + slope * slope)


def inverse_distance(inverse, mean, height_m):
    """1 / y of a point that appears at 1 / ``inverse`` on the rig's flat plane; y is the real distance.

    The inverse of ``Surface.flat_from_road``: 1 / y - hill y / (2 height) = q, with q = inverse + pitch / height, is
    a quadratic equation in y; of its two roots the nearer, 1 / y = (q + sqrt(q^2 + 2 hill / height)) / 2.
    """
    q = inverse + mean[PITCH] / height_m
    return np.maximum(0.5 * (q + np.sqrt(np.maximum(q * q + 2 * mean[HILL] / height_m, 0.0))), 0.003)


def distance(inverse, mean, height_m):
    """Real distance y of a point that appears at 1 / ``inverse`` on the rig's flat plane."""
    return 1 / inverse_distance(inverse, mean, height_m)


def landmarks(means) -> np.ndarray:
    """By which lanes (..., 7) are told apart: x of left and right line at 6 m and at 20 m, (..., 4)."""
    return line_x(np.array([6.0, 6.0, 20.0, 20.0]), np.moveaxis(means, -1, 0)[..., None], np.array([-1, 1, -1, 1]))


DIFFERENT_M = 0.4, 0.4, 1.0, 1.0  # two lanes are different when one of their landmarks is so far from the other's


def differ(a, b) -> bool:
    """Whether two means (7,) are different lanes: one of their lines differs by 0.4 m at 6 m or by 1 m at 20 m."""
    return bool((np.abs(landmarks(a) - landmarks(b)) > DIFFERENT_M).any())


BESIDE_M = 0.25  # so far beyond a line the car's centre may be before another lane is its own: no flicker on a line


def holds_car(mean, *, beside_m: float = BESIDE_M) -> bool:
    """Whether the car is in this lane (..., 7), or at most ``beside_m`` beyond one of its lines."""
    return abs(mean[..., CENTRE]) <= mean[..., WIDTH] / 2 + beside_m


SEARCH_GATES = (27, 16, 10, 7, 5, 4, 4)  # widths of the biweight in standard deviations, step by step
SEARCH_REACH_M = (35, 45, 60, 85, 120, 140)  # from near to far: a bend shows its sign before its size
TRACK_GATES, TRACK_REACH_M = (8, 4), SEARCH_REACH_M[-1:]  # the lane is known: at once as far as the fit looks
SUPPORT_GATE = 3.0  # standard deviations within which a point speaks for a line
SMALL_STEP = 1.0  # of them


def fit(
    points: Points, start: np.ndarray, *, prior: Prior = UNKNOWN_ROAD, gates=SEARCH_GATES, reach_m=SEARCH_REACH_M
) -> JointFit:
    """Robust Gauss-Newton from ``start`` (7,) under ``prior``; always returns an estimate, ``energy`` says what it
    is worth."""
    return fits(points, [start], prior=prior, gates=gates, reach_m=reach_m)[0]


def fits(
    points: Points, starts, *, prior: Prior = UNKNOWN_ROAD, gates=SEARCH_GATES, reach_m=SEARCH_REACH_M
) -> list[JointFit]:
    """``fit`` from each of several ``starts`` (M, 7), all at once, with a third of the calls into numpy."""
    if len(starts) == 0:
        return []
    mean = np.array(starts, float)
    rate_variance = prior.covariance[RATE, RATE]
    information = np.tile(prior.information, (len(mean), 1, 1))
    others = prior.information[RATE, RATE] - 1 / rate_variance  # what the prior of the other numbers says of the rate
    scale, weight = 1 / points.std, points.weight / NEIGHBOURS
    jacobian = np.empty((len(mean), 8, len(points)))  # seven derivatives, and below them the residuals
    for step, gate in enumerate(gates):
        information[:, RATE, RATE] = others + 1 / np.minimum(rate_variance, np.square(rate_std(mean)))
        if step < len(reach_m):
            reached = weight * (points.inverse > 1 / reach_m[step])
        powers, middle, slope, twice_bend = seen_lane(points, mean)
        stretch = slope * slope
        stretch += 1
        root = np.sqrt(stretch)
        off = points.bearing - middle
        half_m = np.copysign(mean[:, WIDTH, None] / 2, off)  # each point belongs to the nearer line: half the width
        half = half_m * root
        half *= powers[:, 0]
        z = off - half
        z *= scale
        w = np.square(z / gate)
        w = np.maximum(np.subtract(1, w, out=w), 0.0, out=w)
        w *= w
        w *= reached
        w *= stretch < 2
        # du/dparameter, with x = centre line + lean
        lean = half_m * slope
        lean /= root
        y = powers[:, 2]
        np.multiply(powers[:, :3] * ORDER, lean[:, None], out=jacobian[:, 1:4])
        jacobian[:, 1:4] += powers[:, 1:]
        jacobian[:, 0] = powers[:, 0]
        np.divide(half, mean[:, WIDTH, None], out=jacobian[:, WIDTH])
        # du/dy dy/dpitch, dy/dpitch = -y^2 / height
        per_pitch = (middle + half - slope - lean * twice_bend) * y
        np.divide(per_pitch, points.height_m, out=jacobian[:, PITCH])
        np.multiply(jacobian[:, PITCH], y / 2, out=jacobian[:, HILL])
        jacobian[:, :7] *= scale
        jacobian[:, 7] = z
        equations = (jacobian[:, :7] * w[:, None]) @ jacobian.transpose(0, 2, 1)
        normal = equations[..., :7] + information
        towards = equations[..., 7:] + information @ (prior.mean - mean)[..., None]
        change = np.linalg.solve(normal, towards)
        mean += change[..., 0]
        np.minimum(np.maximum(mean, LEAST, out=mean), MOST, out=mean)
    moved = (change.transpose(0, 2, 1) @ jacobian[:, :7])[:, 0]
    found = []
    for i, covariance in enumerate(np.linalg.inv(normal)):
        # after a small last step the distances follow from the derivatives
        small = np.abs(moved[i]).max(initial=0.0) < SMALL_STEP
        support, rms = support_of(points, half_m[i] > 0, z[i] - moved[i]) if small else supported_rows(points, mean[i])
        energy = energy_of(mean[i], support, prior)
        found.append(JointFit(mean[i], covariance, support, energy, points.height_m, rms))
    return found


# Beyond these no road goes; they keep a wild start from running away
LEAST = np.array([-np.inf, -np.inf, -np.inf, -2e-4, 2.0, -np.inf, -np.inf])
MOST = np.array([np.inf, np.inf, np.inf, 2e-4, 6.0, np.inf, np.inf])
ORDER = np.array([[1.0], [2.0], [3.0]])  # y^n is n y^(n - 1) steep


def seen_lane(points: Points, means: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lanes (M, 7) at the distance y of each point: the powers (M, 4, N) 1 / y, 1, y, y^2; of the centre line,
    (M, N) each, its bearing, its slope, and its second derivative."""
    powers = np.ones((len(means), 4, len(points)))
    powers[:, 0] = inverse_distance(points.inverse, means.T[..., None], points.height_m)
    np.divide(1, powers[:, 0], out=powers[:, 2])
    np.multiply(powers[:, 2], powers[:, 2], out=powers[:, 3])
    line = (means[:, : RATE + 1] @ DERIVATIVES).reshape(-1, 3, 4) @ powers
    return powers, line[:, 0], line[:, 1], line[:, 2]


# Centre, heading, bend and rate (rows) to the factors of the powers in bearing, slope and second derivative
DERIVATIVES: np.ndarray = np.zeros((4, 3, 4))
DERIVATIVES[range(4), 0, range(4)] = 1
DERIVATIVES[[HEADING, BEND, RATE], 1, [1, 2, 3]] = 1, 2, 3
DERIVATIVES[[BEND, RATE], 2, [1, 2]] = 2, 6
DERIVATIVES = DERIVATIVES.reshape(4, 12)


def outward(points: Points, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each point lies from the lane's centre line, and outside of the nearer line, as bearings (N,)."""
    powers, middle, slope, _ = (of_all[0] for of_all in seen_lane(points, mean[None]))
    off = points.bearing - middle
    return off, np.abs(off) - (mean[WIDTH] / 2) * np.sqrt(1 + slope * slope) * powers[0]


def rate_std(mean: np.ndarray) -> np.ndarray:
    """How fast the curvature of a road like this (..., 7) may change: standard deviation of ``rate``, 1/m^2.

    Roads are laid out so that a driver feels neither more than about 2 m/s^2 of lateral acceleration nor more than 1
    m/s^3 of jerk (AASHTO Green Book, ch. 3, spiral curves). With curvature k that speed is v = sqrt(2 / k), so the
    curvature changes by at most 1 / v^3 = (k / 2)^(3/2) a metre: 1e-5 on a bend of R 1 km, 8e-4 at R 60 m. One
    standard deviation is a third of it, and rate a sixth.
    """
    bend = mean[..., BEND]
    sharpest = 2 * np.maximum(abs(bend), abs(bend + 90 * mean[..., RATE]))  # at the car and 30 m ahead
    return 3e-7 + sharpest**1.5 / 2**1.5 / 18


def paint_value(rows):
    """What ``rows`` of paint on a line are worth: the first say more than the last, but all say something."""
    return ENOUGH_ROWS * (1 - np.exp(-2 * rows / ENOUGH_ROWS)) + rows / 50


def energy_of(mean: np.ndarray, support: np.ndarray, prior: Prior) -> float:
    """What a lane is worth: the paint on both lines, less what ``prior`` objects (half the squared Mahalanobis
    distance).

    Counted line by line, so that a lane with some paint on both lines beats one with all of it on one.
    """
    difference = mean - prior.mean
    objection = 0.5 * difference @ prior.information @ difference
    return float(paint_value(support.sum(axis=1)).sum() - objection)


def supported_rows(points: Points, mean: np.ndarray) -> tuple[np.ndarray, float]:
    """``support_of`` the lane ``mean`` (7,)."""
    off, error = outward(points, mean)
    return support_of(points, off > 0, error / points.std)


def support_of(points: Points, right: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, float]:
    """Per line and grid row the weight of the best paint point on it (2, n_rows); weighted rms in px. ``right`` (N,):
    which points belong to the right line; ``z`` (N,): how far they are from it, in standard deviations."""
    share = np.square(z / SUPPORT_GATE)
    on = np.flatnonzero(share < 1)
    weight, share = points.weight[on], share[on]
    support = np.zeros(2 * points.n_rows)
    np.maximum.at(support, points.row[on] + points.n_rows * right[on], weight * (1 - share))
    error = z[on] * points.std[on]
    rms = points.focal_px * math.sqrt(float(weight @ np.square(error)) / max(float(weight.sum()), 1e-9))
    return support.reshape(2, -1), rms
