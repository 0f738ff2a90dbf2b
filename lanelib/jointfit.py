"""One lane, not two lines: both boundaries, and the surface under them, estimated together.

The two lines of a lane share its heading and its curvature and are a lane width apart, so a strong line carries a
weak one, a dash
carries the gap, and a seam cannot pull one side. Seven numbers describe the lane and how the road departs from the
rig's flat plane:

    centre    x of the lane's centre at the car, m          heading   dx/dy of the lane at the car
    bend      A in x = ... + A y^2, 1/m                     rate      D in x = ... + D y^3, 1/m^2
    width     of the lane, m                                pitch     extra pitch of the camera, rad
    hill      vertical curvature of the road, 1/m

    centre line  xc(y) = centre + heading y + bend y^2 + rate y^3
    lines        x(y)  = xc(y) -+ width / 2 * sqrt(1 + xc'(y)^2)         (parallel curves: the width is measured
    across)

What is measured is the bearing U = x / y at which a paint point is seen, because its error, one or two pixels, is
the same near and far. On the
rig's flat plane the point appears at y0 = 1 / q0; the real distance is y = 1 / q with q = q0 + (pitch + hill y /
2) / height.

1. ``hypotheses``: a Hough transform over (bearing at infinity, bend, x at the car) for single lines; for each of
the strongest a partner,
   parallel to it, over all widths and pitches.
2. ``fit``: iteratively reweighted Gauss-Newton on all seven numbers with a prior, from one hypothesis or from the
last frame's lane.
   With the last lane as prior this is the measurement update of an iterated extended Kalman filter
   (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, sec. 10.5).
"""

from __future__ import annotations

from dataclasses import dataclass

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
ENOUGH_ROWS = 40.0  # so many rows of paint settle a line; more add little
# crests along one line share their error (wear, a kink in the paint): so many count as one measurement
NEIGHBOURS = 8.0


@dataclass(frozen=True, eq=False)
class Points:
    """Paint points as the fit sees them. ``bearing`` U = x / y and ``inverse`` q0 = 1 / y0 on the rig's flat
    plane; ``row`` of
    the grid, ``weight`` 0..1; ``focal_px`` turns bearings into pixels, ``height_m`` is the camera's; ``n_rows`` of
    the grid."""

    bearing: np.ndarray
    inverse: np.ndarray
    row: np.ndarray
    weight: np.ndarray
    focal_px: float
    height_m: float
    n_rows: int
    yellow: np.ndarray | None = None

    def __len__(self):
        return len(self.row)


@dataclass(frozen=True, eq=False)
class JointFit:
    """The estimate: ``mean`` (7,), ``covariance`` (7, 7); ``support`` (2, n_rows): per line and grid row the
    weight of the paint on it;
    ``energy``: support less what the prior objects."""

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
        lines = []
        joint_far = max(visible_range(s, y0_of_row, self.mean, self.height_m, near_m)[1] for s in self.support)
        for side, support in zip((-1, 1), self.support, strict=True):
            seen = visible_range(support, y0_of_row, self.mean, self.height_m, near_m)
            y = np.linspace(0, max(joint_far, 10.0), 24)
            x = line_x(y, mean, side)
            coefficients = np.polyfit(y, x, 3)
            # the line's own first-order error: x = centre + heading y + bend y^2 + rate y^3 + side width / 2
            take = np.zeros((4, 7))
            take[3, CENTRE], take[2, HEADING], take[1, BEND], take[0, RATE], take[3, WIDTH] = 1, 1, 1, 1, side / 2
            lines.append(Line(coefficients, seen, take @ self.covariance @ take.T, float(support.sum())))
        std = np.sqrt(np.diag(self.covariance))
        return Lane(
            lines[0],
            lines[1],
            surface,
            {
                "offset_m": float(std[CENTRE]),
                "heading_rad": float(std[HEADING]),
                "curvature_1pm": float(2 * std[BEND]),
                "width_m": float(std[WIDTH]),
                "pitch_rad": float(std[PITCH]),
            },
        )


def visible_range(support, y0_of_row, mean, height_m, near_m) -> tuple[float, float]:
    """From ``near_m`` to the distance of the farthest row with clear paint (two rows together, so that a speck
    does not count)."""
    solid = np.flatnonzero((support[:-1] > 0.25) & (support[1:] > 0.25))
    if len(solid) == 0:
        return near_m, near_m
    return near_m, max(near_m, float(distance(1 / y0_of_row[solid[0]], mean, height_m)))


def line_x(y, mean, side):
    """x of the left (``side`` -1) or right (+1) line at distance ``y`` (metres)."""
    slope = mean[HEADING] + y * (2 * mean[BEND] + 3 * y * mean[RATE])
    centre = mean[CENTRE] + y * (mean[HEADING] + y * (mean[BEND] + y * mean[RATE]))
    return centre + side * mean[WIDTH] / 2 * np.sqrt(1 + slope * slope)


def distance(inverse, mean, height_m):
    """Real distance y of a point that appears at 1 / ``inverse`` on the rig's flat plane."""
    q = np.maximum(inverse + mean[PITCH] / height_m, 0.004)
    return 1 / np.maximum(q + mean[HILL] / (2 * height_m) / q, 0.003)


def bearing_std(points: Points) -> np.ndarray:
    """Standard deviation of each point's bearing: pixels of the frame and ragged paint."""
    return np.sqrt(LOCATION_STD_PX**2 + (LOCATION_STD_M * points.focal_px * points.inverse) ** 2) / points.focal_px


