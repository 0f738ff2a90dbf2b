"""Charts drawn with OpenCV in a few milliseconds, for pictures that change with every tick of a slider."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lanelib.draw import Canvas, bgr, put_text
from lanelib.draw.lettering import text_width
from lanelib.draw.marks import line_in_place

LEFT, RIGHT, TOP, BOTTOM = 62, 14, 28, 26  # margins of a chart, px
CAP_PX = 10


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a chart; NaN in ``y`` leaves a gap. ``points``: dots instead of a line."""

    name: str
    x: np.ndarray
    y: np.ndarray
    colour: str
    width_px: float = 2.0
    points: bool = False


def nice_step(span: float, count: int = 5) -> float:
    """The distance of some ``count`` ticks over ``span``: 1, 2 or 5 times a power of ten."""
    if not (span > 0 and math.isfinite(span)):
        return 1.0
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    return next(s * power for s in (1, 2, 5, 10) if s * power >= raw * 0.999)


def ticks_in(span: tuple[float, float], count: int = 5) -> tuple[np.ndarray, float]:
    """Some ``count`` (4 or more) ticks over ``span`` (low, high), at least two of them, and their distance."""
    for more in (count, 2 * count):
        step = nice_step(span[1] - span[0], more)
        ticks = np.arange(math.ceil(span[0] / step - 1e-6), math.floor(span[1] / step + 1e-6) + 1) * step
        if len(ticks) > 1:
            break
    return ticks, step


def line_chart(
    curves: Sequence[Curve],
    size_wh: tuple[int, int],
    *,
    title: str = "",
    x_unit: str = "",
    y_range: tuple[float, float] | None = None,
    cursor: float | None = None,
    shaded: np.ndarray | None = None,
) -> np.ndarray:
    """Curves over a common axis, (H, W, 3) BGR, with ticks and a legend; ``cursor``: an upright line at that x.

    ``shaded`` (N, 2): stretches of x to be shaded.
    """
    width, height = size_wh
    out = np.full((height, width, 3), bgr("card"), np.uint8)
    x_low, x_high = _range([c.x for c in curves])
    y_low, y_high = y_range or _range([c.y for c in curves], pad=0.08)
    box = (LEFT, TOP, width - RIGHT, height - BOTTOM)

    def at(x, y):
        u = box[0] + (np.asarray(x, float) - x_low) / (x_high - x_low) * (box[2] - box[0])
        v = box[3] - (np.asarray(y, float) - y_low) / (y_high - y_low) * (box[3] - box[1])
        return np.column_stack([u, np.clip(v, box[1] - 4, box[3] + 4)])

    canvas = Canvas.of_bgr(out)
    for begin, end in np.asarray(shaded if shaded is not None else np.empty((0, 2)), float).reshape(-1, 2):
        (u0, _), (u1, _) = at([begin, end], [y_low, y_low])
        canvas.fill([np.array([(u0, box[1]), (u1, box[1]), (u1, box[3]), (u0, box[3])])], bgr("held"), opacity=0.25)
    _ticks(out, box, (y_low, y_high), at, vertical=True)
    _ticks(out, box, (x_low, x_high), at, vertical=False, unit=x_unit)
    legend = width - RIGHT
    for curve in reversed(curves):
        put_text(out, curve.name, (legend, 18), bgr("label"), cap_px=CAP_PX, align="right")
        legend -= text_width(curve.name, CAP_PX) + 6
        line_in_place(out, [(legend - 16, 13), (legend, 13)], bgr(curve.colour), 3)
        legend -= 34
    put_text(out, title, (10, 18), bgr("title"), cap_px=CAP_PX + 1)
    for curve in curves:
        on = at(curve.x, curve.y)
        known = np.isfinite(on).all(axis=1)
        if curve.points:
            for u, v in on[known]:
                out[max(round(v) - 1, 0) : round(v) + 2, max(round(u) - 1, 0) : round(u) + 2] = bgr(curve.colour)
            continue
        for run in np.split(np.arange(len(on)), np.flatnonzero(np.diff(known)) + 1):
            if len(run) > 1 and known[run[0]]:
                line_in_place(out, on[run], bgr(curve.colour), curve.width_px)
    if cursor is not None:
        u = at([cursor], [y_low])[0, 0]
        line_in_place(out, [(u, box[1] - 2), (u, box[3] + 2)], bgr("text"), 1)
    return out


