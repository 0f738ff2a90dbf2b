"""Distortion explorer: five coefficients and a focal length, on a straight grid and on a frame, live."""

from __future__ import annotations

import math

import cv2
import numpy as np

from lanelib import draw
from lanelib.camera import Camera
from lanelib.channels import as_bgr
from lanelib.draw.marks import line_in_place
from lanelib.explore.kit import Explorer, button, slider, tick
from lanelib.explore.look import PANEL_WIDTH, Look, Reading

GRID = 12  # cells of the straight grid across the picture
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")


def camera_of(camera: Camera, *, k1: float, k2: float, p1: float, p2: float, k3: float, f: float) -> Camera:
    """The camera with another lens; ``f``: focal length fx in pixels, fy keeps its proportion to it."""
    matrix = camera.camera_matrix.copy()
    matrix[1, 1] *= f / matrix[0, 0]
    matrix[0, 0] = f
    return Camera(matrix, np.array([k1, k2, p1, p2, k3]), camera.size_wh)


def straight_grid(size_wh: tuple[int, int]) -> list[np.ndarray]:
    """Straight lines that divide a picture into squares, each (N, 2) pixels; they reach a cell beyond its edge."""
    width, height = size_wh
    cell = width / GRID
    along = np.linspace(-cell, width - 1 + cell, 120)
    down = np.linspace(-cell, height - 1 + cell, 80)
    xs = (width - 1) / 2 + cell * np.arange(-GRID // 2 - 1, GRID // 2 + 2)
    half = math.ceil(height / cell / 2)
    ys = (height - 1) / 2 + cell * (np.arange(-half - 1, half + 1) + 0.5)
    upright = [np.column_stack([np.full(len(down), x), down]) for x in xs]
    return upright + [np.column_stack([along, np.full(len(along), y)]) for y in ys]


def distortion_look(camera: Camera, frame_bgr: np.ndarray | None = None, **lens: float) -> Look:
    """What a lens does, and how it is taken back.

    Left: the frame as given (or a blank one), and where the lens shows a straight grid. Right: the frame undistorted
    with this lens, under the straight grid; with the right numbers its straight edges are straight. ``lens``: k1, k2,
    p1, p2, k3 and f (px of the camera's picture). Distances are in pixels of that picture.
    """
    tried = camera_of(camera, **lens)
    width, height = camera.size_wh
    size_wh = (PANEL_WIDTH, round(PANEL_WIDTH * height / width))
    small = Camera(_scaled_matrix(tried, size_wh), tried.distortion, size_wh)
    given: np.ndarray = np.full((size_wh[1], size_wh[0], 3), 236, np.uint8)
    if frame_bgr is not None:
        given = cv2.resize(frame_bgr, size_wh, interpolation=cv2.INTER_AREA)
    undistorted = small.undistort(given)
    left, right = given.copy(), undistorted
    for line in straight_grid(size_wh):
        left = _with_line(left, small.distort_points(line), "trapezoid")
        right = _with_line(right, line, "right")
    picture = draw.side_by_side(
        [left, right],
        ["as given: a straight grid through this lens", "undistorted with this lens"],
        height=size_wh[1],
        cap_px=10,
    )
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    moved = np.hypot(*(tried.undistort_points(corners) - corners).T)
    edge = np.hypot(*(tried.undistort_points([[0.0, (height - 1) / 2]]) - [[0.0, (height - 1) / 2]]).T)
    folds = math.degrees(math.atan(tried.fold_radius)) if math.isfinite(tried.fold_radius) else "nowhere"
    readings = (
        Reading("corners move by", float(moved.mean()), "px", 1),
        Reading("left edge moves by", float(edge.mean()), "px", 1),
        Reading("from the calibration", difference_px(tried, camera), "px rms", 2),
        Reading("width of view", _field_deg(tried), "°", 1),
        Reading("lens folds over at", folds, "° off axis", 0),
    )
    return Look(picture, readings)


def difference_px(first: Camera, second: Camera) -> float:
    """How far two cameras disagree, px: root mean square over the frame of the distance between where each shows the
    ray that the other sees at a pixel. NaN where no pixel has a ray in both."""
    width, height = second.size_wh
    u, v = np.meshgrid(np.linspace(0, width - 1, 24), np.linspace(0, height - 1, 14))
    seen = np.column_stack([u.ravel(), v.ravel()])
    rays = (second.undistort_points(seen) - second.camera_matrix[:2, 2]) / np.diag(second.camera_matrix)[:2]
    shown = first.project(np.column_stack([np.nan_to_num(rays, nan=1e3), np.ones(len(rays))]))
    off = np.hypot(*(shown - seen).T)
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if len(off) else math.nan


def _field_deg(camera: Camera) -> float:
    """Angle between the rays of the left and right edge in the middle row; NaN where the lens shows none there."""
    width, height = camera.size_wh
    ends = camera.undistort_points([[-0.5, (height - 1) / 2], [width - 0.5, (height - 1) / 2]])
    rays = np.column_stack([(ends - camera.camera_matrix[:2, 2]) / np.diag(camera.camera_matrix)[:2], np.ones(2)])
    cosine = rays[0] @ rays[1] / np.prod(np.linalg.norm(rays, axis=1))
    return math.degrees(math.acos(np.clip(cosine, -1, 1))) if np.isfinite(cosine) else math.nan


def _scaled_matrix(camera: Camera, size_wh: tuple[int, int]) -> np.ndarray:
    """The camera matrix for a picture of ``size_wh``, whose rows were rounded to whole numbers."""
    sx, sy = size_wh[0] / camera.size_wh[0], size_wh[1] / camera.size_wh[1]
    shift = np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1]])
    return shift @ camera.camera_matrix