def differ(a, b) -> bool:
    """Two lanes are different when one of their lines differs by 0.4 m at 6 m or by 1 m at 20 m."""
    return any(abs(line_x(y, a, s) - line_x(y, b, s)) > far for s in (-1, 1) for y, far in ((6.0, 0.4), (20.0, 1.0)))


SEARCH_GATES = (27, 27, 16, 10, 8, 6, 5, 4, 4, 4)  # widths of the biweight in standard deviations, step by step
SEARCH_REACH_M = (35, 35, 45, 60, 80, 110, 140)  # from near to far: a bend shows its sign before its size
TRACK_GATES = (9, 6, 4, 4)


def fit(
    points: Points, start: np.ndarray, *, prior: Prior = UNKNOWN_ROAD, gates=SEARCH_GATES, reach_m=SEARCH_REACH_M
) -> JointFit:
    """Robust Gauss-Newton from ``start`` (7,) under ``prior``; always returns an estimate, ``energy`` says what it
    is worth."""
    information = np.linalg.inv(prior.covariance)
    mean = np.asarray(start, float).copy()
    q0, bearing, weight = points.inverse, points.bearing, points.weight / NEIGHBOURS
    height = points.height_m
    sigma = bearing_std(points)
    sides = np.array([-1.0, 1.0])[:, None]
    normal = information
    for step, gate in enumerate(gates):
        far = reach_m[min(step, len(reach_m) - 1)]
        q = np.maximum(q0 + mean[PITCH] / height, 0.004)
        y = 1 / np.maximum(q + mean[HILL] / (2 * height) / q, 0.003)
        slope = mean[HEADING] + y * (2 * mean[BEND] + 3 * y * mean[RATE])
        stretch = np.sqrt(1 + slope * slope)
        centre = mean[CENTRE] + y * (mean[HEADING] + y * (mean[BEND] + y * mean[RATE]))
        u = (centre + sides * (mean[WIDTH] / 2) * stretch) / y  # (2, N)
        z = (bearing - u) / sigma
        w = weight * np.square(np.maximum(1 - np.square(z / gate), 0))
        w[:, (q0 < 1 / far) | (np.abs(slope) > 1.0)] = 0
        used = np.flatnonzero(w.any(axis=0))
        w, z, yy, ss, ph, sg = w[:, used], z[:, used], y[used], slope[used], stretch[used], sigma[used]
        # du/dparameter for both sides: (2, 7, M)
        lean = sides * (mean[WIDTH] / 2) * ss / ph  # d(offset along x) / d slope
        jacobian = np.empty((2, 7, len(used)))
        jacobian[:, CENTRE] = 1 / yy
        jacobian[:, HEADING] = 1 + lean / yy
        jacobian[:, BEND] = yy + 2 * lean
        jacobian[:, RATE] = yy * yy + 3 * lean * yy
        jacobian[:, WIDTH] = sides * ph / (2 * yy)
        x_slope = ss + lean * (2 * mean[BEND] + 6 * yy * mean[RATE])
        du_dy = (x_slope - u[:, used]) / yy
        jacobian[:, PITCH] = du_dy * -(yy * yy) / height
        jacobian[:, HILL] = du_dy * -(yy**3) / (2 * height)
        jacobian /= sg
        weighted = jacobian * w[:, None, :]
        normal = np.einsum("sim,sjm->ij", weighted, jacobian) + information
        gradient = np.einsum("sim,sm->i", weighted, z) + information @ (prior.mean - mean)
        mean = mean + np.linalg.solve(normal, gradient)
        mean[RATE] = min(max(mean[RATE], -2e-4), 2e-4)
        mean[WIDTH] = min(max(mean[WIDTH], 2.0), 6.0)
    covariance = np.linalg.inv(normal)
    support, rms = supported_rows(points, mean)
    energy = energy_of(mean, support, prior)
    return JointFit(mean, covariance, support, energy, height, rms)


def energy_of(mean: np.ndarray, support: np.ndarray, prior: Prior) -> float:
    """What a lane is worth: the paint on its lines, less what ``prior`` objects (half the squared Mahalanobis
    distance).

    The first rows of paint on a line say more than the last: ENOUGH (1 - exp(-2 rows / ENOUGH)) per line, so that
    a lane with
    some paint on both lines is worth more than one with all of it on one.
    """
    difference = mean - prior.mean
    paint = ENOUGH_ROWS * (1 - np.exp(-2 * support.sum(axis=1) / ENOUGH_ROWS))
    return float(paint.sum() - 0.5 * difference @ np.linalg.solve(prior.covariance, difference))


def supported_rows(points: Points, mean: np.ndarray, *, gate: float = 3.0) -> tuple[np.ndarray, float]:
    """Per line and grid row the weight of the best paint point within ``gate`` standard deviations (2, n_rows);
    weighted rms in px."""
    y = distance(points.inverse, mean, points.height_m)
    sigma = bearing_std(points) * points.focal_px
    support = np.zeros((2, points.n_rows))
    total, squares = 1e-9, 0.0
    for i, side in enumerate((-1, 1)):
        error = (points.bearing - line_x(y, mean, side) / y) * points.focal_px
        z = error / sigma
        on = np.abs(z) < gate
        np.maximum.at(support[i], points.row[on], points.weight[on] * (1 - np.square(z[on] / gate)))
        total += points.weight[on].sum()
        squares += float(np.sum(points.weight[on] * np.square(error[on])))
    return support, float(np.sqrt(squares / total))
