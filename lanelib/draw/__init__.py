"""Drawing: image in, new image out. Nothing here reads files, and nothing measures: it shows what was measured.

overlay         the lane on the frame, with a read-out (`overlay_bgr`, `overlay_yuv420`: in place, for videos)
diagnostic      everything about one frame on one picture
birdseye        a bird's-eye view with metre rulers, lane and paint points
side_by_side    pictures with titles
draw_…          marks on a picture: points, lines, windows, chessboard corners
"""

from lanelib.draw.canvas import Canvas
from lanelib.draw.lettering import put_text
from lanelib.draw.marks import difference, draw_corners, draw_line, draw_points, draw_windows, heat
from lanelib.draw.overlays import (
    draw_overlay,
    offset_text,
    overlay,
    overlay_bgr,
    overlay_yuv420,
    radius_text,
    status_text,
)
from lanelib.draw.palette import PALETTE, SERIES, SMOOTHER_COLOURS, bgr
from lanelib.draw.panels import birdseye, fitted, histogram_panel, side_by_side
from lanelib.draw.screens import birdseye_beside, diagnostic

__all__ = [
    "PALETTE",
    "SERIES",
    "SMOOTHER_COLOURS",
    "Canvas",
    "bgr",
    "birdseye",
    "birdseye_beside",
    "diagnostic",
    "difference",
    "draw_corners",
    "draw_line",
    "draw_overlay",
    "draw_points",
    "draw_windows",
    "fitted",
    "heat",
    "histogram_panel",
    "offset_text",
    "overlay",
    "overlay_bgr",
    "overlay_yuv420",
    "put_text",
    "radius_text",
    "side_by_side",
    "status_text",
]
