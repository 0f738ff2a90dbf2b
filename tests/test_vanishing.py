"""vanishing: the vote finds the road's direction and the lane's two lines, on drawn roads of known geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import ASPHALT, WHITE, Lane7, paint_frame, project, rig_of_scene

from lanelib.jointfit import UNKNOWN_ROAD, WIDTH
from lanelib.road import CarPose, Marking, Mounting
from lanelib.simulator import Scene, render_road
from lanelib.vanishing import (
    MEETING_POINTS,
    SLOPE_BIN,
    SLOPE_REACH,
    USUAL_HEIGHTS_M,
    best_pairs,
    candidates,
    height_prior,
    picture_points,
    slope_peaks,
)

SIZE_WH = (800, 450)
USUAL_WIDTH_M = UNKNOWN_ROAD.mean[WIDTH]


def scene(*, focal_px=760.0, mounting, **more) -> Scene:
    matrix = ((focal_px, 0, 399.5), (0, focal_px, 224.5), (0, 0, 1))
    return Scene(size_wh=SIZE_WH, camera_matrix=matrix, distortion=(0,) * 5, mounting=mounting, **more)


def vanishing_of(a_scene: Scene) -> np.ndarray:
    u, v, w = rig_of_scene(a_scene).birdseye.image_from_road @ (0, 1, 0)
    return np.array([u / w, v / w])


@settings(max_examples=50, deadline=None)
@given(st.floats(300, 500), st.floats(100, 220), st.floats(-3, -0.4), st.floats(0.4, 3))
def test_points_of_two_lines_have_two_slopes(u0, v0, left, right):
    """Whatever the focal length: points u = u0 + s (v - v0) peak at s, and a wrong vanishing point blurs them."""
    v = np.arange(v0 + 30, 449, 3.0)
    points = np.concatenate([np.column_stack([u0 + s * (v - v0), v]) for s in (left, right)])
    peaks = slope_peaks(points, np.ones(len(points)), [u0, u0 + 60], v0, 450)
    slopes = (np.arange(peaks.shape[1]) + 0.5) * SLOPE_BIN - SLOPE_REACH
    for s in (left, right):
        near = np.abs(slopes - s) < 1.5 * SLOPE_BIN
        assert peaks[0, near].max() > 0.58 * len(v)  # half in each of two bins: 0.75, less 4 of 25 for the surroundings
        assert peaks[1, near].max() < 0.5 * peaks[0, near].max()
    assert peaks[0, np.abs(np.subtract.outer(slopes, (left, right))).min(axis=1) > 2 * SLOPE_BIN].max() == 0


def test_best_pair_is_the_lane_of_a_usual_camera():
    slopes = (np.arange(int(2 * SLOPE_REACH / SLOPE_BIN)) + 0.5) * SLOPE_BIN - SLOPE_REACH
    peaks = np.zeros((1, len(slopes)))
    for s in (-3.9, -1.1, 1.6):  # a line two lanes to the left, and the lane of 2.7 camera heights
        peaks[0, np.argmin(np.abs(slopes - s))] = 10
    score, difference = best_pairs(peaks)
    assert difference[0] == pytest.approx(2.7, abs=SLOPE_BIN) and score[0] > 0
    peaks[0, slopes > 0] = 0
    assert best_pairs(peaks)[0][0] == 0  # one side alone is no lane


def test_heights_of_cars_are_usual():
    assert height_prior(1.4) == 1
    assert height_prior(1.1) > 0.7 and height_prior(1.8) > 0.7
    assert height_prior(0.7) < 0.2 and height_prior(2.8) < 0.2  # half a lane's, and two lanes'


def test_picture_points_lie_on_the_paint():
    a_scene = scene(mounting=Mounting(1.5, 2.0, 0, 1.0), others=(), left=Marking(-1.9), right=Marking(1.7))
    points, weights = picture_points(render_road(a_scene)[0])
    road = rig_of_scene(a_scene).birdseye.road_from_points(points)
    near = (road[:, 1] > 6) & (road[:, 1] < 20) & (np.abs(road[:, 0]) < 3)
    away = np.abs(np.subtract.outer(road[near, 0], (-1.9, 1.7))).min(axis=1)
    assert weights[near] @ (away < 0.1) / weights[near].sum() > 0.9


@pytest.mark.parametrize("width", [640, 1280])
def test_picture_points_are_pixels_of_the_picture_as_given(width):
    """The crest of an upright stripe is its middle, whatever the size at which it is looked for."""
    picture = np.full((width * 9 // 16, width, 3), ASPHALT, np.uint8)
    wide = width // 128
    picture[:, 400 : 400 + wide] = WHITE
    points, weights = picture_points(picture)
    assert weights.sum() > 100 and points[:, 0] @ weights / weights.sum() == pytest.approx(399.5 + wide / 2, abs=0.5)


def test_where_most_lines_meet_is_a_candidate_too():
    """Lines of other lanes: none is a pair with the car between them, and together they show where the road leads."""
    others = [(lambda y, x=x: x + 0 * y, 0.15, WHITE) for x in (-5.5, 5.5, 9.2, 12.9)]
    found = candidates([paint_frame(Lane7(), colours=(ASPHALT, ASPHALT), extra=others)])
    truth = project([[0, 1e6, 0]])[0]
    off = {True: [], False: []}
    for vanishing, height_m in found:
        off[height_m in USUAL_HEIGHTS_M].append(np.abs(np.array(vanishing) - truth).max())
    assert len(off[True]) == MEETING_POINTS * len(USUAL_HEIGHTS_M)
    assert min(off[True]) < 1042 * np.deg2rad(0.7) < min(off[False])


@pytest.mark.parametrize(
    "focal_px, mounting",
    [
        (620.0, Mounting(1.15, -4.0, 0, 3.0)),  # looks up: the horizon in the lower half
        (760.0, Mounting(1.6, 6.0, 0, -4.0)),  # looks down
        (900.0, Mounting(2.4, 1.0, 0.5, 1.0)),  # a lorry's, slightly rolled
    ],
)
def test_first_candidate_is_the_road(focal_px, mounting):
    a_scene = scene(focal_px=focal_px, mounting=mounting, others=(), pose=CarPose(5, 0.2), right=Marking(1.83))
    (vanishing, height_m), *_ = candidates([render_road(a_scene)[0]])
    # within the 0.7 degrees of pitch that the joint fit takes for a nod, and corrects
    assert np.abs(np.array(vanishing) - vanishing_of(a_scene)).max() < focal_px * np.deg2rad(0.7)
    assert height_m == pytest.approx(mounting.height_m * USUAL_WIDTH_M / 3.66, rel=0.1)  # two slope bins


def test_many_frames_vote_together():
    """Frames whose lines are too short to tell alone."""
    mounting = Mounting(1.35, 3.0, 0, -2.0)
    scenes = [scene(mounting=mounting, seed=i, pose=CarPose(3.7 * i, 0.1 * i - 0.2), noise=6) for i in range(4)]
    (vanishing, _), *_ = candidates([render_road(s)[0] for s in scenes])
    assert np.abs(np.array(vanishing) - vanishing_of(scenes[0])).max() < 12


def test_nothing_in_nothing():
    assert candidates([np.zeros((450, 800, 3), np.uint8)]) == []
