"""hypotheses.py: whatever the lane, one of the few starting points is it, and the fit from there is the best."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from roads import Lane7, joined, points, points_on_lane

from lanelib.hypotheses import (
    BEARINGS,
    BENDS,
    FARTHEST_M,
    MOST_VOTERS,
    X_BINS_M,
    X_REACH_M,
    X_STEP_M,
    hypotheses,
    partners,
    refined_lines,
    single_lines,
    votes,
)
from lanelib.jointfit import UNKNOWN_ROAD, WIDTH, differ, fit, holds_car, line_x

# offset, heading, bend (R from 60 m on, either way), width, pitch in degrees
lanes = st.builds(
    lambda c, h, k, w, p: Lane7(c, h, k / 2, 0.0, w, np.radians(p)),
    st.floats(-1, 1),
    st.floats(-0.1, 0.1),
    st.floats(-1 / 60, 1 / 60),
    st.floats(3.2, 4.2),
    st.floats(-1, 1),
)


def best_fit(p):
    return max((fit(p, start) for start in hypotheses(p)), key=lambda f: f.energy)


def dashed(lane, phase=2.0):
    """Solid on the left, 3.66 m of paint every 14.63 m on the right."""
    return points_on_lane(lane, gaps={1: (3.66, 14.63, phase)})


@settings(max_examples=40, deadline=None)
@given(lanes, st.floats(0, 14))
@example(Lane7(0.9, -0.09, 1 / 120, 0, 3.3, 0.015), 3.0)
@example(Lane7(-0.9, 0.09, -1 / 120, 0, 4.1, -0.015), 9.0)
def test_the_best_fit_is_the_lane(lane, phase):
    p = dashed(lane, phase)
    assert not differ(best_fit(p).mean, lane.mean)


def test_the_lane_is_among_the_hypotheses():
    """Of 100 random lanes with a dashed line: for at least 95 a start is already the lane, and from every one
    the best fit is; the line with more paint then lies within 5 cm to 20 m for nine of ten."""
    rng, among, worst, at = np.random.default_rng(11), 0, [], np.array([0.0, 6, 12, 20])
    for _ in range(100):
        c, h, k, w, p = rng.uniform(-1, 1, 5)
        lane = Lane7(c, 0.1 * h, k / 120, 0.0, 3.6 + 0.5 * w, np.radians(p))
        dashes = dashed(lane, rng.uniform(0, 14))
        starts = hypotheses(dashes)
        assert 1 <= len(starts) <= 4
        among += any(not differ(start, lane.mean) for start in starts)
        found = best_fit(dashes)
        assert not differ(found.mean, lane.mean)
        worst.append(np.abs(line_x(at, found.mean, -1) - lane.x(at, -1)).max())
    assert among >= 95
    assert np.percentile(worst, 90) < 0.05


@settings(max_examples=20, deadline=None)
@given(lanes, st.integers(0, 99))
def test_clutter_does_not_hide_it(lane, seed):
    """Half as many points again anywhere on the road, and those on the lines scattered by 1 px."""
    rng, p = np.random.default_rng(seed), dashed(lane)
    n = len(p) // 2
    y = 1 / rng.uniform(1 / 60, 1 / 4, n)
    clutter = points(rng.uniform(-8, 8, n) / y, 1 / y, rng.integers(0, 136, n), rng.uniform(0, 1, n))
    p = points(p.bearing + rng.normal(0, 1, len(p)) / p.focal_px, p.inverse, p.row, p.weight)
    assert not differ(best_fit(joined(p, clutter)).mean, lane.mean)


@pytest.mark.parametrize("radius_m", [-60, 45, -35, 30])
def test_a_hairpin_is_found(radius_m):
    """Bends so tight that they leave the view within 20 m, as a straight Hough line would never see them."""
    lane = Lane7(0.2, 0.05, -1 / (2 * radius_m), width=3.5)
    p = points_on_lane(lane, y_m=np.linspace(0.55 * abs(radius_m), 4, 80))
    found = best_fit(p)
    at = np.array([4.0, 8, 12])
    assert max(np.abs(line_x(at, found.mean, s) - lane.x(at, s)).max() for s in (-1, 1)) < 0.15


def test_each_hypothesis_is_another_lane():
    """Three lanes side by side: 3.6 m each, the middle one ours."""
    ours = Lane7(width=3.6, heading=0.01)
    p = joined(points_on_lane(ours), dashed(Lane7(3.6, 0.01, width=3.6)), dashed(Lane7(-3.6, 0.01, width=3.6)))
    starts = hypotheses(p)
    assert all(differ(a, b) for i, a in enumerate(starts) for b in starts[:i])
    assert not differ(best_fit(p).mean, ours.mean)
    assert len(hypotheses(p, count=1)) == 1


def test_starts_that_are_worth_too_little_are_left_out():
    """Two lanes beside each other, ours with less paint: what is asked for decides which of them are named."""
    p = joined(dashed(Lane7(0.9, width=3.6)), points_on_lane(Lane7(-2.7, width=3.6)))
    estimated, means = partners(p, single_lines(p), UNKNOWN_ROAD)
    worth = {tuple(mean): energy for energy, mean in zip(estimated, means, strict=True)}
    starts = hypotheses(p)
    energies = [worth[tuple(start)] for start in starts]
    assert len(starts) > 1 and energies == sorted(energies, reverse=True)
    between = (energies[0] + energies[1]) / 2
    assert np.array_equal(hypotheses(p, least_energy=between), starts[:1])
    assert hypotheses(p, least_energy=energies[0] + 1e-6) == []


@pytest.mark.parametrize("bend", [0.0, 1 / 160])
def test_the_oncoming_lane_is_not_ours_however_clear_its_lines(bend):
    """Forest road: double line and far edge line in the sun, our own edge line a few specks in the shade."""
    theirs, ours = Lane7(-2.45, 0.0, bend, width=2.9), Lane7(0.45, 0.0, bend, width=2.9)
    specks = points_on_lane(ours, y_m=np.linspace(8, 20, 9), sides=(1,))
    starts = hypotheses(joined(points_on_lane(theirs), specks))
    assert starts and all(holds_car(start) for start in starts)
    assert any(not differ(start, ours.mean) for start in starts)


@pytest.mark.parametrize("side", [-1, 1])
def test_one_line_is_enough_for_a_lane_of_the_usual_width(side):
    lane = Lane7(0.2, 0.02, -1 / 500, width=3.6)
    found = best_fit(points_on_lane(lane, sides=(side,)))
    at = np.array([0.0, 6, 12, 20])
    assert np.abs(line_x(at, found.mean, side) - lane.x(at, side)).max() < 0.05
    assert found.mean[WIDTH] == pytest.approx(UNKNOWN_ROAD.mean[WIDTH], abs=0.4)


def test_without_paint_there_is_no_hypothesis():
    assert hypotheses(points_on_lane(Lane7(), sides=())) == []
    assert hypotheses(points_on_lane(Lane7(), y_m=[8.0])) == []
    few = points_on_lane(Lane7(), y_m=[8.0, 9.0, 10.0])
    assert all(np.isfinite(start).all() for start in hypotheses(few))


def test_votes_peak_at_the_line():
    """A straight line at x = -1.75, heading 0.04: the peak bin holds it, and nearly all of its weight."""
    lane = Lane7(centre=0.1, heading=0.04, width=3.7 / np.hypot(1, 0.04))
    p = points_on_lane(lane, sides=(-1,))
    table = votes(p)
    # the best of the coarse bins holds most of the paint between the car and 45 m that has a vote
    assert table.max() > 0.6 * min(p.weight[p.inverse > 1 / 45].sum(), MOST_VOTERS)
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
    table, near = votes(p), p.inverse > 1 / FARTHEST_M
    y, bearing, weight = 1 / p.inverse[near], p.bearing[near], p.weight[near]
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


def test_lines_refined_together_are_those_refined_alone():
    p = joined(dashed(Lane7(0.2, 0.03, 1 / 500)), clutter(60, 3))
    starts = np.array([[0, 1e-3, 0.02, -1.5], [0, 0, 0.05, 2.2], [0, -2e-3, 0.0, 1.9]])
    together = refined_lines(p, starts)
    for start, line in zip(starts, together, strict=True):
        np.testing.assert_allclose(refined_lines(p, start[None])[0], line, rtol=1e-9, atol=1e-12)
    assert refined_lines(p, np.empty((0, 4))).shape == (0, 4)
