"""Which pictures there are: folders, names, order, one's own folder, and the package without a checkout."""

from pathlib import Path

import pytest

from lanelib import datasets
from lanelib.errors import LanelibError


def put(root: Path, *paths: str) -> None:
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(b"x")


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """A checkout of its own instead of this one, and no LANELIB_DATA."""
    root = tmp_path / "project"
    put(root, "pyproject.toml", "lanelib/datasets.py")
    monkeypatch.setattr(datasets, "_project", lambda: root)
    monkeypatch.delenv("LANELIB_DATA", raising=False)
    return root


def test_the_checkout_of_this_package_is_found():
    assert datasets.project_root() == Path(__file__).resolve().parents[1]


def test_a_set_is_what_holds_pictures_or_clips(project):
    put(project, "camera_cal/boards/b.png", "test_images/still/a.JPG", "test_videos/clip/a.mp4")
    put(project, "test_images/notes/readme.txt", "test_images/.hidden/a.jpg", "test_images/loose.jpg")
    put(project, "test_videos/half/a.mp4.part", "output_images/done/a.jpg")
    assert datasets.available() == ("boards", "clip", "still")


def test_folders_and_files_of_a_set(project):
    put(project, "camera_cal/car/calibration10.jpg", "camera_cal/car/calibration2.jpg", "camera_cal/car/truth.json")
    put(project, "test_videos/car/b.mov", "test_videos/car/a.mp4", "test_videos/car/a.mp4.part", "rigs/car.json")
    car = datasets.get("car")
    assert [path.name for path in car.boards()] == ["calibration2.jpg", "calibration10.jpg"]
    assert [path.name for path in car.videos()] == ["a.mp4", "b.mov"]
    assert car.images() == []
    assert car.rig_file == project / "rigs/car.json" and car.has_rig
    assert car.output_images == project / "output_images/car" and not car.output_images.exists()
    assert car.output_videos == project / "output_videos/car"
    assert str(car) == "car: 2 chessboards, 0 pictures, 2 videos, a rig"


def test_ones_own_folder_comes_first_and_keeps_its_results(project, tmp_path, monkeypatch):
    own = tmp_path / "my drive"
    put(project, "test_images/both/a.jpg", "test_images/theirs/a.jpg", "rigs/both.json", "rigs/theirs.json")
    put(own, "test_images/both/mine.jpg", "test_images/mine/a.jpg", "rigs/mine.json")
    monkeypatch.setenv("LANELIB_DATA", str(own))
    assert datasets.available() == ("both", "mine", "theirs")
    assert [path.name for path in datasets.get("both").images()] == ["mine.jpg"]
    assert datasets.get("mine").output_images == own / "output_images/mine"
    assert datasets.get("theirs").root == project
    assert datasets.get("mine").rig_file == own / "rigs/mine.json"
    # The rig of the project is used where one's own folder has none.
    assert datasets.get("both").rig_file == project / "rigs/both.json"
    put(own, "rigs/both.json")
    assert datasets.get("both").rig_file == own / "rigs/both.json"


def test_a_set_that_is_not_there(project):
    put(project, "test_images/here/a.jpg")
    with pytest.raises(LanelibError, match=r"'gone' is not there \(there: here\)"):
        datasets.get("gone")
    with pytest.raises(LanelibError, match="lanelib fetch udacity"):
        datasets.get("udacity")
    for name in ("", ".", "..", "../here", "here/"):
        with pytest.raises(LanelibError):
            datasets.get(name)


def test_data_folder_that_is_none(project, tmp_path, monkeypatch):
    monkeypatch.setenv("LANELIB_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(LanelibError, match="LANELIB_DATA must name a folder.*nowhere"):
        datasets.available()


def test_the_package_without_its_checkout(tmp_path, monkeypatch):
    monkeypatch.setattr(datasets, "_project", lambda: tmp_path / "site-packages")
    monkeypatch.delenv("LANELIB_DATA", raising=False)
    with pytest.raises(LanelibError, match="clone the repository and run `make`, or set LANELIB_DATA"):
        datasets.available()
    put(tmp_path / "own", "test_images/mine/a.jpg")
    monkeypatch.setenv("LANELIB_DATA", str(tmp_path / "own"))
    assert datasets.available() == ("mine",)


def test_truth_of_each_folder(project):
    put(project, "camera_cal/car/a.jpg", "test_images/car/a.jpg")
    (project / "test_images/car/truth.json").write_text(
        '{"format": "lanelib-truth/1", "frames": [{"raw_file": "a.jpg", "h_samples": [], "lanes": []}]}'
    )
    car = datasets.get("car")
    assert list(car.image_truth()) == ["a.jpg"]
    assert car.board_truth() == {} and car.video_truth() == {}


def test_tags():
    truth = {"a": {"tags": ["rain", "night"]}, "b": {"tags": ["rain"]}, "c": {}}
    assert datasets.tagged(truth, "rain", "night") == ["a"]
    assert datasets.tagged(truth) == ["a", "b", "c"]
