"""birdseye: geometry against OpenCV, against the independent `lanelib.road.Mounting`, and against formulas."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.birdseye import (
    BirdsEye,
    Grid,
    angles_from_vanishing_point,
    map_points,
    rotation_from_angles,
)
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.road import Mounting

CAMERA = Camera(np.array([[911.0, 0, 655.5], [0, 905.0, 342.25], [0, 0, 1]]), np.zeros(5), (1280, 720))
BENT = Camera(CAMERA.camera_matrix, np.array([-0.22, 0.05, 0.001, -0.0007, 0.003]), (1280, 720))
MOUNTING = {"height_m": 1.37, "pitch_deg": 2.6, "yaw_deg": -1.8, "roll_deg": 1.1}
ROAD_M = np.array([(-1.9, 6.0), (1.7, 6.5), (-3.3, 18.0), (2.2, 31.0), (0.4, 70.0)])

angles = st.floats(-9, 9)
heights = st.floats(0.6, 3.5)
mountings = st.fixed_dictionaries({"height_m": heights, "pitch_deg": angles, "yaw_deg": angles, "roll_deg": angles})


def opencv_pixels(points_m, camera, *, height_m, **turned):
    """The same projection through cv2.projectPoints."""
    rotation = rotation_from_angles(**turned)
    points = np.column_stack([points_m, np.zeros(len(points_m))])
    t = -rotation @ (0, 0, height_m)
    return cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], t, camera.camera_matrix, None)[0].reshape(-1, 2)


# ------------------------------------------------------------------ the three angles
def test_signs_of_the_angles():
    down, right, clockwise = (rotation_from_angles(**{name: 5.0}) for name in ("pitch_deg", "yaw_deg", "roll_deg"))
    assert down[2] @ (0, 0, 1) == pytest.approx(-math.sin(math.radians(5)))  # the optical axis, in road axes, sinks
    assert right[2] @ (1, 0, 0) == pytest.approx(math.sin(math.radians(5)))  # and turns right
    far_right = clockwise @ (1, 1, 0)  # a point of the horizon on the right
    assert far_right[1] < 0 < far_right[0]  # is seen above the middle (y down): the horizon rises to the right


@settings(max_examples=50, deadline=None)
@given(mountings)
def test_same_mounting_as_in_the_truth(m):
    theirs = Mounting(**m)
    turned = {k: v for k, v in m.items() if k != "height_m"}
    assert np.allclose(rotation_from_angles(**turned), theirs.rotation(), atol=1e-12)
    mine = BirdsEye.from_mounting(CAMERA, **m).road_from_image
    other = theirs.road_from_image(CAMERA.camera_matrix)
    assert np.allclose(mine / mine[2, 2], other / other[2, 2], rtol=1e-9, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(mountings)
def test_projection_agrees_with_opencv_and_returns(m):
    view = BirdsEye.from_mounting(CAMERA, **m)
    pixels = view.points_from_road(ROAD_M)
    assert np.allclose(pixels, opencv_pixels(ROAD_M, CAMERA, **m), atol=1e-6)
    assert np.allclose(view.road_from_points(pixels), ROAD_M, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(mountings)
def test_mounting_is_read_back(m):
    found = BirdsEye.from_mounting(CAMERA, **m).mounting(CAMERA)
    assert found == pytest.approx(m, abs=1e-6)


@settings(max_examples=50, deadline=None)
@given(angles, angles, angles)
def test_angles_from_the_vanishing_point(pitch, yaw, roll):
    u, v, w = CAMERA.camera_matrix @ rotation_from_angles(pitch_deg=pitch, yaw_deg=yaw, roll_deg=roll) @ (0, 1, 0)
    found = angles_from_vanishing_point(CAMERA.camera_matrix, (u / w, v / w), roll_deg=roll)
    assert found == pytest.approx((pitch, yaw), abs=1e-9)


def test_horizon_row_of_a_level_camera():
    view = BirdsEye.from_mounting(CAMERA, height_m=1.9, pitch_deg=4.0)
    assert view.horizon_row_px == pytest.approx(342.25 - 905 * math.tan(math.radians(4)))


def test_nothing_beyond_the_horizon_nor_behind_the_camera():
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    row = view.horizon_row_px
    assert np.isnan(view.road_from_points([(639.5, row - 1), (639.5, row - 200)])).all()
    assert view.road_from_points([(639.5, row + 1)])[0, 1] > 500
    assert np.isnan(view.points_from_road([(0.0, -3.0), (1.0, -30.0)])).all()


def test_pitched_is_a_larger_pitch():
    level = {"height_m": 1.5, "pitch_deg": 1.0}
    nodded = BirdsEye.from_mounting(CAMERA, **level).pitched(CAMERA, math.radians(0.7))
    assert nodded.mounting(CAMERA)["pitch_deg"] == pytest.approx(1.7, abs=1e-9)
    assert nodded.mounting(CAMERA)["height_m"] == pytest.approx(1.5, abs=1e-9)


# ------------------------------------------------------------------ made from points and lines
def test_from_points_agrees_with_opencv():
    image = np.float32([(570, 460), (715, 455), (1100, 690), (180, 680)])
    road = np.float32([(-1.7, 31), (1.9, 32), (1.8, 4), (-1.9, 4.2)])
    view = BirdsEye.from_points(image, road, (1280, 720))
    asked = np.array([(640, 500), (333, 610), (900, 640)], float)
    expected = cv2.perspectiveTransform(asked[None], cv2.getPerspectiveTransform(image, road).astype(float))[0]
    assert np.allclose(view.road_from_points(asked), expected, atol=1e-4)


def test_points_that_give_no_homography():
    road = np.array([(0, 5), (1, 5), (1, 9), (0, 9)])
    with pytest.raises(LanelibError, match="at least 4 pairs of points, found 3 and 4"):
        BirdsEye.from_points(road[:3] * 10, road, (1280, 720))
    with pytest.raises(LanelibError):
        BirdsEye.from_points([(0, 0), (10, 10), (20, 20), (30, 30)], road, (1280, 720))


@pytest.mark.parametrize("size_wh", [(1280, 720), (960, 540), (641, 350)])
def test_classic_trapezoid_is_proportional(size_wh):
    view = BirdsEye.classic(size_wh, lane_width_m=3.5, length_m=25, near_m=5)
    corners = np.array([(576, 454), (704, 454), (1088, 684), (192, 684)]) / (1280, 720) * size_wh
    expected = [(-1.75, 30), (1.75, 30), (1.75, 5), (-1.75, 5)]
    assert np.allclose(view.road_from_points(corners), expected, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(heights, angles, angles, st.floats(-1, 1), st.floats(2.8, 4.5))
def test_straight_lines_give_the_mounting(height, pitch, yaw, aside, width):
    truth = BirdsEye.from_mounting(CAMERA, height_m=height, pitch_deg=pitch, yaw_deg=yaw)
    left, right = (truth.points_from_road([(x, 6.0), (x, 30.0)]) for x in (aside - width / 2, aside + width / 2))
    found = BirdsEye.from_straight_lines(CAMERA, left, right, lane_width_m=width)
    assert np.allclose(found.road_from_points(truth.points_from_road(ROAD_M)), ROAD_M, atol=1e-5)
    assert found.parallelism(left, right) == pytest.approx(0, abs=1e-6)


def test_lines_that_are_no_lane():
    truth = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    left, right = (truth.points_from_road([(x, 6.0), (x, 30.0)]) for x in (-1.8, 1.9))
    with pytest.raises(LanelibError, match="exchanged"):
        BirdsEye.from_straight_lines(CAMERA, right, left)
    with pytest.raises(LanelibError, match="do not meet"):
        BirdsEye.from_straight_lines(CAMERA, [(400, 500), (400, 700)], [(800, 500), (800, 700)])


@pytest.mark.parametrize("width", [0, -3.7, math.nan, math.inf])
def test_widths_of_a_lane_that_cannot_be(width):
    """A negative one would mirror the road and put it behind the car."""
    lines = [(500, 500), (400, 700)], [(800, 500), (900, 700)]
    with pytest.raises(LanelibError, match="lane_width_m must be positive"):
        BirdsEye.from_straight_lines(CAMERA, *lines, lane_width_m=width)
    with pytest.raises(LanelibError, match="lane_width_m must be positive"):
        BirdsEye.classic((1280, 720), lane_width_m=width)
    with pytest.raises(LanelibError, match="length_m must be positive"):
        BirdsEye.classic((1280, 720), length_m=width)


@pytest.mark.parametrize("points", [[(400, 500)], np.zeros((0, 2))])
def test_a_line_needs_two_points(points):
    for lines in ((points, [(800, 500), (900, 700)]), ([(500, 500), (400, 700)], points)):
        with pytest.raises(LanelibError, match="two points"):
            BirdsEye.from_straight_lines(CAMERA, *lines)


def test_lines_that_the_road_does_not_show_have_no_parallelism():
    view = BirdsEye.from_mounting(CAMERA, height_m=1.4, pitch_deg=2.0)
    line, above = [(500, 500), (400, 700)], [(500, 100), (400, 200)]
    assert math.isnan(view.parallelism(line, above)) and math.isnan(view.parallelism([(500, 500)], line))


def test_parallelism_shows_a_wrong_pitch():
    truth = BirdsEye.from_mounting(CAMERA, height_m=1.4, pitch_deg=2.0)
    lines = [truth.points_from_road(np.column_stack([np.full(20, x), np.linspace(6, 30, 20)])) for x in (-1.8, 1.8)]
    # too little pitch puts far points further away but no wider apart: bearings x / y stay, so the lane narrows or
    # widens by width * error / height per metre (small angles): 3.6 m * 0.01 / 1.4 m * 30 m, less where it is near
    wrong = truth.pitched(CAMERA, 0.01)
    assert truth.parallelism(*lines) == pytest.approx(0, abs=1e-6)
    assert abs(wrong.parallelism(*lines)) == pytest.approx(30 * 3.6 * 0.01 / 1.4, rel=0.35)


# ------------------------------------------------------------------ matrices, sizes
def test_sign_and_scale_of_the_matrix_do_not_matter():
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    pixels = view.points_from_road(ROAD_M)
    for factor in (-1, 17, -0.003):
        other = BirdsEye(view.road_from_image * factor, view.size_wh)
        assert np.allclose(other.road_from_points(pixels), ROAD_M, atol=1e-6)
        assert np.allclose(other.points_from_road(ROAD_M), pixels, atol=1e-6)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.ones((3, 3)), np.eye(2), np.full((3, 3), np.nan)])
def test_bad_matrices_are_refused(matrix):
    with pytest.raises(LanelibError, match="invertible 3x3"):
        BirdsEye(matrix, (1280, 720))


@pytest.mark.parametrize("matrix", [[[1, 2], [3]], None, "wide", [["a"] * 3] * 3])
def test_what_is_no_matrix_is_refused(matrix):
    with pytest.raises(LanelibError, match="invertible 3x3"):
        BirdsEye(matrix, (1280, 720))


NO_SIZES = [None, 5, (0, -3), (0, 0), (640,), (640.5, 360), "ab", (math.nan, 3)]


@pytest.mark.parametrize("size_wh", NO_SIZES)
def test_what_is_no_size_is_refused(size_wh):
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    for make in (
        lambda: BirdsEye(view.road_from_image, size_wh),
        lambda: view.scaled(size_wh),
        lambda: BirdsEye.classic(size_wh),
        lambda: Grid.uniform(size_wh=size_wh),
    ):
        with pytest.raises(LanelibError, match="two whole numbers above 0, found"):
            make()


def test_views_and_grids_are_their_own():
    """What they were made of can be changed afterwards, they cannot; two of them are compared and kept in sets."""
    x, h = np.array([0.0, 1, 2]), np.array(BirdsEye.from_mounting(CAMERA, **MOUNTING).road_from_image)
    grid, view = Grid(x, [2, 1]), BirdsEye(h, (1280, 720))
    before = view.points_from_road(ROAD_M)
    x[0] = -9
    h *= 0
    assert grid.x_m[0] == 0 and np.array_equal(view.points_from_road(ROAD_M), before)
    for array in (grid.x_m, grid.y_m, view.road_from_image, view.image_from_road, view.view_from_image):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    assert grid == grid and grid != Grid(grid.x_m, grid.y_m) and len({grid, view, view}) == 2


@pytest.mark.parametrize("points", [np.zeros((2, 3)), [1.0, 2.0], np.zeros((2, 2, 2)), [], [[1, 2], [3]], "here"])
def test_points_of_another_shape_are_refused(points):
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    four = [(0, 5), (1, 5), (1, 9), (0, 9)]
    for use in (
        view.road_from_points,
        view.points_from_road,
        lambda points: view.parallelism(points, ROAD_M),
        lambda points: BirdsEye.from_points(points, four, (1280, 720)),
        lambda points: BirdsEye.from_points(four, points, (1280, 720)),
        lambda points: BirdsEye.from_straight_lines(CAMERA, points, [(800, 500), (900, 700)]),
    ):
        with pytest.raises(LanelibError, match=r"points of shape \(N, 2\)"):
            use(points)
    assert view.road_from_points(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("height", [0, -1.2, math.nan])
def test_heights_that_cannot_be(height):
    with pytest.raises(LanelibError, match="height"):
        BirdsEye.from_mounting(CAMERA, height_m=height)


def test_scaled_keeps_the_road():
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    small = view.scaled((480, 270))
    pixels = view.points_from_road(ROAD_M)
    assert np.allclose(small.road_from_points((pixels + 0.5) * 0.375 - 0.5), ROAD_M, atol=1e-6)
    # and it is what the scaled camera, mounted there, sees
    there = BirdsEye.from_mounting(CAMERA.scaled((480, 270)), **MOUNTING)
    assert np.allclose(there.points_from_road(ROAD_M), small.points_from_road(ROAD_M), atol=1e-6)


def test_map_points_is_perspective_transform():
    h = np.array([[1.1, 0.2, 3], [-0.1, 0.9, 5], [1e-3, 2e-3, 1]])
    points = np.array([(3.0, 4.0), (100, 50), (-20, 8)])
    assert np.allclose(map_points(h, points), cv2.perspectiveTransform(points[None], h)[0])


# ------------------------------------------------------------------ grids
def test_uniform_grid_covers_its_range():
    grid = Grid.uniform(x_range_m=(-4, 8), y_range_m=(2, 32), size_wh=(240, 300))
    assert grid.size_wh == (240, 300) and grid.is_uniform
    assert grid.column_m == pytest.approx(0.05) and grid.row_m == pytest.approx(0.1)
    assert grid.x_m[0] == pytest.approx(-3.975) and grid.y_m[0] == pytest.approx(31.95)  # centres of pixels
    assert np.allclose(map_points(grid.road_from_pixel, [(0, 0), (239, 299)]), [(-3.975, 31.95), (7.975, 2.05)])
    assert np.allclose(grid.x_of(grid.column_of([-1.234, 5.0])), [-1.234, 5.0])


@pytest.mark.parametrize("size", [1e-290, 1e-150, 1e150, 1e300])
def test_the_size_of_a_homography_means_nothing(size):
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    found = BirdsEye(view.road_from_image * size, CAMERA.size_wh).mounting(CAMERA)
    assert found == pytest.approx(MOUNTING, abs=1e-6)


def test_a_road_that_no_camera_sees_is_refused():
    """Invertible by the skin of its teeth, and its inverse is beyond all numbers."""
    matrix = np.diag([1e-308, 1e-308, 1e-308]) @ BirdsEye.from_mounting(CAMERA, **MOUNTING).road_from_image
    with pytest.raises(LanelibError, match="no camera"):
        BirdsEye(matrix, CAMERA.size_wh).mounting(CAMERA)


def test_a_grid_with_rows_of_perspective_has_no_homography():
    with pytest.raises(LanelibError, match="equal rows"):
        _ = Grid(np.arange(5), 1 / np.arange(1, 6)).road_from_pixel


@pytest.mark.parametrize(
    "x, y",
    [
        ([1, 0], [2, 1]),
        ([0, 1], [1, 2]),
        ([0], [2, 1]),
        ([0, 1], [2, math.nan]),
        ([0, 1, 3], [2, 1]),  # columns of unequal steps: x_of and column_of would be wrong
        ([[0, 1], [2]], [2, 1]),
        (["a", "b"], [2, 1]),
    ],
)
def test_bad_grids_are_refused(x, y):
    with pytest.raises(LanelibError, match="metres"):
        Grid(x, y)


# ------------------------------------------------------------------ pictures
def stripe(view, x_m, half_m=0.25):
    """A picture in which a stripe along the road is painted as a polygon."""
    y = np.linspace(4.5, 60, 200)
    edges = [view.points_from_road(np.column_stack([np.full_like(y, x_m + d), y])) for d in (-half_m, half_m)]
    polygon = np.vstack([edges[0], edges[1][::-1]])
    picture = np.zeros((720, 1280), np.uint8)
    cv2.fillPoly(picture, [np.round(polygon * 16).astype(np.int32)], 255, lineType=cv2.LINE_AA, shift=4)
    return picture


def test_warp_shows_metres():
    grid = Grid.uniform(x_range_m=(-5, 5), y_range_m=(6, 30), size_wh=(400, 480))
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING, grid=grid)
    seen = view.warp(stripe(view, 1.3)).astype(float)
    assert seen.shape == (480, 400)
    middle = seen @ grid.x_m / seen.sum(axis=1)
    assert np.abs(middle - 1.3).max() < 0.02  # a column is 0.025 m
    near = grid.y_m < 12  # further away the pixel by which OpenCV's polygons are too wide shows
    assert np.allclose((seen.sum(axis=1) / 255 * grid.column_m)[near], 0.5, atol=0.03)


def test_pictures_of_another_size_or_kind_are_refused():
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING)
    for picture in (np.full((360, 640), 255, np.uint8), np.zeros((1280, 720, 3), np.uint8)):
        with pytest.raises(LanelibError, match=r"1280x720.*found shape"):
            view.warp(picture)
        with pytest.raises(LanelibError, match=r"360x720.*found shape"):
            view.unwarp(picture)
    for kind in (bool, np.int64, np.complex64):
        with pytest.raises(LanelibError, match="uint8 or another number that OpenCV takes"):
            view.warp(np.zeros((720, 1280), kind))
        with pytest.raises(LanelibError, match="uint8 or another number that OpenCV takes"):
            view.unwarp(np.zeros((720, 360), kind))
    for picture in (None, [[0]], np.zeros((720, 1280, 3, 1), np.uint8), np.zeros(720, np.uint8)):
        with pytest.raises(LanelibError, match="1280x720"):
            view.warp(picture)
    for kind in (np.uint8, np.float32, np.float64, np.uint16):
        assert view.warp(np.ones((720, 1280), kind)).dtype == kind


def test_unwarp_is_the_way_back():
    view = BirdsEye.from_mounting(CAMERA, **MOUNTING, grid=Grid.uniform(size_wh=(720, 1440)))
    picture = stripe(view, -1.1)
    back = view.unwarp(view.warp(picture))
    y = np.linspace(8, 20, 30)
    inside, outside = (view.points_from_road(np.column_stack([np.full_like(y, x), y])) for x in (-1.1, -0.5))
    for points, value in ((inside, 255), (outside, 0)):
        u, v = np.round(points).astype(int).T
        assert np.abs(back[v, u].astype(int) - value).max() < 30


def test_table_joins_lens_and_homography():
    """Of a picture whose value is its column (and then its row) the table reads where each grid point lies."""
    view = BirdsEye.from_mounting(BENT, **MOUNTING)
    grid = Grid(np.linspace(-3, 3, 25), 1 / np.linspace(1 / 40, 1 / 6, 40))
    maps = view.table(BENT, grid)
    x, y = np.meshgrid(grid.x_m, grid.y_m)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    rotation = rotation_from_angles(**{k: v for k, v in MOUNTING.items() if k != "height_m"})
    t = -rotation @ (0, 0, MOUNTING["height_m"])
    expected = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], t, BENT.camera_matrix, BENT.distortion)[0]
    expected = expected.reshape(*x.shape, 2)
    v, u = np.mgrid[0:720, 0:1280].astype(np.float32)
    for axis, picture in enumerate((u, v)):
        read = cv2.remap(picture, *maps, cv2.INTER_LINEAR)
        seen = (expected >= 1).all(axis=2) & (expected < (1278, 718)).all(axis=2)
        assert seen.mean() > 0.9
        assert np.abs(read - expected[..., axis])[seen].max() < 0.05  # remap's fractions are 1/32 px


def test_table_is_black_where_the_camera_sees_nothing():
    view = BirdsEye.from_mounting(BENT, height_m=1.4, pitch_deg=2)
    beside_and_behind = Grid([-60.0, 60.0], [2.0, -5.0])
    read = cv2.remap(np.full((720, 1280), 255, np.uint8), *view.table(BENT, beside_and_behind), cv2.INTER_LINEAR)
    assert not read.any()
