"""Figures for notebooks and the write-up: one line a call, each returns the matplotlib Figure.

Pictures come in as everywhere, (H, W, 3) BGR or masks (H, W); this is the edge where BGR becomes RGB. Colours are those of `draw.PALETTE`:
left vermillion, right blue, truth black and dashed. A returned Figure is closed for pyplot, so a notebook shows it
once, where the call is the last line of a cell; elsewhere use ``display(figure)``.
"""

from __future__ import annotations

import functools
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.channels import CHANNELS, as_bgr
from lanelib.draw import PALETTE
from lanelib.errors import LanelibError
from lanelib.pictures import write_bytes
from lanelib.search import find_peaks, histogram

WIDTH_IN = 10.0  # what a notebook shows without scaling, at 100 dots an inch
INK, SOFT = "#22272e", "#6b7480"
STYLE = {
    "figure.dpi": 100, "savefig.dpi": 100, "figure.facecolor": "white", "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5, "axes.titlesize": 10.5, "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.titlepad": 6,
    "axes.labelsize": 9.5, "axes.labelcolor": INK, "axes.edgecolor": "#9aa3ad", "axes.linewidth": 0.8, "axes.spines.top": False,
    "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True, "grid.color": "#e4e7eb", "grid.linewidth": 0.8, "text.color": INK,
    "xtick.color": SOFT, "ytick.color": SOFT, "xtick.labelsize": 8.5, "ytick.labelsize": 8.5, "legend.frameon": False, "legend.fontsize": 8.5,
    "lines.linewidth": 1.8, "lines.solid_capstyle": "round", "image.interpolation": "antialiased", "axes.prop_cycle": plt.cycler(
        color=PALETTE["series"]),
}


def _figure(function):
    """The function's Figure in the project's style, closed for pyplot so that it is not shown a second time."""

    @functools.wraps(function)
    def drawn(*args, **kwargs) -> Figure:
        with plt.rc_context(STYLE):
            figure = function(*args, **kwargs)
            figure.canvas.draw()  # lays everything out while the style holds
        plt.close(figure)
        return figure

    return drawn


def save(figure: Figure, path) -> Path:
    """Write a Figure as JPEG, PNG or SVG by the name's ending, completely or not at all."""
    kind = Path(path).suffix.lstrip(".").lower() or "png"
    memory, options = io.BytesIO(), {"pil_kwargs": {"quality": 88}} if kind in ("jpg", "jpeg") else {}
    try:
        figure.savefig(memory, format=kind, **options)
    except ValueError as error:
        raise LanelibError(f"cannot write {path}: {error}; use .jpg, .png or .svg") from None
    return write_bytes(path, memory.getvalue())


# ---------------------------------------------------------------------------------------------- pictures
def rgb(picture: np.ndarray) -> np.ndarray:
    """What matplotlib shows: BGR to RGB; masks (0/1, 0/255, bool) and grey pictures as RGB, too; float pictures 0..largest as heat."""
    picture = np.asarray(picture)
    if picture.dtype == bool:
        picture = picture.astype(np.uint8) * np.uint8(255)
    if picture.ndim == 2 and picture.dtype.kind == "f":
        picture = draw.heat(picture)
    if picture.ndim == 2 and picture.size and picture.max() <= 1:
        picture = picture * np.uint8(255)
    picture = np.repeat(picture[:, :, None], 3, axis=2) if picture.ndim == 2 else picture
    return np.ascontiguousarray(picture[:, :, 2::-1])


def _put(axes, picture, title="", extent=None) -> None:
    axes.imshow(rgb(picture), extent=extent, aspect="auto" if extent else "equal")
    if title:
        axes.set_title(title)
    if extent is None:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(False)


