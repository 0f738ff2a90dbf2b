"""Arrays that are handed in: as a function needs them, or one clear line; and copies that nobody outside can change."""

import numpy as np

from lanelib.errors import LanelibError

SAMPLED = (np.uint8, np.uint16, np.int16, np.float32, np.float64)  # what OpenCV interpolates


def owned(values) -> np.ndarray:
    """A read-only float64 copy: what a frozen object keeps, so that nobody outside can change it."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def as_points(points, n: int) -> np.ndarray:
    """Points (N, n) as float64."""
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise LanelibError(f"need points of shape (N, {n}), found {in_short(points)}") from None
    if array.ndim != 2 or array.shape[1] != n:
        raise LanelibError(f"need points of shape (N, {n}), found {array.shape}")
    return array


def as_size_wh(size_wh, what: str) -> tuple[int, int]:
    """Width and height as plain whole numbers above 0; ``what`` needs them."""
    try:
        width, height = size = tuple(int(n) for n in size_wh)
        valid = min(size) > 0 and size == tuple(size_wh)
    except (TypeError, ValueError, OverflowError):
        valid = False
    if not valid:
        raise LanelibError(f"{what}: need size_wh as two whole numbers above 0, found {in_short(size_wh)}")
    return width, height


def as_picture(picture, size_wh: tuple[int, int], what: str, cure: str) -> np.ndarray:
    """The array itself, if it is a picture of that size which OpenCV can sample; ``what`` needs it."""
    if not isinstance(picture, np.ndarray) or picture.ndim not in (2, 3) or picture.shape[1::-1] != size_wh:
        raise LanelibError(f"{what}: need a frame of {size_wh[0]}x{size_wh[1]}, found {described(picture)}; {cure}")
    if picture.dtype not in SAMPLED:
        raise LanelibError(f"{what}: need uint8 or another number that OpenCV takes, found {picture.dtype}; convert it")
    return picture


def described(value) -> str:
    """What an array, or something else, is, in the words of an error.

    >>> described(np.zeros((2, 3))), described(None)
    ('shape (2, 3), float64', 'NoneType')
    """
    return f"shape {value.shape}, {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__


def in_short(value) -> str:
    """A value on one line, cut where it is long, in the words of an error."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."
