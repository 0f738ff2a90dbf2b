"""Checkers of notebook 03."""

from __future__ import annotations

import numpy as np

from lanelib.exercises.judges import array, function, never_raises, number

HOMOGRAPHY = np.array([[0.012, 0.001, -8.0], [0.0005, -0.011, 9.0], [0.00002, 0.0021, -0.85]])
# four points: with three, H @ points would fit by chance
POINTS = np.array([[640.0, 690.0], [300.0, 520.0], [900.0, 600.0], [500.0, 450.0]])


@never_raises
def check_map_point(answer):
    """Points (N, 2) through a homography (3, 3) of any scale: points (N, 2)."""

    def mapped(matrix, points):
        xyw = np.column_stack([points, np.ones(len(points))]) @ matrix.T
        return xyw[:, :2] / xyw[:, 2:]

    def homogeneous(matrix, points, w=1.0):
        return np.column_stack([points, np.full(len(points), w)]) @ matrix.T

    slips = {
        "divide by the third coordinate: x / w, y / w": lambda h, points: homogeneous(h, points)[:, :2],
        "H @ point takes columns; for points in rows it is points @ H.T": lambda h, points: mapped(h.T, points),
        "this is H @ point without the division, and without the transpose":
            lambda h, points: homogeneous(h.T, points)[:, :2],
        "this maps back: it is the inverse of the matrix": lambda h, points: mapped(np.linalg.inv(h), points),
        "x and y of the points that go in are exchanged": lambda h, points: mapped(h, points[:, ::-1]),
        "the third coordinate of a point that goes in is 1, not 0":
            lambda h, points: homogeneous(h, points, 0.0)[:, :2] / homogeneous(h, points, 0.0)[:, 2:],
        f"homogeneous points (x, y, w) came out; divide by w and leave it out: shape {POINTS.shape}":
            lambda h, points: homogeneous(h, points),
        f"divided, and its 1 is still there; leave it out: shape {POINTS.shape}":
            lambda h, points: homogeneous(h, points) / homogeneous(h, points)[:, 2:],
        f"homogeneous points (x, y, w) in columns came out; divide by w, leave it out: shape {POINTS.shape}":
            lambda h, points: homogeneous(h, points).T,
    }
    cases = [((matrix, POINTS), mapped(matrix, POINTS)) for matrix in (HOMOGRAPHY, -3 * HOMOGRAPHY)]
    # a millimetre will do
    return function(answer, cases, array, rel=0, tolerance=1e-3, columns="x, y", slips=slips)


@never_raises
def check_distance_of_row(answer):
    """Metres ahead of the road seen in a row, from the horizon's row, the focal length and the camera's height."""
    given = ((600.0, 420.0, 1150.0, 1.25), (450.0, 400.0, 1000.0, 1.4), (700.0, 360.0, 800.0, 1.1))
    slips = {
        "rows count from the horizon, not from the top": lambda v, _, f, h: f * h / v,
        "the focal length multiplies: a longer lens spreads the road over more rows":
            lambda v, v_h, f, h: h / (v - v_h),
        "the height is missing": lambda v, v_h, f, h: f / (v - v_h),
        "turned over: fewer rows below the horizon are farther": lambda v, v_h, f, h: (v - v_h) / (f * h),
        "f and the rows are exchanged: farther means fewer rows below the horizon":
            lambda v, v_h, f, h: (v - v_h) * h / f,
        "the height multiplies: from higher up the same row is farther": lambda v, v_h, f, h: f / h / (v - v_h),
        "this is the length of road in one row; the distance has the rows once, not squared":
            lambda v, v_h, f, h: f * h / (v - v_h) ** 2,
        "the row *below* the horizon is a difference": lambda v, v_h, f, h: f * h / (v + v_h),
        "a bracket is missing: v - horizon_v divides as a whole": lambda v, v_h, f, h: f * h / v - v_h,
    }
    cases = [((v, v_h, f, h), f * h / (v - v_h)) for v, v_h, f, h in given]
    return function(answer, cases, number, unit="m", rel=0.005, slips=slips, sign="rows grow downwards")


@never_raises
def check_camera_height(answer):
    """The camera's height from the lane's width in pixels in a row so far below the horizon, and in metres."""
    given = ((533.0, 180.0, 3.66), (210.0, 75.0, 3.5), (800.0, 260.0, 3.0))
    slips = {
        "upside down: more rows below the horizon for the same width is a higher camera":
            lambda width_px, below_px, width_m: width_px / (below_px * width_m),
        "the lane's width in metres divides here, it should multiply":
            lambda width_px, below_px, width_m: below_px / (width_px * width_m),
        "this is the lane's width per row: turn rows and pixels around":
            lambda width_px, below_px, width_m: width_m * width_px / below_px,
        "pixels by pixels are no metres: where does the lane's width in metres come in?":
            lambda width_px, below_px, _: below_px / width_px,
        "metres by pixels are no metres: where do the rows below the horizon come in?":
            lambda width_px, _, width_m: width_m / width_px,
    }
    cases = [((width_px, below_px, width_m), width_m * below_px / width_px) for width_px, below_px, width_m in given]
    return function(answer, cases, number, unit="m", rel=0.006, slips=slips)


@never_raises
def check_true_radius(answer):
    """The true radius from one measured with a wrong length of the view; the width was right."""
    given = ((900.0, 30.0, 36.0), (400.0, 30.0, 24.0))
    slips = {
        "lengths along the road enter squared: R = y² / (2 x)": lambda radius, assumed, true: radius * true / assumed,
        "the other way round: in a view longer than assumed curves are flatter":
            lambda radius, assumed, true: radius * (assumed / true) ** 2,
        "unchanged? y is stretched, x is not (and `//` throws the rest away)": lambda radius, assumed, true: radius,
        "the other way round, and squared: R = y² / (2 x)": lambda radius, assumed, true: radius * assumed / true,
        "this is how many times larger the radius is; the radius itself is asked for":
            lambda radius, assumed, true: (true / assumed) ** 2,
        "the width was right, so x has no part in it: the square is enough":
            lambda radius, assumed, true: radius * (true / assumed) ** 3,
    }
    cases = [((radius, assumed, true), radius * (true / assumed) ** 2) for radius, assumed, true in given]
    return function(answer, cases, number, unit="m", rel=0.005, slips=slips)
