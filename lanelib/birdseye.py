"""Bird's-eye view: the homography between the undistorted picture and the road plane in metres.

The road plane has x to the right and y ahead, in metres, with its origin straight below the camera.
Everything else follows from one 3x3 matrix, ``road_from_image``: metres per pixel are never typed
but read off the geometry.

A flat road seen by a pinhole camera with matrix K, rotation R and height h gives

    image_from_road = K [r1  r2  t]          (Hartley and Zisserman, Multiple View Geometry, 2nd ed., sec. 8.1.1)

where r1, r2 are the images of the road's two axes and t = -R C is the road's origin in camera axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from lanelib.arrays import as_picture, as_points, as_size_wh, owned
from lanelib.camera import Camera
from lanelib.errors import LanelibError

# The classic trapezoid of the Udacity course, in fractions of a 1280x720 picture, and the rectangle it maps to.
CLASSIC_SOURCE = np.array([(576, 454), (704, 454), (1088, 684), (192, 684)]) / (1280, 720)
CLASSIC_TARGET = np.array([(320, 0), (960, 0), (960, 720), (320, 720)]) / (1280, 720)

UNSEEN_PX = -1e4  # a place outside of every frame, and within the 16 bits of OpenCV's fixed-point maps
EQUAL_STEPS = 1e-3  # of a column; numbers in single precision differ by 1e-4 of 5 mm
CAMERA_FROM_ROAD_AXES = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x right; y down = -z up; z forward = y ahead


def rotation_from_angles(*, pitch_deg: float = 0.0, yaw_deg: float = 0.0, roll_deg: float = 0.0) -> np.ndarray:
    """Rotation (3, 3) that takes road axes (right, ahead, up) to camera axes (right, down, forward).

    pitch > 0 looks down, yaw > 0 looks right, roll > 0 turns the camera clockwise as seen from behind it; applied in
    the order yaw, pitch, roll.
    """
    p, y, r = (math.radians(a) for a in (pitch_deg, yaw_deg, roll_deg))
    yaw = np.array([[math.cos(y), 0, -math.sin(y)], [0, 1, 0], [math.sin(y), 0, math.cos(y)]])
    pitch = np.array([[1, 0, 0], [0, math.cos(p), -math.sin(p)], [0, math.sin(p), math.cos(p)]])
    roll = np.array([[math.cos(r), math.sin(r), 0], [-math.sin(r), math.cos(r), 0], [0, 0, 1]])
    return roll @ pitch @ yaw @ CAMERA_FROM_ROAD_AXES


def map_points(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Apply a (3, 3) homography to points (N, 2); NaN where a point lies on or beyond the horizon (w <= 0)."""
    xyw = as_points(points, 2) @ homography[:, :2].T + homography[:, 2]
    w = np.where(xyw[:, 2:] > 1e-12, xyw[:, 2:], np.nan)
    return xyw[:, :2] / w


@dataclass(frozen=True, eq=False)
class Grid:
    """Where a bird's-eye picture samples the road: column j at ``x_m[j]``, row i at ``y_m[i]``.

    ``x_m`` (W,) ascends in equal steps; ``y_m`` (H,) descends, because rows grow towards the car.
    """

    x_m: np.ndarray
    y_m: np.ndarray

    def __post_init__(self):
        for name, sign in (("x_m", 1), ("y_m", -1)):
            try:
                values = owned(getattr(self, name))
                steps = sign * np.diff(values)
                good = values.ndim == 1 and len(values) >= 2 and np.isfinite(values).all() and steps.min() > 0
            except (TypeError, ValueError):
                good = False
            if not good:
                order, found = ("ascending" if sign > 0 else "descending"), getattr(self, name)
                raise LanelibError(f"a grid's {name} must be at least two finite {order} metres, found {found!r:.60}")
            if name == "x_m" and np.ptp(steps) > EQUAL_STEPS * steps[0]:
                raise LanelibError(
                    f"a grid's x_m must ascend in equal steps, in metres, found steps of {steps.min():g} to "
                    f"{steps.max():g}; only rows may be spaced by perspective"
                )
            object.__setattr__(self, name, values)

    @classmethod
    def uniform(cls, *, x_range_m=(-6.0, 6.0), y_range_m=(3.0, 45.0), size_wh=(360, 720)) -> Grid:
        """Equal steps both ways: a map of the road, as it is shown to people."""
        w, h = as_size_wh(size_wh, "grid")
        dx, dy = (x_range_m[1] - x_range_m[0]) / w, (y_range_m[1] - y_range_m[0]) / h
        return cls(x_range_m[0] + dx * (np.arange(w) + 0.5), y_range_m[1] - dy * (np.arange(h) + 0.5))

    @property
    def size_wh(self) -> tuple[int, int]:
        """Columns and rows."""
        return len(self.x_m), len(self.y_m)

    @property
    def column_m(self) -> float:
        """Metres per column."""
        return float((self.x_m[-1] - self.x_m[0]) / (len(self.x_m) - 1))

    @property
    def row_m(self) -> float:
        """Metres per row (the mean, where rows are not equally spaced)."""
        return float((self.y_m[0] - self.y_m[-1]) / (len(self.y_m) - 1))

    @property
    def is_uniform(self) -> bool:
        """Whether all rows are equally far apart (columns always are)."""
        return bool(np.allclose(np.diff(self.y_m), -self.row_m, rtol=1e-6))

    @cached_property
    def road_from_pixel(self) -> np.ndarray:
        """Affine (3, 3) from pixels (column, row) of a uniform grid to metres (x, y)."""
        if not self.is_uniform:
            raise LanelibError("a homography needs a grid with equal rows; this one's rows are spaced by perspective")
        return np.array([[self.column_m, 0, self.x_m[0]], [0, -self.row_m, self.y_m[0]], [0, 0, 1]])

    def x_of(self, columns) -> np.ndarray:
        """Metres of (fractional) columns."""
        return self.x_m[0] + self.column_m * np.asarray(columns, float)

    def column_of(self, x_m) -> np.ndarray:
        """Fractional column of metres."""
        return (np.asarray(x_m, float) - self.x_m[0]) / self.column_m


