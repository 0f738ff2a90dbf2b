"""The checkers of notebook 05: right answers, other right answers, and wrong ones with the hint they must give."""

import numpy as np
import pytest

from lanelib import exercises, figures
from lanelib.draw import PALETTE, SMOOTHER_COLOURS
from lanelib.figures import n05
from lanelib.tracking import SMOOTHING


def test_nothing_there_yet():
    for name in ("exponential", "fuse", "kalman_step", "statuses"):
        check = getattr(exercises, f"check_{name}")
        assert not check(...) and not check(None) and not check(3), name
        assert "nothing" in check(lambda *_: None).hint, name


# ------------------------------------------------------------------ exponential smoothing
def exponential(values, alpha):
    out = [values[0]]
    for value in values[1:]:
        out.append((1 - alpha) * out[-1] + alpha * value)
    return out


def test_exponential():
    assert exercises.check_exponential(exponential)
    assert exercises.check_exponential(lambda v, a: np.array(exponential(v, a)))
    assert "new" in exercises.check_exponential(lambda v, a: exponential(v, 1 - a)).hint
    assert "first" in exercises.check_exponential(lambda v, a: exponential([0, *v], a)[1:]).hint
    assert exercises.check_exponential(lambda v, a: np.round(exponential(v, a), 2))
    assert "the first value is missing" in exercises.check_exponential(lambda v, a: exponential(v, a)[1:]).hint
    assert "all are asked for" in exercises.check_exponential(lambda v, a: exponential(v, a)[-1]).hint
    raw = exercises.check_exponential(lambda v, a: np.append(v[0], (1 - a) * v[:-1] + a * v[1:]))
    assert "smoothed" in raw.hint
    assert "generator" in exercises.check_exponential(lambda v, a: (x for x in exponential(v, a))).hint

    def in_place(values, alpha):
        for i in range(1, len(values)):
            values[i] = values[i - 1] + alpha * (values[i] - values[i - 1])
        return values

    assert "copy" in exercises.check_exponential(in_place).hint


# ------------------------------------------------------------------ fusing
def fuse(a, var_a, b, var_b):
    gain = var_a / (var_a + var_b)
    return a + gain * (b - a), (1 - gain) * var_a


@pytest.mark.parametrize(("wrong", "hint"), [
    (lambda a, u, b, v: ((a + b) / 2, u * v / (u + v)), "plain mean"),
    (lambda a, u, b, v: (fuse(a, v, b, u)[0], u * v / (u + v)), "wrong way round"),
    (lambda a, u, b, v: (fuse(a, u, b, v)[0], u + v), "smaller than either"),
    (lambda a, u, b, v: ((a + b) / 2, (u + v) / 2), "both: the better one must count more"),
    (lambda a, u, b, v: (fuse(a, v, b, u)[0], u + v), "both: the weights are the wrong way round"),
    (lambda a, u, b, v: fuse(a, u * u, b, v * v), "here they are squared"),
    (lambda a, u, b, v: (fuse(a, u, b, v)[0], min(u, v)), "surer than the better one"),
    (lambda a, u, b, v: (a / u + b / v, u * v / (u + v)), "sum of the weights"),
    (lambda a, u, b, v: fuse(a, u, b, v)[0], "a pair"),
    (lambda a, u, b, v: (fuse(a, u, b, v)[0], (u * v / (u + v)) ** 0.5), "variance"),
])
def test_fuse(wrong, hint):
    assert exercises.check_fuse(fuse)
    verdict = exercises.check_fuse(wrong)
    assert not verdict and hint in verdict.hint, verdict


# ------------------------------------------------------------------ one step of a filter
def step(mean, variance, step_variance, measured, measured_variance):
    variance += step_variance
    return (mean, variance) if measured is None else fuse(mean, variance, measured, measured_variance)


def test_kalman_step():
    assert exercises.check_kalman_step(step)
    assert exercises.check_kalman_step(lambda *a: np.array(step(*a)))


def test_zero_is_a_measurement():
    def not_measured(m, v, q, z, r):
        return (m, v + q) if not z else step(m, v, q, z, r)

    assert "is None" in exercises.check_kalman_step(not_measured).hint
    assert "mean, variance" in exercises.check_kalman_step(lambda *a: step(*a)[::-1]).hint
    missed = exercises.check_kalman_step(lambda m, v, q, z, r: None if z is None else step(m, v, q, z, r))
    assert "None, None) returns nothing" in missed.hint


