"""Rig: a camera and how it sees the road, in one file; View: a rig made ready for one frame size.

The finder's order warps first: ``View.scan`` takes the raw frame through one look-up table, distortion and homography
together, straight to a small bird's-eye view (301 x 112), so that nothing is ever computed on pixels that no one
looks at.
"""

from __future__ import annotations

import json
import math
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from lanelib.birdseye import BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.channels import yuv420_planes
from lanelib.errors import LanelibError
from lanelib.files import read_text, write_bytes
from lanelib.jointfit import SIDES, JointFit, Points, distance, line_x
from lanelib.lane import Lane
from lanelib.paint import PaintPoints, brightness_of_luma, paint_channels, paint_points, yellow_of_uv

RIG_FORMAT = "lanelib-rig/1"
SCAN_COLUMN_M, SCAN_REACH_M, SCAN_ROWS = 0.05, 7.5, 112  # chosen by accuracy against truth: see notebook 07
# What lies between two rows of the scan counts where they are further apart than a Botts' dot is long (4 inches), and
# where it is brighter by more than noise, and the nearest pixel in place of an interpolated one, can make it
DOT_M, SHINING_LEVELS = 0.10, 12
FAR_ROW_M = 10.0  # the farthest scan row is where one pixel of a 1280-wide frame covers 10 m of road
# Lines are reported to 2.5 times the distance of the last paint, three fifths of the way that is left to the horizon in
# the picture, and no farther than 250 m: beyond, a pixel row of a 1280-wide frame covers 40 m of road.
EXTEND, FARTHEST_M = 2.5, 250.0
# While a lane is tracked, only the columns around it are looked at: so far to the sides that the texture beside its
# lines is the same as in the whole view; in steps of columns, so that few different tables are ever made.
AROUND_M, AROUND_STEP, MOST_AROUND = 2.0, 10, 24
AROUND_Y_M = np.array([5.0, 10.0, 20.0, 35.0, 60.0])


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera and how it sees the road: all that the finder must know, and nothing about the road itself.

    Saved as one readable file.
    """

    camera: Camera
    birdseye: BirdsEye
    name: str = "rig"
    notes: str = ""

    @property
    def size_wh(self) -> tuple[int, int]:
        """Width and height of the frames the rig is for, px."""
        return self.camera.size_wh

    @property
    def mounting(self) -> dict:
        """height_m, pitch_deg, yaw_deg, roll_deg of the camera; one's own copy."""
        return dict(self._mounting)

    @cached_property
    def _mounting(self) -> dict:
        return self.birdseye.mounting(self.camera)

    @cached_property
    def near_m(self) -> float:
        """Distance of the road that the middle of the lowest row shows."""
        w, h = self.size_wh
        return float(self.birdseye.road_from_points(self.camera.undistort_points([[(w - 1) / 2, h - 1.0]]))[0, 1])

    @cached_property
    def scan_grid(self) -> Grid:
        """The small bird's-eye view the finder works on: 5 cm columns; rows closer together far away, where they
        are worth more: equal steps of 1/sqrt(y), between equal metres and equal pixels of the frame."""
        focal_720p = self.camera.camera_matrix[1, 1] * 1280 / self.size_wh[0]
        height_m = self.mounting["height_m"]  # below 0 or NaN where the homography shows a road from underneath
        far = math.sqrt(FAR_ROW_M * focal_720p * height_m) if height_m > 0 else 0.0
        if not 0 < self.near_m < far:
            raise LanelibError(
                f"the rig {self.name!r} sees no road: its lowest row looks {self.near_m:.1f} m ahead; make it again"
            )
        n = int(round(SCAN_REACH_M / SCAN_COLUMN_M))
        rows = np.linspace(1 / math.sqrt(far), 1 / math.sqrt(self.near_m), SCAN_ROWS) ** -2
        return Grid(np.arange(-n, n + 1) * SCAN_COLUMN_M, rows)

    def scaled(self, size_wh) -> Rig:
        """The same rig for another resolution of the same camera; LanelibError where the aspect ratio differs."""
        if tuple(size_wh) == tuple(self.size_wh):
            return self
        return replace(self, camera=self.camera.scaled(size_wh), birdseye=self.birdseye.scaled(size_wh))

    def to_dict(self) -> dict:
        """The file's content (see docs/ARCHITECTURE.md)."""
        return {
            "format": RIG_FORMAT,
            "name": self.name,
            "camera": self.camera.to_dict(),
            "road_from_image": self.birdseye.road_from_image.tolist(),
            "notes": self.notes,
        }

    @classmethod
    def from_dict(cls, numbers: dict) -> Rig:
        """The inverse of ``to_dict``; LanelibError, KeyError, TypeError or ValueError for what is none."""
        camera = Camera.from_dict(numbers["camera"])
        birdseye = BirdsEye(np.array(numbers["road_from_image"], float), camera.size_wh)
        return cls(camera, birdseye, str(numbers.get("name", "rig")), str(numbers.get("notes", "")))

    def save(self, path) -> Path:
        """Write the rig as JSON, completely or not at all; LanelibError where that cannot be."""
        return write_bytes(path, (json.dumps(self.to_dict(), indent=1) + "\n").encode())

    @classmethod
    def load(cls, path) -> Rig:
        """Read a rig file; LanelibError, one line, for anything that is none."""
        path = Path(path)
        try:
            numbers = json.loads(read_text(path))
            if numbers["format"] != RIG_FORMAT:
                raise KeyError(numbers["format"])
            return cls.from_dict(numbers)
        except OSError as error:
            raise LanelibError(f"cannot read the rig {path}: {error.strerror}; make one with `lanelib rig`") from None
        except LanelibError as error:
            raise LanelibError(f"{path}: {error}") from None
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            raise LanelibError(f"{path} is not a rig file ({RIG_FORMAT}); make one with `lanelib rig`") from None