def _grid(pictures, *, columns: int, width: float = WIDTH_IN, head: float = 0.3, tallest: float = 4.6):
    """A figure and one axes a picture, in rows of ``columns``; the pictures of a row are of one height and keep their proportions.

    ``head``: inches above each picture for its title; ``tallest``: a row is no higher (inches).
    """
    gap = 0.1
    shapes = [np.shape(p)[:2] for p in pictures]
    rows = [shapes[i : i + columns] for i in range(0, len(shapes), columns)]
    # inches of height for each inch of width are the same in all rows that are full
    heights = [min((width - gap * (columns - 1)) / max(sum(w / h for h, w in row) * columns / len(row), 1e-6), tallest) for row in rows]
    total = sum(heights) + head * len(rows) + gap * (len(rows) - 1)
    figure, axes, y = plt.figure(figsize=(width, total)), [], total
    for row, height in zip(rows, heights, strict=True):
        x, y = 0.0, y - head - height
        for h, w in row:
            wide = height * w / h
            axes.append(figure.add_axes((x / width, y / total, wide / width, height / total)))
            x += wide + gap
        y -= gap
    return figure, axes


@_figure
def show(pictures, titles=None, *, columns: int = 3, width: float | None = None) -> Figure:
    """One picture, a list of them, or a dictionary {title: picture}, in rows of ``columns``."""
    if isinstance(pictures, Mapping):
        titles, pictures = list(pictures), list(pictures.values())
    pictures = [pictures] if isinstance(pictures, np.ndarray) else list(pictures)
    titles = [titles] if isinstance(titles, str) else list(titles or [""] * len(pictures))
    if not pictures or len(titles) != len(pictures):
        raise LanelibError(f"a title for each picture is needed, found {len(titles)} titles and {len(pictures)} pictures")
    width = width or (7.0 if len(pictures) == 1 else WIDTH_IN)
    figure, axes = _grid(pictures, columns=min(columns, len(pictures)), width=width, head=0.3 if any(titles) else 0.0)
    for a, picture, title in zip(axes, pictures, titles, strict=True):
        _put(a, picture, title)
    return figure


@_figure
def before_after(before, after, titles=("as the camera gives it", "undistorted"), *, edges=()) -> Figure:
    """Two pictures side by side; ``edges``: for each picture a list of lines (2, 2), x y, that ought to follow straight edges."""
    figure, axes = _grid((before, after), columns=2)
    for i, (a, picture, title) in enumerate(zip(axes, (before, after), titles, strict=True)):
        _put(a, picture, title)
        for line in edges[i] if len(edges) > i else ():
            a.plot(*np.asarray(line, float).T, color=PALETTE["paint"], linestyle=(0, (4, 3)), linewidth=1.3)
    return figure


@_figure
def boards(pictures, views, board_wh=(9, 6), *, columns: int = 5) -> Figure:
    """Chessboard pictures (BGR) with their corners and errors, by number; ``views``: `calibration.BoardView`s in the order of the
    pictures. Unused ones are pale."""
    pairs = sorted(zip(pictures, views, strict=True), key=lambda pair: _natural(pair[1].name))
    figure, axes = _grid([picture for picture, _ in pairs], columns=columns, head=0.25)
    for a, (picture, view) in zip(axes, pairs, strict=True):
        small, scale = _small(picture)
        if view.corners_px is not None:
            small = draw.draw_corners(small, (view.corners_px + 0.5) * scale - 0.5, view.corners_wh or board_wh)
        _put(a, small if view.used else cv2.addWeighted(small, 0.5, np.full_like(small, 255), 0.5, 0))
        error = "" if view.rms_px is None else f"{view.rms_px:.2f} px"
        a.set_title(f"{Path(view.name).stem.removeprefix('calibration')}:  {error if view.used else 'not used'}", fontsize=8.5,
                    color=INK if view.used else PALETTE["none"])
    return figure


