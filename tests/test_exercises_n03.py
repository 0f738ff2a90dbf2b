"""Checkers of notebook 03, and how its figures find dashes."""

import cv2
import numpy as np
import pytest

from lanelib import exercises
from lanelib.figures.n03 import dash_middles


def mapped(matrix, points):
    xyw = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return xyw[:, :2] / xyw[:, 2:]


def test_map_point():
    assert exercises.check_map_point(mapped)
    assert exercises.check_map_point(lambda m, p: cv2.perspectiveTransform(p[None], m)[0])
    assert exercises.check_map_point(lambda m, p: [list(mapped(m, [point])[0]) for point in p])


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda m, p: (np.column_stack([p, np.ones(len(p))]) @ m.T)[:, :2], "divide by the third"),
        (lambda m, p: np.column_stack([p, np.ones(len(p))]) @ m.T, "homogeneous"),
        (lambda m, p: mapped(m.T, p), "points @ H.T"),
        (lambda m, p: m @ p, "mismatch"),
        (lambda m, p: mapped(np.linalg.inv(m), p), "maps back"),
        (lambda m, p: mapped(m, p[:, ::-1]), "go in are exchanged"),
        (lambda m, p: mapped(m, p)[:, ::-1], "x, y is wanted"),
        (lambda m, p: mapped(m, p).T, "shape"),
        (lambda m, p: np.abs(mapped(m, p)) * np.sign(m[2, 2]) * np.sign(mapped(m, p)), "reversed"),
        (..., "nothing here"),
    ],
)
def test_map_point_hints(wrong, hint):
    verdict = exercises.check_map_point(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_distance_of_row():
    assert exercises.check_distance_of_row(lambda v, horizon, f, h: f * h / (v - horizon))
    assert exercises.check_distance_of_row(lambda v, horizon, f, h: round(f * h / (v - horizon), 1))
    assert exercises.check_distance_of_row(lambda v, horizon, f, h: h / np.tan(np.arctan((v - horizon) / f)))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda v, horizon, f, h: f * h / v, "from the horizon"),
        (lambda v, horizon, f, h: f * h / (horizon - v), "rows grow downwards"),
        (lambda v, horizon, f, h: h / (v - horizon), "longer lens"),
        (lambda v, horizon, f, h: f / (v - horizon), "height is missing"),
        (lambda v, horizon, f, h: (v - horizon) / (f * h), "turned over"),
        (lambda v, horizon, f, h: f * h / v - horizon, "bracket"),
        (lambda v, horizon, f, h: f * h / (v - horizon) ** 2, "in one row"),
        (lambda v, horizon, f, h: f / h / (v - horizon), "the height multiplies"),
        (lambda v, horizon, f, h: 1000 * f * h / (v - horizon), "1000 times"),
        (lambda v, horizon, f, h: None, "returns nothing"),
    ],
)
def test_distance_of_row_hints(wrong, hint):
    verdict = exercises.check_distance_of_row(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_camera_height():
    assert exercises.check_camera_height(lambda w_px, d, w: w * d / w_px)
    assert exercises.check_camera_height(lambda w_px, d, w: round(w * d / w_px, 2))
    assert exercises.check_camera_height(lambda w_px, d, w: np.float32(w / (w_px / d)))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda w_px, d, w: w_px / (d * w), "upside down"),
        (lambda w_px, d, w: d / (w_px * w), "should multiply"),
        (lambda w_px, d, w: w * w_px / d, "turn rows and pixels around"),
        (lambda w_px, d, w: 100 * w * d / w_px, "centimetres"),
        (lambda w_px, d, w: d / w_px, "no metres"),  # 3.6 times too small by chance: no km/h
    ],
)
def test_camera_height_hints(wrong, hint):
    verdict = exercises.check_camera_height(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_true_radius():
    assert exercises.check_true_radius(lambda r, assumed, true: r * (true / assumed) ** 2)
    # another way: three points of the circle, stretched
    def refitted(r, assumed, true):
        y = np.array([0.0, 10.0, 20.0])
        return 1 / (2 * np.polyfit(y * true / assumed, y**2 / (2 * r), 2)[0])

    assert exercises.check_true_radius(refitted)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda r, assumed, true: r * true / assumed, "enter squared"),
        (lambda r, assumed, true: r * assumed / true, "squared"),
        (lambda r, assumed, true: r * (assumed / true) ** 2, "the other way round"),
        (lambda r, assumed, true: r, "unchanged"),
        (lambda r, assumed, true: (true / assumed) ** 2, "the radius itself"),
    ],
)
def test_true_radius_hints(wrong, hint):
    verdict = exercises.check_true_radius(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_dash_middles_of_a_known_line():
    y = np.linspace(4, 60, 1500)
    along = np.mod(y - 9.0, 12.19)
    brightness = np.where(along < 3.05, 240.0, 90.0)
    brightness[np.abs(y - 16.0) < 0.2] = 240.0  # a reflector
    brightness[np.abs(along - 1.2) < 0.3] = 90.0  # a chip in the paint
    middles = dash_middles(y, brightness)
    np.testing.assert_allclose(middles, 9.0 + 3.05 / 2 + 12.19 * np.arange(3), atol=0.05)


def test_no_dash_in_an_even_line():
    assert len(dash_middles(np.linspace(4, 40, 300), np.full(300, 100.0))) == 0
