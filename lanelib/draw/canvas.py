"""Two ways to hold a frame, BGR and planar YUV 4:2:0, and the one way to draw on both: polygons and layers.

A `Canvas` is a list of planes: views into the frame's own memory, so what is drawn appears in the frame. A BGR picture
is one plane of three channels; a YUV420p frame has three planes of one channel, two of them at half size. Nothing is
converted, and only the bounding box of what is drawn is touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from lanelib.arrays import described
from lanelib.channels import yuv420_planes
from lanelib.errors import LanelibError

SHIFT = 4  # OpenCV's fixed-point coordinates: 1/16 px ...
ONE = 1 << SHIFT  # ... and a whole one
FADE_STEPS, ROWS_PER_STEP = 12, 6  # a step of a lane's opacity then is 3 %: not seen
FARTHEST_PX = 30000  # points farther out are pulled in; OpenCV's integers would wrap around

# Video range (16..235) of ITU-R BT.601, as COLOR_BGR2YUV_I420 has it. Rows Y, U, V; columns B, G, R and the coverage
YUV_FROM_BGR1 = np.array(
    [
        [0.0979, 0.5041, 0.2568, 16 / 255],
        [0.4392, -0.2910, -0.1482, 128 / 255],
        [-0.0714, -0.3678, 0.4392, 128 / 255],
    ],
    np.float32,
)


@dataclass(frozen=True, eq=False)
class Plane:
    """One array of a frame, (h, w) or (h, w, 3), its scale, and which of a colour's numbers it holds."""

    pixels: np.ndarray
    scale: float
    channels: slice


@dataclass(frozen=True, eq=False)
class Canvas:
    """A frame to draw on, in place. ``size_wh`` in pixels of the frame."""

    planes: tuple[Plane, ...]
    size_wh: tuple[int, int]

    @classmethod
    def of_bgr(cls, frame: np.ndarray) -> Canvas:
        """A frame (H, W, 3) uint8 BGR."""
        fits = isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.ndim == 3 and frame.shape[2] == 3
        if not (fits and frame.size and frame.strides[1:] == (3, 1) and frame.flags.writeable):
            raise LanelibError(
                f"a BGR frame (H, W, 3) of uint8 to write into is needed, found {described(frame)}; draw on a copy"
            )
        return cls((Plane(frame, 1.0, slice(0, 3)),), (frame.shape[1], frame.shape[0]))

    @classmethod
    def of_yuv420(cls, frame: np.ndarray) -> Canvas:
        """A frame (H * 3 / 2, W) uint8, planar Y, U, V ("yuv420p", "I420"), H and W even."""
        fits = isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.ndim == 2 and frame.size > 0
        fits = fits and frame.flags.c_contiguous and frame.flags.writeable
        if not fits or frame.shape[0] % 3 or frame.shape[1] % 2:
            raise LanelibError(
                f"a YUV420p frame (H*3/2, W), uint8 in one piece, is needed, found {described(frame)}; use even H and W"
            )
        y, u, v = yuv420_planes(frame)
        planes = (Plane(y, 1.0, slice(0, 1)), Plane(u, 0.5, slice(1, 2)), Plane(v, 0.5, slice(2, 3)))
        return cls(planes, (y.shape[1], y.shape[0]))

    @property
    def is_yuv(self) -> bool:
        """Whether colours must be given as Y, U, V."""
        return len(self.planes) == 3

    def colour(self, bgr) -> tuple[float, ...]:
        """A BGR colour in the numbers of this canvas."""
        return tuple((YUV_FROM_BGR1 @ (*bgr, 255)).tolist()) if self.is_yuv else tuple(bgr)

    def fill(
        self, polygons: list[np.ndarray], bgr, *, opacity: float = 1.0, fade_rows: tuple[float, float] | None = None
    ) -> None:
        """Fill polygons, each (N, 2) pixels x, y of the frame, with one colour; ``opacity`` 0..1. Edges are smooth.

        ``fade_rows``: the opacity grows from 0 at the first of these rows of the frame to full at the second.
        """
        polygons = [p for p in polygons if len(p) >= 3]
        if not polygons:
            return
        colour = self.colour(bgr)
        for plane in self.planes:
            # a pixel's centre is at integers: (x + 1/2) scale - 1/2
            fixed = [_fixed(p, plane.scale) for p in polygons]
            room, corner = _room(plane.pixels, fixed)
            if room.size == 0:
                continue
            bands = _bands(corner[1], room.shape[0], plane.scale, fade_rows)
            # what must be kept to be mixed in again: all of it, or only the rows that fade
            kept = room.copy() if opacity < 1 else room[: bands[-1][0].start].copy()
            for polygon in fixed:  # one by one: together, overlapping polygons would cancel
                polygon -= np.array(corner, np.int32) << SHIFT
                cv2.fillPoly(room, [polygon], colour[plane.channels], cv2.LINE_AA, SHIFT)
            for rows, share in bands:
                part = opacity * share
                if part < 1:
                    cv2.addWeighted(room[rows], part, kept[rows], 1 - part, 0, dst=room[rows])

    def lay(self, layer: Layer, xy: tuple[int, int]) -> None:
        """Lay a layer with its upper left pixel at ``xy`` (even, 0 and more); what does not fit is cut off."""
        parts = layer.yuv if self.is_yuv else layer.bgr
        for plane, (colour, clear) in zip(self.planes, parts, strict=True):
            x, y = int(xy[0] * plane.scale), int(xy[1] * plane.scale)
            below = plane.pixels[y : y + colour.shape[0], x : x + colour.shape[1]]
            if below.size:
                h, w = below.shape[:2]
                through = cv2.multiply(below, clear[:h, :w], scale=1 / 255)
                cv2.add(through, colour[:h, :w], dst=below)


