"""Lines and lanes in metres: curvature, lateral offset, width, their uncertainty, and the checks of sanity.

A line is x = A y^2 + B y + C on the road plane: x to the right, y ahead of the camera, in metres. Curvature is
signed, positive to the left, so with x'' = 2A

    curvature = -x'' / (1 + x'^2)^(3/2),    radius of curvature = 1 / |curvature|

Curvatures are averaged, never radii: of two nearly straight lines one may well have a radius of 8,000 m to the left
and the other of 8,000 m to the right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, final

import numpy as np

from lanelib.arrays import owned
from lanelib.errors import LanelibError

STRAIGHT_1PM = 1e-4  # curvatures below this (radius above 10 km) are called straight
PAINT_M = 0.05  # how well paint can be located
TRIES = 40  # of the robust fit's start; where half the points are wrong, one of so many triples is right in 99.5 %
ITERATIONS = 8  # of the robust fit; what is left to move is then below 0.001 of the standard deviation, after five 0.01


def radius_of(curvature_1pm: float) -> float:
    """Radius of curvature in metres; ``inf`` on a straight road."""
    return math.inf if abs(curvature_1pm) < STRAIGHT_1PM else 1 / abs(curvature_1pm)


def horner(coefficients, y_m):
    """The polynomial with these coefficients, highest power first, at ``y_m`` (scalar or array)."""
    scalar = isinstance(y_m, (float, int))  # plain numbers are several times quicker than arrays of one
    y = y_m if scalar else np.asarray(y_m, float)
    value = 0.0 if scalar else np.zeros(y.shape)
    for c in coefficients:
        value = value * y + c
    return value


@final  # it has no subclass that could be falsy: `if not line` tells a NoLine
@dataclass(frozen=True, eq=False)
class Line:
    """One lane line, x = polynomial(y) in metres, ``coefficients`` highest power first (2nd order; a 3rd is allowed).

    ``y_range_m``: from where to where it was seen. ``covariance`` of the coefficients, or None. ``support``: how much
    paint speaks for it, in bird's-eye rows.
    """

    coefficients: np.ndarray
    y_range_m: tuple[float, float] = (0.0, 30.0)
    covariance: np.ndarray | None = None
    support: float = 0.0

    def __post_init__(self):
        object.__setattr__(self, "coefficients", owned(self.coefficients))  # x(y) is worked out from a list made once

    @cached_property
    def _derivatives(self) -> tuple[list[float], list[float], list[float]]:
        """Coefficients of x, dx/dy and d2x/dy2, as plain floats: at one distance Horner's rule is quick on them."""
        x = self.coefficients.tolist()
        slope = [c * p for c, p in zip(x[:-1], range(len(x) - 1, 0, -1), strict=True)]
        bend = [c * p for c, p in zip(slope[:-1], range(len(slope) - 1, 0, -1), strict=True)]
        return x, slope, bend

    def x(self, y_m):
        """Lateral position in metres at distance ``y_m`` (scalar or array)."""
        return horner(self._derivatives[0], y_m)

    def slope(self, y_m=0.0):
        """dx/dy: the tangent of the angle to the car's axis, positive to the right."""
        return horner(self._derivatives[1], y_m)

    def curvature_1pm(self, y_m=0.0):
        """Signed curvature in 1/m, positive to the left."""
        return -horner(self._derivatives[2], y_m) / (1 + self.slope(y_m) ** 2) ** 1.5

    def x_continued(self, y_m, known_to_m: float):
        """x(y), continued beyond ``known_to_m`` with the slope and bend it has there: no change of bend is invented."""
        y = np.asarray(y_m, float)
        known = np.minimum(y, known_to_m)
        more = y - known
        bend = horner(self._derivatives[2], known_to_m)
        return self.x(known) + more * (self.slope(known_to_m) + more * bend / 2)

    def radius_m(self, y_m=0.0) -> float:
        """Radius of curvature in metres, ``inf`` where straight."""
        return radius_of(float(self.curvature_1pm(y_m)))

    def std_x_m(self, y_m=0.0):
        """Standard deviation of x(y) in metres (NaN without a covariance)."""
        if self.covariance is None:
            return np.full(np.shape(y_m), np.nan)
        powers = np.vander(np.atleast_1d(np.asarray(y_m, float)), len(self.coefficients))
        return np.sqrt(np.einsum("ij,jk,ik->i", powers, self.covariance, powers)).reshape(np.shape(y_m))

    def __repr__(self):
        radius = self.radius_m()
        side = "left" if self.curvature_1pm() > 0 else "right"
        bend = "straight" if math.isinf(radius) else f"R {radius:.0f} m {side}"
        return f"Line(x(0) = {self.x(0):+.2f} m, {bend}, seen {self.y_range_m[0]:.0f}-{self.y_range_m[1]:.0f} m)"


