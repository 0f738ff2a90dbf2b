"""Figures of notebook 03: the road from the side, a line's brightness on two rulers, views compared, hills."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.birdseye import BirdsEye
from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import DASHES, INK, WIDTH_IN, extent_of, in_style, put_picture


@in_style
def from_the_side(height_m: float, distances_m: Sequence[float] = (6, 12, 30)) -> Figure:
    """A camera above a flat road from the side: rays to points of the road, and where they pass a plane 4 m ahead."""
    figure, a = plt.subplots(figsize=(WIDTH_IN, 2.7), layout="constrained")
    plane = 4.0
    a.axhline(0, color=INK, linewidth=1.5)
    a.plot([0, 34], [height_m, height_m], color=PALETTE["truth"], linestyle=DASHES, linewidth=1.1)
    a.annotate("to the horizon: never meets the road", (34, height_m), ha="right", xytext=(0, 4),
               textcoords="offset points")
    a.plot([plane, plane], [0.05, height_m + 0.1], color=PALETTE["accent"], linewidth=3)
    a.annotate("picture plane", (plane, height_m + 0.1), ha="center", xytext=(0, 4), textcoords="offset points")
    for i, y in enumerate(distances_m):
        colour = SERIES[i % len(SERIES)]
        a.plot([0, y], [height_m, 0], color=colour, linewidth=1.4)
        a.plot(plane, height_m * (1 - plane / y), "o", color=colour, markersize=6)
        a.plot(y, 0, "o", color=colour, markersize=7)
        a.annotate(f"y = {y:g} m", (y, 0), xytext=(0, 9), textcoords="offset points", color=colour, fontweight="bold")
    a.plot(0, height_m, "s", color=INK, markersize=10)
    a.annotate("camera", (0, height_m), xytext=(8, 5), textcoords="offset points")
    a.annotate("", (0, 0), (0, height_m), arrowprops={"arrowstyle": "<->", "color": INK})
    a.annotate("h", (0, height_m / 2), xytext=(6, 0), textcoords="offset points", fontweight="bold")
    a.set(xlim=(-0.6, 34.5), ylim=(-0.1, height_m + 0.45), xlabel="distance ahead, m", yticks=[])
    a.grid(False)
    return figure


@in_style
def along_line(rulers: Mapping[str, Sequence[float]], brightness: Sequence[float], period_m: float) -> Figure:
    """Brightness along a dashed line on several rulers, {name: distance of each sample}; dots at the middles of dashes,
    dashed lines every true period from the first one on."""
    figure, axes = plt.subplots(len(rulers), 1, figsize=(WIDTH_IN, 1.6 * len(rulers) + 0.4), layout="constrained",
                                sharex=True)
    for i, (a, (name, y)) in enumerate(zip(np.atleast_1d(axes), rulers.items(), strict=True)):
        a.plot(y, brightness, color=SERIES[i], linewidth=1.3)
        middles = dash_middles(y, brightness)
        if len(middles):
            for line in middles[0] + period_m * np.arange(0, 4):
                a.axvline(line, color=PALETTE["truth"], linestyle=DASHES, linewidth=1.1)
        a.plot(middles, np.full(len(middles), 60), "^", color=PALETTE["none"], markersize=8, clip_on=False)
        a.set(ylabel="brightness", xlim=(4, 45), ylim=(50, 265))
        a.set_title(name, fontsize=9.5)
    key = f"triangles: middles of dashes; dashed: every {period_m:.2f} m from the first; a spike: a reflector"
    np.atleast_1d(axes)[-1].set_xlabel(f"distance ahead, m   ({key})")
    return figure


def dash_middles(y_m, brightness, *, far_m: float = 45.0) -> np.ndarray:
    """Distances of the middles of whole dashes, nearest first; ``y_m`` rises. A dash is brighter than half of the range
    for 2 m and more (a reflector is shorter); chipped paint may leave gaps of up to 1 m in it."""
    y, values = np.asarray(y_m, float), np.asarray(brightness, float)
    bright = values > (np.percentile(values, 10) + np.percentile(values, 98)) / 2
    edges = np.flatnonzero(np.diff(bright.astype(int)))
    starts, ends = y[edges[~bright[edges]]], y[edges[bright[edges]]]
    ends = ends[np.searchsorted(ends, starts[0]) :] if len(starts) else ends  # a dash that is cut off has no middle
    runs: list[list[float]] = []
    for start, end in zip(starts, ends, strict=False):
        if runs and start - runs[-1][1] < 1.0:
            runs[-1][1] = end
        else:
            runs.append([start, end])
    return np.array([(start + end) / 2 for start, end in runs if end - start > 2.0 and end < far_m])


@in_style
def views(undistorted: np.ndarray, by_name: Mapping[str, BirdsEye], lines_m: Sequence[float] = ()) -> Figure:
    """The bird's-eye views of one picture in several geometries (`BirdsEye`), on the same scale; ``lines_m``: where
    the lines of a straight lane truly are, dashed."""
    figure, axes = plt.subplots(1, len(by_name), figsize=(2.6 * len(by_name) + 0.5, 4.6), layout="constrained",
                                sharey=True)
    for a, (name, view) in zip(np.atleast_1d(axes), by_name.items(), strict=True):
        put_picture(a, view.warp(undistorted), name, extent_of(view.grid))
        for x in lines_m:
            reference = a.axvline(x, color=PALETTE["trapezoid"], linestyle=DASHES, linewidth=1)
        a.set(xlabel="x, m")
        a.grid(color="white", alpha=0.2)
        a.set_axisbelow(False)
    np.atleast_1d(axes)[0].set_ylabel("y ahead, m")
    if len(lines_m):
        figure.legend([reference], ["dashed: where the lines truly are"], loc="outside lower center")
    return figure


@in_style
def hill(height_m: float, *, change: float = 0.02, at_m: float = 15.0, far_m: float = 45.0) -> Figure:
    """A road that rises (or falls) by ``change`` from ``at_m`` on, and where a flat road would put its points."""
    figure, (a, b) = plt.subplots(1, 2, figsize=(WIDTH_IN, 3.2), layout="constrained")
    y = np.linspace(5, far_m, 200)
    for sign, colour, name, style in ((1, PALETTE["none"], f"rises by {100 * change:g} %", "-"),
                                      (-1, PALETTE["right"], f"falls by {100 * change:g} %", "--")):
        z = sign * change * np.maximum(y - at_m, 0)
        a.plot(y, z, color=colour, linestyle=style, label=name)
        b.plot(y, y * height_m / (height_m - z), color=colour, linestyle=style, label=name)
    a.plot(0, height_m, "s", color=INK, markersize=9)
    a.axhline(0, color=PALETTE["truth"], linestyle=DASHES, linewidth=1)
    a.set(xlabel="distance ahead, m", ylabel="height of the road, m", title="the road from the side")
    b.plot(y, y, color=PALETTE["truth"], linestyle=DASHES, linewidth=1, label="flat")
    b.set(xlabel="true distance, m", ylabel="distance measured, m", ylim=(0, 100),
          title="what the flat road makes of it")
    b.legend()
    return figure
