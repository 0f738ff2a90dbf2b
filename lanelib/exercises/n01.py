"""Checkers of notebook 01."""

from __future__ import annotations

import numpy as np

from lanelib.exercises.judges import array, choice, first_failed, function, never_raises, not_yet, number, right
from lanelib.exercises.verdict import Verdict


def _lens(x: float, y: float, k1: float, k2: float) -> tuple[float, float]:
    rr = x * x + y * y
    factor = 1 + k1 * rr + k2 * rr * rr
    return x * factor, y * factor


@never_raises
def check_radial(answer):
    """Normalised (x, y) moved by the radial part of a lens, coefficients k1 and k2: a pair (x_d, y_d)."""
    cases = [(0.3, -0.4, -0.24, 0.05), (0.5, 0.2, -0.3, 0.11), (0.0, 0.0, -0.3, 0.1)]

    def slipped(factor):
        """The lens with this factor instead, of r, k1 and k2."""
        return lambda x, y, k1, k2: np.array([x, y]) * factor(np.hypot(x, y), k1, k2)

    slips = {
        "this uses r and r² where the equation has r² and r⁴": slipped(lambda r, k1, k2: 1 + k1 * r + k2 * r**2),
        "k2 goes with r⁴, the square of r²": slipped(lambda r, k1, k2: 1 + (k1 + k2) * r**2),
        "the power of r with k2: r⁴ is the square of r², not r³": slipped(lambda r, k1, k2: 1 + k1 * r**2 + k2 * r**3),
        "the power of r with k2: r⁶ goes with k3": slipped(lambda r, k1, k2: 1 + k1 * r**2 + k2 * r**6),
        "r² was squared once more: x² + y² is r² already": slipped(lambda r, k1, k2: 1 + k1 * r**4 + k2 * r**8),
        "k1 and k2 are exchanged": slipped(lambda r, k1, k2: 1 + k2 * r**2 + k1 * r**4),
        "k2 is missing": slipped(lambda r, k1, k2: 1 + k1 * r**2),
        "both are added, with their own signs: k1 < 0 pulls inwards":
            slipped(lambda r, k1, k2: 1 - k1 * r**2 - k2 * r**4),
        "this divides; the lens multiplies": slipped(lambda r, k1, k2: 1 / (1 + k1 * r**2 + k2 * r**4)),
        "the 1 is missing: the factor is 1 + k1 r² + k2 r⁴": slipped(lambda r, k1, k2: k1 * r**2 + k2 * r**4),
        "nothing has moved: where do k1 and k2 come in?": slipped(lambda r, k1, k2: 1.0),
        "the same r for both: each coordinate is multiplied by the one factor of x² + y²":
            lambda x, y, k1, k2: (x * (1 + k1 * x**2 + k2 * x**4), y * (1 + k1 * y**2 + k2 * y**4)),
        "this is the factor alone; multiply x and y by it":
            lambda x, y, k1, k2: 1 + k1 * (x * x + y * y) + k2 * (x * x + y * y) ** 2,
    }
    cases = [(case, _lens(*case)) for case in cases]
    return function(answer, cases, array, rel=0, tolerance=1e-4, columns="x, y", slips=slips)  # four digits will do


def _scaled(matrix, factor, entries) -> np.ndarray:
    """The matrix with these entries multiplied."""
    out = matrix.copy()
    for entry in entries:
        out[entry] *= factor
    return out


_FOCAL, _CENTRE = ((0, 0), (1, 1)), ((0, 2), (1, 2))
_MATRICES = {
    "the focal lengths are right; the principal point is a place in the picture, it moves, too":
        lambda matrix, factor: _scaled(matrix, factor, _FOCAL),
    "the principal point is right; the focal lengths are in pixels, too":
        lambda matrix, factor: _scaled(matrix, factor, _CENTRE),
    "the other way round: a smaller picture has a smaller focal length in pixels":
        lambda matrix, factor: _scaled(matrix, 1 / factor, _FOCAL + _CENTRE),
    "unchanged? pixels are larger in the smaller picture, so there are fewer of them": lambda matrix, factor: matrix,
    "the factor came in twice; an area has two sides, a focal length is along one":
        lambda matrix, factor: _scaled(matrix, factor**2, _FOCAL + _CENTRE),
    "u has its factor, v has not: both sides of the picture shrink":
        lambda matrix, factor: _scaled(matrix, factor, ((0, 0), (0, 2))),
}


