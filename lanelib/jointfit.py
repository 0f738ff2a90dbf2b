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

import cv2
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


# ---------------------------------------------------------------------------------------------- hypotheses
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


def bearing_std(points: Points) -> np.ndarray:
    """Standard deviation of each point's bearing: pixels of the frame and ragged paint."""
    return np.sqrt(LOCATION_STD_PX**2 + (LOCATION_STD_M * points.focal_px * points.inverse) ** 2) / points.focal_px


def differ(a, b) -> bool:
    """Two lanes are different when one of their lines differs by 0.4 m at 6 m or by 1 m at 20 m."""
    return any(abs(line_x(y, a, s) - line_x(y, b, s)) > far for s in (-1, 1) for y, far in ((6.0, 0.4), (20.0, 1.0)))


# ---------------------------------------------------------------------------------------------- fit
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


# ---------------------------------------------------------------------------------------------- double lines
# half the width of one painted line; the width from which a stripe is two lines with a gap
SINGLE_LINE_M = (0.06, 0.25)
PROFILE_REACH_M, PROFILE_FAR_M = 0.6, 25.0


def stripe_width(picture: np.ndarray, x_m: np.ndarray, grid_x0_m: float, column_m: float) -> tuple[float, float, float]:
    """Width at half height of the bright stripe that runs along ``x_m``.

    ``picture`` (H, W): rows of a bird's-eye picture; ``x_m`` (H,): where the line crosses them. The rows are laid
    on top of each other along
    the line and averaged. Returns (left edge, right edge) relative to the line, in metres, and the contrast in
    grey levels; zeros where no stripe is.
    """
    step = 0.025
    d = np.arange(-PROFILE_REACH_M, PROFILE_REACH_M + step / 2, step)
    column = (x_m[:, None] + d[None, :] - grid_x0_m) / column_m
    low = np.clip(column.astype(int), 0, picture.shape[1] - 2)
    rows = np.arange(len(x_m))[:, None]
    part = column - low
    values = picture[rows, low] * (1 - part) + picture[rows, low + 1] * part
    profile = values.mean(axis=0)
    outside = np.abs(d) > PROFILE_REACH_M - 0.15
    profile = profile - np.median(profile[outside])
    middle = np.abs(d) < 0.2
    peak = float(profile[middle].max())
    if peak <= 1.0:
        return 0.0, 0.0, 0.0
    above = profile > peak / 2
    top = int(np.argmax(np.where(middle, profile, -np.inf)))
    gap = int(round(0.125 / step))  # the dark gap of a double line may fall below half height: bridge it
    left = right = top
    while left > 0 and above[max(left - gap, 0) : left].any():
        left -= 1
    while right < len(d) - 1 and above[right + 1 : right + 1 + gap].any():
        right += 1
    return float(d[left]) - step / 2, float(d[right]) + step / 2, peak


def inward(fit: JointFit, picture: np.ndarray, grid) -> tuple[float, float]:
    """How much further in than the fitted stripes the boundaries lie (m, left and right): 0 for single lines. For
    a double line the
    boundary is the middle of its inner line: half a painted line within the stripe's inner edge."""
    y = distance(1 / grid.y_m, fit.mean, fit.height_m)
    shifts = []
    for side, support in zip((-1, 1), fit.support, strict=True):
        rows = np.flatnonzero((support > 0.4) & (y < PROFILE_FAR_M))
        if len(rows) < 8:
            shifts.append(0.0)
            continue
        x = line_x(y[rows], fit.mean, side) / y[rows] * grid.y_m[rows]  # where the line appears on the flat plane
        left, right, _ = stripe_width(picture[rows].astype(np.float32), x, grid.x_m[0], grid.column_m)
        inner = right if side < 0 else -left
        double = SINGLE_LINE_M[1] < right - left < 0.55 and inner > SINGLE_LINE_M[0]
        shifts.append(inner - SINGLE_LINE_M[0] if double else 0.0)
    return shifts[0], shifts[1]