def test_kalman_step_wrong():
    verdict = exercises.check_kalman_step(lambda m, v, q, z, r: step(m, v, 0.0, z, r))
    assert not verdict and "prediction" in verdict.hint

    def frozen(m, v, q, z, r):
        return (m, v) if z is None else step(m, v, q, z, r)

    assert "grows" in exercises.check_kalman_step(frozen).hint
    assert "None" in exercises.check_kalman_step(lambda m, v, q, z, r: fuse(m, v + q, z, r)).hint


# ------------------------------------------------------------------ measured, held, none
def statuses(seen, hold):
    words, missed = [], hold + 1
    for one in seen:
        missed = 0 if one else missed + 1
        words.append("measured" if one else "held" if missed <= hold else "none")
    return words


def test_statuses():
    assert exercises.check_statuses(statuses)
    assert exercises.check_statuses(lambda s, h: tuple(statuses(s, h)))
    assert exercises.check_statuses(lambda s, h: np.array(statuses(s, h)))


def test_statuses_wrong():
    def forever(seen, hold):
        return ["measured" if s else "held" if any(seen[:i]) else "none" for i, s in enumerate(seen)]

    assert "for ever" in exercises.check_statuses(forever).hint

    def from_nothing(seen, hold):
        words, missed = [], 0
        for one in seen:
            missed = 0 if one else missed + 1
            words.append("measured" if one else "held" if missed <= hold else "none")
        return words

    assert "before the first" in exercises.check_statuses(from_nothing).hint
    one_too_many = exercises.check_statuses(lambda s, h: statuses(s, h + 1))
    assert not one_too_many and "frame" in one_too_many.hint
    assert "only" in exercises.check_statuses(lambda s, h: ["kept"] * len(s)).hint
    assert "list" in exercises.check_statuses(lambda s, h: "measured").hint
    assert not exercises.check_statuses(lambda s, h: ["measured"])


def test_the_tracker_itself_gives_these_words():
    """The exercise is what `LaneTracker` does."""
    from lanelib.jointfit import UNKNOWN_ROAD, JointFit
    from lanelib.tracking import LaneTracker

    fit = JointFit(UNKNOWN_ROAD.mean, UNKNOWN_ROAD.covariance * 0.01, np.ones((2, 5)), 9.0, 1.2, 0.5)

    def by_tracker(seen, hold):
        tracker = LaneTracker(hold_frames=hold)
        return [tracker.update(fit if one else None, "missed").status for one in seen]

    assert exercises.check_statuses(by_tracker)


WAYS = {
    "average": [("1", 1.0, 0.8, 0.0), ("6", 4.0, 0.4, 0.1)],
    "kalman": [("1", 0.7, 0.16, 0.02), ("3", 1.2, 0.3, 0.03)],
}


def test_a_smoother_has_one_colour_and_a_crowded_one_a_window_where_each_setting_is_named():
    for a in n05.tradeoff(WAYS, colours=SMOOTHER_COLOURS, enlarged="kalman").axes:
        colours = {line.get_label(): line.get_color() for line in a.lines}
        assert colours == {name: SMOOTHER_COLOURS[name] for name in WAYS}
        (window,) = a.child_axes
        assert [text.get_text() for text in window.texts] == ["1", "3"]
        assert {text.get_color() for text in window.texts} == {SMOOTHER_COLOURS["kalman"]}
        inside = [window.viewLim.contains(*text.xy) for text in window.texts]
        assert all(inside) and "1" in [text.get_text() for text in a.texts]


def test_every_way_to_smooth_has_its_own_colour():
    assert set(SMOOTHING) < set(SMOOTHER_COLOURS)
    assert len(set(SMOOTHER_COLOURS.values())) == len(SMOOTHER_COLOURS)
    figure = figures.curves([0, 1], {"kalman": [1, 2], "truth": [1, 1], "more": [2, 2]}, truth="truth",
                            colours=SMOOTHER_COLOURS | {"truth": "#ff0000"})
    kalman, truth, _ = figure.axes[0].lines
    assert kalman.get_color() == SMOOTHER_COLOURS["kalman"] and truth.get_color() == PALETTE["truth"]


def test_bell_curves_are_fused_as_the_exercise_asks():
    measured = {"a": (0.24, 0.0025), "b": (0.30, 0.0009), "c": (0.1, 0.04)}
    mean, variance = fuse(*fuse(0.24, 0.0025, 0.30, 0.0009), 0.1, 0.04)
    last = n05.gaussians(measured, together="all", xlabel="m").axes[0].lines[-1]
    assert last.get_label() == f"all: {mean:.3f} ± {variance**0.5:.3f}"
    assert last.get_xdata()[np.argmax(last.get_ydata())] == pytest.approx(mean, abs=2e-3)
