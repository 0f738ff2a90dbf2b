"""Figures for notebooks and the write-up: one line a call, each returns the matplotlib Figure.

Pictures come in as everywhere, (H, W, 3) BGR or masks (H, W); this is the edge where BGR becomes RGB. Colours are those
of `draw.PALETTE`: left vermillion, right blue, truth black and dashed. A returned Figure is closed for pyplot, so a
notebook shows it once, where the call is the last line of a cell; elsewhere use ``display(figure)``.

show, before_after, boards, thresholds, channels, contact_sheet     pictures
warp, column_histogram, fit                                         on the road, in metres
board_errors, over_time, bars, curves                               numbers
save                                                                to a JPEG, PNG or SVG file
"""

from lanelib.figures.numbers import bars, board_errors, curves, over_time
from lanelib.figures.pictures import before_after, boards, channels, contact_sheet, show, thresholds
from lanelib.figures.road import column_histogram, fit, warp
from lanelib.figures.style import rgb, save

__all__ = [
    "bars",
    "before_after",
    "board_errors",
    "boards",
    "channels",
    "column_histogram",
    "contact_sheet",
    "curves",
    "fit",
    "over_time",
    "rgb",
    "save",
    "show",
    "thresholds",
    "warp",
]
