"""road.py against OpenCV, against closed forms and against itself backwards."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.errors import LanelibError
from lanelib.road import CarPose, Marking, Mounting, Road, fold_radius2, frame_truth, line_in_car_axes, project

K = np.array([[1143.0, 0, 655.5], [0, 1151.0, 371.25], [0, 0, 1]])
DIST = np.array([-0.21, -0.04, 0.0012, -0.0007, 0.011])
SIZE = (1280, 720)
WINDING = Road([0, 60, 140, 180, 300], [0, 0, 1 / 150, 1 / 150, -1 / 220])


def opencv_pixels(points, mounting, k=K, dist=DIST):
    """The same projection by another way: Rodrigues vectors multiplied, cv2.projectPoints."""
    about_y, about_x, about_z = (cv2.Rodrigues(np.radians(a) * np.array(v, float))[0] for a, v in (
        (-mounting.yaw_deg, (0, 1, 0)), (mounting.pitch_deg, (1, 0, 0)), (-mounting.roll_deg, (0, 0, 1))))
    r = about_z @ about_x @ about_y @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    t = r @ np.array([0, 0, -mounting.height_m])
    return cv2.projectPoints(np.asarray(points, float), cv2.Rodrigues(r)[0], t, k, dist)[0].reshape(-1, 2)


mountings = st.builds(Mounting, height_m=st.floats(0.8, 2.5), pitch_deg=st.floats(-6, 8), roll_deg=st.floats(-5, 5),
                      yaw_deg=st.floats(-8, 8))


@settings(max_examples=50, deadline=None)
@given(mountings, st.floats(-3, 3), st.floats(6, 120))
def test_projection_agrees_with_opencv(mounting, x, y):
    points = np.array([[x, y, 0.0], [x - 1, y + 3, 0.4]])
    np.testing.assert_allclose(project(points, mounting, K, DIST), opencv_pixels(points, mounting), atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(mountings, st.floats(-3, 3), st.floats(8, 80))
def test_homography_takes_undistorted_pixels_to_metres(mounting, x, y):
    uv = opencv_pixels([[x, y, 0.0]], mounting, dist=np.zeros(5)).reshape(1, 1, 2)
    xy = cv2.perspectiveTransform(uv, mounting.road_from_image(K)).ravel()
    np.testing.assert_allclose(xy, [x, y], atol=1e-6)


def test_signs_of_the_mounting():
    ahead = np.array([[0.0, 1e6, 1.22]])  # a point on the horizon straight ahead
    u0, v0 = project(ahead, Mounting(), K, np.zeros(5))[0]
    assert (u0, v0) == pytest.approx((655.5, 371.25), abs=0.01)
    assert project(ahead, Mounting(pitch_deg=2), K, np.zeros(5))[0, 1] < v0 - 30  # looking down, the horizon rises
    assert project(ahead, Mounting(yaw_deg=2), K, np.zeros(5))[0, 0] < u0 - 30  # looking right, things move left
    horizon = np.array([[-3e5, 1e6, 1.22], [3e5, 1e6, 1.22]])
    left, right = project(horizon, Mounting(roll_deg=3), K, np.zeros(5))
    assert right[1] < left[1]  # the camera turned clockwise: its horizon rises to the right


def test_points_behind_the_fold_do_not_come_back():
    r_fold = np.sqrt(fold_radius2(DIST))
    x = np.array([0.5, 0.98, 1.02, 3.0]) * r_fold * 10
    uv = project(np.column_stack([x, np.full(4, 10.0), np.full(4, 1.22)]), Mounting(), K, DIST)
    assert np.isfinite(uv[:2]).all() and np.isnan(uv[2:]).all()
    r = np.linspace(0, r_fold, 200)
    rd = r * (1 + r**2 * (DIST[0] + r**2 * (DIST[1] + r**2 * DIST[4])))
    assert (np.diff(rd) > 0).all() and np.diff(rd)[-1] < 1e-4  # the fold is where the distorted radius stops growing
    assert fold_radius2(np.zeros(5)) == np.inf
    assert np.isnan(project(np.array([[0.0, -5.0, 0.0]]), Mounting(), K, DIST)).all()  # behind the camera


def test_a_constant_curvature_is_a_circle_to_the_left():
    road, r = Road([0], [1 / 300]), 300.0
    s = np.array([-20.0, 0, 10.3, 77.7, 200])
    np.testing.assert_allclose(road.point(s), np.column_stack([r * np.cos(s / r) - r, r * np.sin(s / r)]), atol=1e-9)
    assert road.point(50.0, 2.0)[0] > road.point(50.0)[0]  # d is to the right


def test_a_clothoid_is_the_fresnel_integral():
    length, k1 = 200.0, 1 / 250
    road = Road([0, length], [0, k1])
    t = np.linspace(0, length, 200001)
    theta = k1 * t**2 / (2 * length)
    xy = [np.trapezoid(-np.sin(theta), t), np.trapezoid(np.cos(theta), t)]
    np.testing.assert_allclose(road.point(length), xy, atol=1e-6)
    assert road.heading(length) == pytest.approx(k1 * length / 2)


def test_curvature_of_the_points_is_the_curvature_of_the_stations():
    """The contract's formula on finite differences: kappa = -x'' / (1 + x'^2)^(3/2)."""
    for s in (30.0, 100.0, 160.0, 250.0):
        h = 0.5
        p = WINDING.point(np.array([s - h, s, s + h]))
        a, b, c = p
        cross = (b - a)[0] * (c - b)[1] - (b - a)[1] * (c - b)[0]
        menger = 2 * cross / (np.linalg.norm(b - a) * np.linalg.norm(c - b) * np.linalg.norm(c - a))
        assert menger == pytest.approx(float(WINDING.curvature(s)), abs=2e-6)


def test_profiles_continue_before_zero_and_with_stations_anywhere():
    road = Road([-30, 20, 90], [0.002, -0.004, 0.006], [0.0, 0.03, -0.02])
    assert road.heading(0.0) == pytest.approx(0) and road.elevation(0.0) == pytest.approx(0)
    s = np.linspace(-50, 120, 17001)
    for profile, values in ((road.heading, road.curvatures_1pm), (road.elevation, road.grades)):
        expected = np.interp(s, road.stations_m, values)
        np.testing.assert_allclose(np.gradient(profile(s), s)[5:-5], expected[5:-5], atol=5e-6)


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 400), st.floats(-15, 15))
def test_locate_is_the_inverse_of_point(s, d):
    got = WINDING.locate(WINDING.point([s], [d]), s_guess=s + 3)
    np.testing.assert_allclose(np.ravel(got), [s, d], atol=1e-4)


def test_locate_takes_whole_numbers_and_lists():
    bend = Road([0], [1 / 200])
    for points in ([[2, 50]], np.array([[2, 50]]), np.array([[2, 50]], np.uint8)):
        np.testing.assert_allclose(bend.locate(points), bend.locate(np.array([[2.0, 50.0]])))
    assert bend.locate(np.array([[2, 50]], np.float32))[0].dtype == np.float32  # pictures are as exact as they were


def test_locate_from_far_off_beside_a_tight_bend():
    """A step must know that stations lie closer together inside a bend, or four of them fall 4 cm short."""
    bend, s = Road([0, 40, 80], [0, 1 / 25, 0]), np.linspace(20, 70, 40)
    for d in (-15, 20):
        got = bend.locate(bend.point(s, d), s_guess=s + 8)
        np.testing.assert_allclose(got, [s, np.full(40, d)], atol=2e-3)


def test_dashes():
    m = Marking(1.8, dash_m=3.05, gap_m=9.14, phase_m=2.0)
    s = np.arange(0, 12.19 * 20, 0.001)
    assert m.painted(s).mean() == pytest.approx(3.05 / 12.19, abs=1e-4)
    assert m.painted([2.1, 5.0, 5.1, 1.9]).tolist() == [True, True, False, False]
    box = np.convolve(m.painted(s), np.full(800, 1 / 800), "same")  # coverage of 0.8 m by brute force
    assert np.abs(m.coverage(s, 0.8) - box)[1000:-1000].max() < 2e-3
    assert Marking(0).painted([0.0, 99.0]).all()


LEFT, RIGHT = Marking(-1.8, "yellow"), Marking(1.9, gap_m=10.97, phase_m=1.0)


def test_truth_of_a_frame_is_consistent_with_opencv():
    mounting = Mounting(1.4, 1.7, -0.8, 0.6)
    pose = CarPose(s_m=110.0, d_m=0.35, heading_rad=0.013)
    truth = json.loads(json.dumps(frame_truth(WINDING, pose, mounting, K, DIST, SIZE, LEFT, RIGHT, tags=["bend"])))
    assert truth["tags"] == ["bend"] and truth["lane_width_m"] == pytest.approx(3.7)
    for row_x, plan in zip(truth["lanes"], truth["lanes_road_m"], strict=True):
        uv = opencv_pixels(np.column_stack([plan, np.zeros(len(plan))])[3:], mounting)
        inside = (uv[:, 1] > 430) & (uv[:, 1] < 690) & (uv[:, 0] > 0) & (uv[:, 0] < 1280)
        rows, x = np.array(truth["h_samples"], float), np.array(row_x, float)
        # the dense curve through the same line, by OpenCV, evaluated at the rows of the truth
        d = LEFT.d_m if plan is truth["lanes_road_m"][0] else RIGHT.d_m
        stations = pose.s_m + 1 / np.linspace(1 / 100, 1 / 3, 20000)
        dense = opencv_pixels(line_in_car_axes(WINDING, pose, d, stations), mounting)
        expected = np.interp(rows, dense[:, 1], dense[:, 0])
        use = (x != -2) & (rows > dense[0, 1])
        assert use.sum() > 8 and inside.sum() > 3
        np.testing.assert_allclose(x[use], expected[use], atol=0.02)
    # offset by another way: the lane's centre is 0.05 m right of the reference, the car 0.35 m
    assert truth["offset_m"] == pytest.approx(0.30, abs=0.003)
    # heading and curvature by a quadratic through the plan of the centre line
    c = np.mean(truth["lanes_road_m"], 0)
    use = np.abs(c[:, 1]) < 5
    a, b, _ = np.polyfit(c[use, 1], c[use, 0], 2)
    assert b == pytest.approx(truth["heading_rad"], abs=2e-3)
    assert -2 * a / (1 + b * b) ** 1.5 == pytest.approx(truth["curvature_1pm"], abs=3e-4)
    assert truth["radius_m"] == pytest.approx(1 / abs(truth["curvature_1pm"]), rel=1e-4)


def test_a_lens_that_bends_near_rows_back_keeps_its_lines():
    """With this lens the road below the frame lies beyond the largest row that it can show."""
    k, d = np.array([[1155.0, 0, 665.3], [0, 1152, 386.7], [0, 0, 1]]), np.array([-0.242, -0.030, -0.0008, 0.0003, 0])
    truth = frame_truth(Road([0], [0.0]), CarPose(), Mounting(1.25, -1.45), k, d, SIZE, LEFT, RIGHT)
    rows, x = np.array(truth["h_samples"]), np.array(truth["lanes"][0])
    assert (x[(rows >= 430) & (rows <= 680)] != -2).all() and (np.diff(x[(rows >= 430) & (rows <= 680)]) < 0).all()


def test_lines_beside_the_car_are_in_the_truth():
    """A camera that looks down steeply sees the road half a metre ahead; no row of the lines it sees is left out."""
    k = np.array([[300.0, 0, 639.5], [0, 300, 359.5], [0, 0, 1]])
    mounting = Mounting(1.2, 20)
    truth = frame_truth(Road([0], [0.0]), CarPose(), mounting, k, np.zeros(5), SIZE, Marking(-1.8), Marking(1.8))
    rows, x = np.array(truth["h_samples"]), np.array(truth["lanes"][0])
    y = np.geomspace(0.1, 100, 100000)
    u, v = opencv_pixels(np.column_stack([np.full(len(y), -1.8), y, np.zeros(len(y))]), mounting, k, np.zeros(5)).T
    expected = np.interp(rows, v[::-1], u[::-1])
    inside = (expected > -0.5) & (rows > 360)
    assert inside[rows >= 560].sum() > 5
    np.testing.assert_allclose(x[inside], expected[inside], atol=0.02)


@pytest.mark.parametrize(("u", "seen"), [(-0.6, False), (-0.4, True), (1279.4, True), (1279.6, False)])
def test_a_line_is_seen_to_the_outer_edges_of_the_outermost_pixels(u, seen):
    """A pixel's centre is at whole coordinates: the first column begins at -0.5 and the last ends at w - 0.5."""
    k = np.array([[1000.0, 0, 639.5], [0, 1000, 359.5], [0, 0, 1]])
    line = Marking(1.2 * (u - 639.5) / 240.5)  # 240.5 rows below the horizon: 4.99 m ahead
    truth = frame_truth(Road([0], [0.0]), CarPose(), Mounting(1.2), k, np.zeros(5), SIZE, line, line, h_samples=[600])
    assert truth["lanes"][0] == ([pytest.approx(u, abs=0.01)] if seen else [-2])


