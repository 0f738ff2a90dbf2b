"""Figures of notebook 07: where the time goes, and what overlaps; with the stopwatch that they are drawn from."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.birdseye import BirdsEye
from lanelib.draw import PALETTE, SERIES, bgr
from lanelib.figures.style import INK, SOFT, WIDTH_IN, in_style
from lanelib.lane import Lane

# A step has one colour in all bars, and what does the same work has the same
STEP_COLOURS = {
    **dict(zip(("undistort", "threshold", "warp", "windows", "fit", "draw"), SERIES, strict=True)),
    "frame to lane": PALETTE["paint"],
    "draw the polygon": SERIES[5],
}
LARGEST_BYTES = 30 << 20  # larger than any array of a frame, and below the 32 MB up to which glibc learns


def milliseconds(steps: Mapping[str, Callable[[], object]], *, repeat: int = 7) -> dict[str, float]:
    """CPU time of each step in ms, the best of ``repeat`` calls in a row, in one thread: what another program takes
    away shows in the others."""
    with _one_thread():
        return {name: min(_once(step) for _ in range(repeat)) for name, step in steps.items()}


def more_ms(step: Callable[[], object], than: Callable[[], object], *, repeat: int = 100) -> float:
    """By how many ms of CPU time ``step`` takes longer ``than`` another, in one thread: the median of so many calls in
    turn, so that what slows the computer down for a while slows both. Tells some hundredths of a millisecond."""
    with _one_thread():
        return float(np.median([_once(step) - _once(than) for _ in range(repeat)]))


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV in one thread, memory as in a program that has run for a while.

    glibc gives freed memory back to the kernel where there is more of it than twice the largest array freed so far. At
    first that is nearly all, at every call, and to fetch it anew, one page fault after the other, may cost three times
    as much as the work itself. One large array, freed, ends this.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    large = np.empty(LARGEST_BYTES, np.uint8)
    del large
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _once(step: Callable[[], object]) -> float:
    began = time.process_time()
    step()
    return (time.process_time() - began) * 1e3


def warped_back_overlay(undistorted_bgr: np.ndarray, birdseye: BirdsEye, lane: Lane) -> np.ndarray:
    """The textbook's way to draw a lane: fill it in the bird's-eye view, warp that picture back, blend the whole frame.

    ``undistorted_bgr`` (H, W, 3) uint8: the textbook shows the lane on the undistorted picture.
    """
    y = np.linspace(*birdseye.grid.y_m[[0, -1]], 60)
    pixel_from_road = np.linalg.inv(birdseye.grid.road_from_pixel)
    sides = [np.column_stack([line.x(y), y]) for line in (lane.left, lane.right)]
    outline = np.concatenate([sides[0], sides[1][::-1]])
    columns_rows = outline @ pixel_from_road[:2, :2].T + pixel_from_road[:2, 2]
    green = np.zeros((*birdseye.grid.size_wh[::-1], 3), np.uint8)
    cv2.fillPoly(green, [np.round(columns_rows).astype(np.int32)], bgr("lane area"))
    return cv2.addWeighted(undistorted_bgr, 1, birdseye.unwarp(green), 0.35, 0)


def ink_on(colour: str) -> str:
    """What can be read on a colour "#rrggbb": white, or ink where that stands out clearly more (contrast: WCAG 2)."""

    def luminance(code: str) -> float:
        s = np.array(bgr(code)[::-1]) / 255
        return float(np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])

    paper = luminance(colour) + 0.05
    return INK if paper / (luminance(INK) + 0.05) > 1.2 * 1.05 / paper else "#ffffff"


@in_style
def stacked(orders: Mapping[str, Mapping[str, float]], *, title: str = "") -> Figure:
    """Each order as a bar of its steps, in ms; the sum at its end. Every step is named in the legend; those below a
    twelfth of the longest bar have no room for their number."""
    figure, a = plt.subplots(figsize=(WIDTH_IN, 0.75 * len(orders) + 1.3), layout="constrained")
    longest = max(sum(steps.values()) for steps in orders.values())
    named = {}
    for i, (name, steps) in enumerate(orders.items()):
        left = 0.0
        for step, value in steps.items():
            colour = STEP_COLOURS.get(step, SOFT)
            named[step] = a.barh(i, value, left=left, color=colour, edgecolor="white", height=0.62)
            if value > longest / 12:
                a.text(left + value / 2, i, f"{step}\n{value:.1f}", ha="center", va="center", fontsize=8,
                       color=ink_on(colour))
            left += value
        a.annotate(f"{name}: {left:.1f} ms", (left, i), xytext=(6, 0), textcoords="offset points", va="center",
                   fontsize=9)
    figure.legend(named.values(), named, loc="outside upper right", ncols=len(named), columnspacing=1.2,
                  handlelength=1.2)
    a.set(yticks=[], xlabel="CPU time, ms a frame", title=title)
    a.set_xlim(0, 1.3 * longest)
    a.invert_yaxis()
    a.grid(axis="y", visible=False)
    return figure


@in_style
def over_size(widths_cm: Sequence[float], errors_cm: Mapping[str, Sequence[float]]) -> Figure:
    """Errors over the width of a column of the bird's-eye view, both logarithmic."""
    figure, a = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
    for name, values in errors_cm.items():
        a.plot(widths_cm, values, marker="o", markersize=4.5, label=name)
    a.set(xscale="log", yscale="log", xlabel="width of a column, cm", ylabel="error at 20 m, cm")
    a.set_xticks(widths_cm, [f"{w:.4g}" for w in widths_cm])
    top = 1.3 * max(map(max, errors_cm.values()))
    levels = [level for level in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if level < top]
    a.set_yticks(levels, [f"{level:g}" for level in levels])
    a.minorticks_off()
    a.legend()
    return figure


@in_style
def timelines(stage_ms: Mapping[str, float], *, frames: int = 5) -> Figure:
    """The same stages one after the other and overlapped, over time; the number in a box is the frame's."""
    names, spans = list(stage_ms), list(stage_ms.values())
    figure, axes = plt.subplots(2, 1, figsize=(WIDTH_IN, 3.4), layout="constrained", sharex=True)
    for a, overlapped in zip(axes, (False, True), strict=True):
        for frame, begins in enumerate(_schedule(spans, frames, overlapped=overlapped)):
            for row, begin in enumerate(begins):
                a.barh(row, spans[row], left=begin, color=SERIES[frame % len(SERIES)], edgecolor="white", height=0.8)
                a.text(begin + spans[row] / 2, row, str(frame), ha="center", va="center", fontsize=8,
                       color=ink_on(SERIES[frame % len(SERIES)]))
        a.set_yticks(range(len(names)), names, color=INK)
        a.invert_yaxis()
        a.grid(axis="y", visible=False)
        a.set_title("decode, process and encode overlap" if overlapped else "one after the other")
    axes[1].set_xlabel("time, ms")
    return figure


def _schedule(spans: Sequence[float], frames: int, *, overlapped: bool) -> list[list[float]]:
    """When each stage of each frame begins: when the frame is there and the stage is free."""
    free, done, begins = [0.0] * len(spans), 0.0, []
    for _ in range(frames):
        at, row = (0.0 if overlapped else done), []
        for i, span in enumerate(spans):
            begin = max(at, free[i])
            row.append(begin)
            at = free[i] = begin + span
        done = at
        begins.append(row)
    return begins
