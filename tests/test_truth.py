"""truth.json: what is right comes through unchanged, every kind of wrong is named."""

import copy
import json

import pytest

from lanelib.errors import LanelibError
from lanelib.truth import load_truth, load_truth_camera

CAMERA = {"size_wh": [640, 360], "camera_matrix": [[500, 0, 320], [0, 500, 180], [0, 0, 1]], "distortion": [0.0] * 5}
FRAME = {
    "raw_file": "clip.mp4:000012",
    "h_samples": [200, 210, 220],
    "lanes": [[300.5, 290.25, -2], [340, 350, 360]],
    "visible": [[1, 0, 1], [1, 1, 1]],
    "radius_m": None,
    "curvature_1pm": 0.0,
    "offset_m": -0.31,
    "lane_width_m": 3.5,
    "lanes_road_m": [[[-1.4, 5.0], [-1.4, 10.0]], [[2.1, 5.0], [2.1, 10.0]]],
    "heading_rad": 0.01,
    "mounting": {"height_m": 1.2, "pitch_deg": 2.0, "roll_deg": 0.0, "yaw_deg": -1.0},
    "time_s": 0.48,
    "tags": ["rain"],
}
EMPTY = {"raw_file": "no_markings.jpg", "h_samples": [], "lanes": [], "visible": [], "radius_m": None}
BOARD = {"raw_file": "calibration1.jpg", "rvec": [0, 0.1, 0], "tvec": [0, 0, 1], "square_m": 0.025, "board_wh": [9, 6]}


def write(folder, document) -> None:
    (folder / "truth.json").write_text(document if isinstance(document, str) else json.dumps(document))


def of(*frames, **more) -> dict:
    return {"format": "lanelib-truth/1", "camera": CAMERA, "frames": list(frames)} | more


def test_frames_by_name_as_they_stand(tmp_path):
    write(tmp_path, of(FRAME, EMPTY))
    truth = load_truth(tmp_path)
    assert list(truth) == ["clip.mp4:000012", "no_markings.jpg"]
    assert truth["clip.mp4:000012"] == FRAME and truth["no_markings.jpg"] == EMPTY
    assert load_truth_camera(tmp_path) == CAMERA


def test_boards_by_name(tmp_path):
    write(tmp_path, {"format": "lanelib-truth/1", "camera": CAMERA, "boards": [BOARD]})
    assert load_truth(tmp_path) == {"calibration1.jpg": BOARD}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"raw_file": "../a.jpg"}, "inside the folder"),
        ({"raw_file": "/a.jpg"}, "inside the folder"),
        ({"raw_file": ""}, "a file's name"),
        ({"raw_file": 7}, "a file's name"),
        ({"lanes": [[1, 2, 3]]}, "left, right"),
        ({"lanes": [[1, 2], [1, 2, 3]]}, "list of 3 numbers"),
        ({"lanes": None}, "left, right"),
        ({"lanes": [[1, 2, True], [1, 2, 3]]}, "finite numbers"),
        ({"h_samples": "200"}, "must be a list"),
        ({"visible": [[1, 1, 1]]}, "as many lines"),
        ({"visible": [[1, 1, 2], [1, 1, 1]]}, "0 and 1"),
        ({"visible": 3}, "as many lines"),
        ({"raw_file": "a\nb", "lanes": 3}, "left, right"),
        ({"radius_m": -100}, "radius_m must be positive"),
        ({"radius_m": "straight"}, "radius_m must be finite numbers"),
        ({"lane_width_m": 0}, "lane_width_m must be positive"),
        ({"offset_m": None}, "finite numbers"),
        ({"curvature_1pm": 1e999}, "not a number|finite"),
        ({"tags": [1]}, "words"),
        ({"tags": "rain"}, "list of words"),
        ({"tags": 5}, "list of words"),
        ({"time_s": "abc"}, "time_s must be finite numbers"),
        ({"offset_m": 10**400}, "finite numbers, below 1e"),
        ({"lanes_road_m": 3}, r"\[left, right\]"),
        ({"lanes_road_m": [[[0, 1]], [[2]]]}, "list of 2 numbers"),
        ({"mounting": {}}, "'height_m' is missing"),
        ({"mounting": {"height_m": 0}}, "height_m must be positive"),
        ({"mounting": {"height_m": 1.2, "tilt": 3}}, "mounting must be of height_m"),
    ],
)
def test_each_wrong_value_is_named(tmp_path, changes, says):
    write(tmp_path, of(FRAME | changes))
    with pytest.raises(LanelibError, match=says) as caught:
        load_truth(tmp_path)
    assert "\n" not in str(caught.value) and "truth.json" in str(caught.value)


@pytest.mark.parametrize("key", sorted(FRAME.keys() - {"visible", "lanes_road_m", "time_s", "tags"}))
def test_each_missing_key_is_named(tmp_path, key):
    frame = copy.deepcopy(FRAME)
    del frame[key]
    write(tmp_path, of(frame))
    with pytest.raises(LanelibError, match=f"'{key}' is missing"):
        load_truth(tmp_path)


@pytest.mark.parametrize("key", ["rvec", "tvec", "square_m", "board_wh"])
def test_a_board_needs_its_pose(tmp_path, key):
    for value in (None, [1, 2, 3, 4], [1, "2"]):
        write(tmp_path, {"format": "lanelib-truth/1", "boards": [BOARD | {key: value}]})
        with pytest.raises(LanelibError, match="calibration1.jpg"):
            load_truth(tmp_path)


def test_a_name_stands_once(tmp_path):
    write(tmp_path, of(FRAME, EMPTY, FRAME))
    with pytest.raises(LanelibError, match=r"entry 2 of frames \('clip.mp4:000012'\): a second entry"):
        load_truth(tmp_path)


@pytest.mark.parametrize(
    "document",
    [
        "",
        "[]",
        "null",
        "{",
        "\x00\xff",
        "[" * 100_000,
        {"format": "lanelib-truth/2", "frames": []},
        {"frames": []},
        {"format": "lanelib-truth/1"},
        {"format": "lanelib-truth/1", "frames": {}},
        {"format": "lanelib-truth/1", "frames": [], "boards": []},
        {"format": "lanelib-truth/1", "frames": [3]},
        '{"format": "lanelib-truth/1", "frames": [{"raw_file": "a", "h_samples": [NaN], "lanes": []}]}',
    ],
)
def test_foreign_and_corrupt_files(tmp_path, document):
    write(tmp_path, document)
    with pytest.raises(LanelibError, match="truth.json") as caught:
        load_truth(tmp_path)
    assert "\n" not in str(caught.value)


def test_no_file_and_no_camera(tmp_path):
    with pytest.raises(LanelibError, match="No such file"):
        load_truth(tmp_path)
    (tmp_path / "truth.json").mkdir()
    with pytest.raises(LanelibError, match="truth.json"):
        load_truth(tmp_path)
    (tmp_path / "truth.json").rmdir()
    (tmp_path / "truth.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LanelibError, match="JSON"):
        load_truth(tmp_path)
    write(tmp_path, {"format": "lanelib-truth/1", "frames": []})
    with pytest.raises(LanelibError, match="'camera' .* found none"):
        load_truth_camera(tmp_path)


def test_a_file_that_is_too_large(tmp_path, monkeypatch):
    monkeypatch.setattr("lanelib.truth.MAX_BYTES", 100)
    write(tmp_path, of(FRAME))
    with pytest.raises(LanelibError, match="at most 100 bytes"):
        load_truth(tmp_path)
