"""Colour: one frame, many grey pictures. Every channel by name, and the masks that need nothing but colour.

Paint is white or yellow. A channel is useful for finding it when paint and road differ in it, *and* keep differing
when the light changes: that second condition is what most channels fail.
"""

from collections.abc import Callable

import cv2
import numpy as np

from lanelib.arrays import described
from lanelib.errors import LanelibError

Channel = Callable[[np.ndarray], np.ndarray]


def as_bgr(frame: np.ndarray) -> np.ndarray:
    """Return any usual uint8 picture as frame_bgr: (H, W, 3) uint8.

    Grey (H, W) or (H, W, 1) is repeated in all three channels; a fourth channel (alpha) is dropped; (H, W, 3) is
    returned as it is, not copied. Raises LanelibError for anything else.
    """
    if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8:
        raise LanelibError(
            f"a picture of uint8 is needed, found {described(frame)}; convert it to 0..255 and astype('uint8')"
        )
    if frame.size == 0 or frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] not in (1, 3, 4)):
        raise LanelibError(f"a picture of shape (H, W, 3) is needed, found {frame.shape}; give a BGR or grey frame")
    if frame.ndim == 2 or frame.shape[2] == 1:
        return np.repeat(frame.reshape(*frame.shape[:2], 1), 3, axis=2)
    return frame if frame.shape[2] == 3 else np.ascontiguousarray(frame[:, :, :3])