def _natural(name: str) -> list:
    """A sorting key that puts calibration2 before calibration10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _small(picture: np.ndarray, width: int = 480) -> tuple[np.ndarray, float]:
    """A BGR picture at most ``width`` wide, and its scale: notebooks stay small."""
    scale = min(1.0, width / picture.shape[1])
    size = (round(picture.shape[1] * scale), max(1, round(picture.shape[0] * scale)))
    return cv2.resize(as_bgr(picture), size, interpolation=cv2.INTER_AREA), scale


@_figure
def board_errors(views, *, rms_px: float | None = None) -> Figure:
    """Reprojection error of each board as bars, the overall RMS as a line; boards that were not used are named below."""
    views = sorted(views, key=lambda view: _natural(view.name))
    used = [view for view in views if view.used and view.rms_px is not None]
    figure, a = plt.subplots(figsize=(WIDTH_IN, 3.0), layout="constrained")
    names = [Path(view.name).stem.removeprefix("calibration") for view in used]
    a.bar(names, [view.rms_px for view in used], color=PALETTE["accent"], width=0.72)
    if rms_px is not None:
        a.axhline(rms_px, color=INK, linestyle="--", linewidth=1.2)
        a.annotate(f"all corners: {rms_px:.2f} px", (1, rms_px), xycoords=("axes fraction", "data"), xytext=(-4, 4),
                   textcoords="offset points", ha="right")
    a.set(ylabel="RMS reprojection error, px", xlabel="board", title="How well does the camera explain each board?")
    a.grid(axis="x", visible=False)
    unused = [Path(view.name).stem for view in views if not view.used]
    if unused:
        a.set_xlabel(f"board      (not used: {', '.join(unused)})")
    return figure


# ---------------------------------------------------------------------------------------------- thresholds
@_figure
def thresholds(frame_bgr, masks: Mapping[str, np.ndarray], *, paint=None, columns: int = 3) -> Figure:
    """The frame and masks by name. With the true ``paint`` (a mask): hits green, paint missed blue, false alarms vermillion, and each
    mask's precision and recall."""
    pictures, titles = [frame_bgr], ["frame"]
    for name, mask in masks.items():
        mask = np.asarray(mask) != 0
        if paint is None:
            pictures.append(mask)
            titles.append(name)
            continue
        truth = np.asarray(paint) != 0
        picture = np.zeros((*mask.shape, 3), np.uint8)
        for where, colour in ((mask & truth, "estimate"), (truth & ~mask, "accent"), (mask & ~truth, "none")):
            picture[where] = draw.bgr(colour)
        hits = int((mask & truth).sum())
        precision, recall = hits / max(int(mask.sum()), 1), hits / max(int(truth.sum()), 1)
        pictures.append(picture)
        titles.append(f"{name}\nprecision {precision:.2f}, recall {recall:.2f}")
    figure, axes = _grid(pictures, columns=columns, head=0.3 if paint is None else 0.48)
    for a, picture, title in zip(axes, pictures, titles, strict=True):
        name, _, score = title.partition("\n")
        _put(a, picture, name + ("\n" if paint is not None else ""))
        a.annotate(score, (0, 1), xycoords="axes fraction", xytext=(0, 5), textcoords="offset points", color=SOFT, fontsize=9)
    return figure


@_figure
def channels(frame_bgr, names: Sequence[str], *, ranges: Mapping[str, tuple[float, float]] | None = None) -> Figure:
    """Channels by name (`channels.CHANNELS`), each with its histogram; ``ranges``: {name: (low, high)} to shade."""
    figure, axes = plt.subplots(2, len(names), figsize=(WIDTH_IN, WIDTH_IN / len(names) * 0.5625 + 1.7), layout="constrained", squeeze=False,
                                height_ratios=(WIDTH_IN / len(names) * 0.5625, 1.2))
    for (top, bottom), name in zip(axes.T, names, strict=True):
        values = CHANNELS[name](frame_bgr)
        _put(top, values, name)
        count = np.bincount(values.ravel(), minlength=256)
        bottom.fill_between(np.arange(256), np.maximum(count, 0.5), 0.5, step="mid", color=PALETTE["accent"], alpha=0.75, linewidth=0)
        if ranges and name in ranges:
            bottom.axvspan(*ranges[name], color=PALETTE["window"], alpha=0.25, linewidth=0)
        bottom.set(xlim=(0, 255), yscale="log", ylim=(0.8, None), xlabel="value", xticks=(0, 64, 128, 192, 255))
        bottom.minorticks_off()
        bottom.tick_params(axis="y", labelleft=False, length=0)
    axes[1, 0].set_ylabel("pixels (log)")
    return figure


# ---------------------------------------------------------------------------------------------- bird's-eye view
def _extent(grid) -> tuple[float, float, float, float]:
    """Edges in metres of a picture of a uniform grid, as imshow wants them."""
    return (grid.x_m[0] - grid.column_m / 2, grid.x_m[-1] + grid.column_m / 2, grid.y_m[-1] - grid.row_m / 2, grid.y_m[0] + grid.row_m / 2)


