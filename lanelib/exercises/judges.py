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

from lanelib.exercises.verdict import Verdict, _said, never_raises, not_yet, right

__all__ = [
    "array", "choice", "first_failed", "function", "homography", "mask", "missing", "never_raises", "not_yet", "number",
    "right",
]  # fmt: skip

# A wrong unit shows as a factor. What is told needs not be exact: the factor must be within 2 %.
FACTOR_TOLERANCE = 0.02
FACTORS = {
    1000.0: "1000 times too large: metres where kilometres are wanted, or millimetres where metres are?",
    1 / 1000: "1000 times too small: kilometres where metres are wanted, or metres where millimetres are?",
    100.0: "100 times too large: centimetres where metres are wanted, or per cent where a share is?",
    1 / 100: "100 times too small: metres where centimetres are wanted, or a share where per cent is?",
    180 / math.pi: "57.3 times too large: degrees where radians are wanted?",
    math.pi / 180: "57.3 times too small: radians where degrees are wanted?",
    3.6: "3.6 times too large: km/h where m/s is wanted?",
    1 / 3.6: "3.6 times too small: m/s where km/h is wanted?",
    2.0: "twice what it should be",
    0.5: "half of what it should be",
}


def missing(answer) -> Verdict | None:
    """The verdict on an answer that is not there; None where there is one."""
    if answer is Ellipsis:
        return not_yet("nothing here so far; replace the `...` by your code")
    if answer is None:
        return not_yet("the answer is None; does your function `return` its result?")
    return None


def number(
    answer,
    expected: float,
    *,
    unit: str = "",
    rel: float = 0.01,
    tolerance: float = 0.0,
    sign: str = "",
    mistakes: Mapping[str, float] | None = None,
    said: str = "",
) -> Verdict:
    """A single number, within ``rel`` of ``expected`` or within ``tolerance`` (in its unit), whichever is more.

    ``sign``: the convention, told where the sign is reversed. ``mistakes``: {hint: value that this mistake gives}.
    ``said``: told where the answer is right.
    """
    if verdict := missing(answer):
        return verdict
    value = _as_number(answer)
    if isinstance(value, Verdict):
        return value
    if _close(value, expected, rel, tolerance):
        return right(said)
    if not math.isfinite(value):
        return not_yet(f"a finite number is needed, found {value}; is something divided by zero?")
    return not_yet(_why(value, expected, unit, rel, tolerance, sign, mistakes or {}))


def _as_number(answer) -> float | Verdict:
    """The answer as a float: Python's and numpy's numbers, arrays of one element."""
    if callable(answer):
        return not_yet("a number is needed, found a function; call it")
    if isinstance(answer, str | bytes | dict):
        return not_yet(f"a number is needed, found {type(answer).__name__} {answer!r:.40}")
    try:
        values = np.asarray(answer)
    except ValueError:
        return not_yet(f"a number is needed, found a {type(answer).__name__} of unequal parts")
    if values.size != 1:
        return not_yet(f"a single number is needed, found {values.size} of shape {values.shape}")
    if values.dtype.kind not in "iuf":
        return not_yet(f"a number is needed, found {type(answer).__name__}")
    return float(values.reshape(())) if values.ndim == 0 else float(values.ravel()[0])


def _close(value: float, expected: float, rel: float, tolerance: float) -> bool:
    if math.isinf(expected) or math.isinf(value):
        return value == expected
    return abs(value - expected) <= max(tolerance, rel * abs(expected))


def _why(value: float, expected: float, unit: str, rel: float, tolerance: float, sign: str, mistakes) -> str:
    """The hint for a number that is not right."""
    shown = f"{value:.4g}{' ' + unit if unit else ''}"
    for hint, wrong in mistakes.items():
        if _close(value, wrong, min(rel, 0.01), tolerance / 10):
            return f"{shown}: {hint}"
    if _close(-value, expected, rel, tolerance):
        return f"{shown}: the size is right, the sign is reversed{f'; {sign}' if sign else ''}"
    if expected and value and math.isfinite(expected):
        ratio = value / expected
        if (hint := _factor(ratio)) is not None:
            return f"{shown}: {hint}"
        if _factor(-ratio) is not None:
            return f"{shown}: {_factor(-ratio)}, and the sign is reversed{f'; {sign}' if sign else ''}"
        if abs(value * expected - 1) < FACTOR_TOLERANCE:
            return f"{shown}: this is one divided by the right answer"
        if ratio > 0:
            much = f"{ratio:.3g} times" if ratio > 2 else f"{100 * (ratio - 1):.2g} %"
            less = f"{1 / ratio:.3g} times" if ratio < 0.5 else f"{100 * (1 - ratio):.2g} %"
            return f"{shown}: {much} too large" if ratio > 1 else f"{shown}: {less} too small"
    return f"{shown}: {'too large' if value > expected else 'too small'}{' (or of the wrong sign)' if value else ''}"


