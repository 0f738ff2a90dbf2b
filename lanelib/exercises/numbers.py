"""Judging numbers: single ones, and arrays of them, with units and signs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction

import numpy as np

from lanelib.exercises.verdict import Verdict, not_yet, right

# A wrong unit shows as a factor. What is told needs not be exact: the factor must be within 2 %.
FACTOR_TOLERANCE = 0.02
FACTORS = {
    1000.0: "1000 times too large: metres where kilometres are wanted, or millimetres where metres are?",
    1 / 1000: "1000 times too small: kilometres where metres are wanted, or metres where millimetres are?",
    100.0: "100 times too large: centimetres where metres are wanted, or per cent where a share is?",
    1 / 100: "100 times too small: metres where centimetres are wanted, or a share where per cent is?",
    180 / math.pi: "57.3 times too large: degrees where radians are wanted?",
    math.pi / 180: "57.3 times too small: radians where degrees are wanted?",
    2.0: "twice what it should be",
    0.5: "half of what it should be",
}
SPEED_FACTORS = {
    3.6: "3.6 times too large: km/h where m/s is wanted?",
    1 / 3.6: "3.6 times too small: m/s where km/h is wanted?",
}
SPEED_UNITS = ("", "m/s", "km/h", "s")  # elsewhere a factor of 3.6 is chance, a lane's width for instance


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
    if (verdict := missing(answer)) is not None:
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
    """The answer as a float: Python's and numpy's numbers (fractions and decimals, too), arrays of one element."""
    if callable(answer):
        return not_yet("a number is needed, found a function; call it")
    if isinstance(answer, str | bytes | dict):
        return not_yet(f"a number is needed, found {type(answer).__name__} {answer!r:.40}")
    try:
        values = np.asarray(float(answer) if isinstance(answer, Fraction | Decimal) else answer)
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
        if _close(value, wrong, min(rel, 0.01), min(tolerance / 10, abs(wrong) / 50)):
            return f"{shown}: {hint}"
    if _close(-value, expected, rel, tolerance):
        return f"{shown}: the size is right, the sign is reversed{f'; {sign}' if sign else ''}"
    if expected and value and math.isfinite(expected):
        ratio = value / expected
        if (hint := _factor(ratio, unit)) is not None:
            return f"{shown}: {hint}"
        if (hint := _factor(-ratio, unit)) is not None:
            return f"{shown}: {hint}, and the sign is reversed{f'; {sign}' if sign else ''}"
        if abs(value * expected - 1) < FACTOR_TOLERANCE:
            return f"{shown}: this is one divided by the right answer"
        if ratio > 0:
            much = f"{ratio:.3g} times" if ratio > 2 else f"{100 * (ratio - 1):.2g} %"
            less = f"{1 / ratio:.3g} times" if ratio < 0.5 else f"{100 * (1 - ratio):.2g} %"
            return f"{shown}: {much} too large" if ratio > 1 else f"{shown}: {less} too small"
    return f"{shown}: {'too large' if value > expected else 'too small'}{' (or of the wrong sign)' if value else ''}"


def _factor(ratio: float, unit: str) -> str | None:
    if not (ratio > 0 and math.isfinite(ratio)):
        return None
    factors = FACTORS | SPEED_FACTORS if unit in SPEED_UNITS else FACTORS
    return next((hint for factor, hint in factors.items() if abs(ratio / factor - 1) < FACTOR_TOLERANCE), None)


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
    mistakes: Mapping[str, object] | None = None,
) -> Verdict:
    """Numbers in an array (a list will do), each as `number`; at least ``share`` of them must be right.

    ``columns``: what the last axis is, "x, y"; told where it is swapped. ``dtype``: where it matters (np.uint8).
    ``mistakes``: {hint: numbers that this mistake gives}, of any shape.
    """
    if (verdict := missing(answer)) is not None:
        return verdict
    values = as_array(answer, dtype)
    if isinstance(values, Verdict):
        return values
    expected = np.asarray(expected)
    if values.shape == expected.shape and np.isclose(values, expected, rtol=rel, atol=tolerance).mean() >= share:
        return right()
    for hint, mistake in (mistakes or {}).items():
        wrong = np.asarray(mistake)
        if values.shape == wrong.shape and np.allclose(values, wrong, rtol=min(rel, 0.01), atol=tolerance / 10):
            return not_yet(hint)
    if values.shape != expected.shape:
        return not_yet(shape_hint(values.shape, expected.shape))
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
        what = "the order" if got.ndim == 1 else "the order of the last axis"
        return not_yet(f"{what} is reversed{f'; {columns} is wanted' if columns else ''}")
    if got.ndim and good(got[::-1]).mean() >= share:
        return not_yet("the values are right, in reversed order")
    use = np.isfinite(wanted) & np.isfinite(got) & (np.abs(wanted) > max(tolerance, 1e-12))
    ratio = np.median(got[use] / wanted[use]) if use.any() else np.nan
    if np.isfinite(ratio) and ratio and abs(ratio - 1) > FACTOR_TOLERANCE and good(got / ratio).mean() >= share:
        hint = _factor(ratio, unit) or (f"all values are {ratio:.3g} times what they should be")
        return not_yet(f"{hint}{f' (unit: {unit})' if unit else ''}")
    shift = np.median((got - wanted)[use]) if use.any() else np.nan
    if np.isfinite(shift) and good(got - shift).mean() >= share:
        return not_yet(f"all values are shifted by {shift:.4g}{' ' + unit if unit else ''}")
    bad = np.unravel_index(int(np.argmin(good(got))), got.shape)
    where = f" (the first wrong one, at {tuple(map(int, bad))}, is {got[bad]:.4g}{' ' + unit if unit else ''})"
    return not_yet(f"{good(got).mean():.0%} of the values are right{where}")


def as_array(answer, dtype=None) -> np.ndarray | Verdict:
    """The answer as an array of numbers, of ``dtype`` where that matters; else the verdict on what it is."""
    if callable(answer):
        return not_yet("an array is needed, found a function; call it")
    if isinstance(answer, str | bytes | dict):
        return not_yet(f"an array is needed, found {type(answer).__name__}")
    try:
        values = np.asarray(answer)
    except ValueError:
        return not_yet(f"an array is needed, found a {type(answer).__name__} of unequal parts")
    if values.dtype.kind not in "iufb":
        return not_yet(f"an array of numbers is needed, found {_elements(values)}")
    if dtype is not None and values.dtype != np.dtype(dtype):
        return not_yet(f"dtype {np.dtype(dtype)} is needed, found {values.dtype}")
    return values


def _elements(values: np.ndarray) -> str:
    """What an array has instead of numbers, in a learner's words."""
    if values.dtype != object:
        return f"elements of type {values.dtype}"
    if values.ndim == 0:
        return f"a {type(values[()]).__name__}; make a list or an array of it"
    return "None among them" if None in values.ravel().tolist() else "elements of several types"


def shape_hint(found: tuple, wanted: tuple) -> str:
    """The hint for a shape that is not right."""
    hint = ""
    if not found and len(wanted) == 1:
        return f"{wanted[0]} numbers are needed, shape {wanted}, found a single one"
    if found == wanted[::-1] and len(found) > 1:
        hint = "; transposed? shapes are (rows, columns)"
    elif len(found) == len(wanted) and len(wanted) > 1 and found[:2] == wanted[1::-1]:
        hint = "; width and height are swapped"
    elif math.prod(found) == math.prod(wanted):
        hint = "; as many numbers, so try `reshape`"
    elif found[:2] == wanted[:2]:
        hint = "; a channel too many or too few?"
    return f"shape {wanted} is needed, found {found}{hint}"
