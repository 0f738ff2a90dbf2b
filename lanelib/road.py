"""A road with exact truth: where its lines are, in metres and in pixels.

A road here is what a road engineer draws: a reference line whose curvature changes linearly between stations
(straights, arcs and the clothoids that join them), a grade that does the same, and lane markings at fixed distances
from the reference line. From that and a camera on a car follows the truth for one frame. The same code serves the
light simulator (`lanelib.simulator`) and the path-traced pictures (`render/`), so that truth means the same in both.

Axes (docs/ARCHITECTURE.md): x right, y ahead, z up, metres. Curvature is positive to the left. Along the road a point
is (s, d): s metres along the reference line, d metres to the right of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lanelib.errors import LanelibError
from lanelib.lane import STRAIGHT_1PM

NODE_STEP_M = 0.5  # spacing of the table of the reference line; the arc between two nodes is then exact to < 0.1 mm
COLORS = ("white", "yellow")  # of paint


@dataclass(frozen=True)
class Mounting:
    """How the camera sits on the car: height above the road and three angles, in the signs of the contract.

    pitch_deg > 0 looks down, yaw_deg > 0 looks right, roll_deg > 0 is turned clockwise as seen from behind.
    The truth has its own rotation and homography, so that `BirdsEye.from_mounting` can be checked against them.
    """

    height_m: float = 1.22
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    yaw_deg: float = 0.0

    def __post_init__(self):
        if not self.height_m > 0:
            raise LanelibError(f"needed a camera height above 0 m, got {self.height_m}: measure it from the road up")

    def rotation(self) -> np.ndarray:
        """Camera axes from road axes, (3, 3): X_camera = R @ (X_road - (0, 0, height)). Yaw, then pitch, then roll."""
        sy, sp, sr = np.sin(np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg]))
        cy, cp, cr = np.cos(np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg]))
        camera_from_road = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # x right, y down, z ahead
        yaw = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        pitch = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        roll = np.array([[cr, sr, 0], [-sr, cr, 0], [0, 0, 1]])
        return roll @ pitch @ yaw @ camera_from_road

    def road_from_image(self, camera_matrix: np.ndarray) -> np.ndarray:
        """Homography (3, 3) from undistorted pixels (u, v, 1) to the flat road (x, y, 1) in metres."""
        r = self.rotation()
        pose = np.column_stack([r[:, 0], r[:, 1], -self.height_m * r[:, 2]])
        image_from_road = np.asarray(camera_matrix, float) @ pose
        h = np.linalg.inv(image_from_road)
        return h / h[2, 2]

    def to_dict(self) -> dict:
        """As it stands in the truth file."""
        return {k: round(float(getattr(self, k)), 6) for k in ("height_m", "pitch_deg", "roll_deg", "yaw_deg")}


class Road:
    """Reference line with curvature and grade linear between stations, constant before the first and after the last.

    Parameters: stations_m (n,) increasing; curvature_1pm (n,), positive to the left; grade (n,) rise over run, or None
    for a flat road. The line starts at s = 0 in the world's origin, heading along y. `Road([0], [1 / 600])` is a
    circle. Between `s_min_m` and `s_max_m` points can be asked for.
    """

    def __init__(self, stations_m: Sequence[float], curvature_1pm: Sequence[float],
                 grade: Sequence[float] | None = None, *, s_min_m: float = -60.0, s_max_m: float = 1200.0):
        s, k = np.atleast_1d(np.asarray(stations_m, float)), np.atleast_1d(np.asarray(curvature_1pm, float))
        g = np.zeros_like(s) if grade is None else np.atleast_1d(np.asarray(grade, float))
        if not (s.ndim == 1 and s.shape == k.shape == g.shape and len(s) and np.all(np.diff(s) > 0)):
            raise LanelibError(f"needed increasing stations with one curvature (and grade) each, got shapes "
                               f"{s.shape}, {k.shape}, {g.shape}: give one value per station")
        if not (-np.inf < s_min_m < np.inf and 0 <= s_max_m < np.inf):
            raise LanelibError(f"needed a road that reaches from its start at 0 m to a finite s_max_m, got "
                               f"{s_min_m} .. {s_max_m} m: give s_max_m ahead of 0")
        if not np.isfinite(np.concatenate([s, k, g])).all() or np.abs(k).max() > 0.1:
            raise LanelibError("needed finite curvatures up to 0.1 per metre (10 m radius): check the unit, it is 1/m")
        self.stations_m, self.curvatures_1pm, self.grades = s, k, g
        self._theta_knots = self._integral_at_knots(k)
        self._z_knots = self._integral_at_knots(g)
        # Table of positions: heading is known in closed form, position by 4-point Gauss-Legendre between nodes.
        self._s = np.arange(np.floor(min(s_min_m, 0)), np.ceil(s_max_m) + NODE_STEP_M, NODE_STEP_M)
        x, w = np.polynomial.legendre.leggauss(4)
        theta = self.heading(self._s[:-1, None] + (x + 1) / 2 * NODE_STEP_M)
        steps = np.stack([-np.sin(theta) @ w, np.cos(theta) @ w], -1) * NODE_STEP_M / 2
        xy = np.vstack([[0.0, 0.0], np.cumsum(steps, 0)])
        self._xy = xy - xy[np.argmin(np.abs(self._s))]
        self._theta, self._kappa = self.heading(self._s), self.curvature(self._s)

    def _integral_at_knots(self, values):
        """Integral of the piecewise linear profile from s = 0 to each station."""
        s = self.stations_m
        upto = np.concatenate([[0.0], np.cumsum(np.diff(s) * (values[1:] + values[:-1]) / 2)])
        return upto - self._integrate(0.0, values, upto)

    def _integrate(self, s, values, at_knots):
        """Integral up to s: exact, the profile is linear in each piece and constant outside."""
        s, k = np.asarray(s, float), self.stations_m
        i = np.clip(np.searchsorted(k, s, side="right") - 1, 0, len(k) - 1)
        ds = s - k[i]
        slope = np.append(np.diff(values) / np.diff(k) if len(k) > 1 else [], 0.0)[i]
        return at_knots[i] + ds * (values[i] + np.where(ds > 0, slope * ds / 2, 0.0))

    def curvature(self, s_m):
        """Curvature of the reference line at s, 1/m, positive to the left."""
        return np.interp(s_m, self.stations_m, self.curvatures_1pm)

    def heading(self, s_m):
        """Direction of the reference line at s: radians turned to the left since s = 0."""
        return self._integrate(s_m, self.curvatures_1pm, self._theta_knots)

    def elevation(self, s_m):
        """Height of the road at s above the road at s = 0, metres (parabolic between stations)."""
        return self._integrate(s_m, self.grades, self._z_knots)

    def point(self, s_m, d_m=0.0) -> np.ndarray:
        """World x, y of the points (s, d): (..., 2). Raises where s is outside the road's table."""
        s, d = np.broadcast_arrays(np.asarray(s_m, float), np.asarray(d_m, float))
        if s.size and not (s.min() >= self._s[0] and s.max() <= self._s[-1]):  # NaN is not within either
            raise LanelibError(f"needed s within {self._s[0]:.0f} .. {self._s[-1]:.0f} m, got {s.min():.1f} .. "
                               f"{s.max():.1f}: make the road longer (s_min_m, s_max_m)")
        i = np.rint((s - self._s[0]) / NODE_STEP_M).astype(int)
        ds, p = s - self._s[i], self._xy[i].copy()
        for node, weight in np.transpose(np.polynomial.legendre.leggauss(3)):
            theta = self.heading(self._s[i] + (node + 1) / 2 * ds)
            p += (weight / 2 * ds)[..., None] * np.stack([-np.sin(theta), np.cos(theta)], -1)
        theta = self.heading(s)
        return p + d[..., None] * np.stack([np.cos(theta), np.sin(theta)], -1)

    def locate(self, xy: np.ndarray, s_guess=None) -> tuple[np.ndarray, np.ndarray]:
        """(s, d) of world points (..., 2): the foot on the reference line, nearest to the guess (default: s = y).

        Four tangent steps through the table of nodes find the nearest node; from there the line is a circular arc.
        Both are as exact as xy: float32 stays float32, whole numbers become float64.
        """
        xy = np.asarray(xy)
        xy = xy if np.issubdtype(xy.dtype, np.floating) else xy.astype(float)
        s = np.array(xy[..., 1] if s_guess is None else np.broadcast_to(s_guess, xy.shape[:-1]), dtype=xy.dtype)
        for _ in range(4):
            i = np.clip(np.rint((s - self._s[0]) / NODE_STEP_M).astype(int), 0, len(self._s) - 1)
            theta, kappa = self._theta.astype(xy.dtype)[i], self._kappa.astype(xy.dtype)[i]
            dx, dy = xy[..., 0] - self._xy[:, 0].astype(xy.dtype)[i], xy[..., 1] - self._xy[:, 1].astype(xy.dtype)[i]
            sin, cos = np.sin(theta), np.cos(theta)
            along, right = cos * dy - sin * dx, cos * dx + sin * dy
            s = self._s.astype(xy.dtype)[i] + along / np.maximum(1 + kappa * right, 0.2)
        # last step: exact on the arc through the node (angle about its centre, distance from it minus the radius)
        angle = np.arctan2(kappa * along, 1 + kappa * right)
        bent = np.abs(kappa) > 1e-7
        safe = np.where(bent, kappa, 1)
        s = self._s.astype(xy.dtype)[i] + np.where(bent, angle / safe, along)
        q = 2 * right + kappa * (right**2 + along**2)  # ((1 + kappa right)^2 + (kappa along)^2 - 1) / kappa
        return s, q / (1 + np.sqrt(np.maximum(1 + kappa * q, 0)))


