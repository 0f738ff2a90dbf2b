"""Thresholding: frame_bgr (H, W, 3) uint8 in, mask (H, W) uint8 0/255 out.

Three classic recipes and the project's own, each a few named steps so that one can look at every mask in between.
The classics compare pixels with fixed numbers; the default asks for the *shape* of paint instead: a stripe of paint's
width, brighter or yellower than the road on both sides, measured against the road's own brightness and texture.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from lanelib.channels import CHANNELS, as_bgr, equalise_lightness, hsv_white, hsv_yellow, in_range, one_channel
from lanelib.errors import LanelibError
from lanelib.paint import PAINT_WIDTH_M, paint_channels, ridge_response

# ---------------------------------------------------------------------------------------------- gradients


@dataclass(frozen=True)
class Gradients:
    """Derivatives of one channel, both (H, W) float32, in grey levels per pixel: x to the right, y down."""

    x: np.ndarray
    y: np.ndarray


def sobel(channel: np.ndarray, *, ksize: int = 3) -> Gradients:
    """Both Sobel derivatives of a channel (H, W) uint8 or float, computed once for all masks that need them.

    `ksize` is odd, 1 to 31 (1: plain central difference). The kernels are scaled so that a ramp of one grey level per
    pixel gives 1 for every ksize; the numbers are float32, so nothing wraps around at 0 or 255.
    """
    if ksize not in range(1, 32, 2):
        raise LanelibError(f"an odd Sobel kernel size from 1 to 31 is needed, found {ksize}; use 3, 5, 7, …")
    values = one_channel(channel).astype(np.float32)
    derive_x, smooth_y = cv2.getDerivKernels(1, 0, ksize, normalize=True)
    smooth_x, derive_y = cv2.getDerivKernels(0, 1, ksize, normalize=True)
    return Gradients(cv2.sepFilter2D(values, cv2.CV_32F, derive_x, smooth_y),
                     cv2.sepFilter2D(values, cv2.CV_32F, smooth_x, derive_y))


def magnitude(gradients: Gradients) -> np.ndarray:
    """sqrt(x² + y²), (H, W) float32, grey levels per pixel."""
    return cv2.magnitude(gradients.x, gradients.y)


def direction(gradients: Gradients) -> np.ndarray:
    """arctan(|y| / |x|), (H, W) float32, 0..π/2: 0 across a vertical edge, π/2 across a level one, 0 where flat."""
    return np.arctan2(np.abs(gradients.y), np.abs(gradients.x))


def scale_to_255(values: np.ndarray) -> np.ndarray:
    """|values| with the largest scaled to 255, as float32 (all zero stays zero).

    The classic way to make gradient thresholds independent of the exposure. Its weakness: one strong edge anywhere in
    the frame, a sign or a car, lowers all others.
    """
    values = np.abs(values).astype(np.float32)
    largest = float(values.max(initial=0.0))
    return values * np.float32(255 / largest) if largest > 0 else values


def abs_sobel_mask(gradients: Gradients, low: float, high: float = 255, *, axis: str = "x") -> np.ndarray:
    """Where the absolute derivative along `axis` ("x" or "y"), scaled to 255, is low..high."""
    if axis not in ("x", "y"):
        raise LanelibError(f"axis 'x' or 'y' is needed, found {axis!r}; lane lines show in 'x'")
    return in_range(scale_to_255(getattr(gradients, axis)), low, high)


def magnitude_mask(gradients: Gradients, low: float, high: float = 255) -> np.ndarray:
    """Where the gradient's magnitude, scaled to 255, is low..high."""
    return in_range(scale_to_255(magnitude(gradients)), low, high)


def direction_mask(gradients: Gradients, low_rad: float, high_rad: float) -> np.ndarray:
    """Where the gradient's direction is low..high, radians."""
    return in_range(direction(gradients), low_rad, high_rad)


# -------------------------------------------------------------------------------------- combining masks


def any_of(*masks: np.ndarray) -> np.ndarray:
    """255 where at least one of the masks (H, W) is not 0."""
    return np.logical_or.reduce(_alike(masks)).astype(np.uint8) * 255


def all_of(*masks: np.ndarray) -> np.ndarray:
    """255 where none of the masks (H, W) is 0."""
    return np.logical_and.reduce(_alike(masks)).astype(np.uint8) * 255


