"""Scores against numbers known beforehand: shifted lanes, delayed lanes, and the reference script where it is there."""

import io
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.evaluate import (
    DISTANCES_M,
    FrameScore,
    clip_score,
    evaluate,
    frame_score,
    lag_s,
    metric_score,
    pixel_score,
    read_rows,
    score,
    table,
)
from lanelib.road import CarPose, Marking, Mounting, Road, frame_truth

# Unlike every default: size, lens, a rolled and turned mounting.
SIZE_WH = (1000, 600)
MATRIX = np.array([[930.0, 0, 489.0], [0, 925.0, 311.0], [0, 0, 1]])
LENS = np.array([-0.21, 0.05, 0.001, -0.0006, 0.0])
CAMERA = Camera(MATRIX, LENS, SIZE_WH)
MOUNTING = Mounting(1.45, pitch_deg=2.3, roll_deg=1.2, yaw_deg=-1.7)


def truth_of(road=None, pose=None, *, left=-1.7, right=1.9, name="a.jpg", **more):
    """Truth of a lane 3.6 m wide; left and right as distances from the reference line."""
    road = road or Road([0], [1 / 400])
    pose = pose or CarPose(10.0, 0.3, 0.02)
    row = frame_truth(
        road,
        pose,
        MOUNTING,
        MATRIX,
        LENS,
        SIZE_WH,
        Marking(left),
        Marking(right),
        raw_file=name,
        tags=more.pop("tags", ()),
    )
    return row | more


def pixels_of(row: dict) -> dict:
    """Only what any tool could say."""
    return {key: row[key] for key in ("raw_file", "h_samples", "lanes")}


def row(name="a.jpg", *, y=(300, 400, 500), left=(300.0, 200.0, 100.0), right=(700.0, 800.0, 900.0), **more):
    return {"raw_file": name, "h_samples": list(y), "lanes": [list(left), list(right)]} | more


# ---------------------------------------------------------------------------------------------- pixels
def test_the_reference_script_gives_the_same_numbers(real_dir, tmp_path):
    labels = read_rows(real_dir / "labels.jsonl")
    for seed, spread in ((0, 3.0), (1, 12.0)):
        rng = np.random.default_rng(seed)
        made = []
        for name, label in labels.items():
            if rng.random() < 0.15:
                continue  # a frame without a prediction
            rows = np.array(label["h_samples"], float)[:: 1 + seed] + 2 * seed
            lanes = []
            for line in label["lanes"]:
                x, y = np.array(line), np.array(label["h_samples"], float)
                moved = np.interp(rows, y[x >= 0], x[x >= 0]) + rng.normal(0, spread, len(rows))
                lanes.append(np.where(rng.random(len(rows)) < 0.1, -2, moved).round(3).tolist())
            made.append({"raw_file": f"some/where/{name}", "h_samples": rows.tolist(), "lanes": lanes})
        made.append({"raw_file": "other.jpg", "h_samples": [1], "lanes": []})
        path = tmp_path / f"{seed}.jsonl"
        path.write_text("".join(json.dumps(line) + "\n" for line in made))
        command = [sys.executable, real_dir / "score.py", real_dir / "labels.jsonl", path, "--json"]
        expected = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=60).stdout)
        found = vars(evaluate(real_dir / "labels.jsonl", path).pixels)
        assert found == pytest.approx(expected, abs=1e-6)
        assert 0.1 < found["strict"] < 0.95  # a comparison of zeros would prove nothing


def test_errors_are_measured_across_the_line_and_scaled_to_1280():
    # Both lines have a slope of one pixel a row: cos = 1 / sqrt(2). 25 px sideways are 17.7 px across: not strict.
    label = row()
    found = pixel_score([frame_score(label, row(left=(325, 225, 125), right=(706, 806, 906)))])
    assert found.tusimple == 1 and found.strict == 0.5 and found.lanes == 1
    assert found.mean_px == pytest.approx((25 + 6) / 2 / math.sqrt(2))
    # The same numbers in a frame 640 px wide are twice as far.
    half = row(size=[640, 360])
    found = pixel_score([frame_score(half, row(left=(325, 225, 125), right=(706, 806, 906)))])
    assert found.tusimple == 0.5 and found.lanes == 0.5 and found.mean_px == pytest.approx(31 / math.sqrt(2))


