"""Checkers of notebook 06."""

from __future__ import annotations

import math

import numpy as np

from lanelib.exercises.judges import first_failed, function, never_raises, not_yet, number, right


@never_raises
def check_tusimple(answer):
    """Share of labelled points found: nearer than 20 px / cos(angle); -2 in the prediction means not seen."""
    true = np.array([600.0, 480.0, 360.0, 240.0, 120.0, 10.0])
    found = np.array([605.0, 505.0, 381.0, 262.0, -2.0, -2.0])
    upright = true + np.array([0.0, 19.0, 21.0, -19.0, -21.0, 40.0])
    cases = [((found, true, 0.9), 4 / 6), ((upright, true, 0.0), 0.5), ((true, true, 0.4), 1.0)]
    mistakes = {
        "the last point was not seen (-2) and yet counts: |-2 - 10| is small; leave out what is below 0": 5 / 6,
        "the limit is 20 px divided by cos(angle), wider for a slanted line": 1 / 6,
        "this divides by the points that were seen; a line that is not seen at all would then be perfect": 1.0,
        "two things to look at: the limit is 20 px divided by cos(angle), and -2 is not found": 2 / 6,
        "this is how many were found; divide by the number of labelled points": 4.0,
    }
    upright_mistakes = {"a point too far to the left passes: take the absolute value of the difference": 4 / 6}

    def judge(value, expected):
        hints = mistakes if abs(expected - 4 / 6) < 1e-9 else upright_mistakes if expected == 0.5 else {}
        return number(value, expected, tolerance=1e-6, mistakes=hints)

    return function(answer, cases, judge)


@never_raises
def check_jitter(answer):
    """Root mean square of the change of the error from frame to frame."""
    rng = np.random.default_rng(4)
    true = 1.2 * np.sin(np.arange(60) / 9)
    found = true + 0.3 + 0.02 * rng.standard_normal(60)
    error = found - true
    expected = float(np.sqrt(np.mean(np.diff(error) ** 2)))
    mistakes = {
        "this is the RMS of the error; a steady error of 30 cm does not jitter: take the change from frame to frame":
            float(np.sqrt(np.mean(error**2))),
        "this counts the lane's own motion: the car really moves; subtract the truth first":
            float(np.sqrt(np.mean(np.diff(found) ** 2))),
        "this is the mean of absolute changes; square, take the mean, then the root":
            float(np.mean(np.abs(np.diff(error)))),
        "the root is missing": expected**2,
        "this is the standard deviation of the error; a slow drift would count as jitter": float(np.std(error)),
        "the changes cancel: square them before you take the mean": float(np.mean(np.diff(error))),
        "the squares are added up; take their mean": float(np.sqrt(np.sum(np.diff(error) ** 2))),
        "this is the largest change; take the root of the mean of their squares": float(np.abs(np.diff(error)).max()),
        "differences were taken twice; the change from frame to frame is one":
            float(np.sqrt(np.mean(np.diff(error, 2) ** 2))),
        "the difference of two RMS: subtract the truth frame by frame, before anything is squared":
            float(np.sqrt(np.mean(np.diff(found) ** 2)) - np.sqrt(np.mean(np.diff(true) ** 2))),
    }
    swaying = error - 0.3  # of either sign
    swaying_rms = float(np.sqrt(np.mean(np.diff(np.abs(swaying)) ** 2)))
    swaying_mistakes = {"the error has a sign: from -2 cm to +2 cm is a change of 4 cm; leave `abs` out": swaying_rms}

    def judge(value, wanted):
        # N - 1 or N changes: both are fine
        return number(value, wanted, unit="m", rel=0.02, mistakes=mistakes)

    def judge_swaying(value, wanted):
        return number(value, wanted, unit="m", rel=0.02, mistakes=swaying_mistakes)

    return first_failed(
        function(answer, [((found, true), expected)], judge),
        lambda: function(answer, [((true + swaying, true), expected)], judge_swaying),
    )


@never_raises
def check_pitch_error(answer):
    """Metres by which a line at x moves sideways at distance y when the pitch is wrong; exact, or x y d / h."""
    cases = [((1.85, 30.0, 0.3, 1.25),), ((-1.85, 20.0, 0.5, 1.4),), ((1.85, 10.0, 0.0, 1.25),)]
    slip = _pitch_slip(answer)
    if slip is not None:
        return slip
    verdict = right()
    for (given,) in cases:
        x, y, degrees, height = given
        expected = abs(x) * y * math.radians(degrees) / height

        def judge(value, wanted):
            first = number(value, wanted, unit="m", tolerance=1e-9)
            if first or np.size(value) != 1 or np.asarray(value).dtype.kind not in "iuf":
                return first
            return number(abs(float(np.ravel(value)[0])), wanted, unit="m", rel=0.2, tolerance=1e-9)

        verdict = function(answer, [(given, expected)], judge)
        if not verdict:
            return verdict
    return verdict


def _pitch_slip(answer):
    """Typical mistakes by their value; None where there is none."""
    try:
        value = abs(float(np.asarray(answer(1.85, 30.0, 0.3, 1.25)).item()))
    except Exception:
        return None  # judged below, where every kind of wrong answer has its hint
    delta = math.radians(0.3)
    slips = {
        "this is by how much the point moves ahead, y² δ / h; sideways it moves by x / y of that": 30**2 * delta / 1.25,
        "this is y δ, the error of a wrong yaw; a wrong pitch moves the point along its own ray": 30 * delta,
        "this is x δ; how far does the point move along its ray, and how much of that is sideways?": 1.85 * delta,
        "the height divides: a higher camera makes a smaller error": 1.85 * 30 * delta * 1.25,
        "the height is missing: a higher camera makes a smaller error": 1.85 * 30 * delta,
        "the ray leads to (x, y): sideways it goes x / y of the way ahead, not y / x": 30**3 * delta / 1.25 / 1.85,
        "this is where the line seems to be; by how much it moves is asked": 1.85 + 1.85 * 30 * delta / 1.25,
        "ahead, not sideways, and in degrees where radians are wanted": 30**2 * 0.3 / 1.25,
        "this is where the point seems to be ahead; how far does it move, and how much of that is sideways?":
            30 + 30**2 * delta / 1.25,
        "x is in it twice; the distance makes the error grow": 1.85**2 * delta / 1.25,
        "sin, cos and π know radians, the pitch is given in degrees": 1.85 * 30 * 0.3 / 1.25,
    }
    return next((not_yet(hint) for hint, slip in slips.items() if abs(value / slip - 1) < 0.02), None)