@dataclass(frozen=True)
class Marking:
    """One painted line: d_m is the distance of its centre to the right of the reference line.

    Dashes start at s = phase_m and repeat every dash_m + gap_m; gap_m = 0 is a solid line. California paints
    12 ft + 36 ft (3.66 + 10.97 m) on motorways, other states 10 ft + 30 ft (3.05 + 9.14 m).
    """

    d_m: float
    color: str = "white"
    width_m: float = 0.12
    dash_m: float = 3.66
    gap_m: float = 0.0
    phase_m: float = 0.0
    wear: float = 0.2  # 0 new .. 1 gone

    def __post_init__(self):
        if self.color not in COLORS:
            raise LanelibError(f"needed a line that is {' or '.join(COLORS)}, got {self.color!r}: choose one of these")

    def painted(self, s_m) -> np.ndarray:
        """True where there is paint (wear apart)."""
        if self.gap_m <= 0:
            return np.ones(np.shape(s_m), bool)
        return np.mod(np.asarray(s_m) - self.phase_m, self.dash_m + self.gap_m) < self.dash_m

    def coverage(self, s_m, length_m) -> np.ndarray:
        """Share of painted length in an interval of length_m around s: 0 .. 1 (what a pixel that long sees)."""
        if self.gap_m <= 0:
            return np.ones(np.shape(s_m), np.float32)
        period = self.dash_m + self.gap_m

        def painted_upto(s):
            n = np.floor(s / period)
            return n * self.dash_m + np.minimum(s - n * period, self.dash_m)

        u = s_m - self.phase_m
        return np.clip((painted_upto(u + length_m / 2) - painted_upto(u - length_m / 2)) / length_m, 0, 1)


