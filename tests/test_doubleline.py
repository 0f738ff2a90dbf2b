"""doubleline.py: of a double line the inner one is the boundary; single and worn lines are left where they are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from roads import Lane7, paint_scan, points

from lanelib.birdseye import Grid
from lanelib.doubleline import around, inward, stripe_edges
from lanelib.jointfit import fit

GRID = Grid(np.arange(-192, 193) * 0.05, np.linspace(1 / np.sqrt(80), 1 / np.sqrt(4), 136) ** -2.0)
LANE = Lane7(centre=0.15, heading=0.02, bend=-1 / 500, width=3.6)
BRIGHT = (200, 200, 200)


def picture_of(*stripes):
    """Grey (H, W) uint8 scan, blurred as a frame is: stripes (x of y, width)."""
    scan = paint_scan(GRID, [(x_of_y, width, BRIGHT) for x_of_y, width in stripes], noise=2)
    return np.ascontiguousarray(cv2.blur(scan, (3, 1))[..., 1])


def fit_along(lane):
    """The fit of points on the middles of the lane's stripes."""
    y, q = GRID.y_m, 1 / GRID.y_m
    rows = np.arange(len(y))
    bearing = np.concatenate([lane.x(y, s) * q for s in (-1, 1)])
    return fit(points(bearing, np.tile(q, 2), np.tile(rows, 2), np.ones(2 * len(y))), lane.mean)


def double(side, apart=0.2, width=0.1):
    """Two lines ``apart`` from middle to middle, around the lane's line; and where its inner one is."""
    lines = [(lambda y, s=s: LANE.x(y, side) + s * apart / 2, width) for s in (-1, 1)]
    return lines, apart / 2


def single(side, width=0.12):
    return (lambda y: LANE.x(y, side), width)


@pytest.mark.parametrize("apart", [0.18, 0.2, 0.22])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_boundary_is_the_inner_line(side, apart):
    lines, shift = double(side, apart)
    found = inward(fit_along(LANE), picture_of(*lines, single(-side)), GRID)
    assert found[(side + 1) // 2] == pytest.approx(shift, abs=0.03)
    assert found[(1 - side) // 2] == 0


@pytest.mark.parametrize("worn", [-1, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_one_of_the_two_lines_may_be_worn(side, worn):
    """A line with less than half of the contrast of the other, left or right, is a line all the same."""
    lines, shift = double(side)
    colours = [(142,) * 3 if s == worn else BRIGHT for s in (-1, 1)]
    scan = paint_scan(GRID, [(*line, colour) for line, colour in zip(lines, colours, strict=True)])
    found = inward(fit_along(LANE), np.ascontiguousarray(cv2.blur(scan, (3, 1))[..., 1]), GRID)
    assert found[(side + 1) // 2] == pytest.approx(shift, abs=0.035)


def test_what_is_much_paler_is_no_second_line():
    lines, _ = double(1)
    scan = paint_scan(GRID, [(*line, (120,) * 3 if i else BRIGHT) for i, line in enumerate(lines)])
    assert inward(fit_along(LANE), np.ascontiguousarray(cv2.blur(scan, (3, 1))[..., 1]), GRID) == (0, 0)


@pytest.mark.parametrize("beside", [-0.06, 0.06])
@pytest.mark.parametrize("side", [-1, 1])
def test_it_is_found_from_a_fit_beside_the_stripes_middle(side, beside):
    """The fit lies 6 cm to one side of both stripes: the inner line is where it is all the same."""
    lines, shift = double(side)
    fitted = fit_along(replace(LANE, centre=LANE.centre + beside))
    found = inward(fitted, picture_of(*lines, single(-side)), GRID)[(side + 1) // 2]
    assert found == pytest.approx(shift + side * beside, abs=0.035)


@pytest.mark.parametrize("width", [0.08, 0.12, 0.16])
def test_single_lines_stay_where_they_are(width):
    assert inward(fit_along(LANE), picture_of(single(-1, width), single(1, width)), GRID) == (0, 0)


def test_without_paint_or_with_a_broad_surface_nothing_moves():
    assert inward(fit_along(LANE), picture_of(), GRID) == (0, 0)
    assert inward(fit_along(LANE), picture_of(single(-1, 0.8), single(1, 0.8)), GRID) == (0, 0)


def test_edges_are_found_to_a_fraction_of_a_column():
    x = np.full(40, 1.0)
    for width in (0.1, 0.22, 0.4):
        picture = paint_scan(Grid(GRID.x_m, GRID.y_m[-40:]), [(lambda y: 1.03 + 0 * y, width, BRIGHT)])[..., 0]
        left, right = stripe_edges(np.ascontiguousarray(picture), x, GRID)
        assert left == pytest.approx(0.03 - width / 2, abs=0.03) and right == pytest.approx(0.03 + width / 2, abs=0.03)
    assert stripe_edges(np.full((40, 385), 100, np.uint8), x, GRID) == (0, 0)


def test_lines_at_the_pictures_border_do_no_harm():
    for x in (-50.0, -9.6, 9.6, 50.0):
        assert np.isfinite(stripe_edges(np.full((40, 385), 100, np.uint8), np.full(40, x), GRID)).all()


def test_a_slope_to_the_border_of_what_is_looked_at_has_an_edge():
    """Ever brighter to one side: no index runs away."""
    for slope in (1, -1):
        picture = np.tile(np.uint8(np.clip(100 + slope * (np.arange(385) - 212), 0, 255)), (40, 1))
        left, right = stripe_edges(picture, np.full(40, 1.0), GRID)
        assert -0.7 < left <= right < 0.7


def test_a_stripe_is_as_wide_as_it_is_above_half_its_height():
    values = [0.0, 1, 4, 10, 6, 0, 0, 2, 5, 6, 1, 0]
    assert around(values, 3) == (3, 4) and around(values, 9) == (8, 9)
    assert around([3.0, 2, 1], 0) == (0, 1) and around([1.0, 2, 3], 2) == (1, 2)


def test_a_broad_bright_patch_beside_is_no_second_line():
    """A dry strip of a wet road, half as bright as the paint and 30 cm wide."""
    patch = (lambda y: LANE.x(y, 1) - 0.3, 0.3)
    scan = paint_scan(GRID, [(*single(1), BRIGHT), (*patch, (150,) * 3)])
    scan = cv2.GaussianBlur(scan, (0, 0), 0.8)
    assert inward(fit_along(LANE), np.ascontiguousarray(scan[..., 1]), GRID) == (0, 0)
