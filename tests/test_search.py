"""Lane pixels against pictures drawn from known polynomials."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.errors import LanelibError
from lanelib.search import find_peaks, histogram, search_around, sliding_windows

SIZE = 400, 260  # rows, columns; not the default of anything


def draw(*lines, half_width=3, shape=SIZE, rows=slice(None)):
    """Mask with a stripe around each x = a y² + b y + c."""
    mask = np.zeros(shape, np.uint8)
    y, x = np.mgrid[: shape[0], : shape[1]]
    for line in lines:
        mask[np.abs(x - np.polyval(line, y)) <= half_width] = 255
    keep = np.zeros_like(mask)
    keep[rows] = mask[rows]
    return keep


LEFT, RIGHT = (4e-4, -0.30, 130.0), (3e-4, -0.22, 240.0)  # at the bottom 74 and 200: two bent lines, 125 px apart


def on_line(xy, line):
    return np.abs(xy[:, 0] - np.polyval(line, xy[:, 1]))


def test_histogram_is_a_count_of_the_chosen_rows():
    mask = draw(LEFT, RIGHT)
    assert histogram(mask) == pytest.approx((mask[200:] > 0).sum(axis=0))
    assert histogram(mask, rows=slice(10, 60)) == pytest.approx((mask[10:60] > 0).sum(axis=0))
    weights = np.random.default_rng(3).random((7, 5))
    assert histogram(weights) == pytest.approx(weights[3:].sum(axis=0), rel=1e-6)


def test_peaks_are_the_middle_of_the_stripes_and_none_where_there_is_nothing():
    sums = np.zeros(100)
    sums[20:27] = 5
    sums[80:83] = 2
    assert find_peaks(sums, smooth_px=1) == (23, 81)
    assert find_peaks(sums, smooth_px=3) == (23, 81)
    assert find_peaks(sums, centre=85, smooth_px=1) == (23, None)
    assert find_peaks(sums, centre=10, smooth_px=1) == (None, 23)
    assert find_peaks(np.zeros(10)) == (None, None)
    with pytest.raises(LanelibError, match="odd"):
        find_peaks(sums, smooth_px=4)
    left, right = find_peaks(np.array([1, 0, 0, 2.0]), smooth_px=9)  # each on its side, however wide the mean
    assert left < 2 <= right
    for bad in ([], [[1.0, 2.0]], [1.0, np.nan]):
        with pytest.raises(LanelibError, match="sums of columns"):
            find_peaks(bad)
    with pytest.raises(LanelibError, match="centre"):
        find_peaks(sums, centre=np.nan)


def test_the_centre_divides_between_columns():
    """Of columns 0..9 the middle is 4.5; at a centre of 4.6 column 5 is on the right."""
    sums = np.zeros(10)
    sums[5] = 3
    assert find_peaks(sums, smooth_px=1) == (None, 5)
    assert find_peaks(sums, centre=4.6, smooth_px=1) == (None, 5)
    assert find_peaks(sums, centre=5.4, smooth_px=1) == (5, None)
    for width in (5, 7, 9):  # the middle one of an odd number is on the left
        assert find_peaks(np.eye(width)[width // 2], smooth_px=1) == (width // 2, None)


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64, np.float32])
def test_masks_of_any_numbers_count_their_pixels(kind):
    mask = (draw(LEFT, RIGHT) > 0).astype(kind)
    levels = [mask] if kind in (bool, np.float32) else [mask, mask * 255]
    for one in levels:
        assert histogram(one) == pytest.approx(histogram(draw(LEFT, RIGHT)))
        assert any(window.recentred for window in sliding_windows(one).windows)


def test_a_single_bright_column_loses_against_a_stripe():
    sums = np.zeros(200)
    sums[30] = 10
    sums[60:65] = 6
    assert find_peaks(sums, smooth_px=5)[0] == 62
    assert find_peaks(sums, smooth_px=1)[0] == 30


def test_sliding_windows_collect_every_pixel_of_both_lines_and_no_other():
    mask = draw(LEFT, RIGHT)
    clutter = mask.copy()
    clutter[5:395:2, 252:] = 255  # a textured verge on the right: not connected, beyond the margin
    found = sliding_windows(clutter, n_windows=20, margin_px=15, minimum_pixels=10)
    assert found
    assert not found.reason
    assert on_line(found.left_xy, LEFT).max() <= 3
    assert on_line(found.right_xy, RIGHT).max() <= 3
    assert len(found.left_xy) + len(found.right_xy) == (mask > 0).sum()
    assert (found.left_weights == 1).all()
    assert len(found.left_weights) == len(found.left_xy)


def test_windows_tile_the_rows_and_count_their_pixels():
    mask = draw(LEFT, RIGHT)
    found = sliding_windows(mask, n_windows=7, margin_px=20)
    left = [window for window in found.windows if window.side == "left"]
    assert len(left) == 7
    assert left[0].row_bottom == 400
    assert left[-1].row_top == 0
    assert all(lower.row_top == upper.row_bottom for lower, upper in zip(left, left[1:], strict=False))
    for window in found.windows:
        assert window.n_pixels == (mask[window.row_top : window.row_bottom, window.left : window.right] > 0).sum()
    assert sum(window.n_pixels for window in left) == len(found.left_xy)
    assert found.peaks == find_peaks(found.histogram)


def test_recentring_follows_a_bend_that_fixed_windows_lose():
    bend = (9e-4, -0.60, 150.0)
    mask = draw(bend)
    following = sliding_windows(mask, n_windows=40, margin_px=14, minimum_pixels=5)
    standing = sliding_windows(mask, n_windows=40, margin_px=14, minimum_pixels=5, recentre=False)
    assert len(following.left_xy) == (mask > 0).sum()
    assert len(standing.left_xy) < 0.8 * len(following.left_xy)
    assert not any(window.recentred for window in standing.windows)
    deaf = sliding_windows(mask, n_windows=40, margin_px=14, minimum_pixels=10_000)
    assert len(deaf.left_xy) == len(standing.left_xy)


def test_a_gap_between_dashes_does_not_lose_the_line():
    straight = (0.0, 0.05, 60.0)
    mask = draw(straight, rows=np.r_[0:100, 250:400])
    found = sliding_windows(mask, n_windows=16, margin_px=20)
    assert len(found.left_xy) == (mask > 0).sum()
    assert "right" in found.reason
    assert "left" not in found.reason
    assert found


def test_windows_share_no_pixel_where_lines_meet():
    mask = draw((0.0, 0.28, 118.0 - 40), (0.0, -0.28, 142.0 + 40), shape=(300, 260), half_width=4)[::-1]  # a wedge
    found = sliding_windows(np.ascontiguousarray(mask), n_windows=15, margin_px=30, minimum_pixels=4)
    left, right = {tuple(p) for p in found.left_xy}, {tuple(p) for p in found.right_xy}
    assert left
    assert right
    assert not left & right


def test_weights_pull_the_windows():
    weights = np.zeros((60, 200), np.float32)
    weights[:, 40] = 1.0
    weights[:, 60] = 0.01
    found = sliding_windows(weights, n_windows=3, margin_px=30, minimum_pixels=0.5)
    middle = (found.windows[1].left + found.windows[1].right - 1) / 2
    assert middle == pytest.approx((40 * 1 + 60 * 0.01) / 1.01, abs=1)
    assert set(np.round(found.left_weights, 4)) == {1.0, 0.01}
    many_weak = np.full((60, 200), 0.01, np.float32)  # 1200 pixels in a window, and a weight of 12 together
    found = sliding_windows(many_weak, n_windows=3, margin_px=30, minimum_pixels=20)
    assert len(found.left_xy) > 20 and not any(window.recentred for window in found.windows)


def test_search_around_takes_exactly_the_pixels_within_the_margin():
    rng = np.random.default_rng(5)
    mask = ((rng.random(SIZE) < 0.2) * 255).astype(np.uint8)
    found = search_around(mask, LEFT, RIGHT, margin_px=11.5)
    y, x = np.nonzero(mask)
    for xy, line in ((found.left_xy, LEFT), (found.right_xy, RIGHT)):
        near = np.abs(x - np.polyval(line, y)) <= 11.5
        assert {tuple(p) for p in xy} == set(zip(x[near], y[near], strict=True))
    assert len(found.regions) == 2
    assert found.regions[0][:400, 0] == pytest.approx(np.polyval(LEFT, np.arange(400)) - 11.5)
    assert found.regions[1][400:, 0] == pytest.approx(np.polyval(RIGHT, np.arange(400))[::-1] + 11.5)


def test_search_around_gives_a_pixel_to_the_nearer_line():
    mask = np.full((5, 30), 255, np.uint8)
    found = search_around(mask, (0, 0, 10), (0, 0, 18), margin_px=20)
    assert set(found.left_xy[:, 0]) == set(range(15))
    assert set(found.right_xy[:, 0]) == set(range(15, 30))


@pytest.mark.parametrize("unknown", [None, (np.nan, 0, 0), (0, np.inf, 0)])
def test_search_around_without_a_known_line(unknown):
    found = search_around(draw(LEFT, RIGHT), unknown, RIGHT, margin_px=9)
    assert len(found.left_xy) == 0
    assert len(found.right_xy)
    assert found.reason == "no pixels of the left line within 9 px of the last lane"
    assert len(found.regions) == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (2, 2), (3, 7)])
@pytest.mark.parametrize("value", [0, 255])
def test_any_size_works_and_emptiness_has_a_reason(shape, value):
    mask = np.full(shape, value, np.uint8)
    around = search_around(mask, (0, 0, 0), (0, 0, shape[1] - 1.0))
    for found in (sliding_windows(mask), around):
        assert bool(found) == (value > 0)
        assert found or "left and the right" in found.reason
        assert found.left_xy.shape == (len(found.left_weights), 2)
        assert "left" in str(found)


@settings(max_examples=50, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    density=st.floats(0, 1),
    n_windows=st.integers(1, 60),
    margin=st.floats(0, 50),
    seed=st.integers(0, 99),
)
def test_every_pixel_found_is_a_pixel_of_the_mask_once(shape, density, n_windows, margin, seed):
    mask = ((np.random.default_rng(seed).random(shape) < density) * 255).astype(np.uint8)
    line = (0.0, 0.0, shape[1] / 3)
    for found in (sliding_windows(mask, n_windows=n_windows, margin_px=margin),
                  search_around(mask, line, None, margin_px=margin)):
        xy = np.concatenate((found.left_xy, found.right_xy)).astype(int)
        assert (mask[xy[:, 1], xy[:, 0]] == 255).all()
        assert len(np.unique(xy, axis=0)) == len(xy)
        assert (found.reason == "") == bool(len(found.left_xy) and len(found.right_xy))


def test_not_a_number_counts_as_no_paint():
    weights = np.array([[np.nan, -1.0, 0.5, np.inf]])
    assert histogram(weights).tolist() == [0, 0, 0.5, 0]


@pytest.mark.parametrize("bad", [np.zeros((4, 4, 3), np.uint8), np.zeros((0, 4), np.uint8), None, np.array([["a"]])])
def test_bad_masks_are_one_clear_line(bad):
    with pytest.raises(LanelibError, match="a mask or a grey picture") as error:
        sliding_windows(bad)
    assert "\n" not in str(error.value)


def test_bad_tuning_values_are_one_clear_line():
    mask = draw(LEFT)
    with pytest.raises(LanelibError, match="n_windows=0"):
        sliding_windows(mask, n_windows=0)
    with pytest.raises(LanelibError, match="margin"):
        sliding_windows(mask, margin_px=float("nan"))
    with pytest.raises(LanelibError, match="three coefficients"):
        search_around(mask, (1.0, 2.0), None)
