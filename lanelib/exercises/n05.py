"""Checkers of notebook 05."""

from __future__ import annotations

import numpy as np

from lanelib.exercises.judges import array, function, missing, never_raises, not_yet, right
from lanelib.exercises.verdict import Verdict

WORDS = ("measured", "held", "none")


def _hinted(answer, cases, wrong, columns: str = "", **options) -> Verdict:
    """``function`` with ``array``; where it fails, the hint of the first mistake in ``wrong`` (hint, results) that
    explains all cases."""
    verdict = function(answer, cases, array, columns=columns, **options)
    if not verdict and callable(answer):
        for hint, results in wrong:
            renamed = [(given, result) for (given, _), result in zip(cases, results, strict=True)]
            if function(answer, renamed, array, **options):
                return not_yet(hint)
    return verdict


def _exponential(values, alpha) -> np.ndarray:
    out = [values[0]]
    for value in values[1:]:
        out.append(out[-1] + alpha * (value - out[-1]))
    return np.array(out)


@never_raises
def check_exponential(answer):
    """Exponential smoothing of values (N,), beginning with the first value."""
    given = [
        (np.array([0.0, 1.0, 1.0, 1.0]), 0.3),
        (np.array([0.2, -0.1, 0.4, 0.3, 0.0]), 0.5),
        (np.array([5.0, 5.0, 8.0]), 0.1),
    ]

    def from_zero(values, alpha):
        return _exponential(np.concatenate([[0.0], values]), alpha)[1:]

    wrong = [
        ("alpha is the weight of the *new* value; here it is that of the old one",
         [_exponential(v, 1 - a) for v, a in given]),
        ("the step starts from the last *smoothed* value, not from the last given one",
         [np.concatenate([v[:1], v[:-1] + a * (v[1:] - v[:-1])]) for v, a in given]),
        ("these are the values as given; where does alpha come in?", [v for v, _ in given]),
        ("this is the last one alone; all are asked for", [_exponential(*g)[-1] for g in given]),
        ("the first value is missing; it is the first output as it is", [_exponential(*g)[1:] for g in given]),
        ("one too many: the first value is there twice", [np.append(g[0][0], _exponential(*g)) for g in given]),
        ("begin with the first value, not with 0", [from_zero(*g) for g in given]),
    ]
    return _hinted(answer, [(g, _exponential(*g)) for g in given], wrong, rel=0, tolerance=0.006)  # two decimals


def _fuse(a, var_a, b, var_b) -> tuple[float, float]:
    variance = 1 / (1 / var_a + 1 / var_b)
    return variance * (a / var_a + b / var_b), variance


