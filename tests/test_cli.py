"""The command line as a user meets it: what it writes, what it says, and how it ends on bad input and signals."""

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import chessboards
import clips
import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lanelib import autorig, cli, commands, rigs, runs
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.ffmpeg import probe
from lanelib.finder import LaneFinder, Rig
from lanelib.outputs import free_name
from lanelib.road import CarPose, Road
from lanelib.simulator import Scene, render_road
from lanelib.tracking import LaneTracker
from lanelib.video import VideoWriter, read_frames

ROOT = Path(__file__).resolve().parents[1]
SIZE_WH = (640, 360)


def make_rig(name="right", *, height_m=1.22, pitch_deg=1.4, size_wh=SIZE_WH) -> Rig:
    scene = Scene()
    camera = Camera(np.array(scene.camera_matrix), np.array(scene.distortion), SIZE_WH).scaled(size_wh)
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=height_m, pitch_deg=pitch_deg), name)


@pytest.fixture(scope="session")
def road():
    """A frame of a gentle bend with its truth: the car 0.3 m right of the lane's centre."""
    return render_road(Scene(road=Road([0], [1 / 600]), pose=CarPose(5.0, 0.3)))


@pytest.fixture(scope="session")
def drive():
    """Twelve frames of a straight road, 0.8 m apart."""
    return [render_road(Scene(pose=CarPose(5 + 0.8 * i, -0.2), seed=i))[0] for i in range(12)]


@pytest.fixture
def place(tmp_path, road, monkeypatch):
    """A folder with a picture and a rig, as working directory; no other data set or rig is known."""
    make_rig().save(tmp_path / "rig.json")
    cv2.imwrite(str(tmp_path / "road.png"), road[0])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rigs.datasets, "roots", lambda: ())
    return tmp_path


@pytest.fixture
def clip(place, drive):
    with VideoWriter(place / "drive.mp4", fps=20, preset="ultrafast") as writer:
        for frame in drive:
            writer.write(frame)
    return place / "drive.mp4"


def run(*arguments, code=0, capsys=None):
    """(stdout, stderr) of a command that must end with this exit code."""
    found = cli.main([str(a) for a in arguments])
    said = capsys.readouterr()
    assert found == code, said.err
    return said.out, said.err


def refused(capsys, *arguments, match, lines=1):
    """stdout of a command that must end with exit code 2 and say why in so many lines."""
    out, err = run(*arguments, code=2, capsys=capsys)
    assert match in err and "Traceback" not in err
    assert len(err.splitlines()) == lines, err
    assert all(line.startswith("lanelib: ") for line in err.splitlines())
    return out


# ---------------------------------------------------------------------------------------------- help
COMMANDS = ("calibrate", "image", "video", "live", "rig", "evaluate", "fetch", "course")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(capsys, command):
    out, err = run(command, "--help", capsys=capsys)
    assert f"lanelib {command} " in out.split("Example")[1] or f"lanelib {command}\n" in out
    assert not err and max(map(len, out.splitlines())) <= 100


def test_the_list_of_commands_is_complete(capsys):
    out, _ = run("--help", capsys=capsys)
    assert all(command in out for command in COMMANDS)
    assert all(callable(getattr(commands, command)) for command in COMMANDS)
    assert run("--version", capsys=capsys)[0].startswith("lanelib ")


def test_help_tells_every_exit_code_and_no_option_of_another_command(capsys):
    out, _ = run("--help", capsys=capsys)
    codes = (cli.OK, cli.FAULT, cli.BAD_INPUT, cli.INTERRUPTED, cli.TERMINATED, cli.BROKEN_PIPE)
    assert all(f" {code} " in out for code in codes)
    for command in COMMANDS:
        usage, *rest = run(command, "--help", capsys=capsys)[0].split("\n\n", 1)
        assert ("--json" in rest[0]) == ("--json" in usage)


@pytest.mark.parametrize("arguments, match", [
    ([], "COMMAND"), (["foo"], "'foo'"), (["image"], "PICTURES"), (["image", "x", "--rg", "y"], "--rg"),
    (["video", "x", "--start", "-1"], "from 0"), (["video", "x", "--end", "nan"], "needed a number"),
    (["calibrate", "x", "--board", "9", "-o", "y"], "9x6"), (["calibrate", "x", "--square", "0", "-o", "y"], "above 0"),
    (["video", "x", "--jobs", "0"], "whole number"), (["live", "0", "--port", "70000"], "65535"),
    (["image", ""], "empty name"),
])
def test_wrong_arguments_are_one_line(capsys, arguments, match):
    refused(capsys, *arguments, match=match)


# ---------------------------------------------------------------------------------------------- image
def test_image_draws_and_says_where(place, road, capsys):
    out, err = run("image", "road.png", "--rig", "rig.json", "-o", "out", "--json", "lanes.jsonl", capsys=capsys)
    assert "out/road.jpg" in out and "wrote lanes.jsonl" in out and not err
    drawn = cv2.imread("out/road.jpg")
    assert drawn.shape == road[0].shape and np.abs(drawn.astype(int) - road[0]).max() > 60
    row, truth = json.loads(Path("lanes.jsonl").read_text()), road[1]
    assert row["raw_file"] == "road.png" and row["status"] == "measured"
    assert row["offset_m"] == pytest.approx(truth["offset_m"], abs=0.05)
    assert row["lane_width_m"] == pytest.approx(truth["lane_width_m"], abs=0.12)
    assert not list(place.glob(".*"))  # nothing temporary is left


