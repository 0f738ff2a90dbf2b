"""Where paint lies in a photograph, measured apart from the finder: an oracle for drives that no one has labelled.

Along one row of the frame a lane line is a hump of brightness or of yellow. Its centre is that of the part above half
of its height: no ridge filter, no bird's-eye view, no model of a lane. Measured only near a line that someone says is
there; where no clear hump is (between dashes, in deep shadow) the answer is NaN.
"""

import numpy as np

REACH_PX, MARGIN_PX = 14, 26  # how far beside the line a centre may lie, and how far the road beside it is looked at
LEAST_LEVELS = 24.0  # of contrast
NARROWEST_PX, WIDEST_PX = 2.0, 34.0


def paint_centres(frame_bgr: np.ndarray, line_x: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """x of the paint's centre at ``rows`` (N,) near ``line_x`` (N,), px of the frame; NaN where there is none."""
    return np.array([_centre(frame_bgr, x, int(row)) for x, row in zip(line_x, rows, strict=True)])


def _centre(frame, x, row):
    if not np.isfinite(x):
        return np.nan
    first, last = round(x) - REACH_PX - MARGIN_PX, round(x) + REACH_PX + MARGIN_PX + 1
    if first < 0 or last > frame.shape[1]:
        return np.nan
    blue, green, red = frame[row - 1 : row + 2, first:last].astype(float).mean(axis=0).T
    inside = slice(MARGIN_PX, -MARGIN_PX)
    humps = [(c, c[inside].max() - np.median(c)) for c in ((red + green) / 2, (red + green) / 2 - blue)]
    channel, height = max(humps, key=lambda hump: hump[1])
    if height < LEAST_LEVELS:
        return np.nan
    above = channel - (np.median(channel) + height / 2)
    top = MARGIN_PX + int(above[inside].argmax())
    out = np.flatnonzero(above <= 0)
    left, right = out[out < top], out[out > top]
    if not len(left) or not len(right):
        return np.nan
    # where it crosses half of its height, between two pixels
    left, right = left[-1], right[0]
    begin = left + above[left] / (above[left] - above[left + 1])
    end = right - above[right] / (above[right] - above[right - 1])
    return first + (begin + end) / 2 if NARROWEST_PX <= end - begin <= WIDEST_PX else np.nan