@never_raises
def check_fuse(answer):
    """(mean, variance) of two independent measurements of the same thing."""
    given = [(0.30, 0.04, 0.10, 0.01), (1.0, 2.0, 3.0, 2.0), (-0.2, 0.09, 0.1, 0.25)]
    right_ones = [np.array(_fuse(*g)) for g in given]
    wrong = [
        ("the plain mean; the better one (smaller variance) must count more",
         [((a + b) / 2, _fuse(a, u, b, v)[1]) for a, u, b, v in given]),
        ("weights the wrong way round: the one with the *smaller* variance counts more",
         [((u * a + v * b) / (u + v), _fuse(a, u, b, v)[1]) for a, u, b, v in given]),
        ("the variance: two measurements know more than one, so it is smaller than either",
         [(m[0], u + v) for m, (_, u, _, v) in zip(right_ones, given, strict=True)]),
        ("the standard deviation is given; the variance is asked for",
         [(m[0], np.sqrt(m[1])) for m in right_ones]),
        ("variances enter as they are; here they are squared, as if they were standard deviations",
         [_fuse(a, u * u, b, v * v) for a, u, b, v in given]),
        ("the mean is right; what two know together is surer than the mean of their variances",
         [(m[0], (u + v) / 2) for m, (_, u, _, v) in zip(right_ones, given, strict=True)]),
        ("the mean is right; the worse measurement knows something, too: both together are surer than the better one",
         [(m[0], min(u, v)) for m, (_, u, _, v) in zip(right_ones, given, strict=True)]),
        ("the mean is right; the variance is not the product: its unit would be squared",
         [(m[0], u * v) for m, (_, u, _, v) in zip(right_ones, given, strict=True)]),
        ("the weighted sum still has to be divided by the sum of the weights",
         [(a / u + b / v, m[1]) for m, (a, u, b, v) in zip(right_ones, given, strict=True)]),
        ("the correction goes the wrong way: from a towards b",
         [(2 * a - m[0], m[1]) for m, (a, *_) in zip(right_ones, given, strict=True)]),
        ("this is the better one of the two; the other one knows something, too",
         [(a, u) if u < v else (b, v) for a, u, b, v in given]),
        ("the mean alone; a pair (mean, variance) is asked for", [m[0] for m in right_ones]),
        *((f"both: {first}; and two measurements know more than one, so the variance is smaller than either",
           [(weigh(a, u, b, v), spread(u, v)) for a, u, b, v in given])
          for first, weigh in (("the better one must count more in the mean", lambda a, u, b, v: (a + b) / 2),
                               ("the weights are the wrong way round", lambda a, u, b, v: (u * a + v * b) / (u + v)))
          for spread in (lambda u, v: u + v, lambda u, v: (u + v) / 2)),
        ("both: the better one must count more in the mean, and in the variance",
         [((a + b) / 2, (u + v) / 4) for a, u, b, v in given]),
        ("the second number is 1 / variance; turn it round", [(m[0], 1 / m[1]) for m in right_ones]),
        ("the weights are 1 / variance, not 1 / variance²",
         [((a / u**2 + b / v**2) / (u**-2 + v**-2), _fuse(a, u, b, v)[1]) for a, u, b, v in given]),
        ("weighted with 1 / variance, please: these are weights of 1 / standard deviation",
         [((a / u**0.5 + b / v**0.5) / (u**-0.5 + v**-0.5), _fuse(a, u, b, v)[1]) for a, u, b, v in given]),
    ]
    return _hinted(answer, list(zip(given, right_ones, strict=True)), wrong, "mean, variance", rel=1e-4, tolerance=1e-9)


def _kalman(mean, variance, step_variance, measured, measured_variance) -> tuple[float, float]:
    variance = variance + step_variance
    return (mean, variance) if measured is None else _fuse(mean, variance, measured, measured_variance)


@never_raises
def check_kalman_step(answer):
    """(mean, variance) after one frame: predict, then update, where there is a measurement."""
    given = [
        (0.10, 0.010, 0.002, 0.30, 0.02),
        (0.10, 0.010, 0.002, None, None),  # a missed frame
        (-0.5, 0.004, 0.01, -0.4, 0.01),
        (0.2, 0.010, 0.002, 0.0, 0.02),  # measured exactly in the middle: 0 is a measurement
    ]
    right_ones = [np.array(_kalman(*g)) for g in given]
    wrong = [
        ("the prediction is missing: first add the step's variance, for the car has moved since",
         [_kalman(m, v, 0.0, z, r) for m, v, _, z, r in given]),
        ("a missed frame is a prediction without an update: its variance grows by the step's",
         [r if g[3] is not None else (g[0], g[1]) for r, g in zip(right_ones, given, strict=True)]),
        ("0.0 is a measurement, too: ask `measured is None`, for `not measured` is true for 0",
         [r if g[3] else (g[0], g[1] + g[2]) for r, g in zip(right_ones, given, strict=True)]),
        ("`step_variance` is a variance already: add it as it is, not its square",
         [np.array(_kalman(m, v, q * q, z, r)) for m, v, q, z, r in given]),
        ("the standard deviation is given; the variance is asked for",
         [np.array([r[0], np.sqrt(r[1])]) for r in right_ones]),
        ("first predict, then update: here the step's variance comes after the update",
         [(m, v + q) if z is None else np.add(_fuse(m, v, z, r), (0, q)) for m, v, q, z, r in given]),
        ("the gain is made of the old variance; the predicted one is larger by the step's",
         [(m, v + q) if z is None else (m + v / (v + r) * (z - m), (1 - v / (v + r)) * (v + q))
          for m, v, q, z, r in given]),
        ("the mean is right; the measurement makes the variance smaller, too",
         [(one[0], v + q) for one, (_, v, q, _, _) in zip(right_ones, given, strict=True)]),
        ("the mean is right; of the variance 1 - gain remains, not the gain",
         [(m, v + q) if z is None else (one[0], (v + q) ** 2 / (v + q + r))
          for one, (m, v, q, z, r) in zip(right_ones, given, strict=True)]),
        ("the gain is the wrong way round: a sure measurement (small variance) counts much",
         [(m, v + q) if z is None else (m + r / (v + q + r) * (z - m), one[1])
          for one, (m, v, q, z, r) in zip(right_ones, given, strict=True)]),
        ("the step makes the *estimate* less sure, not the measurement",
         [(m, v + q) if z is None else _fuse(m, v, z, r + q) for m, v, q, z, r in given]),
        ("the past is thrown away: this is the measurement alone",
         [(m, v + q) if z is None else (z, r) for m, v, q, z, r in given]),
        ("a step makes less sure: its variance is added", [_kalman(m, v, -q, z, r) for m, v, q, z, r in given]),
        ("the step's variance makes the estimate less sure; it does not move the mean",
         [_kalman(m + q, v, q, z, r) for m, v, q, z, r in given]),
    ]
    if callable(answer):
        try:
            if (result := answer(*given[1])) is not None and any(part is None for part in result):
                return not_yet("a missed frame has a mean, too: what was known before is still the best guess")
        except TypeError:
            return not_yet("a missed frame comes as None; look for `measured is None` before computing with it")
        except Exception:  # judged below, with the call that raised
            pass
    return _hinted(answer, list(zip(given, right_ones, strict=True)), wrong, "mean, variance", rel=1e-4, tolerance=1e-9)