@dataclass(frozen=True)
class NoLine:
    """No line could be fitted, and why. Falsy."""

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


def fit_line(x_m, y_m, weights=None, *, order: int = 2, robust: bool = True) -> Line | NoLine:
    """Weighted least-squares polynomial through points (N,), in metres; robust to outliers.

    ``weights``: how much a point counts, 1 / variance up to a common factor; points with a weight of 0 or less, or with
    a number that is not finite, are left out. Robust: iteratively reweighted with Tukey's biweight,
    b(r) = (1 - (r / c)^2)^2 for |r| < c, else 0 (Beaton and Tukey 1974); c = 4.685 s with s the larger of ``PAINT_M``
    and 1.48 times the median residual. It starts from the best of ``TRIES`` fits through random points, as few as the
    polynomial needs (RANSAC, Fischler and Bolles 1981), so that up to half of the points may be wrong.

    The covariance is (J' W J)^-1 s^2 with W = w b and s^2 = sum(w r^2) / (n - p), over the n points with b > 0, for p
    coefficients (Draper and Smith, "Applied Regression Analysis", 3rd ed., sec. 9.2; without ``robust`` b = 1). Where
    n = p nothing is left to tell how points scatter, and they are taken to do so by ``PAINT_M``. It holds for points
    with errors of their own; pixels of one dash share theirs. Points that do not determine the polynomial give
    ``NoLine``.
    """
    x, y = np.asarray(x_m, float).ravel(), np.asarray(y_m, float).ravel()
    w = np.ones(len(x)) if weights is None else np.asarray(weights, float).ravel()
    if not len(x) == len(y) == len(w) or order < 0:
        raise LanelibError(
            "a line is fitted to as many x as y and weights, by a polynomial of order 0 or more; "
            f"found {len(x)}, {len(y)} and {len(w)}, order {order}"
        )
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(w) & (w > 0)
    x, y, w = x[good], y[good], w[good]
    if len(np.unique(y)) <= order:
        found = len(np.unique(y))
        return NoLine(f"a polynomial of order {order} needs points at more than {order} distances, found {found}")
    length = max(float(np.abs(y).max()), 1e-9)
    design = np.vander(y / length, order + 1)  # scaled to 1: conditions the normal equations

    def solve(weight):
        normal = (design * weight[:, None]).T @ design
        return normal, np.linalg.lstsq(normal, design.T @ (weight * x), rcond=1e-12)[0]

    weight = w
    if robust:
        best = _best_of_few(design, x, w, start=solve(w)[1])
        for _ in range(ITERATIONS):
            residual = x - design @ best
            spread = max(PAINT_M, 1.4826 * float(np.median(np.abs(residual))))
            weight = w * np.clip(1 - (residual / (4.685 * spread)) ** 2, 0, None) ** 2
            if np.count_nonzero(weight) <= order:
                return NoLine("fewer points agree with each other than a line needs")
            best = solve(weight)[1]
    normal, coefficients = solve(weight)
    if np.linalg.cond(normal) > 1e12:
        return NoLine("the points lie too close together to tell a line")
    used = weight > 0
    spare = np.count_nonzero(used) - order - 1
    squares = float(np.sum((w * (x - design @ coefficients) ** 2)[used]))
    variance = max(squares / spare, 1e-12) if spare else PAINT_M**2 * float(w[used].mean())
    unscale = 1 / length ** np.arange(order, -1, -1)
    return Line(
        coefficients * unscale,
        (float(y[used].min()), float(y[used].max())),
        np.linalg.inv(normal) * variance * np.outer(unscale, unscale),
        float(w[used].sum()),
    )


