"""The camera: a pinhole and a lens, for pictures and for points, both ways.

A point (X, Y, Z) in camera axes (x right, y down, z forward) lies at x = X/Z, y = Y/Z; the lens moves it to (x_d, y_d)
(`lanelib.distortion`); its pixel in the frame as given is u = fx x_d + cx, v = fy y_d + cy. "Undistorted" pixels are
fx x + cx, fy y + cy: the same camera matrix, no lens.
"""

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from lanelib.arrays import as_picture, as_points, as_size_wh, in_short, owned
from lanelib.distortion import distort, fold_radius, undistort
from lanelib.errors import LanelibError
from lanelib.files import read_text, write_bytes

FORMAT = "lanelib-camera/1"
INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
MAX_DISTORTION = 1e6  # folds the picture within a pixel of its centre; beyond, floating point overflows
ASPECT_TOLERANCE = 0.005  # 1281x721 is the camera of 1280x720 (0.06 %), a 4:3 picture of a 16:9 camera is a crop (33 %)


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """A calibrated camera.

    Parameters
    ----------
    camera_matrix : ndarray of shape (3, 3), float64, pixels: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; centres at integers
    distortion : ndarray of shape (5,), float64: k1, k2, p1, p2, k3
    size_wh : width and height of the pictures in pixels
    rms_px : root-mean-square reprojection error of the calibration, of each corner's distance (both axes), where known
    std : standard deviations of the intrinsics by name (fx, fy, cx, cy in pixels; k1, k2, p1, p2, k3), where known

    Raises
    ------
    LanelibError : a shape, a number or the size makes no camera
    """

    camera_matrix: np.ndarray
    distortion: np.ndarray
    size_wh: tuple[int, int]
    rms_px: float | None = None
    std: dict[str, float] | None = None

    def __post_init__(self):
        matrix = _numbers(self.camera_matrix, (3, 3), "camera_matrix")
        distortion = _numbers(self.distortion, (5,), "distortion (k1, k2, p1, p2, k3)")
        if np.abs(distortion).max() > MAX_DISTORTION:
            found = in_short(distortion.tolist())
            raise LanelibError(f"camera: need a distortion within +-{MAX_DISTORTION:g}, found {found}; calibrate again")
        fx, fy = matrix[0, 0], matrix[1, 1]
        if fx <= 0 or fy <= 0 or matrix[0, 1] != 0 or matrix[1, 0] != 0 or (matrix[2] != (0, 0, 1)).any():
            raise LanelibError(
                f"camera: need a camera_matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found {in_short(matrix.tolist())}"
            )
        object.__setattr__(self, "camera_matrix", matrix)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "size_wh", as_size_wh(self.size_wh, "camera"))
        if self.rms_px is not None:
            object.__setattr__(self, "rms_px", float(_numbers(self.rms_px, (), "rms_px")))
        if self.std is not None:
            if not isinstance(self.std, dict) or not set(self.std) <= set(INTRINSICS):
                raise LanelibError(f"camera: need std by the names {', '.join(INTRINSICS)}, found {in_short(self.std)}")
            std = {name: float(_numbers(value, (), f"std of {name}")) for name, value in self.std.items()}
            object.__setattr__(self, "std", std)

    def __repr__(self) -> str:
        width, height = self.size_wh
        fx, fy, cx, cy = self._intrinsics
        lens = f"k1 {self.distortion[0]:+.3f}" if self.distortion.any() else "no distortion"
        rms = "" if self.rms_px is None else f", rms {self.rms_px:.2f} px"
        return f"Camera {width}x{height}: focal length {fx:.1f} x {fy:.1f} px, centre ({cx:.1f}, {cy:.1f}), {lens}{rms}"

    @classmethod
    def ideal(cls, size_wh, *, hfov_deg: float | None = None, focal_px: float | None = None) -> "Camera":
        """A camera without distortion, its centre in the middle; give the horizontal field of view or the focal length.

        The field of view reaches from the left edge of the first pixel to the right edge of the last.
        """
        width, height = as_size_wh(size_wh, "camera")
        if (hfov_deg is None) == (focal_px is None) or (hfov_deg is not None and not 0 < hfov_deg < 180):
            raise LanelibError(
                f"camera: need either hfov_deg (between 0 and 180) or focal_px, found {hfov_deg} and {focal_px}"
            )
        if hfov_deg is not None:
            focal_px = width / 2 / math.tan(math.radians(hfov_deg) / 2)
        matrix = [[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]]
        return cls(_numbers(matrix, (3, 3), "camera_matrix"), np.zeros(5), size_wh)

    # Pictures

    def undistort(self, frame: np.ndarray) -> np.ndarray:
        """The picture a lens without distortion would have made: same size, same camera matrix, black where unseen.

        Parameters
        ----------
        frame : ndarray of shape (H, W, 3) BGR or (H, W), uint8, of this camera's size

        Raises
        ------
        LanelibError : the frame has another size (use `scaled`), or numbers that make no picture
        """
        frame = as_picture(np.asarray(frame), self.size_wh, "undistort", "use camera.scaled")
        if not self.distortion.any():
            return frame.copy()
        return cv2.remap(frame, *self._maps, cv2.INTER_LINEAR)

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Where each undistorted pixel comes from, in fixed point (1/32 px: enough for pictures, not for geometry)."""
        return cv2.initUndistortRectifyMap(
            self.camera_matrix, self.distortion, None, self.camera_matrix, self.size_wh, cv2.CV_16SC2
        )

    # Points

    def undistort_points(self, points_px) -> np.ndarray:
        """Pixels of the frame as given -> undistorted pixels, (N, 2) float64 each, to 1e-4 px; NaN where no ray is."""
        xy_d = self._normalised(points_px)
        return self._pixels(undistort(xy_d, self.distortion, r_max=self.fold_radius))

    def distort_points(self, points_px) -> np.ndarray:
        """Undistorted pixels -> pixels of the frame as given, (N, 2) float64 each; NaN beyond the `fold_radius`."""
        return self._pixels(distort(self._normalised(points_px), self.distortion, r_max=self.fold_radius))

    def project(self, points_m) -> np.ndarray:
        """Points (N, 3) in camera axes, metres -> pixels of the frame as given, (N, 2) float64.

        NaN behind the camera and beyond the `fold_radius`.
        """
        points_m = as_points(points_m, 3)
        depth = np.where(points_m[:, 2] > 0, points_m[:, 2], np.nan)
        return self._pixels(distort(points_m[:, :2] / depth[:, None], self.distortion, r_max=self.fold_radius))

    @cached_property
    def fold_radius(self) -> float:
        """Beyond this distance from the axis, in focal lengths, the lens shows nothing (`lanelib.distortion`)."""
        return fold_radius(self.distortion)

    # The same camera elsewhere

    def scaled(self, size_wh) -> "Camera":
        """The same camera with its pictures shrunk or enlarged to `size_wh`.

        The pixel whose centre is at cx covers cx - 0.5 .. cx + 0.5, so that cx' = (cx + 0.5) s - 0.5. Width and height
        may scale apart by 0.5 %, for sizes rounded to whole or even pixels; a crop is another camera.

        Raises
        ------
        LanelibError : the aspect ratio is another
        """
        width, height = self.size_wh
        size_wh = as_size_wh(size_wh, "camera")
        sx, sy = size_wh[0] / width, size_wh[1] / height
        if abs(sx / sy - 1) > ASPECT_TOLERANCE:
            raise LanelibError(
                f"camera: need pictures in the proportions of {width}x{height}, found {size_wh[0]}x{size_wh[1]}; "
                "use pictures as the camera gives them, not cropped or stretched"
            )
        fx, fy, cx, cy = self._intrinsics
        matrix = [[fx * sx, 0, (cx + 0.5) * sx - 0.5], [0, fy * sy, (cy + 0.5) * sy - 0.5], [0, 0, 1]]
        factor = {"fx": sx, "cx": sx, "fy": sy, "cy": sy}
        std = self.std and {name: value * factor.get(name, 1.0) for name, value in self.std.items()}
        rms_px = None if self.rms_px is None else self.rms_px * math.sqrt(sx * sy)
        return Camera(np.array(matrix), self.distortion, size_wh, rms_px, std)

    def to_dict(self) -> dict:
        """The camera as plain numbers, ready for JSON; `from_dict` is the way back."""
        numbers = {
            "format": FORMAT,
            "size_wh": list(self.size_wh),
            "camera_matrix": self.camera_matrix.tolist(),
            "distortion": self.distortion.tolist(),
        }
        if self.rms_px is not None:
            numbers["rms_px"] = self.rms_px
        if self.std is not None:
            numbers["std"] = dict(self.std)
        return numbers

    @classmethod
    def from_dict(cls, numbers) -> "Camera":
        """A camera from `to_dict` or a parsed calibration file; keys it does not know (such as boards) are left alone.

        Raises
        ------
        LanelibError : another format, or a number is missing or wrong
        """
        if not isinstance(numbers, dict) or numbers.get("format") != FORMAT:
            found = numbers.get("format", "no format") if isinstance(numbers, dict) else type(numbers).__name__
            raise LanelibError(f"camera: need the format {FORMAT!r}, found {in_short(found)}; use `lanelib calibrate`")
        missing = [key for key in ("size_wh", "camera_matrix", "distortion") if key not in numbers]
        if missing:
            raise LanelibError(f"camera: need {', '.join(missing)}, found none; use `lanelib calibrate`")
        size_wh = numbers["size_wh"]
        size_wh = tuple(size_wh) if isinstance(size_wh, list) else size_wh
        return cls(numbers["camera_matrix"], numbers["distortion"], size_wh, numbers.get("rms_px"), numbers.get("std"))

    def save(self, path) -> Path:
        """Write the camera as JSON, completely or not at all."""
        return write_bytes(path, (json.dumps(self.to_dict(), indent=1) + "\n").encode())

    @classmethod
    def load(cls, path) -> "Camera":
        """Read a calibration file.

        Raises
        ------
        LanelibError : missing, unreadable, not JSON, or not a camera
        """
        try:
            numbers = json.loads(read_text(path))
        except FileNotFoundError:
            raise LanelibError(f"{path}: need a calibration file, found none; use `lanelib calibrate`") from None
        except OSError as error:
            raise LanelibError(f"{path}: need a calibration file, found: {error.strerror or error}") from None
        except (ValueError, RecursionError):
            raise LanelibError(f"{path}: need a calibration file, found no JSON; use `lanelib calibrate`") from None
        try:
            return cls.from_dict(numbers)
        except LanelibError as error:
            raise LanelibError(f"{path}: {error}") from None

    # Inside

    @property
    def _intrinsics(self) -> tuple[float, float, float, float]:
        matrix = self.camera_matrix
        return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])

    def _normalised(self, points_px) -> np.ndarray:
        fx, fy, cx, cy = self._intrinsics
        return (as_points(points_px, 2) - (cx, cy)) / (fx, fy)

    def _pixels(self, xy: np.ndarray) -> np.ndarray:
        fx, fy, cx, cy = self._intrinsics
        return xy * (fx, fy) + (cx, cy)


def _numbers(value, shape: tuple[int, ...], what: str) -> np.ndarray:
    """A read-only float64 copy of that shape with finite numbers."""
    try:
        array = owned(value)
    except (TypeError, ValueError, OverflowError):
        raise LanelibError(f"camera: need {what} as {shape or 'one'} numbers, found {in_short(value)}") from None
    if array.shape != shape:
        raise LanelibError(f"camera: need {what} of shape {shape}, found {array.shape}")
    if not np.isfinite(array).all():
        raise LanelibError(f"camera: need {what} finite, found {in_short(array.tolist())}")
    return array
