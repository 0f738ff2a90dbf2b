"""The checkers of notebook 04: right answers, other right answers, and wrong ones with the hint they must give."""

import numpy as np
import pytest

from lanelib import exercises


def test_nothing_there_yet():
    for name in ("start_columns", "bend_in_metres", "curvature_of_lane", "fit_shared", "offset_and_width"):
        check = getattr(exercises, f"check_{name}")
        assert not check(...) and not check(None) and not check(3), name
        assert "nothing" in check(lambda *_: None).hint, name


# ------------------------------------------------------------------ where to begin
def argmax(sums, centre):
    return int(np.argmax(sums[:centre])), centre + int(np.argmax(sums[centre:]))


def test_start_columns():
    assert exercises.check_start_columns(argmax)
    smooth = np.ones(5) / 5
    assert exercises.check_start_columns(lambda s, c: list(argmax(np.convolve(s, smooth, "same"), c)))
    assert "order" in exercises.check_start_columns(lambda s, c: argmax(s, c)[::-1]).hint
    counted = exercises.check_start_columns(lambda s, c: (int(np.argmax(s[:c])), int(np.argmax(s[c:]))))
    assert not counted and "centre" in counted.hint
    middle = exercises.check_start_columns(lambda s, c: argmax(s, len(s) // 2))
    assert not middle and "split it at `centre`" in middle.hint
    first = exercises.check_start_columns(lambda s, c: (np.flatnonzero(s)[0], c + np.flatnonzero(s[c:])[0]))
    assert not first and "the highest are asked for" in first.hint
    heights = exercises.check_start_columns(lambda s, c: (s[:c].max(), s[c:].max()))
    assert not heights and "heights of the peaks" in heights.hint


# ------------------------------------------------------------------ units
@pytest.mark.parametrize(("wrong", "hint"), [
    (lambda a, sx, sy: a, "pixels"),
    (lambda a, sx, sy: a * sx * sy**2, "divide"),
    (lambda a, sx, sy: a * sx / sy, "squared"),
    (lambda a, sx, sy: a / sy**2, "missing"),
    (lambda a, sx, sy: a * sy**2 / sx, "inverse"),
    (lambda a, sx, sy: -a * sx / sy**2, "sign"),
])
def test_bend_in_metres(wrong, hint):
    assert exercises.check_bend_in_metres(lambda a, sx, sy: a * sx / sy**2)
    verdict = exercises.check_bend_in_metres(wrong)
    assert not verdict and hint in verdict.hint


def test_bend_in_metres_agrees_with_a_fit():
    sx, sy, a = 0.02, 0.05, 3e-4
    v = np.arange(0, 700, 50.0)
    bend = np.polyfit(30 - sy * v, -6 + sx * (a * v * v - 0.1 * v + 200), 2)[0]
    assert bend == pytest.approx(a * sx / sy**2)


# ------------------------------------------------------------------ curvature
def mean_curvature(left, right):
    return sum(-2 * a / (1 + b * b) ** 1.5 for a, b, _ in (left, right)) / 2


def mean_radius(left, right):
    radius = sum((1 + b * b) ** 1.5 / abs(2 * a) for a, b, _ in (left, right)) / 2
    return -np.sign(left[0]) / radius


@pytest.mark.parametrize(("wrong", "hint"), [
    (mean_radius, "radii averaged"),
    (lambda left, right: -mean_curvature(left, right), "sign"),
    (lambda left, right: -(left[0] + right[0]), "slope"),
    (lambda left, right: mean_curvature(left, right) / 2, "2 A"),
    (lambda left, right: 2 * mean_curvature(left, right), "mean"),
    (lambda left, right: 1 / mean_curvature(left, right), "radius"),
])
def test_curvature_of_lane(wrong, hint):
    assert exercises.check_curvature_of_lane(mean_curvature)
    assert exercises.check_curvature_of_lane(lambda left, right: np.float32(mean_curvature(left, right)))
    verdict = exercises.check_curvature_of_lane(wrong)
    assert not verdict and hint in verdict.hint, verdict


# ------------------------------------------------------------------ offset and width
def offset_width(left, right):
    slope = (left[1] + right[1]) / 2
    return -(left[2] + right[2]) / 2, (right[2] - left[2]) / np.hypot(1, slope)


def test_offset_and_width():
    assert exercises.check_offset_and_width(offset_width)
    along_x = exercises.check_offset_and_width(lambda le, ri: (-(le[2] + ri[2]) / 2, ri[2] - le[2]))
    assert not along_x and "oblique" in along_x.hint
    mirrored = exercises.check_offset_and_width(lambda le, ri: (-offset_width(le, ri)[0], offset_width(le, ri)[1]))
    assert not mirrored and "right of the centre" in mirrored.hint


# ------------------------------------------------------------------ one lane
def shared(left_xy, right_xy):
    rows = [np.column_stack([np.ones(len(p)), p[:, 1], p[:, 1] ** 2, np.full(len(p), s / 2)])
            for s, p in ((-1, left_xy), (1, right_xy))]
    return np.linalg.lstsq(np.vstack(rows), np.concatenate([left_xy[:, 0], right_xy[:, 0]]), rcond=None)[0]


def by_differences(left_xy, right_xy):
    """Another right way: the line with more points tells the bend, the other one the width."""
    more, fewer = (left_xy, right_xy) if len(left_xy) >= len(right_xy) else (right_xy, left_xy)
    bend, heading, at_car = np.polyfit(more[:, 1], more[:, 0], 2)
    apart = np.mean(fewer[:, 0] - np.polyval([bend, heading, at_car], fewer[:, 1]))
    return at_car + apart / 2, heading, bend, abs(apart)


def test_fit_shared():
    assert exercises.check_fit_shared(shared)
    assert exercises.check_fit_shared(by_differences)


def test_fit_shared_wrong():
    def left_line(left_xy, right_xy):
        centre, heading, bend, width = shared(left_xy, right_xy)
        return centre - width / 2, heading, bend, width

    verdict = exercises.check_fit_shared(left_line)
    assert not verdict and "left line" in verdict.hint

    def apart(left_xy, right_xy):  # two parabolas: three points at one dash tell nothing of the bend with noise
        left, right = (np.polyfit(p[:, 1], p[:, 0], 1) for p in (left_xy, right_xy))
        return (left[1] + right[1]) / 2, (left[0] + right[0]) / 2, 0.0, right[1] - left[1]

    assert not exercises.check_fit_shared(apart)

    def two_parabolas(left_xy, right_xy):  # right without noise: three points decide on a parabola
        left, right = (np.polyfit(p[:, 1], p[:, 0], 2) for p in (left_xy, right_xy))
        return (left[2] + right[2]) / 2, (left[1] + right[1]) / 2, (left[0] + right[0]) / 2, right[2] - left[2]

    assert "one matrix" in exercises.check_fit_shared(two_parabolas).hint

    def half_width(left_xy, right_xy):
        return shared(left_xy, right_xy) * [1, 1, 1, 0.5]

    assert "half of what" in exercises.check_fit_shared(half_width).hint
    assert "shape" in exercises.check_fit_shared(lambda *_: np.zeros(3)).hint


# ------------------------------------------------------------------ mistakes that are told by their value
@pytest.mark.parametrize(("name", "wrong", "hint"), [
    ("curvature_of_lane", lambda left, right: -2 * left[0] / (1 + left[1] ** 2) ** 1.5, "the left line's"),
    ("curvature_of_lane", lambda left, right: -sum(a / (1 + b * b) ** 0.5 for a, b, _ in (left, right)), "has 1/2"),
    ("curvature_of_lane", lambda left, right: -sum(a / (1 + b * b) ** 3 / 2 for a, b, _ in (left, right)), "(3 / 2)"),
    ("curvature_of_lane", lambda left, right: -sum(a / (1 + c * c) ** 1.5 for a, _, c in (left, right)), "uses C"),
    ("curvature_of_lane", lambda left, right: -sum(c / (1 + b * b) ** 1.5 for _, b, c in (left, right)), "C for A"),
    ("offset_and_width", lambda left, right: (-(left[0] + right[0]) / 2, right[0] - left[0]), "at y = 0"),
    ("offset_and_width", lambda left, right: (-(left[2] + right[2]), right[2] - left[2]), "twice"),
    ("offset_and_width", lambda left, right: (-(left[2] + right[2]) / 2, left[2] - right[2]), "negative"),
    ("offset_and_width",
     lambda left, right: (-(left[2] + right[2]) / 2, (right[2] - left[2]) / (1 + left[1] ** 2)), "the root of"),
    ("bend_in_metres", lambda a, sx, sy: a * sx, "the rows' scale is missing"),
])
def test_hints_by_value(name, wrong, hint):
    verdict = getattr(exercises, f"check_{name}")(wrong)
    assert not verdict and hint in verdict.hint, verdict


def everything(left_xy, right_xy):
    rows = [np.column_stack([np.ones(len(xy)), xy[:, 1], xy[:, 1] ** 2, np.full(len(xy), side / 2)])
            for side, xy in ((-1, left_xy), (1, right_xy))]
    return np.linalg.lstsq(np.vstack(rows), np.concatenate([left_xy[:, 0], right_xy[:, 0]]), rcond=None)


@pytest.mark.parametrize(("change", "hint"), [
    ([1, 1, 1, -1], "the width's sign"), ([1, 1, -2, 1], "this is the curvature"), ([1, 1, 2, 1], "twice the bend"),
    ([1, -1, 1, 1], "the heading's sign"),
])
def test_a_shared_fit_is_judged_number_by_number(change, hint):
    assert exercises.check_fit_shared(lambda left, right: everything(left, right)[0])
    assert hint in exercises.check_fit_shared(lambda left, right: everything(left, right)[0] * change).hint
    assert "four things" in exercises.check_fit_shared(everything).hint
    second = exercises.check_fit_shared(lambda left, right: everything(left, right)[0][[0, 3, 1, 2]])
    assert "came out second" in second.hint
