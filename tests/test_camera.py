"""lanelib.camera against OpenCV's own projection, against its own inverse, and against files that are no cameras."""

import json
import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.camera import Camera
from lanelib.errors import LanelibError

# A camera unlike any in the course: odd size, unequal focal lengths, both tangential terms, strong barrel.
ODD = Camera([[611.0, 0, 401.5], [0, 597.0, 222.25], [0, 0, 1]], [-0.31, 0.11, 0.002, -0.0015, -0.017], (823, 467))
PINCUSHION = Camera([[900.0, 0, 500], [0, 910.0, 260], [0, 0, 1]], [0.21, -0.04, -0.001, 0.002, 0.03], (1001, 547))


def grid_px(size_wh, n=13, border=0.0):
    x = np.linspace(-border, size_wh[0] - 1 + border, n)
    y = np.linspace(-border, size_wh[1] - 1 + border, n)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("camera", [ODD, PINCUSHION], ids=["barrel", "pincushion"])
def test_undistort_points_then_distort_returns_over_the_whole_frame(camera):
    points = grid_px(camera.size_wh)
    undistorted = camera.undistort_points(points)
    np.testing.assert_allclose(camera.distort_points(undistorted), points, atol=1e-6)
    assert np.abs(undistorted - points).max() > 5  # the lens does something


@pytest.mark.parametrize("camera", [ODD, PINCUSHION], ids=["barrel", "pincushion"])
def test_distort_points_agrees_with_opencv(camera):
    undistorted = camera.undistort_points(grid_px(camera.size_wh))
    rays = np.column_stack([undistorted, np.ones(len(undistorted))]) @ np.linalg.inv(camera.camera_matrix).T
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion)
    np.testing.assert_allclose(camera.distort_points(undistorted), expected.reshape(-1, 2), atol=1e-8)


def test_project_agrees_with_opencv_after_moving_the_points():
    rng = np.random.default_rng(5)
    board_m = rng.uniform(-0.3, 0.3, (40, 3))
    rvec, tvec = np.array([0.3, -0.2, 0.1]), np.array([0.1, -0.05, 1.3])
    expected, _ = cv2.projectPoints(board_m, rvec, tvec, ODD.camera_matrix, ODD.distortion)
    in_camera = board_m @ cv2.Rodrigues(rvec)[0].T + tvec
    np.testing.assert_allclose(ODD.project(in_camera), expected.reshape(-1, 2), atol=1e-8)


def test_project_is_nan_behind_the_camera_and_beyond_the_fold():
    points_m = np.array([[0, 0, 1], [0, 0, 0], [0.1, 0.1, -1], [50, 0, 1], [np.nan, 0, 1]])
    seen = np.isfinite(ODD.project(points_m)).all(axis=1)
    assert seen.tolist() == [True, False, False, False, False]
    assert not np.isnan(Camera.ideal((64, 48), hfov_deg=60).project([[50, 0, 1]])).any()  # no lens, no fold


def test_fold_radius_is_where_the_distorted_radius_is_largest():
    camera = Camera(ODD.camera_matrix, [-0.31, 0.02, 0, 0, 0.0], ODD.size_wh)
    r = np.linspace(0, 3, 300_001)
    growing = np.diff(r * (1 - 0.31 * r**2 + 0.02 * r**4)) > 0
    assert camera.fold_radius == pytest.approx(r[np.argmin(growing)], abs=2e-5)
    # Without the cull a point 3 focal lengths off axis would appear inside the picture.
    outside = np.array([[401.5 + 3.0 * 611, 222.25]])
    off = np.array([[3.0, 0, 1]])
    folded, _ = cv2.projectPoints(off, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion)
    assert 0 < folded.ravel()[0] < 823
    assert np.isnan(camera.distort_points(outside)).all()