def histogram_chart(
    counts: np.ndarray,
    domain: tuple[float, float],
    chosen: tuple[float, float],
    size_wh: tuple[int, int],
    *,
    of_paint: np.ndarray | None = None,
    title: str = "",
) -> np.ndarray:
    """A histogram (N,) over ``domain`` with the ``chosen`` range lit, and above it that of paint alone.

    Heights are square roots of the counts, each histogram against its own highest bar: paint is one pixel in a
    hundred, and would not be seen otherwise.
    """
    width, height = size_wh
    out = np.full((height, width, 3), bgr("card"), np.uint8)
    box = (LEFT, TOP, width - RIGHT, height - BOTTOM)
    low, high = domain

    def column(value):
        return box[0] + (np.clip(value, low, high) - low) / (high - low) * (box[2] - box[0])

    canvas = Canvas.of_bgr(out)
    u0, u1 = column(chosen[0]), max(column(min(chosen[1], high)), column(chosen[0]) + 1)
    canvas.fill([np.array([(u0, box[1]), (u1, box[1]), (u1, box[3]), (u0, box[3])])], bgr("accent"), opacity=0.22)
    at = np.linspace(box[0], box[2], len(counts))
    legend = width - RIGHT
    for name, bars, colour in (("all pixels", counts, "track"), ("paint", of_paint, "paint")):
        if bars is None:
            continue
        top = np.sqrt(np.asarray(bars, float))
        line = np.column_stack([at, box[3] - top / max(float(top.max(initial=0.0)), 1e-9) * (box[3] - box[1])])
        if colour == "track":
            canvas.fill([np.concatenate([line, [(box[2], box[3]), (box[0], box[3])]])], bgr(colour), opacity=0.8)
        line_in_place(out, line, bgr("label" if colour == "track" else colour), 1.5)
        put_text(out, name, (legend, 18), bgr("label"), cap_px=CAP_PX, align="right")
        legend -= text_width(name, CAP_PX) + 6
        line_in_place(out, [(legend - 16, 13), (legend, 13)], bgr("label" if colour == "track" else colour), 3)
        legend -= 34
    for u in (u0, u1):
        line_in_place(out, [(u, box[1] - 3), (u, box[3] + 3)], bgr("accent"), 2)
    _ticks(out, box, domain, lambda x, y: np.column_stack([column(np.asarray(x)), np.asarray(y)]), vertical=False)
    put_text(out, title, (10, 18), bgr("title"), cap_px=CAP_PX + 1)
    return out


def _range(values: Sequence[np.ndarray], *, pad: float = 0.0) -> tuple[float, float]:
    flat = np.concatenate([np.asarray(v, float).ravel() for v in values] or [np.empty(0)])
    flat = flat[np.isfinite(flat)]
    low, high = (float(flat.min()), float(flat.max())) if len(flat) else (0.0, 1.0)
    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    return low - pad * (high - low), high + pad * (high - low)


def _ticks(out, box, span, at, *, vertical: bool, unit: str = "") -> None:
    ticks, step = ticks_in(span, 4 if vertical else 8)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    for tick in ticks:
        words = f"{0.0 if abs(tick) < step / 1e6 else tick:.{digits}f}"
        if vertical:
            v = at([0], [tick])[0, 1]
            line_in_place(out, [(box[0], v), (box[2], v)], bgr("rule"), 1)
            put_text(out, words, (box[0] - 6, v + 4), bgr("label"), cap_px=9, align="right")
        else:
            u = at([tick], [span[0]])[0, 0]
            line_in_place(out, [(u, box[3]), (u, box[3] + 4)], bgr("label"), 1)
            put_text(out, f"{words} {unit}".strip(), (u, box[3] + 18), bgr("label"), cap_px=9, align="centre")
