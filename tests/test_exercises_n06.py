"""Checkers of notebook 06: right, right in another way, and typical mistakes with the hint each must get."""

import math

import numpy as np
import pytest

from lanelib import exercises
from lanelib.figures import n06


def tusimple(found, label, angle):
    good = [f >= 0 and abs(f - x) * math.cos(angle) < 20 for f, x in zip(found, label, strict=True)]
    return sum(good) / len(good)


def test_tusimple():
    assert exercises.check_tusimple(tusimple)
    assert exercises.check_tusimple(lambda f, x, a: np.array([np.mean((np.abs(f - x) < 20 / np.cos(a)) & (f != -2))]))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda f, x, a: np.mean(np.abs(f - x) < 20 / np.cos(a)), "was not seen"),
        (lambda f, x, a: np.mean((np.abs(f - x) < 20 * np.cos(a)) & (f >= 0)), "divided by cos"),
        (lambda f, x, a: np.mean((np.abs(f - x) < 20) & (f >= 0)), "divided by cos"),
        (lambda f, x, a: np.mean((np.abs(f - x) < 20 / np.cos(a))[f >= 0]), "not seen at all"),
        (lambda f, x, a: 100 * np.mean((np.abs(f - x) < 20 / np.cos(a)) & (f >= 0)), "per cent"),
        (lambda f, x, a: np.abs(f - x) < 20, "single number"),
        (lambda f, x, a: np.mean((f - x < 20 / np.cos(a)) & (f >= 0)), "absolute value"),
        (lambda f, x, a: np.sum((np.abs(f - x) < 20 / np.cos(a)) & (f >= 0)), "how many"),
        (lambda f, x, a: np.mean(np.abs(f - x) < 20), "two things"),
        (lambda f, x, a: None, "return"),
        (..., "nothing here"),
    ],
)
def test_wrong_tusimple(wrong, hint):
    verdict = exercises.check_tusimple(wrong)
    assert not verdict and hint in verdict.hint


def test_jitter():
    assert exercises.check_jitter(lambda f, t: np.sqrt(np.mean(np.diff(f - t) ** 2)))
    assert exercises.check_jitter(lambda f, t: np.linalg.norm(np.diff(f) - np.diff(t)) / np.sqrt(len(f)))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda f, t: np.sqrt(np.mean((f - t) ** 2)), "steady error"),
        (lambda f, t: np.sqrt(np.mean(np.diff(f) ** 2)), "the car really moves"),
        (lambda f, t: np.mean(np.abs(np.diff(f - t))), "mean of absolute"),
        (lambda f, t: np.mean(np.diff(f - t) ** 2), "root is missing"),
        (lambda f, t: np.std(f - t), "slow drift"),
        (lambda f, t: 100 * np.sqrt(np.mean(np.diff(f - t) ** 2)), "centimetres"),
        (lambda f, t: np.diff(f - t), "single number"),
        (lambda f, t: np.sqrt(np.mean(np.diff(np.abs(f - t)) ** 2)), "leave `abs` out"),
        (lambda f, t: np.sqrt(np.sum(np.diff(f - t) ** 2)), "take their mean"),
        (lambda f, t: np.sqrt(np.mean(np.diff(f - t, 2) ** 2)), "taken twice"),
    ],
)
def test_wrong_jitter(wrong, hint):
    verdict = exercises.check_jitter(wrong)
    assert not verdict and hint in verdict.hint


def exact(x, y, degrees, h):
    return x * (1 / (1 - y * math.tan(math.radians(degrees)) / h) - 1)


def test_pitch_error():
    assert exercises.check_pitch_error(lambda x, y, d, h: x * y * np.radians(d) / h)
    assert exercises.check_pitch_error(exact)
    assert exercises.check_pitch_error(lambda x, y, d, h: np.array([x * y * np.radians(d) / h]))
    assert exercises.check_pitch_error(lambda x, y, d, h: abs(x) * y * np.radians(d) / h)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda x, y, d, h: x * y * d / h, "radians"),
        (lambda x, y, d, h: y**2 * np.radians(d) / h, "moves ahead"),
        (lambda x, y, d, h: y * np.radians(d), "yaw"),
        (lambda x, y, d, h: x * y * np.radians(d) * h, "the height divides"),
        (lambda x, y, d, h: 100 * x * y * np.radians(d) / h, "100 times too large"),
        (lambda x, y, d, h: 0.0, "too small"),
        (lambda x, y, d, h: x / d, "0.0"),
        (lambda x, y, d, h: None, "return"),
        (lambda x, y, d, h: [x, y], "a single number"),
        (lambda x, y, d, h: "far", "a number is needed"),
        (lambda x, y, d, h: x * y * np.radians(d), "height is missing"),
        (lambda x, y, d, h: x + x * y * np.radians(d) / h, "by how much it moves"),
        (7, "a function is needed"),
    ],
)
def test_wrong_pitch_error(wrong, hint):
    verdict = exercises.check_pitch_error(wrong)
    assert not verdict and hint in verdict.hint, verdict


def test_tables_of_shares_stand_below_each_other_with_the_same_shades():
    tables = {"right": {"a": {"x": 1.0, "y": 0.9}, "b": {"x": 0.5, "y": 0.9}}, "strict": {"a": {"x": 0.2, "y": 0.9}}}
    above, below = n06.matrices(tables).axes
    assert [a.get_title(loc="left") for a in (above, below)] == ["right", "strict"]
    assert [t.get_text() for t in above.texts] == ["1.00", "0.90", "0.50", "0.90"]
    assert above.images[0].get_clim() == below.images[0].get_clim() == (0.2, 1)
    assert below.texts[0].get_color() == "white" != below.texts[1].get_color()
    assert above.get_position().y0 > below.get_position().y1
