"""The write-up of a run: every number in it is one of the run's."""

import json
import os
import re
from pathlib import PureWindowsPath

import pytest

from lanelib import datasets
from lanelib.course import run_course
from lanelib.outputs import Console
from lanelib.writeup import write_up


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    root = tmp_path_factory.mktemp("own")
    shipped = datasets.get("rendered")
    folder = root / "test_images" / "mine"
    folder.mkdir(parents=True)
    for name in ("test2.jpg", "no_markings.jpg"):
        (folder / name).write_bytes((shipped.test_images / name).read_bytes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LANELIB_DATA", str(root))
        run_course(["mine"], console=Console(quiet=True))
    out = root / "output_images" / "mine"
    rows = [json.loads(line) for line in (out / "lanes.jsonl").read_text().splitlines()]
    return out, (out / "WRITEUP.md").read_text(encoding="utf-8"), {row["raw_file"]: row for row in rows}


def test_its_numbers_are_those_of_the_run(page):
    _, text, rows = page
    row = rows["test2.jpg"]
    assert f"{row['radius_m']:.0f} m to the left" in text
    assert f"{abs(row['offset_m']):.2f} m right of the lane's centre" in text
    assert f"{row['lane_width_m']:.2f} m wide" in text


def test_its_pictures_are_there(page):
    out, text, _ = page
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert len(links) >= 8
    assert all((out / link).exists() for link in links)


def test_what_was_not_found_is_said_with_the_reason(page):
    _, text, rows = page
    assert rows["no_markings.jpg"]["status"] == "none"
    assert rows["no_markings.jpg"]["reason"] in text.split("## What is doubtful")[1]


def test_the_links_to_the_videos_are_those_of_a_web_page(tmp_path, monkeypatch):
    """On Windows, too, where a path has another stroke."""
    (tmp_path / "test_images/mine").mkdir(parents=True)
    (tmp_path / "test_images/mine/a.jpg").touch()
    overlays = tmp_path / "output_videos/mine/05_overlay"
    overlays.mkdir(parents=True)
    (overlays / "drive.jsonl").write_text('{"status": "measured", "confidence": 1}\n')
    monkeypatch.setenv("LANELIB_DATA", str(tmp_path))
    data_set, relpath = datasets.get("mine"), os.path.relpath
    monkeypatch.setattr("os.path.relpath", lambda *places: relpath(*places).replace("/", "\\"))
    monkeypatch.setattr("lanelib.writeup.Path", PureWindowsPath)
    assert "[drive](../../output_videos/mine/05_overlay/drive.mp4)" in write_up(data_set, None, None)
