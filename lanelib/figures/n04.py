"""Figures of notebook 04: lanes from above beside the truth, the sanity checks as a table, votes, errors as dots."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import INK, SOFT, WIDTH_IN, extent_of, in_style, put_picture
from lanelib.hough import BENDS, X_BINS_M, voters, votes
from lanelib.jointfit import Points


@in_style
def above(view_bgr: np.ndarray, grid, lanes: Mapping[str, object], *, truth_m=None, y_max_m: float = 40.0) -> Figure:
    """Lanes by name on one bird's-eye picture (H, W, 3) of a uniform ``grid``, a panel each; ``truth_m``: [left,
    right], each (N, 2) metres, dashed. Lines are thin where no paint was seen. A lane may be None."""
    size = (WIDTH_IN, 5.2)
    figure, axes = plt.subplots(1, len(lanes), figsize=size, layout="constrained", sharey=True, squeeze=False)
    for a, (name, lane) in zip(axes[0], lanes.items(), strict=True):
        put_picture(a, view_bgr, name, extent_of(grid))
        for side in ("left", "right") if lane is not None else ():
            line = getattr(lane, side)
            y = np.linspace(0, y_max_m, 200)
            seen = y <= line.y_range_m[1]
            a.plot(line.x(y[seen]), y[seen], color=PALETTE[side], linewidth=2.4)
            a.plot(line.x(y[~seen]), y[~seen], color=PALETTE[side], linewidth=1.2)
        for xy in truth_m or ():
            a.plot(*np.asarray(xy, float).T, color="white", linestyle=(0, (4, 3)), linewidth=1.3)
        a.set(xlim=(grid.x_m[0], grid.x_m[-1]), ylim=(0, y_max_m), xlabel="x to the right, m")
        a.grid(False)
    axes[0, 0].set_ylabel("y ahead, m")
    return figure


CHECKED = {  # unit and decimals of the value of each sanity check, by its name
    "order": ("m", 2),
    "width": ("m", 2),
    "parallel": ("m in ≤ 20 m", 2),
    "same bend": ("1/m", 4),
    "radius": ("m", 1),
    "no jump": ("m", 2),
}


@in_style
def checks(rows: Mapping[str, tuple]) -> Figure:
    """The outcome of each sanity check (`lane.Check`, columns) for each lane (rows), the value found in its cell."""
    names = list(dict.fromkeys(check.name for row in rows.values() for check in row))
    table = np.full((len(rows), len(names)), np.nan)
    figure, a = plt.subplots(figsize=(8.6, 0.36 * len(rows) + 0.85), layout="constrained")
    texts = []
    for i, row in enumerate(rows.values()):
        for check in row:
            j = names.index(check.name)
            table[i, j] = check.ok
            digits = CHECKED[check.name][1] if check.value < 100 else 0
            value = f"{check.value:.{digits}f}"
            texts.append((j, i, ("✓ " if check.ok else "✗ ") + ("straight" if check.value > 9999 else value)))
    a.imshow(table, cmap=ListedColormap(["#f6c9ad", "#d3efe4"]), vmin=0, vmax=1, aspect="auto")
    for j, i, text in texts:
        failed = text[0] == "✗"
        a.text(j, i, text, ha="center", va="center", fontsize=9, fontweight="bold" if failed else "normal", color=INK)
    a.set_xticks(range(len(names)), [f"{name},\n{CHECKED[name][0]}" for name in names])
    a.set_yticks(range(len(rows)), list(rows))
    a.tick_params(length=0, labeltop=True, labelbottom=False, labelcolor=INK, labelsize=9.5)
    a.set_xticks(np.arange(len(names) + 1) - 0.5, minor=True)
    a.set_yticks(np.arange(len(rows) + 1) - 0.5, minor=True)
    a.grid(False)
    a.grid(which="minor", color="white", linewidth=3)
    a.tick_params(which="minor", length=0)
    for spine in a.spines.values():
        spine.set_visible(False)
    return figure


@in_style
def hough(points: Points, lines=()) -> Figure:
    """Paint points from above, and their votes for single lines: bend (positive to the left, as everywhere) against x
    at the car, the best bearing each.

    ``lines``: (d, a, b, c) as `hough.single_lines` gives them; drawn into both panels, numbered.
    """
    table = votes(points.some(voters(points))).max(axis=1)[::-1]
    figure, (a, b) = plt.subplots(1, 2, figsize=(WIDTH_IN, 4.4), layout="constrained", width_ratios=(1, 1.5))
    y = 1 / points.inverse
    a.scatter(points.bearing * y, y, s=4 + 14 * points.weight, color=INK, alpha=0.55, linewidth=0)
    bends = -2000 * BENDS[::-1]  # curvature to the left, 1/km, at the car: x'' = 2 a
    b.pcolormesh(X_BINS_M, np.arange(len(bends)), table, cmap="inferno", shading="nearest")
    for i, (d, bend, bearing, x) in enumerate(np.asarray(lines, float).reshape(-1, 4)):
        far = np.linspace(2, 40, 100)
        a.plot(x + far * (bearing + far * (bend + far * d)), far, color=SERIES[i], linewidth=1.6)
        row = np.interp(-2000 * bend, bends, np.arange(len(bends)))
        b.plot(x, row, "o", markersize=15, color=SERIES[i], markerfacecolor="none", markeredgewidth=2)
        b.annotate(f"{i + 1}", (x, row), xytext=(9, 9), textcoords="offset points", color="white", fontweight="bold")
    a.set(xlim=(-6, 6), ylim=(0, 40), xlabel="x to the right, m", ylabel="y ahead, m", title="paint points")
    rows = [int(np.argmin(np.abs(bends - v))) for v in (-50, -10, -2, 0, 2, 10, 50)]
    b.set_yticks(rows, [f"{bends[r]:+.0f}" if r != len(bends) // 2 else "straight" for r in rows])
    b.set(xlabel="x at the car, m", ylabel="bend, 1/km (left is up)", title="votes for a line")
    b.grid(False)
    return figure


@in_style
def dots(errors: Mapping[str, np.ndarray], *, unit: str, limit: float | None = None, title: str = "") -> Figure:
    """One dot a measurement, a row a method; the median of the absolute values as a bar to either side. NaN are
    counted as "no lane"; beyond ``limit`` a dot sits at the edge as a triangle. ``unit``: what is measured, after a
    comma its unit: "error, cm"."""
    figure, a = plt.subplots(figsize=(WIDTH_IN, 0.72 * len(errors) + 1.0), layout="constrained")
    rng = np.random.default_rng(0)
    largest = limit or max(float(np.nanmax(np.abs(v))) for v in errors.values()) * 1.05
    for i, (name, values) in enumerate(errors.items()):
        values = np.asarray(values, float).ravel()
        known = values[np.isfinite(values)]
        inside = np.abs(known) <= largest
        jitter = i + rng.uniform(-0.22, 0.22, len(known))
        colour = SERIES[i % len(SERIES)]
        a.plot(known[inside], jitter[inside], ".", color=colour, alpha=0.6, markersize=7)
        a.plot(np.clip(known[~inside], -largest, largest), jitter[~inside], "^", color=colour, markersize=6)
        middle = float(np.median(np.abs(known))) if len(known) else np.nan
        a.plot([-middle, middle], [i, i], color=INK, linewidth=3, alpha=0.8)
        none = len(values) - len(known)
        words = f"{name}\nmedian |error| {middle:.1f} {unit.rpartition(', ')[2]}"
        words += f"\nno lane in {none / len(values):.0%}" if none else ""
        a.annotate(words, (0, i), xycoords=("axes fraction", "data"), xytext=(-10, 0), textcoords="offset points",
                   ha="right", va="center", fontsize=9.5, color=INK)
    a.axvline(0, color=SOFT, linewidth=0.8)
    a.set(xlim=(-1.05 * largest, 1.05 * largest), ylim=(len(errors) - 0.5, -0.5), yticks=[], title=title,
          xlabel=f"{unit}   (bar: ± the median of the absolute values)")
    return figure
