"""Two ways to hold a frame, BGR and planar YUV 4:2:0, and the one way to draw on both: polygons and layers.

A `Canvas` is a list of planes: views into the frame's own memory, so what is drawn appears in the frame. A BGR picture is one plane of
three channels; a YUV420p frame has three planes of one channel, two of them at half size. Nothing is converted, and only the
bounding box of what is drawn is touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from lanelib.errors import LanelibError

SHIFT = 4  # OpenCV's fixed-point coordinates: 1/16 px
FADE_STEPS = 16  # a step of opacity then is 2 %: not seen
FARTHEST_PX = 30000  # points farther out are pulled in; OpenCV's integers would wrap around

# Video range ("16..235") of ITU-R BT.601, as COLOR_BGR2YUV_I420 has it; rows Y, U, V; columns B, G, R, 1 (255 at full cover)
YUV_FROM_BGR1 = np.float32([
    [0.0979, 0.5041, 0.2568, 16 / 255],
    [0.4392, -0.2910, -0.1482, 128 / 255],
    [-0.0714, -0.3678, 0.4392, 128 / 255],
])


@dataclass(frozen=True, eq=False)
class Plane:
    """One array of a frame, (h, w) or (h, w, 3), its scale against the frame, and which of the colour's numbers it holds."""

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
        if not (isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.ndim == 3 and frame.shape[2] == 3 and frame.size):
            raise LanelibError(f"a BGR frame (H, W, 3) of uint8 is needed to draw on, found {_found(frame)}; convert it first")
        return cls((Plane(frame, 1.0, slice(0, 3)),), (frame.shape[1], frame.shape[0]))

    @classmethod
    def of_yuv420(cls, frame: np.ndarray) -> Canvas:
        """A frame (H * 3 / 2, W) uint8, planar Y, U, V ("yuv420p", "I420"), H and W even."""
        shape = frame.shape if isinstance(frame, np.ndarray) else ()
        if len(shape) != 2 or frame.dtype != np.uint8 or not frame.size or shape[0] % 3 or shape[1] % 2 \
                or not frame.flags.c_contiguous:
            raise LanelibError(f"a YUV420p frame (H*3/2, W) of uint8 in one piece is needed, found {_found(frame)}; H and W are even")
        height, width = shape[0] * 2 // 3, shape[1]
        u, v = frame[height:].reshape(2, height // 2, width // 2)
        return cls((Plane(frame[:height], 1.0, slice(0, 1)), Plane(u, 0.5, slice(1, 2)), Plane(v, 0.5, slice(2, 3))), (width, height))

    @property
    def is_yuv(self) -> bool:
        """Whether colours must be given as Y, U, V."""
        return len(self.planes) == 3

    def colour(self, bgr) -> tuple[float, ...]:
        """A BGR colour in the numbers of this canvas."""
        return tuple((YUV_FROM_BGR1 @ (*bgr, 255)).tolist()) if self.is_yuv else tuple(bgr)

    def fill(self, polygons: list[np.ndarray], bgr, *, opacity: float = 1.0, fade_rows: tuple[float, float] | None = None) -> None:
        """Fill polygons, each (N, 2) pixels x, y of the frame, with one colour; ``opacity`` 0..1. Edges are smooth.

        ``fade_rows``: the opacity grows from 0 at the first of these rows of the frame to full at the second.
        """
        polygons = [p for p in polygons if len(p) >= 3]
        if not polygons:
            return
        colour = self.colour(bgr)
        for plane in self.planes:
            height, width = plane.pixels.shape[:2]
            # a pixel's centre is at integers: (x + 1/2) scale - 1/2
            scaled = [np.clip((p + 0.5) * plane.scale - 0.5, -FARTHEST_PX, FARTHEST_PX) for p in polygons]
            lowest, highest = np.min([p.min(axis=0) for p in scaled], axis=0), np.max([p.max(axis=0) for p in scaled], axis=0)
            x0, y0 = np.clip(np.floor(lowest).astype(int) - 1, 0, (width, height))
            x1, y1 = np.clip(np.ceil(highest).astype(int) + 2, 0, (width, height))
            room = plane.pixels[y0:y1, x0:x1]
            if room.size == 0:
                continue
            fixed = [np.round((p - (x0, y0)) * (1 << SHIFT)).astype(np.int32) for p in scaled]
            if opacity >= 1:
                for polygon in fixed:
                    cv2.fillPoly(room, [polygon], colour[plane.channels], cv2.LINE_AA, SHIFT)
                continue
            filled = room.copy()
            for polygon in fixed:  # one by one: together, overlapping polygons would cancel
                cv2.fillPoly(filled, [polygon], colour[plane.channels], cv2.LINE_AA, SHIFT)
            for rows, part in _bands(y0, y1, plane.scale, fade_rows):
                cv2.addWeighted(filled[rows], opacity * part, room[rows], 1 - opacity * part, 0, dst=room[rows])

    def lay(self, layer: Layer, xy: tuple[int, int]) -> None:
        """Lay a layer with its upper left pixel at ``xy`` (even numbers, 0 and more); what does not fit is cut off."""
        parts = layer.yuv if self.is_yuv else layer.bgr
        for plane, (colour, clear) in zip(self.planes, parts, strict=True):
            below = plane.pixels[int(xy[1] * plane.scale) :, int(xy[0] * plane.scale) :][: colour.shape[0], : colour.shape[1]]
            if below.size:
                h, w = below.shape[:2]
                through = cv2.multiply(below, clear[:h, :w], scale=1 / 255)
                cv2.add(through, colour[:h, :w], dst=below)


class Layer:
    """A small picture to be laid over a frame: ``pixels`` (h, w, 4) uint8, BGR already multiplied with the coverage, and the coverage
    0..255. What each kind of canvas needs of it is worked out once."""

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
        for row, picture in zip(YUV_FROM_BGR1, (even, half, half), strict=True):
            parts.append((cv2.transform(picture, row[None]), cv2.bitwise_not(cv2.extractChannel(picture, 3))))
        return parts


def _bands(y0: int, y1: int, scale: float, fade_rows) -> list[tuple[slice, float]]:
    """Rows y0 to y1 of a plane as slices from y0, each with its share of the opacity: in steps where it fades, the rest in one."""
    if fade_rows is None:
        return [(slice(0, y1 - y0), 1.0)]
    edges = np.clip(np.linspace(*fade_rows, FADE_STEPS + 1) * scale, y0, y1).round().astype(int) - y0
    parts = [((i + 0.5) / FADE_STEPS, a, b) for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True))]
    parts.append((1.0, edges[-1], y1 - y0))
    return [(slice(int(a), int(b)), share) for share, a, b in parts if b > a]


def _found(frame) -> str:
    return f"shape {frame.shape}, {frame.dtype}" if isinstance(frame, np.ndarray) else type(frame).__name__
