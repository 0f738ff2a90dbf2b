"""windows.py: the classic way gives the drawn lines of a mask, in metres and in the joint fit's numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import Lane7, paint_scan

from lanelib.birdseye import Grid
from lanelib.jointfit import BEND, CENTRE, HEADING, PITCH, WIDTH, line_x
from lanelib.lane import Line
from lanelib.search import LanePixels
from lanelib.windows import find_pixels, fit_lines, joint_state, pixel_coefficients

GRID = Grid.uniform(x_range_m=(-6, 6), y_range_m=(4, 40), size_wh=(480, 720))
SCAN_Y_M = np.linspace(1 / np.sqrt(80), 1 / np.sqrt(4), 136) ** -2.0
LANE = Lane7(centre=-0.3, heading=0.02, bend=-1 / 700, width=3.5)


def mask_of(lane, sides=(-1, 1), width_m=0.12):
    """0/255 mask of the lane's lines in the view of ``GRID``."""
    stripes = [(lambda y, s=s: lane.x(y, s), width_m, (255, 255, 255)) for s in sides]
    return np.uint8(paint_scan(GRID, stripes, road=(0, 0, 0))[..., 0] > 127) * np.uint8(255)


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.01, 0.01), st.floats(-0.3, 0.3), st.floats(-5, 5), st.integers(2, 900), st.integers(2, 900))
def test_pixel_coefficients_are_the_line_in_pixels(a, b, c, width, height):
    grid = Grid.uniform(x_range_m=(-4, 7), y_range_m=(2.5, 41), size_wh=(width, height))
    line = Line([a, b, c])
    rows = np.arange(height)
    columns = np.polyval(pixel_coefficients(line, grid), rows)
    np.testing.assert_allclose(grid.x_of(columns), line.x(grid.y_m), atol=1e-6)


def test_a_cubics_second_order_part_is_taken():
    np.testing.assert_allclose(
        pixel_coefficients(Line([0.0, 0.001, 0.1, 1.0]), GRID), pixel_coefficients(Line([0.001, 0.1, 1.0]), GRID)
    )


@pytest.mark.parametrize("around", [False, True])
def test_the_drawn_lines_come_back(around):
    """By sliding windows, and around lines 0.3 m beside the true ones."""
    previous = tuple(Line([LANE.bend, LANE.heading, LANE.x(0, s) + 0.3]) for s in (-1, 1)) if around else None
    pixels = find_pixels(mask_of(LANE), GRID, previous)
    assert bool(pixels.windows) != around and bool(pixels.regions) == around
    left, right = fit_lines(pixels, GRID)
    at = np.array([4.0, 15, 30, 39])
    assert np.abs(left.x(at) - LANE.x(at, -1)).max() < 0.02
    assert np.abs(right.x(at) - LANE.x(at, 1)).max() < 0.02
    assert left.curvature_1pm() == pytest.approx(2 / 700, rel=0.05)


def test_where_the_last_lane_is_empty_windows_look_everywhere():
    far = tuple(Line([0, 0, x]) for x in (-5.5, 5.5))
    pixels = find_pixels(mask_of(LANE), GRID, far)
    assert pixels.windows and not pixels.reason
    assert np.abs(fit_lines(pixels, GRID)[0].x(10.0) - LANE.x(10.0, -1)) < 0.02


@pytest.mark.parametrize("sides", [(), (-1,), (1,)])
def test_a_missing_line_is_no_line_with_a_reason(sides):
    pixels = find_pixels(mask_of(LANE, sides), GRID)
    lines = fit_lines(pixels, GRID)
    for side, line in zip((-1, 1), lines, strict=True):
        assert bool(line) == (side in sides)
        assert line or line.reason
    assert "no pixels" in pixels.reason


