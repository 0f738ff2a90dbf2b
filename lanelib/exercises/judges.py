"""The judges from which every checker is made.

A judge compares one answer with what is expected and returns a `Verdict`. It tells apart, in this order: nothing there
(None, `...`), the wrong type, the wrong shape, not finite, right, the wrong sign, the wrong unit, the wrong value.

    number      a single number with a unit
    array       an array, list or table of numbers
    mask        which pixels; bool, 0/1 and 0/255 are all right
    homography  a 3x3 matrix, judged by where it takes points, not by its entries
    choice      one of several words
    function    a function, called on several cases, each judged by one of the above
    first_failed  several verdicts in one

A notebook's checker is then three lines::

    @never_raises
    def check_offset_of(answer):
        return function(answer, [((-1.8, 1.9), -0.05), ((-2.0, 1.6), 0.2)], number, unit="m", sign="right is positive")
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from lanelib.exercises.numbers import array, as_array, missing, number, shape_hint
from lanelib.exercises.verdict import Verdict, never_raises, not_yet, right, said_by

__all__ = [
    "array",
    "choice",
    "first_failed",
    "function",
    "homography",
    "mask",
    "missing",
    "never_raises",
    "not_yet",
    "number",
    "right",
]


def mask(answer, expected, *, least: float = 0.95) -> Verdict:
    """Which pixels: bool, 0/1 or 0/255, whose overlap with ``expected`` (intersection over union) is ``least``."""
    if (verdict := missing(answer)) is not None:
        return verdict
    values, expected = as_array(answer, None), np.asarray(expected) != 0
    if isinstance(values, Verdict):
        return values
    if values.shape != expected.shape:
        return not_yet(shape_hint(values.shape, expected.shape))
    levels = np.unique(values)
    if len(levels) > 2:
        return not_yet(f"a mask has two values, found {len(levels)}; compare with a threshold")
    found = values != 0
    overlap = _overlap(found, expected)
    if overlap >= least:
        dark = values.dtype != bool and levels.max() == 1
        return right("0/1 looks black as a picture; multiply by 255 to see it" if dark else "")
    if not found.any() or found.all():
        return not_yet(f"{'no' if not found.any() else 'every'} pixel is set; look at the range of your values first")
    if _overlap(~found, expected) >= least:
        return not_yet("inverted: what should be set is not, and the other way round")
    more = "too many" if found.sum() > expected.sum() else "too few"
    return not_yet(f"the overlap with the right mask is {overlap:.2f}, {least} is needed; {more} pixels are set")


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    union = (one | other).sum()
    return float((one & other).sum() / union) if union else 1.0


def homography(answer, points, expected, *, tolerance: float, unit: str = "m", names=("from", "to")) -> Verdict:
    """A 3x3 matrix of any scale that takes ``points`` (N, 2) to ``expected`` (N, 2), largest miss ``tolerance``."""
    if (verdict := missing(answer)) is not None:
        return verdict
    values = as_array(answer, None)
    if isinstance(values, Verdict):
        return values
    if values.shape != (3, 3):
        return not_yet(shape_hint(values.shape, (3, 3)))
    matrix = values.astype(float)
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-30:
        return not_yet("the matrix cannot be inverted; are three of the points on one line?")
    points, expected = np.asarray(points, float), np.asarray(expected, float)
    miss = _miss(matrix, points, expected)
    if miss <= tolerance:
        return right()
    if _miss(np.linalg.inv(matrix), points, expected) <= tolerance:
        return not_yet(f"the other direction: this goes {names[1]} to {names[0]}; swap the points, or invert it")
    if _miss(matrix.T, points, expected) <= tolerance:
        return not_yet("transposed: points are columns, so it is H @ point")
    if _miss(matrix[[1, 0, 2]], points, expected) <= tolerance:
        return not_yet("x and y of what comes out are swapped")
    return not_yet(f"a point lands {miss:.3g} {unit} from where it belongs, {tolerance:g} {unit} are allowed")


def _miss(matrix: np.ndarray, points: np.ndarray, expected: np.ndarray) -> float:
    with np.errstate(all="ignore"):
        moved = np.column_stack([points, np.ones(len(points))]) @ matrix.T
        error = np.linalg.norm(moved[:, :2] / moved[:, 2:] - expected, axis=1).max()
    return float(error) if np.isfinite(error) else math.inf


def choice(
    answer, expected: str, *, among: Sequence[str], hints: Mapping[str, str] | None = None, said: str = ""
) -> Verdict:
    """One of several words, in any case, "a_b" as "a b", "(a)" as "a"; ``hints``: what to say to a wrong one."""
    if (verdict := missing(answer)) is not None:
        return verdict
    if not isinstance(answer, str):
        return not_yet(f"one of {', '.join(map(repr, among))} is needed, found {type(answer).__name__}")
    word = _plain(answer)
    if word == _plain(expected):
        return right(said)
    if word not in map(_plain, among):
        return not_yet(f"one of {', '.join(map(repr, among))} is needed, found {answer!r}")
    return not_yet({_plain(k): v for k, v in (hints or {}).items()}.get(word, "look at the figure above again"))


def _plain(word: str) -> str:
    return word.strip(" \t\n().:").lower().replace("_", " ")


def function(
    answer, cases, judge: Callable[..., Verdict], *, slips: Mapping[str, Callable] | None = None, **options
) -> Verdict:
    """A function: ``cases`` are (arguments, expected), and each result is judged by ``judge`` with ``options``.

    ``slips``: {hint: the function with this mistake in it}, from which the ``mistakes`` of each case are made.

    Told apart besides: not a function, an exception, arguments changed in place.
    """
    if (verdict := missing(answer)) is not None:
        return verdict
    if not callable(answer):
        return not_yet(f"a function is needed, found {type(answer).__name__}; leave out the brackets")
    verdict = right()
    for i, (arguments, expected) in enumerate(cases):
        given = [one.copy() if isinstance(one, np.ndarray) else one for one in arguments]
        try:
            result = answer(*given)
        except Exception as error:
            return not_yet(f"{_call(answer, arguments)} raised {said_by(error)}")
        if any(isinstance(a, np.ndarray) and not np.array_equal(a, b) for a, b in zip(arguments, given, strict=True)):
            return not_yet("your function changes its argument; work on a copy, or make a new array")
        if result is None or result is Ellipsis:
            if i:  # it has answered before
                return not_yet(f"{_call(answer, arguments)} returns nothing; every way through it needs a `return`")
            return not_yet("the function returns nothing so far; write its body, and `return` the result")
        if slips:
            options["mistakes"] = {hint: slip(*arguments) for hint, slip in slips.items()}
        verdict = judge(result, expected, **options)
        if not verdict:
            return not_yet(f"{_call(answer, arguments)}: {verdict.hint}")
    return verdict


def _call(answer, arguments) -> str:
    """How the function was called, short."""
    texts = [
        f"array {one.shape}" if isinstance(one, np.ndarray) and one.size > 4 else _short(repr(one))
        for one in arguments
    ]
    return f"{getattr(answer, '__name__', 'your function')}({', '.join(texts)})"


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:12].split("(")[0] + "…"


def first_failed(*verdicts: Verdict | Callable[[], Verdict]) -> Verdict:
    """The first verdict that is not right, else the last one; later ones given as functions are then not asked."""
    verdict = right()
    for one in verdicts:
        verdict = one() if callable(one) else one
        if not verdict:
            return verdict
    return verdict
