"""What an explorer shows for one setting of its controls: a picture and labelled numbers, made without any widget.

Every explorer is a plain function from its controls' values to a `Look`; the widget only shows it. So a test, or a
figure in print, can ask for exactly what would be on the screen.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from lanelib.draw import bgr, put_text
from lanelib.draw.lettering import wrapped

JPEG_QUALITY = 88  # thin coloured lines stay clean from here on, with full colour resolution
WIDTH_PX = 960  # of a composed picture: as wide as a notebook's cell in a window of 1200 px
PANEL_WIDTH = 462  # of each of two pictures side by side, px
NOTHING = "–"
WIDE = 22  # letters; a longer value has a row of its own


@dataclass(frozen=True)
class Reading:
    """One labelled number (or word). ``truth``: the true value of the same thing, where it is known."""

    name: str
    value: float | str | None
    unit: str = ""
    digits: int = 2
    truth: float | str | None = None
    signed: bool = False

    @property
    def text(self) -> str:
        """The value as it is shown, with its unit."""
        return self._written(self.value)

    @property
    def truth_text(self) -> str:
        """The true value as it is shown, "" where none is known."""
        return "" if self.truth is None else self._written(self.truth)

    def _written(self, value) -> str:
        if value is None or (not isinstance(value, str) and math.isnan(value)):
            return NOTHING
        if isinstance(value, str):
            return value
        if math.isinf(value):
            return "∞"
        number = f"{value:{'+' if self.signed else ''}.{self.digits}f}"
        if float(number) == 0:  # no "-0.00"
            number = number.replace("-", "+" if self.signed else "")
        return f"{number} {self.unit}".strip()


@dataclass(frozen=True, eq=False)
class Look:
    """A picture (H, W, 3) uint8 BGR, its readings, and where an explorer writes code, that ``code``."""

    picture: np.ndarray
    readings: tuple[Reading, ...] = ()
    code: str = ""

    @property
    def values(self) -> dict[str, float | str | None]:
        """The numbers by name."""
        return {reading.name: reading.value for reading in self.readings}

    def jpeg(self) -> bytes:
        """The picture as a JPEG file."""
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        return cv2.imencode(".jpg", self.picture, options)[1].tobytes()

    def _repr_jpeg_(self) -> bytes:
        return self.jpeg()

    def __repr__(self) -> str:
        lines = (f"{r.name}: {r.text}" + (f" (truth {r.truth_text})" if r.truth_text else "") for r in self.readings)
        return "\n".join(lines) or "Look"


def readings_html(readings: Iterable[Reading]) -> str:
    """The readings as a list of labelled values; the true value below, where there is one."""
    items = []
    for reading in readings:
        truth = f'<dd class="lx-truth">truth {html.escape(reading.truth_text)}</dd>' if reading.truth_text else ""
        name = html.escape(reading.name)
        wide = ' class="lx-wide"' if len(reading.text) > WIDE else ""
        value = f'<dd class="lx-value">{html.escape(reading.text)}</dd>'
        items.append(f'<div data-name="{name}"{wide}><dt>{name}</dt>{value}{truth}</div>')
    return f'<dl class="lx-readings">{"".join(items)}</dl>' if items else ""


def message_card(message: str, size_wh: tuple[int, int]) -> np.ndarray:
    """A dark card with a message on it, (H, W, 3): what is shown in place of a picture that cannot be made."""
    width, height = size_wh
    card = np.full((height, width, 3), bgr("card"), np.uint8)
    lines = wrapped(message, 13, width - 80, max_lines=5)
    for i, line in enumerate(lines):
        base = height / 2 + 28 * (i - (len(lines) - 1) / 2) + 6
        put_text(card, line, (width / 2, base), bgr("title"), cap_px=13, align="centre")
    return card