def test_json_on_stdout_is_alone_there(place, capsys):
    out, err = run("image", "road.png", "--rig", "rig.json", "--json", "-", capsys=capsys)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == ["road.png"]
    assert "lanelib_output/road.jpg" in err


def test_stages_are_numbered_pictures(place, capsys):
    run("image", "road.png", "--rig", "rig.json", "-o", "out", "--stages", capsys=capsys)
    names = sorted(path.name for path in Path("out").iterdir())
    for stage in ("undistorted", "mask", "birdseye", "windows", "fit", "lane"):
        assert any(name.endswith(f"_{stage}.jpg") for name in names), names
    assert names[0] == "road.jpg" and names[1].startswith("road_1_")


def test_stages_replace_no_picture_that_is_read(place, capsys):
    run("image", "road.png", "--rig", "rig.json", "-o", "out", "--stages", capsys=capsys)
    stage = next(Path("out").glob("road_*_mask.jpg"))
    as_before = stage.read_bytes()
    Path("in").mkdir()
    os.link(stage, "in/linked.jpg")
    arguments = ["road.png", "in/linked.jpg", "--rig", "rig.json", "-o", "out", "--stages", "--quiet"]
    refused(capsys, "image", *arguments, match=f"{stage}: needed another file for the output", lines=2)
    assert stage.read_bytes() == as_before


def test_a_picture_of_another_kind_is_no_folders_name(place, capsys):
    for name in ("out.gif", "out.webp"):
        refused(capsys, "image", "road.png", "--rig", "rig.json", "-o", name, match="ends in .jpg or .png")
    assert not list(place.glob("out*"))


def test_pictures_and_rows_of_one_run_have_two_names(place, capsys):
    run("image", "road.png", "--rig", "rig.json", "-o", "both.jpg", "--json", "both.jpg", capsys=capsys)
    assert json.loads(Path("both.jpg").read_text())["raw_file"] == "road.png"
    assert cv2.imread("both-2.jpg") is not None


