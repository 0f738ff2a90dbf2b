"""What makes paint paint: a ridge of known width, brighter or yellower than the road on both sides.

A lane line is a stripe 0.10-0.15 m wide (US Manual on Uniform Traffic Control Devices, sec. 3A.06: 4 to 6 inches).
Seams, shadow
edges and barriers are steps: one side is as bright as the middle. So the response at a pixel is

    ridge = middle - max(left side, right side)            (a dark seam gives less than 0, a step gives 0)

with box means of the paint's width, and it counts only as far as it stands out from the texture around it:

    z = ridge / (texture + floor),    texture = local mean of |middle - mean of both sides|

so that a faint line under a bridge weighs as much as a bright one in the sun. All on a bird's-eye picture,
where the paint's width in pixels is the same near and far.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

PAINT_WIDTH_M = 0.15  # the middle box; 4-6 inch paint, blurred by the lens
DOUBLE_WIDTH_M = 0.35  # two 4-inch lines and their gap, seen as one from afar
TEXTURE_SIZE_M = 3.0  # the texture is averaged over this width: most of a lane, so that one line in it counts little
TEXTURE_ROWS = 7
FLOOR_GREY_LEVELS = 2.0  # quantisation and sensor noise: contrasts below this are not trusted
WEAK_Z, STRONG_Z = 1.5, 4.5  # a point weighs 0 at the first and 1 at the second; noise alone seldom passes 1.5


@dataclass(frozen=True)
class PaintPoints:
    """Ridge crests of a bird's-eye picture, row by row.

    ``row`` (N,) int, ``column`` (N,) float (sub-pixel), ``weight`` (N,) in 0..1; ``yellow`` (N,) bool: the
    yellow channel answered more strongly than the brightness.
    """

    row: np.ndarray
    column: np.ndarray
    weight: np.ndarray
    yellow: np.ndarray

    def __len__(self):
        return len(self.row)


def paint_channels(bgr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Brightness and yellowness of a (H, W, 3) uint8 BGR picture, each (H, W) uint8.

    Brightness is the plain mean: where an over-exposed road has burnt out in red, blue still tells white paint
    from it. Yellow paint
    on pale concrete is no brighter than the concrete; it stands out only in (R + G) / 2 - B.
    """
    mix = np.array([[1 / 3, 1 / 3, 1 / 3], [-1, 0.5, 0.5]], np.float32)
    return cv2.split(cv2.transform(bgr, mix))


def _shifted(picture: np.ndarray, columns: int) -> np.ndarray:
    """The picture seen ``columns`` further right (its border repeated)."""
    if columns > 0:
        return cv2.copyMakeBorder(picture[:, columns:], 0, 0, 0, columns, cv2.BORDER_REPLICATE)
    return cv2.copyMakeBorder(picture[:, :columns], 0, 0, -columns, 0, cv2.BORDER_REPLICATE)


def ridge_response(channel: np.ndarray, *, column_m: float = 0.05) -> np.ndarray:
    """Normalised ridge response z (H, W) float32 >= 0 of one channel (H, W) float32 of a bird's-eye picture.

    ``column_m``: metres per column. Two widths are tried, a single line and a double one; the better one counts.
    """
    width = max(3, int(round(PAINT_WIDTH_M / column_m)) | 1)  # odd: an even box shifts the line by half a pixel
    reach = width + 1  # from the middle of the line to the middle of the road beside it, one column apart
    middle = cv2.blur(channel, (width, 1))
    left, right = _shifted(middle, -reach), _shifted(middle, reach)
    ridge = middle - cv2.max(left, right)

    double = max(width + 2, int(round(DOUBLE_WIDTH_M / column_m)) | 1)
    reach = (double + width) // 2 + 2
    wide = cv2.blur(channel, (double, 1)) - cv2.max(_shifted(middle, -reach), _shifted(middle, reach))

    texture = cv2.absdiff(middle, (left + right) * 0.5)
    texture = cv2.blur(texture, (int(round(TEXTURE_SIZE_M / column_m)) | 1, TEXTURE_ROWS))
    return cv2.max(cv2.max(ridge, wide), 0.0) / (texture + FLOOR_GREY_LEVELS)


def paint_evidence(view_bgr: np.ndarray, *, column_m: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """z of brightness or yellow, whichever is larger, and z of yellow alone; both (H, W) float32."""
    brightness, yellow = (channel.astype(np.float32) for channel in paint_channels(view_bgr))
    z_yellow = ridge_response(yellow, column_m=column_m)
    z = cv2.max(ridge_response(brightness, column_m=column_m), z_yellow)
    return cv2.blur(z, (3, 3)), z_yellow


def weight_of(z: np.ndarray) -> np.ndarray:
    """Weight 0..1 of a normalised response."""
    return np.clip((z - WEAK_Z) / (STRONG_Z - WEAK_Z), 0, 1)


def paint_points(z: np.ndarray, z_yellow: np.ndarray | None = None) -> PaintPoints:
    """Crests of the response: local maxima along each row, located by the parabola through three pixels."""
    crest = (z[:, 1:-1] > WEAK_Z) & (z[:, 1:-1] >= z[:, :-2]) & (z[:, 1:-1] > z[:, 2:])
    row, column = np.nonzero(crest)
    column = column + 1
    before, here, after = z[row, column - 1], z[row, column], z[row, column + 1]
    shift = 0.5 * (before - after) / np.minimum(before - 2 * here + after, -1e-6)
    yellow = np.zeros(len(row), bool) if z_yellow is None else z_yellow[row, column] > 0.7 * here
    return PaintPoints(row, column + np.clip(shift, -0.5, 0.5), weight_of(here), yellow)
