"""Whole screens: everything about one frame, or the road from above, composed at 1280x720."""

from __future__ import annotations

import numpy as np

from lanelib.draw.lettering import put_text, shortened, text_width, wrapped
from lanelib.draw.marks import disc_in_place
from lanelib.draw.overlays import offset_text, overlay, radius_text, status_text
from lanelib.draw.palette import bgr
from lanelib.draw.panels import GAP, fitted, histogram_panel


def diagnostic(frame_bgr: np.ndarray, stages: dict, result, *, size_wh: tuple[int, int] = (1280, 720)) -> np.ndarray:
    """Everything about one frame on one picture of ``size_wh`` (16:9).

    The overlay, mask, evidence, bird's-eye view with windows and with the fit, histogram, and numbers. ``stages``:
    pictures by name as `lanelib.stages` gives them; missing ones stay empty.
    """
    out = np.full((720, 1280, 3), bgr("desk"), np.uint8)
    # two rows, three columns; widths such that overlay (16:9) and bird's-eye views (2:3) are of one height
    columns, rows = ((12, 704), (728, 264), (1004, 264)), ((36, 396), (470, 195))

    def place(picture, title, x, y, w, h, *, stretch=False):
        put_text(out, title, (x, y - 9), bgr("label"), cap_px=10)
        if picture is None:
            out[y : y + h, x : x + w] = bgr("card")
            put_text(out, "not available", (x + w / 2, y + h / 2 + 5), bgr("track"), cap_px=10, align="centre")
        else:
            out[y : y + h, x : x + w] = fitted(picture, (w, h), stretch=stretch)

    def cell(column, row):
        return columns[column][0], rows[row][0], columns[column][1], rows[row][1]

    place(overlay(frame_bgr, result, text=False), "lane on the frame", *cell(0, 0))
    place(stages.get("windows"), "sliding windows on the mask", *cell(1, 0))
    place(stages.get("fit"), "paint points and fitted lane", *cell(2, 0))
    x, y, w, h = cell(0, 1)
    half = (w - GAP) // 2
    place(stages.get("mask"), "mask of the recipe", x, y, half, h)
    place(stages.get("evidence"), "evidence for paint, from above", x + half + GAP, y, half, h, stretch=True)
    mask = stages.get("birdseye_mask")
    x, y, w, h = cell(1, 1)
    place(None if mask is None else histogram_panel(mask, (w, h)), "pixels per column, lower half", x, y, w, h)
    put_text(out, "at the car", (columns[2][0], rows[1][0] - 9), bgr("label"), cap_px=10)
    _numbers(out, result, cell(2, 1))
    _status_bar(out, result, 12, 698, 1256)
    return out if tuple(size_wh) == (1280, 720) else fitted(out, size_wh)


def birdseye_beside(
    above: np.ndarray, frame_bgr: np.ndarray, result, *, size_wh: tuple[int, int] = (1280, 720)
) -> np.ndarray:
    """A bird's-eye picture (2:3, as `birdseye` gives it) at full height, the overlay and the numbers beside it."""
    out = np.full((720, 1280, 3), bgr("desk"), np.uint8)
    out[:, :480] = fitted(above, (480, 720))
    out[60:494, 496:1268] = fitted(overlay(frame_bgr, result, text=False), (772, 434))
    _numbers(out, result, (496, 510, 772, 110))
    _status_bar(out, result, 496, 660, 772)
    return out if tuple(size_wh) == (1280, 720) else fitted(out, size_wh)


def _status_bar(out, result, x, base, width) -> None:
    """Status, confidence, time and reason in one line."""
    colour = {"measured": "lane area", "held": "held"}.get(result.status, "left line")
    disc_in_place(out, (x + 6, base - 6), bgr(colour), 6)
    words = status_text(result.status)
    put_text(out, words, (x + 20, base), bgr("text"), cap_px=12, bold=True)
    rest = [f"confidence {100 * result.confidence:.0f} %", f"{result.milliseconds:.1f} ms"]
    rest += [str(result.reason)] if result.reason else []
    at = x + 20 + text_width(words, 12, bold=True) + 16
    put_text(out, shortened(" · ".join(rest), 11, width - (at - x)), (at, base), bgr("label"), cap_px=11)


def _numbers(out, result, box) -> None:
    """A table of what was measured, with standard deviations where they are known."""
    x, y, w, h = box
    out[y : y + h, x : x + w] = bgr("card")
    if result.lane is None:
        put_text(out, "no lane", (x + 16, y + 36), bgr("text"), cap_px=15, bold=True)
        for i, words in enumerate(wrapped(str(result.reason), 11, w - 32, max_lines=5)):
            put_text(out, words, (x + 16, y + 66 + 22 * i), bgr("label"), cap_px=11)
        return
    std = getattr(result.lane, "std", None) or {}

    def plus(key, digits, times=1):
        return f" ±{times * std[key]:.{digits}f}" if np.isfinite(std.get(key, np.nan)) else ""

    rows = [
        ("radius", radius_text(result.radius_m, result.curvature_1pm).removeprefix("R ")),
        ("curvature", f"{1000 * result.curvature_1pm:+.2f}{plus('curvature_1pm', 2, 1000)} /km"),
        ("offset", offset_text(result.offset_m).removesuffix(" of centre")),
        ("lane width", f"{result.width_m:.2f}{plus('width_m', 2)} m"),
        ("seen to", f"{result.lane.y_range_m[1]:.0f} m"),
    ]
    if w > 500:  # wide: one column each, the number below its name
        pitch = w / len(rows)
        for i, (label, value) in enumerate(rows):
            put_text(out, label, (x + i * pitch + 16, y + h / 2 - 14), bgr("label"), cap_px=11)
            put_text(out, shortened(value, 12, pitch - 8), (x + i * pitch + 16, y + h / 2 + 18), bgr("text"), cap_px=12)
        return
    pitch = h / len(rows)
    for i, (label, value) in enumerate(rows):
        base = round(y + (i + 0.5) * pitch + 6)
        if i:
            out[round(y + i * pitch), x + 14 : x + w - 14] = bgr("rule")
        put_text(out, label, (x + 16, base), bgr("label"), cap_px=11)
        put_text(out, value, (x + w - 16, base), bgr("text"), cap_px=12, align="right")
