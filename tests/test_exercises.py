"""Checkers: right answers and other right answers pass, typical wrong ones get the hint that fits, nothing raises.

One table a notebook: (checker, answer, None where it is right, else words that the hint must hold). Add yours below.
"""

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib import exercises
from lanelib.exercises import judges
from lanelib.exercises.judges import array, choice, first_failed, function, homography, mask, number
from lanelib.exercises.verdict import Verdict, not_yet, right

ANYTHING = [None, ..., 3, -1.5, math.nan, math.inf, "text", b"x", [], [1, [2]], {}, object(), np.zeros((2, 3)),
            np.zeros((4, 4), complex), np.array(["a"]), int, lambda: None, lambda *a: 1 / 0, True]
CHECKERS = [name for name in exercises.__all__ if name.startswith("check_")]


@pytest.mark.parametrize("name", CHECKERS)
def test_no_checker_raises_and_none_is_content_with_rubbish(name):
    checker = getattr(exercises, name)
    assert checker.__doc__, "say what is judged"
    for answer in ANYTHING:
        verdict = checker(answer)
        assert isinstance(verdict, Verdict)
        assert not verdict or isinstance(answer, int | float), f"{name} accepts {answer!r}"
        assert verdict or (verdict.hint and "\n" not in verdict.hint), f"{name} has no hint for {answer!r}"
    assert not checker(None) and not checker(...)



N00 = [
    ("offset_of", lambda left, right: -(left + right) / 2, None),
    ("offset_of", lambda left, right: np.float32(-0.5) * np.array([left + right]), None),
    ("offset_of", lambda left, right: 0 - np.mean([left, right]), None),
    ("offset_of", lambda left, right: (left + right) / 2, "sign is reversed"),
    ("offset_of", lambda left, right: -(left + right), "twice"),
    ("offset_of", lambda left, right: -(left + right) / 2 * 100, "100 times too large"),
    ("offset_of", lambda left, right: (left + right) / 2 * 1000, "1000 times too large"),
    ("offset_of", lambda left, right: print(end=""), "returns nothing"),
    ("offset_of", lambda left: left, "TypeError"),
    ("offset_of", lambda left, right: (left, right), "single number"),
    ("offset_of", -0.1, "a function is needed"),
    ("sideways_m", lambda r, y: y * y / 2 / r, None),
    ("sideways_m", lambda r, y: r - np.sqrt(r * r - y * y), None),  # the circle
    ("sideways_m", lambda r, y: y * y / r, "twice"),
    ("sideways_m", lambda r, y: -y * y / 2 / r, "sign is reversed"),
    ("sideways_m", lambda r, y: y * y / 2 / r / 1000, "1000 times too small"),
    ("offset_of", lambda left, right: right - left, "the lane's width"),
    ("offset_of", lambda left, right: (right - left) / 2, "half the lane's width"),
    ("offset_of", lambda left, right: -left, "how far away the left line is"),
    ("sideways_m", lambda r, y: 2 * r / y**2, "one divided by"),
    ("sideways_m", lambda r, y: round(y * y / 2 / r, 2), None),
    ("sideways_m", lambda r, y: y**2 / 2 * r, "brackets"),
    ("sideways_m", lambda r, y: math.sqrt(r * r - y * y), "from its centre"),
    ("sideways_m", lambda r, y: 1 / (2 * r), "A alone"),
    ("sideways_m", lambda r, y: y / (2 * r), "as its square"),
    ("seconds_to_line", lambda g, a, v: g / (math.tan(math.radians(a)) * v / 3.6), None),  # nearly the same
    ("seconds_to_line", lambda g, a, v: round(g / (math.sin(math.radians(a)) * v / 3.6), 1), None),
    ("seconds_to_line", lambda g, a, v: g / (math.sin(math.radians(a)) * v / 3.6) + 0.1, ""),
    ("seconds_to_line", lambda g, a, v: g / (math.sin(a) * v / 3.6), "radians"),
    ("seconds_to_line", lambda g, a, v: g / (math.sin(math.radians(a)) * v), "km/h"),
    ("seconds_to_line", lambda g, a, v: g / (v / 3.6), "along the road"),
    ("seconds_to_line", lambda g, a, v: g / (a * v / 3.6), "degrees are no sine"),
    ("seconds_to_line", lambda g, a, v: math.sin(math.radians(a)) * v / 3.6, "the speed across"),
    ("seconds_to_line", lambda g, a, v: g / math.sin(math.radians(a)), "metres along"),
]


