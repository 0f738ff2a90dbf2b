"""The overlay: the lane on the frame, and what it means in numbers.

`overlay` gives a new picture; `overlay_bgr` and `overlay_yuv420` draw into a frame of a video, in place, and touch only
the bounding boxes of what they draw. All take a `LaneResult` (or anything with its attributes).
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from lanelib.draw.canvas import ONE, SHIFT, Canvas, Layer
from lanelib.draw.lettering import put_text, text_width, wrapped
from lanelib.draw.marks import disc_in_place, own_copy
from lanelib.draw.palette import bgr
from lanelib.errors import LanelibError

AREA_OPACITY = {"measured": 0.35, "held": 0.20}  # the road must stay visible under the lane
HELD_PALER = 0.45  # how much of a pale grey is mixed into the lines' colours while the lane is held
PALE = (214, 214, 214)
LINE_WIDTH = 0.026  # of the lane's width at the same place: 0.10 m of 3.66 m, as wide as the narrowest paint
FADE = 0.35  # the upper part of the lane over which the area fades out and the lines taper: farther away less is known
LINE_FADE = 0.14  # the same for the lines
THINNEST, NEIGHBOUR_THINNEST = 0.0011, 0.0012  # of the frame's width: 1.4 and 1.5 px of 1280, so that far ends stay
NEIGHBOUR_WIDTH = 0.6  # of the ego lane's lines: they are not what is driven by
CARD_OPACITY = 0.66  # white letters keep a contrast of 6:1 even over white (4.5:1 is asked for: WCAG 2.1, 1.4.3)
DASH, PAUSE = 3, 2  # points of a line that is held


def overlay(frame_bgr: np.ndarray, result, *, text: bool = True) -> np.ndarray:
    """The frame (H, W, 3) uint8 BGR with the lane drawn on it, as a new picture of the same size.

    Green lane area, left line red, right line blue, far boundaries of neighbouring lanes thin and purple; with
    ``text`` a read-out in the upper left corner: radius of curvature, offset from the lane's centre, lane width, and
    how far to trust them. A lane held from frames before is paler and dashed. Grey and four-channel frames are taken
    too. Raises LanelibError where the result belongs to a frame of another size.
    """
    return overlay_bgr(own_copy(frame_bgr), result, text=text)


def overlay_bgr(frame_bgr: np.ndarray, result, *, text: bool = True) -> np.ndarray:
    """`overlay` in place on a (H, W, 3) uint8 BGR frame; returns that frame."""
    draw_overlay(Canvas.of_bgr(frame_bgr), result, text=text)
    return frame_bgr


def overlay_yuv420(frame_yuv: np.ndarray, result, *, text: bool = True) -> np.ndarray:
    """`overlay` in place on a YUV420p frame (H * 3 / 2, W) uint8, without converting it; returns that frame."""
    draw_overlay(Canvas.of_yuv420(frame_yuv), result, text=text)
    return frame_yuv


def draw_overlay(canvas: Canvas, result, *, text: bool = True) -> None:
    """Lane area, lines and read-out on any canvas."""
    if result.lane is not None:
        if tuple(result.size_wh) not in ((0, 0), tuple(canvas.size_wh)):
            raise LanelibError(
                f"the lane was found in a frame of {_by(result.size_wh)} pixels, this one has {_by(canvas.size_wh)}; "
                "draw it on the frame it was found in"
            )
        draw_lane(canvas, result.left_px, result.right_px, held=result.status == "held")
        draw_neighbours(canvas, result)
    if text:
        card = read_out(result, canvas.size_wh)
        if card is not None:
            width, height = canvas.size_wh
            margin = 2 * round(0.01 * min(width / 16 * 9, height))  # even, for the half-size planes
            canvas.lay(card, (margin, margin))


def draw_lane(canvas: Canvas, left_px: np.ndarray, right_px: np.ndarray, *, held: bool = False) -> None:
    """The lane between two lines, (N, 2) and (M, 2) pixels of the frame from near to far."""
    left, right = (_finite(p) for p in (left_px, right_px))
    if min(len(left), len(right)) < 2:
        return
    n = min(len(left), len(right))
    width = np.hypot(*(right[:n] - left[:n]).T)
    top, bottom = min(left[:, 1].min(), right[:, 1].min()), min(max(left[0, 1], right[0, 1]), canvas.size_wh[1])
    full = top + FADE * max(bottom - top, 1.0)
    area, opacity = np.concatenate([left, right[::-1]]), AREA_OPACITY["held" if held else "measured"]
    canvas.fill([area], bgr("lane area"), opacity=opacity, fade_rows=(top, full))
    thinnest = max(1.0, THINNEST * canvas.size_wh[0])
    for line, name in ((left, "left line"), (right, "right line")):
        wide = LINE_WIDTH * np.concatenate([width, np.full(len(line) - n, width[-1])])
        wide = np.maximum(wide * np.clip((line[:, 1] - top) / (full - top), 0.25, 1), thinnest)
        colour = mixed(bgr(name), PALE, HELD_PALER) if held else bgr(name)
        last = len(line) - 1
        pieces = [(i, min(i + DASH, last)) for i in range(0, last, DASH + PAUSE)] if held else [(0, last)]
        ribbons = [ribbon(line[a : b + 1], wide[a : b + 1]) for a, b in pieces]
        canvas.fill(ribbons, colour, fade_rows=(top, top + LINE_FADE * (bottom - top)))


def draw_neighbours(canvas: Canvas, result) -> None:
    """The far boundaries of a result's neighbouring lanes."""
    left, right = (_finite(p) for p in (result.left_px, result.right_px))
    n = min(len(left), len(right))
    if n < 2:
        return
    width, rows = np.hypot(*(right[:n] - left[:n]).T), (left[:n, 1] + right[:n, 1]) / 2
    for neighbour in getattr(result, "neighbours", ()):
        line = _finite(neighbour.points_px)
        if len(line) > 1:
            line = line[np.linspace(0, len(line) - 1, min(len(line), 16)).astype(int)]  # short pieces look ragged
            wide = NEIGHBOUR_WIDTH * LINE_WIDTH * np.interp(line[:, 1], rows[::-1], width[::-1])
            canvas.fill([ribbon(line, np.maximum(wide, NEIGHBOUR_THINNEST * canvas.size_wh[0]))], bgr("neighbour"))