def test_left_curves_left_and_offsets_have_the_sign_of_the_contract():
    left_bend = frame_truth(Road([0], [1 / 200]), CarPose(d_m=0.4), Mounting(pitch_deg=1), K, DIST, SIZE, LEFT, RIGHT)
    straight = frame_truth(Road([0], [0.0]), CarPose(d_m=0.4), Mounting(pitch_deg=1), K, DIST, SIZE, LEFT, RIGHT)
    i = straight["h_samples"].index(420)
    assert left_bend["lanes"][1][i] < straight["lanes"][1][i] - 20
    assert left_bend["curvature_1pm"] > 0 and straight["radius_m"] is None
    assert straight["offset_m"] == pytest.approx(0.35)
    turned_left = frame_truth(Road([0], [0.0]), CarPose(heading_rad=0.03), Mounting(), K, DIST, SIZE, LEFT, RIGHT)
    x, y = np.array(turned_left["lanes_road_m"][0]).T
    assert np.polyfit(y, x, 1)[0] == pytest.approx(np.tan(0.03), abs=1e-6)


def test_visible_is_paint_that_nothing_hides():
    road, pose = Road([0], [0.0]), CarPose()
    open_road = frame_truth(road, pose, Mounting(), K, DIST, SIZE, LEFT, RIGHT)
    behind = frame_truth(road, pose, Mounting(), K, DIST, SIZE, LEFT, RIGHT, hidden=lambda p: p[:, 1] > 20)
    seen = np.array(open_road["lanes"]) != -2
    assert (np.array(open_road["visible"])[0] == seen[0]).all()
    assert 0 < np.sum(open_road["visible"][1]) < seen[1].sum()
    assert behind["lanes"] == open_road["lanes"]
    assert 0 < np.sum(behind["visible"][0]) < np.sum(open_road["visible"][0])


