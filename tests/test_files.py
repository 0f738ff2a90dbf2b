"""Files that are no files: devices, pipes, links, far too large ones. What the tests of each module do not try already.

A loader that opens a pipe waits for ever, and one that reads /dev/zero eats all memory; so every test here runs in the
time that pytest gives it anyway, and a failure shows as a hang.
"""

import os
import sys
import threading
from pathlib import Path

import clips
import numpy as np
import pytest

from lanelib import cli, rigs
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.files import read_text, write_bytes
from lanelib.labels import read_labels
from lanelib.outputs import json_lines
from lanelib.pictures import read_image, write_image
from lanelib.rig import Rig
from lanelib.truth import load_truth

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes, devices and links of Unix")

CAMERA = Camera.ideal((160, 96), hfov_deg=60)
RIG = Rig(CAMERA, BirdsEye.from_mounting(CAMERA, height_m=1.2, pitch_deg=3))


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a rig, a picture and a clip, and no known data set."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rigs.datasets, "roots", lambda: ())
    RIG.save("rig.json")
    write_image("road.png", np.full((96, 160, 3), 90, np.uint8))
    clips.clip(Path("clip.mp4"), n_frames=5)
    os.mkfifo("pipe")
    with open("huge", "wb") as file:
        file.truncate(1 << 40)  # a hole of a terabyte: it takes no room on the disk
    return tmp_path


LOADERS = (Camera.load, Rig.load, read_labels, read_image)


@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "huge"])
@pytest.mark.parametrize("load", LOADERS, ids=["camera", "rig", "labels", "picture"])
def test_neither_pipe_nor_device_nor_huge_file_is_read(place, load, name):
    with pytest.raises(LanelibError) as error:
        load(name)
    assert name in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_truth_that_is_a_pipe(place):
    os.mkfifo("truth.json")
    with pytest.raises(LanelibError, match="pipe"):
        load_truth(place)


def test_text_of_ordinary_files_is_read_whole(place):
    Path("a.txt").write_text("Straße 道\n" * 1000, encoding="utf-8")
    assert read_text("a.txt") == "Straße 道\n" * 1000
    with pytest.raises(OSError, match="too large"):
        read_text("a.txt", max_bytes=1000)


@pytest.mark.parametrize("line", [
    "image {} --rig rig.json -o out.png", "image road.png --rig {} -o out.png", "video {} --rig rig.json -o out.mp4",
    "video clip.mp4 --rig {} -o out.mp4", "calibrate {} -o out.json", "rig {} --camera none -o out.json",
    "rig road.png --camera {} -o out.json", "evaluate {} --rig rig.json",
])
@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "huge"])
def test_neither_is_waited_for_by_a_command(place, capsys, line, name):
    assert cli.main(line.format(name).split()) == 2
    err = capsys.readouterr().err
    assert err and all(said.startswith("lanelib: ") for said in err.splitlines()) and "Traceback" not in err
    assert not list(place.glob("*out*"))


def test_pipes_and_devices_stay_what_they_are(place):
    """Bytes and rows go into them; a file in their place would be read by nobody."""
    for write in (lambda path: write_bytes(path, b"x"), _one_row):
        read = []
        reader = threading.Thread(target=lambda into=read: into.append(Path("pipe").read_bytes()), daemon=True)
        reader.start()
        write(Path("pipe"))
        reader.join(10)
        assert read[0] and Path("pipe").is_fifo()
        write(Path("/dev/null"))
        assert Path("/dev/null").is_char_device()
    assert sorted(path.name for path in place.iterdir()) == ["clip.mp4", "huge", "pipe", "rig.json", "road.png"]


def _one_row(path: Path) -> None:
    with json_lines(path) as write_row:
        write_row({"raw_file": "a.jpg"})


def test_hard_links_and_links_to_nowhere(place, capsys):
    """A hard link of the input is the input; a link to nowhere as output is replaced, not followed."""
    os.link("clip.mp4", "same.mp4")
    before = Path("clip.mp4").read_bytes()
    assert cli.main(["video", "clip.mp4", "--rig", "rig.json", "-o", "same.mp4", "--quiet"]) == 2
    assert Path("clip.mp4").read_bytes() == before and "found the same" in capsys.readouterr().err
    Path("nowhere.mp4").symlink_to("gone.mp4")
    assert cli.main(["video", "clip.mp4", "--rig", "rig.json", "-o", "nowhere.mp4", "--quiet"]) == 0
    assert Path("nowhere.mp4").stat().st_size and not Path("gone.mp4").exists()


@pytest.mark.parametrize("make", [clips.rotated, clips.changing_size, clips.odd])
def test_unusual_videos_through_the_command(place, capsys, make):
    """Done where the proportions fit the rig, refused in one line where they do not; nothing half-written."""
    source = make(place / ("in.h264" if make is clips.changing_size else "in.mp4"))
    code = cli.main(["video", str(source), "--rig", "rig.json", "-o", "out.mp4", "--json", "out.jsonl", "--quiet"])
    err = capsys.readouterr().err
    assert code == (2 if make is clips.rotated else 0), err  # 96x160 is no picture of a 160x96 camera
    assert len(err.splitlines()) == (1 if code else 0) and Path("out.mp4").exists() == (code == 0)
    if not code:
        assert len(Path("out.jsonl").read_text().splitlines()) == 20
    assert not list(place.glob(".*"))
