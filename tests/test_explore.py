"""The explorers without a browser: what they show is what lanelib says, and a moved control changes it."""

import re
import threading
import time
from dataclasses import replace

import chessboards
import cv2
import numpy as np
import pytest
from roads import rig_of_scene

from lanelib import LaneFinder, LanelibError, draw, explore, threshold, windows
from lanelib.birdseye import CLASSIC_SOURCE, BirdsEye
from lanelib.calibration import board_points, calibrate
from lanelib.camera import Camera
from lanelib.channels import CHANNELS
from lanelib.evaluate import lag_s
from lanelib.explore import chart, corners, detection, lens, roads, scrubber, smoothers, steps
from lanelib.explore.chessboards import projected_corners
from lanelib.explore.kit import slider
from lanelib.explore.look import Look, Reading, readings_html
from lanelib.jointfit import CENTRE, UNKNOWN_ROAD, JointFit, Prior
from lanelib.road import CarPose, Mounting, Road
from lanelib.simulator import Scene, render_road
from lanelib.tracking import SMOOTHING
from lanelib.video import VideoWriter

SIZE_WH = (640, 360)
SCENE = Scene(road=Road([0], [1 / 500]), pose=CarPose(2.0, 0.3, -0.004), mounting=Mounting(1.35, 2.4, yaw_deg=0.8))


@pytest.fixture(scope="module")
def seen():
    """A frame, its truth and the rig that fits it."""
    return *render_road(SCENE), rig_of_scene(SCENE)


def pixels(explorer) -> np.ndarray:
    """The picture as it goes to the page."""
    return cv2.imdecode(np.frombuffer(explorer.picture.value, np.uint8), cv2.IMREAD_COLOR)


def moved(explorer, **values) -> dict:
    """Move controls; the picture must have changed. The values now shown."""
    before = explorer.picture.value
    explorer.set(**values)
    assert explorer.picture.value != before, f"the picture did not change with {values}"
    assert pixels(explorer).shape == explorer.look.picture.shape
    return explorer.values


# ------------------------------------------------------------------------------------------------ the frame
def test_reading_says_value_and_unit_and_never_minus_nothing():
    assert Reading("a", 1.236, "m").text == "1.24 m"
    assert Reading("a", -0.001, "m", signed=True).text == "+0.00 m"
    assert Reading("a", -0.001).text == "0.00"
    assert [Reading("a", v).text for v in (None, float("nan"), float("inf"), "word")] == ["–", "–", "∞", "word"]
    assert Reading("a", 1.0, truth=2.0).truth_text == "2.00" and Reading("a", 1.0).truth_text == ""
    assert "&lt;b&gt;" in readings_html([Reading("<b>", "x")])


def test_user_errors_are_told_in_place_and_faults_are_raised():
    def make(x):
        if x == 1:
            raise LanelibError("x must not be 1; choose another <x>")
        if x == 2:
            raise KeyError("a fault")
        return Look(np.full((40, 60, 3), round(x), np.uint8), (Reading("x", x),))

    explorer = explore.Explorer("test", make, {"x": slider("x", 0, 0, 9, 1)})
    explorer.controls["x"].value = 1
    assert "choose another &lt;x&gt;" in explorer.numbers.value and "data-name" not in explorer.numbers.value
    with pytest.raises(KeyError, match="a fault"):
        explorer.controls["x"].value = 2
    assert "a fault" in explorer.numbers.value and "data-name" not in explorer.numbers.value, "an old value stayed"
    explorer.controls["x"].value = 3
    assert "alert" not in explorer.numbers.value and explorer.values == {"x": 3}


def test_several_controls_are_answered_once():
    calls = []

    def make(**state):
        calls.append(state)
        return Look(np.zeros((4, 4, 3), np.uint8))

    explorer = explore.Explorer("test", make, {"x": slider("x", 0, 0, 9, 1), "y": slider("y", 0, 0, 9, 1)})
    explorer.set(x=3, y=4)
    assert calls == [{"x": 0, "y": 0}, {"x": 3, "y": 4}]
    assert repr(explorer) == "Explorer('test': x, y)"


