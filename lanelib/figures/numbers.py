"""Figures of numbers: errors per board, a quantity over time against truth, bars, curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import DASHES, INK, WIDTH_IN, in_style
from lanelib.names import natural_key


@in_style
def board_errors(views, *, rms_px: float | None = None) -> Figure:
    """Reprojection error of each board as bars, that of all as a line; boards that were not used are named below."""
    views = sorted(views, key=lambda view: natural_key(view.name))
    used = [view for view in views if view.used and view.rms_px is not None]
    figure, a = plt.subplots(figsize=(WIDTH_IN, 3.0), layout="constrained")
    names = [Path(view.name).stem.removeprefix("calibration") for view in used]
    a.bar(names, [view.rms_px for view in used], color=PALETTE["accent"], width=0.72)
    if rms_px is not None:
        a.axhline(rms_px, color=INK, linestyle="--", linewidth=1.2)
        a.annotate(
            f"all corners:\n{rms_px:.2f} px",
            (1, rms_px),  # beside the axes: no bar is there
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )
    a.set(ylabel="RMS reprojection error, px", xlabel="board", title="How well does the camera explain each board?")
    a.grid(axis="x", visible=False)
    unused = [Path(view.name).stem for view in views if not view.used]
    if unused:
        a.set_xlabel(f"board      (not used: {', '.join(unused)})")
    return figure


QUANTITIES = {  # key of a row: (axis label, factor)
    "curvature_1pm": ("curvature, 1/km\n(left is up)", 1000.0),
    "offset_m": ("offset, m\n(car right is up)", 1.0),
    "lane_width_m": ("lane width, m", 1.0),
    "confidence": ("confidence", 1.0),
    "run_time": ("time, ms", 1.0),
}


@in_style
def over_time(
    rows, truth=None, *, quantities: Sequence[str] = ("curvature_1pm", "offset_m"), fps: float = 25.0, title: str = ""
) -> Figure:
    """Rows of ``--json`` (a list, or {method: list}) over time, truth dashed.

    Of a single method, frames held are shaded orange, those without a lane vermillion.
    """
    methods = rows if isinstance(rows, Mapping) else {"estimate": rows}
    size_in = (WIDTH_IN, 1.9 * len(quantities) + 0.7)
    figure, axes = plt.subplots(
        len(quantities), 1, figsize=size_in, layout="constrained", sharex=True, squeeze=False
    )

    def series(rows, key, factor):
        return np.array([np.nan if row.get(key) is None else factor * row[key] for row in rows], float)

    def seconds(rows):
        return np.array([row.get("time_s", i / fps) for i, row in enumerate(rows)], float)

    for a, key in zip(axes[:, 0], quantities, strict=True):
        label, factor = QUANTITIES.get(key, (key, 1.0))
        colours = [PALETTE["estimate"]] if len(methods) == 1 else SERIES
        for i, (name, own) in enumerate(methods.items()):
            a.plot(seconds(own), series(own, key, factor), color=colours[i % len(colours)], label=name, linewidth=1.4)
        if truth is not None:
            true = series(truth, key, factor)
            a.plot(seconds(truth), true, color=PALETTE["truth"], linestyle=DASHES, linewidth=1.1, label="truth")
        if len(methods) == 1:
            own = next(iter(methods.values()))
            for status, words in (("held", "held from before"), ("none", "no lane")):
                for first, end in _runs([row.get("status") == status for row in own]):
                    begin_s, end_s = seconds(own)[first], seconds(own)[end - 1] + 1 / fps
                    a.axvspan(begin_s, end_s, color=PALETTE[status], alpha=0.18, linewidth=0, label=words)
        a.set_ylabel(label)
    handles = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside upper right", ncols=len(handles))
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
    axes[-1, 0].set_xlabel("time, s")
    return figure


def _runs(flags) -> list[tuple[int, int]]:
    """First and past-the-last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


@in_style
def bars(
    values: Mapping[str, float],
    *,
    errors: Mapping[str, float] | None = None,
    unit: str = "",
    title: str = "",
    highlight: str | None = None,
    digits: int = 2,
    log: bool = False,
) -> Figure:
    """A bar for each name, its number at the end; ``errors`` as whiskers; the ``highlight`` in green."""
    names = list(values)
    numbers = [values[name] for name in names]
    figure, a = plt.subplots(figsize=(8, 0.36 * len(names) + 1.0), layout="constrained")
    colours = [PALETTE["estimate"] if name == highlight else PALETTE["accent"] for name in names]
    whiskers = None if errors is None else [errors.get(name, np.nan) for name in names]
    whisker_style = {"ecolor": INK, "elinewidth": 1.2, "capsize": 3}
    a.barh(names, numbers, xerr=whiskers, color=colours, height=0.66, error_kw=whisker_style)
    for i, (name, number) in enumerate(zip(names, numbers, strict=True)):
        words, end = f"{number:.{digits}f}", max(number + (errors or {}).get(name, 0.0), 0)
        a.annotate(words, (end, i), xytext=(6, 0), textcoords="offset points", va="center", fontsize=8.5)
    a.invert_yaxis()
    a.margins(x=0.12)
    a.set(xlabel=unit, title=title, xscale="log" if log else "linear")
    a.grid(axis="y", visible=False)
    a.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    return figure


@in_style
def curves(
    x,
    series: Mapping[str, Sequence[float]],
    *,
    xlabel: str = "",
    ylabel: str = "",
    title: str = "",
    truth: str | None = None,
    logx: bool = False,
    logy: bool = False,
    markers: bool = True,
    colours: Mapping[str, str] | None = None,
) -> Figure:
    """Several numbers over one axis; the series called ``truth`` is black and dashed, ``colours`` those of others."""
    figure, a = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
    for name, y in series.items():
        style: dict[str, Any] = {"color": colours[name]} if colours and name in colours else {}
        style = {"color": PALETTE["truth"], "linestyle": DASHES} if name == truth else style
        a.plot(x, y, marker="o" if markers and name != truth else None, markersize=4, label=name, **style)
    a.set(xlabel=xlabel, ylabel=ylabel, title=title)
    a.set(xscale="log" if logx else "linear", yscale="log" if logy else "linear")
    if len(series) > 1:  # outside, so that it hides no curve
        figure.legend(*a.get_legend_handles_labels(), loc="outside upper right", ncols=min(len(series), 5))
    return figure
