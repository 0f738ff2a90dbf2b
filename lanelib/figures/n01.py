"""Figures of notebook 01: the lens, where the corners lie, a calibration against the truth, what a wrong one costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lanelib.camera import Camera
from lanelib.draw import PALETTE, SERIES
from lanelib.figures.style import DASHES, INK, LINE_STYLES, WIDTH_IN, in_style


@in_style
def lens(camera: Camera, *, step_px: int = 80) -> Figure:
    """Left: where the lens moves points of the frame, arrows from undistorted to distorted. Right: by how much, along
    a ray from the optical axis outwards."""
    width, height = camera.size_wh
    figure, (a, b) = plt.subplots(1, 2, figsize=(WIDTH_IN, 3.3), layout="constrained", width_ratios=(1.55, 1))
    to = np.stack(np.meshgrid(np.arange(40, width, step_px), np.arange(40, height, step_px)), -1).reshape(-1, 2)
    start = camera.undistort_points(to)
    move = to - start
    a.quiver(*start.T, *move.T, np.hypot(*move.T), angles="xy", scale_units="xy", scale=1, cmap="viridis", width=0.003)
    centre = camera.camera_matrix[:2, 2]
    a.plot(*centre, "+", color=PALETTE["none"], markersize=12, markeredgewidth=2)
    a.annotate("principal point", centre, xytext=(8, 6), textcoords="offset points", color=PALETTE["none"])
    a.set(xlim=(-60, width + 60), ylim=(height + 40, -40), aspect="equal", xlabel="u, px", ylabel="v, px",
          title="where the lens moves a point")
    a.add_patch(plt.Rectangle((0, 0), width, height, fill=False, edgecolor=INK, linewidth=0.8))
    focal = camera.camera_matrix[0, 0]
    k1, k2, _, _, k3 = camera.distortion
    far = np.hypot(*(camera.undistort_points([[0.0, 0.0]])[0] - centre)) / focal
    r = np.linspace(0, far, 100)
    b.plot(focal * r, focal * r * (k1 * r**2 + k2 * r**4 + k3 * r**6), color=PALETTE["estimate"], label="all terms")
    b.plot(focal * r, focal * r * k1 * r**2, color=PALETTE["accent"], linestyle="--", label="k1 alone")
    b.set(xlabel="distance from the principal point, px", ylabel="moved outwards, px", title="the radial part")
    b.legend()
    return figure


@in_style
def coverage(views, size_wh: tuple[int, int]) -> Figure:
    """All corners used, in one frame: whole boards and boards cut off by the frame; a lens is known where they lie."""
    figure, a = plt.subplots(figsize=(6.4, 3.9), layout="constrained")
    used = [view for view in views if view.used]
    most = max(len(view.corners_px) for view in used)
    for partial, colour, name in ((False, PALETTE["accent"], "whole boards"), (True, PALETTE["none"], "cut off")):
        points = [view.corners_px for view in used if (len(view.corners_px) < most) == partial]
        if points:
            marker = "^" if partial else "o"
            a.plot(*np.concatenate(points).T, marker, color=colour, markersize=3.5, alpha=0.75, label=name)
    width, height = size_wh
    a.add_patch(plt.Rectangle((0, 0), width, height, fill=False, edgecolor=INK, linewidth=1))
    a.set(xlim=(-20, width + 20), ylim=(height + 20, -20), aspect="equal", xlabel="u, px", ylabel="v, px")
    a.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure


@in_style
def against_truth(camera: Camera, true: Camera) -> Figure:
    """Left: focal lengths and centre minus the true ones, with two standard deviations. Right: how far, in pixels, the
    ray of each pixel lies from its true one."""
    figure, (a, b) = plt.subplots(1, 2, figsize=(WIDTH_IN, 3.2), layout="constrained", width_ratios=(1, 1.5))
    names = ("fx", "fy", "cx", "cy")
    where = ((0, 0), (1, 1), (0, 2), (1, 2))
    error = [camera.camera_matrix[at] - true.camera_matrix[at] for at in where]
    bars = [2 * (camera.std or {}).get(name, np.nan) for name in names]
    a.errorbar(error, names, xerr=bars, fmt="o", color=PALETTE["estimate"], ecolor=INK, capsize=4, markersize=7)
    a.axvline(0, color=PALETTE["truth"], linestyle=DASHES, linewidth=1.2)
    a.invert_yaxis()
    a.margins(y=0.2)
    a.set(xlabel="calibrated minus true, px (bars: ± 2 standard deviations)", title="nine numbers, four of them here")
    x, y = np.arange(0, camera.size_wh[0], 20), np.arange(0, camera.size_wh[1], 20)
    off = _off_px(camera, true, _every_20_px(camera))
    drawn = b.imshow(off.reshape(len(y), len(x)), extent=(-10, x[-1] + 10, y[-1] + 10, -10), cmap="viridis", vmin=0)
    figure.colorbar(drawn, ax=b, label="px", shrink=0.9)
    b.set(title="how far each pixel's ray is off", xlabel="u, px", ylabel="v, px")
    b.grid(False)
    return figure


def ray_error_px(camera: Camera, true: Camera) -> float:
    """Root mean square over the frame of what `against_truth` shows on its right, px."""
    return float(np.sqrt((_off_px(camera, true, _every_20_px(camera)) ** 2).mean()))


def worst_ray(camera: Camera, true: Camera) -> tuple[float, np.ndarray]:
    """The largest error that `against_truth` shows on its right, px, and the pixel (u, v) where it is."""
    pixels = _every_20_px(camera)
    off = _off_px(camera, true, pixels)
    return float(off.max()), pixels[off.argmax()]


def _every_20_px(camera: Camera) -> np.ndarray:
    x, y = np.arange(0, camera.size_wh[0], 20), np.arange(0, camera.size_wh[1], 20)
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _off_px(camera: Camera, true: Camera, pixels: np.ndarray) -> np.ndarray:
    """How far the ray of each pixel (N, 2) lies from its true one, px."""
    return np.hypot(*(_rays(camera, pixels) - _rays(true, pixels)).T) * true.camera_matrix[0, 0]


def _rays(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """X/Z and Y/Z (N, 2) of what the pixels (N, 2) of the frame as given see."""
    matrix = camera.camera_matrix
    return (camera.undistort_points(pixels) - matrix[:2, 2]) / (matrix[0, 0], matrix[1, 1])


@in_style
def rms_and_error(rms_px: Sequence[float], error_px: Sequence[float], whole: tuple[float, float]) -> Figure:
    """Calibrations from few boards: their RMS against how wrong they are; ``whole`` is the one from all boards."""
    figure, a = plt.subplots(figsize=(6.6, 3.6), layout="constrained")
    a.plot(rms_px, error_px, "o", color=PALETTE["accent"], markersize=6, label="three boards drawn at random")
    a.plot(*whole, "D", color=PALETTE["estimate"], markersize=9, label="all boards")
    a.set(xlabel="RMS reprojection error, px: what you can see", ylabel="error of the focal length, px",
          title="what you cannot see without the truth")
    a.set_ylim(bottom=0)
    a.set_xlim(left=0)
    a.legend(loc="upper left")
    return figure


@in_style
def road_cost(y_m, costs: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> Figure:
    """Distance on the road, in cm, between where points are and where a camera puts them, over the distance ahead:
    ``costs`` {name: (own lane, next lane)}."""
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH_IN, 3.7), layout="constrained", sharey=True)
    for i, (name, errors) in enumerate(costs.items()):
        for a, error in zip(axes, errors, strict=True):
            a.plot(y_m, error, color=SERIES[i % len(SERIES)], linestyle=LINE_STYLES[i % 4], label=name, marker="o",
                   markersize=3.5)
    for a, title in zip(axes, ("the lines of the own lane", "the far line of the next lane"), strict=True):
        a.set(xlabel="distance ahead, m", yscale="log", title=title, ylim=(0.05, 300))
        a.set_yticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    axes[0].set_ylabel("misplaced sideways, cm (log)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(costs))
    return figure
