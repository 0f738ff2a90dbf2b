"""Roads of known geometry for the tests of the detection core, drawn in three ways that share no code:

- points: what the joint fit would be given if paint were found exactly (`points_on_lane`), from a formula written out
  here once more;
- a bird's-eye scan in which stripes are painted by the share of each pixel they cover (`paint_scan`);
- a frame in which stripes are filled polygons, projected with cv2.projectPoints (`paint_frame`).

`lanelib.simulator` is the fourth and the only one that looks like a road.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.jointfit import Points
from lanelib.rig import Rig
from lanelib.simulator import Scene

# A camera like no shipped one, so that nothing can lean on a shipped rig's numbers.
MATRIX = np.array([[1042.0, 0, 652.5], [0, 1037.0, 341.25], [0, 0, 1]])
DISTORTION = np.array([-0.21, 0.05, 0.0008, -0.0005, 0.004])
SIZE_WH = (1280, 720)
MOUNTING = {"height_m": 1.41, "pitch_deg": 3.1, "yaw_deg": -0.9, "roll_deg": 0.7}
WHITE, YELLOW = (205, 210, 208), (60, 170, 205)  # BGR
ASPHALT = (98, 100, 99)


def rig(size_wh=SIZE_WH, **mounting) -> Rig:
    """A rig of the camera above, mounted as given (default: ``MOUNTING``), for frames of ``size_wh``."""
    camera = Camera(MATRIX, DISTORTION, SIZE_WH)
    return Rig(camera, BirdsEye.from_mounting(camera, **(MOUNTING | mounting)), "test").scaled(size_wh)


def rig_of_scene(scene: Scene) -> Rig:
    """The rig that fits a scene of the simulator exactly."""
    m, camera = scene.mounting, Camera(np.array(scene.camera_matrix), np.array(scene.distortion), scene.size_wh)
    angles = {"pitch_deg": m.pitch_deg, "yaw_deg": m.yaw_deg, "roll_deg": m.roll_deg}
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=m.height_m, **angles), "simulated")


@dataclass(frozen=True)
class Lane7:
    """A lane and its surface in the seven numbers of the joint fit, with the geometry written out independently."""

    centre: float = 0.0
    heading: float = 0.0
    bend: float = 0.0
    rate: float = 0.0
    width: float = 3.65
    pitch: float = 0.0
    hill: float = 0.0

    @property
    def mean(self) -> np.ndarray:
        return np.array([self.centre, self.heading, self.bend, self.rate, self.width, self.pitch, self.hill])

    def x(self, y, side: int):
        """x of the left (-1) or right (+1) line: the centre line moved half a width along its normal, seen at y."""
        y = np.asarray(y, float)
        slope = np.polyval([3 * self.rate, 2 * self.bend, self.heading], y)
        centre = np.polyval([self.rate, self.bend, self.heading, self.centre], y)
        return centre + side * self.width / 2 / np.cos(np.arctan(slope))


def points_on_lane(lane: Lane7, *, y_m=None, sides=(-1, 1), height_m=1.3, focal_px=1100.0, gaps=None) -> Points:
    """Exact paint points of a lane at distances ``y_m`` (default: 136 rows from 4 to 90 m, spaced like a scan).

    ``gaps``: {side: (paint, period, phase)} in metres leaves only dashes on that side.
    """
    y = np.linspace(1 / np.sqrt(90), 1 / np.sqrt(4), 136) ** -2.0 if y_m is None else np.asarray(y_m, float)
    # seen from height h a point of the road at distance y, height bend y^2 / 2, lies (h - hill y^2 / 2) / y below
    # the horizontal; the camera looks pitch further down than the rig says, which moves it up by as much
    depression = (height_m - lane.hill * y**2 / 2) / y - lane.pitch
    bearing, inverse, row, weight = [[]], [[]], [[]], [[]]
    for side in sides:
        on = np.ones(len(y), bool)
        if gaps and side in gaps:
            paint, period, phase = gaps[side]
            on = np.mod(y - phase, period) < paint
        on &= depression > 0.01
        bearing.append((lane.x(y, side) / y)[on])
        inverse.append((depression / height_m)[on])
        row.append(np.flatnonzero(on))
        weight.append(np.ones(on.sum()))
    return points(*(np.concatenate(v) for v in (bearing, inverse, row, weight)), focal_px, height_m, len(y))


def points(bearing, inverse, row, weight, focal_px=1100.0, height_m=1.3, n_rows=136) -> Points:
    """Points for the joint fit, sorted by row as a scan gives them."""
    order = np.lexsort((bearing, row))
    return Points(bearing[order], inverse[order], row[order].astype(int), weight[order], focal_px, height_m, n_rows)


def joined(*several: Points) -> Points:
    """All points of several sets."""
    first = several[0]
    columns = (np.concatenate([getattr(p, n) for p in several]) for n in ("bearing", "inverse", "row", "weight"))
    return points(*columns, first.focal_px, first.height_m, first.n_rows)


def stripe_coverage(x_m, centre_m, width_m: float, column_m: float) -> np.ndarray:
    """Share 0..1 of each cell (centres ``x_m``, ``column_m`` wide) that a stripe covers; broadcasts."""
    left = np.maximum(x_m - column_m / 2, centre_m - width_m / 2)
    right = np.minimum(x_m + column_m / 2, centre_m + width_m / 2)
    return np.clip((right - left) / column_m, 0, 1)


def paint_scan(grid, stripes, *, road=ASPHALT, noise=0.0, seed=0) -> np.ndarray:
    """A bird's-eye picture (H, W, 3) uint8 of ``grid``. ``stripes``: (x of y in m, width in m, BGR) each; a stripe is
    painted where its x is finite."""
    picture = np.tile(np.asarray(road, float), (len(grid.y_m), len(grid.x_m), 1))
    for x_of_y, width_m, bgr in stripes:
        centre = np.broadcast_to(np.asarray(x_of_y(grid.y_m), float), grid.y_m.shape)[:, None]
        share = np.nan_to_num(stripe_coverage(grid.x_m[None, :], centre, width_m, grid.column_m))[..., None]
        picture += (np.asarray(bgr, float) - picture) * share
    if noise:
        picture += np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.uint8(np.clip(np.rint(picture), 0, 255))


def camera_from_road(*, height_m, pitch_deg=0.0, yaw_deg=0.0, roll_deg=0.0):
    """(rvec, tvec) for cv2.projectPoints, from Rodrigues vectors: yaw about the camera's y axis, then pitch, roll."""
    turns = ((-yaw_deg, (0, 1, 0)), (pitch_deg, (1, 0, 0)), (-roll_deg, (0, 0, 1)))
    about_y, about_x, about_z = (cv2.Rodrigues(np.radians(a) * np.array(axis, float))[0] for a, axis in turns)
    # road x right, y ahead, z up is camera x, z, -y
    r = about_z @ about_x @ about_y @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return cv2.Rodrigues(r)[0], r @ np.array([0, 0, -height_m])