@pytest.mark.parametrize(("name", "answer", "hint"), N00)
def test_notebook_00(name, answer, hint):
    judged(name, answer, hint)


def judged(name, answer, hint):
    """For the table of every notebook: right where ``hint`` is None, else wrong with these words in the hint."""
    verdict = getattr(exercises, f"check_{name}")(answer)
    assert bool(verdict) == (hint is None), verdict
    if hint is not None:
        assert hint in verdict.hint, verdict


# --------------------------------------------------------------------------------------------------- the judges
def test_a_verdict_says_the_same_in_words_and_in_colour():
    assert repr(right()) == "✓ Right." and repr(not_yet("a <b>\n c")) == "✗ Not yet: a <b> c"
    assert right() and not not_yet("x")
    assert "&lt;b&gt;" in not_yet("<b>")._repr_html_() and "✗" in not_yet("<b>")._repr_html_()


@pytest.mark.parametrize("value", [2.5, np.float64(2.5), np.array(2.5), np.array([[2.5]]), 2.51, np.float32(2.49),
                                   Fraction(5, 2), Decimal("2.5")])
def test_a_number_may_come_in_many_forms(value):
    assert number(value, 2.5)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.01, 1e5), st.booleans(), st.sampled_from([1000, 1e-3, 100, 0.01, 180 / math.pi, math.pi / 180, 3.6]))
def test_units_and_signs_are_told_apart_at_every_size(size, negative, factor):
    expected = -size if negative else size
    assert number(expected, expected)
    assert number(expected * 1.009, expected) and not number(expected * 1.011, expected)
    assert "times too" in number(expected * factor, expected).hint
    assert "sign" not in number(expected * factor, expected).hint
    assert "sign is reversed" in number(-expected, expected).hint
    both = number(-expected * factor, expected).hint
    assert "times too" in both and "sign is reversed" in both
    percent = number(expected * 1.25, expected).hint
    assert "25 % too large" in percent or "one divided by" in percent and abs(1.25 * size**2 - 1) < 0.05


def test_a_number_near_zero_is_judged_by_its_tolerance():
    assert number(0.004, 0.0, tolerance=0.005) and number(-0.004, 0.0, tolerance=0.005)
    assert "too large" in number(0.006, 0.0, tolerance=0.005).hint
    assert number(math.inf, math.inf) and not number(1e9, math.inf)
    assert "divided by zero" in number(math.nan, 1.0).hint


def test_known_mistakes_come_first():
    assert "y in pixels" in number(20.0, 10.0, mistakes={"y in pixels": 20.0}).hint


def test_a_factor_of_chance_is_no_speed():
    assert "km/h" in number(36.0, 10.0, unit="m/s").hint
    assert "km/h" not in number(36.0, 10.0, unit="m").hint


def test_known_mistakes_may_have_any_shape_and_never_hide_a_right_answer():
    mistakes = {"the mean alone": 1.0, "the same": [1.0, 2.0]}
    assert array([1.0, 2.0], [1.0, 2.0], mistakes=mistakes)
    assert array(1.0, [1.0, 2.0], mistakes=mistakes).hint == "the mean alone"
    assert "2 numbers are needed" in array(3.0, [1.0, 2.0], mistakes=mistakes).hint


def test_a_generator_and_a_none_among_numbers_are_told_in_words():
    assert "generator; make a list" in array((x for x in (1.0, 2.0)), [1.0, 2.0]).hint
    assert "None among them" in array([None, 2.0], [1.0, 2.0]).hint


def test_slips_are_told_by_the_case_in_which_they_show():
    slips = {"the square is missing": lambda x: x}
    verdict = function(lambda x: x, [((1.0,), 1.0), ((3.0,), 9.0)], number, slips=slips)
    assert not verdict and verdict.hint.endswith("the square is missing") and "(3.0)" in verdict.hint


A = np.array([[1.0, 5.0], [2.0, 7.0], [4.0, 9.0]])


