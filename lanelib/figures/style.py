"""The project's figure style, and how pictures are put on paper.

A drawn Figure is closed for pyplot, so a notebook shows it once: as the value of the cell's last line.
"""

from __future__ import annotations

import functools
import io
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.channels import as_bgr
from lanelib.draw import SERIES
from lanelib.errors import LanelibError
from lanelib.files import write_bytes

WIDTH_IN = 10.0  # what a notebook shows without scaling, at 100 dots an inch
INK, SOFT = "#22272e", "#6b7480"
DASHES: Any = (0, (5, 3))  # of the truth, and of what else is held against: lengths in line widths
LINE_STYLES = ("-", "--", "-.", ":")  # beside colours, for those who cannot tell them apart
STYLE: Any = {
    "figure.dpi": 100,
    "savefig.dpi": 100,
    "figure.facecolor": "white",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 6,
    "axes.labelsize": 9.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa3ad",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "image.interpolation": "antialiased",
    "axes.prop_cycle": plt.cycler(color=SERIES),
}


def in_style(function):
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
    memory = io.BytesIO()
    options: dict[str, Any] = {"pil_kwargs": {"quality": 88}} if kind in ("jpg", "jpeg") else {}
    try:
        figure.savefig(memory, format=kind, **options)
    except ValueError as error:
        raise LanelibError(f"cannot write {path}: {error}; use .jpg, .png or .svg") from None
    return write_bytes(path, memory.getvalue())


def rgb(picture: np.ndarray) -> np.ndarray:
    """What matplotlib shows: BGR, grey pictures and masks (0/1, 0/255, bool) as RGB; floats 0..largest as heat."""
    picture = np.asarray(picture)
    if picture.dtype == bool:
        picture = picture.astype(np.uint8) * np.uint8(255)
    if picture.ndim == 2 and picture.dtype.kind == "f":
        picture = draw.heat(picture)
    if picture.ndim == 2 and picture.size and picture.max() <= 1:
        picture = picture * np.uint8(255)
    picture = np.repeat(picture[:, :, None], 3, axis=2) if picture.ndim == 2 else picture
    return np.ascontiguousarray(picture[:, :, 2::-1])


def put_picture(axes, picture, title="", extent=None) -> None:
    """A picture without axes; with ``extent`` (left, right, bottom, top) in metres, with them."""
    axes.imshow(rgb(picture), extent=extent, aspect="auto" if extent else "equal")
    if title:
        axes.set_title(title)
    if extent is None:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(False)


def picture_grid(pictures, *, columns: int, width: float = WIDTH_IN, head: float = 0.3, tallest: float = 4.6):
    """A figure and axes for each picture, in rows of ``columns``.

    The pictures of a row are of one height and keep their proportions. ``head``: inches above each picture for its
    title; ``tallest``: a row is no higher (inches).
    """
    gap = 0.1
    shapes = [np.shape(p)[:2] for p in pictures]
    rows = [shapes[i : i + columns] for i in range(0, len(shapes), columns)]
    # inches of height for each inch of width are the same in all rows that are full
    heights = [
        min((width - gap * (columns - 1)) / max(sum(w / h for h, w in row) * columns / len(row), 1e-6), tallest)
        for row in rows
    ]
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


def small_picture(picture: np.ndarray, width: int = 480) -> tuple[np.ndarray, float]:
    """A BGR picture at most ``width`` wide, and its scale: notebooks stay small."""
    scale = min(1.0, width / picture.shape[1])
    size = (round(picture.shape[1] * scale), max(1, round(picture.shape[0] * scale)))
    return cv2.resize(as_bgr(picture), size, interpolation=cv2.INTER_AREA), scale


def extent_of(grid) -> tuple[float, float, float, float]:
    """Edges in metres of a picture of a uniform grid, as imshow wants them."""
    return (
        grid.x_m[0] - grid.column_m / 2,
        grid.x_m[-1] + grid.column_m / 2,
        grid.y_m[-1] - grid.row_m / 2,
        grid.y_m[0] + grid.row_m / 2,
    )