def test_the_last_change_wins_though_changes_come_in_threads():
    """JupyterLab's subshells call back while an answer is under way; a slow old answer must not replace a new one."""
    slow, go_on, made = threading.Event(), threading.Event(), []

    def make(x):
        if x == 1:
            slow.set()
            assert go_on.wait(10)
        made.append(x)
        return Look(np.full((4, 4, 3), round(10 * x), np.uint8), (Reading("x", x, digits=0),))

    explorer = explore.Explorer("test", make, {"x": slider("x", 0, 0, 9, 1)})
    first = threading.Thread(target=explorer.set, kwargs={"x": 1})
    first.start()
    assert slow.wait(10)
    others = [threading.Thread(target=explorer.set, kwargs={"x": x}) for x in (2, 3, 4)]
    for other in others:
        other.start()
    while explorer._asked < 5:
        time.sleep(0.01)
    go_on.set()
    for thread in (first, *others):
        thread.join(10)
    last = explorer.controls["x"].value
    assert explorer.values["x"] == last and f'lx-value">{last:.0f}<' in explorer.numbers.value
    assert made == [0, 1, last], "those who waited should have been answered once, together"


def test_slider_ends_are_whole_steps_from_its_value():
    made = slider("k", -0.2417, -0.6, 0.6, 0.005)
    steps_up = (made.value - made.min) / 0.005
    assert made.value == -0.2417 and abs(steps_up - round(steps_up)) < 1e-9 and abs(made.min + 0.6) < 0.005


@pytest.mark.parametrize(("span", "count", "step"), [(10, 5, 2), (0.9, 4, 0.5), (255, 8, 50), (0, 5, 1)])
def test_nice_step(span, count, step):
    assert chart.nice_step(span, count) == pytest.approx(step)


@pytest.mark.parametrize("largest", [0.3, 1.0, 4.9, 45.0, 100.0])
def test_an_axis_has_two_ticks_at_least(largest):
    ticks, step = chart.ticks_in((-largest, largest), 4)
    assert 2 <= len(ticks) <= 9 and np.allclose(np.diff(ticks), step) and np.abs(ticks).max() <= largest * 1.001
    assert len(chart.ticks_in((largest, largest), 4)[0]) < 2  # nothing to measure: it ends, too


def test_the_simulators_true_lines_have_no_corners():
    drawn = []
    with pytest.MonkeyPatch.context() as patch:
        draw_line = roads.draw.draw_line
        patch.setattr(roads.draw, "draw_line", lambda *a, **k: drawn.append(a[1]) or draw_line(*a, **k))
        look = roads.simulator_look(bend_1pkm=-12, heading_deg=-4, pitch_deg=-2, noise=0, wear=0)
    for line in drawn[:2]:
        line = line[np.isfinite(line).all(axis=1)]
        turns = np.diff(np.unwrap(np.arctan2(*np.diff(line, axis=0).T)))
        assert len(turns) > 10 and np.abs(turns).max() < 0.12
    assert look.picture.ndim == 3


def test_charts_draw_where_the_numbers_say():
    x = np.arange(11.0)
    flat = chart.line_chart([chart.Curve("", x, np.full(11, 5.0), "#ffffff", 3)], (400, 200), y_range=(0, 10))
    rows = np.flatnonzero((flat[:, 200] > 200).all(axis=1))
    middle = (chart.TOP + 200 - chart.BOTTOM) / 2
    assert len(rows) and abs(rows.mean() - middle) < 2
    gap = chart.line_chart(
        [chart.Curve("", x, np.where(x == 5, np.nan, 5.0), "#ffffff", 3)], (400, 200), y_range=(0, 10)
    )
    at_gap = round((chart.LEFT + 400 - chart.RIGHT) / 2)
    assert not (gap[rows, at_gap] > 200).any() and (flat[rows, at_gap] > 200).any()
    counts = np.zeros(256, int)
    counts[128] = 100
    bars = chart.histogram_chart(counts, (0, 255), (100, 150), (500, 120))
    lit = np.abs(bars[60].astype(int) - chart.histogram_chart(counts, (0, 255), (0, 1), (500, 120))[60]).sum(axis=1) > 0
    inside = chart.LEFT + np.array([110, 140]) / 255 * (500 - chart.LEFT - chart.RIGHT)
    assert lit[inside.astype(int)].all() and not lit[-40:].any()


