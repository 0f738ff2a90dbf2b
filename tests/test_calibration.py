"""lanelib.calibration against rendered cameras that are known, and against 20 real boards."""

import json
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from chessboards import CAMERA, POSES, bend_m, render

from lanelib.calibration import OUTLIER_FLOOR_PX, BoardView, _fit_size, board_points, calibrate
from lanelib.camera import INTRINSICS, Camera
from lanelib.chessboard import straightness_px
from lanelib.errors import LanelibError
from lanelib.pictures import write_image


def intrinsics(camera: Camera) -> np.ndarray:
    return np.concatenate([camera.camera_matrix[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])


def deviations(camera: Camera, truth: Camera) -> np.ndarray:
    """How far each intrinsic is from the truth, in the standard deviations the calibration gives itself."""
    return np.abs(intrinsics(camera) - intrinsics(truth)) / [camera.std[name] for name in INTRINSICS]


def ray_error_px(camera: Camera, truth: Camera) -> float:
    """Largest distance, over the part of the frame where boards were, between the pixels of the same rays."""
    width, height = truth.size_wh
    x, y = np.linspace(0.1 * width, 0.9 * width, 9), np.linspace(0.1 * height, 0.9 * height, 7)
    at = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = np.column_stack([truth.undistort_points(at), np.ones(len(at))]) @ np.linalg.inv(truth.camera_matrix).T
    return np.hypot(*(camera.project(rays) - at).T).max()


@pytest.fixture(scope="module")
def pictures():
    return [(f"board {i}", render(*pose, seed=i)) for i, pose in enumerate(POSES)]


@pytest.fixture(scope="module")
def calibration(pictures):
    return calibrate(pictures, board_wh=(7, 5), square_m=0.031)


def test_the_camera_that_drew_the_boards_is_found(calibration):
    assert sum(board.used for board in calibration.boards) == len(POSES)
    assert calibration.rms_px < 0.12 and calibration.camera.rms_px == calibration.rms_px
    assert deviations(calibration.camera, CAMERA).max() < 4
    np.testing.assert_allclose(intrinsics(calibration.camera)[:2], intrinsics(CAMERA)[:2], rtol=0.003)
    assert ray_error_px(calibration.camera, CAMERA) < 1.0
    assert list(calibration.camera.std) == list(INTRINSICS)


def reprojection_px(calibration, board: BoardView) -> np.ndarray:
    """Distances between seen and projected corners, the pose found anew by another method of OpenCV."""
    camera, seen = calibration.camera, board.corners_px
    points = calibration.board_m
    if board.corners_wh != calibration.boards[1].corners_wh:
        points = board_points(board.corners_wh).astype(float)
    _, rvec, tvec = cv2.solvePnP(points, seen, camera.camera_matrix, camera.distortion)
    rvec, tvec = cv2.solvePnPRefineLM(points, seen, camera.camera_matrix, camera.distortion, rvec, tvec)
    projected, _ = cv2.projectPoints(points, rvec, tvec, camera.camera_matrix, camera.distortion)
    return np.hypot(*(projected.reshape(-1, 2) - seen).T)


def test_the_errors_reported_are_root_mean_squares_over_all_corners(calibration):
    distances = [reprojection_px(calibration, board) for board in calibration.boards]
    for board, d in zip(calibration.boards, distances, strict=True):
        assert board.rms_px == pytest.approx(np.sqrt((d**2).mean()), rel=2e-3)
    assert calibration.rms_px == pytest.approx(np.sqrt((np.concatenate(distances) ** 2).mean()), rel=2e-3)


def test_the_size_of_the_squares_does_not_change_the_camera(pictures, calibration):
    other = calibrate(pictures, board_wh=(7, 5), square_m=1.7)
    np.testing.assert_allclose(intrinsics(other.camera)[:4], intrinsics(calibration.camera)[:4], rtol=1e-4)
    assert other.board_m[1, 0] == pytest.approx(1.7) and calibration.board_m[7, 1] == pytest.approx(0.031)


def test_a_board_that_does_no_harm_is_no_outlier_however_good_the_others_are(pictures, calibration):
    errors = [board.rms_px for board in calibration.boards if board.used]
    assert 1.01 * np.median(errors) < max(errors) < OUTLIER_FLOOR_PX
    strict = calibrate(pictures, board_wh=(7, 5), outlier_factor=1.01)
    assert [board.used for board in strict.boards] == [board.used for board in calibration.boards]


def test_undistorting_makes_rows_and_columns_straight(calibration):
    before = [straightness_px(board.corners_px, (7, 5)) for board in calibration.boards]
    after = [straightness_px(calibration.camera.undistort_points(b.corners_px), (7, 5)) for b in calibration.boards]
    assert min(before) > 0.1 and max(after) < 0.1 and np.mean(after) < 0.3 * np.mean(before)


def test_a_bent_board_needs_its_shape_estimated():
    pictures = [(str(i), render(*pose, bend=0.15, seed=i)) for i, pose in enumerate(POSES)]
    flat = calibrate(pictures, board_wh=(7, 5), outlier_factor=20)
    bent = calibrate(pictures, board_wh=(7, 5), flat=False)
    assert bent.rms_px < 0.15 < 0.5 < flat.rms_px
    assert ray_error_px(bent.camera, CAMERA) < 0.3 * ray_error_px(flat.camera, CAMERA)
    np.testing.assert_allclose(intrinsics(bent.camera)[:2], intrinsics(CAMERA)[:2], rtol=0.01)
    truth = bend_m(np.arange(7.0), 0.15, 7)
    np.testing.assert_allclose(np.abs(bent.board_m.reshape(5, 7, 3)[..., 2]).mean(axis=0), truth, atol=0.01)


def test_pictures_that_cannot_be_used_are_listed_with_the_reason(tmp_path, pictures, calibration):
    folder = tmp_path / "boards"
    folder.mkdir()
    for i, (_, frame) in enumerate(pictures):
        write_image(folder / f"b{i}.png", frame)
    write_image(folder / "b20.png", pictures[0][1])  # again
    write_image(folder / "b21.png", np.full((390, 660), 99, np.uint8))
    (folder / "²2.jpg").write_bytes(b"")
    write_image(folder / "b23.png", np.pad(pictures[3][1], ((0, 1), (0, 1)), mode="edge")[:, :, None])
    write_image(folder / "b24.png", cv2.resize(render(*POSES[4], seed=99), (1320, 780), interpolation=cv2.INTER_CUBIC))
    write_image(folder / "b25.png", pictures[5][1][:, 120:])
    wide = cv2.resize(render(*POSES[1], seed=98)[:, 60:600], (660, 390))  # another camera: stretched by a fifth
    write_image(folder / "b26.png", wide)
    (folder / "notes.txt").write_text("ten kilometres")
    (folder / "._b0.png").write_bytes(b"of macOS")

    result = calibrate(folder, board_wh=(7, 5))
    boards = {board.name: board for board in result.boards}
    assert list(boards)[:3] == ["b0.png", "b1.png", "b2.png"] and "notes.txt" not in boards
    assert Counter(board.used for board in result.boards) == {True: len(POSES) + 1, False: 6}
    assert boards["b20.png"].reason == "the same picture as b0.png"
    assert "no 7x5 board" in boards["b21.png"].reason
    assert "empty" in boards["²2.jpg"].reason and str(tmp_path) not in boards["²2.jpg"].reason
    # b23 is picture 3 with a column and a row more: the same corners, so a repetition.
    assert boards["b23.png"].reason == "the same picture as b3.png"
    assert boards["b24.png"].used and "1320x780, scaled to 660x390" in boards["b24.png"].reason
    assert "not in proportion" in boards["b25.png"].reason
    assert "outlier" in boards["b26.png"].reason and boards["b26.png"].rms_px > 3 * result.rms_px
    assert all("\n" not in repr(board) for board in result.boards)
    assert ray_error_px(result.camera, CAMERA) < 1.0

    numbers = json.loads(result.save(tmp_path / "c.json").read_text())
    assert [board["name"] for board in numbers["boards"]] == list(boards)
    assert numbers["boards"][0]["used"] and numbers["boards"][0]["corners_wh"] == [7, 5]
    np.testing.assert_array_equal(intrinsics(Camera.load(tmp_path / "c.json")), intrinsics(result.camera))


def test_a_picture_one_pixel_larger_is_taken_from_its_corner(pictures):
    own = [(name, np.pad(f, ((0, 1), (0, 1)), mode="edge") if name == "board 3" else f) for name, f in pictures]
    board = calibrate(own, board_wh=(7, 5)).boards[3]
    assert board.used and "661x391, taken as 660x390" in board.reason


def test_cut_off_boards_are_used(pictures):
    pose = ((0.15, 0.2, 0.05), (-6.5, 0.0, 13.0))
    result = calibrate([*pictures, ("cut", render(*pose))], board_wh=(7, 5))
    cut = result.boards[-1]
    assert cut.used and "of 7x5 corners in view" in cut.reason and cut.rms_px < 0.3
    bent = calibrate([*pictures, ("cut", render(*pose))], board_wh=(7, 5), flat=False)
    assert not bent.boards[-1].used and "whole" in bent.boards[-1].reason


def message(*args, **options) -> str:
    with pytest.raises(LanelibError) as caught:
        calibrate(*args, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_too_few_boards(pictures, tmp_path):
    blank = ("blank", np.zeros((390, 660), np.uint8))
    text = message([*pictures[:2], blank], board_wh=(7, 5))
    assert "at least 3" in text and "found 2 in 3 pictures" in text and "blank" in text
    assert "found 1 in 3" in message([pictures[0]] * 3, board_wh=(7, 5))
    assert "found 0 in 0" in message([], board_wh=(7, 5))
    assert "need a folder" in message(tmp_path / "none")
    assert "found none" in message(tmp_path)
    assert "need pictures" in message(3)
    assert "pairs" in message([3])


@pytest.mark.parametrize("board_wh, words", [((9, 7), "at most 7x5"), ((6, 4), "shows 7x5 inner corners")])
def test_a_board_size_that_does_not_fit(pictures, board_wh, words):
    assert words in message(pictures, board_wh=board_wh)


def test_boards_held_alike_do_not_determine_a_focal_length():
    pictures = [(str(i), render((0.0, 0.0, 0.02 * i), (0.3 * i, 0.1, 13.0 + i), seed=i)) for i in range(4)]
    assert "need boards tilted" in message(pictures, board_wh=(7, 5))


@pytest.mark.parametrize(
    "options", [{"square_m": 0}, {"square_m": float("nan")}, {"outlier_factor": 1}, {"board_wh": 9}]
)
def test_senseless_options_are_refused(pictures, options):
    message(pictures, **{"board_wh": (7, 5), **options})


def test_the_rendered_boards_of_the_project_give_their_true_camera():
    folder = Path(__file__).resolve().parents[1] / "camera_cal" / "rendered"
    if not (folder / "truth.json").is_file():
        pytest.skip("no rendered chessboards in camera_cal/rendered")
    truth = json.loads((folder / "truth.json").read_text())
    true_camera = Camera.from_dict(truth["camera"])
    result = calibrate(folder)
    tags = {board["raw_file"]: board["tags"] for board in truth["boards"]}
    assert {board.name for board in result.boards} == set(tags)
    for board in result.boards:
        assert board.used or "blurred" in tags[board.name], board
        assert ("partial" in tags[board.name]) == (board.corners_wh not in ((9, 6), None)), board
    assert result.rms_px < 0.2
    assert deviations(result.camera, true_camera).max() < 3
    assert ray_error_px(result.camera, true_camera) < 0.3


@pytest.fixture(scope="module")
def udacity_dir(real_dir):
    folder = real_dir / "udacity" / "camera_cal"
    if not folder.is_dir():
        pytest.skip(f"no chessboards at {folder}")
    return folder


def test_all_twenty_real_boards_are_used(udacity_dir):
    result = calibrate(udacity_dir)
    boards = {board.name.removeprefix("calibration").removesuffix(".jpg"): board for board in result.boards}
    assert len(boards) == 20 and all(board.used for board in boards.values())
    assert result.rms_px <= 0.86
    assert boards["1"].corners_wh == boards["5"].corners_wh == (9, 5)
    assert "1281x721" in boards["7"].reason and "1281x721" in boards["15"].reason
    distances = np.concatenate([reprojection_px(result, board) for board in result.boards])
    assert np.sqrt((distances**2).mean()) == pytest.approx(result.rms_px, rel=0.01)
    undistorted = [(result.camera.undistort_points(b.corners_px), b.corners_wh) for b in result.boards]
    before = np.mean([straightness_px(b.corners_px, b.corners_wh) ** 2 for b in result.boards]) ** 0.5
    after = np.mean([straightness_px(*board) ** 2 for board in undistorted]) ** 0.5
    assert before > 1 and after < 0.5


def test_the_real_board_is_bent(udacity_dir):
    result = calibrate(udacity_dir, flat=False)
    assert result.rms_px < 0.52
    assert sum(board.used for board in result.boards) == 18  # two are not seen whole


def test_corners_of_a_larger_picture_are_brought_to_the_common_size_by_the_edges_of_pixels():
    view = BoardView("a", True, "", None, (3, 3), np.array([[-0.5, -0.5], [1319.5, 779.5], [659.5, 389.5]]))
    fitted = _fit_size(view, (1320, 780), (660, 390))
    np.testing.assert_allclose(fitted.corners_px, [[-0.5, -0.5], [659.5, 389.5], [329.5, 194.5]])
