"""autorig: a rig from drawn roads of known mounting, refusals, and the real road where it is there."""

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from roads import rig_of_scene

from lanelib import autorig
from lanelib.autorig import find_rig
from lanelib.camera import Camera
from lanelib.dashes import DashPeriod, dash_period
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder
from lanelib.result import line_at_rows
from lanelib.rig import Rig
from lanelib.road import CarPose, Marking, Mounting, Road
from lanelib.simulator import Scene, render_road

SIZE_WH = (960, 540)
LANE_M = 3.5  # not the default
LENS = (-0.2, 0.04, 0.0006, -0.0004, 0.0)


def scene(mounting, *, focal_px=870.0, lens=LENS, period_m=12.19, **more) -> Scene:
    """A lane 3.5 m wide, solid and dashed; the camera's middle is not the picture's unless there is no lens."""
    centre = (491.0, 262.0) if any(lens) else (479.5, 269.5)
    dashed = {"dash_m": period_m / 4, "gap_m": period_m * 3 / 4}
    lines = {
        "left": Marking(-LANE_M / 2, "yellow"),
        "right": Marking(LANE_M / 2, **dashed, phase_m=3.0),
        "others": (Marking(1.5 * LANE_M, **dashed, phase_m=1.0),),
    }
    return Scene(
        mounting=mounting,
        size_wh=SIZE_WH,
        camera_matrix=((focal_px, 0, centre[0]), (0, focal_px, centre[1]), (0, 0, 1)),
        distortion=lens,
        **(lines | more),
    )


def camera_of(a_scene: Scene) -> Camera:
    return Camera(np.array(a_scene.camera_matrix), np.array(a_scene.distortion), a_scene.size_wh)


def pictures(*scenes: Scene) -> list[np.ndarray]:
    return [render_road(s)[0] for s in scenes]


def share_right(rig: Rig, frame, rows, lanes, *, within_px: float) -> float:
    """Share of labelled points of a lane (-2: none) that the finder with this rig meets."""
    result = LaneFinder(rig, track=False).process(frame)
    hits, n = 0, 0
    for points, wanted in zip((result.left_px, result.right_px), np.array(lanes, float), strict=True):
        found = np.array(line_at_rows(points, np.array(rows), frame.shape[1]))
        labelled = wanted >= 0
        hits += np.count_nonzero(np.abs(found - wanted)[labelled] < within_px)
        n += np.count_nonzero(labelled)
    return hits / n


# ------------------------------------------------------------------ one frame, many mountings
@pytest.mark.parametrize(
    "focal_px, mounting",
    [
        (760.0, Mounting(1.15, -3.0, 0, 2.5)),
        (870.0, Mounting(1.50, 6.0, 0, -4.0)),
        (1050.0, Mounting(1.90, 1.5, 0, 1.0)),
    ],
)
def test_one_straight_frame_gives_the_mounting(focal_px, mounting):
    a_scene = scene(mounting, focal_px=focal_px, pose=CarPose(4.0, 0.25))
    found = find_rig(pictures(a_scene)[0], camera_of(a_scene), lane_width_m=LANE_M, name="drawn")
    assert found.height_m == pytest.approx(mounting.height_m, rel=0.015)
    assert found.pitch_deg == pytest.approx(mounting.pitch_deg, abs=0.1)
    assert found.yaw_deg == pytest.approx(mounting.yaw_deg, abs=0.15)
    assert found.n_frames == 1 and found.rig.name == "drawn" and found.rig.notes == found.notes
    assert found.std["pitch_deg"] < 0.5 and found.std["yaw_deg"] < 1.0 and found.std["height_m"] < 0.1
    # the rig is the same camera on the same road: metres agree
    there = rig_of_scene(a_scene).birdseye
    road = np.array([(-1.5, 6.0), (1.5, 12.0), (0.0, 25.0)])
    again = found.rig.birdseye.road_from_points(there.points_from_road(road))
    assert np.abs(again - road)[:, 0].max() < 0.1
    assert again[:, 1] == pytest.approx(road[:, 1], rel=0.05)


def test_the_lane_width_is_the_scale():
    a_scene = scene(Mounting(1.4, 3.0))
    frames = pictures(a_scene)
    half, double = (find_rig(frames, camera_of(a_scene), lane_width_m=w).height_m for w in (LANE_M, 1.5 * LANE_M))
    assert double == pytest.approx(1.5 * half, rel=1e-6)