class View:
    """A rig prepared for one frame size: the look-up table and the geometry of the scan grid, computed once."""

    def __init__(self, rig: Rig):
        self.rig, self.grid = rig, rig.scan_grid
        self._around: dict[tuple[int, int], View] = {}
        self._table = rig.birdseye.table(rig.camera, self.grid)
        self._inverse_y = 1 / self.grid.y_m
        self.height_m = rig.mounting["height_m"]
        # in pixels of a 1280-wide frame
        self.focal_px = float(rig.camera.camera_matrix[0, 0] * 1280 / rig.size_wh[0])

    @cached_property
    def _undistorted_table(self):
        camera = self.rig.camera
        return self.rig.birdseye.table(replace(camera, distortion=np.zeros(5)), self.grid)

    @cached_property
    def metric(self) -> BirdsEye:
        """The rig's view of the road as a map with equal steps, as it is shown to people and searched by windows."""
        return replace(
            self.rig.birdseye,
            grid=Grid.uniform(x_range_m=(-6, 6), y_range_m=(max(2.0, self.rig.near_m - 0.5), 40), size_wh=(480, 720)),
        )

    def scan(self, frame: np.ndarray) -> np.ndarray:
        """The small bird's-eye view of a frame as given."""
        return cv2.remap(frame, *self._table, cv2.INTER_LINEAR)

    def scan_undistorted(self, picture: np.ndarray) -> np.ndarray:
        """The same of an undistorted picture or mask."""
        return cv2.remap(picture, *self._undistorted_table, cv2.INTER_LINEAR)

    def paint_channels(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Brightness and yellowness, each (H, W) uint8, of the small bird's-eye view of a frame as given: BGR, or
        YUV420p where 2-D. What shines between two rows of the view is added to the brightness of one of them."""
        if frame.ndim == 2:
            luma, yellow = self._luma_and_yellow(frame)
            return self._with_shining(brightness_of_luma(luma), luma, frame, self._between), yellow
        scan = self.scan(frame)
        brightness, yellow = paint_channels(scan)
        return self._with_shining(brightness, cv2.extractChannel(scan, 1), frame, self._between_green), yellow

    def _luma_and_yellow(self, frame_yuv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The planes' part below the horizon makes one plane of yellow, and that is warped: one look-up less."""
        y, u, v = yuv420_planes(frame_yuv)
        luma = cv2.remap(y, *self._table, cv2.INTER_LINEAR)
        first, half_table = self._half_table
        return luma, cv2.remap(yellow_of_uv(u[first:], v[first:]), *half_table, cv2.INTER_LINEAR)

    def _with_shining(self, brightness: np.ndarray, scan: np.ndarray, frame: np.ndarray, between) -> np.ndarray:
        """``brightness`` (H, W), raised by as much as the ``frame`` half way to the next row is brighter than the
        ``scan`` (H, W): a Botts' dot may be seen there and nowhere else."""
        at, noise = between
        if len(noise):
            shining = cv2.subtract(cv2.subtract(frame.reshape(-1).take(at), noise), scan[: len(noise)])
            cv2.add(brightness[: len(noise)], shining, dst=brightness[: len(noise)])
        return brightness

    @cached_property
    def _between(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the R rows that are further apart than ``DOT_M``, the points half way to the next one.

        Where in a plane of the frame, as one long row, they lie, (R, W); and by how many grey levels they may be
        brighter, (R, W) uint8: by all where the frame does not show them.
        """
        width, height = self.rig.size_wh
        apart_m = -np.gradient(self.grid.y_m)
        rows = np.count_nonzero(apart_m > DOT_M)  # the farthest ones
        half_way_m = self.grid.y_m[:rows] - apart_m[:rows] / 2
        if rows < 2 or (np.diff(half_way_m) >= 0).any():  # a picture of next to nothing, or of 1e16 m of road
            return np.empty((0, len(self.grid.x_m)), np.intp), np.empty((0, len(self.grid.x_m)), np.uint8)
        pixels, _ = self.rig.birdseye.table(self.rig.camera, Grid(self.grid.x_m, half_way_m))
        x, y = np.moveaxis(pixels.astype(np.intp), -1, 0)
        seen = (self._table[0][:rows, :, 0] >= 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
        return np.where(seen, y * width + x, 0), np.where(seen, SHINING_LEVELS, 255).astype(np.uint8)

    @cached_property
    def _between_green(self) -> tuple[np.ndarray, np.ndarray]:
        """The same in the green of BGR frames."""
        at, noise = self._between
        return 3 * at + 1, noise

    @cached_property
    def first_row(self) -> int:
        """The first row of a YUV420p frame that is looked at (even): what lies above need not be read."""
        (width, height), (at, noise) = self.rig.size_wh, self._between
        rows = self._table[0][..., 1]
        first = min(rows[rows >= 0].min(initial=height - 2), at[noise < 255].min(initial=height * width) // width)
        return min(int(first) // 2 * 2, 2 * self._half_table[0])

    @cached_property
    def _half_table(self):
        """For planes of half the size: the first row that is needed, and the look-up table from there.

        (MPEG-2 siting is half a pixel off sideways: 3 mm on the road.)
        """
        width, height = self.rig.size_wh
        half = self.rig.scaled((width // 2, height // 2))
        pixels, parts = half.birdseye.table(half.camera, self.grid)
        rows = pixels[..., 1]
        first = int(rows[rows >= 0].min(initial=half.size_wh[1] - 1))
        return first, (pixels - np.array([0, first], np.int16), parts)

    def around(self, mean: np.ndarray) -> View:
        """The same view, but only of the columns around the lane ``mean`` (7,): what tracking needs to look at."""
        y = distance(1 / AROUND_Y_M, mean, self.height_m)
        x = line_x(y, mean, SIDES) / y * AROUND_Y_M  # where the lines appear on the rig's flat plane
        low, high = self.grid.column_of([x.min() - AROUND_M, x.max() + AROUND_M]) / AROUND_STEP
        low, high = max(math.floor(low), 0) * AROUND_STEP, min(math.ceil(high) * AROUND_STEP, len(self.grid.x_m))
        if high - low < 2 * AROUND_M / SCAN_COLUMN_M or high - low == len(self.grid.x_m):
            return self
        if (low, high) not in self._around:
            if len(self._around) >= MOST_AROUND:
                self._around.clear()
            self._around[low, high] = self._columns(slice(low, high))
        return self._around[low, high]

    def _columns(self, columns: slice) -> View:
        def part(table):
            return tuple(np.ascontiguousarray(of_all[:, columns]) for of_all in table)

        view = copy(self)
        view.grid = Grid(self.grid.x_m[columns], self.grid.y_m)
        view._table = part(self._table)
        made = vars(view)  # what was made on demand so far; the rest will be, of these columns
        if "_half_table" in made:
            view._half_table = self._half_table[0], part(self._half_table[1])
        for name in ("_between", "_between_green"):
            if name in made:
                made[name] = part(made[name])
        made.pop("_undistorted_table", None)
        return view

    def points(self, paint: PaintPoints) -> Points:
        """Paint points of a scan as the joint fit wants them."""
        inverse = self._inverse_y[paint.row]
        bearing, n_rows = self.grid.x_of(paint.column) * inverse, len(self.grid.y_m)
        return Points(bearing, inverse, paint.row, paint.weight, self.focal_px, self.height_m, n_rows)

    def points_of_mask(self, mask: np.ndarray) -> Points:
        """Points of a 0/255 mask on the scan grid: the middles of what is white."""
        # not a box filter: its flat top has no crest, and its left end is half a column off
        z = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigmaX=1.2, sigmaY=1.0) * (6.0 / 255)
        return self.points(paint_points(z))

    def lane(self, fit: JointFit) -> Lane:
        """A fit as two lines in metres."""
        return fit.lane(self.rig.near_m, self.grid.y_m)

    def lines_px(self, lane: Lane, *, count: int = 48) -> tuple[np.ndarray, np.ndarray]:
        """Both lines in pixels of the frame as given, from the lower edge to where the lane is known."""
        near, far = 0.8 * self.rig.near_m, min(EXTEND * lane.y_range_m[1], FARTHEST_M)
        y = 1 / np.linspace(1 / near, 1 / max(far, 2 * near), count)
        known = lane.y_range_m[1]
        x = [line.x_continued(y, known) for line in (lane.left, lane.right)]
        flat = lane.surface.flat_from_road(np.column_stack([np.concatenate(x), np.tile(y, 2)]), known_to_m=known)
        pixels = self.rig.camera.distort_points(self.rig.birdseye.points_from_road(flat))
        seen = np.isfinite(pixels[:, 1])
        return pixels[:count][seen[:count]], pixels[count:][seen[count:]]