def test_pixels_no_ray_reaches_are_nan():
    camera = Camera(ODD.camera_matrix, [-0.31, 0, 0, 0, 0], ODD.size_wh)
    r_max = camera.fold_radius * (1 - 0.31 * camera.fold_radius**2)
    at = np.array([[401.5 + 611 * r_max * 0.99, 222.25], [401.5 + 611 * r_max * 1.01, 222.25], [np.nan, 3]])
    assert np.isfinite(camera.undistort_points(at)).all(axis=1).tolist() == [True, False, False]


@settings(max_examples=50, deadline=None)
@given(
    focal=st.floats(300, 3000),
    k1=st.floats(-0.35, 0.35),
    k2=st.floats(-0.05, 0.05),
    p=st.tuples(st.floats(-0.003, 0.003), st.floats(-0.003, 0.003)),
    where=st.lists(st.tuples(st.floats(-0.45, 0.45), st.floats(-0.45, 0.45)), min_size=1, max_size=8),
)
def test_distort_then_undistort_returns(focal, k1, k2, p, where):
    camera = Camera([[focal, 0, 640], [0, focal, 360], [0, 0, 1]], [k1, k2, *p, 0.0], (1280, 720))
    points = np.array(where) * focal + (640, 360)
    np.testing.assert_allclose(camera.undistort_points(camera.distort_points(points)), points, atol=1e-3)


def test_undistort_moves_a_spot_to_where_undistort_points_says():
    frame = np.zeros((467, 823, 3), np.uint8)
    spots = np.array([[90, 60], [700, 90], [120, 400], [640, 380]])
    for u, v in spots:
        cv2.circle(frame, (int(u), int(v)), 5, (255, 255, 255), -1, cv2.LINE_AA)
    undistorted = ODD.undistort(frame)
    assert undistorted.shape == frame.shape and undistorted.dtype == np.uint8
    for expected in ODD.undistort_points(spots):
        x0, y0 = np.round(expected).astype(int) - 12
        patch = undistorted[y0 : y0 + 25, x0 : x0 + 25, 0].astype(float)
        yy, xx = np.mgrid[y0 : y0 + 25, x0 : x0 + 25]
        centre = np.array([(patch * xx).sum(), (patch * yy).sum()]) / patch.sum()
        np.testing.assert_allclose(centre, expected, atol=0.15)


def test_undistort_computes_its_maps_once_and_agrees_with_opencv():
    rng = np.random.default_rng(2)
    frame = cv2.GaussianBlur(rng.integers(0, 256, (467, 823, 3), np.uint8), (0, 0), 2)
    first = ODD.undistort(frame)
    maps = ODD._maps
    ODD.undistort(frame)
    assert ODD._maps is maps
    np.testing.assert_array_equal(first, cv2.undistort(frame, ODD.camera_matrix, ODD.distortion))


def test_undistort_of_an_ideal_camera_is_a_copy():
    frame = np.full((48, 64, 3), 7, np.uint8)
    camera = Camera.ideal((64, 48), focal_px=50)
    out = camera.undistort(frame)
    assert (out == frame).all() and out is not frame


@pytest.mark.parametrize("shape", [(823, 467, 3), (466, 823, 3), (467, 823, 3, 1), (823,), ()])
def test_undistort_refuses_other_sizes(shape):
    with pytest.raises(LanelibError, match="need a frame of 823x467"):
        ODD.undistort(np.zeros(shape, np.uint8))


@pytest.mark.parametrize("camera", [ODD, Camera.ideal((823, 467), hfov_deg=60)], ids=["lens", "no lens"])
@pytest.mark.parametrize("kind", [bool, np.int64, np.complex64, object])
def test_undistort_refuses_numbers_that_are_no_picture(camera, kind):
    with pytest.raises(LanelibError, match="undistort: need uint8 or another number that OpenCV takes, found"):
        camera.undistort(np.zeros((467, 823), kind))


@pytest.mark.parametrize("size_wh", [None, 5, (640,), (640.5, 360), "ab", (0, 5), (-3, -3)])
def test_what_is_no_size_is_refused(size_wh):
    for make in (lambda: Camera.ideal(size_wh, hfov_deg=60), lambda: Camera.ideal(size_wh, focal_px=60)):
        with pytest.raises(LanelibError, match="two whole numbers above 0, found"):
            make()
    with pytest.raises(LanelibError, match="two whole numbers above 0, found"):
        ODD.scaled(size_wh)


