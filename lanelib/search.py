"""Lane pixels: which pixels of a bird's-eye view belong to the left and which to the right line of the ego lane?

Rows grow towards the car, so the bottom of the picture is where one looks first. Input is a mask (H, W) uint8 0/255 or
a weight picture (H, W) float, 0 = no paint. Everything looked at on the way is part of the result, so that it can be
drawn. Nothing found is a result like any other: it is falsy and says why.
"""

from dataclasses import dataclass, field

import numpy as np

from lanelib.channels import one_channel
from lanelib.errors import LanelibError

MARGIN_FRACTION = 0.08  # of the picture's width: 0.6 m to either side where the view is two lanes (7.3 m) wide, enough
# for a bend between two windows and less than the distance from paint to most seams and barriers
MINIMUM_FRACTION = 0.003  # of a window's area: one reflector does not move a window, a third of a worn dash does
SMOOTH_FRACTION = 0.01  # of the width, about the width of paint: a peak of the histogram is a stripe, not one column
N_WINDOWS = 9  # one window then is about as long as a dash (3 m of 27 m)


@dataclass(frozen=True)
class Window:
    """One window: rows row_top to row_bottom and columns left to right, ends excluded as in a slice."""

    side: str  # "left" or "right"
    row_top: int
    row_bottom: int
    left: int
    right: int
    n_pixels: int  # pixels of a weight above 0 inside
    recentred: bool  # the next window starts from the mean column of these pixels


def _no_xy() -> np.ndarray:
    return np.empty((0, 2))


def _no_values() -> np.ndarray:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class LanePixels:
    """The pixels of both lines, and how they were found. True if there are pixels of at least one line."""

    left_xy: np.ndarray = field(default_factory=_no_xy)  # (N, 2) float64, columns x and rows y, pixels
    right_xy: np.ndarray = field(default_factory=_no_xy)
    left_weights: np.ndarray = field(default_factory=_no_values)  # (N,) float64; 1 for a mask's 255
    right_weights: np.ndarray = field(default_factory=_no_values)
    histogram: np.ndarray = field(default_factory=_no_values)  # (W,) float64: sum of weights per column, lower half
    peaks: tuple[int | None, int | None] = (None, None)  # columns of the histogram where the windows start
    windows: tuple[Window, ...] = ()  # sliding windows, from the car upwards
    regions: tuple[np.ndarray, ...] = ()  # search around: per side searched the polygon (M, 2) float64, x and y
    reason: str = ""  # what is missing, "" when both lines have pixels

    def __bool__(self) -> bool:
        return len(self.left_xy) + len(self.right_xy) > 0

    def __str__(self) -> str:
        because = f": {self.reason}" if self.reason else ""
        return f"{len(self.left_xy)} left and {len(self.right_xy)} right pixels{because}"


def _weights(mask: np.ndarray) -> np.ndarray:
    """(H, W) float32 weights, 0 and more: whole numbers 0..255 become 0..1; a mask of 0 and 1, and a picture of floats,
    stay as they are; NaN and negative numbers become 0."""
    weights = one_channel(mask).astype(np.float32)
    if mask.dtype.kind in "ui" and mask.max() > 1:
        weights *= np.float32(1 / 255)
    return np.where(np.isfinite(weights) & (weights > 0), weights, np.float32(0))


