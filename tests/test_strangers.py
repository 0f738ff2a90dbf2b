"""tools/strangers.py: five pictures of one camera, drawn by the simulator, and what the report says of them."""

import json
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from roads import rig_of_scene

from lanelib.road import CarPose, Road
from lanelib.simulator import Scene, render_road

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))
import strangers  # noqa: E402


def scene(number):
    return Scene(road=Road([0], [number / 8000]), pose=CarPose(3.0 * number, 0.1 * number - 0.2), seed=number)


@pytest.fixture
def folder(tmp_path):
    here, frames = tmp_path / "00", []
    here.mkdir()
    for number in range(5):
        frame, truth = render_road(scene(number))
        cv2.imwrite(str(here / f"{number}.png"), frame)
        frames.append(truth | {"raw_file": f"{number}.png", "tags": ["even" if number % 2 == 0 else "odd"]})
    cv2.imwrite(str(here / "4.png"), np.zeros_like(frame))  # the last one shows nothing: a lane that is not found
    rig = rig_of_scene(scene(0))
    rig.save(here / "rig.json")
    document = {"format": "lanelib-truth/1", "camera": rig.camera.to_dict(), "frames": frames}
    (here / "truth.json").write_text(json.dumps(document))
    return tmp_path


def test_the_report_counts_what_is_found_and_what_is_not(folder, capsys):
    report = folder / "report.md"
    assert strangers.main([str(folder), "-o", str(report)]) == 0
    rows = {
        cells[0]: cells[1:]
        for cells in (
            [c.strip() for c in line.strip("|").split("|")] for line in report.read_text().splitlines() if "|" in line
        )
    }
    n, with_lane, tusimple, strict = map(float, rows["true rig"])
    assert (n, with_lane) == (5, 0.8)
    assert tusimple == pytest.approx(0.8, abs=0.02) and 0.7 < strict <= tusimple
    assert [rows[f"true rig, {tag}"][:2] for tag in ("odd", "even")] == [["2", "1.00"], ["3", "0.67"]]
    assert float(rows["rig found from the five pictures"][1]) >= 0.6 and "a rig was found for 1" in report.read_text()
    assert re.search(r"wrote .*report.md", capsys.readouterr().out)


def test_rows_beyond_fifty_metres_are_left_out(folder):
    rig = rig_of_scene(scene(0))
    _, truth = render_road(scene(0))
    kept = strangers.near_rows(truth, rig)
    v = np.array(kept["h_samples"], float)
    y = rig.birdseye.road_from_points(np.column_stack([np.full(len(v), 320.0), v]))[:, 1]
    assert 0 < len(v) < len(truth["h_samples"]) and 30 < y.max() < 50
    assert all(len(lane) == len(v) for lane in kept["lanes"])
    assert set(truth["h_samples"]) - set(kept["h_samples"]) == {r for r in truth["h_samples"] if r < v.min()}


def test_without_pictures_it_says_what_makes_them(tmp_path, capsys):
    assert strangers.main([str(tmp_path)]) == 2
    assert "python -m render strangers" in capsys.readouterr().err
