"""hypotheses.py: whatever the lane, one of the few starting points is it, and the fit from there is the best."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from roads import Lane7, joined, points, points_on_lane

from lanelib.hough import single_lines
from lanelib.hypotheses import APART_M, APART_PITCH, hypotheses, partners
from lanelib.jointfit import PITCH, UNKNOWN_ROAD, WIDTH, differ, fit, holds_car, landmarks, line_x

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
    assert len(starts) > 1
    for i, a in enumerate(starts):
        assert all((np.abs(landmarks(a) - landmarks(b)) > APART_M).any() for b in starts[:i])
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
def test_a_lane_beside_the_car_is_no_start(side):
    """Both lines of it solid, and of ours one dashed: what does not hold the car is not ours, but it was seen."""
    beside = Lane7(2.2 * side, width=2.7)
    p = joined(points_on_lane(beside), points_on_lane(Lane7(), y_m=np.linspace(7, 20, 16), sides=(-side,)))
    starts = hypotheses(p)
    assert starts and all(holds_car(start) for start in starts)
    _, means = partners(p, single_lines(p), UNKNOWN_ROAD)
    assert any(not differ(mean, beside.mean) for mean in means)


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


def dots(lane, phase, sides=(-1, 1)):
    """Botts' dots: four in a row every 14.6 m, each a row or two of faint paint."""
    y = np.concatenate([phase + 14.63 * k + 1.22 * np.arange(4) for k in range(3)])
    p = points_on_lane(lane, y_m=y, sides=sides)
    return points(p.bearing, p.inverse, p.row, 0.6 * p.weight)


@pytest.mark.parametrize("phase", [5.0, 8.0, 12.0])
@pytest.mark.parametrize("bend", [0.0, 1 / 1400])
def test_solid_lines_beside_the_neighbours_do_not_hide_our_dots(phase, bend):
    """The middle one of three lanes: our lines are dots, the road's edges are solid and have ten times their paint."""
    ours = Lane7(0.2, 0.01, bend, width=3.6)
    edges = points_on_lane(Lane7(0.2, 0.01, bend, width=3 * 3.6))
    p = joined(dots(ours, phase), edges)
    assert edges.weight.sum() > 8 * dots(ours, phase).weight.sum()
    starts = hypotheses(p)
    assert starts and all(holds_car(start) for start in starts)
    inside = [found for found in (fit(p, start) for start in starts) if holds_car(found.mean, beside_m=0.0)]
    assert not differ(max(inside, key=lambda f: f.energy).mean, ours.mean)


def test_the_lane_that_is_known_is_not_named_again():
    p = joined(dashed(Lane7(0.9, width=3.6)), points_on_lane(Lane7(-2.7, width=3.6)))
    starts = hypotheses(p)
    for known in starts:
        others = hypotheses(p, known=known)
        near = [(np.abs(landmarks(start) - landmarks(known)) <= APART_M).all() for start in others]
        pitch = [abs(start[PITCH] - known[PITCH]) <= APART_PITCH for start in others]
        assert not any(a and b for a, b in zip(near, pitch, strict=True))
    assert len(hypotheses(p, known=np.array([99.0, 0, 0, 0, 3.6, 0, 0]))) == len(starts)
