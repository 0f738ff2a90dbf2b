"""Figures of notebook 05: what smoothing gains against what it costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import INK, SOFT, WIDTH_IN, in_style


@in_style
def tradeoff(families: Mapping[str, Sequence[tuple[str, float, float, float]]]) -> Figure:
    """Jitter against error and against lag; a family of smoothers is a curve, each point (label, error cm, jitter cm,
    lag s) one of its settings. Best is the lower left corner."""
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH_IN, 4.2), layout="constrained", sharey=True)
    every = [point for points in families.values() for point in points]
    widest = [max(float(np.nanmax(column)), 1e-9) for column in zip(*(point[1:] for point in every), strict=True)]
    for a, at in ((axes[0], 0), (axes[1], 2)):
        labelled: list[tuple[float, float]] = []  # as shares of the axes; where points crowd, some stay without words
        for i, (name, points) in enumerate(families.items()):
            x, jitter = ([point[1:][k] for point in points] for k in (at, 1))
            a.plot(x, jitter, "o-", color=SERIES[i], label=name, markersize=5, linewidth=1.4)
            for label, u, v in zip((point[0] for point in points), x, jitter, strict=True):
                place = (u / widest[at], v / widest[1])
                if all(abs(place[0] - p) > 0.06 or abs(place[1] - q) > 0.045 for p, q in labelled):
                    a.annotate(label, (u, v), xytext=(5, 4), textcoords="offset points", fontsize=7.5, color=SOFT)
                    labelled.append(place)
    axes[0].set(xlabel="error, cm", ylabel="jitter, cm a frame", xlim=(0, None), ylim=(0, None))
    axes[1].set(xlabel="lag, s")
    axes[0].set_title("lower left is better")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(families))
    return figure


@in_style
def gaussians(means: Sequence[float], variances: Sequence[float], names: Sequence[str], *, xlabel: str) -> Figure:
    """Normal densities, the last one (what comes out of fusing the others) filled."""
    figure, a = plt.subplots(figsize=(7.5, 2.6), layout="constrained")
    spread = np.sqrt(variances)
    x = np.linspace(min(means - 3.5 * spread), max(means + 3.5 * spread), 400)
    for i, (mean, variance, name) in enumerate(zip(means, variances, names, strict=True)):
        density = np.exp(-((x - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
        last = i == len(names) - 1
        colour = PALETTE["estimate"] if last else SERIES[i]
        a.plot(x, density, color=colour, label=f"{name}: {mean:.3f} ± {np.sqrt(variance):.3f}")
        if last:
            a.fill_between(x, density, color=colour, alpha=0.25, linewidth=0)
    a.set(xlabel=xlabel, yticks=[], ylim=(0, None))
    a.legend(labelcolor=INK)
    return figure