@_figure
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
    outline = np.concatenate([p + along * (q - p) for p, q in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True)])
    _put(a, undistorted, "undistorted picture")
    seen = birdseye.points_from_road(outline)
    a.plot(*seen.T, color=PALETTE["trapezoid"], linewidth=2)
    a.plot(*birdseye.points_from_road(corners_m).T, "o", color=PALETTE["trapezoid"], markeredgecolor="white", markersize=7)
    a.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    _put(b, birdseye.warp(undistorted), "bird's-eye view", _extent(grid))
    b.plot(*outline.T, color=PALETTE["trapezoid"], linewidth=2)
    b.plot(*corners_m.T, "o", color=PALETTE["trapezoid"], markeredgecolor="white", markersize=7)
    b.set(xlabel="x to the right, m", ylabel="y ahead, m")
    b.grid(color="white", alpha=0.25)
    b.set_axisbelow(False)
    return figure


@_figure
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


@_figure
def fit(lane=None, *, points_m: Mapping[str, np.ndarray] | None = None, lines: Mapping[str, object] | None = None, truth_m=None,
        y_max_m: float | None = None, view=None, grid=None) -> Figure:
    """Points and fitted lines on the road, in metres, with a band of two standard deviations.

    ``points_m``: {"left": (N, 2), "right": (N, 2)}; ``lines``: further {name: `lane.Line`}; ``truth_m``: [left, right], each (N, 2);
    ``view`` with its uniform ``grid``: a bird's-eye picture below it all.
    """
    figure, a = plt.subplots(figsize=(5.2, 6.4), layout="constrained")
    if view is not None:
        a.imshow(rgb(view), extent=_extent(grid), aspect="auto", alpha=0.75)
    for name, xy in (points_m or {}).items():
        a.plot(*np.asarray(xy, float).reshape(-1, 2).T, ".", color=PALETTE.get(name, PALETTE["other"]), markersize=3, alpha=0.45)
    named = {"left": lane.left, "right": lane.right} if lane is not None else {}
    series = iter(PALETTE["series"][2:])
    for name, line in {**named, **(lines or {})}.items():
        y = np.linspace(0, y_max_m or max(line.y_range_m[1], 5.0), 120)
        colour = PALETTE[name] if name in ("left", "right") else next(series)
        x, std = line.x(y), line.std_x_m(y)
        a.plot(x, y, color=colour, label=f"{name}, {_bend(line)}")
        if np.isfinite(std).all():
            a.fill_betweenx(y, x - 2 * std, x + 2 * std, color=colour, alpha=0.2, linewidth=0)
    for i, xy in enumerate(truth_m or ()):
        a.plot(*np.asarray(xy, float).T, color=PALETTE["truth"], linestyle=(0, (5, 3)), linewidth=1.2, label="truth" if i == 0 else None)
    a.plot(0, 0, marker="^", color=INK, markersize=10, clip_on=False)
    a.set(xlabel="x to the right, m", ylabel="y ahead, m", ylim=(0, y_max_m))
    if len(a.get_legend_handles_labels()[0]):
        a.legend(loc="upper left", bbox_to_anchor=(0, -0.1), ncols=3)
    return figure


def _bend(line) -> str:
    radius = line.radius_m()
    return "straight" if math.isinf(radius) else f"R {radius:.0f} m {'left' if line.curvature_1pm() > 0 else 'right'}"


# ---------------------------------------------------------------------------------------------- numbers
QUANTITIES = {  # key of a row: (axis label, factor)
    "curvature_1pm": ("curvature, 1/km\n(left is up)", 1000.0), "offset_m": ("offset, m\n(car right is up)", 1.0),
    "lane_width_m": ("lane width, m", 1.0), "confidence": ("confidence", 1.0), "run_time": ("time, ms", 1.0),
}


