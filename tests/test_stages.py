"""Stages: every picture has its name, shape and meaning, and looking at them changes nothing."""

import cv2
import numpy as np
import pytest

from lanelib import draw
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, Rig
from lanelib.simulator import Scene, render_road
from lanelib.stages import NAMES, birdseye, diagnostic, stage, stages

SCENE = Scene(seed=3)


@pytest.fixture(scope="module")
def rig() -> Rig:
    camera = Camera(np.array(SCENE.camera_matrix, float), np.array(SCENE.distortion), SCENE.size_wh)
    mounting = SCENE.mounting
    view = BirdsEye.from_mounting(
        camera,
        height_m=mounting.height_m,
        pitch_deg=mounting.pitch_deg,
        yaw_deg=mounting.yaw_deg,
        roll_deg=mounting.roll_deg,
    )
    return Rig(camera, view, "simulator")


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return render_road(SCENE)[0]


@pytest.mark.parametrize("recipe", ["paint", "gradient-and-colour"])
def test_all_stages_by_name_with_shape_and_type(rig, frame, recipe):
    finder = LaneFinder(rig, recipe=recipe)
    result = finder.process(frame)
    pictures = stages(frame, finder, result)
    assert tuple(pictures) == NAMES
    assert {p.dtype for p in pictures.values()} == {np.dtype(np.uint8)}
    for name in ("frame", "undistorted", "lane"):
        assert pictures[name].shape == frame.shape
    view = pictures["birdseye"].shape[:2]
    for name in ("windows", "fit"):
        assert pictures[name].shape == (*view, 3)
    assert pictures["birdseye_mask"].shape == view
    for name in ("mask", "birdseye_mask"):
        assert set(np.unique(pictures[name])) == {0, 255}
    np.testing.assert_array_equal(pictures["lane"], draw.overlay(frame, result))
    np.testing.assert_array_equal(pictures["undistorted"], rig.camera.undistort(frame))


def test_the_birdseye_stages_show_the_lane_at_its_metres(rig, frame):
    finder = LaneFinder(rig)
    result = finder.process(frame)
    assert result.lane is not None
    pictures = stages(frame, finder, result)
    grid = finder.view(SCENE.size_wh).metric.grid
    row = int(np.argmin(np.abs(grid.y_m - 9.0)))
    for line, truth_m, name in ((result.lane.left, -1.83, "left line"), (result.lane.right, 1.83, "right line")):
        near = np.abs(grid.x_m - truth_m) < 0.5
        like = near & (np.abs(pictures["fit"][row].astype(int) - draw.bgr(name)).max(axis=1) < 90)
        assert abs(grid.x_m[like].mean() - line.x(9.0)) < 0.06
        assert abs(grid.x_m[like].mean() - truth_m) < 0.15
    mask = pictures["birdseye_mask"][row - 20 : row + 20]
    assert abs(grid.x_m[np.nonzero(mask[:, grid.x_m < 0])[1]].mean() + 1.83) < 0.15


def test_looking_at_stages_leaves_the_tracker_alone(rig, frame):
    finder = LaneFinder(rig)
    finder.process(frame)
    fit, missed = finder.tracker.fit, finder.tracker.missed
    black = np.zeros_like(frame)
    for look in (stages, diagnostic, birdseye):
        look(black, finder)
    assert finder.tracker.fit is fit and finder.tracker.missed == missed and finder.track


def test_without_a_result_the_frame_stands_alone(rig, frame):
    finder = LaneFinder(rig)
    for _ in range(3):
        finder.process(frame)
    black = stages(np.zeros_like(frame), finder)
    assert not np.array_equal(black["lane"][:80], np.zeros_like(frame)[:80])  # "no lane" is written there
    assert black["lane"][120:].max() == 0  # and no lane of the frames before is drawn


def test_one_stage_by_name(rig, frame):
    finder = LaneFinder(rig)
    np.testing.assert_array_equal(stage("birdseye", frame, finder), stages(frame, finder)["birdseye"])
    with pytest.raises(LanelibError, match="undistorted.*'foo'"):
        stage("foo", frame, finder)


@pytest.mark.parametrize("shape", [(360, 640, 3), (180, 320), (360, 360, 3), (1, 1, 3), (720, 1280, 4)])
def test_screens_for_a_video_take_any_frame(rig, shape):
    finder = LaneFinder(rig)
    frame = np.full(shape, 80, np.uint8)
    for screen in (diagnostic, birdseye):
        assert screen(frame, finder).shape == (720, 1280, 3)
    if cv2.norm(np.array(shape[:2], float) / shape[0], np.array([1, 16 / 9])) > 0.1:
        with pytest.raises(LanelibError):
            stages(frame, finder)