def test_one_bad_picture_does_not_stop_the_others(place, capsys):
    data = Path("road.png").read_bytes()
    Path("cut.png").write_bytes(data[: len(data) // 2])
    Path("empty.jpg").touch()
    Path("again.png").write_bytes(data)
    Path("no_pictures").mkdir()
    names = ["road.png", "cut.png", "empty.jpg", "no_pictures", "missing.jpg", "again.png"]
    with_rig = ["--rig", "rig.json", "-o", "out", "--json", "-", "--quiet"]
    out = refused(capsys, "image", *names, *with_rig, match="4 of 6 pictures", lines=5)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == ["road.png", "again.png"]
    assert sorted(path.name for path in Path("out").iterdir()) == ["again.jpg", "road.jpg"]


def test_unusual_names(place, road, capsys):
    names = ["two words.png", "Straße – 道.png", "-dash.png"]
    for name in names:
        cv2.imencode(".png", road[0])[1].tofile(f"./{name}")
    out, _ = run("image", "--rig", "rig.json", "-o", "out", "--json", "-", "--", *names, capsys=capsys)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == names
    assert {path.name for path in Path("out").iterdir()} == {name.replace(".png", ".jpg") for name in names}


def test_a_pattern_that_the_shell_hands_on_stands_for_its_files(place, road, capsys):
    """As on Windows; a name that is there, or matches nothing, is the name."""
    for name in ("p10.png", "p2.png", "[p2].png"):
        cv2.imwrite(name, road[0])
    arguments = ["--rig", "rig.json", "-o", "out", "--json", "-"]
    out, _ = run("image", "p*.png", "[p2].png", *arguments, capsys=capsys)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == ["p2.png", "p10.png", "[p2].png"]
    refused(capsys, "image", "*.bmp", *arguments, match="*.bmp: need a picture, found no such file")


def test_a_folder_stands_for_its_pictures(place, road, capsys):
    Path("drive").mkdir()
    for name in ("f10.png", "f2.png", "._f2.png"):
        cv2.imwrite(f"drive/{name}", road[0])
    Path("drive/notes.txt").write_text("wet", encoding="utf-8")
    arguments = ["--rig", "rig.json", "-o", "out", "--json", "-"]
    out, _ = run("image", "drive", *arguments, capsys=capsys)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == ["f2.png", "f10.png"]
    assert {path.name for path in Path("out").iterdir()} == {"f2.jpg", "f10.jpg"}
    refused(capsys, "image", "drive", "--rig", "rig.json", "-o", "one.jpg", match="needed a folder")


def test_two_pictures_of_one_name_are_both_kept(place, road, capsys):
    for folder in ("a", "b"):
        Path(folder).mkdir()
        cv2.imwrite(f"{folder}/x.png", road[0])
    out, _ = run("image", "a/x.png", "b/x.png", "--rig", "rig.json", "-o", "out", "--json", "-", capsys=capsys)
    assert [json.loads(line)["raw_file"] for line in out.splitlines()] == ["a/x.png", "b/x.png"]
    assert {p.name for p in Path("out").iterdir()} == {"x.jpg", "x-2.jpg"}
    refused(capsys, "image", "a/x.png", "b/x.png", "--rig", "rig.json", "-o", "one.jpg", match="needed a folder")
    assert not Path("one.jpg").exists()


def test_input_is_never_overwritten(place, clip, road, capsys):
    cv2.imwrite("p.jpg", road[0])
    before = {name: Path(name).read_bytes() for name in ("p.jpg", "rig.json", "drive.mp4")}
    Path("link.mp4").symlink_to("drive.mp4")
    with_rig = ["--rig", "rig.json"]
    refused(capsys, "image", "p.jpg", *with_rig, "-o", ".", match="found the same")
    refused(capsys, "image", "p.jpg", *with_rig, "-o", "out", "--json", "p.jpg", match="found the same")
    refused(capsys, "video", "drive.mp4", *with_rig, "-o", "drive.mp4", match="found the same")
    refused(capsys, "video", "drive.mp4", *with_rig, "-o", "link.mp4", match="found the same")
    refused(capsys, "calibrate", "p.jpg", "-o", "p.jpg", match="found the same")
    # nor is that of another one, nor what else is read
    Path("sub").mkdir()
    Path("sub/drive.mp4").write_bytes(before["drive.mp4"])
    refused(capsys, "video", "sub/drive.mp4", "drive.mp4", *with_rig, "-o", ".", match="found the same")
    refused(capsys, "image", "road.png", *with_rig, "-o", "out", "--json", "rig.json", match="found the same")
    refused(capsys, "video", "drive.mp4", *with_rig, "--no-video", "--json", "rig.json", match="found the same")
    refused(capsys, "rig", "p.jpg", "--camera", "rig.json", "-o", "rig.json", match="found the same")
    Path("truth.json").write_text("old")
    Path("rows.jsonl").touch()
    refused(capsys, "evaluate", ".", "rows.jsonl", "--json", "truth.json", match="found the same")
    assert Path("truth.json").read_text() == "old"
    assert {name: Path(name).read_bytes() for name in before} == before


def test_names_that_differ_in_capitals_only_are_one_name():
    taken = set()
    names = ["out/A.mp4", "out/a.mp4", "out/b.mp4", "out/a.mp4"]
    assert [free_name(Path(name), taken).name for name in names] == ["A.mp4", "a-2.mp4", "b.mp4", "a-3.mp4"]


def test_a_name_too_long_for_the_system_does_not_stop_the_others(place, capsys):
    Path("out").mkdir()
    Path("out/road.jpg").write_text("from before")  # so that it is compared with all that is read
    refused(capsys, "image", f"{'n' * 300}.jpg", "road.png", "--rig", "rig.json", "-o", "out", match="1 of 2", lines=2)
    assert cv2.imread("out/road.jpg") is not None


@pytest.mark.parametrize("command, step", [("image", "write_pictures"), ("video", "run_video")])
def test_what_the_system_refuses_fails_one_file_only(place, capsys, monkeypatch, command, step):
    done = []

    def second_time(*args, **_):
        done.append(args)
        if len(done) == 1:
            raise OSError(24, "Too many open files")
        raise LanelibError("and on it goes")

    monkeypatch.setattr(commands, "probe", lambda path: SimpleNamespace(size_wh=SIZE_WH))
    monkeypatch.setattr(commands, step, second_time)
    names = ["road.png", "road.png"]
    refused(capsys, command, *names, "--rig", "rig.json", "-o", "out", match="Too many open files", lines=3)
    assert len(done) == 2


@pytest.mark.parametrize("output", ["rig.json/out", "no/such/lanes.jsonl", "."])
def test_places_that_cannot_be_written(place, capsys, output):
    option = "-o" if output.startswith("rig") else "--json"
    refused(capsys, "image", "road.png", "--rig", "rig.json", option, output, match=output)


def test_a_recipe_or_rig_that_is_none(place, capsys):
    refused(capsys, "image", "road.png", "--rig", "rig.json", "--recipe", "foo", match="paint")
    refused(capsys, "image", "road.png", "--rig", "road.png", match="road.png")
    refused(capsys, "image", "road.png", "--rig", "gone.json", match="gone.json")


def test_numbers_are_kept_where_the_picture_cannot_be(place, capsys):
    options = ["--rig", "rig.json", "-o", "rig.json", "--json", "l.jsonl", "--quiet"]
    refused(capsys, "image", "road.png", *options, match="rig.json")
    assert json.loads(Path("l.jsonl").read_text())["status"] == "measured"


# ---------------------------------------------------------------------------------------------- rigs
def test_a_rig_for_other_proportions_is_refused(place, clip, capsys):
    make_rig("square", size_wh=SIZE_WH)
    camera = Camera.ideal((400, 400), focal_px=400)
    Rig(camera, BirdsEye.from_mounting(camera, height_m=1.2, pitch_deg=2), "square").save("square.json")
    refused(capsys, "image", "road.png", "--rig", "square.json", "-o", "out", match="640x360")
    refused(capsys, "video", "drive.mp4", "--rig", "square.json", "-o", "out.mp4", match="400x400")
    assert not Path("out.mp4").exists() and not Path("out").exists()


def test_a_rig_that_sees_no_road_is_refused(place, clip, capsys):
    make_rig("sky", pitch_deg=-40).save("sky.json")
    refused(capsys, "image", "road.png", "--rig", "sky.json", "-o", "out", match="'sky' sees no road")
    refused(capsys, "video", "drive.mp4", "--rig", "sky.json", "-o", "out.mp4", match="'sky' sees no road")
    assert not Path("out.mp4").exists() and not Path("out").exists()


def test_a_wrong_folder_of_data_is_said(road, tmp_path, monkeypatch, capsys):
    cv2.imwrite(str(tmp_path / "road.png"), road[0])
    monkeypatch.setenv("LANELIB_DATA", str(tmp_path / "gone"))
    refused(capsys, "image", tmp_path / "road.png", match="LANELIB_DATA must name a folder")


def test_the_package_alone_knows_no_rigs_and_no_sets(monkeypatch, tmp_path):
    monkeypatch.setattr(rigs.datasets, "_project", lambda: tmp_path)
    monkeypatch.delenv("LANELIB_DATA", raising=False)
    assert rigs.known_rigs() == () and rigs.set_of("road.png") is None


def test_frames_of_a_video_that_is_cut_off(tmp_path, monkeypatch):
    path = clips.truncated(tmp_path / "cut.mp4", keep=0.45)
    assert 1 <= len(rigs.frames_of_video(path, 4)) < 4  # as far as it goes

    def only_from_the_front(path, *, start_s=0.0, **options):
        if start_s:
            raise LanelibError("nothing there")
        return read_frames(path, **options)

    monkeypatch.setattr(rigs, "read_frames", only_from_the_front)
    assert len(rigs.frames_of_video(path, 4)) == 4
    (tmp_path / "none.mp4").write_bytes(path.read_bytes()[:200])
    with pytest.raises(LanelibError, match="none.mp4"):
        rigs.frames_of_video(tmp_path / "none.mp4", 4)


def test_the_rig_that_sees_lanes_is_chosen(road):
    wrong = [make_rig("steep", pitch_deg=9), make_rig("low", height_m=0.55)]
    choice = rigs.choose_rig([road[0]], [wrong[0], make_rig(), wrong[1]])
    assert choice.rig.name == "right" and "steep 0." in str(choice)
    near = [make_rig("tilted", pitch_deg=2.1), make_rig("high", height_m=1.5), make_rig("up", pitch_deg=0.6)]
    assert min(rigs.try_rig(rig, [road[0]]).confidence for rig in near) > 0.5  # the finder forgives these
    assert rigs.choose_rig([road[0]], [*near, make_rig()]).rig.name == "right"
    black = np.zeros_like(road[0])
    assert rigs.choose_rig([road[0], road[0], black], [*wrong, make_rig()]).rig.name == "right"
    with pytest.raises(LanelibError, match="lanelib rig"):
        rigs.choose_rig([black], [make_rig()])
    with pytest.raises(LanelibError, match="right 640x360"):
        rigs.choose_rig([np.zeros((300, 300, 3), np.uint8)], [make_rig()])
    with pytest.raises(LanelibError, match="at least one picture"):
        rigs.choose_rig([], [make_rig()])


def test_without_rig_the_choice_is_said(place, clip, monkeypatch, capsys):
    refused(capsys, "image", "road.png", match="lanelib rig")
    Path("rigs").mkdir()
    make_rig("steep", pitch_deg=9).save("rigs/steep.json")
    make_rig("mine").save("rigs/mine.json")
    monkeypatch.setattr(rigs.datasets, "roots", lambda: (place,))
    _, err = run("image", "road.png", "road.png", "-o", "out", capsys=capsys)
    assert err.count("rig mine: fits best") == 1
    _, err = run("video", "drive.mp4", "-o", "out.mp4", capsys=capsys)
    assert "drive.mp4: rig mine: fits best" in err
    _, err = run("image", "road.png", "--rig", "mine", "-o", "out", capsys=capsys)
    assert not err
    refused(capsys, "image", "road.png", "--rig", "other", match="known by name: mine, steep")


def test_pictures_of_a_data_set_have_its_rig_and_its_output(place, clip, road, monkeypatch, capsys):
    for folder in ("test_images/mine", "test_videos/mine", "rigs"):
        Path(folder).mkdir(parents=True)
    make_rig("mine").save("rigs/mine.json")
    make_rig("right too").save("rigs/other.json")
    cv2.imwrite("test_images/mine/a.png", road[0])
    clip.rename("test_videos/mine/drive.mp4")
    monkeypatch.setattr(rigs.datasets, "roots", lambda: (place,))
    _, err = run("image", "test_images/mine/a.png", capsys=capsys)
    assert "rig mine: the file is of the set mine" in err
    run("video", "test_videos/mine/drive.mp4", capsys=capsys)
    assert Path("output_images/mine/a.jpg").is_file() and Path("output_videos/mine/drive.mp4").is_file()


def test_of_many_pictures_only_those_that_are_used_are_read(place, monkeypatch, capsys):
    read, frame = [], np.zeros((120, 160, 3), np.uint8)
    monkeypatch.setattr(commands, "read_image", lambda path: read.append(path.name) or frame)
    names = [f"{i}.png" for i in range(150)]
    refused(capsys, "rig", *names, "--camera", "none", "-o", "new.json", match=f"in {autorig.MAXIMUM_FRAMES} frames")
    assert read == [names[i] for i in rigs.spread(150, autorig.MAXIMUM_FRAMES)]


def test_rig_is_made_from_frames(place, capsys):
    for i in range(3):
        cv2.imwrite(f"f{i}.png", render_road(Scene(pose=CarPose(4.0 * i, 0.1), seed=i))[0])
    scene = Scene()
    camera = Camera(np.array(scene.camera_matrix), np.array(scene.distortion), SIZE_WH)
    camera.save("camera.json")
    options = ["--camera", "camera.json", "--lane-width", "3.66", "-o", "made.json"]
    out, _ = run("rig", "f0.png", "f1.png", "f2.png", *options, capsys=capsys)
    assert "wrote made.json" in out
    made = Rig.load("made.json")
    assert made.name == "made"
    assert made.mounting["height_m"] == pytest.approx(1.22, rel=0.05) and made.mounting["pitch_deg"] == pytest.approx(
        1.4, abs=0.4
    )
    cv2.imwrite("noise.png", np.random.default_rng(0).integers(0, 255, (360, 640, 3)).astype(np.uint8))
    refused(capsys, "rig", "noise.png", "--camera", "none", "-o", "noise.json", match="rig")
    refused(capsys, "rig", "f0.png", "--camera", "rig.json", "-o", "x.json", match="rig.json")
    assert not Path("noise.json").exists()


# ---------------------------------------------------------------------------------------------- video
def test_video_is_followed_frame_by_frame(place, clip, capsys):
    out, err = run("video", "drive.mp4", "--rig", "rig.json", "-o", "out.mp4", "--json", "lanes.jsonl", capsys=capsys)
    assert "out.mp4" in out and "measured 12" in out and not err
    rows = [json.loads(line) for line in Path("lanes.jsonl").read_text().splitlines()]
    assert [row["raw_file"] for row in rows] == [f"drive.mp4:{i:06d}" for i in range(12)]
    assert all(row["offset_m"] == pytest.approx(-0.2, abs=0.06) for row in rows)
    with read_frames("out.mp4") as frames:
        assert sum(1 for _ in frames) == 12 and frames.info.codec == "h264"


def test_a_section_keeps_the_numbers_of_the_whole(place, clip, capsys):
    out, _ = run(
        "video",
        "drive.mp4",
        "--rig",
        "rig.json",
        "--no-video",
        "--start",
        0.25,
        "--end",
        0.45,
        "--json",
        "-",
        capsys=capsys,
    )
    assert [json.loads(line)["raw_file"][-6:] for line in out.splitlines()] == [f"{i:06d}" for i in (5, 6, 7, 8)]
    assert not list(place.glob("lanelib_output*"))
    refused(capsys, "video", "drive.mp4", "--rig", "rig.json", "--no-video", "--start", 9, match="0.60 s")
    for output in (["-o", "out.mp4"], ["--no-video"]):
        between = ["--start", 0.56, "--end", 0.59]  # the last frame is that of 0.55 s
        said = "drive.mp4: needed frames from 0.56 s to 0.59 s of a video of 0.60 s, found none"
        refused(capsys, "video", "drive.mp4", "--rig", "rig.json", *output, *between, match=said)


@pytest.mark.parametrize("view", ["diagnostic", "birdseye"])
def test_other_views(place, clip, view, capsys):
    run("video", "drive.mp4", "--rig", "rig.json", "-o", "out.mp4", "--view", view, "--end", 0.15, capsys=capsys)
    with read_frames("out.mp4") as frames:
        pictures = [frame.frame_bgr for frame in frames]
    assert len(pictures) == 3 and pictures[0].std() > 10


@pytest.mark.parametrize("jobs", [1, 2])
def test_several_videos_go_to_a_folder(place, clip, capsys, jobs):
    Path("other").mkdir()
    Path("other/drive.mp4").write_bytes(clip.read_bytes())
    Path("bad.mp4").write_text("no video")
    names = ["drive.mp4", "bad.mp4", "other/drive.mp4"]
    refused(capsys, "video", *names, "--rig", "rig.json", "-o", "one.mp4", match="needed a folder")
    options = ["--rig", "rig.json", "-o", "out", "--json", "lanes.jsonl", "--jobs", jobs]
    refused(capsys, "video", *names, *options, match="bad.mp4", lines=2)
    assert {path.name for path in Path("out").iterdir()} == {"drive.mp4", "drive-2.mp4"}
    rows = [json.loads(line)["raw_file"] for line in Path("lanes.jsonl").read_text().splitlines()]
    assert rows == [f"{name}:{i:06d}" for name in ("drive.mp4", "other/drive.mp4") for i in range(12)]


def test_ctrl_c_need_not_wait_for_a_video(place, clip, capsys, monkeypatch):
    """On Windows it is answered only between two waits."""

    result = Future.result

    def of_what_is_done(future, timeout=None):
        assert future.done(), "a wait without a limit"
        return result(future, timeout)

    monkeypatch.setattr(Future, "result", of_what_is_done)
    Path("b.mp4").write_bytes(clip.read_bytes())
    arguments = ["--rig", "rig.json", "--no-video", "--json", "l.jsonl", "--jobs", 2]
    run("video", "drive.mp4", "b.mp4", *arguments, capsys=capsys)
    assert len(Path("l.jsonl").read_text().splitlines()) == 24


def test_jobs_keep_the_rows_of_what_was_begun(place, clip, capsys, monkeypatch):
    """Ctrl-C while the first of three is waited for."""
    second_done = threading.Event()

    def one_row(path, out, rig, *, write_row, **_):
        if path.name == "c.mp4":
            raise LanelibError("stopped")
        write_row({"raw_file": f"{path.name}:000000"})
        if path.name == "a.mp4":
            second_done.wait(10)
            raise KeyboardInterrupt
        second_done.set()
        raise LanelibError("stopped")

    monkeypatch.setattr(commands, "run_video", one_row)
    monkeypatch.setattr(commands, "probe", lambda path: SimpleNamespace(size_wh=SIZE_WH))
    names = ["a.mp4", "b.mp4", "c.mp4"]
    _, err = run("video", *names, "--rig", "rig.json", "--no-video", "--json", "l.jsonl", "--jobs", 2, code=130,
                 capsys=capsys)
    assert "l.partial.jsonl" in err and not Path("l.jsonl").exists()
    rows = Path("l.partial.jsonl").read_text().splitlines()
    assert [json.loads(row)["raw_file"][:5] for row in rows] == ["a.mp4", "b.mp4"]


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts the open files of Linux")
def test_many_videos_need_few_open_files(place, capsys):
    import resource

    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    names = [f"gone{i}.mp4" for i in range(60)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 30, limits[1]))
    try:
        options = ["--rig", "rig.json", "--no-video", "--json", "l.jsonl", "--jobs", 2]
        refused(capsys, "video", *names, *options, match="60 of 60", lines=61)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_a_truncated_video_is_done_as_far_as_it_goes(place, drive, capsys):
    with VideoWriter(place / "whole.mp4", fps=20, preset="ultrafast") as writer:
        for frame in drive * 3:
            writer.write(frame)
    data = Path("whole.mp4").read_bytes()
    Path("cut.mp4").write_bytes(data[: len(data) // 2])
    out = refused(
        capsys,
        "video",
        "cut.mp4",
        "--rig",
        "rig.json",
        "-o",
        "out.mp4",
        "--json",
        "lanes.jsonl",
        match="ends too early",
    )
    n = len(Path("lanes.jsonl").read_text().splitlines())
    assert 5 < n < 36 and f"{n} frames" in out
    with read_frames("out.mp4") as frames:
        assert sum(1 for _ in frames) == n


@pytest.mark.parametrize(
    "make", [clips.audio_only, clips.no_frames, Path.touch, lambda p: p.write_text("x" * 999), Path.mkdir]
)
def test_what_is_no_video(place, capsys, make):
    make(place / "x.mp4")
    refused(capsys, "video", "x.mp4", "--rig", "rig.json", "-o", "out.mp4", match="x.mp4: needed")
    assert not list(place.glob("*out*"))


def test_live_shows_a_file_on_a_page(place, clip, capsys):
    out, err = run("live", "drive.mp4", "--rig", "rig.json", "--page", "--frames", 3, capsys=capsys)
    assert "http://127.0.0.1:" in err and out.startswith("3 frames")
    refused(capsys, "live", "gone.mp4", "--rig", "rig.json", "--quiet", match="gone.mp4")


def test_live_measures_the_rate_of_its_source(place, clip, capsys, monkeypatch):
    """What the tracker is told after 25 frames that come every tenth of a second, and then no more."""
    told, frame, set_fps = [], np.zeros((360, 640, 3), np.uint8), LaneTracker.set_fps

    def ten_a_second(source, step, **_):
        for index in range(60):
            step(frame, index, index / 10)
        return "done"

    monkeypatch.setattr("lanelib.live.live", ten_a_second)
    monkeypatch.setattr(LaneTracker, "set_fps", lambda tracker, fps: told.append(fps) or set_fps(tracker, fps))
    run("live", "drive.mp4", "--rig", "rig.json", "--quiet", capsys=capsys)
    assert told == [25.0, pytest.approx(10)]


def test_video_tells_the_tracker_the_rate_of_the_file(place, clip, capsys, monkeypatch):
    told = []
    monkeypatch.setattr(
        runs, "LaneFinder", lambda *args, fps, **options: told.append(fps) or LaneFinder(*args, **options)
    )
    run("video", "drive.mp4", "--rig", "rig.json", "-o", "out.mp4", "--quiet", capsys=capsys)
    assert told == [probe("drive.mp4").fps]


# ---------------------------------------------------------------------------------------------- other commands
def test_calibrate_prints_every_board(place, capsys):
    Path("boards").mkdir()
    for i, rvec in enumerate([(0.3, 0.2, 0.0), (-0.35, 0.1, 0.1), (0.1, -0.4, -0.1), (0.2, 0.35, 0.2)]):
        cv2.imwrite(f"boards/b{i}.png", chessboards.render(rvec, (0.2 * i - 0.3, 0.1, 12.0), seed=i))
    cv2.imwrite("boards/road.png", cv2.imread("road.png"))
    Path("boards/._b0.png").write_bytes(b"macOS")
    out, _ = run("calibrate", "boards", "--board", "7x5", "-o", "camera.json", capsys=capsys)
    assert "4 of 5 pictures used" in out and "| road.png" in out and "wrote camera.json" in out and "+-" in out
    assert Camera.load("camera.json").size_wh == chessboards.CAMERA.size_wh
    refused(capsys, "calibrate", "boards", "-o", "other.json", match="9x6")
    Path("none").mkdir()
    refused(capsys, "calibrate", "none", "-o", "other.json", match="none")
    refused(capsys, "calibrate", "nowhere", "-o", "other.json", match="nowhere")
    assert not Path("other.json").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here that is always full")
def test_a_full_disk_behind_stdout_is_said_of_stdout(place, capsys, monkeypatch):
    with open("/dev/full", "w", buffering=1) as full:
        monkeypatch.setattr("sys.stdout", full)
        code = cli.main(["image", "road.png", "--rig", "rig.json", "--json", "-"])
    monkeypatch.undo()
    err = capsys.readouterr().err
    assert code == 2 and "stdout: needed a place for the results" in err and "try it alone" not in err


def test_evaluate_prints_and_writes(place, road, capsys, monkeypatch):
    run("image", "road.png", "--rig", "rig.json", "-o", "out", "--json", "lanes.jsonl", capsys=capsys)
    camera = make_rig().camera.to_dict()
    truth = {
        "format": "lanelib-truth/1",
        "camera": camera,
        "frames": [road[1] | {"raw_file": "road.png", "tags": ["day"]}],
    }
    Path("truth.json").write_text(json.dumps(truth))
    out, _ = run("evaluate", "truth.json", "lanes.jsonl", "--json", "scores.json", capsys=capsys)
    assert "TuSimple" in out and "cm at 20 m" in out and "| day" in out and "wrote scores.json" in out
    found = json.loads(Path("scores.json").read_text())["tags"]["day"]
    assert found["tusimple"] == 1 and found["lateral_m"][1] < 0.05 and abs(found["offset_m"]) < 0.05
    out, _ = run("evaluate", "truth.json", "lanes.jsonl", "--json", "-", capsys=capsys)
    assert json.loads(out)["tags"]["day"]["frames"] == 1
    truth["frames"].append(truth["frames"][0] | {"raw_file": "other.png"})
    Path("truth.json").write_text(json.dumps(truth))
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(Path("lanes.jsonl").read_bytes()), "cp1252"))
    out, err = run("evaluate", "truth.json", "-", "--json", "-", capsys=capsys)
    assert json.loads(out)["unpredicted"] == 1 and json.loads(out)["tags"]["day"]["frames"] == 2
    assert "1 of 2 labelled frames have no prediction" in err
    refused(capsys, "evaluate", "rig.json", "lanes.jsonl", match="rig.json")
    refused(capsys, "evaluate", "lanes.jsonl", "gone.jsonl", match="gone.jsonl")


def test_fetch_knows_its_names(capsys):
    refused(capsys, "fetch", "nothing", match="udacity")


# ---------------------------------------------------------------------------------------------- how it ends
@pytest.mark.parametrize("error, code, text", [
    (RuntimeError("boom\nbang"), 1, "a fault of lanelib (RuntimeError: boom bang)"),
    (MemoryError(), 1, "not enough memory"), (KeyboardInterrupt(), 130, "interrupted"),
    (PermissionError(13, "Permission denied", "secret"), 2, "secret: Permission denied"),
])
def test_every_end_is_one_line(monkeypatch, capsys, error, code, text):
    def fail(*_):
        raise error

    monkeypatch.delenv("LANELIB_DEBUG", raising=False)
    monkeypatch.setattr(commands, "fetch", fail)
    _, err = run("fetch", "x", code=code, capsys=capsys)
    assert text in err and len(err.splitlines()) == 1


def test_faults_show_where_on_request(monkeypatch):
    monkeypatch.setattr(commands, "fetch", lambda *_: 1 / 0)
    monkeypatch.setenv("LANELIB_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["fetch", "x"])


def child(*arguments, **options):
    """The command line as a process; Ctrl-C reaches it even where the tests themselves run in the background."""
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import lanelib.__main__ as m"
    return subprocess.Popen(
        [sys.executable, "-c", f"{program}; m.sys.exit(m.main())", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,
    )


def processes_naming(text: str) -> list[str]:
    """Command lines of the processes that have this in their arguments."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
        except OSError:
            continue
        if text in line:
            found.append(line)
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("number, code", [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_nothing_behind(place, drive, number, code):
    with VideoWriter(place / "long.mp4", fps=20, preset="ultrafast") as writer:
        for _ in range(60):
            for frame in drive:
                writer.write(frame)
    Path("out.mp4").write_text("from before")
    process = child("video", "long.mp4", "--rig", "rig.json", "-o", "out.mp4", "--json", "lanes.jsonl", cwd=place)
    deadline = time.monotonic() + 60
    while not list(place.glob(".out*.part*")):  # ffmpeg writes: it is in the middle
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == code, err
    assert len(err.splitlines()) == 1 and err.startswith("lanelib: ") and not out
    assert Path("out.mp4").read_text() == "from before"
    kept = "lanes.partial.jsonl"
    assert {path.name for path in place.iterdir()} == {"long.mp4", "out.mp4", "rig.json", "road.png", kept}
    assert err.endswith(f"; the rows so far are in {kept}\n")
    rows = [json.loads(line) for line in Path(kept).read_text().splitlines()]
    assert [row["raw_file"] for row in rows] == [f"long.mp4:{i:06d}" for i in range(len(rows))] and rows
    assert not processes_naming(str(place))


@pytest.fixture
def as_in_a_terminal():
    """Ctrl-C is heard; in the background of a shell it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("as_in_a_terminal")
@pytest.mark.parametrize("number, code, word", [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "ended by")])
def test_a_signal_is_told_even_while_a_picture_is_decoded(place, capfd, monkeypatch, number, code, word):
    """Then the standard error is caught, for what libjpeg says; what lanelib says must not be lost with it."""
    imdecode = cv2.imdecode

    def hit(*args):
        os.kill(os.getpid(), number)
        return imdecode(*args)

    monkeypatch.setattr(cv2, "imdecode", hit)
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    assert cli.main(["image", "road.png", "--rig", "rig.json", "-o", "out"]) == code
    err = capfd.readouterr().err
    assert err.startswith(f"lanelib: {word}") and len(err.splitlines()) == 1
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.usefixtures("as_in_a_terminal")
@pytest.mark.parametrize("names", [["road.png"], ["road.png", "again.png", "third.png"]])
@pytest.mark.parametrize("number, code, word", [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "ended by")])
def test_a_signal_that_a_library_makes_an_error_of_ends_the_run(
    place, road, monkeypatch, capfd, names, number, code, word
):
    """As matplotlib does, where it comes while a number is converted: "Invalid bounding box"."""
    for name in names[1:]:
        cv2.imwrite(name, road[0])
    tried = []

    def swallowed(*_, **__):
        tried.append(1)
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            raise LanelibError("cannot write road.jpg: Invalid bounding box") from None

    monkeypatch.setattr(commands, "write_pictures", swallowed)
    assert cli.main(["image", *names, "--rig", "rig.json", "-o", "out"]) == code
    err = capfd.readouterr().err
    assert err.startswith(f"lanelib: {word}") and len(err.splitlines()) == 1 and len(tried) == 1


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be held back on this system")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_wait_while_libraries_are_loaded(number):
    came, before = [], signal.signal(number, lambda *_: came.append(number))
    try:
        with cli._signals_wait():
            signal.pthread_kill(threading.get_ident(), number)  # other tests' threads would not hold it back
            time.sleep(0.05)
            assert came == []
        time.sleep(0.05)
        assert came == [number] and not signal.pthread_sigmask(signal.SIG_BLOCK, ())
    finally:
        signal.signal(number, before)


@pytest.mark.usefixtures("as_in_a_terminal")
@pytest.mark.parametrize("number, code, word", [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "ended by")])
def test_a_signal_is_one_even_where_a_library_makes_another_error_of_it(place, capsys, monkeypatch, number, code, word):
    """As old numpy and matplotlib do while they are being loaded."""

    def loading(*args):
        try:
            os.kill(os.getpid(), number)
            time.sleep(5)
        except BaseException:
            raise ImportError("you should not try to import numpy from its source directory") from None

    monkeypatch.setattr(commands, "image", loading)
    assert cli.main(["image", "road.png", "--rig", "rig.json", "-o", "out"]) == code
    assert capsys.readouterr().err.startswith(f"lanelib: {word}")


def test_a_reader_that_stops_reading_is_no_fault(place, clip):
    process = child("video", "drive.mp4", "--rig", "rig.json", "--no-video", "--json", "-", "--quiet", cwd=place)
    process.stdout.close()  # like `| head -0`
    err = process.stderr.read()
    assert process.wait(timeout=60) == 141 and not err
    process.stderr.close()


# ---------------------------------------------------------------------------------------------- fuzz
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.floats(0, 1), new=st.binary(min_size=1, max_size=4), target=st.sampled_from(["rig.json", "road.png"]))
def test_damaged_files_never_cause_a_fault(place, capsys, at, new, target):
    data = bytearray((place / target).read_bytes())
    start = int(at * (len(data) - 1))
    data[start : start + len(new)] = new
    (place / f"damaged_{target}").write_bytes(data)
    rig, picture = ("damaged_rig.json", "road.png") if target == "rig.json" else ("rig.json", "damaged_road.png")
    code = cli.main(["image", picture, "--rig", rig, "-o", "out"])
    err = capsys.readouterr().err
    assert code in (0, 2) and len(err.splitlines()) == (1 if code else 0), err