@_figure
def over_time(rows, truth=None, *, quantities: Sequence[str] = ("curvature_1pm", "offset_m"), fps: float = 25.0, title: str = "") -> Figure:
    """Rows of ``--json`` (a list, or {method: list}) over time, truth dashed; frames held are shaded orange, without a lane vermillion."""
    methods = rows if isinstance(rows, Mapping) else {"estimate": rows}
    figure, axes = plt.subplots(len(quantities), 1, figsize=(WIDTH_IN, 1.9 * len(quantities) + 0.7), layout="constrained", sharex=True,
                                squeeze=False)

    def series(rows, key, factor):
        return np.array([np.nan if row.get(key) is None else factor * row[key] for row in rows], float)

    def seconds(rows):
        return np.array([row.get("time_s", i / fps) for i, row in enumerate(rows)], float)

    for a, key in zip(axes[:, 0], quantities, strict=True):
        label, factor = QUANTITIES.get(key, (key, 1.0))
        colours = [PALETTE["estimate"]] if len(methods) == 1 else PALETTE["series"]
        for i, (name, own) in enumerate(methods.items()):
            a.plot(seconds(own), series(own, key, factor), color=colours[i % len(colours)], label=name, linewidth=1.4)
        if truth is not None:
            a.plot(seconds(truth), series(truth, key, factor), color=PALETTE["truth"], linestyle=(0, (5, 3)), linewidth=1.1, label="truth")
        if len(methods) == 1:
            own = next(iter(methods.values()))
            for status in ("held", "none"):
                for begin, end in _runs([row.get("status") == status for row in own]):
                    a.axvspan(seconds(own)[begin], seconds(own)[end - 1] + 1 / fps, color=PALETTE[status], alpha=0.18, linewidth=0,
                              label={"held": "held from before", "none": "no lane"}[status])
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


@_figure
def bars(values: Mapping[str, float], *, errors: Mapping[str, float] | None = None, unit: str = "", title: str = "",
         highlight: str | None = None, digits: int = 2, log: bool = False) -> Figure:
    """One bar a name, longest names welcome, the number at its end; ``errors`` as whiskers; ``highlight`` one in green."""
    names = list(values)
    numbers = [values[name] for name in names]
    figure, a = plt.subplots(figsize=(8, 0.36 * len(names) + 1.0), layout="constrained")
    colours = [PALETTE["estimate"] if name == highlight else PALETTE["accent"] for name in names]
    whiskers = None if errors is None else [errors.get(name, np.nan) for name in names]
    a.barh(names, numbers, xerr=whiskers, color=colours, height=0.66, error_kw={"ecolor": INK, "elinewidth": 1.2, "capsize": 3})
    for i, (name, number) in enumerate(zip(names, numbers, strict=True)):
        beside = number + (errors or {}).get(name, 0.0)
        a.annotate(f"{number:.{digits}f}", (max(beside, 0), i), xytext=(6, 0), textcoords="offset points", va="center", fontsize=8.5)
    a.invert_yaxis()
    a.margins(x=0.12)
    a.set(xlabel=unit, title=title, xscale="log" if log else "linear")
    a.grid(axis="y", visible=False)
    a.tick_params(axis="y", length=0, labelcolor=INK, labelsize=9.5)
    return figure


@_figure
def curves(x, series: Mapping[str, Sequence[float]], *, xlabel: str = "", ylabel: str = "", title: str = "", truth: str | None = None,
           logx: bool = False, logy: bool = False, markers: bool = True) -> Figure:
    """Several numbers over one axis; the series called ``truth`` is black and dashed."""
    figure, a = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
    for name, y in series.items():
        style = {"color": PALETTE["truth"], "linestyle": (0, (5, 3))} if name == truth else {}
        a.plot(x, y, marker="o" if markers and name != truth else None, markersize=4, label=name, **style)
    a.set(xlabel=xlabel, ylabel=ylabel, title=title, xscale="log" if logx else "linear", yscale="log" if logy else "linear")
    if len(series) > 1:
        a.legend()
    return figure


@_figure
def contact_sheet(frames, labels=None, *, columns: int = 4, marks: Sequence[str] | None = None) -> Figure:
    """Many frames, small; ``marks``: a status for each ("measured", "held", "none"), shown as a coloured bar below it."""
    frames = list(frames)
    labels = list(labels) if labels is not None else [""] * len(frames)
    figure, axes = _grid(frames, columns=columns, head=0.24 if any(labels) else 0.0)
    for i, (a, frame, label) in enumerate(zip(axes, frames, labels, strict=True)):
        small, _ = _small(frame)
        _put(a, small)
        a.set_title(label, fontsize=8, fontweight="normal", pad=3)
        if marks is not None:
            a.axhline(small.shape[0] - 2, color=PALETTE[marks[i]], linewidth=5, solid_capstyle="butt")
    return figure