def yuv420_planes(frame_yuv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The planes Y (H, W), U and V (H / 2, W / 2) of a YUV420p frame (H * 3 / 2, W) in one piece, as views into it."""
    height, width = frame_yuv.shape[0] * 2 // 3, frame_yuv.shape[1]
    u, v = frame_yuv[height:].reshape(2, height // 2, width // 2)
    return frame_yuv[:height], u, v


def one_channel(values: np.ndarray) -> np.ndarray:
    """The array itself if it is one channel (H, W) of numbers with at least one pixel; else LanelibError.

    Some functions of OpenCV end the whole process on an empty picture instead of raising.
    """
    if not isinstance(values, np.ndarray) or values.ndim != 2 or values.size == 0 or values.dtype.kind not in "bufi":
        raise LanelibError(f"one channel (H, W) is needed, found {described(values)}; give a mask or a grey picture")
    return values


def _channel(code: int, index: int) -> Channel:
    """The function frame_bgr -> channel `index` of the colour space of cv2.cvtColor's `code`."""

    def channel(frame_bgr: np.ndarray) -> np.ndarray:
        converted = cv2.cvtColor(as_bgr(frame_bgr), code)
        return converted if converted.ndim == 2 else np.ascontiguousarray(converted[:, :, index])

    return channel


CHANNELS: dict[str, Channel] = {
    "grey": _channel(cv2.COLOR_BGR2GRAY, 0),  # 0.299 R + 0.587 G + 0.114 B
    "rgb_r": _channel(cv2.COLOR_BGR2RGB, 0),  # white and yellow are both bright here; so is concrete
    "rgb_g": _channel(cv2.COLOR_BGR2RGB, 1),
    "rgb_b": _channel(cv2.COLOR_BGR2RGB, 2),  # yellow is dark here
    "hls_h": _channel(cv2.COLOR_BGR2HLS, 0),  # hue in 2-degree steps, 0..179; yellow is 15..30
    "hls_l": _channel(cv2.COLOR_BGR2HLS, 1),  # (max + min) / 2: finds white
    "hls_s": _channel(cv2.COLOR_BGR2HLS, 2),  # finds yellow, but also dark pixels, whose saturation is noise
    "hsv_h": _channel(cv2.COLOR_BGR2HSV, 0),
    "hsv_s": _channel(cv2.COLOR_BGR2HSV, 1),
    "hsv_v": _channel(cv2.COLOR_BGR2HSV, 2),  # max(R, G, B)
    "lab_l": _channel(cv2.COLOR_BGR2LAB, 0),  # lightness as the eye sees it, 0..255
    "lab_a": _channel(cv2.COLOR_BGR2LAB, 1),
    "lab_b": _channel(cv2.COLOR_BGR2LAB, 2),  # blue 0 .. grey 128 .. yellow 255: the best single channel for yellow
    "yuv_y": _channel(cv2.COLOR_BGR2YUV, 0),  # what a video file stores (there in 16..235): brightness,
    "yuv_u": _channel(cv2.COLOR_BGR2YUV, 1),  # blue difference (yellow lies below 128),
    "yuv_v": _channel(cv2.COLOR_BGR2YUV, 2),  # red difference
}
"""Name -> function from frame_bgr (H, W, 3) uint8 to one channel (H, W) uint8, in OpenCV's scale for 8-bit pictures."""


def channel_by_name(frame_bgr: np.ndarray, name: str) -> np.ndarray:
    """The channel called `name`, (H, W) uint8. Raises LanelibError for a name that is not in CHANNELS."""
    if name not in CHANNELS:
        raise LanelibError(f"a channel name is needed, found {name!r}; choose one of {', '.join(CHANNELS)}")
    return CHANNELS[name](frame_bgr)


def in_range(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Mask (H, W) uint8 0/255: 255 where low <= value <= high, both ends included. NaN is outside.

    >>> in_range(np.array([[10, 20, 30]], np.uint8), 20, 255).tolist()
    [[0, 255, 255]]
    """
    return ((values >= low) & (values <= high)).astype(np.uint8) * 255


def hsv_white(frame_bgr: np.ndarray, *, value_min: int = 200, saturation_max: int = 40) -> np.ndarray:
    """Mask (H, W) uint8 0/255 of bright pixels of little colour.

    Sunlit white paint reaches V of 200 and more in a well exposed frame; S above 40 is a visible tint. Concrete in the
    sun passes too, and paint in the shade fails: that is the limit of every fixed threshold.
    """
    hsv = cv2.cvtColor(as_bgr(frame_bgr), cv2.COLOR_BGR2HSV)
    return cv2.inRange(hsv, (0, 0, value_min), (179, saturation_max, 255))


def hsv_yellow(
    frame_bgr: np.ndarray,
    *,
    hue_range: tuple[int, int] = (15, 35),
    saturation_min: int = 90,
    value_min: int = 100,
) -> np.ndarray:
    """Mask (H, W) uint8 0/255 of yellow pixels.

    Hue 15..35 in OpenCV's steps is 30..70 degrees, orange-yellow to lemon. Below S = 90 dry grass and concrete in
    warm light pass as well; below V = 100 hue is mostly noise.
    """
    hsv = cv2.cvtColor(as_bgr(frame_bgr), cv2.COLOR_BGR2HSV)
    return cv2.inRange(hsv, (hue_range[0], saturation_min, value_min), (hue_range[1], 255, 255))


def equalise_lightness(frame_bgr: np.ndarray, *, clip_limit: float = 2.0, tiles: int = 8) -> np.ndarray:
    """CLAHE on the L of LAB; colours stay. Returns a new frame_bgr (H, W, 3) uint8.

    Contrast limited adaptive histogram equalisation: each of tiles x tiles regions is stretched over the whole scale,
    by at most `clip_limit` times, so that noise in a flat region is not blown up (Zuiderveld, Graphics Gems IV, 1994).
    """
    if tiles not in range(1, 65) or not clip_limit > 0:  # OpenCV ends Python on 0 tiles
        raise LanelibError(
            f"1 to 64 tiles a side and a clip limit above 0 are needed, found {tiles} and {clip_limit}; 8 and 2.0 are "
            "usual"
        )
    lab = cv2.cvtColor(as_bgr(frame_bgr), cv2.COLOR_BGR2LAB)
    clahe = cv2.createCLAHE(clipLimit=clip_limit, tileGridSize=(tiles, tiles))
    lab[:, :, 0] = clahe.apply(np.ascontiguousarray(lab[:, :, 0]))
    return cv2.cvtColor(lab, cv2.COLOR_LAB2BGR)
