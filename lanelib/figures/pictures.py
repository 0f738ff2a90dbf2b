"""Figures made of pictures: side by side, before and after, boards, thresholds, channels, a clip's contact sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.channels import CHANNELS
from lanelib.draw import PALETTE
from lanelib.errors import LanelibError
from lanelib.figures.style import INK, SOFT, WIDTH_IN, in_style, picture_grid, put_picture, small_picture
from lanelib.names import natural_key


@in_style
def show(pictures, titles=None, *, columns: int = 3, width: float | None = None) -> Figure:
    """One picture, a list of them, or a dictionary {title: picture}, in rows of ``columns``."""
    if isinstance(pictures, Mapping):
        titles, pictures = list(pictures), list(pictures.values())
    pictures = [pictures] if isinstance(pictures, np.ndarray) else list(pictures)
    titles = [titles] if isinstance(titles, str) else list(titles or [""] * len(pictures))
    if not pictures or len(titles) != len(pictures):
        raise LanelibError(
            f"a title for each picture is needed, found {len(titles)} titles and {len(pictures)} pictures"
        )
    width = width or (7.0 if len(pictures) == 1 else WIDTH_IN)
    figure, axes = picture_grid(
        pictures, columns=min(columns, len(pictures)), width=width, head=0.3 if any(titles) else 0.0
    )
    for a, picture, title in zip(axes, pictures, titles, strict=True):
        put_picture(a, picture, title)
    return figure


@in_style
def before_after(before, after, titles=("as the camera gives it", "undistorted"), *, edges=()) -> Figure:
    """Two pictures side by side; ``edges``: for each, lines (2, 2), x and y, that ought to follow straight edges."""
    figure, axes = picture_grid((before, after), columns=2)
    for i, (a, picture, title) in enumerate(zip(axes, (before, after), titles, strict=True)):
        put_picture(a, picture, title)
        for line in edges[i] if len(edges) > i else ():
            a.plot(*np.asarray(line, float).T, color=PALETTE["paint"], linestyle=(0, (4, 3)), linewidth=1.3)
    return figure


@in_style
def boards(pictures, views, board_wh=(9, 6), *, columns: int = 5) -> Figure:
    """Chessboard pictures (BGR) with their corners and errors, by number.

    ``views``: `calibration.BoardView`s in the order of the pictures. Unused ones are pale; a picture that is None is
    left out.
    """
    pairs = zip(pictures, views, strict=True)
    shown = [(*small_picture(picture), view) for picture, view in pairs if picture is not None]
    shown.sort(key=lambda one: natural_key(one[-1].name))
    figure, axes = picture_grid([small for small, _, _ in shown], columns=columns, head=0.25)
    for a, (small, scale, view) in zip(axes, shown, strict=True):
        if view.corners_px is not None:
            small = draw.draw_corners(small, (view.corners_px + 0.5) * scale - 0.5, view.corners_wh or board_wh)
        put_picture(a, small if view.used else cv2.addWeighted(small, 0.5, np.full_like(small, 255), 0.5, 0))
        error = "" if view.rms_px is None else f"{view.rms_px:.2f} px"
        title = f"{Path(view.name).stem.removeprefix('calibration')}:  {error if view.used else 'not used'}"
        a.set_title(title, fontsize=8.5, color=INK if view.used else PALETTE["none"])
    return figure


@in_style
def thresholds(frame_bgr, masks: Mapping[str, np.ndarray], *, paint=None, columns: int = 3) -> Figure:
    """The frame and masks by name.

    With the true ``paint`` (a mask): hits green, paint missed blue, false alarms vermillion, and each mask's precision
    and recall.
    """
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
    figure, axes = picture_grid(pictures, columns=columns, head=0.3 if paint is None else 0.48)
    for a, picture, title in zip(axes, pictures, titles, strict=True):
        name, _, score = title.partition("\n")
        put_picture(a, picture, name + ("\n" if paint is not None else ""))
        a.annotate(
            score, (0, 1), xycoords="axes fraction", xytext=(0, 5), textcoords="offset points", color=SOFT, fontsize=9
        )
    return figure


@in_style
def channels(frame_bgr, names: Sequence[str], *, ranges: Mapping[str, tuple[float, float]] | None = None) -> Figure:
    """Channels by name (`channels.CHANNELS`), each with its histogram; ``ranges``: {name: (low, high)} to shade."""
    picture_in = WIDTH_IN / len(names) * 0.5625  # the height of a picture of 16:9
    size_in, heights = (WIDTH_IN, picture_in + 1.7), (picture_in, 1.2)
    figure, axes = plt.subplots(
        2, len(names), figsize=size_in, layout="constrained", squeeze=False, height_ratios=heights
    )
    for (top, bottom), name in zip(axes.T, names, strict=True):
        values = CHANNELS[name](frame_bgr)
        put_picture(top, values, name)
        count = np.bincount(values.ravel(), minlength=256)
        bottom.fill_between(
            np.arange(256), np.maximum(count, 0.5), 0.5, step="mid", color=PALETTE["accent"], alpha=0.75, linewidth=0
        )
        if ranges and name in ranges:
            bottom.axvspan(*ranges[name], color=PALETTE["window"], alpha=0.25, linewidth=0)
        bottom.set(xlim=(0, 255), yscale="log", ylim=(0.8, None), xlabel="value", xticks=(0, 64, 128, 192, 255))
        bottom.minorticks_off()
        bottom.tick_params(axis="y", labelleft=False, length=0)
    axes[1, 0].set_ylabel("pixels (log)")
    return figure


@in_style
def contact_sheet(frames, labels=None, *, columns: int = 4, marks: Sequence[str] | None = None) -> Figure:
    """Many frames, small; ``marks``: the status of each ("measured", "held", "none"), a coloured bar below it."""
    frames = list(frames)
    labels = list(labels) if labels is not None else [""] * len(frames)
    figure, axes = picture_grid(frames, columns=columns, head=0.24 if any(labels) else 0.0)
    for i, (a, frame, label) in enumerate(zip(axes, frames, labels, strict=True)):
        small, _ = small_picture(frame)
        put_picture(a, small)
        a.set_title(label, fontsize=8, fontweight="normal", pad=3)
        if marks is not None:
            a.axhline(small.shape[0] - 2, color=PALETTE[marks[i]], linewidth=5, solid_capstyle="butt")
    return figure
