"""Panels: several pictures on one dark desk, with titles, rulers and numbers.

All functions take pictures (H, W, 3) uint8 BGR or masks (H, W) uint8 and give a new BGR picture.
"""

from __future__ import annotations

import math
from itertools import count

import cv2
import numpy as np

from lanelib.channels import as_bgr
from lanelib.draw.canvas import Canvas
from lanelib.draw.lettering import put_text, shortened, text_width
from lanelib.draw.marks import disc_in_place, line_in_place
from lanelib.draw.palette import bgr
from lanelib.errors import LanelibError
from lanelib.search import find_peaks, histogram

GAP = 12  # between pictures, and around them


def fitted(picture: np.ndarray, size_wh: tuple[int, int], *, stretch: bool = False) -> np.ndarray:
    """The picture scaled to fit into ``size_wh``, centred on the desk; ``stretch`` fills it. Masks 0/1 are seen too."""
    picture = np.asarray(picture)
    if picture.dtype == bool:
        picture = picture.astype(np.uint8)
    if picture.ndim == 2 and picture.dtype == np.uint8 and picture.size and picture.max() == 1:
        picture = picture * np.uint8(255)
    picture = as_bgr(picture)
    height, width = picture.shape[:2]
    scale = min(size_wh[0] / width, size_wh[1] / height)
    inner = size_wh if stretch else (max(1, round(width * scale)), max(1, round(height * scale)))
    smaller = inner[0] < width or inner[1] < height
    scaled = cv2.resize(picture, inner, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
    out = np.full((size_wh[1], size_wh[0], 3), bgr("desk"), np.uint8)
    x, y = (size_wh[0] - inner[0]) // 2, (size_wh[1] - inner[1]) // 2
    out[y : y + inner[1], x : x + inner[0]] = scaled
    return out


def side_by_side(
    pictures, titles=None, *, height: int | None = None, columns: int | None = None, cap_px: int = 13
) -> np.ndarray:
    """Pictures next to each other, each with its title above.

    ``height``: of all of them; by default the lowest one's, at most 480. ``columns``: begin a new row after so many.
    """
    pictures = [np.asarray(p) for p in pictures]
    titles = list(titles) if titles is not None else [""] * len(pictures)
    if not pictures or len(titles) != len(pictures):
        raise LanelibError(
            f"a title for each picture is needed, found {len(titles)} titles and {len(pictures)} pictures"
        )
    if any(p.ndim < 2 or not p.size for p in pictures):
        raise LanelibError(f"pictures (H, W) or (H, W, 3) are needed, found shapes {[p.shape for p in pictures]}")
    height = height or min(480, *(p.shape[0] for p in pictures))
    columns = columns or len(pictures)
    if height < 1 or columns < 1:
        raise LanelibError(f"a height and a number of columns above 0 are needed, found {height} and {columns}")
    widths = [max(1, round(p.shape[1] * height / p.shape[0])) for p in pictures]
    rows = [range(i, min(i + columns, len(pictures))) for i in range(0, len(pictures), columns)]
    head = round(2.2 * cap_px) if any(titles) else 0
    width = max(sum(widths[i] for i in row) + GAP * (len(row) - 1) for row in rows)
    out = np.full((len(rows) * (height + head + GAP) + GAP, width + 2 * GAP, 3), bgr("desk"), np.uint8)
    for r, row in enumerate(rows):
        x, y = GAP, GAP + r * (height + head + GAP)
        for i in row:
            words = shortened(str(titles[i]), cap_px, widths[i])
            put_text(out, words, (x, y + head - 0.55 * cap_px), bgr("title"), cap_px=cap_px)
            out[y + head : y + head + height, x : x + widths[i]] = fitted(pictures[i], (widths[i], height))
            x += widths[i] + GAP
    return out


# ---------------------------------------------------------------------------------------------- bird's-eye view
def pixels_of_road(grid, points_m) -> np.ndarray:
    """Metres (N, 2) to pixels (N, 2) of a picture of ``grid`` (`birdseye.Grid`); NaN before and beyond its rows.

    The rows may be spaced as they like.
    """
    points_m = np.asarray(points_m, float).reshape(-1, 2)
    row = np.interp(points_m[:, 1], grid.y_m[::-1], np.arange(len(grid.y_m))[::-1], left=np.nan, right=np.nan)
    return np.column_stack([grid.column_of(points_m[:, 0]), row])


def birdseye(
    view: np.ndarray, grid, *, lane=None, points_m=None, weights=None, held: bool = False, rulers: bool = True
) -> np.ndarray:
    """A bird's-eye picture of ``grid`` with metre rulers, the car's place, and what is given of lane and paint points.

    ``lane`` (`lane.Lane`) is drawn where it appears on the rig's flat plane; solid where paint was seen, dashed
    beyond. ``points_m`` (N, 2) metres on that plane, ``weights`` (N,) 0..1.
    """
    picture = as_bgr(view).copy()
    if picture.shape[:2] != (len(grid.y_m), len(grid.x_m)):
        width, height = grid.size_wh
        raise LanelibError(
            f"the view must be {width}x{height} as its grid, found {picture.shape[1]}x{picture.shape[0]}"
        )
    scale = max(picture.shape[0] / 720, 0.5)
    if lane is not None:
        y = np.geomspace(max(0.5 * grid.y_m[-1], 0.5), grid.y_m[0] * 4, 240)
        for line, name in ((lane.left, "left line"), (lane.right, "right line")):
            flat = lane.surface.flat_from_road(np.column_stack([line.x(y), y]))
            on = pixels_of_road(grid, flat)
            known = y <= lane.y_range_m[1]
            colour = bgr(name)
            line_in_place(picture, on[~known], colour, 2 * scale, dashed=True)
            line_in_place(picture, on[known], colour, 3 * scale, outline=True, dashed=held)
    if points_m is not None:
        on = pixels_of_road(grid, points_m)
        weights = np.ones(len(on)) if weights is None else np.asarray(weights, float)
        for (u, v), weight in zip(on, weights, strict=True):
            if np.isfinite(u + v) and weight > 0.02:
                shade = tuple(float(c) * (0.4 + 0.6 * weight) for c in bgr("paint"))
                disc_in_place(picture, (u, v), shade, (0.9 + 0.9 * weight) * scale)
    if rulers:
        _rulers(picture, grid, scale)
        _car(picture, grid, scale)
    return picture


def _rulers(picture, grid, scale) -> None:
    """With numbers: up to ten hairlines ahead (every 5 m of 40 m), and a mark for every metre along the lower edge."""
    height, width = picture.shape[:2]
    cap = max(7, round(14 * scale))
    canvas = Canvas.of_bgr(picture)
    step = next(s * 10**k for k in count() for s in (1, 2, 5) if s * 10 ** (k + 1) >= grid.y_m[0] - grid.y_m[-1])
    for metres in np.arange(math.ceil(grid.y_m[-1] / step) * step, grid.y_m[0], step):
        v = pixels_of_road(grid, [(0, metres)])[0, 1]
        hairline = np.array([(0, v - 0.5), (width, v - 0.5), (width, v + 0.5), (0, v + 0.5)])
        canvas.fill([hairline], (255, 255, 255), opacity=0.22)
        if v < height - 46 * scale:
            _tag(picture, canvas, f"{metres:g} m", (round(5 * scale), v - 4 * scale), cap)
    for metres in np.arange(math.ceil(grid.x_m[0]), grid.x_m[-1]):
        u = float(grid.column_of(metres))
        tall = (9 if metres % 2 == 0 else 5) * scale
        box = np.array([(u - 0.5, height - tall), (u + 0.5, height - tall), (u + 0.5, height), (u - 0.5, height)])
        canvas.fill([box], (255, 255, 255), opacity=0.85)
        words = f"{metres:+g}"
        half = text_width(words, cap) / 2
        if metres % 2 == 0 and metres != 0 and half < u < width - half:
            _tag(picture, canvas, words, (u, height - tall - 4 * scale), cap, align="centre")


def _tag(picture, canvas, words, xy, cap, *, align="left") -> None:
    """Words on a dark patch: they must be read on any ground."""
    width = text_width(words, cap)
    x = xy[0] - (width / 2 if align == "centre" else 0)
    pad = 0.35 * cap
    left, right, top, bottom = x - pad, x + width + pad, xy[1] - cap - pad, xy[1] + pad
    box = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    canvas.fill([box], bgr("card"), opacity=0.55)
    put_text(picture, words, (x, xy[1]), bgr("text"), cap_px=cap)


def _car(picture, grid, scale) -> None:
    """An arrow at the lower edge where the car drives (x = 0)."""
    u, bottom = float(grid.column_of(0.0)), picture.shape[0] - 1
    arrow = np.array(
        [(u, bottom - 24 * scale), (u + 10 * scale, bottom), (u, bottom - 6 * scale), (u - 10 * scale, bottom)]
    )
    canvas = Canvas.of_bgr(picture)
    canvas.fill([(arrow - (u, bottom - 10 * scale)) * 1.35 + (u, bottom - 10 * scale)], bgr("card"))
    canvas.fill([arrow], (255, 255, 255))


def histogram_panel(mask: np.ndarray, size_wh: tuple[int, int], *, centre: float | None = None) -> np.ndarray:
    """The column histogram of a bird's-eye mask (H, W) as bars, its left and right peak marked."""
    sums = histogram(mask)
    peaks = find_peaks(sums, centre=centre)
    width, height = size_wh
    out = np.full((height, width, 3), bgr("card"), np.uint8)
    base, top = height - 3, 8
    columns = np.arange(width)
    values = np.interp(columns, np.linspace(0, width - 1, len(sums)), sums) / max(float(sums.max(initial=0.0)), 1.0)
    edge = np.column_stack([columns, base - values * (base - top)])
    canvas = Canvas.of_bgr(out)
    canvas.fill([np.concatenate([edge, [(width - 1, base), (0, base)]])], bgr("accent"), opacity=0.55)
    line_in_place(out, edge, bgr("accent"), 1)
    for peak, name in zip(peaks, ("left line", "right line"), strict=True):
        if peak is not None:
            x = peak * (width - 1) / max(len(sums) - 1, 1)
            line_in_place(out, [(x, top - 4), (x, base)], bgr(name), 2)
    line_in_place(out, [(0, base + 0.5), (width, base + 0.5)], bgr("track"), 1)
    return out
