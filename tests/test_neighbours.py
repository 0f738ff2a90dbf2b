"""neighbours.py, straighten.py: painted lanes beside the ego lane come out where they are; nothing else is one."""

import json
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import ASPHALT, SIZE_WH, WHITE, YELLOW, Lane7, paint_frame, project, rig, rig_of_scene

from lanelib import cli, draw, rigs
from lanelib.camera import Camera
from lanelib.datasets import project_root
from lanelib.draw.overlays import LINE_WIDTH
from lanelib.draw.palette import bgr
from lanelib.errors import LanelibError
from lanelib.evaluate import score
from lanelib.finder import LaneFinder, Rig
from lanelib.jointfit import JointFit
from lanelib.neighbours import find_neighbours
from lanelib.road import CarPose, Marking, Road, frame_truth
from lanelib.simulator import Scene, render_road
from lanelib.straighten import COLUMN_M, Straightened, paint_of, straightened
from lanelib.video import VideoWriter

ROOT = project_root()
STILLS = ROOT / "test_images" / "rendered"
DASHES = {"gap_m": 10.97, "dash_m": 3.66}


def scene_of(**kwargs) -> Scene:
    """The simulator's road at 1280x720, wide, without its own neighbour."""
    small = np.array(Scene().camera_matrix)
    large = Camera(small, np.zeros(5), (640, 360)).scaled((1280, 720)).camera_matrix
    given = {"others": (), "road_edges_m": (-9.0, 9.0), "size_wh": (1280, 720)}
    return Scene(camera_matrix=tuple(map(tuple, large.tolist())), **(given | kwargs))


def neighbours_in(scene, **kwargs):
    """The result with neighbours of one frame of a scene."""
    finder = LaneFinder(rig_of_scene(scene), **({"track": False, "neighbours": 1} | kwargs))
    return finder.process(render_road(scene)[0])


def pixels_off(scene, neighbour, d_m: float) -> np.ndarray:
    """How far (px, sideways) a neighbour is drawn from the marking at ``d_m``, row by row."""
    s = scene
    lines = Marking(d_m), Marking(1.83)
    truth = frame_truth(s.road, s.pose, s.mounting, s.camera_matrix, s.distortion, s.size_wh, *lines)
    rows, x = np.array(truth["h_samples"]), np.array(truth["lanes"][0])
    px = neighbour.points_px[::-1]
    found = np.interp(rows, px[:, 1], px[:, 0], left=np.nan, right=np.nan)
    return (found - x)[np.isfinite(found) & (x >= 0)]


# ---------------------------------------------------------------------------------------------- the straightened road
@pytest.mark.parametrize("lane", [Lane7(-0.4, 0.03, -1 / 500, 1e-5, 3.5), Lane7(0.6, -0.02, 1 / 900, 0, 3.9, 0.002)])
def test_a_column_is_a_line_parallel_to_the_lane(lane):
    """The table of the straightened road against cv2.projectPoints, which shares no code with it: a pixel."""
    view = LaneFinder(rig()).view(SIZE_WH)
    fit = JointFit(lane.mean, np.eye(7), np.zeros((2, 112)), 0.0, view.height_m, 0.0)
    road = straightened(view, fit, reach_m=8.0, far_m=50.0)
    assert road.d_m[0] <= -8.0 and np.allclose(np.diff(road.d_m), COLUMN_M)
    assert 45 < road.y_m[0] < 50 and (np.diff(road.y_m) < 0).all()
    tilt = {"pitch_deg": 3.1 + np.degrees(lane.pitch)}
    for d in (-7.3, -5.15, 0.0, 2.6, 5.5, 7.9):
        expected = project(np.column_stack([replace(lane, width=2 * d).x(road.y_m, 1), road.y_m, 0 * road.y_m]), **tilt)
        column = int(round((d - road.d_m[0]) / COLUMN_M))
        found = np.column_stack([road.map_x[:, column], road.map_y[:, column]])
        seen = road.inside[:, column]
        assert seen.sum() > 20
        assert np.abs(found - expected)[seen].max() < 1.0
        on_line = road.pixels(np.full(len(road.y_m), d))
        assert np.allclose(on_line, found[seen][::-1], atol=0.02)


