"""Checkers of notebook 03."""

from __future__ import annotations

import numpy as np

from lanelib.exercises.judges import array, first_failed, function, never_raises, not_yet, number, right

HOMOGRAPHY = np.array([[0.012, 0.001, -8.0], [0.0005, -0.011, 9.0], [0.00002, 0.0021, -0.85]])
POINTS = np.array([[640.0, 690.0], [300.0, 520.0], [900.0, 600.0]])


@never_raises
def check_map_point(answer):
    """Points (N, 2) through a homography (3, 3) of any scale: points (N, 2)."""
    xyw = np.column_stack([POINTS, np.ones(3)]) @ HOMOGRAPHY.T
    expected = xyw[:, :2] / xyw[:, 2:]
    transposed = np.column_stack([POINTS, np.ones(3)]) @ HOMOGRAPHY
    slips = {
        "divide by the third coordinate: x / w, y / w": xyw[:, :2],
        "H @ point takes columns; for points in rows it is points @ H.T": transposed[:, :2] / transposed[:, 2:],
        "this is H @ point without the division, and without the transpose": transposed[:, :2],
    }

    def judge(value, wanted):
        if np.shape(value) == (3, 3):
            return not_yet("homogeneous points (x, y, w) came out; divide by w and leave it out: shape (3, 2)")
        if np.shape(value) == (3, 2):
            for hint, slip in slips.items():
                if np.allclose(np.asarray(value, float), slip, rtol=1e-6):
                    return not_yet(hint)
        return array(value, wanted, rel=1e-6, columns="x, y")

    return first_failed(
        function(answer, [((HOMOGRAPHY, POINTS), expected)], judge),
        lambda: function(answer, [((-3 * HOMOGRAPHY, POINTS), expected)], array, rel=1e-6, columns="x, y"),
    )


@never_raises
def check_distance_of_row(answer):
    """Metres ahead of the road seen in a row, from the horizon's row, the focal length and the camera's height."""
    cases = ((600.0, 420.0, 1150.0, 1.25), (450.0, 400.0, 1000.0, 1.4), (700.0, 360.0, 800.0, 1.1))
    verdict = right()
    for v, horizon, focal, height in cases:
        below = v - horizon
        mistakes = {
            "rows count from the horizon, not from the top": focal * height / v,
            "the focal length multiplies: a longer lens spreads the road over more rows": height / below,
            "the height is missing": focal / below,
            "this is rows per metre turned over: y = f h / (v - v_h)": below / (focal * height),
            "f and the rows are exchanged: farther means fewer rows below the horizon": below * height / focal,
        }
        expected = focal * height / below
        verdict = first_failed(verdict, function(answer, [((v, horizon, focal, height), expected)], number, unit="m",
                               rel=1e-4, mistakes=mistakes, sign="rows grow downwards"))  # fmt: skip
        if not verdict:
            return verdict
    return verdict


@never_raises
def check_camera_height(answer):
    """The camera's height from the lane's width in pixels in a row so far below the horizon, and in metres."""
    cases = ((533.0, 180.0, 3.66), (210.0, 75.0, 3.5), (800.0, 260.0, 3.0))
    verdict = right()
    for width_px, below_px, width_m in cases:
        mistakes = {
            "upside down: more rows below the horizon for the same width is a higher camera":
                width_px / (below_px * width_m),
            "the lane's width in metres divides here, it should multiply": below_px / (width_px * width_m),
            "this is the lane's width per row: turn rows and pixels around": width_m * width_px / below_px,
        }  # fmt: skip
        case = ((width_px, below_px, width_m), width_m * below_px / width_px)
        verdict = first_failed(verdict, function(answer, [case],
                               number, unit="m", rel=1e-4, mistakes=mistakes))  # fmt: skip
        if not verdict:
            return verdict
    return verdict


@never_raises
def check_true_radius(answer):
    """The true radius from one measured with a wrong length of the view; the width was right."""
    cases = ((1000.0, 30.0, 36.0), (400.0, 30.0, 24.0))
    verdict = right()
    for radius, assumed, true in cases:
        mistakes = {
            "lengths along the road enter squared: R = y² / (2 x)": radius * true / assumed,
            "the other way round: in a view longer than assumed curves are flatter": radius * (assumed / true) ** 2,
            "unchanged? y is stretched, x is not": radius,
            "the other way round, and squared: R = y² / (2 x)": radius * assumed / true,
        }
        verdict = first_failed(verdict, function(answer, [((radius, assumed, true), radius * (true / assumed) ** 2)],
                               number, unit="m", rel=1e-3, mistakes=mistakes))  # fmt: skip
        if not verdict:
            return verdict
    return verdict