def test_two_lanes_are_not_taken_for_one():
    """From 2.2 m two lanes look as wide as one from 1.1 m, the more usual height; the line between them decides."""
    a_scene = scene(Mounting(2.2, -1.0, 0, 2.0), pose=CarPose(3.0, -0.1))
    found = find_rig(pictures(a_scene), camera_of(a_scene), lane_width_m=LANE_M)
    assert found.height_m == pytest.approx(2.2, rel=0.02)


@pytest.mark.parametrize("aside, below", [(-40, 70), (30, -60)])
def test_climbs_to_the_road_from_a_vote_drawn_aside(monkeypatch, aside, below):
    """As in a curve: a vanishing point 4 degrees off, further than the joint fit takes for a nod."""
    a_scene = scene(Mounting(1.5, 4.0), lens=(0,) * 5)
    u, v = autorig.vanishing_point(rig_of_scene(a_scene))
    monkeypatch.setattr(autorig, "candidates", lambda pictures: [((u + aside, v + below), 1.4)])
    _, rig = autorig.search(pictures(a_scene), camera_of(a_scene), "climbed")
    assert np.abs(np.subtract(autorig.vanishing_point(rig), (u, v))).max() < 8


def test_a_clip_averages_nods_and_weaving():
    rng = np.random.default_rng(5)
    scenes = [
        scene(
            Mounting(1.3, 2.0 + nod, 0, -1.0), pose=CarPose(5.3 * i, rng.normal(0, 0.3), rng.normal(0, 0.006)), seed=i
        )
        for i, nod in enumerate(rng.normal(0, 0.3, 8))
    ]
    found = find_rig(pictures(*scenes), camera_of(scenes[0]), lane_width_m=LANE_M)
    assert found.n_frames == 8
    assert found.height_m == pytest.approx(1.3, rel=0.015)
    assert found.pitch_deg == pytest.approx(np.median([s.mounting.pitch_deg for s in scenes]), abs=0.1)
    heading = np.median([s.pose.heading_rad for s in scenes])
    assert found.yaw_deg == pytest.approx(-1.0 - math.degrees(heading), abs=0.15)
    assert found.std["pitch_deg"] == pytest.approx(np.std([s.mounting.pitch_deg for s in scenes], ddof=1), rel=0.4)


def test_straight_frames_are_preferred():
    mounting = Mounting(1.45, 2.5, 0, 1.0)
    bends = [0, 0, 1 / 400, 1 / 350, 1 / 300, 1 / 350]
    scenes = [scene(mounting, road=Road([0], [k]), pose=CarPose(4 + 3 * i), seed=i) for i, k in enumerate(bends)]
    found = find_rig(pictures(*scenes), camera_of(scenes[0]), lane_width_m=LANE_M)
    assert found.n_frames == 2
    assert found.yaw_deg == pytest.approx(1.0, abs=0.15)
    assert "straight road" not in found.notes


def test_one_straight_frame_of_many_is_said():
    bends = [0] + [1 / 300] * 6
    roads = [scene(Mounting(1.45, 2.5), road=Road([0], [k]), pose=CarPose(4 + 3 * i)) for i, k in enumerate(bends)]
    found = find_rig(pictures(*roads), camera_of(roads[0]), lane_width_m=LANE_M)
    assert found.n_frames == 1 and "from 1 of 7 frames" in found.notes and "little straight road" in found.notes


def test_a_gentle_curve_alone_is_taken_and_said():
    a_scene = scene(Mounting(1.45, 2.5, 0, 1.0), road=Road([0], [-1 / 500]))
    found = find_rig(pictures(a_scene), camera_of(a_scene), lane_width_m=LANE_M)
    assert "no straight road seen" in found.notes
    assert found.yaw_deg == pytest.approx(1.0, abs=0.6)
    assert found.height_m == pytest.approx(1.45, rel=0.03)


