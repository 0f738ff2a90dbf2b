"""What makes paint paint: a ridge of known width, brighter or yellower than the road on both sides.

A lane line is a stripe 0.10-0.15 m wide (US Manual on Uniform Traffic Control Devices, sec. 3A.06: 4 to 6 inches).
Seams, shadow edges and barriers are steps: one side is as bright as the middle. So the response at a pixel is

    ridge = middle - max(left side, right side)            (a dark seam gives less than 0, a step gives 0)

with box means of the paint's width, and it counts only as far as it stands out from the texture around it:

    z = ridge / (texture + floor),    texture = local mean of |middle - mean of both sides|

so that a faint line under a bridge weighs as much as a bright one in the sun. All on a bird's-eye picture, where the
paint's width in pixels is the same near and far.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanelib.channels import as_bgr, one_channel

PAINT_WIDTH_M = 0.15  # the middle box; 4-6 inch paint, blurred by the lens
TEXTURE_SIZE_M = 3.0  # the texture is averaged over this width: most of a lane, so that one line in it counts little
TEXTURE_ROWS = 7
FLOOR_GREY_LEVELS = 2.0  # quantisation and sensor noise: contrasts below this are not trusted
WEAK_Z, STRONG_Z = 1.5, 4.5  # a point weighs 0 at the first and 1 at the second; noise alone seldom passes 1.5


@dataclass(frozen=True)
class PaintPoints:
    """Ridge crests of a bird's-eye picture, row by row.

    ``row`` (N,) int, ``column`` (N,) float (sub-pixel), ``weight`` (N,) in 0..1.
    """

    row: np.ndarray
    column: np.ndarray
    weight: np.ndarray

    def __len__(self):
        return len(self.row)


def paint_channels(bgr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Brightness and yellowness of a (H, W, 3) uint8 BGR picture, each (H, W) uint8.

    Brightness is the plain mean: where an over-exposed road has burnt out in red, blue still tells white paint from
    it. Yellow paint on pale concrete is no brighter than the concrete; it stands out only in (R + G) / 2 - B.
    """
    blue, green, red = cv2.split(as_bgr(bgr))
    warm = cv2.addWeighted(red, 0.5, green, 0.5, 0)
    return cv2.addWeighted(warm, 2 / 3, blue, 1 / 3, 0), cv2.subtract(warm, blue)


def ridge_response(channel: np.ndarray, *, column_m: float = 0.05, rows: int | None = None) -> np.ndarray:
    """Normalised ridge response z >= 0, (H, W) float32, of one channel (H, W) uint8 of a bird's-eye picture.

    ``column_m``: metres per column. Two stripes are tried, a single line and one a little over twice as wide (two
    lines and their gap, seen as one from afar); the better one counts. Columns too close to the picture's border
    read 0.
    ``rows``: of each picture, where several stand below each other. Sums of integers throughout: exact, and several
    times faster than floating point (where paint is wider than 42 columns, of floats, which hold such integers).
    """
    width = max(3, round(PAINT_WIDTH_M / column_m) | 1)  # odd: an even box shifts the line by half a pixel
    near, far = width + 1, 2 * width + 1  # columns from the middle of the line to the middle of the road beside it
    step = width // 2 + 1
    inside = one_channel(channel).shape[1] - 2 * far
    z = np.zeros(channel.shape, np.float32)
    if inside < 1:
        return z
    depth = cv2.CV_16S if 3 * 255 * width <= np.iinfo(np.int16).max else cv2.CV_32F
    sums = cv2.boxFilter(channel, depth, (width, 1), normalize=False, borderType=cv2.BORDER_REPLICATE)

    def at(columns: int) -> np.ndarray:
        return sums[:, far + columns : far + columns + inside]

    middle, left, right = at(0), at(-near), at(near)
    ridge = cv2.subtract(middle, cv2.max(left, right))
    wide = cv2.add(cv2.add(at(-step), middle), at(step))  # the sum of three boxes that overlap by a column
    wide = cv2.addWeighted(wide, 1 / 3, cv2.max(at(-far), at(far)), -1, 0)
    texture = cv2.absdiff(cv2.add(middle, middle), cv2.add(left, right))  # twice |middle - mean of both sides|
    size = (round(TEXTURE_SIZE_M / column_m) | 1, TEXTURE_ROWS)
    every = range(0, len(texture), rows or len(texture))
    textures = [cv2.boxFilter(texture[i : i + every.step], cv2.CV_32F, size, normalize=False) for i in every]
    texture = np.concatenate(textures) if len(textures) > 1 else textures[0]
    scale = 1 / (2 * size[0] * size[1])
    texture = cv2.addWeighted(texture, scale, texture, 0, FLOOR_GREY_LEVELS * width)
    cv2.divide(cv2.max(cv2.max(ridge, wide), 0.0), texture, z[:, far : far + inside], 1.0, cv2.CV_32F)
    return z


def brightness_of_luma(luma: np.ndarray) -> np.ndarray:
    """Brightness from the Y plane (H, W) uint8 of a video frame (limited range, ITU-R BT.601), for greys the same as
    that of ``paint_channels``; yellow paint is brighter in it, and seen in either."""
    return cv2.addWeighted(luma, 1.164, luma, 0, -1.164 * 16)


def yellow_of_uv(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The same yellowness from the planes U and V, each (H, W) uint8.

    R = Y + 1.402 V, G = Y - 0.344 U - 0.714 V, B = Y + 1.772 U give (R + G) / 2 - B = 0.344 V - 1.944 U, here times
    255 / 224.
    """
    return cv2.addWeighted(v, 0.392, u, -2.213, (2.213 - 0.392) * 128)


def paint_evidence(view_bgr: np.ndarray, *, column_m: float = 0.05) -> np.ndarray:
    """z of brightness or yellow, whichever is larger, smoothed over 3 x 3, (H, W) float32. ``view_bgr``: (H, W, 3)
    uint8 bird's-eye picture."""
    return evidence_of(*paint_channels(view_bgr), column_m=column_m)


def evidence_of(brightness: np.ndarray, yellow: np.ndarray, *, column_m: float = 0.05) -> np.ndarray:
    """``paint_evidence`` of the two channels, each (H, W) uint8."""
    rows = len(brightness)
    z = ridge_response(np.concatenate([brightness, yellow]), column_m=column_m, rows=rows)
    z = cv2.max(z[:rows], z[rows:])
    return cv2.blur(z, (3, 3))


def weight_of(z: np.ndarray) -> np.ndarray:
    """Weight 0..1 of a normalised response."""
    return np.minimum(np.maximum((z - WEAK_Z) / (STRONG_Z - WEAK_Z), 0), 1)


def paint_points(z: np.ndarray) -> PaintPoints:
    """Crests of the response (H, W): local maxima along each row, located by the parabola through three pixels."""
    strong = one_channel(z) > WEAK_Z
    strong[:, 0] = strong[:, -1] = False  # a crest has a neighbour on both sides
    at, flat = np.flatnonzero(strong), z.ravel() if z.dtype.kind == "f" else z.ravel().astype(np.float32)
    before, here, after = flat[at - 1], flat[at], flat[at + 1]
    crest = np.flatnonzero((here > before) & (here >= after))  # of two equal neighbours the left one
    at, before, here, after = at[crest], before[crest], here[crest], after[crest]
    shift = 0.5 * (before - after) / ((before - here) + (after - here))  # never more than half a pixel
    row, column = np.divmod(at, z.shape[1])
    return PaintPoints(row, column + shift, weight_of(here))
