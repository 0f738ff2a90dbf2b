"""The same colour for the same thing everywhere: one table for overlays, panels and figures.

Everything but the classic overlay (green lane, red and blue lines) uses the palette of Okabe and Ito (2008), which
people with any kind of colour vision can tell apart. Colours are written "#rrggbb", as matplotlib takes them; `bgr`
gives what OpenCV takes.
"""

import re

from lanelib.errors import LanelibError

# Okabe and Ito, "Color universal design", 2008
VERMILLION, BLUE, GREEN, ORANGE = "#d55e00", "#0072b2", "#009e73", "#e69f00"
SKY, PURPLE, YELLOW = "#56b4e9", "#cc79a7", "#f0e442"

SERIES = (BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE)  # things without a colour of their own, in this order

# The ways to smooth a lane over time (`tracking.SMOOTHING`), and no smoothing at all
SMOOTHER_COLOURS = {
    "each frame alone": PURPLE,
    "none": SKY,
    "average": BLUE,
    "exponential": VERMILLION,
    "kalman": GREEN,
}

PALETTE = {
    # figures and panels
    "left": VERMILLION, "right": BLUE, "estimate": GREEN, "truth": "#000000",
    "measured": GREEN, "held": ORANGE, "none": VERMILLION,
    "window": ORANGE, "region": SKY, "paint": YELLOW, "accent": SKY, "other": PURPLE, "trapezoid": VERMILLION,
    # the classic overlay
    "lane area": "#12d66a", "left line": "#ff3b30", "right line": "#2f7bff", "neighbour": PURPLE,
    # panels: a dark desk on which pictures lie
    "desk": "#14181d", "card": "#0b0e12", "rule": "#3a424c", "track": "#5b6672",
    "title": "#e8ecf1", "text": "#ffffff", "label": "#a7b1bd",
}


def bgr(name: str) -> tuple[int, int, int]:
    """A colour of PALETTE, or any "#rrggbb", as OpenCV's (blue, green, red)."""
    code = PALETTE.get(name, name) if isinstance(name, str) else ""
    if not re.fullmatch("#[0-9a-fA-F]{6}", code):
        raise LanelibError(f"a colour must be '#rrggbb' or a name of draw.PALETTE, found {name!r}")
    return int(code[5:7], 16), int(code[3:5], 16), int(code[1:3], 16)