def _judge_matrix(value, expected, *, mistakes) -> Verdict:
    if np.shape(value) == (3, 3) and not np.allclose(np.asarray(value, float)[2], (0, 0, 1)):
        last = np.asarray(value, float)[2]
        if np.allclose(last[:2], 0):
            return not_yet("the last row must stay 0, 0, 1: a camera matrix has no scale of its own")
        return not_yet("the last row must stay 0, 0, 1; is the matrix transposed?")
    return array(value, expected, unit="px", rel=0, tolerance=1.0, mistakes=mistakes)  # whole pixels will do


@never_raises
def check_scaled_matrix(answer):
    """The camera matrix of pictures shrunk to ``factor`` of their size; with or without the half pixel."""
    matrix = np.array([[1155.0, 0, 665.3], [0, 1152.0, 386.7], [0, 0, 1]])
    verdict = right()
    for factor in (0.5, 0.25, 1.5):
        expected = np.diag([factor, factor, 1]) @ matrix
        expected[:2, 2] += 0.5 * factor - 0.5
        case = (matrix, factor), expected
        verdict = first_failed(verdict, function(answer, [case], _judge_matrix, slips=_MATRICES))
        if not verdict:
            return verdict
    exact = np.asarray(answer(matrix.copy(), 0.25), float)[0, 2]
    plain = abs(exact - 0.25 * 665.3) < 1e-6
    return right("pixel centres at integers would shift the centre by another 0.375 px here; see Camera.scaled"
                 if plain else "")


@never_raises
def check_rms(answer):
    """RMS over the corners of the distance between two arrays (N, 2)."""
    rng = np.random.default_rng(5)
    seen = rng.uniform(0, 700, (54, 2))
    projected = seen + rng.normal(0, 0.7, (54, 2)) + (0.3, 0.0)
    off = np.hypot(*(seen - projected).T)
    rms = float(np.sqrt((off**2).mean()))
    mistakes = {
        "this is the mean distance; RMS squares first, takes the mean, then the root": float(off.mean()),
        "divided by the number of coordinates (2N); the mean is over N corners, each with du² + dv²": rms / np.sqrt(2),
        "this is the norm divided by N, as some programs print it; the root must be taken after dividing":
            float(np.sqrt((off**2).sum()) / len(off)),
        "the root is missing": rms**2,
        "this is the norm of all residuals; divide by N inside the root": float(np.sqrt((off**2).sum())),
        "summed down the columns: du² and dv² of one corner stand in one row": float(np.sqrt((off**2).sum() / 2)),
        "the standard deviation takes a common shift away first; a shift is an error, too":
            float((seen - projected).std()),
        "this is the mean of |du| and |dv|; RMS squares first, takes the mean, then the root":
            float(np.abs(seen - projected).mean()),
        "errors of both signs cancel here; square them first": float((seen - projected).mean()),
        "du and dv were added before squaring; a distance is √(du² + dv²)":
            float(np.sqrt(((seen - projected).sum(axis=1) ** 2).mean())),
        "this is the median distance; RMS squares, takes the mean, then the root": float(np.median(off)),
        "this is the largest distance; the mean is over all corners": float(off.max()),
    }
    # two decimals will do
    return function(answer, [((seen, projected), rms)], number, unit="px", rel=0.005, mistakes=mistakes)


@never_raises
def check_trust(answer):
    """Which calibration to trust."""
    return choice(
        answer,
        "b",
        among=("a", "b", "c"),
        hints={
            "a": "its RMS is low because three boards are easily pleased; where in the frame do they lie?",
            "c": "boards that are all parallel to the sensor leave the focal length free, however many they are",
        },
        said="many boards, tilted, all over the frame; its RMS is honest because it had something to contradict it",
    )