# ---------------------------------------------------------------------------------------------- lanes that are there
@settings(max_examples=6, deadline=None)
@given(
    st.floats(2.9, 4.3), st.floats(-0.6, 0.6), st.floats(-1 / 350, 1 / 350), st.sampled_from([-1, 1]), st.floats(0, 14)
)
def test_a_dashed_line_beyond_is_found_where_it_is(width, offset, curvature, side, phase):
    """On either side: width of the lane to 12 cm, its line in the picture to 4 px, within its own uncertainty."""
    d = side * (1.83 + width)
    scene = scene_of(
        left=Marking(-1.83),
        right=Marking(1.83, **DASHES, phase_m=7.0),
        others=(Marking(d, width_m=0.15, **DASHES, phase_m=phase),),
        road=Road([0], [curvature]),
        pose=CarPose(10, offset, 0.005),
    )
    found = neighbours_in(scene).neighbours
    assert [n.side for n in found] == [side]
    assert found[0].width_m == pytest.approx(width, abs=0.12)
    assert abs(found[0].width_m - width) < 3 * found[0].width_std_m < 1.0
    assert (found[0].colour, found[0].across, found[0].place) == ("white", "white", 1)
    off = pixels_off(scene, found[0], d)
    assert len(off) >= 4 and np.abs(off).mean() < 4.0
    y = np.array([8.0, 25.0])
    true = frame_truth(scene.road, scene.pose, scene.mounting, scene.camera_matrix, scene.distortion, (1280, 720),
                       Marking(d), Marking(1.83))["lanes_road_m"][0]
    assert np.abs(found[0].line.x(y) - np.interp(y, *np.array(true).T[::-1])).max() < 0.3


def test_both_sides_two_lanes_each_and_their_colours():
    """Two lanes to the left, a yellow line's far side to the right; nearer ones only where only they are asked for."""
    scene = scene_of(
        left=Marking(-1.75),
        right=Marking(1.75, "yellow"),
        others=(Marking(-5.0, **DASHES), Marking(-8.4, width_m=0.15), Marking(5.35)),
        road_edges_m=(-12, 9),
    )
    two = neighbours_in(scene, neighbours=2).neighbours
    assert [(n.side, n.place, n.colour, n.across) for n in two] == [
        (-1, 1, "white", "white"), (-1, 2, "white", "white"), (1, 1, "white", "yellow")
    ]
    assert [n.width_m for n in two] == pytest.approx([3.25, 3.4, 3.6], abs=0.1)
    one = neighbours_in(scene, neighbours=True).neighbours
    assert [(n.side, n.place) for n in one] == [(-1, 1), (1, 1)]
    assert "left" in repr(one[0]) and "yellow" in repr(one[1])


def test_confidence_grows_with_paint_and_stays_below_one():
    solid, dashed = (
        neighbours_in(scene_of(others=(Marking(5.49, width_m=0.15, gap_m=gap),))).neighbours[0] for gap in (0.0, 10.97)
    )
    assert 0.2 < dashed.confidence < solid.confidence < 1
    assert dashed.width_std_m >= solid.width_std_m > 0


def test_a_double_line_of_the_ego_lane_counts_once():
    """Double yellow on the left, 0.2 m apart: the lane beyond begins at the outer line and is 3.4 m wide."""
    lane = Lane7(width=3.5)
    extra = [(lambda y: lane.x(y, -1) - 0.21, 0.11, YELLOW), (lambda y: lane.x(y, -1) - 0.21 - 3.4, 0.13, WHITE)]
    result = LaneFinder(rig(), track=False, neighbours=1).process(paint_frame(lane, paint_m=0.11, extra=extra))
    assert [n.side for n in result.neighbours] == [-1]
    assert result.neighbours[0].width_m == pytest.approx(3.4, abs=0.1)
    assert result.neighbours[0].across == "yellow"


# ---------------------------------------------------------------------------------------------- what is no lane
@pytest.mark.parametrize("seed", range(6))
def test_a_single_lane_has_no_neighbours(seed):
    """Grass right beside the shoulder, bends, worn concrete, shade."""
    rng = np.random.default_rng(seed)
    scene = scene_of(
        road=Road([0], [rng.uniform(-1 / 200, 1 / 200)]),
        pose=CarPose(10, rng.uniform(-0.5, 0.5)),
        road_edges_m=(-rng.uniform(2.2, 5.5), rng.uniform(2.2, 5.5)),
        concrete_m=((20, 60),) if seed % 2 else (),
        shade_m=((5, 40),) if seed % 3 == 0 else (),
        right=Marking(1.83),
        noise=4.0,
        seed=seed,
    )
    result = neighbours_in(scene, neighbours=2)
    assert result.lane is not None and result.neighbours == ()