# ------------------------------------------------------------------------------------------------ threshold
def test_threshold_scores_are_those_of_the_mask(seen):
    frame, truth, _ = seen
    explorer = explore.threshold(frame, truth)
    values = moved(explorer, range=(90, 250))
    mask = (CHANNELS["hls_s"](frame) >= 90) & (CHANNELS["hls_s"](frame) <= 250)
    judged = explore.paint_truth(truth, SIZE_WH)
    hits = (mask & judged.paint).sum()
    assert values["precision of step"] == pytest.approx(hits / (mask & judged.road).sum())
    assert values["recall of step"] == pytest.approx(hits / judged.paint.sum())
    assert values["white pixels"] == pytest.approx(100 * mask.mean())


def test_threshold_recipe_is_composed_and_its_code_does_the_same(seen):
    frame, truth, _ = seen
    explorer = explore.threshold(frame, truth)
    add, drop, clear = explorer.children[1].children[-3:]
    chosen = [
        ("hls_s", (90, 255), "OR"),
        ("brightness ridge", (0.8, 4), "OR"),
        ("sobel x", (8, 255), "AND"),
        ("direction", (1.4, 1.57), "AND NOT"),
        ("magnitude", (6, 250), "AND"),
        ("sobel y", (60, 255), "AND NOT"),
    ]
    for source, limits, way in chosen:
        explorer.set(source=source)
        moved(explorer, range=limits, way=way, equalise=source == "hls_s", ksize=5 if source == "sobel x" else 3)
        add.click()
    assert explorer.values["steps in recipe"] == len(chosen)
    namespace: dict = {}
    exec(explorer.look.code, namespace)
    mask = namespace["my_recipe"](frame)
    recipe = explorer.controls["steps"].value
    assert np.array_equal(mask, steps.combined([s.mask(frame) for s in recipe], [s.way for s in recipe]))
    assert 0 < (mask != 0).mean() < 0.5 and [s.source for s in recipe] == [c[0] for c in chosen]
    judged = explore.paint_truth(truth, SIZE_WH)
    assert (explorer.values["precision of recipe"], explorer.values["recall of recipe"]) == judged.score(mask)
    drop.click()
    assert explorer.values["steps in recipe"] == len(chosen) - 1
    clear.click()
    assert explorer.values["steps in recipe"] == 0


def test_threshold_remembers_ranges_and_starts_where_the_recipes_do(seen):
    frame, _, _ = seen
    explorer = explore.threshold(frame)
    assert explorer.controls["range"].value == (170, 255), "the S threshold of the classic recipe"
    explorer.set(range=(150, 240))
    explorer.set(source="direction")
    assert explorer.controls["range"].value == pytest.approx((0.5, 1.3))
    explorer.set(source="brightness ridge")
    mask = threshold.paint_steps(frame)["brighter on both sides"]
    assert explorer.values["white pixels"] == pytest.approx(100 * (mask != 0).mean())
    explorer.set(source="hls_s")
    assert explorer.controls["range"].value == (150, 240)
    assert "precision of step" not in explorer.values


@pytest.mark.parametrize("source", steps.SOURCES)
def test_every_source_can_be_chosen(seen, source):
    frame, truth, _ = seen
    low, high, _ = steps.domain(source)
    begin, end = steps.STARTS.get(source, (200, 255))
    assert low <= begin < end <= high
    look = explore.threshold_look(frame, explore.Step(source, begin, end), truth=explore.paint_truth(truth, SIZE_WH))
    assert look.picture.shape[1] == 960 and "my_recipe" in look.code


def test_paint_truth_is_where_the_simulator_painted(seen):
    """Against the simulator itself: the same scene with and without the two lines differs where paint is."""
    frame, truth, _ = seen
    bare, _ = render_road(replace(SCENE, left=None, right=None, noise=0))
    painted, _ = render_road(replace(SCENE, noise=0))
    differs = np.abs(painted.astype(int) - bare).max(axis=2) > 25
    judged = explore.paint_truth(truth, SIZE_WH)
    precision, recall = judged.score(differs)
    assert precision > 0.8 and recall > 0.8
    shifted = np.roll(differs, 12, axis=1)
    assert judged.score(shifted)[0] < 0.5, "a mask beside the paint scores as well as one on it"


def test_paint_truth_takes_masks_and_refuses_nonsense(seen):
    _, truth, _ = seen
    mask = np.zeros((360, 640), np.uint8)
    mask[100:110, 50:60] = 255
    assert explore.paint_truth(mask, SIZE_WH).score(mask) == (1, 1)
    assert not explore.paint_truth(truth | {"lanes": []}, SIZE_WH).paint.any()
    for wrong in (mask[:-1], {"no": 1}, 7):
        with pytest.raises(LanelibError):
            explore.paint_truth(wrong, SIZE_WH)


# ------------------------------------------------------------------------------------------------ warp
def test_warp_derives_the_geometry_of_the_rig(seen):
    frame, truth, rig = seen
    explorer = explore.warp(frame, rig, truth)
    values = explorer.values
    for name in ("height_m", "pitch_deg", "yaw_deg"):
        shown = {"height_m": "camera height", "pitch_deg": "pitch", "yaw_deg": "yaw"}[name]
        assert values[shown] == pytest.approx(truth["mounting"][name], abs=0.02)
    assert values["length, derived"] == pytest.approx(corners.AHEAD_M, abs=0.2)
    assert values["metres a pixel, along"] == pytest.approx(
        1.12 * values["length, used"] / corners.VIEW_WH[1], rel=1e-6
    )
    values = moved(explorer, derive=False, length_m=50.0)
    assert values["length, used"] == 50 and values["length, derived"] == pytest.approx(corners.AHEAD_M, abs=0.2)


def test_warp_of_the_classic_corners_equals_birdseye(seen):
    frame, truth, rig = seen
    explorer = explore.warp(frame, rig, truth)
    explorer.children[1].children[-2].click()
    classic = np.round(CLASSIC_SOURCE * SIZE_WH, 1)
    assert np.allclose(explorer.controls["corners"].value, classic)
    far_left, far_right, near_right, near_left = classic
    view = BirdsEye.from_straight_lines(rig.camera, [near_left, far_left], [near_right, far_right], lane_width_m=3.66)
    at = view.mounting(rig.camera)
    assert explorer.values["pitch"] == pytest.approx(at["pitch_deg"]) and explorer.values[
        "camera height"
    ] == pytest.approx(at["height_m"])
    assert abs(explorer.values["lane widens by"]) > 20, "the classic corners belong to another car"
    explorer.children[1].children[-1].click()
    assert abs(explorer.values["lane widens by"]) < 20


def test_warp_tells_what_is_wrong_with_corners(seen):
    frame, _, rig = seen
    explorer = explore.warp(frame, rig)
    good = explorer.controls["corners"].value
    for order in ((3, 2, 1, 0), (1, 0, 3, 2), (0, 0, 2, 3)):
        explorer.set(corners=[good[i] for i in order])
        assert "lx-alert" in explorer.numbers.value and "fault" not in explorer.numbers.value
    explorer.set(corners=good)
    assert "lx-alert" not in explorer.numbers.value


def test_warp_takes_a_camera_alone(seen):
    frame, _, rig = seen
    explorer = explore.warp(frame, rig.camera)
    assert np.allclose(explorer.controls["corners"].value, np.round(CLASSIC_SOURCE * SIZE_WH, 1))
    assert explorer.values["lane widens by"] is None


# ------------------------------------------------------------------------------------------------ detect
def test_detect_starts_with_what_the_finder_does(seen):
    frame, truth, rig = seen
    explorer = explore.detect(frame, rig, truth)
    for recipe in ("paint", "sobel-or-colour"):
        explorer.set(recipe=recipe)
        finder = LaneFinder(rig, recipe=recipe, model="windows", track=False)
        view = finder.view(SIZE_WH)
        mask = view.metric.warp(finder.recipe.function(rig.camera.undistort(frame)))
        left, right = windows.fit_lines(windows.find_pixels(mask, view.metric.grid), view.metric.grid)
        assert explorer.values["lane width"] == pytest.approx(right.x(0) - left.x(0), rel=0.02)
        assert explorer.values["offset"] == pytest.approx(-(right.x(0) + left.x(0)) / 2, abs=0.02)


def test_detect_joint_fit_is_the_finders_and_the_controls_count(seen):
    frame, truth, rig = seen
    explorer = explore.detect(frame, rig, truth)
    before = explorer.values["pixels, left"]
    assert moved(explorer, margin_m=0.1)["pixels, left"] < before
    moved(explorer, n_windows=4, minimum_pixels=300)
    moved(explorer, way="around the last lane")
    values = moved(explorer, model="joint")
    lane = LaneFinder(rig, track=False).process(frame).lane
    assert values["offset"] == lane.offset_m and values["curvature"] == 1000 * lane.curvature_1pm
    assert all(explorer.controls[name].disabled for name in ("way", "n_windows", "margin_m", "minimum_pixels"))
    truths = {reading.name: reading.truth for reading in explorer.look.readings}
    assert truths["offset"] == truth["offset_m"] and truths["radius"] == truth["radius_m"]


def test_detect_says_why_there_is_no_lane(seen):
    _, _, rig = seen
    look = explore.detect_look(explore.Frame(np.full((360, 640, 3), 90, np.uint8), rig))
    assert look.values["outcome"] == "none" and look.values["reason"] and look.values["offset"] is None
    assert detection.minimum_by_default(explore.Frame(np.zeros((360, 640, 3), np.uint8), rig)) >= 1


# ------------------------------------------------------------------------------------------------ simulator
def test_simulator_shows_the_scene_asked_for():
    explorer = explore.simulator(bend_1pkm=2.0)
    values = moved(explorer, offset_m=0.5, pitch_deg=0.6)
    readings = {reading.name: reading for reading in explorer.look.readings}
    assert readings["curvature"].truth == pytest.approx(2.0, rel=1e-3)
    assert readings["offset"].truth == pytest.approx(0.5) and readings["nod of the car"].truth == 0.6
    frame, _ = render_road(explore.scene_of(bend_1pkm=2.0, offset_m=0.5, pitch_deg=0.6))
    result = LaneFinder(roads.simulated_rig(), track=False).process(frame)
    assert values["offset"] == result.offset_m and values["error at 10 m"] < 5
    for change in (
        {"shade": True},
        {"concrete": True},
        {"wear": 0.7},
        {"light": 0.4},
        {"noise": 12.0},
        {"along_m": 4},
        {"heading_deg": 1.0},
        {"recipe": "gradient-and-colour"},
    ):
        moved(explorer, **change)
    explorer.children[1].children[-1].click()
    assert explorer.state["wear"] == 0.2 and explorer.state["bend_1pkm"] == 2.0


def test_simulator_without_a_lane_shows_no_number():
    values = explore.simulator_look(light=0.001).values
    assert values["outcome"] == "none" and values["offset"] is None and np.isnan(values["error at 10 m"])


# ------------------------------------------------------------------------------------------------ lens, boards
def test_distortion_against_opencv(seen):
    frame, _, rig = seen
    explorer = explore.distortion(rig.camera, frame)
    assert explorer.values["from the calibration"] == pytest.approx(0, abs=1e-6)
    values = moved(explorer, k1=-0.15, p1=0.004, f=620.0)
    tried = lens.camera_of(
        rig.camera,
        k1=-0.15,
        k2=rig.camera.distortion[1],
        p1=0.004,
        p2=rig.camera.distortion[3],
        k3=rig.camera.distortion[4],
        f=620.0,
    )
    at, k = np.array([0.0, (360 - 1) / 2]), tried.camera_matrix
    back = at.copy()
    for _ in range(200):  # the point that OpenCV's lens moves to `at`, by fixed-point steps
        ray = np.array([[*((back - k[:2, 2]) / np.diag(k)[:2]), 1.0]])
        back = back + at - cv2.projectPoints(ray, np.zeros(3), np.zeros(3), k, tried.distortion)[0].ravel()
    assert values["left edge moves by"] == pytest.approx(np.hypot(*(back - at)), abs=0.01)
    assert moved(explorer, none=True)["corners move by"] == pytest.approx(0, abs=1e-9)
    explorer.children[1].children[-1].click()
    assert explorer.values["from the calibration"] == pytest.approx(0, abs=1e-6)


def test_distortion_difference_and_field_of_view():
    camera = Camera.ideal((1280, 720), hfov_deg=60)
    look = explore.distortion_look(camera, None, k1=0, k2=0, p1=0, p2=0, k3=0, f=camera.camera_matrix[0, 0])
    assert look.values["width of view"] == pytest.approx(60) and look.values["lens folds over at"] == "nowhere"
    other = Camera(camera.camera_matrix + [[0, 0, 3], [0, 0, 4], [0, 0, 0]], np.zeros(5), (1280, 720))
    assert lens.difference_px(other, camera) == pytest.approx(5)
    folded = explore.distortion_look(camera, None, k1=-1.5, k2=0, p1=0, p2=0, k3=0, f=camera.camera_matrix[0, 0])
    assert folded.values["lens folds over at"] == pytest.approx(np.degrees(np.arctan((3 * 1.5) ** -0.5)))
    assert np.isnan(folded.values["corners move by"])


@pytest.fixture(scope="module")
def calibrated():
    pictures = [(f"board{i}.png", chessboards.render(*pose)) for i, pose in enumerate(chessboards.POSES[:4])]
    pictures.append(("blank.png", np.full((390, 660), 90, np.uint8)))
    return calibrate(pictures, board_wh=(7, 5)), pictures


def test_boards_show_the_errors_of_the_calibration(calibrated):
    calibration, pictures = calibrated
    explorer = explore.boards(calibration, pictures)
    for i, board in enumerate(calibration.boards):
        if i:
            explorer.children[1].children[-2].click()  # Next
        assert explorer.values["picture"] == board.name and explorer.values["rms of this board"] == board.rms_px
        if board.used:
            off = projected_corners(board, calibration) - board.corners_px
            assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(board.rms_px, rel=0.01)
            assert explorer.values["worst corner"] == pytest.approx(np.hypot(*off.T).max())
    assert explorer.values["used"] == "no" and explorer.values["remark"]
    explorer.children[1].children[-1].click()  # Worst
    errors = [board.rms_px or 0 for board in calibration.boards]
    assert explorer.values["rms of this board"] == max(errors)
    assert board_points((7, 5)).shape == (35, 3)


def test_boards_need_their_pictures(calibrated, tmp_path):
    calibration, pictures = calibrated
    with pytest.raises(LanelibError, match="board3.png"):
        explore.boards(calibration, pictures[:3])
    for name, picture in pictures:
        cv2.imwrite(str(tmp_path / name), picture)
    assert explore.boards(calibration, tmp_path).values["picture"] == "board0.png"


# ------------------------------------------------------------------------------------------------ smoothing
def synthetic_fits(n=120, *, std=0.08, seed=3, frames=12):
    """A lane that swings under the car, a radian in so many ``frames``, measured with a known error; the truth as the
    truth file tells it."""
    random = np.random.default_rng(seed)
    fits, truth = [], []
    for i in range(n):
        centre = 0.4 * np.sin(i / frames)
        mean = UNKNOWN_ROAD.mean.copy()
        mean[CENTRE] = centre + random.normal() * std
        covariance = np.diag([std**2, 1e-6, 1e-8, 1e-12, 1e-4, 1e-6, 1e-10])
        information = np.linalg.inv(covariance) + np.linalg.inv(UNKNOWN_ROAD.covariance)
        fits.append(JointFit(mean, np.linalg.inv(information), np.full((2, 136), 0.3), 50.0, 1.3, 1.0))
        y = np.arange(-4.0, 60, 2)
        lines = [np.column_stack([np.full(len(y), centre + side * 3.65 / 2), y]).tolist() for side in (-1, 1)]
        truth.append({"lanes_road_m": lines})
    return fits, truth


def test_smoothing_numbers_are_those_of_the_curves():
    fits, truth = synthetic_fits()
    explorer = explore.smoothing(fits, truth)
    values = moved(explorer, smoothing="exponential", alpha=0.1)
    state, centres = None, []
    for fit in fits:  # exponential smoothing written out
        state = fit.mean if state is None else state + 0.1 * (fit.mean - state)
        centres.append(state[CENTRE])
    true = 0.4 * np.sin(np.arange(len(fits)) / 12)
    off = np.array(centres) - true
    assert values["error"] == pytest.approx(100 * np.sqrt(np.mean(off**2)), rel=1e-3)
    assert values["jitter"] == pytest.approx(100 * np.sqrt(np.mean(np.diff(off) ** 2)), rel=1e-3)
    time_s = np.arange(len(fits)) / 25
    assert values["lag"] == pytest.approx(lag_s(time_s, true, np.array(centres)), abs=0.011) and values["lag"] > 0.2


def test_smoothing_kalman_has_the_least_error_and_none_is_the_frames_own():
    fits, truth = synthetic_fits(240, std=0.05, frames=18)  # a swing nearly as quick as a lane change: 0.55 m/s
    found = {
        name: explore.smoothing_look(fits, truth, smoothing=name).values for name in ("none", "exponential", "kalman")
    }
    assert found["none"]["error"] == pytest.approx(found["none"]["error, each frame alone"])
    assert found["kalman"]["error"] < min(found["none"]["error"], found["exponential"]["error"])
    assert found["kalman"]["jitter"] < found["none"]["jitter"] / 1.3


def test_fusing_equals_the_covariance_form_of_the_kalman_filter():
    fits, _ = synthetic_fits(1)
    random = np.random.default_rng(0)
    half = random.normal(size=(7, 7)) * np.sqrt(np.diag(UNKNOWN_ROAD.covariance))[:, None] * 0.3
    prediction = Prior(
        UNKNOWN_ROAD.mean + 0.01 * random.normal(size=7) * np.sqrt(np.diag(UNKNOWN_ROAD.covariance)),
        half @ half.T + 1e-3 * UNKNOWN_ROAD.covariance,
    )
    fit = fits[0]
    unknown = np.diag(UNKNOWN_ROAD.covariance).copy()
    unknown[3] = min(unknown[3], smoothers.rate_std(fit.mean) ** 2)
    noise = np.linalg.inv(np.linalg.inv(fit.covariance) - np.diag(1 / unknown))
    measured = noise @ (np.linalg.solve(fit.covariance, fit.mean) - UNKNOWN_ROAD.mean / unknown)
    gain = prediction.covariance @ np.linalg.inv(prediction.covariance + noise)
    fused = smoothers.fused(fit, prediction)
    std = np.sqrt(np.diag(prediction.covariance))
    assert np.allclose(fused.mean / std, (prediction.mean + gain @ (measured - prediction.mean)) / std, atol=1e-5)
    assert np.allclose(np.diag(fused.covariance), np.diag((np.eye(7) - gain) @ prediction.covariance), rtol=1e-3)


def test_smoothing_draws_each_way_in_its_own_colour():
    fits, truth = synthetic_fits(40)
    colours = {name: np.array(draw.bgr(code)) for name, code in draw.SMOOTHER_COLOURS.items()}
    for name in SMOOTHING:
        picture = explore.smoothing_look(fits, truth, smoothing=name).picture
        drawn = {key for key, colour in colours.items() if (np.abs(picture - colour).max(axis=2) == 0).sum() > 60}
        assert drawn == {"each frame alone", name}


def test_smoothing_losses_are_held_then_forgotten():
    fits, truth = synthetic_fits(100)
    held = explore.smoothing_look(fits, truth, lost=10, hold_frames=12).values
    assert held["frames held"] == 40 and held["frames without"] == 0
    forgotten = explore.smoothing_look(fits, truth, lost=10, hold_frames=4).values
    assert forgotten["frames held"] == 16 and forgotten["frames without"] == 24
    shaken = explore.smoothing_look(fits, truth, noise_m=0.3, smoothing="none").values
    assert shaken["error"] == pytest.approx(100 * np.hypot(0.3, 0.08), rel=0.25)


def test_smoothing_takes_results_and_refuses_others(seen):
    frame, truth, rig = seen
    result = LaneFinder(rig, track=False).process(frame)
    values = explore.smoothing([result] * 30, [truth] * 30).values
    assert values["jitter"] == pytest.approx(0, abs=0.2) and values["error"] < 10
    assert "error" not in explore.smoothing([result] * 30).values
    for results, truths in (([], None), (["x"], None), ([result], [])):
        with pytest.raises(LanelibError):
            explore.smoothing(results, truths)


# ------------------------------------------------------------------------------------------------ scrub
BAD, N = 9, 20


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A short drive in a file, with one frame that is nearly black, and its truth by name."""
    path, truth = tmp_path_factory.mktemp("clip") / "drive.mp4", {}
    with VideoWriter(path, size_wh=roads.SIZE_WH, fps=25) as writer:
        for i in range(N):
            frame, row = render_road(explore.scene_of(along_m=float(i), bend_1pkm=1.5, light=1e-4 if i == BAD else 1.0))
            writer.write(frame)
            truth[f"drive.mp4:{i:06d}"] = row | {"raw_file": f"drive.mp4:{i:06d}"}
    return path, truth


def test_scrub_shows_the_result_of_every_frame(clip):
    path, truth = clip
    explorer = explore.scrub(path, roads.simulated_rig(), truth=truth)
    finder = LaneFinder(roads.simulated_rig())
    for i, frame in enumerate(scrubber.read_frames(path)):
        result = finder.process(frame.frame_bgr)
        explorer.set(number=i)
        assert explorer.values["frame"] == i and explorer.values["offset"] == result.offset_m
        assert explorer.values["time"] == pytest.approx(i / 25, abs=1e-3)
    assert explorer.controls["number"].max == N - 1
    for stage in scrubber.STAGES[1:]:
        moved(explorer, stage=stage)


def test_scrub_jumps_to_the_worst_frame(clip):
    path, _ = clip
    found = explore.look_through(path, roads.simulated_rig())
    assert found.results[BAD].status == "held" and found.worst[0] == BAD
    assert found.badness[BAD] == pytest.approx(100 - 50 * found.results[BAD].confidence)
    assert found.badness[0] == pytest.approx(100 - 100 * found.results[0].confidence)
    explorer = explore.scrub_clip(found)
    on, worst = explorer.children[1].children[-2:]
    worst.click()
    assert explorer.values["frame"] == BAD and explorer.values["outcome"] == "held"
    on.click()
    assert explorer.values["frame"] == BAD + 1


def test_badness_with_truth_counts_misses_and_false_lanes(clip):
    path, truth = clip
    found = explore.look_through(path, roads.simulated_rig(), truth=truth, track=False)
    assert found.badness[BAD] == 100 and np.delete(found.badness, BAD).max() < 5
    empty = {name: row | {"lanes": [], "visible": []} for name, row in truth.items()}
    found = explore.look_through(path, roads.simulated_rig(), truth=empty, end_s=0.2)
    assert len(found) == 5 and set(found.badness) == {100}


def test_scrub_refuses_an_empty_section(clip):
    with pytest.raises(LanelibError):
        explore.look_through(clip[0], roads.simulated_rig(), start_s=5.0)


def test_every_explorer_is_in_the_documentation():
    listed = re.findall(r"^(\w+(?:, \w+)*) {2,}", explore.__doc__, flags=re.MULTILINE)
    names = [name for entry in listed for name in entry.split(", ")]
    assert set(names) == {"distortion", "boards", "threshold", "warp", "detect", "smoothing", "scrub", "simulator"}
    assert all(callable(getattr(explore, name)) for name in names) and set(names) <= set(explore.__all__)
