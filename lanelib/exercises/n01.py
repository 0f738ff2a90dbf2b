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

    def judge(value, expected, given=cases[0]):
        slip = _known_slip(value, *given)
        return array(value, expected, rel=1e-6, tolerance=1e-9, columns="x, y") if slip is None else slip

    return first_failed(
        function(answer, [(cases[0], _lens(*cases[0]))], judge),
        lambda: function(answer, [(case, _lens(*case)) for case in cases], array, rel=1e-6, tolerance=1e-9),
    )


def _known_slip(value, x: float, y: float, k1: float, k2: float) -> Verdict | None:
    """Typical mistakes, told by their value; None for anything else."""
    r = np.hypot(x, y)
    slips = {
        "this uses r and r² where the equation has r² and r⁴": 1 + k1 * r + k2 * r**2,
        "k2 goes with r⁴, the square of r²": 1 + (k1 + k2) * r**2,
        "this divides; the lens multiplies": 1 / (1 + k1 * r**2 + k2 * r**4),
        "the 1 is missing: the factor is 1 + k1 r² + k2 r⁴": k1 * r**2 + k2 * r**4,
    }
    if np.shape(value) == (2,):
        for hint, factor in slips.items():
            if np.allclose(np.asarray(value, float), np.array([x, y]) * factor, rtol=1e-6):
                return not_yet(hint)
    return None


@never_raises
def check_scaled_matrix(answer):
    """The camera matrix of pictures shrunk to ``factor`` of their size; with or without the half pixel."""
    matrix = np.array([[1155.0, 0, 665.3], [0, 1152.0, 386.7], [0, 0, 1]])
    verdict = right()
    for factor in (0.5, 0.25, 1.5):
        expected = np.diag([factor, factor, 1]) @ matrix
        expected[:2, 2] += 0.5 * factor - 0.5

        def judge(value, _, expected=expected, factor=factor):
            if np.shape(value) == (3, 3) and np.isclose(np.asarray(value, float)[2, 2], factor):
                return not_yet("the last row must stay 0, 0, 1: a camera matrix has no scale of its own")
            return array(value, expected, unit="px", rel=0, tolerance=0.55)

        verdict = first_failed(verdict, function(answer, [((matrix, factor), expected)], judge))
        if not verdict:
            return verdict
    exact = np.asarray(answer(matrix.copy(), 0.25), float)[0, 2]
    plain = abs(exact - 0.25 * 665.3) < 1e-6
    return right("pixel centres at integers would shift the centre by another 0.375 px here; see Camera.scaled"
                 if plain else "")  # fmt: skip


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
    }  # fmt: skip
    return function(answer, [((seen, projected), rms)], number, unit="px", rel=1e-6, mistakes=mistakes)


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