def test_behind_a_crest_there_is_no_line():
    crest = Road([0, 30, 70, 200], [0.0] * 4, [0.0, 0.0, -0.06, -0.06])
    flat = frame_truth(Road([0], [0.0]), CarPose(), Mounting(), K, DIST, SIZE, LEFT, RIGHT)
    over = frame_truth(crest, CarPose(), Mounting(), K, DIST, SIZE, LEFT, RIGHT)
    first = [next(r for r, x in zip(t["h_samples"], t["lanes"][0], strict=True) if x != -2) for t in (flat, over)]
    assert first[1] > first[0] + 5
    same = [i for i, r in enumerate(flat["h_samples"]) if r > 450]  # the near part is the same flat road
    assert [flat["lanes"][0][i] for i in same] == [over["lanes"][0][i] for i in same]


def test_a_slope_as_a_whole_changes_nothing():
    tilted = frame_truth(Road([0], [0.0], [0.05]), CarPose(s_m=40), Mounting(pitch_deg=1), K, DIST, SIZE, LEFT, RIGHT)
    flat = frame_truth(Road([0], [0.0]), CarPose(s_m=40), Mounting(pitch_deg=1), K, DIST, SIZE, LEFT, RIGHT)
    assert np.array(tilted["lanes"])[0] == pytest.approx(np.array(flat["lanes"])[0], abs=0.02)


