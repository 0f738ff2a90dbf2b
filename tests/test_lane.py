"""lane.py: fits against synthetic truth and numpy, arcs against their radius, each check against what breaks it."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import camera_from_road

from lanelib.birdseye import Grid
from lanelib.errors import LanelibError
from lanelib.lane import Lane, Limits, Line, NoLine, Surface, check_lane, fit_line, radius_of
from lanelib.windows import pixel_coefficients


def arc(radius_m, *, left: bool, x0_m=0.0, y_m=None):
    """Points of a circle that touches the direction of travel at (x0, 0); its centre is on the side it bends to."""
    y = np.linspace(0, 30, 120) if y_m is None else y_m
    bulge = radius_m - np.sqrt(radius_m**2 - y**2)
    return x0_m + (-bulge if left else bulge), y


# ---------------------------------------------------------------------------------------------- fit_line
@settings(max_examples=50, deadline=None)
@given(st.floats(-0.01, 0.01), st.floats(-0.4, 0.4), st.floats(-6, 6), st.integers(0, 9))
def test_exact_points_give_back_their_polynomial(a, b, c, seed):
    y = np.random.default_rng(seed).uniform(3.0, 45.0, 40)
    line = fit_line(np.polyval([a, b, c], y), y)
    np.testing.assert_allclose(line.coefficients, [a, b, c], atol=1e-8)
    assert line.y_range_m == (y.min(), y.max())


@pytest.mark.parametrize("order", [1, 2, 3])
def test_without_robustness_it_is_numpys_polyfit(order):
    rng = np.random.default_rng(order)
    y, x, w = rng.uniform(4, 60, 80), rng.normal(0, 1, 80), rng.uniform(0.1, 1, 80)
    line = fit_line(x, y, w, order=order, robust=False)
    expected = np.polyfit(y, x, order, w=np.sqrt(w))  # numpy's weights are those of the residual, not of its square
    np.testing.assert_allclose(line.coefficients, expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.2, 0.4])
def test_outliers_on_one_side_do_not_pull_the_line(share, seed):
    """A second stripe 0.4-3 m to the right of the line: the mean of all points lies 0.3 m and more off."""
    rng = np.random.default_rng(seed)
    y = rng.uniform(4, 40, 200)
    truth = np.array([-1 / 900, 0.03, 1.7])
    x = np.polyval(truth, y) + rng.normal(0, 0.02, 200)
    wrong = rng.random(200) < share
    x[wrong] += rng.uniform(0.4, 3, wrong.sum())
    at = np.linspace(4, 40, 9)
    assert np.abs(np.polyval(np.polyfit(y, x, 2) - truth, at)).max() > 0.25
    assert np.abs(fit_line(x, y).x(at) - np.polyval(truth, at)).max() < 0.03


def test_a_heavy_point_counts_as_often_as_it_weighs():
    rng = np.random.default_rng(5)
    y = rng.uniform(4, 40, 60)
    x = np.polyval([0.001, 0.02, -1.6], y) + rng.normal(0, 0.05, 60)
    copies = rng.integers(1, 4, 60)
    weighted = fit_line(x, y, copies, robust=False)
    repeated = fit_line(np.repeat(x, copies), np.repeat(y, copies), robust=False)
    np.testing.assert_allclose(weighted.coefficients, repeated.coefficients, atol=1e-9)
    np.testing.assert_allclose(
        fit_line(x, y, (y < 25), robust=False).coefficients,
        fit_line(x[y < 25], y[y < 25], robust=False).coefficients,
        atol=1e-9,
    )


@pytest.mark.parametrize("robust", [False, True])
def test_the_covariance_is_the_scatter_of_repeated_measurements(robust):
    """300 noisy drawings of one line: the scatter of x at three distances is what each fit says of itself."""
    rng = np.random.default_rng(1)
    y, at = np.linspace(4, 35, 60), np.array([0.0, 10.0, 30.0])
    truth = np.polyval([0.0012, -0.01, 1.8], y)
    lines = [fit_line(truth + rng.normal(0, 0.06, 60), y, robust=robust) for _ in range(300)]
    scatter = np.std([line.x(at) for line in lines], axis=0)
    said = np.sqrt(np.mean([line.std_x_m(at) ** 2 for line in lines], axis=0))
    # the scatter of 300 is known to 4 %; the biweight loses 5 % and its residual variance is 7 % low
    np.testing.assert_allclose(said, scatter, rtol=0.2)
    if not robust:
        _, numpys = np.polyfit(y, truth + rng.normal(0, 0.06, 60), 2, cov=True)
        np.testing.assert_allclose(np.sqrt(np.diag(lines[0].covariance)), np.sqrt(np.diag(numpys)), rtol=0.35)


WEIGHTS = {
    "a ramp": np.linspace(0.05, 1, 60),
    "one of 15": np.r_[np.ones(30), 15, np.ones(29)],
    "one of 100": np.r_[np.ones(30), 100, np.ones(29)],
    "four points": np.array([1.0, 2, 3, 1]),
    "three points": np.array([1.0, 2, 1]),
}


@pytest.mark.parametrize(
    ("name", "robust"), [(name, robust) for name, w in WEIGHTS.items() for robust in (False, True)[: 1 + (len(w) > 9)]]
)
def test_the_covariance_is_that_of_noise_as_the_weights_say(name, robust):
    """Each point scatters by 5 cm / sqrt(weight), where 5 cm are those of the mean weight; the mean of all that the
    fits say is their scatter. Three points leave nothing to judge the noise by, and four points almost nothing."""
    w = WEIGHTS[name]
    rng, y, at = np.random.default_rng(1), np.linspace(4, 35, len(w)), np.array([0.0, 10.0, 30.0])
    truth, sigma = np.polyval([0.0012, -0.01, 1.8], y), 0.05 * np.sqrt(w.mean() / w)
    lines = [fit_line(truth + rng.normal(0, sigma), y, w, robust=robust) for _ in range(300)]
    scatter = np.std([line.x(at) for line in lines], axis=0)
    said = np.sqrt(np.mean([line.std_x_m(at) ** 2 for line in lines], axis=0))
    np.testing.assert_allclose(said, scatter, rtol=0.2)


def test_a_common_factor_of_the_weights_says_nothing():
    rng = np.random.default_rng(2)
    y, w = np.linspace(4, 35, 40), rng.uniform(0.2, 1, 40)
    for n in (40, 3):
        x = rng.normal(0, 0.05, n)
        one, other = (fit_line(x, y[:n], w[:n] * factor, robust=False) for factor in (1, 255))
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6)


@pytest.mark.parametrize(
    ("x", "y", "weights", "order"),
    [([1, 2, 3], [1, 2], None, 1), ([1, 2, 3], [1, 2, 3], [1, 1], 1), ([1, 2, 3], [1, 2, 3], None, -1)],
)
def test_what_is_no_set_of_points_is_refused(x, y, weights, order):
    with pytest.raises(LanelibError, match="as many x as y and weights"):
        fit_line(x, y, weights, order=order)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ([], []),
        ([1.0], [5.0]),
        ([1, 2], [5, 6]),
        ([1.0] * 50, [7.0] * 50),
        ([1, 2, 3, 4], [5, 5, 6, 6]),
        ([np.nan] * 9, range(9)),
        ([1.0] * 9, [np.inf] * 9),
    ],
)
def test_points_that_make_no_line_say_so(x, y):
    found = fit_line(x, y)
    assert isinstance(found, NoLine) and not found and "distances, found" in found.reason


def test_points_too_close_together_make_no_line():
    y = 30 + np.linspace(0, 1e-3, 40)
    found = fit_line(np.sin(np.arange(40.0)), y)
    assert not found and found.reason
    assert not fit_line([1.0, 2, 3, 4], [1.0, 2, 3, 4], [0, 0, 1, 1])  # two points left by their weights


def test_bad_points_are_left_out():
    y = np.linspace(4, 40, 30)
    x = np.polyval([0.001, 0, 1.5], y)
    x[3], spoiled = np.nan, y.copy()
    spoiled[7] = np.inf
    weights = np.ones(30)
    x[20], weights[20:22] = 9.0, (np.inf, np.nan)
    np.testing.assert_allclose(fit_line(x, spoiled, weights).coefficients, [0.001, 0, 1.5], atol=1e-9)


# ---------------------------------------------------------------------------------------------- curvature
@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("x0_m", [-1.9, 1.7])
@pytest.mark.parametrize("radius_m", [200, 450, 1000, 3000])
def test_an_arc_comes_out_as_its_radius(radius_m, x0_m, left):
    line = fit_line(*arc(radius_m, left=left, x0_m=x0_m))
    assert line.radius_m() == pytest.approx(radius_m, rel=0.01)
    assert (line.curvature_1pm() > 0) == left


@pytest.mark.parametrize("at_m", [0.0, 10.0, 25.0])
@pytest.mark.parametrize("radius_m", [-250, 250, 800])
def test_an_arc_has_its_radius_at_every_distance(radius_m, at_m):
    """Where the line is no longer straight ahead, the slope in the formula matters: at 25 m of R 250 m 1.5 %."""
    left = radius_m > 0
    line = fit_line(*arc(abs(radius_m), left=left, y_m=np.linspace(at_m - 5, at_m + 5, 60)))
    assert line.radius_m(at_m) == pytest.approx(abs(radius_m), rel=0.01)
    assert np.sign(line.curvature_1pm(at_m)) == np.sign(radius_m)


def test_a_turned_arc_keeps_its_radius():
    """The same circle seen by a car that heads 15 degrees off: A alone would be 10 % wrong."""
    x, y = arc(300, left=True, y_m=np.linspace(-6, 6, 60))
    c, s = math.cos(math.radians(15)), math.sin(math.radians(15))
    line = fit_line(c * x + s * y, c * y - s * x)
    assert line.slope(0) == pytest.approx(math.tan(math.radians(15)), rel=1e-3)
    assert line.radius_m() == pytest.approx(300, rel=0.01)
    assert abs(1 / (2 * line.coefficients[0])) < 0.92 * 300


def test_a_straight_line_is_straight_and_divides_nothing():
    line = fit_line(np.full(20, 1.8), np.linspace(4, 30, 20))
    assert math.isinf(line.radius_m()) and "straight" in repr(line)
    assert math.isinf(Line([0.0, 0.01, 1.0]).radius_m()) and Line([0.0, 0.01, 1.0]).curvature_1pm() == 0
    lane = Lane(Line([0.0, 0.0, -1.8]), Line([0.0, 0.0, 1.8]))
    assert math.isinf(lane.radius_m) and "straight" in repr(lane)
    assert all(check.ok for check in check_lane(lane))
    assert math.isinf(radius_of(0.0)) and radius_of(-1 / 500) == pytest.approx(500)


def test_metres_refitted_are_pixel_coefficients_converted():
    """A bend drawn in pixels of a view whose columns and rows have different metres: two ways to the same numbers."""
    grid = Grid.uniform(x_range_m=(-5, 7), y_range_m=(3, 48), size_wh=(321, 513))
    metres = Line([-1 / 640, 0.07, 1.62])
    rows = np.arange(513)
    columns = grid.column_of(metres.x(grid.y_m))
    in_pixels = np.polyfit(rows, columns, 2)
    np.testing.assert_allclose(pixel_coefficients(metres, grid), in_pixels, rtol=1e-8)
    np.testing.assert_allclose(
        fit_line(grid.x_of(np.polyval(in_pixels, rows)), grid.y_m).coefficients, metres.coefficients, rtol=1e-6
    )


# ---------------------------------------------------------------------------------------------- lane
def lane_of(*, centre=0.0, slope=0.0, bend=0.0, width=3.6, **kwargs) -> Lane:
    w = width * math.sqrt(1 + slope**2) / 2
    return Lane(*(Line([bend, slope, centre + s * w], (4.0, 30.0)) for s in (-1, 1)), **kwargs)


def test_the_offset_says_on_which_side_the_car_is():
    assert lane_of(centre=-0.30).offset_m == pytest.approx(0.30)  # the lane's centre lies left: the car is right of it
    assert "0.30 m right of centre" in repr(lane_of(centre=-0.30))
    assert lane_of(centre=0.45).offset_m == pytest.approx(-0.45)
    assert "0.45 m left of centre" in repr(lane_of(centre=0.45))


@pytest.mark.parametrize("slope", [-0.6, 0.0, 0.3])
def test_the_width_is_measured_across_a_slanted_lane(slope):
    lane = lane_of(slope=slope, width=3.3)
    across = abs(lane.right.x(0) - lane.left.x(0)) * math.cos(math.atan(slope))  # distance of two parallel lines
    assert across == pytest.approx(3.3)
    np.testing.assert_allclose(lane.width_m(np.array([0, 7.0, 20])), 3.3)


def test_curvatures_are_averaged_and_not_radii():
    lane = Lane(Line([1 / 16000, 0, -1.8]), Line([-1 / 1000, 0, 1.8]))  # one says R 8 km right, one R 500 m left
    assert lane.curvature_1pm == pytest.approx((-1 / 8000 + 1 / 500) / 2)
    assert lane.radius_m == pytest.approx(1067, rel=0.01)


def test_a_bend_within_its_own_uncertainty_is_called_straight():
    assert lane_of(bend=-1 / 4000, std={"curvature_1pm": 0.0004}).radius_m == pytest.approx(2000, rel=1e-6)
    assert math.isinf(lane_of(bend=-1 / 4000, std={"curvature_1pm": 0.0006}).radius_m)


def test_the_range_of_a_lane_is_that_of_both_lines():
    assert Lane(Line([0, 0, -2], (5, 30)), Line([0, 0, 2], (7, 44))).y_range_m == (5, 44)
    assert Lane(Line([0, 0, -2], (8, 50)), Line([0, 0, 2], (7, 44))).y_range_m == (7, 50)


def test_a_line_cannot_be_changed_from_outside():
    coefficients = np.array([0.001, 0.1, 1.8])
    line = Line(coefficients)
    coefficients[2] = 5
    assert line.x(0.0) == 1.8 and line.coefficients[2] == 1.8
    with pytest.raises(ValueError, match="read-only"):
        line.coefficients[2] = 5


def test_a_line_without_a_covariance_has_no_standard_deviation():
    assert np.isnan(Line([0, 0, 1]).std_x_m(3.0))
    covariance = np.diag([0, 0.01**2, 0.03**2])
    np.testing.assert_allclose(Line([0, 0, 1], covariance=covariance).std_x_m([0.0, 4.0]), [0.03, 0.05])


@pytest.mark.parametrize("coefficients", [[0.012, 0.55, 1.0], [-0.02, -0.4, -2.0], [3e-4, 0.004, 0.6, 1.0]])
def test_curvature_is_the_turn_of_the_tangent_per_metre_of_road(coefficients):
    """The definition, by differences of the tangent's angle over the arc, where the line runs far from straight
    ahead: there the exponent 3/2 matters."""
    line, at, h = Line(coefficients), np.array([2.0, 9.0, 20.0]), 1e-4
    x = lambda y: np.polyval(coefficients, y)  # noqa: E731
    angle = lambda y: np.arctan((x(y + h) - x(y - h)) / (2 * h))  # noqa: E731
    arc = np.hypot(2 * h, x(at + h) - x(at - h))
    expected = -(angle(at + h) - angle(at - h)) / arc  # positive to the left, as x grows to the right
    np.testing.assert_allclose(line.curvature_1pm(at), expected, rtol=1e-4)
    assert np.abs(line.slope(at)).max() > 0.7


# ---------------------------------------------------------------------------------------------- checks
BROKEN = {
    "order": Lane(Line([0, 0, 1.8], (4, 30)), Line([0, 0, -1.8], (4, 30))),
    "width": lane_of(width=5.2),
    "parallel": Lane(Line([0, -0.02, -1.8], (4, 30)), Line([0, 0.02, 1.8], (4, 30))),
    "same bend": Lane(Line([0, 0, -1.8], (4, 6)), Line([0.004, 0, 1.8], (4, 6))),
    "radius": Lane(Line([1 / 27.6, 0, -1.8], (4, 5)), Line([1 / 20.4, 0, 1.8], (4, 5))),
}


def failed(checks):
    return {check.name for check in checks if not check.ok}


def test_a_good_lane_passes_every_check():
    for lane in (lane_of(), lane_of(centre=0.9, bend=-1 / 120), lane_of(width=2.7), lane_of(width=4.5, slope=0.1)):
        assert not failed(check_lane(lane, lane)) and len(check_lane(lane, lane)) == 6


@pytest.mark.parametrize("name", BROKEN)
def test_each_check_fails_on_the_lane_that_breaks_it(name):
    checks = check_lane(BROKEN[name])
    # lines that have changed places are also of a wrong (negative) width: nothing else may fail with them
    assert failed(checks) == ({name, "width"} if name == "order" else {name})
    assert all(("FAIL" in repr(c)) == (c.name in failed(checks)) for c in checks)


def test_a_jump_is_looked_for_where_the_lines_are_seen():
    """A lane that turns about the point 5 m ahead has moved at the car, where no camera sees it, but not there."""
    before = lane_of()
    turned = [Line(line.coefficients + [0, 0.12, -0.6], (4, 30)) for line in (before.left, before.right)]
    jump = check_lane(Lane(*turned), before)[-1]
    assert jump.ok and jump.value == pytest.approx(0, abs=1e-12)
    further = [Line(line.coefficients + [0, 0.12, 0.0], (4, 30)) for line in (before.left, before.right)]
    jump = check_lane(Lane(*further), before)[-1]
    assert not jump.ok and jump.value == pytest.approx(0.6)
    assert "5 m ahead" in jump.reason


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("order", "its right line lies -3.6 m to the right of its left one, allowed more than 0 m"),
        ("width", "it is 5.2 m wide, allowed 2.6-4.6 m"),
        ("parallel", "its width changes by 0.8 m, allowed at most 0.6 m in 20 m"),
        ("same bend", "its lines' curvatures differ by 0.007886 1/m, allowed at most 0.004 1/m"),
        ("radius", "its radius is 11.73 m, allowed at least 15 m"),
    ],
)
def test_a_failed_check_gives_its_reason_in_words(name, reason):
    check = next(c for c in check_lane(BROKEN[name]) if c.name == name)
    assert check.reason == reason and repr(check) == f"FAIL {name}: {reason}"


def test_a_value_is_told_from_the_limit_that_it_fails():
    lane = Lane(Line([0, 0, -1.8], (4, 30)), Line([0, 0.030014, 1.8], (4, 30)))
    parallel = next(c for c in check_lane(lane) if c.name == "parallel")
    assert not parallel.ok and "0.6002 m, allowed at most 0.6 m" in parallel.reason


@pytest.mark.parametrize("radius_m", [27, -27, 18])
def test_the_lines_of_a_hairpin_bend_differently_and_are_parallel(radius_m):
    """Concentric circles: the inner line's curvature is 1 / (R - w / 2), the outer one's 1 / (R + w / 2)."""
    width = 3.7
    left, right = (
        Line([-1 / (2 * (radius_m + side * width / 2)), 0, side * width / 2], (4, 6)) for side in (-1, 1)
    )
    assert abs(left.curvature_1pm() - right.curvature_1pm()) > 0.004
    bend = next(c for c in check_lane(Lane(left, right)) if c.name == "same bend")
    assert bend.ok and bend.value < 1e-9


def test_lines_that_cross_ahead_are_out_of_order():
    crossing = Lane(Line([0, 0.11, -1.8], (4, 30)), Line([0, -0.11, 1.8], (4, 30)))
    assert {"order", "parallel"} == failed(check_lane(crossing))


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_jump_of_either_line_is_seen(side):
    before = lane_of(bend=1 / 800)
    moved = {"left": 0.0, "right": 0.0} | {side: 0.55}
    now = Lane(
        Line(before.left.coefficients + [0, 0, -moved["left"]], (4, 30)),
        Line(before.right.coefficients + [0, 0, moved["right"]], (4, 30)),
    )
    assert failed(check_lane(now, before)) == {"no jump"}
    reason = "5 m ahead one of its lines moved by 0.55 m since the last frame, allowed at most 0.5 m"
    assert check_lane(now, before)[-1].reason == reason
    assert not failed(check_lane(now))  # on its own the lane is a good one
    assert not failed(check_lane(now, before, limits=Limits(jump_m=0.6)))


def test_limits_decide():
    assert failed(check_lane(lane_of(width=3.2), limits=Limits(width_m=(3.3, 4.5)))) == {"width"}
    assert failed(check_lane(lane_of(bend=1 / 100), limits=Limits(radius_m=60))) == {"radius"}


# ---------------------------------------------------------------------------------------------- surface
@pytest.mark.parametrize("pitch_deg", [-1.2, 0.0, 0.8])
@pytest.mark.parametrize("bend_1pm", [-1 / 2500, 0.0, 1 / 4000])
def test_a_surface_is_seen_where_three_dimensions_say(pitch_deg, bend_1pm):
    """Road points lifted by the hill, seen by a camera that nods, put back on the flat plane by an exact ray.

    The formula is one of small angles. In pixels of a camera with f = 1000 px, for up to 1.2 degrees of nod (21 px), it
    is off by at most 2.5 px at 5 m and 0.5 px from 12 m on; for a hill alone by nothing.
    """
    height, camera_pitch = 1.3, 1.5  # the rig's own pitch: the formula must not need to know it
    y, x = np.array([5.0, 8, 12, 20, 35, 50]), np.array([-1.8, 1.9, 0.3, -3, 2.2, 1.8])
    rvec, tvec = camera_from_road(height_m=height, pitch_deg=camera_pitch + pitch_deg)
    ideal = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
    road = np.column_stack([x, y, bend_1pm * y**2 / 2])
    seen = cv2.projectPoints(road, rvec, tvec, ideal, None)[0].reshape(-1, 2)
    flat = Surface(height, math.radians(pitch_deg), bend_1pm).flat_from_road(road[:, :2])
    rvec, tvec = camera_from_road(height_m=height, pitch_deg=camera_pitch)
    shown = cv2.projectPoints(np.column_stack([flat, np.zeros(6)]), rvec, tvec, ideal, None)[0].reshape(-1, 2)
    error = np.abs(shown - seen).max(axis=1)
    assert error.max() < (2.5 if pitch_deg else 0.01) and error[2:].max() < 0.5


def test_a_flat_surface_changes_nothing_and_a_crest_hides_the_road():
    points = np.array([[1.0, 5.0], [-2.0, 60.0]])
    np.testing.assert_allclose(Surface(1.2).flat_from_road(points), points)
    beyond = Surface(1.2, bend_1pm=-1 / 500).flat_from_road([[0.0, 20.0], [0.0, 60.0]])
    assert np.isfinite(beyond).all()  # a crest falls away: its road is seen nearer, never beyond the horizon
    dip = Surface(1.2, bend_1pm=1 / 500).flat_from_road([[0.0, 20.0], [0.0, 60.0]])
    assert np.isfinite(dip[0]).all() and np.isnan(dip[1]).all()  # rising above the plane's horizon


def test_the_road_below_the_camera_and_behind_it_is_not_seen():
    seen = Surface(1.2, 0.01).flat_from_road([[1.0, 0.0], [1.0, -5.0], [1.0, np.nan], [1.0, 8.0]])
    assert np.isfinite(seen).all(axis=1).tolist() == [False, False, False, True]


@pytest.mark.parametrize("bend_1pm", [-1 / 1500, 1 / 1500])
def test_a_hill_is_not_continued_beyond_where_it_is_known(bend_1pm):
    """Up to there nothing changes; beyond, the road goes on with the slope of the line of sight to its farthest point:
    that is bend y / 2, and the road beyond lies bend known / 2 * y high instead of bend y^2 / 2."""
    height, known = 1.3, 25.0
    points = np.array([[1.5, 10.0], [1.5, 25.0], [1.5, 40.0], [-2.0, 60.0]])
    hill = Surface(height, 0.004, bend_1pm)
    seen = hill.flat_from_road(points, known_to_m=known)
    np.testing.assert_allclose(seen[:2], hill.flat_from_road(points[:2]))
    assert not np.allclose(seen[2:], hill.flat_from_road(points[2:]), equal_nan=True)
    for (x, y), (x0, y0) in zip(points[2:], seen[2:], strict=True):
        below = (height - bend_1pm * known / 2 * y) / y - 0.004  # tangent of the angle below the rig's horizon
        assert (x0, y0) == pytest.approx((x / y * height / below, height / below))