def _best_of_few(design: np.ndarray, x: np.ndarray, w: np.ndarray, *, start: np.ndarray) -> np.ndarray:
    """The best of ``start`` and ``TRIES`` polynomials through random points, as few as each needs.

    Judged by the weighted absolute residuals of all points, beyond 4 ``PAINT_M`` all alike.
    """
    rng, n = np.random.default_rng(0), design.shape[1]
    picks = [rng.choice(len(x), min(len(x), n), replace=False, p=w / w.sum()) for _ in range(TRIES)]
    candidates = [start, *(np.linalg.lstsq(design[few], x[few], rcond=1e-9)[0] for few in picks)]
    return min(candidates, key=lambda c: float(np.sum(w * np.minimum(np.abs(x - design @ c), 4 * PAINT_M))))


@dataclass(frozen=True)
class Surface:
    """How the road departs from the flat plane that the rig assumes: the car's nod, and a hill.

    ``pitch_rad`` > 0: the camera looks further down than the rig says. ``bend_1pm``: vertical curvature of the road
    (height = bend y^2 / 2), positive in a dip, negative on a crest. ``height_m``: of the camera.

    A point of the road at distance y is seen height / y - bend y / 2 below the road's own horizon, the rig's flat
    plane shows it at y0 with height / y0 = height / y - bend y / 2 - pitch (small angles); its bearing x / y is the
    same.
    """

    height_m: float = 1.0
    pitch_rad: float = 0.0
    bend_1pm: float = 0.0

    def flat_from_road(self, points_m: np.ndarray, *, known_to_m: float = math.inf) -> np.ndarray:
        """Points (N, 2) of the real road to where they appear on the rig's flat plane.

        NaN beyond the plane's horizon, and from the camera backwards. Beyond ``known_to_m`` the hill is not continued:
        the sight line keeps the slope it has there.
        """
        x, y = np.asarray(points_m, float).reshape(-1, 2).T
        y = np.where(y > 0, y, np.nan)
        inverse = 1 / y - (self.pitch_rad + 0.5 * self.bend_1pm * np.minimum(y, known_to_m)) / self.height_m
        y0 = 1 / np.where(inverse > 1e-4, inverse, np.nan)
        return np.column_stack([x / y * y0, y0])


@dataclass(frozen=True)
class Here:
    """The road at the car, as it was seen when it lay ahead: signed curvature of the lane's centre, and the offset."""

    curvature_1pm: float
    offset_m: float


@dataclass(frozen=True, eq=False)
class Lane:
    """The ego lane: two lines and the surface they lie on.

    ``here``: what earlier frames knew of the road at the car (``roadmemory``); None where only this frame speaks.
    """

    left: Line
    right: Line
    surface: Surface = field(default_factory=Surface)
    std: dict = field(default_factory=dict)  # standard deviations by name, where the fit knows them
    here: Here | None = None

    @property
    def offset_m(self) -> float:
        """Lateral offset of the car from the lane's centre, positive when the car is right of it."""
        return self.here.offset_m if self.here else float(-(self.left.x(0) + self.right.x(0)) / 2)

    def width_m(self, y_m=0.0):
        """Distance between the lines, across the lane (not along x), at distance ``y_m``."""
        slope = (self.left.slope(y_m) + self.right.slope(y_m)) / 2
        return (self.right.x(y_m) - self.left.x(y_m)) / (1 + slope**2) ** 0.5

    @property
    def curvature_1pm(self) -> float:
        """Signed curvature of the lane's centre at the car, 1/m, positive to the left."""
        if self.here:
            return self.here.curvature_1pm
        return float(self.left.curvature_1pm() + self.right.curvature_1pm()) / 2

    @property
    def radius_m(self) -> float:
        """Radius of curvature at the car in metres; ``inf`` where it is straight or cannot be told from straight."""
        if abs(self.curvature_1pm) < self.std.get("curvature_1pm", 0.0):
            return math.inf
        return radius_of(self.curvature_1pm)

    @property
    def y_range_m(self) -> tuple[float, float]:
        """Nearest and farthest distance at which any of the two lines was seen."""
        (left_near, left_far), (right_near, right_far) = self.left.y_range_m, self.right.y_range_m
        return min(left_near, right_near), max(left_far, right_far)

    def __repr__(self):
        radius = self.radius_m
        bends_to, car = "left" if self.curvature_1pm > 0 else "right", "right" if self.offset_m > 0 else "left"
        bend = "straight" if math.isinf(radius) else f"R {radius:.0f} m to the {bends_to}"
        return f"Lane({float(self.width_m()):.2f} m wide, {bend}, car {abs(self.offset_m):.2f} m {car} of centre)"