@pytest.mark.parametrize("scale", [0.5, 0.75, 3])
def test_scaled_camera_sees_the_same_ray_at_the_same_place_of_the_picture(scale):
    camera = Camera(ODD.camera_matrix, ODD.distortion, (840, 480), 0.8, {"fx": 2.0, "cy": 1.0, "k1": 0.01})
    other = camera.scaled((round(840 * scale), round(480 * scale)))
    points_m = np.random.default_rng(3).uniform(-0.5, 0.5, (30, 3)) + (0, 0, 2)
    # Edges, not centres, scale by s: (u + 0.5) s = u' + 0.5.
    np.testing.assert_allclose(other.project(points_m) + 0.5, (camera.project(points_m) + 0.5) * scale, atol=1e-9)
    assert other.rms_px == pytest.approx(0.8 * scale)
    assert other.std == pytest.approx({"fx": 2.0 * scale, "cy": scale, "k1": 0.01})


def test_scaled_matches_a_picture_that_was_shrunk():
    """A white spot in the large picture lies where the camera of the small picture says."""
    large = np.zeros((480, 840), np.uint8)
    cv2.circle(large, (300, 200), 12, 255, -1, cv2.LINE_AA)
    small = cv2.resize(large, (210, 120), interpolation=cv2.INTER_AREA).astype(float)
    yy, xx = np.mgrid[:120, :210]
    centre = [(small * xx).sum() / small.sum(), (small * yy).sum() / small.sum()]
    camera = Camera.ideal((840, 480), focal_px=500)
    ray = np.linalg.inv(camera.camera_matrix) @ (300, 200, 1)
    np.testing.assert_allclose(camera.scaled((210, 120)).project(ray[None])[0], centre, atol=0.01)


def test_scaled_accepts_rounding_and_refuses_a_crop():
    camera = Camera.ideal((1280, 720), hfov_deg=58)
    assert camera.scaled((854, 480)).size_wh == (854, 480)
    assert camera.scaled((2560, 1433)).size_wh == (2560, 1433)  # 0.5 % off
    for size_wh in [(2560, 1425), (1267, 720)]:  # 1 % off: eleven rows are missing in 1080
        with pytest.raises(LanelibError, match="not cropped or stretched"):
            camera.scaled(size_wh)
    for size_wh in [(640, 480), (720, 1280), (0, 0), (-1280, -720)]:
        with pytest.raises(LanelibError):
            camera.scaled(size_wh)


def test_ideal_camera_spans_its_field_of_view():
    camera = Camera.ideal((801, 333), hfov_deg=73)
    edge = math.tan(math.radians(73 / 2))
    np.testing.assert_allclose(camera.project([[-edge, 0, 1], [edge, 0, 1]])[:, 0], [-0.5, 800.5])
    np.testing.assert_allclose(camera.project([[0, 0, 4]]), [[400, 166]])
    for wrong in [{}, {"hfov_deg": 60, "focal_px": 300}, {"hfov_deg": 180}, {"focal_px": -3}]:
        with pytest.raises(LanelibError):
            Camera.ideal((801, 333), **wrong)


def test_save_and_load_keep_every_number(tmp_path):
    camera = Camera(ODD.camera_matrix, ODD.distortion, ODD.size_wh, 0.1 + 0.2, {"fx": 1 / 3, "k3": 1e-17})
    path = camera.save(tmp_path / "calibration.json")
    again = Camera.load(path)
    assert (again.camera_matrix == camera.camera_matrix).all() and (again.distortion == camera.distortion).all()
    assert (again.size_wh, again.rms_px, again.std) == (camera.size_wh, camera.rms_px, camera.std)
    assert json.loads(path.read_text())["format"] == "lanelib-camera/1"
    assert [p.name for p in tmp_path.iterdir()] == ["calibration.json"]


