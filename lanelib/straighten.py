"""The road straightened along the ego lane: what runs beside it becomes a column.

One column for each distance d across the road from the ego lane's centre, one row for each distance ahead. Every line
of the road is upright in it, however the road bends, and what is not parallel to the road (cars, shadows, skid marks)
is not. It reaches as far to the sides as it is asked to and bends with the road; the finder's own bird's-eye view ends
7.5 m beside the car.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanelib.birdseye import UNSEEN_PX
from lanelib.channels import yuv420_planes
from lanelib.jointfit import BEND, CENTRE, HEADING, LOCATION_STD_M, LOCATION_STD_PX, RATE, JointFit, distance
from lanelib.paint import brightness_of_luma, evidence_of, paint_channels, paint_points, yellow_of_uv
from lanelib.rig import View

COLUMN_M = 0.05  # as in the finder's own view
NODE = 10  # columns between exact positions; half a metre in between is straight in the frame to a pixel
FAR_M = 60.0  # beyond, a pixel of a 1280-wide frame covers 2.5 m of road and more, nearly a dash


@dataclass(frozen=True, eq=False)
class Straightened:
    """The road straightened along the ego lane. ``d_m`` (W,) across, ``y_m`` (H,) ahead, far to near; ``map_x``,
    ``map_y`` (H, W) float32: the pixel of the frame that shows it; ``inside`` (H, W) bool: it is in the frame."""

    d_m: np.ndarray
    y_m: np.ndarray
    map_x: np.ndarray
    map_y: np.ndarray
    inside: np.ndarray

    def picture(self, frame: np.ndarray) -> np.ndarray:
        """``frame`` straightened; its border is prolonged, so that it is no edge."""
        return cv2.remap(frame, self.map_x, self.map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def along(self, picture: np.ndarray, d_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Values (N, K) of a straightened ``picture`` at ``d_m`` (N, K) of ``rows`` (N,), between columns linearly."""
        column = np.clip((d_m - self.d_m[0]) / COLUMN_M, 0, len(self.d_m) - 1.001)
        low = column.astype(int)
        left, right = picture[rows[:, None], low], picture[rows[:, None], low + 1]
        return left + (column - low) * (right.astype(np.float32) - left)

    def pixels(self, d_m: np.ndarray) -> np.ndarray:
        """(N, 2) pixels of the frame, near to far, of the line at ``d_m`` (H,), where it is in the frame."""
        rows = np.arange(len(d_m))
        x, y, inside = (self.along(m, d_m[:, None], rows)[:, 0] for m in (self.map_x, self.map_y, self.inside * 1.0))
        return np.column_stack([x, y])[inside > 0.999][::-1].astype(float)


def straightened(view: View, fit: JointFit, *, reach_m: float, far_m: float = FAR_M) -> Straightened:
    """The table of the straightened road ``reach_m`` to both sides of the ego lane's centre, as far as ``far_m``; its
    rows are the last ones of the view's grid.

    The point at d beside the centre line xc lies at x = xc(y) + d sqrt(1 + xc'(y)^2), as in ``jointfit``.
    """
    y0, mean = view.grid.y_m, fit.mean
    y = distance(1 / y0, mean, fit.height_m)
    y0, y = y0[y < far_m], y[y < far_m]
    n = NODE * int(np.ceil(reach_m / COLUMN_M / NODE))
    columns = np.arange(-n, n + 1)
    nodes = columns[::NODE] * COLUMN_M
    slope = mean[HEADING] + y * (2 * mean[BEND] + 3 * y * mean[RATE])
    centre = mean[CENTRE] + y * (mean[HEADING] + y * (mean[BEND] + y * mean[RATE]))
    x = centre[:, None] + nodes * np.sqrt(1 + slope * slope)[:, None]
    flat = np.stack([x * (y0 / y)[:, None], np.broadcast_to(y0[:, None], x.shape)], axis=-1).reshape(-1, 2)
    pixels = view.rig.camera.distort_points(view.rig.birdseye.points_from_road(flat))
    pixels = np.where(np.isfinite(pixels), pixels, UNSEEN_PX).reshape(*x.shape, 2)
    node = np.minimum((columns + n) // NODE, len(nodes) - 2)
    part = (columns + n - NODE * node)[:, None] / NODE
    between = pixels[:, node] * (1 - part) + pixels[:, node + 1] * part
    map_x, map_y = (np.ascontiguousarray(between[..., i], np.float32) for i in (0, 1))
    width, height = view.rig.size_wh
    inside = (map_x > 0) & (map_x < width - 1) & (map_y > 0) & (map_y < height - 1)
    return Straightened(columns * COLUMN_M, y, map_x, map_y, inside)


@dataclass(frozen=True, eq=False)
class Paint:
    """What is on the straightened ``road``: its brightness and yellowness, (H, W) uint8, and the paint points, (N,)
    each: place ``d_m``, ``y_m``, standard deviation across, weight 0..1, row."""

    road: Straightened
    brightness: np.ndarray
    yellow: np.ndarray
    d_m: np.ndarray
    y_m: np.ndarray
    std_m: np.ndarray
    weight: np.ndarray
    row: np.ndarray

    def beyond(self, side: int, inner_m: float) -> Paint:
        """The points beyond ``inner_m`` to one side."""
        on = side * self.d_m > inner_m
        chosen = (self.d_m, self.y_m, self.std_m, self.weight, self.row)
        return Paint(self.road, self.brightness, self.yellow, *(array[on] for array in chosen))


def paint_of(frame: np.ndarray, road: Straightened, focal_px: float) -> Paint:
    """Paint on the straightened ``frame``, BGR, or YUV420p where 2-D."""
    if frame.ndim == 3:
        brightness, yellow = paint_channels(road.picture(frame))
    else:
        luma, u, v = yuv420_planes(frame)
        # pixel centres are at integers, in planes of half the size, too
        half = replace(road, map_x=road.map_x / 2 - np.float32(0.25), map_y=road.map_y / 2 - np.float32(0.25))
        brightness, yellow = brightness_of_luma(road.picture(luma)), yellow_of_uv(half.picture(u), half.picture(v))
    z = evidence_of(brightness, yellow, column_m=COLUMN_M)
    z[~road.inside] = 0
    points = paint_points(z)
    d, y = road.d_m[0] + points.column * COLUMN_M, road.y_m[points.row]
    std = np.sqrt((LOCATION_STD_PX * y / focal_px) ** 2 + LOCATION_STD_M**2)
    return Paint(road, brightness, yellow, d, y, std, points.weight, points.row)