LANE = Lane7(centre=0.2, width=3.6)
BESIDE = {  # (distance beyond the right line in m, width in m, BGR) of stripes beside the lane
    "a white line, which is one": ([(3.5, 0.13, WHITE)], True),
    "a shoulder's line": ([(2.0, 0.13, WHITE)], False),
    "a wide shoulder's line, in a lane of 3.6 m": ([(2.7, 0.13, WHITE)], False),
    "a line too far out": ([(5.2, 0.13, WHITE)], False),
    "a bright wall": ([(5.4, 4.0, (150, 150, 150))], False),
    "a kerb: bright, with grass behind it": ([(5.55, 4.0, (60, 120, 110)), (3.5, 0.15, (190, 190, 190))], False),
    "a guard rail, 45 cm wide": ([(3.5, 0.45, WHITE)], False),
    "a dark seam": ([(3.5, 0.12, (30, 30, 30))], False),
    "a faint seam": ([(3.5, 0.12, (110, 112, 111))], False),
    "gravel: forty stripes": ([(1.0 + 0.15 * i, 0.07, (90 + 17 * (i * i % 5),) * 3) for i in range(40)], False),
}


@pytest.mark.parametrize("name", BESIDE)
def test_what_stands_beside_the_lane(name):
    stripes, expected = BESIDE[name]
    extra = [(lambda y, b=beyond: replace(LANE, width=LANE.width + 2 * b).x(y, 1), w, c) for beyond, w, c in stripes]
    frame = paint_frame(LANE, colours=(WHITE, WHITE), extra=extra)
    result = LaneFinder(rig(), track=False, neighbours=1).process(frame)
    assert result.width_m == pytest.approx(3.6, abs=0.1)
    assert bool(result.neighbours) == expected, result.neighbours


def test_between_two_yellow_lines_is_no_lane():
    for colours, expected in ((("yellow", "yellow"), 0), (("white", "yellow"), 1), (("yellow", "white"), 1)):
        scene = scene_of(left=Marking(-1.83, colours[0]), others=(Marking(-5.4, colours[1]),))
        assert len(neighbours_in(scene).neighbours) == expected, colours


def test_beyond_a_line_that_was_not_seen_nothing_is_claimed():
    """One line alone makes an ego lane; where its other line is assumed, no lane beside it is."""
    scene = scene_of(left=Marking(-1.83), right=None, others=(Marking(5.49, width_m=0.15),))
    result = neighbours_in(scene)
    assert result.lane is None or all(n.side < 0 for n in result.neighbours)


def test_frames_that_show_too_little_give_none():
    """A fit whose road ends before the first rows, as on a steep crest, must not break anything."""
    view, lane = LaneFinder(rig()).view(SIZE_WH), Lane7(hill=-1 / 20, pitch=0.2)
    fit = JointFit(lane.mean, np.eye(7), np.zeros((2, 112)), 0.0, view.height_m, 0.0)
    frame = np.full((720, 1280, 3), ASPHALT, np.uint8)
    assert find_neighbours(frame, view, fit) == ()


# ---------------------------------------------------------------------------------------------- the rendered stills
def markings_of_stills() -> dict[str, list[dict]]:
    """{name: markings} as render/scenes/stills.toml describes them."""
    about = tomllib.loads((ROOT / "render" / "scenes" / "stills.toml").read_text())
    layouts = about["layouts"]

    def surface(layout):
        return (surface(layouts[layout["like"]]) if "like" in layout else {}) | layout.get("surface", {})

    return {
        p["name"]: [m for m in (surface(layouts[p["layout"]]) | p.get("surface", {}))["markings"] if not m.get("ghost")]
        for p in about["picture"]
    }