def histogram(mask: np.ndarray, *, rows: slice | None = None) -> np.ndarray:
    """Sum of the weights in each column, (W,) float64, over `rows` (default: the lower half, nearest to the car).

    For a mask this is the number of its pixels. Near the car a lane line is nearly upright, so it makes a peak.
    """
    weights = _weights(mask)
    rows = slice(len(weights) // 2, None) if rows is None else rows
    return weights[rows].sum(axis=0, dtype=np.float64)


def find_peaks(
    column_sums: np.ndarray, *, centre: float | None = None, smooth_px: int | None = None
) -> tuple[int | None, int | None]:
    """Columns of the highest peak left and right of `centre` (default: the middle); None where a side is all zero.

    The sums (W,) are first averaged over `smooth_px` columns (odd; default SMOOTH_FRACTION of the width).
    """
    column_sums = np.asarray(column_sums, float)
    if column_sums.ndim != 1 or not len(column_sums) or not np.isfinite(column_sums).all():
        raise LanelibError(f"finite sums of columns (W,) are needed, found shape {column_sums.shape}; see histogram")
    if centre is not None and not np.isfinite(centre):
        raise LanelibError(f"a column is needed as centre, found {centre}; leave it out for the middle")
    width = len(column_sums)
    smooth_px = 2 * round(SMOOTH_FRACTION * width / 2) + 1 if smooth_px is None else smooth_px
    if smooth_px < 1 or smooth_px % 2 == 0:
        raise LanelibError(f"an odd smoothing width of 1 or more is needed, found {smooth_px}; add 1")
    centre = (width - 1) / 2 if centre is None else min(max(centre, 0), width - 1)
    split = int(centre) + 1  # the first column on the right
    peaks: list[int | None] = []
    for side in (slice(None, split), slice(split, None)):
        sums = np.zeros(width)  # each side is smoothed alone: a stripe across the middle must not count for the other
        sums[side] = column_sums[side]
        if not sums.any():
            peaks.append(None)
            continue
        smooth = np.full(width, -np.inf)
        smooth[side] = np.convolve(sums, np.ones(smooth_px) / smooth_px)[smooth_px // 2 :][:width][side]
        highest = np.flatnonzero(smooth >= smooth.max() * (1 - 1e-9))
        flat_top = highest[: np.argmax(np.diff(highest, append=np.inf) > 1) + 1]  # the first run of equal columns
        peaks.append(int(flat_top[len(flat_top) // 2]))
    return peaks[0], peaks[1]


def _gather(weights: np.ndarray, window: tuple[int, int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of weight above 0 in a window (top, bottom, left, right): (N, 2) x, y and (N,) weights."""
    top, bottom, left, right = window
    crop = weights[top:bottom, left:right]
    y, x = np.nonzero(crop)
    return np.column_stack((x + left, y + top)).astype(float), crop[y, x].astype(float)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and weights (N,) of several windows as those of one."""
    return np.concatenate([_no_xy(), *(xy for xy, _ in parts)]), np.concatenate([_no_values(), *(w for _, w in parts)])


def _margin(margin_px: float | None, width: int) -> float:
    """The margin given, or the default in proportion to the width."""
    if margin_px is None:
        return max(1.0, MARGIN_FRACTION * width)
    if not 0 <= margin_px < np.inf:
        raise LanelibError(f"a margin of 0 px or more is needed, found {margin_px}; try {MARGIN_FRACTION * width:.0f}")
    return margin_px


def _missing(left_xy: np.ndarray, right_xy: np.ndarray, where: str) -> str:
    sides = [side for side, xy in (("left", left_xy), ("right", right_xy)) if not len(xy)]
    return f"no pixels of the {' and the '.join(sides)} line {where}" if sides else ""


def sliding_windows(
    mask: np.ndarray,
    *,
    n_windows: int = N_WINDOWS,
    margin_px: float | None = None,
    minimum_pixels: float | None = None,
    recentre: bool = True,
    centre: float | None = None,
) -> LanePixels:
    """Find both lines without knowing anything: start at the histogram's peaks and follow the pixels upwards.

    Each side has `n_windows` windows stacked from the bottom, each `margin_px` to both sides of its centre. A window
    that holds `minimum_pixels` (sum of weights) or more centres the next one on their mean column, if `recentre`;
    otherwise the next one stays in the same column. Where two windows of a row meet they share the space between
    their centres, so no pixel belongs to both lines. `centre` is the column that divides left from right peaks.
    Defaults are proportional to the picture: MARGIN_FRACTION and MINIMUM_FRACTION.
    """
    weights = _weights(mask)
    height, width = weights.shape
    if n_windows < 1:
        raise LanelibError(f"at least one window is needed, found n_windows={n_windows}; {N_WINDOWS} is usual")
    n_windows = min(n_windows, height)
    margin_px = _margin(margin_px, width)
    if minimum_pixels is None:
        minimum_pixels = max(1.0, MINIMUM_FRACTION * 2 * margin_px * height / n_windows)
    sums = histogram(mask)
    peaks = find_peaks(sums, centre=centre)
    centres: dict[str, float] = {side: p for side, p in zip(("left", "right"), peaks, strict=True) if p is not None}
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {"left": [], "right": []}
    windows = []
    edges = np.linspace(height, 0, n_windows + 1).round().astype(int)
    for bottom, top in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        middle = round(sum(centres.values()) / 2 + 0.5) if len(centres) == 2 else None
        for side, column in dict(centres).items():
            left, right = max(0, round(column - margin_px)), min(width, round(column + margin_px) + 1)
            if middle is not None:
                left, right = (left, min(right, middle)) if side == "left" else (max(left, middle), right)
            xy, pixel_weights = _gather(weights, (top, bottom, left, right))
            total = pixel_weights.sum()
            enough = bool(recentre and len(xy) and total >= minimum_pixels)
            if enough:
                centres[side] = float(xy[:, 0] @ pixel_weights / total)
            found[side].append((xy, pixel_weights))
            windows.append(Window(side, top, bottom, left, right, len(xy), enough))
    (left_xy, left_weights), (right_xy, right_weights) = _joined(found["left"]), _joined(found["right"])
    reason = _missing(left_xy, right_xy, f"in the lower half of the {width}x{height} bird's-eye view")
    return LanePixels(left_xy, right_xy, left_weights, right_weights, sums, peaks, tuple(windows), (), reason)


def search_around(
    mask: np.ndarray,
    left_coefficients: np.ndarray | None,
    right_coefficients: np.ndarray | None,
    *,
    margin_px: float | None = None,
) -> LanePixels:
    """Find both lines near where they were: all pixels within `margin_px` columns of x = a y² + b y + c.

    Coefficients are (a, b, c), highest power first, x and y in pixels of this picture; None (or not finite) for a line
    that was not known. Where the two regions overlap a pixel goes to the nearer line. `regions` are the polygons
    searched, left first.
    """
    weights = _weights(mask)
    height, width = weights.shape
    margin_px = _margin(margin_px, width)
    y, x = np.nonzero(weights)
    rows = np.arange(height, dtype=float)
    distances, regions = [], []
    for coefficients in (left_coefficients, right_coefficients):
        a_b_c = np.full(3, np.nan) if coefficients is None else np.asarray(coefficients, float)
        if a_b_c.shape != (3,):
            raise LanelibError(f"three coefficients a, b, c are needed, found {a_b_c.shape}; fit a second order")
        if not np.isfinite(a_b_c).all():
            distances.append(np.full(len(x), np.inf))
            continue
        line_x = (a_b_c[0] * rows + a_b_c[1]) * rows + a_b_c[2]
        distances.append(np.abs(x - line_x[y]))
        edge_left, edge_right = (np.column_stack((line_x + shift, rows)) for shift in (-margin_px, margin_px))
        regions.append(np.concatenate((edge_left, edge_right[::-1])))
    is_left = (distances[0] <= margin_px) & (distances[0] <= distances[1])
    is_right = (distances[1] <= margin_px) & ~is_left
    sides = [(np.column_stack((x[chosen], y[chosen])).astype(float), weights[y[chosen], x[chosen]].astype(float))
             for chosen in (is_left, is_right)]
    (left_xy, left_weights), (right_xy, right_weights) = sides
    sums = histogram(mask)
    reason = _missing(left_xy, right_xy, f"within {margin_px:.0f} px of the last lane")
    return LanePixels(left_xy, right_xy, left_weights, right_weights, sums, (None, None), (), tuple(regions), reason)
