"""Figures of notebook 06: lanes beside their truth, the error budget, a matrix of shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import INK, LINE_STYLES, WIDTH_IN, in_style, picture_grid, put_picture, small_picture


def with_truth(frame_bgr: np.ndarray, result, truth: Mapping) -> np.ndarray:
    """The frame (H, W, 3) uint8 BGR with the lane found in green and the true lines dashed in white."""
    picture = draw.overlay(frame_bgr, result, text=False)
    for line in truth["lanes"]:
        xy = np.array([(x, y) for x, y in zip(line, truth["h_samples"], strict=True) if x >= 0], float)
        if len(xy) > 1:
            picture = draw.draw_line(picture, xy, "text", width_px=2.5, dashed=True)
    return picture


@in_style
def lanes_beside_truth(frames, results, truths, labels: Sequence[str], *, columns: int = 3) -> Figure:
    """Frames with the lane found in green and the truth dashed in white; ``labels`` above them."""
    pictures = [with_truth(*one) for one in zip(frames, results, truths, strict=True)]
    figure, axes = picture_grid(pictures, columns=min(columns, len(pictures)), head=0.27)
    for a, picture, label in zip(axes, pictures, labels, strict=True):
        put_picture(a, small_picture(picture, 640)[0])
        a.set_title(label, fontsize=8.5, fontweight="normal", pad=4)
    return figure


def far_part(frame_bgr: np.ndarray, result, truth: Mapping, *, rows: float = 0.2) -> np.ndarray:
    """The far end of the lane, enlarged: the ``rows`` of the frame's height that begin at the highest true point."""
    height, width = frame_bgr.shape[:2]
    seen = [(x, y) for line in truth["lanes"] for x, y in zip(line, truth["h_samples"], strict=True) if x >= 0]
    top = min(y for _, y in seen)
    at = [x for x, y in seen if y < top + 40]
    size = (round(rows * width), round(rows * height))
    x0 = int(np.clip(np.mean(at) - size[0] / 2, 0, width - size[0]))
    y0 = int(np.clip(top - 10, 0, height - size[1]))
    part = with_truth(frame_bgr, result, truth)[y0 : y0 + size[1], x0 : x0 + size[0]]
    return cv2.resize(part, (width // 2, height // 2), interpolation=cv2.INTER_CUBIC)


@in_style
def budget(errors_m: Mapping[str, Sequence[float]], at_m: Sequence[float]) -> Figure:
    """What each source of error costs over the distance, in cm, on a logarithmic axis."""
    figure, a = plt.subplots(figsize=(WIDTH_IN, 3.9), layout="constrained")
    for i, (name, errors) in enumerate(errors_m.items()):
        a.plot(at_m, 100 * np.asarray(errors), label=name, marker="o", markersize=4.5, color=SERIES[i % len(SERIES)],
               linestyle=LINE_STYLES[i % 4])
    a.axhline(6, color=PALETTE["truth"], linewidth=0.9, linestyle=":")
    a.annotate("half the width of a line", (at_m[-1], 6), xytext=(0, 3), textcoords="offset points", ha="right",
               fontsize=8.5)
    a.set(xlabel="distance ahead, m", ylabel="median error, cm (log)", yscale="log",
          title="What the car believes, minus what is true")
    figure.legend(*a.get_legend_handles_labels(), loc="outside right center")
    return figure


@in_style
def matrices(tables: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Figure:
    """Shares 0..1 by row and column, {title: {row: {column: share}}}, one table below the other; a number in every
    cell, dark where low, with the same shades in all."""
    shapes = [(list(table), list(next(iter(table.values())))) for table in tables.values()]
    shares = [np.array([[table[row][column] for column in columns] for row in names])
              for table, (names, columns) in zip(tables.values(), shapes, strict=True)]
    low = min(0.4, *(float(np.nanmin(share)) for share in shares))
    figure, axes = plt.subplots(len(tables), 1, layout="constrained", squeeze=False,
                                figsize=(WIDTH_IN, sum(0.36 * len(names) + 0.75 for names, _ in shapes)))
    for a, title, share, (names, columns) in zip(axes[:, 0], tables, shares, shapes, strict=True):
        a.imshow(share, cmap="cividis", vmin=low, vmax=1, aspect="auto")
        for (i, j), value in np.ndenumerate(share):
            bright = (value - low) / (1 - low) > 0.58  # cividis is as far from black as from white there
            a.text(j, i, f"{value:.2f}", ha="center", va="center", color=INK if bright else "white", fontsize=9)
        a.set_xticks(range(len(columns)), columns, color=INK)
        a.set_yticks(range(len(names)), names, color=INK)
        a.xaxis.tick_top()
        a.tick_params(length=0)
        a.grid(False)
        for spine in a.spines.values():
            spine.set_visible(False)
        a.set_title(title)
    return figure
