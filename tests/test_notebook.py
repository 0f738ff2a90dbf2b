"""What notebooks call first: the set-up check, a road with truth, a clip, a video in the page."""

import base64
import os
import subprocess
import sys

import numpy as np
import pytest

from lanelib import LaneFinder, LanelibError, Rig, datasets, notebook
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.truth import load_truth


@pytest.fixture
def empty_project(tmp_path, monkeypatch):
    """A checkout without any picture."""
    (tmp_path / "lanelib").mkdir()
    (tmp_path / "lanelib" / "datasets.py").touch()
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setattr(datasets, "_project", lambda: tmp_path)
    monkeypatch.delenv("LANELIB_DATA", raising=False)
    return tmp_path


def test_start_says_in_a_line_what_is_missing_and_what_to_run(empty_project):
    with pytest.raises(LanelibError, match=r"git checkout -- test_images/rendered") as caught:
        notebook.start()
    assert "\n" not in str(caught.value)
    board = empty_project / "camera_cal" / "rendered" / "calibration1.jpg"
    board.parent.mkdir(parents=True)
    board.touch()
    with pytest.raises(LanelibError, match=r"the road pictures .*`git checkout -- test_images/rendered"):
        notebook.start("images")
    with pytest.raises(LanelibError, match=r"the rig .*`git checkout -- rigs/rendered.json"):
        notebook.start("rig")
    with pytest.raises(LanelibError, match="one of boards, images, videos, rig"):
        notebook.start("pictures")


def test_start_with_all_there():
    text = notebook.start()
    assert text.startswith("✓") and repr(text) == text._repr_markdown_()


def test_a_road_has_its_truth():
    frame, truth = notebook.road("straight_lines1.jpg")
    assert frame.shape == (720, 1280, 3) and truth["raw_file"] == "straight_lines1.jpg"
    with pytest.raises(LanelibError, match="straight_lines1.jpg"):
        notebook.road("nothing.jpg")


@pytest.fixture(scope="module")
def small_rig():
    camera = Camera.ideal((320, 180), hfov_deg=60.0)
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=1.4, pitch_deg=2.0), "small")


def test_the_simulated_drive_is_true(small_rig, tmp_path, monkeypatch):
    monkeypatch.setattr(notebook, "_cache", lambda: tmp_path)
    monkeypatch.setattr(notebook, "FPS", 5.0)
    whole = notebook.simulate
    monkeypatch.setattr(notebook, "simulate", lambda rig, seconds: whole(small_rig, seconds=seconds))
    clip = notebook._simulated(small_rig)
    assert len(clip) == 30 and clip.fps == 5.0
    assert list(load_truth(clip.path.parent)) == [f"simulated.mp4:{i:06}" for i in range(30)]
    assert sorted(p.name for p in clip.path.parent.iterdir()) == ["simulated.mp4", "truth.json"]
    frames = list(clip.frames())
    assert len(frames) == 30
    assert np.array_equal(clip.frame(17), frames[17]) and np.array_equal(next(clip.frames(5, 9)), frames[5])
    assert len(list(clip.frames(5, 9))) == 4 and list(clip.frames(5, 5)) == []
    before = clip.path.stat().st_mtime_ns
    assert len(notebook._simulated(small_rig)) == 30 and clip.path.stat().st_mtime_ns == before  # made once


def test_of_two_notebooks_that_make_the_drive_the_first_wins(small_rig, tmp_path, monkeypatch):
    """On Windows a file that the other one shows cannot be replaced."""
    folder, replace = tmp_path / notebook.SIMULATED, os.replace

    def made_by_both(rig, own):
        for place in (own, folder):
            (place / "simulated.mp4").write_bytes(b"")
            (place / "truth.json").write_text('{"frames": [{}, {}]}')

    def in_use(source, target):
        if target.exists():
            raise PermissionError(13, "used by another process", str(target))
        replace(source, target)

    monkeypatch.setattr(notebook, "_cache", lambda: tmp_path)
    monkeypatch.setattr(notebook, "_make_simulated", made_by_both)
    monkeypatch.setattr("os.replace", in_use)
    assert len(notebook._simulated(small_rig)) == 2
    assert sorted(p.name for p in folder.iterdir()) == ["simulated.mp4", "truth.json"]


def test_the_finder_agrees_with_the_simulated_truth(monkeypatch):
    monkeypatch.setattr(notebook, "FPS", 5.0)
    rig = Rig.load(datasets.get("rendered").rig_file).scaled((320, 180))
    drive = list(notebook.simulate(rig, seconds=3))
    finder = LaneFinder(rig, track=False)
    for index in (0, 6, 14):
        frame, truth = drive[index]
        assert abs(finder.process(frame).offset_m - truth["offset_m"]) < 0.1


def test_a_video_plays_in_a_browser(small_rig):
    frames = [np.full((90, 161, 3), 40 * i, np.uint8) for i in range(5)]
    page = notebook.play(frames, alt='grey to "white"', width=120)._repr_html_()
    assert "controls" in page and 'aria-label="grey to &quot;white&quot;"' in page
    mp4 = base64.b64decode(page.split("base64,")[1].split('"')[0])
    assert mp4[4:8] == b"ftyp" and b"avc1" in mp4 and mp4.index(b"moov") < mp4.index(b"mdat")  # H.264, index first
    with pytest.raises(LanelibError):
        notebook.play([], alt="nothing")


def test_the_first_cell_names_the_cure_where_lanelib_is_not_installed():
    """As it stands in every notebook, in a Python that does not find lanelib."""
    source = (datasets.project_root() / "notebooks" / "source" / "template.py.txt").read_text(encoding="utf-8")
    cell = source[source.index("try:") : source.index("notebook.start()")]
    block = "import sys; sys.modules['lanelib'] = None\n"
    done = subprocess.run([sys.executable, "-c", block + cell], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.strip() == "lanelib is not installed; run `make lab` in the project's folder"