@dataclass(frozen=True, eq=False)
class BirdsEye:
    """The road plane as one camera sees it.

    ``road_from_image``: (3, 3), undistorted pixels (u, v, 1) to road metres (x, y, 1), scaled so that the third
    coordinate is positive below the horizon. ``size_wh``: of the picture. ``grid``: what is shown of the road.
    """

    road_from_image: np.ndarray
    size_wh: tuple[int, int]
    grid: Grid = None  # type: ignore[assignment]  # None asks for the usual one, made below

    def __post_init__(self):
        try:
            h = np.asarray(self.road_from_image, float)
        except (TypeError, ValueError):
            h = np.empty(0)
        good = h.shape == (3, 3) and np.all(np.isfinite(h)) and np.any(h)
        if not good or abs(np.linalg.det(h / np.abs(h).max())) < 1e-15:
            raise LanelibError("road_from_image must be a finite, invertible 3x3 matrix; make the rig again")
        w, height = as_size_wh(self.size_wh, "bird's-eye view")
        if h[2] @ (w / 2, 1.2 * height, 1) < 0:  # homographies have no sign: make the road side the positive one
            h = -h
        object.__setattr__(self, "road_from_image", owned(h))
        object.__setattr__(self, "size_wh", (w, height))
        if self.grid is None:
            object.__setattr__(self, "grid", Grid.uniform())

    # ------------------------------------------------------------------ ways to make one
    @classmethod
    def from_mounting(
        cls, camera: Camera, *, height_m, pitch_deg=0.0, yaw_deg=0.0, roll_deg=0.0, grid=None
    ) -> BirdsEye:
        """From the camera matrix and the mounting: ``height_m`` above a flat road, turned by three angles."""
        if not 0 < height_m < math.inf:
            raise LanelibError(f"a camera's height above the road must be positive metres, found {height_m}")
        if not all(map(math.isfinite, (pitch_deg, yaw_deg, roll_deg))):
            raise LanelibError(f"a camera's angles must be finite degrees, found {pitch_deg}, {yaw_deg}, {roll_deg}")
        rotation = rotation_from_angles(pitch_deg=pitch_deg, yaw_deg=yaw_deg, roll_deg=roll_deg)
        t = -rotation @ (0, 0, height_m)
        image_from_road = camera.camera_matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], t])
        return cls(np.linalg.inv(image_from_road), camera.size_wh, grid)

    @classmethod
    def from_points(cls, image_px, road_m, size_wh, grid=None) -> BirdsEye:
        """From four (or more) undistorted pixels (N, 2) and the metres (N, 2) on the road that they show."""
        image_px, road_m = as_points(image_px, 2), as_points(road_m, 2)
        if len(image_px) < 4 or len(image_px) != len(road_m):
            raise LanelibError(
                f"a homography needs at least 4 pairs of points, found {len(image_px)} and {len(road_m)}"
            )
        h, _ = cv2.findHomography(image_px, road_m)
        if h is None:
            raise LanelibError("these points give no homography: three of them lie on one line; choose others")
        return cls(h, size_wh, grid)

    @classmethod
    def classic(cls, size_wh, *, lane_width_m=3.7, length_m=30.0, near_m=4.0, grid=None) -> BirdsEye:
        """The trapezoid that everyone copies, with the metres that everyone assumes (30 m long, a lane 3.7 m wide).

        Kept for comparison: notebook 03 measures how far its 30 m are from the truth. The camera's own position is
        not known to it, so ``near_m`` says how far ahead of the camera its lower edge lies.
        """
        size_wh = as_size_wh(size_wh, "bird's-eye view")
        _check_length(lane_width_m, "lane_width_m")
        _check_length(length_m, "length_m")
        target_width = CLASSIC_TARGET[1, 0] - CLASSIC_TARGET[0, 0]  # the lane is half the bird's-eye picture
        x = (CLASSIC_TARGET[:, 0] - CLASSIC_TARGET[:, 0].mean()) / target_width * lane_width_m
        y = near_m + (1 - CLASSIC_TARGET[:, 1]) * length_m
        return cls.from_points(CLASSIC_SOURCE * size_wh, np.column_stack([x, y]), size_wh, grid)

    @classmethod
    def from_straight_lines(
        cls, camera: Camera, left_px, right_px, *, lane_width_m=3.7, roll_deg=0.0, grid=None
    ) -> BirdsEye:
        """From two straight lane lines: their meeting point gives pitch and yaw, the lane's width gives the height.

        ``left_px``, ``right_px``: two undistorted points (2, 2) on each line. The lane must be straight and the car
        parallel to it. With the vanishing point at direction d (camera axes), d is the road's y axis; the lane's
        width then fixes the only number left, the height of the camera.
        """
        _check_length(lane_width_m, "lane_width_m")
        left_px, right_px = as_points(left_px, 2), as_points(right_px, 2)
        if min(len(left_px), len(right_px)) < 2:
            raise LanelibError(f"a line is given by two points, found {len(left_px)} and {len(right_px)}")
        lines = [np.cross((*p[0], 1.0), (*p[1], 1.0)) for p in (left_px, right_px)]
        vanishing = np.cross(*lines)
        if abs(vanishing[2]) < 1e-9 * np.abs(vanishing).max():
            raise LanelibError(
                "the two lines do not meet in the picture's plane: they cannot be parallel lines of a road ahead"
            )
        u, v = vanishing[:2] / vanishing[2]
        pitch_deg, yaw_deg = angles_from_vanishing_point(camera.camera_matrix, (u, v), roll_deg=roll_deg)
        unit = cls.from_mounting(
            camera, height_m=1.0, pitch_deg=pitch_deg, yaw_deg=yaw_deg, roll_deg=roll_deg, grid=grid
        )
        x = [np.nanmean(map_points(unit.road_from_image, p)[:, 0]) for p in (left_px, right_px)]
        if not np.isfinite(x).all() or x[1] - x[0] <= 1e-6:
            raise LanelibError(
                "the left line must lie left of the right one and below their meeting point; were they exchanged?"
            )
        scale = lane_width_m / (x[1] - x[0])  # a road plane is known up to scale: metres per camera height
        return replace(unit, road_from_image=np.diag([scale, scale, 1.0]) @ unit.road_from_image)

    # ------------------------------------------------------------------ geometry
    @cached_property
    def image_from_road(self) -> np.ndarray:
        """The inverse homography (3, 3): road metres to undistorted pixels, third coordinate positive ahead."""
        h = np.linalg.inv(self.road_from_image)
        return owned(h if h[2] @ (0, 20, 1) > 0 else -h)

    def road_from_points(self, points_px) -> np.ndarray:
        """Undistorted pixels (N, 2) to metres on the road (N, 2); NaN on and above the horizon."""
        return map_points(self.road_from_image, points_px)

    def points_from_road(self, points_m) -> np.ndarray:
        """Metres on the road (N, 2) to undistorted pixels (N, 2); NaN behind the camera."""
        return map_points(self.image_from_road, points_m)

    @property
    def horizon_row_px(self) -> float:
        """Row of the horizon in the middle column of the undistorted picture."""
        a, b, c = self.road_from_image[2]
        return float(-(a * (self.size_wh[0] - 1) / 2 + c) / b)

    def mounting(self, camera: Camera) -> dict:
        """height_m, pitch_deg, yaw_deg and roll_deg of the camera that sees the road like this.

        Raises LanelibError where no camera does.
        """
        with np.errstate(all="ignore"):
            a = np.linalg.inv(camera.camera_matrix) @ self.image_from_road
            a = a / np.abs(a).max()  # its size means nothing; squares of 1e200 would overflow
            scale = 2 / (np.linalg.norm(a[:, 0]) + np.linalg.norm(a[:, 1]))
            r1, r2 = a[:, 0] * scale, a[:, 1] * scale
            axes = np.column_stack([r1, r2, np.cross(r1, r2)])
        if not np.isfinite(axes).all():
            raise LanelibError("road_from_image shows the road as no camera does; make the rig again")
        u, _, vt = np.linalg.svd(axes)
        rotation = u @ vt
        centre = -rotation.T @ (a[:, 2] * scale)
        forward = rotation[2]
        pitch, yaw = math.asin(np.clip(-forward[2], -1, 1)), math.atan2(forward[0], forward[1])
        level = rotation_from_angles(pitch_deg=math.degrees(pitch), yaw_deg=math.degrees(yaw))
        roll = math.atan2((rotation @ level.T)[0, 1], (rotation @ level.T)[0, 0])
        return {
            "height_m": float(centre[2]),
            "pitch_deg": math.degrees(pitch),
            "yaw_deg": math.degrees(yaw),
            "roll_deg": math.degrees(roll),
        }

    def pitched(self, camera: Camera, pitch_rad: float) -> BirdsEye:
        """The same mounting with the car's nose ``pitch_rad`` further down (positive) or up, about the camera."""
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        k = camera.camera_matrix
        image = k @ turn @ np.linalg.inv(k) @ self.image_from_road
        return replace(self, road_from_image=np.linalg.inv(image))

    def scaled(self, size_wh) -> BirdsEye:
        """The same view of another resolution of the same picture."""
        size_wh = as_size_wh(size_wh, "bird's-eye view")
        sx, sy = size_wh[0] / self.size_wh[0], size_wh[1] / self.size_wh[1]
        # pixel centres at integers
        here = np.array([[1 / sx, 0, 0.5 / sx - 0.5], [0, 1 / sy, 0.5 / sy - 0.5], [0, 0, 1]])
        return replace(self, road_from_image=self.road_from_image @ here, size_wh=size_wh)

    def parallelism(self, left_px, right_px) -> float:
        """How much wider (m) the lane between two undistorted lines (N, 2) gets over 30 m: 0 where they are parallel.

        NaN where fewer than two points of a line are on the road.
        """
        slopes = []
        for points in (left_px, right_px):
            x, y = self.road_from_points(points).T
            seen = np.isfinite(x)
            if len(np.unique(y[seen])) < 2:
                return math.nan
            slopes.append(np.polyfit(y[seen], x[seen], 1)[0])
        return float(30 * (slopes[1] - slopes[0]))

    # ------------------------------------------------------------------ pictures
    @cached_property
    def view_from_image(self) -> np.ndarray:
        """Homography (3, 3) from undistorted pixels to pixels of the bird's-eye picture."""
        return owned(np.linalg.inv(self.grid.road_from_pixel) @ self.road_from_image)

    def warp(self, undistorted, *, flags=cv2.INTER_LINEAR) -> np.ndarray:
        """Undistorted picture or mask to the bird's-eye picture of ``grid`` (black outside)."""
        picture = as_picture(undistorted, self.size_wh, "warp", "use birdseye.scaled")
        return cv2.warpPerspective(picture, self.view_from_image, self.grid.size_wh, flags=flags)

    def unwarp(self, view, *, flags=cv2.INTER_LINEAR) -> np.ndarray:
        """Bird's-eye picture back to the undistorted picture (black outside the grid)."""
        view = as_picture(view, self.grid.size_wh, "unwarp", "give a picture of its grid")
        return cv2.warpPerspective(view, np.linalg.inv(self.view_from_image), self.size_wh, flags=flags)

    def table(self, camera: Camera, grid: Grid | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Fixed-point maps for ``cv2.remap`` straight from the frame as given to a bird's-eye picture of ``grid``.

        Distortion and homography in one look-up: for every (row, column) of the grid, road to undistorted pixel to
        pixel as given. Points that the camera cannot see read black.
        """
        grid = grid or self.grid
        x, y = np.meshgrid(grid.x_m, grid.y_m)
        pixels = camera.distort_points(self.points_from_road(np.column_stack([x.ravel(), y.ravel()])))
        pixels = np.where(np.isfinite(pixels), pixels, UNSEEN_PX).reshape(*x.shape, 2).astype(np.float32)
        return cv2.convertMaps(pixels[..., 0], pixels[..., 1], cv2.CV_16SC2)


def _check_length(metres, name: str) -> None:
    if not 0 < metres < math.inf:
        raise LanelibError(f"{name} must be positive metres, found {metres}")


def angles_from_vanishing_point(camera_matrix, vanishing_px, *, roll_deg=0.0) -> tuple[float, float]:
    """Pitch and yaw in degrees of a camera that sees the road's direction at ``vanishing_px`` (u, v)."""
    direction = np.linalg.inv(camera_matrix) @ (*vanishing_px, 1.0)
    r = math.radians(roll_deg)
    x = math.cos(r) * direction[0] - math.sin(r) * direction[1]
    y = math.sin(r) * direction[0] + math.cos(r) * direction[1]
    # ahead = (0, 1, 0) in road axes is seen at (-sin yaw, -sin pitch cos yaw, cos pitch cos yaw)
    yaw = math.atan2(-x, math.hypot(y, direction[2]))
    return math.degrees(math.atan2(-y, direction[2])), math.degrees(yaw)