def test_no_lane_is_an_empty_truth():
    truth = frame_truth(WINDING, CarPose(), Mounting(), K, DIST, SIZE, None, None)
    assert truth["lanes"] == [] and truth["radius_m"] is None and truth["offset_m"] is None


@pytest.mark.parametrize("bad", [
    lambda: Road([0, 0], [0, 0]), lambda: Road([0, 1], [0]), lambda: Road([0], [300.0]), lambda: Road([0], [np.nan]),
    lambda: Mounting(height_m=0), lambda: WINDING.point(5000.0), lambda: WINDING.point([0.0, np.nan]),
    lambda: Road([0], [0], s_max_m=-100), lambda: Road([0], [0], s_max_m=np.inf),
    lambda: Road([0], [0], s_min_m=np.nan), lambda: Marking(1.8, "blue")])
def test_bad_input_says_so_in_one_line(bad):
    with pytest.raises(LanelibError) as error:
        bad()
    assert "\n" not in str(error.value)


def test_the_lane_beside_the_reference_line_has_its_own_radius():
    left, right = Marking(3.2), Marking(6.8)
    for kappa, radius in ((1 / 100, 105), (-1 / 100, 95)):  # the outer lane of a left bend is wider
        truth = frame_truth(Road([0], [kappa]), CarPose(d_m=5.0), Mounting(), K, DIST, SIZE, left, right)
        assert truth["radius_m"] == pytest.approx(radius, abs=1e-3)
        assert np.sign(truth["curvature_1pm"]) == np.sign(kappa)


def test_a_line_is_seen_where_the_lens_folds_near_the_car():
    """Just inside the fold of a strong barrel lens the nearest points of a line may dip; the rest is still in sight."""
    lens = (-0.242, -0.030, -0.0008, 0.0003, 0.0)
    matrix = np.array([[1155.0, 0, 665.3], [0, 1152.0, 386.7], [0, 0, 1]])
    mounting = Mounting(1.25, -1.45, 0.25, 0.35)
    truth = frame_truth(Road([0], [0.0]), CarPose(), mounting, matrix, lens, (1280, 720), Marking(-1.83), Marking(1.83))
    for line in truth["lanes"]:
        assert sum(x >= 0 for x in line) >= 25