@pytest.mark.parametrize("lane", [LANE, Lane7(0.6, -0.05, 1 / 400, 0, 3.8)])
def test_two_lines_become_the_seven_numbers(lane):
    pixels = find_pixels(mask_of(lane), GRID)
    left, right = fit_lines(pixels, GRID)
    state = joint_state(left, right, pixels, GRID, 1.3, SCAN_Y_M)
    assert state.mean[CENTRE] == pytest.approx(lane.centre, abs=0.02)
    assert state.mean[HEADING] == pytest.approx(lane.heading, abs=0.004)
    assert state.mean[BEND] == pytest.approx(lane.bend, rel=0.06)
    assert state.mean[WIDTH] == pytest.approx(lane.width, abs=0.03)
    assert abs(np.degrees(state.mean[PITCH])) < 0.1
    at = np.array([4.0, 12, 25])
    for side in (-1, 1):
        assert np.abs(line_x(at, state.mean, side) - lane.x(at, side)).max() < 0.06
    # support: every scan row that the view shows has paint on both lines, no other has
    shown = (SCAN_Y_M < 39) & (SCAN_Y_M > 4.1)
    assert state.support[:, shown].min() > 0.1 and state.support[:, shown].mean() > 0.7
    assert state.support[:, SCAN_Y_M > 41].max() == 0
    assert np.linalg.eigvalsh(state.covariance).min() > 0


def test_lines_that_drift_apart_become_pitch():
    """Drawn where a camera that nods by 0.6 degrees shows a straight lane: x_right - x_left = w (1 + pitch y / h)."""
    pitch, h = np.radians(0.6), 1.3
    seen = [Line([0.0, s * 1.8 * pitch / h, s * 1.8], (4, 40), np.eye(3) * 1e-4) for s in (-1, 1)]
    pixels = find_pixels(mask_of(LANE), GRID)
    state = joint_state(*seen, pixels, GRID, h, SCAN_Y_M)
    assert state.mean[PITCH] == pytest.approx(pitch, rel=1e-6) and state.mean[WIDTH] == pytest.approx(3.6)


@pytest.mark.parametrize("heading", [-0.4, 0.0, 0.2])
def test_the_width_of_the_state_is_across_the_lane(heading):
    """Two parallel lines 3.7 m apart, slanted: along x they are further apart. Back as lines they are the same."""
    half = 3.7 / 2 / np.cos(np.arctan(heading))
    lines = [Line([0.0, heading, 0.4 + s * half], (4, 40), np.eye(3) * 1e-4) for s in (-1, 1)]
    state = joint_state(*lines, find_pixels(mask_of(LANE), GRID), GRID, 1.3, SCAN_Y_M)
    assert state.mean[WIDTH] == pytest.approx(3.7) and state.mean[PITCH] == pytest.approx(0)
    for side, line in zip((-1, 1), lines, strict=True):
        assert line_x(10.0, state.mean, side) == pytest.approx(line.x(10.0))


def test_a_nodding_camera_beside_its_lane_keeps_the_heading():
    """Seen at height h under the pitch p, x + heading y appears as x + (heading + x p / h) y: the lane beside which the
    car drives seems to turn."""
    pitch, h, heading, centre = np.radians(0.6), 1.3, 0.02, -1.2
    at_car = [centre + s * 1.8 * np.hypot(1, heading) for s in (-1, 1)]
    seen = [Line([0.0, heading + x * pitch / h, x], (4, 40), np.eye(3) * 1e-4) for x in at_car]
    state = joint_state(*seen, find_pixels(mask_of(LANE), GRID), GRID, h, SCAN_Y_M)
    expected = [centre, heading, 0, 0, 3.6, pitch, 0]
    np.testing.assert_allclose(state.mean, expected, atol=1e-9)


def test_half_the_pixels_of_paint_are_half_the_support_at_every_distance():
    """Two pixels a row, where four are paint: far rows of the scan span many rows of the view, near ones less than
    one."""
    rows = np.arange(720)
    xy = np.column_stack([np.tile([100, 101], 720), np.repeat(rows, 2)])
    pixels = LanePixels(xy, left_weights=np.ones(len(xy)))
    lines = [Line([0.0, 0.0, s * 1.8], (4, 40), np.eye(3) * 1e-4) for s in (-1, 1)]
    support = joint_state(*lines, pixels, GRID, 1.3, SCAN_Y_M).support
    shown = (SCAN_Y_M < 39) & (SCAN_Y_M > 7)  # nearer than 7 m some rows of the scan fall between two of the view
    assert np.abs(support[0, shown] - 0.5).max() < 0.2 and support[0, shown].mean() == pytest.approx(0.5, abs=0.02)
    assert not support[1].any()