def _factor(ratio: float) -> str | None:
    if not (ratio > 0 and math.isfinite(ratio)):
        return None
    return next((hint for factor, hint in FACTORS.items() if abs(ratio / factor - 1) < FACTOR_TOLERANCE), None)


def array(
    answer,
    expected,
    *,
    unit: str = "",
    rel: float = 0.01,
    tolerance: float = 0.0,
    share: float = 1.0,
    sign: str = "",
    columns: str = "",
    dtype=None,
) -> Verdict:
    """Numbers in an array (a list will do), each as `number`; at least ``share`` of them must be right.

    ``columns``: what the last axis is, "x, y"; told where it is swapped. ``dtype``: where it matters (np.uint8).
    """
    if verdict := missing(answer):
        return verdict
    values = _as_array(answer, dtype)
    if isinstance(values, Verdict):
        return values
    expected = np.asarray(expected)
    if values.shape != expected.shape:
        return not_yet(_shape(values.shape, expected.shape))
    wanted, got = expected.astype(float), values.astype(float)
    if np.isnan(got[np.isfinite(wanted)]).any():
        return not_yet("some values are NaN; is something divided by zero?")

    def good(v):
        return np.isclose(v, wanted, rtol=rel, atol=tolerance, equal_nan=True)

    if good(got).mean() >= share:
        return right()
    if good(-got).mean() >= share:
        return not_yet(f"the sizes are right, the signs are reversed{f'; {sign}' if sign else ''}")
    if got.ndim and got.shape[-1] in (2, 3) and good(got[..., ::-1]).mean() >= share:
        return not_yet(f"the order of the last axis is reversed{f'; {columns} is wanted' if columns else ''}")
    if got.ndim and good(got[::-1]).mean() >= share:
        return not_yet("the values are right, in reversed order")
    use = np.isfinite(wanted) & np.isfinite(got) & (np.abs(wanted) > max(tolerance, 1e-12))
    ratio = np.median(got[use] / wanted[use]) if use.any() else np.nan
    if np.isfinite(ratio) and ratio and abs(ratio - 1) > FACTOR_TOLERANCE and good(got / ratio).mean() >= share:
        hint = _factor(ratio) or (f"all values are {ratio:.3g} times what they should be")
        return not_yet(f"{hint}{f' (unit: {unit})' if unit else ''}")
    shift = np.median((got - wanted)[use]) if use.any() else np.nan
    if np.isfinite(shift) and good(got - shift).mean() >= share:
        return not_yet(f"all values are shifted by {shift:.4g}{' ' + unit if unit else ''}")
    bad = np.unravel_index(int(np.argmin(good(got))), got.shape)
    where = f" (the first wrong one, at {tuple(map(int, bad))}, is {got[bad]:.4g}{' ' + unit if unit else ''})"
    return not_yet(f"{good(got).mean():.0%} of the values are right{where}")


def _as_array(answer, dtype) -> np.ndarray | Verdict:
    if callable(answer):
        return not_yet("an array is needed, found a function; call it")
    if isinstance(answer, str | bytes | dict):
        return not_yet(f"an array is needed, found {type(answer).__name__}")
    try:
        values = np.asarray(answer)
    except ValueError:
        return not_yet(f"an array is needed, found a {type(answer).__name__} of unequal parts")
    if values.dtype.kind not in "iufb":
        return not_yet(f"an array of numbers is needed, found elements of type {values.dtype}")
    if dtype is not None and values.dtype != np.dtype(dtype):
        return not_yet(f"dtype {np.dtype(dtype)} is needed, found {values.dtype}")
    return values


