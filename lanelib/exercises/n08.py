"""Checkers of notebook 08."""

from __future__ import annotations

from collections.abc import Mapping

from lanelib.exercises.judges import choice, first_failed, function, missing, never_raises, not_yet, number, right

CAUSES = ("height", "pitch", "yaw", "focal length")


@never_raises
def check_square_px(answer):
    """Side of a square in pixels of a page printed at so many dots an inch; whole or not."""
    mistakes = {
        "an inch has 25.4 mm, and dpi counts dots an inch": 25 * 300,
        "the other way round: dots = millimetres / 25.4 * dpi": 25.4 / 25 * 300,
        "an inch has 25.4 mm, not 2.54: that is cm": 25 / 2.54 * 300,
    }

    def judge(value, expected):
        return number(value, expected, unit="px", rel=1e-9, tolerance=0.51, mistakes=mistakes if expected < 300 else {})

    return function(answer, [((25, 300), 25 / 25.4 * 300), ((30, 600), 30 / 25.4 * 600)], judge)


@never_raises
def check_diagnosis(answer):
    """{"a" … "d": cause} for four symptoms."""
    if (verdict := missing(answer)) is not None:
        return verdict
    if not isinstance(answer, Mapping):
        return not_yet(f"a dictionary with a, b, c, d is needed, found {type(answer).__name__}")
    if absent := [key for key in "abcd" if key not in answer]:
        return not_yet(f"{', '.join(absent)} not there yet")
    hints = {
        "a": {"focal length": "then the width would be right: it is set by the lane itself",
              "pitch": "then the lines would not stay parallel"},
        "b": {"height": "a wrong height scales everything alike; these lines do not stay parallel",
              "yaw": "a wrong yaw turns both lines the same way"},
        "c": {"height": "then the width would be wrong, too", "pitch": "then the lines would spread or close"},
        "d": {"pitch": "a wrong pitch moves the two lines in opposite directions"},
    }  # fmt: skip
    wanted = {"a": "height", "b": "pitch", "c": "focal length", "d": "yaw"}

    def one(key: str):
        verdict = choice(answer[key], wanted[key], among=CAUSES, hints=hints[key])
        return verdict if verdict else not_yet(f"{key}: {verdict.hint}")

    return first_failed(*(one(key) for key in "abcd"), right())


@never_raises
def check_zoomed_focal(answer):
    """Focal length in pixels after the middle share of the frame was enlarged to the old size."""
    mistakes = {
        "smaller? what is enlarged has more pixels for the same angle": 1155 * 0.8,
        "an area has two sides; the focal length goes with one of them": 1155 / 0.64,
    }

    def judge(value, expected):
        return number(value, expected, unit="px", rel=1e-6, mistakes=mistakes if abs(expected - 1443.75) < 1e-6 else {})

    return function(answer, [((1155.0, 0.8), 1155 / 0.8), ((900.0, 0.5), 1800.0), ((640.0, 1.0), 640.0)], judge)