@pytest.mark.parametrize(
    ("answer", "hint"),
    [
        (A, None),
        (A.tolist(), None),
        (A * 1.005, None),
        (A.T, "transposed"),
        (A.ravel(), "reshape"),
        (A[:, ::-1], "x, y is wanted"),
        (A[::-1], "reversed order"),
        (-A, "signs are reversed"),
        (A * 1000, "1000 times too large"),
        (A * 1.3, "1.3 times"),
        (A + 0.5, "shifted by 0.5"),
        (np.where(A == 7, 8, A), "83% of the values"),
        (np.full_like(A, np.nan), "NaN"),
        ([[1, 2], [3]], "unequal"),
        (lambda: A, "call it"),
    ],
)
def test_array(answer, hint):
    verdict = array(answer, A, columns="x, y", unit="m")
    assert bool(verdict) == (hint is None), verdict
    assert hint is None or hint in verdict.hint, verdict


def test_array_of_a_picture():
    picture = np.random.default_rng(0).integers(0, 256, (4, 6, 3), np.uint8)
    assert array(picture, picture, dtype=np.uint8)
    assert "dtype uint8" in array(picture / 255, picture, dtype=np.uint8).hint
    assert "width and height" in array(picture.swapaxes(0, 1), picture).hint
    assert "channel" in array(picture[..., 0], picture).hint
    assert "order of the last axis" in array(picture[..., ::-1], picture).hint


M = np.zeros((6, 8), bool)
M[2:5, 1:7] = True


@pytest.mark.parametrize(
    ("answer", "hint"),
    [
        (M, None),
        (M.astype(np.uint8), None),
        (M.astype(np.uint8) * 255, None),
        (M * 1.0, None),
        (~M, "inverted"),
        (M.T, "transposed"),
        (np.zeros_like(M), "no pixel"),
        (np.ones_like(M), "every pixel"),
        (np.arange(48).reshape(6, 8), "two values"),
        (np.roll(M, 1, axis=1), "overlap"),
    ],
)
def test_mask(answer, hint):
    verdict = mask(answer, M)
    assert bool(verdict) == (hint is None), verdict
    assert hint is None or hint in verdict.hint, verdict
    if hint is None and np.max(answer) == 1 and np.asarray(answer).dtype != bool:
        assert "black" in verdict.hint


def test_homography_is_judged_by_what_it_does():
    h = np.array([[2.0, 0.3, 5], [0.1, 3, -2], [1e-3, 2e-3, 1]])
    points = np.array([[0, 0], [10, 0], [10, 20], [0, 20.0]])
    moved = np.column_stack([points, np.ones(4)]) @ h.T
    target = moved[:, :2] / moved[:, 2:]
    judge = lambda answer: homography(answer, points, target, tolerance=0.01, names=("picture", "road"))  # noqa: E731
    assert judge(h) and judge(-7 * h) and judge(h.tolist())
    assert "road to picture" in judge(np.linalg.inv(h)).hint
    assert "transposed" in judge(h.T).hint and "swapped" in judge(h[[1, 0, 2]]).hint
    assert "cannot be inverted" in judge(np.ones((3, 3))).hint and "shape (3, 3)" in judge(np.eye(4)).hint
    assert "from where it belongs" in judge(h + np.diag([0, 0.5, 0])).hint


def test_choice():
    judge = lambda answer: choice(answer, "left", among=("left", "right"), hints={"right": "sign?"})  # noqa: E731
    assert judge(" LEFT ") and judge("right").hint == "sign?" and "one of" in judge("up").hint and not judge(1)


def test_a_function_that_changes_its_argument_is_told():
    def doubles(values):
        values *= 2
        return values

    case = [((np.ones(3),), np.full(3, 2.0))]
    assert "changes its argument" in function(doubles, case, array).hint
    assert function(lambda v: v * 2, case, array) and (case[0][0][0] == 1).all()


def test_a_function_is_judged_on_every_case():
    cases = [((1.0,), 1.0), ((4.0,), 2.0)]
    assert function(math.sqrt, cases, number)
    assert "(4.0)" in function(lambda v: v, cases, number).hint


def test_first_failed_asks_no_further():
    asked = []
    assert not first_failed(right(), not_yet("here"), lambda: asked.append(1))
    assert asked == [] and first_failed(right(), lambda: right("end")).hint == "end"


def test_a_checker_that_fails_itself_answers_with_a_hint():
    @judges.never_raises
    def check(answer):
        return answer.no_such_thing

    assert "could not be judged" in check(3).hint