def test_what_is_not_predicted_is_missed_and_never_extrapolated():
    label = row()
    short = row(y=(300, 400), left=(300, 200), right=(-2, 800))  # one point is no line
    found = pixel_score([frame_score(label, short), frame_score(label, None)])
    assert found.seen == 2 / 12 and found.tusimple == 2 / 12 and found.mean_px == pytest.approx(0)
    assert found.lanes == 0


def test_names_match_whole_before_their_last_part():
    labels = {name: row(name) for name in ("one/20.jpg", "two/20.jpg")}
    predictions = {"two/20.jpg": row("two/20.jpg"), "one/20.jpg": row("one/20.jpg", left=(350, 250, 150))}
    frames = score(labels, predictions).frames
    assert frames[1].errors_px[0].max() < 1e-9 < frames[0].errors_px[0].max()
    # By the last part alone two predictions are meant, so none is taken.
    with pytest.raises(LanelibError, match="same pictures"):
        score({"20.jpg": row("20.jpg")}, predictions)
    assert score({"20.jpg": row("20.jpg")}, {"x/20.jpg": row("x/20.jpg")}).pixels.tusimple == 1


def test_a_prediction_is_of_one_frame_only():
    labels = {name: row(name) for name in ("one/20.jpg", "two/20.jpg")}
    assert [f.claimed for f in score(labels, {"one/20.jpg": row("one/20.jpg")}).frames] == [True, False]
    with pytest.raises(LanelibError, match="same pictures"):
        score(labels, {"20.jpg": row("20.jpg")})  # of which of the two?


# ---------------------------------------------------------------------------------------------- metres
ROADS = {
    "straight": Road([0], [0.0]),
    "bend": Road([0], [1 / 250]),
    "clothoid": Road([0, 80], [-1 / 300, 1 / 200]),
}


@pytest.mark.parametrize("road", ROADS.values(), ids=ROADS)
def test_the_truth_itself_has_no_error(road):
    truth = truth_of(road)
    found = frame_score(truth, truth, CAMERA)
    assert np.abs(found.lateral_m).max() < 1e-9
    assert found.offset_m == found.width_m == found.curvature_1pm == 0
    assert abs(found.heading_rad) < 0.004
    assert pixel_score([found]).mean_px == 0


@pytest.mark.parametrize("road", ROADS.values(), ids=ROADS)
@pytest.mark.parametrize("shift", [0.1, -0.25])
def test_a_shifted_lane_is_off_by_its_shift_at_every_distance(road, shift):
    moved = truth_of(road, left=-1.7 + shift, right=1.9 + shift)
    found = frame_score(truth_of(road), pixels_of(moved), CAMERA)
    across = found.lateral_m * math.cos(0.02)  # lateral errors are along x, the shift is across the road
    assert across[:, :2] == pytest.approx(np.full((2, 2), shift), abs=0.012)
    assert across == pytest.approx(np.full((2, 4), shift), rel=0.12)  # in a bend x is not across the road far ahead
    assert found.offset_m == pytest.approx(-shift, abs=0.03)
    assert found.width_m == pytest.approx(0, abs=0.03)


def test_offset_width_heading_and_bend_come_from_the_pixels_alone():
    truth = truth_of()
    wider = frame_score(truth, pixels_of(truth_of(right=2.2)), CAMERA)
    assert wider.width_m == pytest.approx(0.3, abs=0.02) and wider.offset_m == pytest.approx(-0.15, abs=0.02)
    turned = frame_score(truth, pixels_of(truth_of(pose=CarPose(10.0, 0.3, 0.035))), CAMERA)
    assert turned.heading_rad == pytest.approx(0.015, abs=0.004)
    bent = frame_score(truth, pixels_of(truth_of(Road([0], [1 / 200]))), CAMERA)
    assert bent.curvature_1pm == pytest.approx(1 / 200 - 1 / 400, rel=0.1)
    said = frame_score(truth, truth | {"offset_m": truth["offset_m"] + 0.07, "curvature_1pm": 0.003}, CAMERA)
    assert said.offset_m == pytest.approx(0.07) and said.curvature_1pm == pytest.approx(0.0005, abs=1e-5)