def _finite(line_px) -> np.ndarray:
    points = np.asarray(line_px, float).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def mixed(colour, other, part: float) -> tuple[int, ...]:
    """A colour with ``part`` (0..1) of another in it."""
    return tuple(round(a + part * (b - a)) for a, b in zip(colour, other, strict=True))


def ribbon(line_px: np.ndarray, width_px: np.ndarray) -> np.ndarray:
    """Outline (2 N, 2) of a line (N, 2) drawn ``width_px`` (N,) wide."""
    along = np.empty_like(line_px)
    along[1:-1], along[0], along[-1] = line_px[2:] - line_px[:-2], line_px[1] - line_px[0], line_px[-1] - line_px[-2]
    across = along[:, ::-1] * (1, -1) / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    half = across * width_px[:, None] / 2
    return np.concatenate([line_px + half, (line_px - half)[::-1]])


# ---------------------------------------------------------------------------------------------- words
def radius_text(radius_m: float | None, curvature_1pm: float | None) -> str:
    """The bend in words: "R 1.02 km left", "R 480 m right", "straight"; "" for None."""
    if radius_m is None or curvature_1pm is None:
        return ""
    if not math.isfinite(radius_m):
        return "straight"
    kilometres = f"{radius_m / 1000:.1f} km" if radius_m >= 9995 else f"{radius_m / 1000:.2f} km"
    three_digits = kilometres if radius_m >= 999.5 else f"{radius_m:.0f} m"
    return f"R {three_digits} {'left' if curvature_1pm > 0 else 'right'}"


def offset_text(offset_m: float | None) -> str:
    """Where the car is: "0.23 m left of centre"; "" for None."""
    if offset_m is None or not math.isfinite(offset_m):
        return ""
    if abs(offset_m) < 0.005:
        return "on the centre"
    return f"{abs(offset_m):.2f} m {'right' if offset_m > 0 else 'left'} of centre"


def status_text(status: str) -> str:
    """The status in words: "measured", "held from before" or "no lane"."""
    return {"measured": "measured", "held": "held from before", "none": "no lane"}.get(status, str(status))


# ---------------------------------------------------------------------------------------------- read-out
def read_out(result, size_wh: tuple[int, int]) -> Layer | None:
    """The read-out of a result as a layer for `Canvas.lay`; None where the frame is too small for words."""
    scale = max(min(size_wh[0] / 1280, size_wh[1] / 720), 0.46)  # below that, strokes would be thinner than a pixel
    widest = size_wh[0] - 8
    if widest < 110 or size_wh[1] < 60:
        return None
    if result.lane is None:
        return _card("none", "", "", "", 0.0, 0.0, scale, widest, str(result.reason))
    width = result.width_m
    width = width if width is not None and math.isfinite(width) and width > 0 else None
    place = float(np.clip(result.offset_m / width, -1, 1)) if width else 0.0
    return _card(
        result.status,
        radius_text(result.radius_m, result.curvature_1pm),
        offset_text(result.offset_m),
        f"{width:.2f} m" if width else "",
        round(place, 2),
        round(result.confidence, 2),
        scale,
        widest,
        str(result.reason) if result.status == "held" else "",
    )