# ------------------------------------------------------------------ cameras of which nothing is known
def test_an_unknown_camera_still_finds_lanes():
    scenes = [scene(Mounting(1.55, 5.0, 0.5, 2.0), focal_px=1150, pose=CarPose(6 * i, 0.1), seed=i) for i in range(3)]
    found = find_rig(pictures(*scenes))
    assert "assumed" in found.notes and found.std["focal_px"] is None
    fresh = scene(Mounting(1.55, 5.2, 0.5, 2.0), focal_px=1150, pose=CarPose(40, -0.4, 0.01), road=Road([0], [1 / 700]))
    frame, truth = render_road(fresh)
    rows = np.array(truth["h_samples"])
    lanes = np.where(rows > found.rig.birdseye.horizon_row_px + 25, np.array(truth["lanes"]), -2)
    assert share_right(found.rig, frame, rows, lanes, within_px=5) > 0.97


@pytest.mark.parametrize("size_wh", [(640, 360), (360, 640)])
def test_an_assumed_lens_is_that_of_the_longer_side(size_wh):
    """A phone has the same lens upright."""
    _, camera, assumed = autorig._usable(np.zeros((*size_wh[::-1], 3), np.uint8), None, 3.7, 60.0, None)
    assert assumed and camera.size_wh == size_wh
    assert camera.camera_matrix[0, 0] == pytest.approx(320 / math.tan(math.radians(30)))


def test_dashes_give_the_focal_length():
    scenes = [scene(Mounting(1.4, 2.0, 0, 1.0), focal_px=1000, lens=(0,) * 5, pose=CarPose(7 * i)) for i in range(6)]
    frames = pictures(*scenes)
    guessed = find_rig(frames, hfov_deg=60, lane_width_m=LANE_M)
    assert guessed.focal_px == pytest.approx(480 / math.tan(math.radians(30)))
    assert guessed.dash.period_m == pytest.approx(12.19 * guessed.focal_px / 1000, rel=0.03)
    found = find_rig(frames, lane_width_m=LANE_M, dash_period_m=12.19)
    assert found.focal_px == pytest.approx(1000, rel=0.04)
    assert abs(found.focal_px - 1000) < 3 * found.std["focal_px"]
    assert found.dash.period_m == pytest.approx(12.19, rel=0.015)  # on the scale of the rig that is handed out
    assert found.height_m == pytest.approx(1.4, rel=0.015)


# ------------------------------------------------------------------ refusals
def empty_road() -> np.ndarray:
    return pictures(scene(Mounting(1.4, 2.0), left=None, right=None, others=()))[0]


def crossing() -> np.ndarray:
    """A zebra crossing and nothing else."""
    frame = empty_road()
    for k in range(12):
        near, far = 90 * k - 60, 80 * k
        cv2.fillPoly(frame, [np.int32([(far, 380), (far + 40, 380), (near + 45, 450), (near, 450)])], (220, 220, 220))
    return frame


NO_ROADS = {
    "black": lambda: np.zeros((540, 960, 3), np.uint8),
    "white": lambda: np.full((540, 960, 3), 255, np.uint8),
    "noise": lambda: np.random.default_rng(1).integers(0, 256, (540, 960, 3), dtype=np.uint8),
    "no lines": empty_road,
    "one line": lambda: pictures(scene(Mounting(1.4, 2.0), right=None, others=()))[0],
    "a crossing": crossing,
    "upside down": lambda: np.ascontiguousarray(pictures(scene(Mounting(1.4, 2.0)))[0][::-1]),
    "on its side": lambda: np.ascontiguousarray(np.rot90(pictures(scene(Mounting(1.4, 2.0)))[0])),
    "a hairpin": lambda: pictures(scene(Mounting(1.4, 2.0), road=Road([0], [1 / 60])))[0],
}


@pytest.mark.parametrize("what", NO_ROADS)
def test_refuses_what_shows_no_straight_lane(what):
    with pytest.raises(LanelibError, match="a rig needs .* found .*; give") as caught:
        find_rig(NO_ROADS[what]())
    assert "\n" not in str(caught.value)


def test_refuses_what_is_no_set_of_frames():
    frame = np.zeros((540, 960, 3), np.uint8)
    with pytest.raises(LanelibError, match="at least one frame"):
        find_rig([])
    with pytest.raises(LanelibError, match="one size"):
        find_rig([frame, frame[:500]])
    with pytest.raises(LanelibError, match="100x100"):
        find_rig(frame[:1, :1])
    with pytest.raises(LanelibError, match="2 to 6 m"):
        find_rig(frame, lane_width_m=370)
    with pytest.raises(LanelibError, match="proportions"):
        find_rig(frame, Camera.ideal((640, 480), hfov_deg=60))
    for nothing in (None, 7):
        with pytest.raises(LanelibError, match=f"a list of them, found {type(nothing).__name__}"):
            find_rig(nothing)