def _statuses(seen, hold) -> list[str]:
    out, missed, known = [], 0, False
    for one in seen:
        if one:
            missed, known = 0, True
            out.append("measured")
            continue
        missed += 1
        known = known and missed <= hold
        out.append("held" if known else "none")
    return out


def _words(result, expected) -> Verdict:
    """A list of status words."""
    if (verdict := missing(result)) is not None:
        return verdict
    if isinstance(result, str) or not hasattr(result, "__iter__"):
        return not_yet(f"a list of words is needed, found {type(result).__name__}")
    words = [str(word).strip().lower() for word in result]
    if len(words) != len(expected):
        return not_yet(f"one word a frame is needed, {len(expected)}, found {len(words)}")
    if strange := sorted(set(words) - set(WORDS)):
        return not_yet(f"only {', '.join(WORDS)} are used, found {strange[0]!r}")
    if words == expected:
        return right()
    i = next(i for i, (a, b) in enumerate(zip(words, expected, strict=True)) if a != b)
    return not_yet(f"frame {i} must be {expected[i]!r}, found {words[i]!r}")


@never_raises
def check_statuses(answer):
    """Per frame "measured", "held" or "none", from whether a lane was seen, holding at most ``hold`` frames."""
    cases = [
        (([True, False, False, True], 2), None),
        (([False, True, False, False, False, True], 2), None),  # nothing to hold at first; a third miss is too many
        (([True, False, True, False, True, False], 1), None),  # the count begins anew
        (([True, False, False, False, False], 0), None),
    ]
    cases = [(given, _statuses(*given)) for given, _ in cases]
    verdict = function(answer, cases, _words)
    if not verdict and callable(answer):

        def never_ends(seen):
            return ["measured" if s else "held" if any(seen[:i]) else "none" for i, s in enumerate(seen)]

        forever = [(given, never_ends(given[0])) for given, _ in cases]
        if function(answer, forever, _words):
            return not_yet("a dead lane is held for ever; after `hold` missed frames in a row there is none")
        second = ["measured" if s else "held" for s in cases[1][0][0][:3]]
        if function(answer, [((cases[1][0][0][:3], 2), second)], _words):
            return not_yet("before the first lane there is nothing to hold: that is 'none'")
        for hint, results in (
            ("one frame too long: the frame after `hold` missed ones is 'none' already",
             [_statuses(seen, hold + 1) for (seen, hold), _ in cases]),
            ("one frame too short: `hold` frames in a row are held, the next one is 'none'",
             [_statuses(seen, max(hold - 1, 0)) for (seen, hold), _ in cases]),
            ("no frame is held; the first `hold` missed frames after a lane are",
             [_statuses(seen, 0) for (seen, _), _ in cases]),
            ("the count of missed frames begins anew with each lane that is seen",
             [["measured" if s else "held" if any(seen[:i]) and seen[: i + 1].count(False) <= hold else "none"
               for i, s in enumerate(seen)] for (seen, hold), _ in cases]),
        ):
            if function(answer, [(given, result) for (given, _), result in zip(cases, results, strict=True)], _words):
                return not_yet(hint)
    return verdict