def _alike(masks: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    shapes = {one_channel(mask).shape for mask in masks}
    if len(shapes) != 1:
        raise LanelibError(f"masks of one size are needed, found {sorted(shapes) or 'none'}; take them from one frame")
    return masks


def _as_uint8(mask: np.ndarray) -> np.ndarray:
    """The mask as OpenCV takes it; a uint8 one is not copied."""
    return mask if one_channel(mask).dtype == np.uint8 else any_of(mask)


def close_gaps(mask: np.ndarray, *, size_px: int = 5) -> np.ndarray:
    """Closing (dilate, then erode) of a mask (H, W): fills gaps and holes narrower than `size_px` (odd)."""
    if size_px not in range(1, 1000, 2):
        raise LanelibError(f"an odd number of pixels is needed to close gaps, found {size_px}; use 3, 5, 7, …")
    return cv2.morphologyEx(_as_uint8(mask), cv2.MORPH_CLOSE, np.ones((size_px, size_px), np.uint8))


# ------------------------------------------------------------------- the default: paint is a narrow ridge

HORIZON_FRACTION = 0.58  # of the height: measured 0.57-0.59 on three dash-cam mountings, from where lane lines meet
NARROWEST_PAINT_M = 0.10  # 4 inches; wider paint still fills the matched stripe
PAINT_SLOPE = 0.08  # width of the stripe, px per row below the horizon = metres of paint / camera height, here of the
# narrowest paint seen from 1.2 m. It holds at any resolution.
WIDTH_MIN_PX = 3  # farther away the lens and the demosaicing blur paint to about this
SIDE_DISTANCE = 1.75  # centre of the road sample beside the stripe, in stripe widths: clear of paint 2.5 widths wide
NEIGHBOURHOOD = 16  # stripe widths (about 1.6 m) over which the road's brightness and texture are averaged
CONTRAST_MIN = 0.08  # of the road's brightness: worn paint on concrete differs by 10 %, seams and patches by 5 %
TEXTURE_MIN = 2.0  # times the mean ridge around: in leaf shadow, grass and gravel all pixels are "ridges"
LEVELS_MIN = 4.0  # grey levels added to the brightness, so that noise in black has no contrast
LENGTH_MIN = 0.10  # of its rows below the horizon = of its distance: 0.8 m of paint at 8 m, 3 m (a dash) at 30 m


def stripe_widths(rows: int, *, horizon_row: float | None = None, paint_slope: float = PAINT_SLOPE) -> np.ndarray:
    """Width of paint in pixels for each of `rows` rows, (rows,) int; 0 next to the horizon and above it.

    On a flat road the scale of row v is (v - horizon) / camera height, so widths grow linearly with the rows below the
    horizon. They are odd, so that a box of that width has a middle and nothing is shifted by half a pixel.
    """
    horizon_row = HORIZON_FRACTION * rows if horizon_row is None else horizon_row
    below = np.arange(rows) - horizon_row
    widths = np.maximum(2 * np.floor(paint_slope * below / 2).astype(int) + 1, WIDTH_MIN_PX)
    return np.where(below > 0.01 * rows, widths, 0)  # next to the horizon, in 1 % of the height, there is only haze


def bands(widths: np.ndarray) -> Iterator[tuple[int, slice]]:
    """The rows below the horizon by their stripe width: (pixels, rows of that width)."""
    for width_px in np.unique(widths[widths > 0]):
        first, last = np.flatnonzero(widths == width_px)[[0, -1]]
        yield int(width_px), slice(first, last + 1)


def ridge(values: np.ndarray, brightness: np.ndarray, width_px: int) -> np.ndarray:
    """How much `values` stands out as an upright stripe of `width_px`: (H, W) float32, paint is 1 and above.

    `values` and `brightness` are (H, W) float32. With c, l, r the means of a box of the stripe's width at a pixel and
    at SIDE_DISTANCE to its left and right:

        ridge = (c - max(l, r)) / max(TEXTURE_MIN · texture, CONTRAST_MIN · (brightness + LEVELS_MIN))
        texture = |c - (l + r) / 2|, like the brightness averaged over NEIGHBOURHOOD widths of the row

    The maximum asks for *both* sides, so the edge of a shadow or of a wide bright patch gives 0 or less. Both terms
    below scale with the light (LEVELS_MIN apart), so half of it gives the same ridge. (The two-sided comparison is the
    "dark-light-dark" test of Bertozzi and Broggi, GOLD, 1998, and the symmetrical local threshold of Veit et al., ITSC
    2008.)
    """
    border = cv2.BORDER_REPLICATE
    distance = round(SIDE_DISTANCE * width_px)
    around = NEIGHBOURHOOD * width_px + 1
    centre = cv2.blur(values, (width_px, 1), borderType=border)
    padded = cv2.copyMakeBorder(centre, 0, 0, distance, distance, border)
    left, right = padded[:, : -2 * distance], padded[:, 2 * distance :]
    texture = cv2.blur(np.abs(centre - (left + right) / 2), (around, 1), borderType=border)
    level = cv2.blur(brightness, (around, 1), borderType=border) + LEVELS_MIN
    return (centre - np.maximum(left, right)) / np.maximum(TEXTURE_MIN * texture, CONTRAST_MIN * level)


def paint_ridges(
    frame_bgr: np.ndarray, *, horizon_row: float | None = None, paint_slope: float = PAINT_SLOPE
) -> tuple[np.ndarray, np.ndarray]:
    """Ridge responses of brightness (R + G) / 2 and of yellow min(R, G) - B, both (H, W) float32; paint is 1 and above.

    White *and* yellow paint are bright in red and green; yellow paint on pale concrete shows in yellow only. Rows at
    and above the horizon are 0.
    """
    frame = as_bgr(frame_bgr)
    widths = stripe_widths(len(frame), horizon_row=horizon_row, paint_slope=paint_slope)
    bright, yellow = np.zeros(frame.shape[:2], np.float32), np.zeros(frame.shape[:2], np.float32)
    for width_px, rows in bands(widths):
        blue, green, red = cv2.split(frame[rows].astype(np.float32))
        brightness = (red + green) / 2
        bright[rows] = ridge(brightness, brightness, width_px)
        yellow[rows] = ridge(np.minimum(red, green) - blue, brightness, width_px)
    return bright, yellow


def keep_long(mask: np.ndarray, *, horizon_row: float | None = None) -> np.ndarray:
    """The mask (H, W) without connected pieces that are too short for their distance.

    A piece of fewer rows than LENGTH_MIN of its lowest row's depth below the horizon, or than WIDTH_MIN_PX, goes: one
    from row v - h to v below the horizon covers h / (v - h) of its distance to the car on a flat road.
    """
    mask = _as_uint8(mask)
    horizon_row = HORIZON_FRACTION * len(mask) if horizon_row is None else horizon_row
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    heights = stats[:, cv2.CC_STAT_HEIGHT]
    depths = stats[:, cv2.CC_STAT_TOP] + heights - 1 - horizon_row
    keep = heights >= np.maximum(WIDTH_MIN_PX, LENGTH_MIN * depths)
    keep[0] = False  # label 0 is the background
    return keep[labels].astype(np.uint8) * 255


def paint_steps(
    frame_bgr: np.ndarray, *, horizon_row: float | None = None, paint_slope: float = PAINT_SLOPE
) -> dict[str, np.ndarray]:
    """The default recipe with its masks in between; `horizon_row` (pixels) and `paint_slope` describe the camera."""
    bright, yellow = paint_ridges(frame_bgr, horizon_row=horizon_row, paint_slope=paint_slope)
    brighter, yellower = in_range(bright, 1, np.inf), in_range(yellow, 1, np.inf)
    steps = {"brighter on both sides": brighter, "yellower on both sides": yellower}
    steps["either"] = any_of(brighter, yellower)
    steps["long enough"] = keep_long(steps["either"], horizon_row=horizon_row)
    return steps


def paint_response(frame_bgr: np.ndarray, *, horizon_row: float | None = None, camera_height_m: float) -> np.ndarray:
    """How much every pixel looks like paint, z >= 0, (H, W) float32.

    The finder's own measure (``paint``), taken in the frame, where paint grows with the rows below the horizon. What
    the textbook order weighs its points with; the mask above is the same idea as a yes or no.
    """
    if not camera_height_m > 0:
        raise LanelibError(f"a camera above the road is needed, found a height of {camera_height_m} m; give metres")
    brightness, yellow = paint_channels(as_bgr(frame_bgr))
    widths = stripe_widths(len(brightness), horizon_row=horizon_row, paint_slope=PAINT_WIDTH_M / camera_height_m)
    z = np.zeros(brightness.shape, np.float32)
    for width_px, rows in bands(widths):
        both = np.concatenate([brightness[rows], yellow[rows]])
        found = ridge_response(both, column_m=PAINT_WIDTH_M / width_px, rows=rows.stop - rows.start)
        z[rows] = np.maximum(*np.split(found, 2))
    return z


# ---------------------------------------------------------------------------------------------- recipes


@dataclass(frozen=True)
class Recipe:
    """A named way from a frame to a mask. `steps(frame_bgr)` gives its masks by name; the last one is the result."""

    name: str
    title: str
    steps: Callable[[np.ndarray], dict[str, np.ndarray]]

    def function(self, frame_bgr: np.ndarray) -> np.ndarray:
        """The result alone: mask (H, W) uint8 0/255."""
        return list(self.steps(frame_bgr).values())[-1]


def _sobel_or_colour_steps(frame_bgr: np.ndarray) -> dict[str, np.ndarray]:
    gradients = sobel(CHANNELS["grey"](frame_bgr), ksize=3)
    steps = {
        "sobel x": abs_sobel_mask(gradients, 20, 200),  # below 20 of 255 the asphalt itself shows
        "magnitude": magnitude_mask(gradients, 30, 200),
        "direction": direction_mask(gradients, 0.5, 1.3),  # lines lean by 15 to 60 degrees in the frame
        "S of HLS": in_range(CHANNELS["hls_s"](frame_bgr), 170, 255),
        "R of RGB": in_range(CHANNELS["rgb_r"](frame_bgr), 220, 255),
    }
    steps["gradient"] = all_of(steps["sobel x"], steps["magnitude"], steps["direction"])
    steps["colour"] = any_of(steps["S of HLS"], steps["R of RGB"])
    steps["gradient OR colour"] = any_of(steps["gradient"], steps["colour"])
    return steps


def _gradient_and_colour_steps(frame_bgr: np.ndarray) -> dict[str, np.ndarray]:
    lightness, saturation = CHANNELS["hls_l"](frame_bgr), CHANNELS["hls_s"](frame_bgr)
    gradients = sobel(lightness, ksize=5)
    steps = {
        "gradient": any_of(abs_sobel_mask(gradients, 15), magnitude_mask(gradients, 25)),
        "HLS": any_of(in_range(lightness, 200, 255), in_range(saturation, 150, 255)),
        "HSV": any_of(hsv_white(frame_bgr), hsv_yellow(frame_bgr)),
        "LAB": in_range(CHANNELS["lab_b"](frame_bgr), 155, 255),  # 27 above neutral: clearly yellow
    }
    steps["colour"] = any_of(steps["HLS"], steps["HSV"], steps["LAB"])
    steps["gradient AND colour"] = all_of(steps["gradient"], steps["colour"])
    return steps


def _clahe_colour_sobel_steps(frame_bgr: np.ndarray) -> dict[str, np.ndarray]:
    equalised = equalise_lightness(frame_bgr)
    steps = {
        "HLS white": in_range(CHANNELS["hls_l"](equalised), 215, 255),
        "HSV yellow": hsv_yellow(equalised),
        "sobel x": abs_sobel_mask(sobel(CHANNELS["grey"](equalised)), 50),
    }
    steps["any"] = any_of(*steps.values())
    steps["closed"] = close_gaps(steps["any"])
    return steps


RECIPES: dict[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        # brighter or yellower than the road on both sides, at paint's width, relative to local brightness and texture;
        # short pieces dropped
        Recipe("paint", "Paint is a ridge", paint_steps),
        # (Sobel x AND magnitude AND direction) OR (S OR R)
        Recipe("sobel-or-colour", "Gradient or colour", _sobel_or_colour_steps),
        # gradient AND (HLS OR HSV OR LAB)
        Recipe("gradient-and-colour", "Gradient and colour", _gradient_and_colour_steps),
        # after CLAHE: HLS white OR HSV yellow OR Sobel x, closed
        Recipe("clahe-colour-sobel", "CLAHE, colour, Sobel", _clahe_colour_sobel_steps),
    )
}
DEFAULT_RECIPE = "paint"


def recipe_by_name(name: str = DEFAULT_RECIPE) -> Recipe:
    """The recipe called `name`. Raises LanelibError for a name that is not in RECIPES."""
    if name not in RECIPES:
        raise LanelibError(f"a recipe name is needed, found {name!r}; choose one of {', '.join(RECIPES)}")
    return RECIPES[name]