@pytest.mark.parametrize("period_m", [-3, 0, np.nan, np.inf])
def test_what_contradicts_itself_is_refused_before_anything_is_searched(monkeypatch, period_m):
    monkeypatch.delattr(autorig, "search")
    frame = np.zeros((540, 960, 3), np.uint8)
    with pytest.raises(LanelibError, match=f"above 0 m, found {period_m}"):
        find_rig(frame, dash_period_m=period_m)
    with pytest.raises(LanelibError, match="calibrated camera has its focal length"):
        find_rig(frame, Camera.ideal((960, 540), hfov_deg=60), dash_period_m=14.63)


def test_a_calibrated_focal_length_is_not_overruled_and_none_comes_from_solid_lines():
    a_scene = scene(Mounting(1.4, 2.0), lens=(0,) * 5)
    with pytest.raises(LanelibError, match="calibrated camera has its focal length"):
        find_rig(pictures(a_scene), camera_of(a_scene), dash_period_m=14.63)
    solid = replace(a_scene, right=Marking(LANE_M / 2), others=())
    with pytest.raises(LanelibError, match="no dashed line"):
        find_rig(pictures(solid), dash_period_m=14.63)


def test_the_dashes_must_be_seen_to_the_end(monkeypatch):
    looks = iter([DashPeriod(12.2, 0.2, 1)] * 3 + [DashPeriod(reason="no dashed line was clear enough")])
    monkeypatch.setattr(autorig, "dash_period", lambda rig, frames: next(looks))
    with pytest.raises(LanelibError, match="needs dashes to measure, found no dashed line"):
        find_rig(pictures(scene(Mounting(1.4, 2.0), lens=(0,) * 5)), dash_period_m=12.19)


# ------------------------------------------------------------------ the real road
def labelled(real_dir, *starts):
    rows = [json.loads(line) for line in (real_dir / "labels.jsonl").read_text().splitlines()]
    rows = [row for row in rows if row["raw_file"].startswith(starts)]
    frames = [cv2.imread(str(next(real_dir.glob(f"*/test_images/{row['raw_file']}")))) for row in rows]
    return rows, frames


@pytest.mark.parametrize("starts", [("straight_lines",), ("solid",)])
def test_real_cameras_of_which_nothing_is_known(real_dir, starts):
    """Lanes found with a rig made from the frames themselves: the TuSimple criterion, 20 px of a 1280-wide frame."""
    rows, frames = labelled(real_dir, *starts)
    found = find_rig(frames)
    assert 1.1 < found.height_m < 1.4  # one car, two cameras behind its windscreen
    near = 20 * frames[0].shape[1] / 1280
    right = [
        share_right(found.rig, frame, row["h_samples"], row["lanes"], within_px=near)
        for frame, row in zip(frames, rows, strict=True)
    ]
    assert min(right) >= 0.9 and np.mean(right) >= 0.95


@pytest.mark.parametrize("starts, name", [(("straight_lines",), "udacity"), (("solid",), "finding_lanes")])
def test_shipped_rigs_fit_their_roads(real_dir, starts, name):
    """Each frame alone agrees with the shipped rig, made from a clip, within the nods of the car; the dashes are long
    enough."""
    shipped = Rig.load(Path(__file__).parents[1] / "rigs" / f"{name}.json")
    rows, frames = labelled(real_dir, *starts)
    assert frames[0].shape[1::-1] == shipped.size_wh
    found = find_rig(frames, shipped.camera)
    assert found.height_m == pytest.approx(shipped.mounting["height_m"], rel=0.05)
    assert found.pitch_deg == pytest.approx(shipped.mounting["pitch_deg"], abs=0.5)
    assert found.yaw_deg == pytest.approx(shipped.mounting["yaw_deg"], abs=0.6)
    # the lanes of single stretches are 3.5 to 3.7 m wide, and the ruler of the rig is one of 3.7 m
    assert dash_period(shipped, frames).period_m == pytest.approx(14.63, rel=0.08)
