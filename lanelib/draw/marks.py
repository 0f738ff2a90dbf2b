"""Marks on pictures: heat, points, lines, windows, corners. A picture in, a new picture out.

Pictures are (H, W, 3) uint8 BGR (grey ones are taken too); positions are pixels x, y, centres at integers.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanelib.channels import as_bgr, one_channel
from lanelib.draw.canvas import ONE, SHIFT, Canvas
from lanelib.draw.palette import SERIES, bgr
from lanelib.errors import LanelibError

LEAST_SCALE = 0.6  # marks on small pictures are no smaller than that, or nobody would see them
FARTHEST_PX = 2e4  # what is farther out is pulled in, or left out; OpenCV's integers would wrap around


def own_copy(picture: np.ndarray) -> np.ndarray:
    """A new (H, W, 3) BGR picture to draw on."""
    copied = as_bgr(picture)
    return copied.copy() if np.shares_memory(copied, picture) else copied


def heat(values: np.ndarray, *, top: float | None = None) -> np.ndarray:
    """Numbers (H, W), 0 and more, from black over purple and orange to pale yellow at ``top`` (default: highest)."""
    values = np.nan_to_num(one_channel(np.asarray(values)).astype(np.float32))
    top = float(values.max(initial=0.0)) if top is None else top
    scaled = np.clip(values * (255 / top if top > 0 else 0), 0, 255).astype(np.uint8)
    return cv2.applyColorMap(scaled, cv2.COLORMAP_INFERNO)  # brightness grows with the number: reads in grey, too


def difference(first: np.ndarray, second: np.ndarray, *, gain: float = 4.0) -> np.ndarray:
    """Where two pictures of one size differ, as heat; ``gain`` makes small differences visible."""
    first, second = as_bgr(first), as_bgr(second)
    if first.shape != second.shape:
        raise LanelibError(f"two pictures of one size are needed, found {first.shape} and {second.shape}")
    if not gain > 0:
        raise LanelibError(f"a difference needs a gain above 0, found {gain}")
    return heat(cv2.absdiff(first, second).max(axis=2), top=255 / gain)


def draw_points(picture: np.ndarray, xy, colour: str = "paint", *, radius_px: float = 2.0, weights=None) -> np.ndarray:
    """Dots at ``xy`` (N, 2), the fainter the less their ``weights`` (N,) 0..1; what is not finite is left out."""
    picture, points = own_copy(picture), np.asarray(xy, float).reshape(-1, 2)
    weights = np.ones(len(points)) if weights is None else np.asarray(weights, float)
    scale, colours = _scale_of(picture), np.array(bgr(colour), float)
    for (x, y), weight in zip(points, weights, strict=True):
        if np.isfinite(x + y) and abs(x) < FARTHEST_PX and abs(y) < FARTHEST_PX:
            shade = tuple((colours * (0.35 + 0.65 * min(max(weight, 0.0), 1.0))).tolist())
            disc_in_place(picture, (x, y), shade, radius_px * scale)
    return picture


def draw_line(
    picture: np.ndarray,
    xy,
    colour: str = "accent",
    *,
    width_px: float = 2.0,
    dashed: bool = False,
    closed: bool = False,
    outline: bool = False,
) -> np.ndarray:
    """A smooth line through ``xy`` (N, 2); ``outline``: with a dark edge, so that it shows on bright ground, too."""
    picture = own_copy(picture)
    line_in_place(picture, xy, bgr(colour), width_px, dashed=dashed, closed=closed, outline=outline)
    return picture


def line_in_place(picture, xy, colour, width_px=2.0, *, dashed=False, closed=False, outline=False) -> None:
    """`draw_line` into ``picture`` itself; ``colour`` as BGR."""
    if not 0 < width_px < np.inf:
        raise LanelibError(f"a line must be wider than 0 px, found {width_px}")
    points = np.asarray(xy, float).reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return
    points = np.clip(points, -FARTHEST_PX, FARTHEST_PX)
    if closed:
        points = np.concatenate([points, points[:1]])
    pieces = [points]
    if dashed:
        length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        starts = np.arange(0, length[-1], 7 * width_px)
        at = [np.linspace(s, min(s + 4 * width_px, length[-1]), 4) for s in starts]
        pieces = [np.column_stack([np.interp(a, length, points[:, 0]), np.interp(a, length, points[:, 1])]) for a in at]
    fixed, thick = [np.round(p * ONE).astype(np.int32) for p in pieces], max(1, round(width_px))
    if outline:
        cv2.polylines(picture, fixed, False, (0, 0, 0), thick + 2, cv2.LINE_AA, SHIFT)
    cv2.polylines(picture, fixed, False, colour, thick, cv2.LINE_AA, SHIFT)


def disc_in_place(picture, xy, colour, radius_px) -> None:
    """A smooth filled circle; ``colour``: a number for each channel."""
    centre = tuple(round(float(v) * ONE) for v in xy)
    cv2.circle(picture, centre, round(radius_px * ONE), colour, -1, cv2.LINE_AA, SHIFT)


def ring_in_place(picture, xy, colour, radius_px) -> None:
    """A white-rimmed dot."""
    centre = np.clip(xy, -FARTHEST_PX, FARTHEST_PX)
    disc_in_place(picture, centre, (255, 255, 255), radius_px)
    disc_in_place(picture, centre, colour, 0.68 * radius_px)


def draw_windows(view: np.ndarray, found, *, left: str = "left line", right: str = "right line") -> np.ndarray:
    """What a search for lane pixels looked at (`search.LanePixels`), on a bird's-eye view (H, W, 3) or mask (H, W).

    Pixels of the left and the right line, windows (faint where they held too few pixels to recentre), and the regions
    that were searched around a known line.
    """
    picture = own_copy(view)
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    picture = cv2.convertScaleAbs(grey, alpha=0.45)  # what belongs to neither line steps back
    canvas = Canvas.of_bgr(picture)
    for region in found.regions:
        canvas.fill([region], bgr("region"), opacity=0.25)
    height, width = picture.shape[:2]
    for xy, name in ((found.left_xy, left), (found.right_xy, right)):
        x, y = np.round(xy).astype(int).T if len(xy) else (np.empty(0, int), np.empty(0, int))
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        picture[y[inside], x[inside]] = bgr(name)
    scale = max(height / 720, LEAST_SCALE)
    for window in found.windows:
        x, y = (window.left, window.right - 1), (window.row_top, window.row_bottom - 1)
        corners = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])
        colour = bgr("window") if window.recentred else tuple(v // 2 for v in bgr("window"))
        line_in_place(picture, corners, colour, 2 * scale, closed=True)
    return picture


SMALLEST_RINGS_PX = 14.0  # between corners; on smaller boards (a contact sheet) rings would hide the squares


def draw_corners(picture: np.ndarray, corners_xy, board_wh: tuple[int, int]) -> np.ndarray:
    """Chessboard corners in the order they were found, (N, 2) or (N, 1, 2): row by row of ``board_wh`` inner corners.

    Each row has a colour, the first corner a ring. Another number of corners than the board has (it was not found) are
    plain red dots.
    """
    picture, corners = own_copy(picture), np.asarray(corners_xy, float).reshape(-1, 2)
    corners = corners[np.isfinite(corners).all(axis=1)]
    columns, rows = board_wh
    if not len(corners) or len(corners) != columns * rows:
        return draw_points(picture, corners, "none", radius_px=4)
    grid = corners.reshape(rows, columns, 2)
    spacing = float(np.median(np.hypot(*np.diff(grid, axis=1).reshape(-1, 2).T))) if columns > 1 else 20.0
    radius = float(np.clip(0.15 * spacing, 1.4, 6 * _scale_of(picture)))  # small boards keep their squares visible
    for i, row in enumerate(grid):
        colour = bgr(SERIES[i % len(SERIES)])
        line_in_place(picture, row, colour, 0.4 * radius)
        for x, y in row if spacing >= SMALLEST_RINGS_PX else ():
            ring_in_place(picture, (x, y), colour, radius)
    first, thick = np.round(corners[0] * ONE).astype(int).tolist(), max(1, round(0.5 * radius))
    cv2.circle(picture, first, round(2.2 * radius * ONE), bgr("none"), thick, cv2.LINE_AA, SHIFT)
    return picture


def _scale_of(picture: np.ndarray) -> float:
    """How large marks must be to look as in a picture 1280 wide."""
    return max(picture.shape[1] / 1280, LEAST_SCALE)