@lru_cache(maxsize=32)
def _card(status, radius, offset, width, place, confidence, scale, widest, reason) -> Layer:
    """A dark card with round corners; ``place``: the car in the lane, -1/2 on the left line, 1/2 on the right one."""
    big, small, pad, thick = round(17 * scale), max(7, round(10.5 * scale)), round(16 * scale), round(13 * scale)
    inner = min(round(278 * scale), widest - 2 * pad)
    reason_lines = wrapped(reason, small, inner) if reason else []
    # base lines of the rows of text, from the top
    row_head = pad + small
    row_radius = row_head + pad + big
    row_offset = row_radius + round(0.75 * pad) + big
    row_gauge = row_offset + round(1.15 * pad)
    rows_end = row_gauge + thick if radius else row_head
    line = round(1.9 * small)
    card = _box(inner + 2 * pad, rows_end + len(reason_lines) * line + pad, round(0.7 * pad)).copy()
    # how far to trust it
    colour = {"measured": "lane area", "held": "held"}.get(status, "left line")
    dot = 0.42 * small
    _disc(card, pad + dot, row_head - small / 2 - 0.5, dot, colour)
    put_text(card, status_text(status), (pad + 2 * dot + 0.55 * small, row_head), _over("text"), cap_px=small)
    if radius:
        percent = f"{100 * confidence:.0f} %"
        put_text(card, percent, (pad + inner, row_head), _over("label"), cap_px=small, align="right")
        end = pad + inner - text_width("100 %", small) - 0.4 * small
        begin = max(end - 56 * scale, pad + 2 * dot + text_width(status_text(status), small) + 1.2 * small)
        if end - begin > 1.5 * small:
            _bar(card, begin, end, row_head - small / 2 - 0.5, max(3, round(0.5 * small)), confidence, colour)
        put_text(card, radius, (pad, row_radius), _over("text"), cap_px=big, bold=True)
        put_text(card, offset, (pad, row_offset), _over("text"), cap_px=big)
        words = f"lane width {width}"
        _gauge(card, pad, row_gauge, inner - text_width(words, small) - pad, thick, place)
        below = (pad + inner, row_gauge + (thick + small) // 2)
        put_text(card, words, below, _over("label"), cap_px=small, align="right")
    for i, words in enumerate(reason_lines, 1):
        put_text(card, words, (pad, rows_end + i * line), _over("label"), cap_px=small)
    return Layer(card)


def _over(name: str) -> tuple[int, ...]:
    """A colour that covers what lies below."""
    return *bgr(name), 255


@lru_cache(maxsize=8)
def _box(width: int, height: int, radius: int) -> np.ndarray:
    """The empty card, (height, width, 4), premultiplied."""
    mask = np.zeros((height * 4, width * 4), np.uint8)
    r, right, bottom = max(radius * 4, 1), 4 * width - 1, 4 * height - 1
    cv2.rectangle(mask, (r, 0), (right - r, bottom), 255, -1)
    cv2.rectangle(mask, (0, r), (right, bottom - r), 255, -1)
    for centre in ((r, r), (right - r, r), (r, bottom - r), (right - r, bottom - r)):
        cv2.circle(mask, centre, r, 255, -1)
    cover = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA)
    return np.round(cover[:, :, None] * (CARD_OPACITY / 255) * np.array(_over("card"))).astype(np.uint8)


def _disc(card, x, y, radius, name) -> None:
    disc_in_place(card, (x, y), _over(name), radius)


def _bar(card, x0, x1, y, thick, value, name) -> None:
    """A value 0..1 as a bar with round ends."""
    for part, colour in ((1.0, "track"), (min(max(value, 0.0), 1.0), name)):
        if part > 0:
            ends = [(round(x * ONE), round(y * ONE)) for x in (x0, x0 + part * (x1 - x0))]
            cv2.line(card, *ends, _over(colour), thick, cv2.LINE_AA, SHIFT)


def _gauge(card, x, y, width, height, place) -> None:
    """The lane from behind: left line, right line, its centre, and where the car is in it."""
    span, middle = 0.74 * width, y + (height - 1) / 2
    centre = x + (width - 1) / 2
    thin = max(1, round(0.12 * height))
    for at, tall, wide, name in (
        (centre, thin, width, "track"),
        (centre, 0.5 * height, thin, "track"),
        (centre - span / 2, height, 2 * thin, "left line"),
        (centre + span / 2, height, 2 * thin, "right line"),
    ):
        corner = round(at - wide / 2), round(middle - tall / 2)
        cv2.rectangle(card, corner, (round(corner[0] + wide) - 1, round(corner[1] + tall) - 1), _over(name), -1)
    _disc(card, centre + min(max(place, -0.65), 0.65) * span, middle, 0.42 * height, "text")


def _by(size_wh) -> str:
    return f"{size_wh[0]}x{size_wh[1]}"