@pytest.mark.skipif(not (STILLS / "truth.json").is_file(), reason=f"no rendered stills in {STILLS}")
def test_rendered_stills():
    """Of every still: each lane claimed is there, with the width and the colours of the scene's description, to 12 cm;
    and of the 22 next ones that there are, 17 are found at least."""
    finder = LaneFinder(Rig.load(ROOT / "rigs" / "rendered.json"), track=False, neighbours=2)
    right, there = 0, 0
    for name, markings in markings_of_stills().items():
        result = finder.process(cv2.imread(str(STILLS / name)))
        found = {(n.side, n.place): n for n in result.neighbours}
        for side in (-1, 1):
            # from the car outwards; double lines count as one
            lines = sorted((m for m in markings if side * m["d"] > 0), key=lambda m: abs(m["d"]))
            lines = [m for m, before in zip(lines, [None, *lines], strict=False)
                     if before is None or abs(m["d"] - before["d"]) > 0.4]
            there += len(lines) > 1
            for place in (1, 2):
                n = found.pop((side, place), None)
                if n is None:
                    continue
                assert len(lines) > place, f"{name}: {n} is claimed, there is none"
                inner, outer = lines[place - 1], lines[place]
                # the inner line of a double one stands in the list; 0.1 m of lee for that
                assert n.width_m == pytest.approx(abs(outer["d"] - inner["d"]), abs=0.12 + 0.2 * (inner["d"] == -1.73))
                assert (n.colour, n.across) == (outer.get("color", "white"), inner.get("color", "white")), name
                right += place == 1
        assert not found
    assert there == 22 and right >= 17


def test_real_stills(real_dir):
    """Udacity's eight: the lane to the right of the carpool lane, and in one frame the lane to the left; never the
    barrier."""
    finder = LaneFinder(Rig.load(ROOT / "rigs" / "udacity.json"), track=False, neighbours=1)
    files = sorted((real_dir / "udacity" / "test_images").glob("*.jpg"))
    assert len(files) == 8
    for file in files:
        found = finder.process(cv2.imread(str(file))).neighbours
        assert [n.side for n in found] == [-1 if file.stem == "straight_lines2" else 1], file.name
        assert (found[0].colour, found[0].across) == ("white", "white")
        assert abs(found[0].width_m - 3.66) < 3 * found[0].width_std_m


# ---------------------------------------------------------------------------------------------- in result and overlay
SCENE = scene_of(others=(Marking(5.49, width_m=0.15, **DASHES, phase_m=2.0), Marking(-5.3, width_m=0.15)))


@pytest.fixture(scope="module")
def frame():
    return render_road(SCENE)[0]


@pytest.fixture(scope="module")
def pair(frame):
    """Results of one frame without and with neighbours."""
    return [LaneFinder(rig_of_scene(SCENE), track=False, neighbours=n).process(frame) for n in (0, 1)]


def test_the_ego_lane_is_the_same_with_and_without(pair):
    plain, more = (r.to_row("x") for r in pair)
    assert plain.keys() == more.keys() - {"neighbours"} and pair[0].neighbours == ()
    for key in plain.keys() - {"run_time", "lanes", "h_samples"}:
        assert plain[key] == more[key]
    rows = [more["h_samples"].index(v) for v in plain["h_samples"]]
    assert [[line[i] for i in rows] for line in more["lanes"][:2]] == plain["lanes"]


def test_a_row_has_further_lines_behind_the_ego_lane_s(pair):
    row = json.loads(json.dumps(pair[1].to_row("x"), allow_nan=False))
    assert len(row["lanes"]) == 4 and all(len(line) == len(row["h_samples"]) for line in row["lanes"])
    at = row["h_samples"].index(480)
    left, right, beyond_left, beyond_right = (line[at] for line in row["lanes"])
    assert 0 <= beyond_left < left < right < beyond_right
    assert [n["side"] for n in row["neighbours"]] == ["left", "right"]
    assert row["neighbours"][0]["across"] == "yellow" and row["neighbours"][1]["across"] == "white"
    assert all(n["place"] == 1 and 0 < n["confidence"] < 1 for n in row["neighbours"])


def test_scores_are_of_the_ego_lane_alone(pair):
    truth = render_road(SCENE)[1] | {"raw_file": "x"}
    plain, more = (score({"x": truth}, {"x": r.to_row("x")}).pixels for r in pair)
    assert plain == more and plain.tusimple == 1


def test_planes_of_a_video_show_the_same(frame, pair):
    yuv = cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)
    result = LaneFinder(rig_of_scene(SCENE), track=False, neighbours=1).process_yuv420(yuv)
    for a, b in zip(result.neighbours, pair[1].neighbours, strict=True):
        assert (a.side, a.colour, a.across) == (b.side, b.colour, b.across)
        assert a.width_m == pytest.approx(b.width_m, abs=0.05)