def _shape(found: tuple, wanted: tuple) -> str:
    """The hint for a shape that is not right."""
    hint = ""
    if found == wanted[::-1] and len(found) > 1:
        hint = "; transposed? shapes are (rows, columns)"
    elif len(found) == len(wanted) and len(wanted) > 1 and found[:2] == wanted[1::-1]:
        hint = "; width and height are swapped"
    elif math.prod(found) == math.prod(wanted):
        hint = "; as many numbers, so try `reshape`"
    elif found[:2] == wanted[:2]:
        hint = "; a channel too many or too few?"
    return f"shape {wanted} is needed, found {found}{hint}"


def mask(answer, expected, *, least: float = 0.95) -> Verdict:
    """Which pixels: bool, 0/1 or 0/255, whose overlap with ``expected`` (intersection over union) is ``least``."""
    if verdict := missing(answer):
        return verdict
    values, expected = _as_array(answer, None), np.asarray(expected) != 0
    if isinstance(values, Verdict):
        return values
    if values.shape != expected.shape:
        return not_yet(_shape(values.shape, expected.shape))
    levels = np.unique(values)
    if len(levels) > 2:
        return not_yet(f"a mask has two values, found {len(levels)}; compare with a threshold")
    found = values != 0
    overlap = _overlap(found, expected)
    if overlap >= least:
        note = "0/1 looks black as a picture; multiply by 255 to see it" if levels.max() == 1 and values.dtype != bool else ""
        return right(note)
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
    if verdict := missing(answer):
        return verdict
    values = _as_array(answer, None)
    if isinstance(values, Verdict):
        return values
    if values.shape != (3, 3):
        return not_yet(_shape(values.shape, (3, 3)))
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


def choice(answer, expected: str, *, among: Sequence[str], hints: Mapping[str, str] | None = None, said: str = "") -> Verdict:
    """One of several words, in any case; ``hints``: what to say to a certain wrong one."""
    if verdict := missing(answer):
        return verdict
    if not isinstance(answer, str):
        return not_yet(f"one of {', '.join(map(repr, among))} is needed, found {type(answer).__name__}")
    word = answer.strip().lower()
    if word == expected.lower():
        return right(said)
    if word not in [one.lower() for one in among]:
        return not_yet(f"one of {', '.join(map(repr, among))} is needed, found {answer!r}")
    return not_yet({k.lower(): v for k, v in (hints or {}).items()}.get(word, "look at the figure above again"))


def function(answer, cases, judge: Callable[..., Verdict], **options) -> Verdict:
    """A function: ``cases`` are (arguments, expected), and each result is judged by ``judge`` with ``options``.

    Told apart besides: not a function, an exception, arguments changed in place.
    """
    if verdict := missing(answer):
        return verdict
    if not callable(answer):
        return not_yet(f"a function is needed, found {type(answer).__name__}; leave out the brackets")
    verdict = right()
    for arguments, expected in cases:
        given = [one.copy() if isinstance(one, np.ndarray) else one for one in arguments]
        try:
            result = answer(*given)
        except Exception as error:
            return not_yet(f"{_call(answer, arguments)} raised {_said(error)}")
        if any(isinstance(a, np.ndarray) and not np.array_equal(a, b) for a, b in zip(arguments, given, strict=True)):
            return not_yet("your function changes its argument; work on a copy, or make a new array")
        verdict = judge(result, expected, **options)
        if not verdict:
            return verdict if missing(result) else not_yet(f"{_call(answer, arguments)}: {verdict.hint}")
    return verdict


def _call(answer, arguments) -> str:
    """How the function was called, short."""
    texts = [
        f"array {one.shape}" if isinstance(one, np.ndarray) and one.size > 4 else f"{one!r:.40}" for one in arguments
    ]
    return f"{getattr(answer, '__name__', 'your function')}({', '.join(texts)})"


def first_failed(*verdicts: Verdict | Callable[[], Verdict]) -> Verdict:
    """The first verdict that is not right, else the last one; later ones given as functions are then not asked."""
    verdict = right()
    for one in verdicts:
        verdict = one() if callable(one) else one
        if not verdict:
            return verdict
    return verdict