def project(points_m, *, size_wh=SIZE_WH, **mounting) -> np.ndarray:
    """Pixels (N, 2) of the frame as given of road points (N, 3), by cv2.projectPoints alone."""
    rvec, tvec = camera_from_road(**(MOUNTING | mounting))
    pixels = cv2.projectPoints(np.asarray(points_m, float), rvec, tvec, MATRIX, DISTORTION)[0].reshape(-1, 2)
    return (pixels + 0.5) * size_wh[0] / SIZE_WH[0] - 0.5


def paint_frame(
    lane: Lane7,
    *,
    size_wh=SIZE_WH,
    far_m=90.0,
    paint_m=0.13,
    dashed=(),
    colours=(YELLOW, WHITE),
    extra=(),
    noise=2.0,
    seed=0,
    **mounting,
) -> np.ndarray:
    """A frame (H, W, 3) uint8: flat asphalt under a plain sky with the lane's two lines as filled polygons.

    ``dashed``: sides (-1, 1) painted 3.66 m in 14.63 m. ``extra``: (x of y, width, BGR) more stripes. The lane's
    ``pitch`` and ``hill`` are drawn in three dimensions: the camera turned, the road lifted.
    """
    tilt = (MOUNTING | mounting) | {"pitch_deg": (MOUNTING | mounting)["pitch_deg"] + np.degrees(lane.pitch)}
    frame = np.zeros((size_wh[1], size_wh[0], 3), np.uint8)
    frame[:] = ASPHALT
    far = project([[0, 400.0, 0]], size_wh=size_wh, **tilt)[0, 1]
    frame[: int(far)] = (190, 160, 130)
    bits = 6
    stripes = [(lambda y, s=s: lane.x(y, s), paint_m, c, s in dashed) for s, c in zip((-1, 1), colours, strict=True)]
    for x_of_y, width, bgr, dash in [*stripes, *((*e, False) for e in extra)]:
        starts = np.arange(2.0, far_m, 14.63) if dash else [1.8]
        for start in starts:
            y = np.geomspace(start, min(start + 3.66, far_m) if dash else far_m, 60)
            x = x_of_y(y)
            # the stripe's edges lie half its width off along the normal, so that a bend does not thin it
            along = np.column_stack([np.gradient(x, y), np.ones_like(y)])
            normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
            outline = []
            for s in (-0.5, 0.5):
                xy = np.column_stack([x, y]) + s * width * normal
                outline.append(np.column_stack([xy, lane.hill * xy[:, 1] ** 2 / 2]))
            ring = project(np.concatenate([outline[0], outline[1][::-1]]), size_wh=size_wh, **tilt)
            cv2.fillPoly(frame, [np.int32(np.rint(ring * 2**bits))], bgr, cv2.LINE_AA, bits)
    frame = cv2.GaussianBlur(frame, (0, 0), 0.6).astype(float)
    frame += np.random.default_rng(seed).normal(0, noise, frame.shape)
    return np.uint8(np.clip(np.rint(frame), 0, 255))


def points_on_grid(lane: Lane7, grid, *, height_m, focal_px, gaps=None, rng=None, px=0.0, drop=0.0) -> Points:
    """Paint points of a flat-road lane as a scan of ``grid`` gives them: one a row and line, within its columns.

    ``rng`` scatters them by ``px`` pixels and drops a share ``drop`` of them.
    """
    y = 1 / (1 / grid.y_m + lane.pitch / height_m)
    lines = points_on_lane(lane, y_m=y, height_m=height_m, focal_px=focal_px, gaps=gaps)
    seen = np.abs(lines.bearing / lines.inverse) < grid.x_m[-1]
    bearing = lines.bearing
    if rng is not None:
        bearing = bearing + rng.normal(0, px, len(bearing)) / focal_px
        seen &= rng.random(len(bearing)) >= drop
    return points(*(v[seen] for v in (bearing, lines.inverse, lines.row, lines.weight)), focal_px, height_m, len(y))


def with_dots(frame, places_m):
    """The frame and dirty Botts' dots at (x, y) on the road: 4 inches across, 3/4 inch high."""
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rings = [(r, z) for r, z in ((0.051, 0.0), (0.036, 0.013), (0.0, 0.019))]
    dome = np.vstack([np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(12, z)]) for r, z in rings])
    for x, y in places_m:
        outline = cv2.convexHull(np.rint(project(dome + (x, y, 0)) * 64).astype(np.int32))
        cv2.fillConvexPoly(frame, outline, (150, 150, 150), cv2.LINE_AA, 6)
    return frame