def test_load_needs_only_the_four_required_keys(tmp_path):
    numbers = {k: ODD.to_dict()[k] for k in ("format", "size_wh", "camera_matrix", "distortion")}
    (tmp_path / "c.json").write_text(json.dumps(numbers | {"boards": [], "note": "x"}))
    camera = Camera.load(tmp_path / "c.json")
    assert camera.rms_px is None and camera.std is None


GOOD = ODD.to_dict()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        "null",
        "{}",
        "\x80\x81",
        json.dumps({"camera_matrix": GOOD["camera_matrix"], "dist_coefs": [0] * 5}),
        json.dumps(GOOD | {"format": "lanelib-rig/1"}),
        json.dumps(GOOD | {"size_wh": [1280]}),
        json.dumps(GOOD | {"size_wh": [0, 720]}),
        json.dumps(GOOD | {"size_wh": [1280.5, 720]}),
        json.dumps(GOOD | {"size_wh": "big"}),
        json.dumps(GOOD | {"size_wh": [float("nan"), 3]}),
        json.dumps(GOOD | {"camera_matrix": [[1, 0], [0, 1]]}),
        json.dumps(GOOD | {"camera_matrix": [[0, 0, 1], [0, 5, 1], [0, 0, 1]]}),
        json.dumps(GOOD | {"camera_matrix": [[9, 0, 1], [0, 9, 1], [0, 0, 2]]}),
        json.dumps(GOOD | {"camera_matrix": [["a", 0, 1], [0, 9, 1], [0, 0, 1]]}),
        json.dumps(GOOD | {"distortion": [0, 0, 0, 0]}),
        json.dumps(GOOD | {"distortion": [0, 0, 0, 0, float("inf")]}),
        json.dumps(GOOD | {"distortion": {"k1": 3}}),
        json.dumps(GOOD | {"distortion": [0, 0, 0, 0, 10**400]}),
        json.dumps(GOOD | {"rms_px": "small"}),
        json.dumps(GOOD | {"std": {"hx": 1}}),
        json.dumps(GOOD | {"std": [1, 2]}),
        json.dumps({k: v for k, v in GOOD.items() if k != "distortion"}),
    ],
)
def test_foreign_or_damaged_files_are_one_line(tmp_path, text):
    path = tmp_path / "calibration.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(LanelibError) as caught:
        Camera.load(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message and "need" in message and len(message) < 400


def test_load_of_no_file_and_of_a_folder(tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(LanelibError, match="need a calibration file"):
            Camera.load(path)


def test_a_camera_cannot_be_changed_from_outside():
    matrix = np.array(ODD.camera_matrix)
    camera = Camera(matrix, ODD.distortion, ODD.size_wh)
    matrix[0, 0] = 1
    assert camera.camera_matrix[0, 0] == 611
    with pytest.raises(ValueError, match="read-only"):
        camera.camera_matrix[0, 0] = 1
    with pytest.raises(AttributeError):
        camera.size_wh = (1, 1)


def test_points_of_a_wrong_shape_are_refused_and_none_is_fine():
    for no_points in ([[1, 2], [3]], "here", None):
        with pytest.raises(LanelibError, match=r"\(N, 2\)"):
            ODD.distort_points(no_points)
    with pytest.raises(LanelibError, match=r"\(N, 2\)"):
        ODD.distort_points([1, 2])
    with pytest.raises(LanelibError, match=r"\(N, 3\)"):
        ODD.project(np.zeros((4, 2)))
    none = np.zeros((0, 2))
    for empty in (ODD.distort_points(none), ODD.undistort_points(none), ODD.project(np.zeros((0, 3)))):
        assert empty.shape == (0, 2)


def test_repr_is_one_line():
    camera = Camera(ODD.camera_matrix, ODD.distortion, ODD.size_wh, rms_px=0.8512)
    assert repr(camera) == (
        "Camera 823x467: focal length 611.0 x 597.0 px, centre (401.5, 222.2), k1 -0.310, rms 0.85 px"
    )
