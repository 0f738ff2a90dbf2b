"""jointfit.py: exact points give back the truth, derivatives are numeric ones, one line carries the other."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import Lane7, joined, points, points_on_lane

from lanelib import jointfit
from lanelib.jointfit import (
    BEND,
    CENTRE,
    HEADING,
    HILL,
    NEIGHBOURS,
    PITCH,
    RATE,
    TRACK_GATES,
    UNKNOWN_ROAD,
    WIDTH,
    Prior,
    differ,
    distance,
    energy_of,
    fit,
    fits,
    landmarks,
    line_x,
    rate_std,
    support_of,
    supported_rows,
)
from lanelib.lane import Surface

STD = np.sqrt(np.diag(UNKNOWN_ROAD.covariance))
NO_PRIOR = Prior(UNKNOWN_ROAD.mean, UNKNOWN_ROAD.covariance * 1e6)
WINDING = Lane7(centre=0.4, heading=-0.05, bend=1 / 240, rate=-2e-5, width=3.4, pitch=np.radians(0.5))

ROWS_M = np.linspace(1 / np.sqrt(90), 1 / np.sqrt(4), 136) ** -2.0  # the rows of points_on_lane

within = st.tuples(*[st.floats(-1.5, 1.5)] * 6)
nudge = st.tuples(*[st.floats(-0.06, 0.06)] * 6)  # of a bend that is 0.9 m at 50 m


def truth(numbers) -> Lane7:
    """A lane so many standard deviations of an unknown road away from its mean, without a hill."""
    return Lane7(*(UNKNOWN_ROAD.mean + STD * (*numbers, 0)))


def off(found, lane, at=(0.0, 6.0, 15.0, 30.0)):
    """Largest distance in x between fitted and true lines, m."""
    at = np.array(at)
    return max(np.abs(line_x(at, found.mean, side) - lane.x(at, side)).max() for side in (-1, 1))


# ---------------------------------------------------------------------------------------------- exact points
@settings(max_examples=50, deadline=None)
@given(within, nudge, st.floats(0.9, 2.0), st.floats(1000, 2000))
def test_exact_points_give_back_all_numbers(numbers, start, height_m, focal_px):
    """From a start up to 1 m off at 50 m, as hypotheses are, under a prior as vague as the finder's, and right."""
    lane = truth(0.7 * np.array(numbers))
    start, prior = lane.mean + STD * (*start, 0), Prior(lane.mean, UNKNOWN_ROAD.covariance)
    found = fit(points_on_lane(lane, height_m=height_m, focal_px=focal_px), start, prior=prior)
    assert np.abs((found.mean - lane.mean) / STD).max() < 2e-3
    assert found.rms_px < 0.05


