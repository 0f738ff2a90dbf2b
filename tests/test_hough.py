"""hough.py: votes for single lines, and the lines that are chosen by them."""

import numpy as np
import pytest
from roads import Lane7, joined, points, points_on_lane

from lanelib.hough import (
    BEARINGS,
    BENDS,
    FARTHEST_M,
    LEAST_WEIGHT,
    MOST_VOTERS,
    MOST_X_M,
    PER_SIDE,
    SAME_LINE_M,
    X_BINS_M,
    X_REACH_M,
    X_STEP_M,
    objection,
    peaks,
    refined_lines,
    single_lines,
    voters,
    votes,
)
from lanelib.jointfit import BEND, CENTRE, UNKNOWN_ROAD, Prior


def near_half(p):
    """The points that may vote for their distance's sake."""
    return p.some(p.inverse > 1 / FARTHEST_M)


def test_votes_peak_at_the_line():
    """A straight line at x = -1.75, heading 0.04: the peak bin holds it, and nearly all of its weight."""
    lane = Lane7(centre=0.1, heading=0.04, width=3.7 / np.hypot(1, 0.04))
    p = points_on_lane(lane, sides=(-1,))
    table = votes(near_half(p))
    # the best of the coarse bins holds most of the paint between the car and 45 m
    assert table.max() > 0.6 * near_half(p).weight.sum()
    d, a, b, c = single_lines(p)[0]
    y = np.array([5.0, 15, 30])
    np.testing.assert_allclose(c + b * y + a * y**2 + d * y**3, lane.x(y, -1), atol=0.02)


def clutter(n, seed):
    """Points anywhere on the road."""
    rng = np.random.default_rng(seed)
    y = 1 / rng.uniform(1 / 60, 1 / 4, n)
    return points(rng.uniform(-8, 8, n) / y, 1 / y, rng.integers(0, 136, n), rng.uniform(0.2, 1, n))


def test_votes_are_counted_as_a_histogram_would():
    """Line by line, with numpy's histogram; a point on the edge of a bin may fall to either side."""
    p = clutter(70, 1)
    table = votes(p)
    y, bearing, weight = 1 / p.inverse, p.bearing, p.weight
    edges = np.linspace(-X_REACH_M, X_REACH_M, len(X_BINS_M) + 1)
    counted = 0.0
    for i in range(0, len(BENDS), 3):
        arc = np.abs(2 * BENDS[i]) * y <= 0.7
        for j in range(0, len(BEARINGS), 4):
            x = ((bearing - BEARINGS[j]) * y - BENDS[i] * y**2)[arc]
            on_edge = np.abs((x + X_REACH_M) / X_STEP_M - np.rint((x + X_REACH_M) / X_STEP_M)) < 1e-3
            expected = np.histogram(x, edges, weights=weight[arc])[0]
            assert np.abs(table[i, j] - expected).sum() <= 2 * weight[arc][on_edge].sum() + 1e-4
            counted += expected.sum()
    assert counted > 500


def test_votes_of_the_mirrored_road_are_mirrored():
    p = clutter(60, 2)
    mirrored = points(-p.bearing, p.inverse, p.row, p.weight)
    difference = np.abs(votes(p) - votes(mirrored)[::-1, ::-1, ::-1])
    assert difference.sum() < 1e-3 * votes(p).sum()


def test_peaks_are_the_highest_bins_of_their_surroundings():
    p = near_half(points_on_lane(Lane7(0.1, 0.02, 1 / 400, width=3.6)))
    table = votes(p)
    bend, bearing, x = peaks(table)
    i, j, k = (np.searchsorted(values, found) for values, found in ((BENDS, bend), (BEARINGS, bearing), (X_BINS_M, x)))
    assert np.array_equal(BENDS[i], bend) and np.array_equal(BEARINGS[j], bearing) and np.array_equal(X_BINS_M[k], x)
    assert table.max() in table[i[:8], j[:8], k[:8]]
    assert all(len(values) == 0 for values in peaks(np.zeros_like(table)))


def test_voters_are_the_strongest_of_those_near_enough():
    p = clutter(60, 4)
    assert sorted(voters(p)) == np.flatnonzero((p.inverse > 1 / FARTHEST_M) & (p.weight > LEAST_WEIGHT)).tolist()
    rng = np.random.default_rng(5)
    x, y = np.repeat(np.arange(-4.0, 5), 40), np.tile(np.linspace(6, 40, 40), 9)  # as many in each strip
    p = points(x / y, 1 / y, np.tile(np.arange(40), 9), rng.uniform(0.2, 1, len(x)))
    chosen = voters(p)
    assert len(set(chosen)) == len(chosen) == MOST_VOTERS
    for strip in range(-4, 5):
        here = np.flatnonzero(np.round(p.bearing / p.inverse) == strip)
        taken = np.isin(here, chosen)
        assert MOST_VOTERS // 9 - 2 <= taken.sum() <= MOST_VOTERS // 9 + 2
        assert p.weight[here[taken]].min() >= p.weight[here[~taken]].max()