class Layer:
    """A small picture to be laid over a frame: ``pixels`` (h, w, 4) uint8, premultiplied BGR and the coverage 0..255.

    What each kind of canvas needs of it is worked out once.
    """

    def __init__(self, pixels: np.ndarray):
        self.pixels = pixels
        self.size_wh = (pixels.shape[1], pixels.shape[0])

    @cached_property
    def bgr(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Colour and 255 - coverage, both (h, w, 3)."""
        blue, green, red, cover = cv2.split(self.pixels)
        clear = cv2.bitwise_not(cover)
        return [(cv2.merge([blue, green, red]), cv2.merge([clear] * 3))]

    @cached_property
    def yuv(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The same for the planes Y (h, w), U and V (h / 2, w / 2)."""
        even = cv2.copyMakeBorder(self.pixels, 0, self.size_wh[1] % 2, 0, self.size_wh[0] % 2, cv2.BORDER_CONSTANT)
        half = cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        parts = []
        for row, channels in zip(YUV_FROM_BGR1, (cv2.split(even), *[cv2.split(half)] * 2), strict=True):
            # what adds comes first, so that no sum leaves 0..255 on the way (quicker than cv2.transform)
            (first, a), (second, b), *others = sorted(zip(row.tolist(), channels, strict=True), key=lambda t: -t[0])
            colour = cv2.addWeighted(a, first, b, second, 0)
            for factor, channel in others:
                colour = cv2.addWeighted(colour, 1, channel, factor, 0)
            parts.append((colour, cv2.bitwise_not(channels[3])))
        return parts


def _fixed(polygon: np.ndarray, scale: float) -> np.ndarray:
    """Pixels of the frame to OpenCV's fixed-point pixels of a plane, (N, 2) int32."""
    points = polygon * scale + (scale - 1) / 2
    return np.rint(np.maximum(np.minimum(points, FARTHEST_PX), -FARTHEST_PX) * ONE).astype(np.int32)


def _room(pixels: np.ndarray, fixed: list[np.ndarray]) -> tuple[np.ndarray, tuple[int, int]]:
    """The part of a plane that polygons cover, as a view, and its upper left pixel."""
    points = fixed[0] if len(fixed) == 1 else np.concatenate(fixed)
    low, high = (points.min(axis=0) >> SHIFT) - 1, (points.max(axis=0) >> SHIFT) + 3
    x0, y0 = max(int(low[0]), 0), max(int(low[1]), 0)
    return pixels[y0 : max(int(high[1]), 0), x0 : max(int(high[0]), 0)], (x0, y0)


def _bands(y0: int, n_rows: int, scale: float, fade_rows) -> list[tuple[slice, float]]:
    """Slices of the rows of a part of a plane that begins at row ``y0``, each with its share of the opacity.

    In steps where it fades (none where it does not), then the rest.
    """
    if fade_rows is None:
        return [(slice(0, n_rows), 1.0)]
    first, last = (float(row) * scale - y0 for row in fade_rows)
    steps = max(1, min(int((last - first) / ROWS_PER_STEP), FADE_STEPS))
    bands, begin = [], 0
    for i in range(steps):
        end = min(max(round(first + (i + 1) * (last - first) / steps), 0), n_rows)
        if end > begin:
            bands.append((slice(begin, end), (i + 0.5) / steps))
            begin = end
    return [*bands, (slice(begin, n_rows), 1.0)]
