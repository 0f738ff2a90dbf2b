"""Checkers of notebook 01: right, right in another way, and typical mistakes with the hint each must get."""

import numpy as np
import pytest

from lanelib import exercises


def radial(x, y, k1, k2):
    r = np.hypot(x, y)
    factor = 1 + k1 * r**2 + k2 * r**4
    return np.array([x, y]) * factor


def of_r(x, y, k1, k2):
    r = np.hypot(x, y)
    return x * (1 + k1 * r + k2 * r * r), y * (1 + k1 * r + k2 * r * r)


def divided(x, y, k1, k2):
    rr = x * x + y * y
    return x / (1 + k1 * rr + k2 * rr**2), y / (1 + k1 * rr + k2 * rr**2)


def no_one(x, y, k1, k2):
    rr = x * x + y * y
    return x * (k1 * rr + k2 * rr**2), y * (k1 * rr + k2 * rr**2)


def test_radial():
    assert exercises.check_radial(radial)
    assert exercises.check_radial(lambda x, y, k1, k2: tuple(radial(x, y, k1, k2)))
    assert exercises.check_radial(lambda x, y, k1, k2: list(radial(x, y, k1, k2)))
    assert exercises.check_radial(lambda x, y, k1, k2: radial(x, y, k1, k2).round(4))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (of_r, "where the equation has r²"),
        (divided, "multiplies"),
        (no_one, "the 1 is missing"),
        (lambda x, y, k1, k2: radial(x, y, k1, 0), "k2 is missing"),
        (lambda x, y, k1, k2: radial(x, y, k2, k1), "exchanged"),
        (lambda x, y, k1, k2: radial(x, y, -k1, -k2), "with their own signs"),
        (lambda x, y, k1, k2: radial(x, y, k1, k2) / [x or 1, y or 1] * [1, 0], "right"),
        (lambda x, y, k1, k2: 1 + k1 * np.hypot(x, y) ** 2 + k2 * np.hypot(x, y) ** 4, "the factor alone"),
        (lambda x, y, k1, k2: (x, y), "nothing has moved"),
        (lambda x, y, k1, k2: (radial(x, 0, k1, k2)[0], radial(0, y, k1, k2)[1]), "the one factor"),
        (lambda x, y, k1, k2: radial(x, y, k1, k2)[::-1], "x, y is wanted"),
        (lambda x, y, k1, k2: radial(x, y, k1, k2)[0], "2 numbers are needed"),
        (lambda x, y, k1, k2: (x * (1 + (k1 + k2) * (x * x + y * y)), y * (1 + (k1 + k2) * (x * x + y * y))), "r⁴"),
        (lambda x, y, k1, k2: None, "return"),
        (lambda x, y, k1, k2: x / 0, "ZeroDivisionError"),
        (..., "nothing here"),
        (3.0, "a function is needed"),
    ],
)
def test_radial_hints(wrong, hint):
    verdict = exercises.check_radial(wrong)
    assert not verdict
    assert hint in verdict.hint


def scaled(matrix, factor):
    out = np.array(matrix, float)
    out[:2] *= factor
    return out


def half_pixel(matrix, factor):
    out = scaled(matrix, factor)
    out[:2, 2] += 0.5 * factor - 0.5
    return out


def in_place(matrix, factor):
    matrix[:2] *= factor
    return matrix


def test_scaled_matrix():
    assert exercises.check_scaled_matrix(half_pixel)
    assert exercises.check_scaled_matrix(half_pixel).hint == ""
    assert "0.375" in exercises.check_scaled_matrix(scaled).hint
    assert exercises.check_scaled_matrix(lambda matrix, factor: (np.diag([factor, factor, 1]) @ matrix).tolist())
    assert exercises.check_scaled_matrix(lambda matrix, factor: scaled(matrix, factor).round())


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda matrix, factor: matrix * factor, "last row"),
        (lambda matrix, factor: matrix, "unchanged"),
        (lambda matrix, factor: scaled(matrix, 1 / factor), "other way round"),
        (lambda matrix, factor: scaled(matrix, factor**2), "twice"),
        (lambda matrix, factor: matrix @ np.diag([factor, factor, 1]), "principal point is a place"),
        (lambda matrix, factor: scaled(matrix, factor).T, "transposed"),
        (lambda matrix, factor: scaled(matrix, factor)[:2], "shape"),
        (in_place, "changes its argument"),
        (lambda matrix, factor: ..., "returns nothing"),
    ],
)
def test_scaled_matrix_hints(wrong, hint):
    verdict = exercises.check_scaled_matrix(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_rms():
    assert exercises.check_rms(lambda a, b: np.sqrt(((a - b) ** 2).sum(1).mean()))
    assert exercises.check_rms(lambda a, b: np.linalg.norm(a - b) / np.sqrt(len(a)))
    assert exercises.check_rms(lambda a, b: round(float(np.linalg.norm(a - b) / np.sqrt(len(a))), 2))
    assert exercises.check_rms(lambda a, b: np.linalg.norm(np.float32(a) - np.float32(b)) / np.sqrt(len(a)))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda a, b: np.hypot(*(a - b).T).mean(), "mean distance"),
        (lambda a, b: np.sqrt(((a - b) ** 2).mean()), "2N"),
        (lambda a, b: np.linalg.norm(a - b) / len(a), "as some programs print it"),
        (lambda a, b: ((a - b) ** 2).sum(1).mean(), "the root is missing"),
        (lambda a, b: np.linalg.norm(a - b), "divide by N"),
        (lambda a, b: np.hypot(*(a - b).T), "a single number"),
        (lambda a, b: np.sqrt(((a - b) ** 2).sum(0).mean()), "down the columns"),
        (lambda a, b: (a - b).std(), "a shift is an error"),
        (lambda a, b: (a - b).mean(), "cancel"),
        (lambda a, b: np.sqrt(((a - b).sum(1) ** 2).mean()), "added before squaring"),
        (None, "None"),
    ],
)
def test_rms_hints(wrong, hint):
    verdict = exercises.check_rms(wrong)
    assert not verdict
    assert hint in verdict.hint


def test_trust():
    assert exercises.check_trust("b")
    assert exercises.check_trust(" B ") and exercises.check_trust("(b)") and exercises.check_trust("b.")
    assert "where in the frame" in exercises.check_trust("a").hint
    assert "parallel" in exercises.check_trust("c").hint
    assert "one of" in exercises.check_trust("d").hint
    assert not exercises.check_trust(...)