@dataclass(frozen=True)
class CarPose:
    """Where the camera is: s along the reference line, d to the right of it, and how the lane leads away.

    heading_rad is the direction of the road as seen from the car, positive where it leads to the right (the same
    sign as `heading_rad` in the truth): a car that has turned left by 0.02 sees a road with heading +0.02.
    """

    s_m: float = 0.0
    d_m: float = 0.0
    heading_rad: float = 0.0

    def world_from_car(self, road: Road) -> np.ndarray:
        """(4, 4): from the car's road axes (origin on the road straight below the camera) to the world."""
        turned = float(road.heading(self.s_m)) + self.heading_rad
        slope = np.arctan(np.interp(self.s_m, road.stations_m, road.grades))
        (c, s), (cg, sg) = (np.cos(turned), np.sin(turned)), (np.cos(slope), np.sin(slope))
        pose = np.eye(4)
        pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cg, -sg], [0, sg, cg]])
        pose[:2, 3], pose[2, 3] = road.point(self.s_m, self.d_m), road.elevation(self.s_m)
        return pose


def line_in_car_axes(road: Road, pose: CarPose, d_m: float, s_m: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the line at d_m, at stations s_m, in the car's road axes (z is not 0 on a crest)."""
    world = np.column_stack([road.point(s_m, d_m), road.elevation(s_m)])
    m = pose.world_from_car(road)
    return (world - m[:3, 3]) @ m[:3, :3]


# `project` and `fold_radius2` say once more what `Camera.project` and `distortion.fold_radius` say, on purpose: the
# truth must not share a mistake with the camera that is judged by it.
def project(points_m: np.ndarray, mounting: Mounting, camera_matrix: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of points (n, 3) in the car's road axes, through the lens (Brown-Conrady, OpenCV's order).

    NaN for points behind the camera, and beyond the angle at which the model folds over: there r (1 + k1 r^2 + k2 r^4
    + k3 r^6) falls again and a point far outside would come back into the picture.
    """
    k1, k2, p1, p2, k3 = np.asarray(distortion, float).ravel()
    cam = (np.asarray(points_m, float) - [0, 0, mounting.height_m]) @ mounting.rotation().T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (cam[:, :2] / cam[:, 2:]).T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        k = np.asarray(camera_matrix, float)
        uv = np.stack([k[0, 0] * xd + k[0, 1] * yd + k[0, 2], k[1, 1] * yd + k[1, 2]], -1)
        uv[~((cam[:, 2] > 0.1) & (r2 < fold_radius2(distortion)))] = np.nan
    return uv


def fold_radius2(distortion: np.ndarray) -> float:
    """Squared radius (normalised) at which the radial distortion folds over; inf where it never does."""
    k1, k2, _, _, k3 = np.asarray(distortion, float).ravel()
    roots = np.roots(np.trim_zeros(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]), "f"))
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real[real > 0].min()) if (real > 0).any() else np.inf


def frame_truth(road: Road, pose: CarPose, mounting: Mounting, camera_matrix: np.ndarray, distortion: np.ndarray,
                size_wh: tuple[int, int], left: Marking | None, right: Marking | None, *, raw_file: str = "",
                tags: Sequence[str] = (), hidden: Callable[[np.ndarray], np.ndarray] | None = None,
                h_samples: Sequence[int] | None = None, range_m: float = 150.0) -> dict:
    """The truth of one frame: the dict of the contract (docs/ARCHITECTURE.md, Files), ready for `json.dumps`.

    left, right: the two lines of the lane the car is in, or None for a road without a lane (empty `lanes`).
    hidden: tells for points (n, 3) in car axes which of them something stands in front of, (n,) bool.
    h_samples: the rows, by default every 10 px of the lower half. A line is -2 where it is outside the frame, behind a
    crest or farther than range_m; where paint is missing or hidden its x is given and `visible` is 0.
    range_m: the line is followed so far; 150 m is one row of 10 below the horizon for a camera at 1.2 m.
    """
    w, h = size_wh
    if h_samples is None:
        h_samples = range(h // 20 * 10, h, 10)
    truth: dict = {
        "raw_file": raw_file, "h_samples": [int(r) for r in h_samples], "lanes": [], "visible": [],
        "lanes_road_m": [], "radius_m": None, "curvature_1pm": None, "offset_m": None, "lane_width_m": None,
        "heading_rad": None, "mounting": mounting.to_dict(), "tags": list(tags)}
    if left is None or right is None:
        return truth
    rows = np.array(truth["h_samples"], float)
    # equal steps in 1 / distance are equal steps in rows, about three a pixel; from 1.5 m on to a few centimetres
    # before the foot of the camera, which only one that looks down steeply sees, in equal ratios
    ahead = np.append(np.geomspace(0.05, 1.5, h, endpoint=False), 1 / np.linspace(1 / 1.5, 1 / range_m, 4 * h))
    s, x_at_car = pose.s_m + ahead, []
    for marking in (left, right):
        uv = project(line_in_car_axes(road, pose, marking.d_m, s), mounting, camera_matrix, distortion)
        u_row, s_row = _at_rows(rows, uv, s, n_near=h)
        seen = (u_row > -0.5) & (u_row < w - 0.5)
        paint = np.zeros(len(rows), bool)
        paint[seen] = marking.painted(s_row[seen])
        if hidden is not None and seen.any():
            paint[seen] &= ~hidden(line_in_car_axes(road, pose, marking.d_m, s_row[seen]))
        truth["lanes"].append([round(float(u), 2) if k else -2 for u, k in zip(u_row, seen, strict=True)])
        truth["visible"].append(paint.astype(int).tolist())
        s_plan = pose.s_m + np.arange(-4.0, min(range_m, 100.0), 2.0)
        plan = line_in_car_axes(road, pose, marking.d_m, s_plan)[:, :2]
        truth["lanes_road_m"].append(np.round(plan, 4).tolist())
        near = line_in_car_axes(road, pose, marking.d_m, pose.s_m + np.linspace(-3, 3, 601))
        x_at_car.append(np.interp(0.0, near[:, 1], near[:, 0]))
    centre = (left.d_m + right.d_m) / 2
    kappa = float(road.curvature(pose.s_m))
    kappa /= 1 + kappa * centre  # the lane's centre runs parallel to the reference line
    truth["curvature_1pm"] = round(kappa, 9)
    truth["radius_m"] = None if abs(kappa) < STRAIGHT_1PM else round(1 / abs(kappa), 3)
    truth["offset_m"] = round(-sum(x_at_car) / 2, 6)
    truth["lane_width_m"] = round(right.d_m - left.d_m, 6)
    truth["heading_rad"] = round(float(pose.heading_rad), 8)
    return truth


def _at_rows(rows: np.ndarray, uv: np.ndarray, s_m: np.ndarray, *, n_near: int) -> tuple[np.ndarray, np.ndarray]:
    """Column and station, (rows,) each, of a line where it crosses rows of the frame; NaN where it is not in sight.

    uv (n, 2): its pixels at the stations s_m (n,), near to far; the first n_near are seen only by looking down steeply.
    """
    ok = np.isfinite(uv[:, 1])
    if not ok[n_near:].any():
        raise LanelibError("needed a camera that sees the road, got one that sees none of it: check the mounting")
    uv, s_m, nearer = uv[ok], s_m[ok], int(ok[:n_near].sum())
    lowest = nearer + int(np.argmax(uv[nearer:, 1]))
    back = np.flatnonzero(np.diff(uv[: lowest + 1, 1]) >= 0)  # nearer than that the lens bends the rows back
    start = back[-1] + 1 if len(back) else 0
    uv, s_m = uv[start:], s_m[start:]
    over = np.flatnonzero(np.diff(uv[:, 1]) >= 0)  # behind a crest the line comes down again: out of sight
    n = over[0] + 1 if len(over) else len(uv)
    u, v, s_m = uv[:n, 0][::-1], uv[:n, 1][::-1], s_m[:n][::-1]  # far to near: rows increase
    return np.interp(rows, v, u, left=np.nan, right=np.nan), np.interp(rows, v, s_m, left=np.nan, right=np.nan)