@pytest.mark.parametrize("heading_rad", [-0.25, 0.25])
def test_a_width_is_measured_across_the_lane_however_the_car_stands(heading_rad):
    truth = truth_of(Road([0], [0.0]), CarPose(10.0, 0.3, heading_rad))
    found = frame_score(truth, pixels_of(truth), CAMERA)
    assert found.width_m == pytest.approx(0, abs=0.01)


def test_on_a_hill_the_lane_is_still_the_scale():
    road = Road([0, 60], [0.0, 0.0], [0.0, 0.05])  # a dip: what is 30 m ahead looks nearer
    found = frame_score(truth_of(road), pixels_of(truth_of(road, left=-1.6, right=2.0)), CAMERA)
    assert found.lateral_m == pytest.approx(np.full((2, 4), 0.1), abs=0.01)
    flat = frame_score(truth_of(road) | {"lanes": [[-2] * 30] * 2}, pixels_of(truth_of(road)), CAMERA)
    assert np.isnan(flat.lateral_m).all()  # nothing is compared with what is not known


def test_false_lanes_and_missed_ones_are_counted():
    empty = {"raw_file": "e.jpg", "h_samples": [300, 310], "lanes": [], "tags": ["no_markings"]}
    none = {"raw_file": "e.jpg", "h_samples": [], "lanes": [], "status": "none"}
    truth = truth_of(tags=["rain"])
    frames = [
        frame_score(empty, row("e.jpg"), CAMERA),
        frame_score(empty, none, CAMERA),
        frame_score(empty, None, CAMERA),
    ]
    frames += [frame_score(truth, truth, CAMERA), frame_score(truth, None, CAMERA)]
    found = metric_score(frames)
    assert (found.empty, found.false_lanes, found.found) == (3, 1, 0.5)
    assert [frame.wrong for frame in frames] == [True, False, False, False, False]
    assert found.lateral_m == (0, 0, 0, 0)


def test_bends_are_judged_in_per_cent_and_straights_in_curvature():
    bend, straight = truth_of(Road([0], [1 / 500])), truth_of(Road([0], [0.0]))
    frames = [
        frame_score(bend, bend | {"curvature_1pm": bend["curvature_1pm"] * 0.9}, CAMERA),
        frame_score(straight, straight | {"curvature_1pm": 2e-4}, CAMERA),
    ]
    found = metric_score(frames)
    assert found.curvature == pytest.approx(0.1) and found.curvature_1pm == pytest.approx(2e-4)


# ---------------------------------------------------------------------------------------------- time
def clip_frames(centre_m, error_m, *, fps=20.0, claimed=None, has_lane=None) -> list[FrameScore]:
    n = len(centre_m)
    return [
        FrameScore(
            f"c.mp4:{i:06d}",
            claimed=True if claimed is None else claimed[i],
            has_lane=True if has_lane is None else has_lane[i],
            lateral_m=np.full((2, len(DISTANCES_M)), error_m[i]),
            centre_m=np.full(len(DISTANCES_M), centre_m[i]),
            clip="c.mp4",
            time_s=i / fps,
        )
        for i in range(n)
    ]


@pytest.mark.parametrize("delay_s", [0.0, 0.15, 0.4])
def test_a_delayed_lane_lags_by_its_delay(delay_s):
    t = np.arange(0, 12, 1 / 20)
    truth = lambda s: 0.8 * np.sin(0.9 * s) + 0.3 * np.sin(2.3 * s + 1)  # noqa: E731
    noise = np.random.default_rng(3).normal(0, 0.02, len(t))
    frames = clip_frames(truth(t), truth(t - delay_s) - truth(t) + noise + 0.05)  # a constant error is no lag
    assert clip_score(frames).lag_s == pytest.approx(delay_s, abs=0.021)


def test_a_lag_is_not_said_where_nothing_moves_or_little_is_known():
    t = np.arange(0, 10, 0.05)
    assert math.isnan(lag_s(t, np.zeros_like(t), np.zeros_like(t)))
    assert math.isnan(lag_s(t[:20], np.sin(t[:20]), np.sin(t[:20])))


