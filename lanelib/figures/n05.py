"""Figures of notebook 05: what smoothing gains against what it costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import INK, SOFT, WIDTH_IN, in_style


@in_style
def tradeoff(
    families: Mapping[str, Sequence[tuple[str, float, float, float]]],
    *,
    colours: Mapping[str, str],
    enlarged: str | None = None,
) -> Figure:
    """Jitter against error and against lag; a family of smoothers is a curve, each point (label, error cm, jitter cm,
    lag s) one of its settings. Best is the lower left corner. The family called ``enlarged``, whose points crowd, has
    its settings written in a window of its own."""
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH_IN, 4.6), layout="constrained", sharey=True)
    for a, at in ((axes[0], 1), (axes[1], 3)):
        for name, points in families.items():
            _family(a, points, at, colours[name], label=name)
            if name == enlarged:
                _window(a, points, at, colours[name]).set_title(
                    f"{name}, enlarged", fontsize=8.5, fontweight="normal", color=colours[name], pad=3
                )
            else:
                for label, *point in points:
                    a.annotate(label, (point[at - 1], point[1]), xytext=(5, 4), textcoords="offset points", fontsize=8,
                               color=SOFT)
    axes[0].set(xlabel="error, cm", ylabel="jitter, cm a frame", xlim=(0, None), ylim=(0, None))
    axes[1].set(xlabel="lag, s")
    axes[0].set_title("lower left is better")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(families))
    return figure


def _family(a, points, at: int, colour: str, label: str | None = None) -> None:
    x, jitter = ([point[k] for point in points] for k in (at, 2))
    a.plot(x, jitter, "o-", color=colour, label=label, markersize=5, linewidth=1.4)


def _window(a, points, at: int, colour: str):
    """Axes in the upper right, where no smoothing comes, that show one family alone; a frame where it lies."""
    window = a.inset_axes((0.4, 0.63, 0.5, 0.33))
    _family(window, points, at, colour)
    lowest = min(points, key=lambda point: point[2])
    for point in points:  # to the left, the lowest one's below
        down = point is lowest
        window.annotate(point[0], (point[at], point[2]), xytext=(-5, -3 if down else 2), textcoords="offset points",
                        ha="right", va="top" if down else "bottom", fontsize=8, color=colour)
    for axis, k, below, above in (("x", at, 0.35, 0.15), ("y", 2, 0.4, 0.3)):
        values = [point[k] for point in points]
        span = max(max(values) - min(values), 1e-6)
        window.set(**{f"{axis}lim": (min(values) - below * span, max(values) + above * span)})
    window.tick_params(labelsize=7)
    window.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    window.yaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
    for spine in window.spines.values():
        spine.set_visible(True)
    a.indicate_inset(window.viewLim.frozen().bounds, edgecolor=SOFT, alpha=0.6)
    return window


@in_style
def gaussians(measurements: Mapping[str, tuple[float, float]], *, together: str, xlabel: str) -> Figure:
    """Normal densities of independent measurements {name: (mean, variance)}, and filled that of all ``together``:
    information, 1 / variance, adds up, and each mean counts by its own."""
    means, variances = np.array(list(measurements.values()), float).T
    variance = 1 / np.sum(1 / variances)
    names, means = [*measurements, together], np.append(means, variance * np.sum(means / variances))
    variances = np.append(variances, variance)
    figure, a = plt.subplots(figsize=(7.5, 2.6), layout="constrained")
    spread = np.sqrt(variances)
    x = np.linspace(min(means - 3.5 * spread), max(means + 3.5 * spread), 400)
    for i, (name, mean, variance) in enumerate(zip(names, means, variances, strict=True)):
        density = np.exp(-((x - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
        last = i == len(names) - 1
        colour = PALETTE["estimate"] if last else SERIES[i]
        a.plot(x, density, color=colour, label=f"{name}: {mean:.3f} ± {np.sqrt(variance):.3f}")
        if last:
            a.fill_between(x, density, color=colour, alpha=0.25, linewidth=0)
    a.set(xlabel=xlabel, yticks=[], ylim=(0, None))
    a.legend(labelcolor=INK)
    return figure