def _with_line(picture: np.ndarray, line: np.ndarray, colour: str) -> np.ndarray:
    """A line drawn where it is known; a gap (NaN) is not bridged."""
    known = np.isfinite(line).all(axis=1)
    for run in np.split(np.arange(len(line)), np.flatnonzero(np.diff(known)) + 1):
        if len(run) > 1 and known[run[0]]:
            line_in_place(picture, line[run], draw.bgr(colour), 1)
    return picture


def distortion(camera: Camera, frame_bgr: np.ndarray | None = None) -> Explorer:
    """Explore the lens of ``camera``, on a frame of it (H, W, 3) uint8 BGR where one is given."""
    frame = None if frame_bgr is None else as_bgr(frame_bgr)
    if frame is not None and (frame.shape[1], frame.shape[0]) != camera.size_wh:
        camera = camera.scaled((frame.shape[1], frame.shape[0]))
    f = float(camera.camera_matrix[0, 0])
    own = dict(zip(COEFFICIENTS, camera.distortion.tolist(), strict=True))
    # half a thousand pixels off axis, a step of k1 moves a point by half a pixel, one of p1 by a third
    spans = {"k1": (0.6, 0.005), "k2": (0.6, 0.005), "p1": (0.03, 0.0005), "p2": (0.03, 0.0005), "k3": (0.6, 0.005)}
    controls = {}
    for name, (reach, step) in spans.items():
        reach = max(reach, 1.5 * abs(own[name]))
        digits, tip = 4 if reach < 0.1 else 3, "tangential coefficient" if name[0] == "p" else "radial coefficient"
        controls[name] = slider(name, own[name], -reach, reach, step, digits=digits, tip=tip)
    controls["f"] = slider("f, px", f, 0.4 * f, 2.5 * f, f / 200, digits=0, tip="focal length in pixels")
    controls["none"] = tick("no distortion", tip="all coefficients 0")

    def make(none, **lens) -> Look:
        return distortion_look(camera, frame, **(lens | dict.fromkeys(COEFFICIENTS, 0.0) if none else lens))

    buttons = [button("Calibrated", lambda: explorer.set(**own, f=f, none=False), tip="the camera's own lens")]
    explorer = Explorer(
        "Distortion explorer",
        make,
        controls,
        buttons=buttons,
        alt="a straight grid through the lens, and the frame undistorted",
    )
    return explorer