def test_jitter_is_what_changes_from_frame_to_frame():
    n = 60
    shaky = 0.03 * (-1.0) ** np.arange(n)  # 6 cm to and fro
    assert clip_score(clip_frames(np.zeros(n), shaky)).jitter_m == pytest.approx(0.06)
    assert clip_score(clip_frames(np.zeros(n), np.full(n, 0.4))).jitter_m == pytest.approx(0)
    once = np.zeros(n)
    once[30] = 0.3  # two steps of 59: one jump weighs more than many small ones
    assert clip_score(clip_frames(np.zeros(n), once)).jitter_m == pytest.approx(0.3 * math.sqrt(2 / 59))
    missing = shaky.copy()
    missing[::3] = np.nan
    assert clip_score(clip_frames(np.zeros(n), missing)).jitter_m == pytest.approx(0.06)


def test_reset_and_wrong_time():
    has_lane = [True] * 20 + [False] * 10 + [True] * 30
    claimed = [True] * 23 + [False] * 13 + [True] * 24  # held 3 frames too long; found again 6 frames late
    error = np.zeros(60)
    error[36:40] = 0.7  # and wrong for 4 frames at first
    found = clip_score(clip_frames(np.zeros(60), error, claimed=claimed, has_lane=has_lane, fps=10))
    assert found.reset_s == pytest.approx(1.0) and found.wrong_s == pytest.approx(0.4)
    never = clip_score(clip_frames(np.zeros(10), np.zeros(10), claimed=[False] * 10, fps=10))
    assert never.reset_s == pytest.approx(0.9) and never.wrong_s == 0


# ---------------------------------------------------------------------------------------------- together, files
def write_truth(folder, frames):
    camera = CAMERA.to_dict()
    folder.joinpath("truth.json").write_text(
        json.dumps({"format": "lanelib-truth/1", "camera": camera, "frames": frames})
    )


def test_a_truth_file_is_scored_by_tag_and_clip(tmp_path):
    frames = [truth_of(name=f"c.mp4:{i:06d}", tags=["night"] if i % 2 else ["rain"], time_s=i / 25) for i in range(6)]
    write_truth(tmp_path, frames)
    rows = [pixels_of(truth_of(left=-1.6, right=2.0, name=frame["raw_file"])) for frame in frames[:-1]]
    predictions = tmp_path / "p.jsonl"
    predictions.write_text("\n".join(map(json.dumps, rows)))
    found = evaluate(tmp_path, predictions)
    assert found.metric and list(found.by_tag()) == ["all", "night", "rain"]
    numbers = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert numbers["tags"]["night"]["found"] == pytest.approx(2 / 3)
    assert numbers["tags"]["all"]["lateral_m"][1] == pytest.approx(0.1, abs=0.01)
    assert numbers["clips"][0]["lag_s"] is None and numbers["clips"][0]["frames"] == 6
    text = str(found)
    assert "cm at 30 m" in text and "night" in text and "c.mp4" in text and "nan" not in text
    assert str(evaluate(tmp_path / "truth.json", predictions)) == text


def test_a_table_is_markdown():
    lines = table([["a", "n", "why"], ["long name", "1", "x"]], left=(0, 2)).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[1].count("|") == 4 and lines[1].endswith("-|") and ":|" in lines[1]


