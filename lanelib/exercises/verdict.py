"""What a checker says: right or not yet, and one line why."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Verdict:
    """True where the answer is right. Shown in a notebook as a coloured line; the sign and the words say the same."""

    ok: bool
    hint: str = ""

    def __bool__(self) -> bool:
        return self.ok

    def __repr__(self) -> str:
        return f"{'✓ Right' if self.ok else '✗ Not yet'}{': ' + self.hint if self.hint else '.'}"

    def _repr_html_(self) -> str:
        colour = "#009e73" if self.ok else "#d55e00"  # told apart by every kind of colour vision
        style = f"border-left: 4px solid {colour}; padding: 4px 10px; margin: 4px 0"
        return f'<div role="status" style="{style}">{escape(repr(self))}</div>'


def right(hint: str = "") -> Verdict:
    """The answer is right; ``hint`` may say what to notice."""
    return Verdict(True, hint)


def not_yet(hint: str) -> Verdict:
    """The answer is not right; ``hint`` says in a line what to look at."""
    return Verdict(False, " ".join(hint.split()))


def never_raises(checker: Callable[..., Verdict]) -> Callable[..., Verdict]:
    """A checker that answers an unforeseen kind of answer with a verdict instead of a traceback."""

    @functools.wraps(checker)
    def checked(*answer, **options) -> Verdict:
        try:
            return checker(*answer, **options)
        except Exception as error:
            return not_yet(f"the answer could not be judged ({said_by(error)}); compare its type with the text above")

    return checked


def said_by(error: BaseException) -> str:
    """An exception in a few words."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:160]}" if text else type(error).__name__
