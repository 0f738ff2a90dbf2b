"""nbval with a tolerance: the words of an output must match, its numbers must be close.

Integers are counts and must be equal. Numbers with a point agree within 1e-3, because the width of a processor's vector
unit alone moves the RMS of a calibration by 8e-4; where three or more digits are shown, within one unit of the last,
because a number in the middle between two roundings may go either way. Used by `make test-notebooks`.
"""

import math
import re

import pytest

# The sources are no modules to import; the learner's notebooks, and copies of them, hold no outputs to compare.
collect_ignore_glob = ["source/*", "learner/*", "mine/*"]

RTOL, ATOL = 1e-3, 1e-6
NUMBER = re.compile(r"(?<![\w.])[-+−]?(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?(?!\w)")


class Tolerant(str):
    """A text that equals another one with the same words and nearly the same numbers."""

    __hash__ = str.__hash__

    def __eq__(self, other):
        if str.__eq__(self, other):
            return True
        if not isinstance(other, str):
            return False
        words = [" ".join(NUMBER.sub(" # ", str(text)).split()) for text in (self, other)]
        mine, theirs = NUMBER.findall(self), NUMBER.findall(other)
        return words[0] == words[1] and all(map(close, mine, theirs))

    def __ne__(self, other):
        return not self == other


def close(one: str, other: str) -> bool:
    """Whether two numbers, as written, are the same for a reader."""
    one, other = one.replace("−", "-"), other.replace("−", "-")
    if one.lstrip("+-").isdigit() and other.lstrip("+-").isdigit():
        return int(one) == int(other)
    shown = min(last_unit(one), last_unit(other))
    return math.isclose(float(one), float(other), rel_tol=RTOL, abs_tol=max(ATOL, shown))


def last_unit(number: str) -> float:
    """One unit of the last digit that is shown (and 1e-9 for what binary fractions add), 0 for fewer than three."""
    mantissa, _, exponent = number.lower().lstrip("+-").partition("e")
    digits = mantissa.replace(".", "").lstrip("0")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) * (1 + 1e-9) if len(digits) >= 3 else 0.0


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    """Let nbval compare tolerantly."""
    try:
        from nbval.plugin import IPyNbCell
    except ImportError:
        return
    plain = IPyNbCell.sanitize
    IPyNbCell.sanitize = lambda self, text: Tolerant(plain(self, text)) if isinstance(text, str) else text