BAD = {
    "missing": (None, "No such file"),
    "empty": ("\n", "at least one line"),
    "no JSON": ("hello\n", r"rows\.jsonl:1: needed an object"),
    "not an object": ("[1]\n", "no object"),
    "no lanes": ('{"raw_file": "a", "h_samples": []}\n', "'lanes' is missing"),
    "lengths differ": ('{"raw_file": "a", "h_samples": [1], "lanes": [[1, 2]]}\n', "another length"),
    "not finite": ('{"raw_file": "a", "h_samples": [1], "lanes": [[NaN]]}\n', "not a number"),
    "too large": ('{"raw_file": "a", "h_samples": [1], "lanes": [[1e999]]}\n', "finite"),
    "bad size": ('{"raw_file": "a", "h_samples": [1], "lanes": [[1]], "size": [0, 1]}\n', "size"),
    "digits without end": (f'{{"raw_file": "a", "h_samples": [1{"0" * 400}], "lanes": []}}\n', "finite"),
    "offset without end": (
        f'{{"raw_file": "a", "h_samples": [], "lanes": [], "offset_m": 1{"0" * 400}}}\n',
        "offset_m that is no number",
    ),
    "words for numbers": ('{"raw_file": "a", "h_samples": [], "lanes": [], "size": ["9", "5"]}\n', "finite numbers"),
    "too far": ('{"raw_file": "a", "h_samples": [1], "lanes": [[1e12]]}\n', "below 1e"),
    "bad time": ('{"raw_file": "a", "h_samples": [], "lanes": [], "time_s": "abc"}\n', "time_s that is no number"),
    "one tag": ('{"raw_file": "a", "h_samples": [], "lanes": [], "tags": "rain"}\n', "list of words"),
    "a number of tags": ('{"raw_file": "a", "h_samples": [], "lanes": [], "tags": 5}\n', "list of words"),
    "tags of two kinds": ('{"raw_file": "a", "h_samples": [], "lanes": [], "tags": [1, "a"]}\n', "list of words"),
    "twice": ('{"raw_file": "a", "h_samples": [], "lanes": []}\n' * 2, r"rows\.jsonl:2: .* found 'a' again"),
    "bad offset": ('{"raw_file": "a", "h_samples": [1], "lanes": [[1]], "offset_m": "x"}\n', "offset_m"),
    "second line": ('{"raw_file": "a", "h_samples": [], "lanes": []}\n{\n', r"rows\.jsonl:2"),
}


@pytest.mark.parametrize("text, message", BAD.values(), ids=BAD)
def test_bad_files_are_one_line(tmp_path, text, message):
    path = tmp_path / "rows.jsonl"
    if text is not None:
        path.write_text(text)
    with pytest.raises(LanelibError, match=message) as error:
        read_rows(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_rows_are_utf8_with_the_mark_of_windows_or_without(tmp_path, monkeypatch, encoding):
    """From a file and from a pipe, which Windows would read in the letters of a code page."""
    data = json.dumps(row() | {"raw_file": "Straße.jpg"}, ensure_ascii=False).encode(encoding)
    (tmp_path / "rows.jsonl").write_bytes(data)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data), "cp1252"))
    assert list(read_rows(tmp_path / "rows.jsonl")) == list(read_rows("-")) == ["Straße.jpg"]


def test_other_files_are_refused(tmp_path):
    for data in (b"\xff\xfe\x00binary", json.dumps(row()).encode("utf-16")):  # PowerShell's > writes the second
        (tmp_path / "rows.jsonl").write_bytes(data)
        with pytest.raises(LanelibError, match="no text of this kind.*PowerShell"):
            read_rows(tmp_path / "rows.jsonl")
    board = {"raw_file": "b.jpg", "rvec": [0, 0, 0], "tvec": [0, 0, 1], "square_m": 0.1, "board_wh": [9, 6]}
    with pytest.raises(LanelibError, match="chessboards"):
        score({"b.jpg": board}, {"b.jpg": row()})


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["raw_file", "h_samples", "lanes", "size"]), inner)
    ),
    max_leaves=12,
)


@settings(max_examples=80, deadline=None)
@given(
    content=st.fixed_dictionaries(
        {"raw_file": st.just("a") | JSON, "h_samples": JSON, "lanes": JSON},
        optional={
            "size": JSON,
            "extrap": JSON,
            "offset_m": JSON,
            "curvature_1pm": JSON,
            "lane_width_m": JSON,
            "time_s": JSON,
            "tags": JSON,
        },
    )
)
def test_any_json_is_scored_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("fuzz") / "rows.jsonl"
    path.write_text(json.dumps(content) + "\n")
    try:
        rows = read_rows(path)
    except LanelibError:
        return
    for name, prediction in rows.items():
        frame_score(truth_of() | {"raw_file": name}, prediction, CAMERA)
        assert str(score({name: prediction}, rows))
