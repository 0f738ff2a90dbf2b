"""The main job on a small data set: everything is written, and a failure of one item does not stop the others."""

import json
from pathlib import Path

import chessboards
import cv2
import pytest
from test_cli import make_rig

from lanelib import course, datasets
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.road import CarPose
from lanelib.simulator import Scene, render_road
from lanelib.video import VideoWriter


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A set `mine` of four boards, two pictures with truth, and a clip, with a rig; it is all there is."""
    monkeypatch.setattr(datasets, "roots", lambda: (tmp_path,))
    for folder in ("camera_cal/mine", "test_images/mine", "test_videos/mine", "rigs"):
        (tmp_path / folder).mkdir(parents=True)
    rig = make_rig("mine")
    rig.save(tmp_path / "rigs/mine.json")
    frames, truths = zip(*[render_road(Scene(pose=CarPose(3.0 * i, 0.1 * i), seed=i)) for i in range(6)], strict=True)
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"test_images/mine/road{i}.png"), frames[i])
    rows = [truth | {"raw_file": f"road{i}.png", "tags": ["day"]} for i, truth in enumerate(truths[:2])]
    truth = {"format": "lanelib-truth/1", "camera": rig.camera.to_dict(), "frames": rows}
    (tmp_path / "test_images/mine/truth.json").write_text(json.dumps(truth))
    with VideoWriter(tmp_path / "test_videos/mine/drive.mp4", fps=20, preset="ultrafast") as writer:
        for frame in frames:
            writer.write(frame)
    return tmp_path


def add_boards(project: Path, count: int) -> None:
    for i in range(count):
        rvec = (0.3 - 0.2 * i, 0.35 - 0.25 * i, 0.1 * i)
        board = chessboards.render(rvec, (0.2 * i - 0.3, 0.1, 14.0), board_wh=(9, 6), seed=i)
        cv2.imwrite(str(project / f"camera_cal/mine/b{i}.png"), board)


class Log(course.Console):
    """What is said, kept."""

    def __init__(self):
        super().__init__()
        self.results, self.notes, self.complaints = [], [], []

    def result(self, text):
        self.results.append(str(text))

    def note(self, text):
        self.notes.append(str(text))

    def complain(self, text):
        self.complaints.append(str(text))


def test_everything_is_written(project):
    add_boards(project, 4)
    log = Log()
    assert course.run_course(console=log) == 0, log.complaints
    assert not log.complaints
    out = project / "output_images/mine"
    names = {path.name for path in out.iterdir()}
    assert {
        "calibration.json",
        "summary.md",
        "lanes.jsonl",
        "road0.jpg",
        "road1.jpg",
        "01_undistorted",
        "02_mask",
        "06_errors",
    } <= names
    for file in ("01_undistorted/road1.jpg", "02_evidence/road0.jpg", "04_fit/road1.jpg", "05_diagnostic/road0.jpg"):
        assert cv2.imread(str(out / file)) is not None, file
    for file in ("01_boards/corners.jpg", "01_boards/errors.png", "05_over_time/drive.png", "05_hardest/drive.jpg"):
        assert cv2.imread(str(out / file)) is not None, file
    assert Camera.load(out / "calibration.json").size_wh == chessboards.CAMERA.size_wh
    before_after = cv2.imread(str(out / "01_before_after/b0.jpg"))
    assert before_after.shape[1] == 2 * chessboards.CAMERA.size_wh[0]
    overlays = project / "output_videos/mine/05_overlay"
    assert {path.name for path in overlays.iterdir()} == {"drive.mp4", "drive.jsonl"}
    assert len((overlays / "drive.jsonl").read_text().splitlines()) == 6
    summary = (out / "summary.md").read_text()
    assert "4 of 4 chessboards used" in summary and "cm at 10 m" in summary and "Could not" not in summary
    rows = {
        row.split("|")[1].strip(): [cell.strip() for cell in row.split("|")[2:5]]
        for row in summary.splitlines()
        if "|" in row
    }
    assert rows["pictures"] == ["2", "2", "0"] and rows["drive.mp4"] == ["6", "6", "0"]
    assert summary.strip() in log.results[0]


def test_one_failure_does_not_stop_the_rest(project):
    add_boards(project, 1)  # too few
    (project / "test_images/mine/broken.jpg").write_bytes(b"\xff\xd8\xff nothing")
    (project / "test_videos/mine/a_broken.mp4").write_text("nothing")
    log = Log()
    assert course.run_course(["mine"], console=log) == 2
    assert (project / "output_images/mine/road1.jpg").is_file()
    assert (project / "output_videos/mine/05_overlay/drive.mp4").is_file()
    summary = (project / "output_images/mine/summary.md").read_text()
    for missed in ("calibrate: need at least 3", "broken.jpg", "a_broken.mp4"):
        assert missed in summary.split("Could not be done")[1]
        assert any(missed in line and line.startswith("not done: mine: ") for line in log.complaints)
    assert not (project / "output_images/mine/calibration.json").exists()


def test_pictures_of_one_stem_and_unreadable_ones(project):
    """road0.jpg beside road0.png gets a name of its own; what cannot be read costs neither rig nor figures."""
    add_boards(project, 4)
    (project / "camera_cal/mine/a_broken.png").write_text("nothing")
    (project / "test_images/mine/a_broken.png").write_text("nothing")
    images = project / "test_images/mine"
    cv2.imwrite(str(images / "road0.jpg"), cv2.imread(str(images / "road1.png")))
    (images / "truth.json").unlink()
    (project / "rigs/mine.json").rename(project / "rigs/other.json")
    log = Log()
    assert course.run_course(videos=False, console=log) == 2
    assert len(log.complaints) == 2 and all("test_images/mine/a_broken.png" in line for line in log.complaints)
    out = project / "output_images/mine"
    assert (out / "01_boards/corners.jpg").is_file() and (out / "01_before_after/b0.jpg").is_file()
    first, second = (cv2.imread(str(out / name)) for name in ("road0.jpg", "road0-2.jpg"))
    assert abs(first.astype(int) - second).max() > 60 and (out / "04_fit/road0-2.jpg").is_file()
    page = (out / "WRITEUP.md").read_text(encoding="utf-8")
    assert "[road0](road0.jpg)" in page and "[road0-2](road0-2.jpg)" in page


def test_a_fault_is_told_from_bad_input(project, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError("oh\nno")

    monkeypatch.setattr(course, "write_steps", fail)
    log = Log()
    assert course.run_course(videos=False, console=log) == 1
    assert any("a fault of lanelib (ZeroDivisionError: oh no)" in line for line in log.complaints)
    assert not (project / "output_videos/mine").exists()


def test_a_set_without_a_rig_takes_the_known_one_that_fits(project):
    (project / "rigs/mine.json").rename(project / "rigs/other.json")
    log = Log()
    assert course.run_course(videos=False, console=log) == 0
    summary = (project / "output_images/mine/summary.md").read_text()
    assert "No rig of its own; rig mine: fits best" in summary
    assert "make one: lanelib rig FRAMES --camera" in summary and "rigs/mine.json" in summary
    (project / "rigs/other.json").unlink()
    assert course.run_course(videos=False, console=Log()) == 2


def test_a_set_that_is_not_there_is_said_first(project, monkeypatch):
    with pytest.raises(LanelibError, match="'yours' is not there"):
        course.run_course(["mine", "yours"])
    assert not (project / "output_images").exists()
    monkeypatch.setattr(datasets, "roots", lambda: ())
    with pytest.raises(LanelibError, match="lanelib fetch udacity"):
        course.run_course()