# ---------------------------------------------------------------------------------------------- sanity checks
JUMP_AT_M = 5.0  # where cameras begin to see the road: nearer, a jump is one of the prolongation


@dataclass(frozen=True)
class Limits:
    """What a lane may look like. Sources beside the numbers."""

    # narrow town lanes 2.7 m; motorway 3.7 m; ramps to 4.5 m (AASHTO Green Book)
    width_m: tuple[float, float] = (2.6, 4.6)
    width_change_m: float = 0.6  # between the car and 20 m ahead; more means that one line is another thing
    curvature_difference_1pm: float = 0.004  # between what the two lines say of the lane's centre at the car
    radius_m: float = 15.0  # the tightest hairpin a car drives
    # of either line between frames, ``JUMP_AT_M`` ahead; 1.5 m/s sideways at 25 frames a second is 0.06 m
    jump_m: float = 0.5


@dataclass(frozen=True)
class Check:
    """One sanity check: its name, what was found, what was allowed, and the outcome.

    ``words`` say the finding in a sentence about the lane, with a place for the value.
    """

    name: str
    value: float
    limit: str
    ok: bool
    words: str = "it has {:.4g}"

    @property
    def reason(self) -> str:
        """What was found and what is allowed, as the end of a sentence that begins with the lane."""
        return f"{self.words.format(self.value)}, allowed {self.limit}"

    def __repr__(self):
        return f"{'ok  ' if self.ok else 'FAIL'} {self.name}: {self.reason}"


def check_size(width_m: float, curvature_1pm: float, *, limits: Limits = Limits()) -> tuple[Check, Check]:
    """Whether a road can have lanes of this width, and bends this sharp."""
    low, high = limits.width_m
    tightest = 1 / max(abs(curvature_1pm), 1e-9)
    wide, sharp = low <= width_m <= high, tightest >= limits.radius_m
    return (
        Check("width", width_m, f"{low}-{high} m", wide, "it is {:.4g} m wide"),
        Check("radius", tightest, f"at least {limits.radius_m:g} m", sharp, "its radius is {:.4g} m"),
    )


def check_lane(lane: Lane, previous: Lane | None = None, *, limits: Limits = Limits()) -> tuple[Check, ...]:
    """Every sanity check on a lane of two separate lines; the last one only where there is a ``previous`` lane."""
    far = min(20.0, max(lane.y_range_m[1], 5.0))
    places = (0.0, far / 3, 2 * far / 3, far)
    gap = min(lane.right.x(y) - lane.left.x(y) for y in places)
    widths = [lane.width_m(y) for y in places]
    width, change = widths[0], max(widths) - min(widths)
    # parallel curves: the inner line of a bend is the sharper one, R -+ width / 2, so both are compared at the centre
    own = (lane.left.curvature_1pm(), -1), (lane.right.curvature_1pm(), 1)
    left, right = (curvature / max(1 - side * curvature * width / 2, 0.2) for curvature, side in own)
    bends = abs(left - right)
    size, radius = check_size(width, lane.curvature_1pm, limits=limits)
    most_change, most_bends, most_jump = limits.width_change_m, limits.curvature_difference_1pm, limits.jump_m
    order = "its right line lies {:.4g} m to the right of its left one"
    parallel, same_bend = "its width changes by {:.4g} m", "its lines' curvatures differ by {:.4g} 1/m"
    checks = [
        Check("order", gap, "more than 0 m", gap > 0, order),
        size,
        Check("parallel", change, f"at most {most_change} m in {far:.0f} m", change <= most_change, parallel),
        Check("same bend", bends, f"at most {most_bends} 1/m", bends <= most_bends, same_bend),
        radius,
    ]
    if previous is not None:
        pairs = ((lane.left, previous.left), (lane.right, previous.right))
        jump = max(abs(float(now.x(JUMP_AT_M) - before.x(JUMP_AT_M))) for now, before in pairs)
        words = f"{JUMP_AT_M:g} m ahead one of its lines moved by {{:.4g}} m since the last frame"
        checks.append(Check("no jump", jump, f"at most {most_jump} m", jump <= most_jump, words))
    return tuple(checks)
