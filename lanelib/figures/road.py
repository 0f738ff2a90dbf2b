"""Figures in metres on the road: the warp, the column histogram, the fit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import DASHES, INK, WIDTH_IN, extent_of, in_style, put_picture, rgb
from lanelib.search import find_peaks, histogram


@in_style
def warp(undistorted, birdseye, *, corners_m=None) -> Figure:
    """A picture and its bird's-eye view; the same rectangle on the road, ``corners_m`` (4, 2), is drawn into both."""
    grid = birdseye.grid
    if corners_m is None:
        near, far = max(grid.y_m[-1], 7.0), min(grid.y_m[0], 30.0)
        corners_m = [(-1.85, far), (1.85, far), (1.85, near), (-1.85, near)]
    corners_m = np.asarray(corners_m, float)
    height, width = undistorted.shape[:2]
    figure, (a, b) = plt.subplots(1, 2, figsize=(WIDTH_IN, 4.2), layout="constrained", width_ratios=(7, 2.8))
    along = np.linspace(0, 1, 20)[:, None]
    outline = np.concatenate(
        [p + along * (q - p) for p, q in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True)]
    )
    put_picture(a, undistorted, "undistorted picture")
    seen = birdseye.points_from_road(outline)
    a.plot(*seen.T, color=PALETTE["trapezoid"], linewidth=2)
    a.plot(
        *birdseye.points_from_road(corners_m).T, "o", color=PALETTE["trapezoid"], markeredgecolor="white", markersize=7
    )
    a.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    put_picture(b, birdseye.warp(undistorted), "bird's-eye view", extent_of(grid))
    b.plot(*outline.T, color=PALETTE["trapezoid"], linewidth=2)
    b.plot(*corners_m.T, "o", color=PALETTE["trapezoid"], markeredgecolor="white", markersize=7)
    b.set(xlabel="x to the right, m", ylabel="y ahead, m")
    b.grid(color="white", alpha=0.25)
    b.set_axisbelow(False)
    return figure


@in_style
def column_histogram(mask, *, centre: float | None = None) -> Figure:
    """A bird's-eye mask above the histogram of its lower half, the two peaks marked."""
    sums = histogram(mask)
    figure, (a, b) = plt.subplots(2, 1, figsize=(6, 5.2), layout="constrained", height_ratios=(2.2, 1), sharex=True)
    a.imshow(rgb(mask), aspect="auto")
    a.set(title="bird's-eye mask", yticks=[])
    a.axhline(len(mask) // 2, color=PALETTE["window"], linewidth=1.2, linestyle="--")
    a.grid(False)
    b.fill_between(np.arange(len(sums)), sums, color=PALETTE["accent"], alpha=0.6, linewidth=0)
    for side, peak in zip(("left", "right"), find_peaks(sums, centre=centre), strict=True):
        if peak is not None:
            b.axvline(peak, color=PALETTE[side], label=f"{side}: column {peak}")
    b.set(xlabel="column", ylabel="pixels in the lower half")
    b.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=2)
    b.set_ylim(0, None)
    return figure


@in_style
def fit(
    lane=None,
    *,
    points_m: Mapping[str, np.ndarray] | None = None,
    lines: Mapping[str, object] | None = None,
    truth_m=None,
    y_max_m: float | None = None,
    view=None,
    grid=None,
) -> Figure:
    """Points and fitted lines on the road, in metres, with a band of two standard deviations.

    ``points_m``: {"left": (N, 2), "right": (N, 2)}; ``lines``: further {name: `lane.Line`}; ``truth_m``: [left,
    right], each (N, 2), drawn up to ``y_max_m``; ``view`` with its uniform ``grid``: a bird's-eye picture below it
    all.
    """
    figure, a = plt.subplots(figsize=(5.2, 6.4), layout="constrained")
    if view is not None:
        a.imshow(rgb(view), extent=extent_of(grid), aspect="auto", alpha=0.75)
    for name, xy in (points_m or {}).items():
        x, y = np.asarray(xy, float).reshape(-1, 2).T
        a.plot(x, y, ".", color=PALETTE.get(name, PALETTE["other"]), markersize=3, alpha=0.45)
    named = {"left": lane.left, "right": lane.right} if lane is not None else {}
    series = iter(SERIES[2:])
    for name, line in {**named, **(lines or {})}.items():
        y = np.linspace(0, y_max_m or max(line.y_range_m[1], 5.0), 120)
        colour = PALETTE[name] if name in ("left", "right") else next(series)
        x, std = line.x(y), line.std_x_m(y)
        a.plot(x, y, color=colour, label=f"{name} line: {_bend(line)}" if name in named else f"{name}: {_bend(line)}")
        if np.isfinite(std).all():
            a.fill_betweenx(y, x - 2 * std, x + 2 * std, color=colour, alpha=0.2, linewidth=0)
    for i, xy in enumerate(truth_m or ()):
        x, y = _up_to(np.asarray(xy, float), y_max_m).T  # what is not shown must not widen the axis
        words = "truth" if i == 0 else None
        a.plot(x, y, color=PALETTE["truth"], linestyle=DASHES, linewidth=1.2, label=words)
    a.plot(0, 0, marker="^", color=INK, markersize=10, clip_on=False)
    a.set(xlabel="x to the right, m", ylabel="y ahead, m", ylim=(0, y_max_m))
    if len(a.get_legend_handles_labels()[0]):
        a.legend(loc="upper left", bbox_to_anchor=(0, -0.1))  # in one column: a wider one would squeeze the axes
    return figure


def _up_to(xy: np.ndarray, y_max_m: float | None) -> np.ndarray:
    """The points (N, 2), y rising, up to ``y_max_m``, where the line is cut."""
    x, y = xy.T
    if y_max_m is None or y[-1] <= y_max_m:
        return xy
    return np.vstack([xy[y < y_max_m], (np.interp(y_max_m, y, x), y_max_m)])


def _bend(line) -> str:
    radius = line.radius_m()
    side = "left" if line.curvature_1pm() > 0 else "right"
    return "straight" if math.isinf(radius) else f"R {radius:.0f} m, bends {side}"