@settings(max_examples=30, deadline=None)
@given(within)
def test_what_fits_exactly_is_left_alone(numbers):
    """The truth is a stationary point: one more step from it goes nowhere."""
    lane = truth(numbers)
    found = fit(points_on_lane(lane), lane.mean, prior=Prior(lane.mean, UNKNOWN_ROAD.covariance), gates=(4,))
    np.testing.assert_allclose((found.mean - lane.mean) / STD, 0, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(within, st.floats(-1, 1))
def test_a_hill_is_seen_through(numbers, hill):
    """Crests and dips down to a radius of 6 km, with the prior that the finder uses: the lines to 30 m within 20 cm.

    Pitch and hill trade with each other, and the prior pulls at the wildest of these roads; the lines hold."""
    lane = Lane7(*(*truth(0.6 * np.array(numbers)).mean[:HILL], hill * STD[HILL]))
    assert off(fit(points_on_lane(lane), lane.mean), lane) < 0.2


# ---------------------------------------------------------------------------------------------- derivatives
@pytest.mark.parametrize("lane", [WINDING, Lane7(), Lane7(-0.9, 0.12, -1 / 160, 3e-5, 4.1, np.radians(-0.9))])
def test_the_information_is_that_of_numeric_derivatives(lane):
    """The fit's covariance, inverted and without the prior, is J' W J with J by central differences of the independent
    formula in roads.py: every column of the analytic Jacobian counts."""
    p = points_on_lane(lane)
    found = fit(p, lane.mean, prior=Prior(lane.mean, UNKNOWN_ROAD.covariance), gates=TRACK_GATES, reach_m=(1e3,))
    information = np.linalg.inv(found.covariance) - np.linalg.inv(UNKNOWN_ROAD.covariance)
    roads_allow = min(rate_std(lane.mean) ** 2, UNKNOWN_ROAD.covariance[RATE, RATE])
    information[RATE, RATE] -= 1 / roads_allow - 1 / UNKNOWN_ROAD.covariance[RATE, RATE]
    y = exact_distance(p.inverse, lane, p.height_m)
    side_of_point = np.where(p.bearing > lane.x(y, 0) / y, 1, -1)
    jacobian = np.empty((len(p), 7))
    for i in range(7):
        step = np.zeros(7)
        step[i] = 1e-4 * STD[i]
        ends = []
        for sign in (-1, 1):
            moved = Lane7(*(lane.mean + sign * step))
            y = exact_distance(p.inverse, moved, p.height_m)
            ends.append(np.where(side_of_point > 0, moved.x(y, 1), moved.x(y, -1)) / y)
        jacobian[:, i] = (ends[1] - ends[0]) / (2e-4 * STD[i])
    weight = p.weight / NEIGHBOURS / p.std**2
    expected = (jacobian * weight[:, None]).T @ jacobian
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(information / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-4)


def exact_distance(inverse, lane, height_m):
    """y of inverse = 1/y - hill y / (2 h) - pitch / h, the quadratic solved."""
    q, c = inverse + lane.pitch / height_m, lane.hill / (2 * height_m)
    return 2 / (q + np.sqrt(q * q + 4 * c))


def test_distance_undoes_the_surface():
    """Out to the rig's plane through ``Surface``, and back through ``distance``."""
    y = np.array([5.0, 12, 25, 50, 80])
    for pitch, hill, tolerance in ((0, 0, 1e-9), (0.012, 0, 1e-9), (-0.01, 1 / 9000, 0.03), (0.005, -1 / 9000, 0.03)):
        flat = Surface(1.3, pitch, hill).flat_from_road(np.column_stack([np.zeros(5), y]))
        mean = Lane7(pitch=pitch, hill=hill).mean
        back = distance(1 / flat[:, 1], mean, 1.3)
        assert np.abs(back / y - 1)[:4].max() < tolerance


# ---------------------------------------------------------------------------------------------- geometry
@pytest.mark.parametrize("lane", [WINDING, Lane7(bend=1 / 120), Lane7(heading=0.25, bend=-1 / 400, width=3.1)])
def test_the_two_lines_are_a_width_apart_measured_across(lane):
    """Nearest distance from points of one line to a fine polyline of the other: not the gap along x, which is wider.

    The formula shifts along x by the slope at the same y: exact for straight lanes, 5 cm off at 25 m of R 60 m."""
    y = np.linspace(-8, 60, 40000)
    other = np.column_stack([line_x(y, lane.mean, 1), y])
    for at in (0.0, 5.0, 12.0, 25.0):
        here = np.array([line_x(at, lane.mean, -1), at])
        across = np.linalg.norm(other - here, axis=1).min()
        assert across == pytest.approx(lane.width, abs=0.06)
        gap = line_x(at, lane.mean, 1) - line_x(at, lane.mean, -1)
        slope = np.polyval([3 * lane.rate, 2 * lane.bend, lane.heading], at)
        assert gap == pytest.approx(lane.width * np.hypot(1, slope))
    np.testing.assert_allclose(line_x(y, lane.mean, -1), lane.x(y, -1), atol=1e-12)


def test_a_fit_becomes_a_lane_in_metres():
    """Offset, width, curvature with their signs, the surface, and how far each line was seen."""
    lane = Lane7(centre=-0.35, heading=0.03, bend=-1 / 600, width=3.5, pitch=0.004)
    y0 = 1 / (1 / ROWS_M - lane.pitch / 1.3)  # where the rows lie on the rig's flat plane
    found = fit(points_on_lane(lane, gaps={1: (3.66, 14.63, 6.0)}), lane.mean)
    metric = found.lane(4.0, y0)
    assert metric.offset_m == pytest.approx(0.35, abs=0.01)
    assert metric.curvature_1pm == pytest.approx(2 / 600, rel=0.03)
    assert float(metric.width_m()) == pytest.approx(3.5, abs=0.01)
    assert (metric.surface.pitch_rad, metric.surface.height_m) == (found.mean[PITCH], 1.3)
    at = np.array([0.0, 5, 20, 40])
    assert np.abs(metric.left.x(at) - lane.x(at, -1)).max() < 0.02
    assert np.abs(metric.right.x(at) - lane.x(at, 1)).max() < 0.02
    assert metric.left.y_range_m[1] > 80 and metric.right.y_range_m[1] < 69  # the last dash ends at 68.2 m
    assert found.rows == (metric.left.support, metric.right.support) == tuple(found.support.sum(axis=1))
    for line, side in ((metric.left, -1), (metric.right, 1)):  # x(0) = centre + side width / 2
        c, w, both = (found.covariance[i, j] for i, j in ((CENTRE, CENTRE), (WIDTH, WIDTH), (CENTRE, WIDTH)))
        assert line.std_x_m(0.0) == pytest.approx(np.sqrt(c + w / 4 + side * both))
        assert line.covariance[1, 1] == pytest.approx(found.covariance[BEND, BEND])
    assert metric.std["offset_m"] == pytest.approx(np.sqrt(found.covariance[CENTRE, CENTRE]))
    assert metric.std["curvature_1pm"] == pytest.approx(2 * np.sqrt(found.covariance[BEND, BEND]))


def test_a_double_lines_inward_shift_moves_its_boundary():
    lane = Lane7(centre=0.2)
    found = replace(fit(points_on_lane(lane), lane.mean), inward_m=(0.12, 0.0))
    metric = found.lane(4.0, ROWS_M)
    assert float(metric.left.x(0)) == pytest.approx(lane.x(0, -1) + 0.12, abs=0.005)
    assert float(metric.right.x(0)) == pytest.approx(lane.x(0, 1), abs=0.005)


# ---------------------------------------------------------------------------------------------- hard evidence
def noisy(p, rng, *, px=1.0):
    """Points scattered by a standard deviation in pixels of the frame."""
    return points(
        p.bearing + rng.normal(0, px, len(p)) / p.focal_px, p.inverse, p.row, p.weight, p.focal_px, p.height_m, p.n_rows
    )


def test_one_dash_is_carried_by_the_other_line():
    """All there is of the right line is one dash, 9 to 12.7 m ahead, scattered by 1 px: a parabola through it is metres
    off at 25 m."""
    rng, together, alone, gaps = np.random.default_rng(2), [], [], {1: (3.66, 1000.0, 9.0)}
    for _ in range(10):
        p = noisy(points_on_lane(WINDING, gaps=gaps), rng)
        found = fit(p, WINDING.mean + STD * rng.normal(0, 0.05, 7))
        together.append(abs(line_x(25.0, found.mean, 1) - WINDING.x(25.0, 1)))
        dash = noisy(points_on_lane(WINDING, sides=(1,), gaps=gaps), rng)
        y = exact_distance(dash.inverse, WINDING, dash.height_m)
        alone.append(abs(np.polyval(np.polyfit(y, dash.bearing * y, 2), 25.0) - WINDING.x(25.0, 1)))
    assert np.median(together) < 0.1 and max(together) < 0.25
    assert np.median(alone) > 3 * np.median(together)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_missing_line_is_a_usual_width_away(side):
    """Nothing tells the width: the prior does, and the fit says how little it knows."""
    lane = Lane7(centre=0.3, heading=0.02, bend=1 / 500, width=3.5)
    found = fit(points_on_lane(lane, sides=(side,)), lane.mean + STD * 0.2)
    at = np.array([0.0, 6, 15])
    assert (
        np.abs(line_x(at, found.mean, side) - lane.x(at, side)).max() < 0.03
    )  # pitch is unknown, too: distances shift
    assert abs(found.mean[WIDTH] - UNKNOWN_ROAD.mean[WIDTH]) < 0.2
    std = np.sqrt(np.diag(found.covariance))
    both = np.sqrt(np.diag(fit(points_on_lane(lane), lane.mean).covariance))
    assert std[WIDTH] > 0.15 > 5 * both[WIDTH]
    assert found.support[(0 if side > 0 else 1)].sum() == 0


def test_clutter_does_not_pull_the_lane():
    """As many points anywhere on the road as there are on the lines."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        p = noisy(points_on_lane(WINDING), rng)
        n = len(p)
        y = 1 / rng.uniform(1 / 60, 1 / 4, n)
        anywhere = points(
            rng.uniform(-8, 8, n) / y, 1 / y, rng.integers(0, 136, n), rng.uniform(0.2, 1, n), 1100.0, 1.3
        )
        assert off(fit(joined(p, anywhere), WINDING.mean + STD * rng.normal(0, 0.2, 7)), WINDING) < 0.05


@pytest.mark.parametrize("beside", [-0.7, 0.6])
def test_a_seam_beside_a_dashed_line_does_not_take_it_away(beside):
    """An unbroken line of points 0.6 m beside the dashes, with three times as many points, each half as clear: a fit of
    that side alone would follow it. The left line and the lane's own width hold against it."""
    lane = Lane7(centre=-0.1, heading=0.01, bend=-1 / 700, width=3.7)
    lane_points = points_on_lane(lane, gaps={1: (3.66, 14.63, 5.0)})
    seam = points_on_lane(Lane7(lane.centre + beside, lane.heading, lane.bend, 0, lane.width), sides=(1,))
    seam = points(seam.bearing, seam.inverse, seam.row, 0.5 * seam.weight, 1100.0, 1.3)
    found = fit(joined(lane_points, seam), lane.mean + STD * 0.1)
    assert off(found, lane) < 0.3  # less than half of the way
    wrong = fit(joined(lane_points, seam), lane.mean + np.array([beside / 2, 0, 0, 0, beside, 0, 0]))
    assert found.energy > wrong.energy - 12  # the seam may be solid, but the lane has to be a lane


def test_lines_that_drift_apart_are_pitch_and_not_a_wider_lane():
    for degrees in (-1.0, 0.8):
        lane = Lane7(width=3.6, pitch=np.radians(degrees))
        found = fit(points_on_lane(lane), UNKNOWN_ROAD.mean)
        assert np.degrees(found.mean[PITCH]) == pytest.approx(degrees, abs=0.03)
        assert found.mean[WIDTH] == pytest.approx(3.6, abs=0.01)


# ---------------------------------------------------------------------------------------------- uncertainty
def test_the_covariance_covers_the_scatter():
    """Independent errors of one standard deviation per point. The fit counts NEIGHBOURS points as one, because crests
    along real paint share their error: against independent ones it must say sqrt(8) times the scatter, not less than
    half and not more than twice that."""
    rng = np.random.default_rng(6)
    p = points_on_lane(WINDING)
    found = []
    for _ in range(60):
        scattered = p.bearing + rng.normal(0, 1, len(p)) * p.std
        found.append(fit(points(scattered, p.inverse, p.row, p.weight, 1100.0, 1.3), WINDING.mean, prior=NO_PRIOR))
    scatter = np.std([f.mean for f in found], axis=0)
    said = np.sqrt(np.mean([np.diag(f.covariance) for f in found], axis=0))
    ratio = said[:RATE] / scatter[:RATE] / np.sqrt(NEIGHBOURS)
    assert ratio.min() > 0.5 and ratio.max() < 2, ratio


def test_less_paint_is_less_sure():
    far = points_on_lane(WINDING, y_m=np.linspace(40, 8, 60))
    near = points_on_lane(WINDING, y_m=np.linspace(14, 8, 60))
    prior = UNKNOWN_ROAD
    spread = [np.sqrt(np.diag(fit(p, WINDING.mean, prior=prior).covariance)) for p in (far, near)]
    assert (spread[1][[HEADING, BEND]] > 1.5 * spread[0][[HEADING, BEND]]).all()
    assert (spread[1] <= STD * 1.001).all()


def test_no_points_leave_the_prior():
    none = points_on_lane(WINDING, y_m=[], sides=())
    found = fit(none, WINDING.mean, prior=UNKNOWN_ROAD)
    np.testing.assert_allclose(found.mean, UNKNOWN_ROAD.mean, atol=1e-12)
    believed = np.diag(UNKNOWN_ROAD.covariance).copy()
    believed[RATE] = min(believed[RATE], rate_std(found.mean) ** 2)
    np.testing.assert_allclose(found.covariance, np.diag(believed), rtol=1e-6, atol=1e-18)
    assert found.energy == pytest.approx(0, abs=1e-9) and found.support.sum() == 0


def test_a_prior_pulls_as_a_measurement_would():
    """The posterior of a prior and of points is that of two independent sources: informations add."""
    p = points_on_lane(WINDING, y_m=np.linspace(20, 8, 40))
    tight, loose = (np.diag(UNKNOWN_ROAD.covariance) * factor for factor in (0.01, 1e6))
    tight[RATE] = loose[RATE] = 1e-14  # tighter than what a road's curvature may change by, which would come on top
    posterior = [
        np.linalg.inv(fit(p, WINDING.mean, prior=Prior(WINDING.mean, np.diag(c))).covariance) for c in (tight, loose)
    ]
    scale = np.sqrt(np.diag(posterior[0]))
    difference = posterior[0] - posterior[1] - np.diag(1 / tight - 1 / loose)
    np.testing.assert_allclose(difference / np.outer(scale, scale), 0, atol=1e-3)


@pytest.mark.parametrize(("bend", "rate", "more"), [(0.0, 0.0, False), (1 / 200, 0.0, True), (0.0, 5e-5, True)])
def test_a_winding_road_may_change_its_curvature_faster(bend, rate, more):
    straight = rate_std(Lane7().mean)
    assert (rate_std(Lane7(bend=bend, rate=rate).mean) > 3 * straight) == more
    assert rate_std(Lane7(bend=-bend, rate=-rate).mean) == rate_std(Lane7(bend=bend, rate=rate).mean)


# ---------------------------------------------------------------------------------------------- worth
def test_support_counts_rows_once_and_only_near_the_line():
    lane = Lane7(width=3.6)
    p = points_on_lane(lane)
    support, rms = supported_rows(p, lane.mean)
    assert support.shape == (2, 136) and support.min() >= 0 and support.max() <= 1
    np.testing.assert_allclose(support, 1.0)
    assert rms < 1e-6
    twice, _ = supported_rows(joined(p, p), lane.mean)
    np.testing.assert_allclose(twice, support)
    assert supported_rows(p, Lane7(centre=1.0, width=3.6).mean)[0][:, 68:].sum() == 0


def test_support_is_less_where_points_are_faint_or_beside_the_line():
    """Each point: its weight times 1 - (z / 3)^2; of a row the best one; the rms weighted as the points are."""
    lane = Lane7(width=3.6)
    p = points_on_lane(lane, y_m=[8.0, 9.0, 10.0], sides=(1,))
    p = points(p.bearing, p.inverse, p.row, np.array([1.0, 0.5, 0.8]))
    z = np.array([0.0, 1.0, 2.0])
    support, rms = support_of(p, np.ones(3, bool), z)
    np.testing.assert_allclose(support[1, p.row], p.weight * (1 - np.square(z / 3)))
    assert support[0].sum() == 0 and np.count_nonzero(support) == 3
    assert rms == pytest.approx(p.focal_px * np.sqrt(np.average(np.square(z * p.std), weights=p.weight)))


def test_energy_is_paint_less_what_the_prior_objects():
    lane, p = Lane7(), points_on_lane(Lane7())
    support, _ = supported_rows(p, lane.mean)
    one_line = support * [[1], [0]]
    two_halves = support * 0.5
    worth = [energy_of(lane.mean, s, UNKNOWN_ROAD) for s in (support, two_halves, one_line, support * 0)]
    assert worth[0] > worth[1] > worth[2] > worth[3] == 0
    odd = lane.mean + 2 * STD * np.eye(7)[WIDTH]
    assert energy_of(odd, support, UNKNOWN_ROAD) == pytest.approx(worth[0] - 2.0)


def test_differ_tells_another_lane_from_the_same_again():
    lane = WINDING.mean
    assert not differ(lane, lane)
    for i, little, much in ((CENTRE, 0.3, 0.5), (HEADING, 0.02, 0.08), (BEND, 1 / 1000, 1 / 300), (WIDTH, 0.5, 1.0)):
        step = np.eye(7)[i]
        assert not differ(lane, lane + little * step)
        assert differ(lane, lane + much * step) and differ(lane + much * step, lane)


def test_landmarks_are_where_the_lines_are():
    lanes = [WINDING.mean, Lane7().mean, Lane7(0.5, 0.1, 1e-3).mean]
    for lane, marks in zip(lanes, landmarks(np.array(lanes)), strict=True):
        np.testing.assert_allclose(marks, [line_x(y, lane, side) for y in (6.0, 20.0) for side in (-1, 1)])
        np.testing.assert_allclose(landmarks(lane), marks)


def test_points_between_the_lines_do_not_move_a_tracked_lane():
    rng = np.random.default_rng(8)
    p = points_on_lane(WINDING)
    far_off = points(
        rng.uniform(-0.02, 0.02, 200),
        rng.uniform(1 / 20, 1 / 5, 200),
        rng.integers(0, 136, 200),
        np.ones(200),
        1100.0,
        1.3,
    )  # 1 m and more from both lines
    np.testing.assert_allclose(
        fit(joined(p, far_off), WINDING.mean, gates=TRACK_GATES).mean, fit(p, WINDING.mean, gates=TRACK_GATES).mean
    )


def test_width_and_curvature_of_a_fit_are_those_of_its_lines():
    for lane in (WINDING, Lane7(0.4, 0.08, 1 / 300, width=3.2), Lane7(-0.5, -0.2, -1 / 60)):
        found = replace(fit(points_on_lane(lane), lane.mean), inward_m=(0.1, 0.05))
        lines = found.lane(4.0, 1 / np.linspace(1 / 60, 1 / 4, 136))
        assert found.width_m == pytest.approx(lines.width_m(), abs=0.01)
        at_centre = [line.curvature_1pm() / (1 - side * line.curvature_1pm() * found.width_m / 2)
                     for line, side in ((lines.left, -1), (lines.right, 1))]
        assert found.curvature_1pm == pytest.approx(np.mean(at_centre), rel=0.05)


def test_wild_starts_and_points_stay_finite():
    rng = np.random.default_rng(9)
    for scale in (1, 5, 30):
        p = points(rng.normal(0, scale, 50), rng.uniform(1e-3, 1, 50), rng.integers(0, 136, 50), rng.uniform(0, 1, 50))
        found = jointfit.fit(p, UNKNOWN_ROAD.mean + scale * STD * rng.normal(0, 1, 7))
        assert np.isfinite(found.mean).all() and np.isfinite(found.covariance).all() and np.isfinite(found.energy)
        assert 2.0 <= found.mean[WIDTH] <= 6.0


def test_several_starts_at_once_are_fitted_as_one_by_one():
    """And a start far away does not touch its neighbour."""
    points = points_on_lane(Lane7(centre=0.2, bend=1 / 800))
    starts = [UNKNOWN_ROAD.mean, UNKNOWN_ROAD.mean + 0.5 * STD, UNKNOWN_ROAD.mean - 3 * STD]
    together = fits(points, starts)
    for start, found in zip(starts, together, strict=True):
        alone = fit(points, start)
        for name in ("mean", "covariance", "support"):
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-9, atol=1e-12)
        assert (found.energy, found.rms_px) == pytest.approx((alone.energy, alone.rms_px))
    assert fits(points, []) == []
