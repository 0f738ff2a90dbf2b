"""Figures of notebook 02: profiles across the lane, channels ranked, masks against the true paint, recipes compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.channels import CHANNELS
from lanelib.draw import PALETTE, SERIES
from lanelib.figures.pictures import thresholds
from lanelib.figures.style import INK, WIDTH_IN, in_style, put_picture
from lanelib.threshold import SIDE_DISTANCE, Gradients, direction, magnitude

MARKERS = "osD^vP"
SHADE = "#c3c9d0"  # true paint behind curves: grey, for yellow and green are series


def masks(frame_bgr, by_name: Mapping[str, np.ndarray], truth, *, rows: slice = slice(390, 690), columns: int = 2):
    """`figures.thresholds` of the road alone: what ``truth`` (`explore.PaintTruth`) does not judge is not shown."""
    judged = {name: ((np.asarray(mask) != 0) & truth.road)[rows] for name, mask in by_name.items()}
    return thresholds(frame_bgr[rows], judged, paint=truth.paint[rows], columns=columns)


@in_style
def profiles(frames: Mapping[str, np.ndarray], truths: Sequence, row: int) -> Figure:
    """Brightness (R + G) / 2 and yellowness min(R, G) - B along one row of several frames; true paint is shaded."""
    figure, axes = plt.subplots(len(frames), 1, figsize=(WIDTH_IN, 1.45 * len(frames) + 0.5), layout="constrained",
                                sharex=True, sharey=True)
    for a, (name, frame), truth in zip(np.atleast_1d(axes), frames.items(), truths, strict=True):
        blue, green, red = frame[row].astype(float).T
        x = np.arange(len(red))
        a.fill_between(x, 0, 255, where=truth.paint[row], color=SHADE, linewidth=0, label="true paint")
        a.plot(x, (red + green) / 2, color=INK, linewidth=1.1, label="brightness")
        a.plot(x, np.minimum(red, green) - blue, color=PALETTE["none"], linewidth=1.1, linestyle="--",
               label="yellowness")
        a.set(ylim=(-30, 275), ylabel="grey levels", xlim=(150, 1150))
        a.set_title(name, fontsize=9.5)
    figure.legend(*np.atleast_1d(axes)[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    np.atleast_1d(axes)[-1].set_xlabel(f"column of row {row}, px")
    return figure


@in_style
def gradients(frame_bgr: np.ndarray, found: Gradients, *, top: float = 20.0) -> Figure:
    """A picture and its gradients (`threshold.sobel`): |Sobel x|, magnitude and direction, each with its scale, which
    ends at ``top`` grey levels a pixel."""
    panels = {"|Sobel x|": (np.abs(found.x), top, "grey levels a pixel"),
              "magnitude": (magnitude(found), top, "grey levels a pixel"),
              "direction": (np.rad2deg(direction(found)), 90.0, "degrees")}
    height, width = frame_bgr.shape[:2]
    figure, axes = plt.subplots(2, 2, figsize=(WIDTH_IN, 8.6 * height / width + 0.9), layout="constrained")
    put_picture(axes[0, 0], frame_bgr, "frame")
    for a, (name, (values, largest, unit)) in zip(axes.flat[1:], panels.items(), strict=True):
        put_picture(a, draw.heat(values, top=largest), name)
        scale = ScalarMappable(Normalize(0, largest), "inferno")  # the colours of draw.heat
        figure.colorbar(scale, ax=a, label=unit, aspect=12, pad=0.02)
    return figure


def separation(values: np.ndarray, paint: np.ndarray, road: np.ndarray) -> float:
    """Chance that a pixel of paint has a higher value than a pixel of the road beside it (the area under the ROC
    curve): 1 separates by some threshold, 0.5 tells nothing, 0 separates the other way round."""
    of_paint, of_road = values[paint], values[road & ~paint]
    below = np.searchsorted(np.sort(of_road), of_paint, side="left")
    upto = np.searchsorted(np.sort(of_road), of_paint, side="right")
    return float(((below + upto) / 2).mean() / len(of_road))


@in_style
def separations(frames: Mapping[str, np.ndarray], paints: Sequence, roads: Sequence, names: Sequence[str]) -> Figure:
    """`separation` of channels (rows) on several paints (columns) as a table of shades."""
    table = np.array([[max(s, 1 - s) for s in (separation(CHANNELS[name](frame), paint, road)
                       for frame, paint, road in zip(frames.values(), paints, roads, strict=True))]
                      for name in names])
    figure, a = plt.subplots(figsize=(1.45 * len(frames) + 1.6, 0.31 * len(names) + 1.4), layout="constrained")
    a.imshow(table, cmap="cividis", vmin=0.5, vmax=1, aspect="auto")
    for (i, j), value in np.ndenumerate(table):
        a.text(j, i, f"{value:.2f}", ha="center", va="center", color="white" if value < 0.8 else "black", fontsize=9)
    a.set_xticks(range(len(frames)), list(frames))
    a.set_yticks(range(len(names)), names)
    a.tick_params(length=0, labelcolor=INK, labelsize=9)
    a.xaxis.tick_top()
    figure.suptitle("how often paint and road are told apart (0.5 is a coin)", x=0.01, ha="left", fontsize=10.5,
                    fontweight="bold")
    a.grid(False)
    return figure


@in_style
def best_thresholds(values: Mapping[str, np.ndarray], truths: Sequence, *, low: int = 60) -> Figure:
    """F1, the harmonic mean of precision and recall, over the threshold of one channel, for several frames."""
    figure, a = plt.subplots(figsize=(9, 3.4), layout="constrained")
    levels = np.arange(low, 256)
    for i, ((name, channel), truth) in enumerate(zip(values.items(), truths, strict=True)):
        on_paint = np.bincount(channel[truth.paint], minlength=256)[::-1].cumsum()[::-1]
        on_road = np.bincount(channel[truth.road], minlength=256)[::-1].cumsum()[::-1]
        f1 = 2 * on_paint / (on_road + truth.paint.sum())
        colour = SERIES[i % len(SERIES)]
        a.plot(levels, f1[levels], color=colour, label=name)
        best = int(f1.argmax())
        a.plot(best, f1[best], MARKERS[i % len(MARKERS)], color=colour, markersize=8)
    a.set(xlabel="threshold", ylabel="F1 of the mask", title="one channel, one threshold: the best one is marked",
          ylim=(0, 1))
    a.legend(loc="upper left", bbox_to_anchor=(1.01, 1))
    return figure


@in_style
def precision_and_recall(scores: Mapping[str, Mapping[str, tuple[float, float]]], hard: Sequence[str]) -> Figure:
    """Recipes as points, {recipe: {frame: (precision, recall)}}, hollow for ``hard`` frames; upper right is good."""
    figure, a = plt.subplots(figsize=(6.2, 4.6), layout="constrained")
    for i, (recipe, by_frame) in enumerate(scores.items()):
        colour, marker = SERIES[i % len(SERIES)], MARKERS[i % len(MARKERS)]
        for frame, (precision, recall) in by_frame.items():
            face = "white" if frame in hard else colour
            a.plot(recall, precision, marker, color=colour, markerfacecolor=face, markersize=7, markeredgewidth=1.4)
        a.plot([], [], marker, color=colour, label=recipe, markersize=7)
    a.plot([], [], "o", color=INK, markerfacecolor="white", label="hollow: hard frames")
    a.set(xlim=(0, 1.03), ylim=(0, 1.03), xlabel="recall: how much of the paint is found",
          ylabel="precision: how much of the mask is paint", aspect="equal")
    a.legend(loc="upper left", bbox_to_anchor=(1.02, 1))
    return figure


@in_style
def ridge_along_row(brightness: np.ndarray, response: np.ndarray, paint: np.ndarray, width_px: int) -> Figure:
    """One row: brightness with the boxes that are compared at the first paint, and the normalised ridge; true paint
    shaded, the threshold dashed."""
    figure, (a, b) = plt.subplots(2, 1, figsize=(WIDTH_IN, 4.2), layout="constrained", sharex=True)
    x = np.arange(len(brightness))
    for axes, top in ((a, 255), (b, 4)):
        axes.fill_between(x, 0, top, where=paint, color=SHADE, linewidth=0, label="true paint")
    a.plot(x, brightness, color=INK, linewidth=1.1)
    painted = np.flatnonzero(paint)
    first_run = np.split(painted, np.flatnonzero(np.diff(painted) > 1) + 1)[0]
    middle = float(first_run.mean()) if len(painted) else len(x) / 2
    for shift, name in ((-SIDE_DISTANCE, "l"), (0, "c"), (SIDE_DISTANCE, "r")):
        at = middle + shift * width_px
        a.fill_between([at - width_px / 2, at + width_px / 2], 266, 294, color=PALETTE["accent"], linewidth=0,
                       label="boxes compared" if name == "c" else None)
        a.text(at, 279, name, ha="center", va="center", fontsize=8, fontweight="bold", color="white")
    b.plot(x, np.clip(response, -0.5, 4), color=PALETTE["estimate"], linewidth=1.3)
    b.axhline(1, color=PALETTE["none"], linestyle="--", linewidth=1.2)
    b.annotate("1: paint", (1, 1), xycoords=("axes fraction", "data"), xytext=(-4, 3), textcoords="offset points",
               ha="right", color=PALETTE["none"])
    a.set(ylabel="brightness, grey levels", ylim=(0, 300), xlim=(150, 1150))
    b.set(ylabel="ridge", ylim=(-0.5, 4), xlabel="column, px")
    a.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure
