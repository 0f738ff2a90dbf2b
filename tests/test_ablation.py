"""Ablation: variants differ in what they say they do; the error budget agrees with geometry."""

import math

import numpy as np
import pytest

from lanelib import ablation
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, LaneResult
from lanelib.jointfit import PITCH
from lanelib.lane import Lane, Line
from lanelib.rig import Rig
from lanelib.road import CarPose, Mounting, Road
from lanelib.simulator import Scene, render_road

HEIGHT_M, PITCH_DEG = 1.31, 1.9  # not the simulator's own


def drive(bend_1pm=0.0, nod_deg=0.0, **more):
    mounting = Mounting(HEIGHT_M, PITCH_DEG + nod_deg)
    return render_road(Scene(road=Road([0], [bend_1pm]), pose=CarPose(3.0, 0.2), mounting=mounting, **more))


@pytest.fixture(scope="module")
def rig() -> Rig:
    scene = Scene()
    camera = Camera(np.array(scene.camera_matrix), np.array(scene.distortion), scene.size_wh)
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=HEIGHT_M, pitch_deg=PITCH_DEG))


@pytest.fixture(scope="module")
def road() -> tuple[dict, dict]:
    made = {f"{bend * 1e3:.1f}": drive(bend) for bend in (0.0, 0.0015, -0.0025)}
    return {name: frame for name, (frame, _) in made.items()}, {
        name: truth | {"raw_file": name} for name, (_, truth) in made.items()
    }


def test_every_variant_sees_an_easy_road_and_the_last_is_the_projects_own(rig, road):
    runs = ablation.ablate(rig, *road)
    assert list(runs) == [v.name for v in ablation.VARIANTS]
    own = LaneFinder(rig, track=False)
    for name, one in runs.items():
        assert one.right == 1, (name, one.failures())
    for name, frame in road[0].items():
        assert runs[ablation.VARIANTS[-1].name].rows[name]["lanes"] == own.process(frame).to_row(name)["lanes"]
    text = ablation.comparison(runs)
    assert len(text.splitlines()) == 2 + len(runs) and "jitter" not in text


def test_variants_are_built_differently(rig):
    made = [v.finder(rig, track=False) for v in ablation.VARIANTS]
    kinds = {(f.recipe.name, f.model, f.order, type(f).__name__) for f in made}
    assert len(kinds) == len(made)
    flat = ablation.FlatRoadFinder(rig, fps=10)
    for _ in range(2):
        assert isinstance(flat.tracker, ablation.FlatRoadTracker) and flat.tracker.fps == 10
        flat.reset()


@pytest.mark.parametrize("nod_deg", [-0.7, 0.6])
def test_only_the_full_finder_sees_the_car_nod(rig, nod_deg):
    frame, _ = drive(0.001, nod_deg)
    seen = LaneFinder(rig, track=False).process(frame)
    flat = ablation.FlatRoadFinder(rig, track=False).process(frame)
    assert math.degrees(seen.fit.mean[PITCH]) == pytest.approx(nod_deg, abs=0.15)
    if flat:
        assert abs(math.degrees(flat.fit.mean[PITCH])) < 0.05


@pytest.mark.parametrize("nod_deg", [-0.4, 0.25])
def test_nodded_moves_the_road_as_the_angle_says(nod_deg):
    camera = Camera.ideal((800, 450), hfov_deg=62)
    rig = Rig(camera, BirdsEye.from_mounting(camera, height_m=1.4, pitch_deg=2.2))
    y = np.array([6.0, 14.0, 25.0])
    seen = rig.birdseye.points_from_road(np.column_stack([np.zeros(3), y]))
    believed = ablation.nodded(rig, nod_deg).birdseye.road_from_points(seen)[:, 1]
    # the true depression of a point is atan(h / y); the rig takes the camera for nod_deg less pitched than it is
    expected = 1.4 / np.tan(np.arctan(1.4 / y) - math.radians(nod_deg))
    assert believed == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("bend_1pm", [0.0, 0.003, -0.002])
def test_perfect_points_lie_on_the_true_lines(rig, bend_1pm):
    _, truth = drive(bend_1pm)
    view = LaneFinder(rig, track=False).view(rig.size_wh)
    points = ablation.perfect_points(view, truth)
    y = 1 / points.inverse
    x = points.bearing * y
    true = [np.interp(y, *np.asarray(line).T[::-1]) for line in truth["lanes_road_m"]]
    near = y < 25
    assert near.sum() > 60
    assert np.min(np.abs(x - true), axis=0)[near].max() < 0.03
    assert (np.abs(np.log(view.grid.y_m[points.row] / y)) < 0.05).all()


def test_believed_error_is_in_metres_and_signed():
    truth = {"lanes_road_m": [[[-1.8, 0.0], [-1.8, 40.0]], [[1.8, 0.0], [1.8, 40.0]]]}
    lane = Lane(Line([0.0, 0.0, -1.7], (3, 40)), Line([0.0, 0.01, 1.8], (3, 40)))
    errors = ablation.believed_error_m(lane, truth, [10, 20, 50])
    assert errors[0, :2] == pytest.approx([0.1, 0.1]) and errors[1, :2] == pytest.approx([0.1, 0.2])
    assert np.isnan(errors[:, 2]).all() and np.isnan(ablation.believed_error_m(None, truth)).all()


def test_the_budget_finds_the_error_that_was_put_in(rig, road):
    budget = ablation.error_budget(rig, *road, calibrated=rig.camera, nod_deg=0.35)
    at_20 = {name: float(errors[2]) for name, errors in budget.items()}
    by_hand = 1.83 * 20 * math.radians(0.35) / HEIGHT_M  # x y delta / h
    known, estimated = at_20["nod of 0.35 deg, pitch taken as known"], at_20["nod of 0.35 deg, pitch estimated"]
    assert 0.4 * by_hand < known < 1.8 * by_hand and estimated < known / 3
    assert at_20["the fit alone, on perfect paint"] < 0.02 and at_20["paint as found"] < 0.05
    assert at_20["camera from the boards"] == pytest.approx(at_20["paint as found"], abs=1e-9)
    assert at_20["distortion ignored"] > at_20["paint as found"]


class Parrot:
    """Says for each frame in turn what it is told."""

    def __init__(self, results):
        self.results, self.next = results, 0

    def reset(self):
        self.next = 0

    def process(self, _):
        self.next += 1
        return self.results[self.next - 1]


def test_failures_tell_missed_wrong_and_invented(rig):
    frame, truth = drive()
    good = LaneFinder(rig, track=False).process(frame)
    aside = LaneFinder(rig, track=False).process(np.roll(frame, 60, axis=1))
    assert aside
    empty = truth | {"lanes": [], "visible": [], "lanes_road_m": []}
    truths = {n: t | {"raw_file": n} for n, t in zip("abcd", (truth, truth, truth, empty), strict=True)}
    parrot = Parrot([good, LaneResult(None, "none", "too dark", size_wh=rig.size_wh), aside, good])
    one = ablation.run(parrot, [(n, frame) for n in "abcd"], truths, rig.camera)
    found = {frame.name: why for frame, why in one.failures()}
    assert list(found) == ["b", "c", "d"] and one.right == 0.25
    assert found["b"] == "missed: too dark" and "off at 10 m" in found["c"] and "where there is none" in found["d"]


def test_frames_need_truth(rig):
    with pytest.raises(LanelibError, match="none for 'x'"):
        ablation.run(LaneFinder(rig), [("x", np.zeros((360, 640, 3), np.uint8))], {}, rig.camera)
    with pytest.raises(LanelibError, match="found no frame"):
        ablation.ablate(rig, {}, {})


@pytest.mark.parametrize("name", ablation.CONDITIONS)
def test_conditions_leave_the_frame_alone_and_repeat(name):
    frame = np.random.default_rng(3).integers(0, 256, (40, 60, 3), np.uint8)
    before, change = frame.copy(), ablation.CONDITIONS[name]
    after = change(frame)
    assert after.dtype == np.uint8 and after.shape == frame.shape
    assert np.array_equal(frame, before) and np.array_equal(after, change(frame))
    assert np.array_equal(after, frame) == (name == "as it is")


def test_a_clip_has_jitter(rig):
    made = {f"c.mp4:{i:06}": drive(0.001, seed=i) for i in range(4)}
    truth = {n: t | {"raw_file": n, "time_s": i / 25} for i, (n, (_, t)) in enumerate(made.items())}
    runs = ablation.ablate(
        rig, {n: f for n, (f, _) in made.items()}, truth, track=True, variants=ablation.VARIANTS[-1:]
    )
    assert "jitter cm" in ablation.comparison(runs)


def test_by_tag_counts_each_frame_in_every_tag_of_its(rig, road):
    truth = {n: t | {"tags": ["bend"] if n != "0.0" else ["straight"]} for n, t in road[1].items()}
    one = ablation.run(LaneFinder(rig, track=False), road[0].items(), truth, rig.camera)
    lines = [line.split("|")[1:4] for line in ablation.by_tag(one).splitlines()]
    rows = {tag.strip(): (int(n), float(right)) for tag, n, right in lines[2:]}
    assert rows == {"all": (3, 1.0), "bend": (2, 1.0), "straight": (1, 1.0)}


def test_a_view_of_the_rigs_own_size_is_the_rigs_own_view(rig, road):
    own = LaneFinder(rig, track=False)
    view = ablation.view_of_size(rig, column_m=rig.scan_grid.column_m, rows=len(rig.scan_grid.y_m))
    assert view.grid.x_m == pytest.approx(rig.scan_grid.x_m) and view.grid.y_m == pytest.approx(rig.scan_grid.y_m)
    for frame in road[0].values():
        lane, expected = ablation.lane_in_view(view, frame), own.process(frame).lane
        assert lane.left.x([8.0, 20.0]) == pytest.approx(expected.left.x([8.0, 20.0]), abs=0.01)


def test_another_size_covers_the_same_road(rig, road):
    view = ablation.view_of_size(rig, column_m=0.1, rows=90)
    assert view.grid.size_wh[1] == 90 and view.grid.column_m == pytest.approx(0.1)
    assert view.grid.y_m[[0, -1]] == pytest.approx(rig.scan_grid.y_m[[0, -1]])
    name, frame = next(iter(road[0].items()))
    errors = ablation.believed_error_m(ablation.lane_in_view(view, frame), road[1][name], [8, 15])
    assert np.abs(errors).max() < 0.06
    assert ablation.lane_in_view(view, np.zeros_like(frame)) is None