def test_a_strip_full_of_paint_leaves_votes_to_the_others():
    """A solid line of 100 rows and a faint dash of 8: all of the dash votes."""
    solid = points_on_lane(Lane7(0.2, width=10.8), y_m=np.linspace(5, 40, 100), sides=(-1,))
    dash = points_on_lane(Lane7(0.2, width=3.6), y_m=np.linspace(8, 11, 8), sides=(-1,))
    faint = points(dash.bearing, dash.inverse, dash.row, 0.4 * dash.weight)
    p = joined(solid, faint)
    chosen = p.some(voters(p))
    assert len(chosen) == MOST_VOTERS and (chosen.weight < 0.5).sum() == len(dash)


def test_lines_are_chosen_on_both_sides_of_the_car_and_near_it():
    lanes = [Lane7(0.3, 0.01, width=3.6), Lane7(0.3, 0.01, width=10.8)]
    p = joined(*(points_on_lane(lane) for lane in lanes))
    lines = single_lines(p)
    assert np.all(np.abs(lines[:, 3]) < MOST_X_M)
    for side in (-1, 1):
        own = lines[np.sign(lines[:, 3]) == side]
        assert 1 <= len(own) <= PER_SIDE
        assert np.abs(own[:, 3] - lanes[0].x(0.0, side)).min() < 0.05
    assert len(single_lines(p, count=1)) <= 2
    assert single_lines(points_on_lane(Lane7(), sides=())).shape == (0, 4)


def test_no_line_is_chosen_twice(monkeypatch):
    """As they are chosen, before they are drawn onto the paint and may become one."""
    monkeypatch.setattr("lanelib.hough.refined_lines", lambda points, lines: lines)
    p = joined(points_on_lane(Lane7(0.2, 0.02, 1 / 300, width=3.6)), clutter(40, 6))
    _, a, b, c = single_lines(p).T
    assert len(a) == 2 * PER_SIDE
    places = np.column_stack([c + b * y + a * y * y for y in (8.0, 20.0)]) / SAME_LINE_M
    apart = np.abs(places[:, None] - places).max(axis=2)[np.triu_indices(len(a), 1)]
    assert apart.min() >= 1


def test_the_prior_speaks_at_the_choice():
    """Two faint lines left of the car: the first to be chosen is that of a lane in which the car is expected."""
    x = np.repeat([-1.0, -2.6], 8)
    y = np.tile(np.linspace(7, 12, 8), 2)
    p = points(x / y, 1 / y, np.tile(np.arange(8), 2), np.full(16, 0.8))
    for centre, expected in ((0.8, -1.0), (-0.8, -2.6)):
        mean = UNKNOWN_ROAD.mean + centre * (np.arange(7) == CENTRE)
        spread = UNKNOWN_ROAD.covariance.copy()
        spread[CENTRE, CENTRE] = 0.3**2
        assert single_lines(p, prior=Prior(mean, spread), count=1)[0, 3] == pytest.approx(expected, abs=0.3)


def test_the_prior_objects_to_bends():
    """By half the squared Mahalanobis distance of the bend, beside what it objects to place and bearing."""
    spread = np.sqrt(UNKNOWN_ROAD.covariance[BEND, BEND])
    straight = objection(UNKNOWN_ROAD, 1.2, 0.0, 0.02, np.array([1.5]))
    for bend in (-2 * spread, 3 * spread):
        bent = objection(UNKNOWN_ROAD, 1.2, np.array([bend]), 0.02, np.array([1.5]))
        assert bent - straight == pytest.approx(0.5 * (bend / spread) ** 2, rel=1e-4)


def test_solid_lines_of_other_lanes_leave_places_to_faint_dots_of_ours():
    """Four solid lines further out have hundreds of votes, in all bends; ours have five half points each."""
    solid = [points_on_lane(Lane7(width=w)) for w in (10.8, 12.4)]
    dots = points_on_lane(Lane7(width=3.6), y_m=np.linspace(9.5, 13, 5))
    lines = single_lines(joined(points(dots.bearing, dots.inverse, dots.row, 0.5 * dots.weight), *solid))
    for side in (-1, 1):
        assert ((np.abs(lines[:, 3] - side * 1.8) < 0.15) & (np.abs(lines[:, 2]) < 0.03)).any(), lines


def test_lines_refined_together_are_those_refined_alone():
    p = joined(points_on_lane(Lane7(0.2, 0.03, 1 / 500)), clutter(60, 3))
    starts = np.array([[0, 1e-3, 0.02, -1.5], [0, 0, 0.05, 2.2], [0, -2e-3, 0.0, 1.9]])
    together = refined_lines(p, starts)
    for start, line in zip(starts, together, strict=True):
        np.testing.assert_allclose(refined_lines(p, start[None])[0], line, rtol=1e-9, atol=1e-12)
    assert refined_lines(p, np.empty((0, 4))).shape == (0, 4)