def test_the_colour_planes_are_half_a_pixel_of_theirs_to_the_side():
    """A plane's pixel j has its centre between the frame's pixels 2 j and 2 j + 1: at x the plane shows x / 2 - 1/4."""
    i, j = np.indices((32, 32))
    yuv = np.full((96, 64), 128, np.uint8)
    yuv[64:80] = (128 - i - j).astype(np.uint8).reshape(16, 64)  # U; yellow is 2.213 (128 - U), see paint.py
    x, y = np.meshgrid(np.arange(10, 50.0), np.arange(10, 50.0))
    road = Straightened(np.arange(40) * COLUMN_M, np.arange(40.0)[::-1] + 5, *np.float32([x, y]), np.ones_like(x, bool))
    found = paint_of(yuv, road, 1000.0).yellow - 2.213 * ((x / 2 - 0.25) + (y / 2 - 0.25))
    assert abs(found.mean()) < 0.2


def test_a_held_lane_has_none(frame, monkeypatch):
    """Where a lane was a moment ago, nothing is looked for beside it, even if it is there to be seen."""
    finder = LaneFinder(rig_of_scene(SCENE), neighbours=1)
    assert finder.process(frame).neighbours
    monkeypatch.setattr(finder, "_measure_joint", lambda *_: (None, "fog", ()))
    held = finder.process(frame)
    assert held.status == "held" and held.neighbours == ()


@pytest.mark.parametrize("number", [-1, 3])
def test_a_number_of_lanes_that_cannot_be(number):
    with pytest.raises(LanelibError, match="neighbours must be 0 to 2"):
        LaneFinder(rig_of_scene(SCENE), neighbours=number)


def test_the_classic_pipeline_takes_them_too():
    result = neighbours_in(SCENE, model="windows")
    assert {n.side for n in result.neighbours} <= {-1, 1} and len(result.neighbours) >= 1


def test_the_overlay_draws_them_thin_and_purple(frame, pair):
    plain, more = (draw.overlay(frame, r, text=False) for r in pair)
    changed = (plain != more).any(axis=2)
    neighbour = np.array(bgr("neighbour"))
    for n in pair[1].neighbours:
        inner = n.points_px[len(n.points_px) // 4 : -len(n.points_px) // 4]
        u, v = np.round(inner).astype(int).T
        assert np.median(np.abs(more[v, u].astype(int) - neighbour).max(axis=1)) < 12
    assert np.flatnonzero(changed.any(axis=1))[0] > 350  # nothing above the road
    # area over length is how thick they are: thinner than the ego lane's lines are in the same rows
    area = (np.abs(more.astype(int) - neighbour).max(axis=2) < 40).sum()
    pieces = [np.hypot(*np.diff(n.points_px, axis=0).T) for n in pair[1].neighbours]
    v = np.concatenate([n.points_px[1:, 1] for n in pair[1].neighbours])
    left, right = (p[::-1] for p in (pair[1].left_px, pair[1].right_px))
    lane = np.interp(v, right[:, 1], right[:, 0]) - np.interp(v, left[:, 1], left[:, 0])
    # 0.6 of them and smooth edges of about a pixel; 1.2 of them would be 1.5
    assert 0.3 < area / (LINE_WIDTH * lane @ np.concatenate(pieces)) < 1.2


def test_the_command_line_draws_and_lists_them(tmp_path, frame, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rigs.datasets, "roots", lambda: ())
    rig_of_scene(SCENE).save(tmp_path / "rig.json")
    cv2.imwrite("road.png", frame)
    rows = []
    for option in ([], ["--neighbours"]):
        assert cli.main(["image", "road.png", "--rig", "rig.json", "-o", "out", "--json", "a.jsonl", *option]) == 0
        rows.append(json.loads((tmp_path / "a.jsonl").read_text()))
    assert "neighbours" not in rows[0] and len(rows[0]["lanes"]) == 2
    assert [n["side"] for n in rows[1]["neighbours"]] == ["left", "right"] and len(rows[1]["lanes"]) == 4
    with VideoWriter(tmp_path / "a.mp4", fps=20, preset="ultrafast") as writer:
        for _ in range(3):
            writer.write(frame)
    assert cli.main(["video", "a.mp4", "--rig", "rig.json", "--neighbours", "--no-video", "--json", "b.jsonl"]) == 0
    video = [json.loads(line) for line in (tmp_path / "b.jsonl").read_text().splitlines()]
    assert len(video) == 3 and all(len(row["lanes"]) == 4 for row in video)
    assert cli.main(["evaluate", "a.jsonl", "a.jsonl"]) == 0
