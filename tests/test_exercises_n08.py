"""Checkers and figures of notebook 08; the printed board is measured."""

import cv2
import numpy as np
import pytest

from lanelib import exercises
from lanelib.birdseye import BirdsEye
from lanelib.calibration import calibrate
from lanelib.camera import Camera
from lanelib.chessboard import find_board
from lanelib.errors import LanelibError
from lanelib.figures import n08
from lanelib.rig import Rig


def test_square_px():
    assert exercises.check_square_px(lambda mm, dpi: mm / 25.4 * dpi)
    for whole in (round, int, np.ceil):
        assert exercises.check_square_px(lambda mm, dpi, whole=whole: whole(dpi * mm / 25.4))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda mm, dpi: mm * dpi, "dots an inch"),
        (lambda mm, dpi: 25.4 / mm * dpi, "other way round"),
        (lambda mm, dpi: mm / 2.54 * dpi, "that is cm"),
        (lambda mm, dpi: mm / 25 * dpi, "not 25"),
        (lambda mm, dpi: mm * 25.4 * dpi, "divides by 25.4"),
        (lambda mm, dpi: mm / 25.4 / dpi, "multiply by dpi"),
        (lambda mm, dpi: 0.0, "too small"),
        (..., "nothing here"),
    ],
)
def test_wrong_square_px(wrong, hint):
    verdict = exercises.check_square_px(wrong)
    assert not verdict and hint in verdict.hint, verdict


RIGHT = {"a": "height", "b": "pitch", "c": "focal length", "d": "yaw"}


def test_diagnosis():
    assert exercises.check_diagnosis(RIGHT)
    assert exercises.check_diagnosis({key.upper(): value.upper() for key, value in RIGHT.items()})
    assert exercises.check_diagnosis(RIGHT | {"c": "focal"})
    assert exercises.check_diagnosis({key: value.replace(" ", "_") for key, value in RIGHT.items()})


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (RIGHT | {"a": "focal length"}, "a: then the width would be right"),
        (RIGHT | {"b": "height"}, "do not stay parallel"),
        (RIGHT | {"c": "height"}, "width would be wrong"),
        (RIGHT | {"a": "yaw"}, "changes no length"),
        (RIGHT | {"b": "focal length"}, "stretches the way ahead"),
        (RIGHT | {"d": "height"}, "no directions"),
        (RIGHT | {"d": "pitch"}, "opposite directions"),
        (RIGHT | {"d": "roll"}, "one of"),
        (RIGHT | {"c": ...}, "c: nothing here"),
        ({"a": "height"}, "b, c, d not there"),
        ("height", "a dictionary"),
        (None, "None"),
    ],
)
def test_wrong_diagnosis(wrong, hint):
    verdict = exercises.check_diagnosis(wrong)
    assert not verdict and hint in verdict.hint, verdict


def test_zoomed_focal():
    assert exercises.check_zoomed_focal(lambda f, share: f / share)
    assert exercises.check_zoomed_focal(lambda f, share: round(f / share))
    assert "by which factor" in exercises.check_zoomed_focal(lambda f, share: f * (2 - share)).hint
    assert "unchanged" in exercises.check_zoomed_focal(lambda f, share: f).hint
    verdict = exercises.check_zoomed_focal(lambda f, share: f * share)
    assert not verdict and "smaller?" in verdict.hint
    verdict = exercises.check_zoomed_focal(lambda f, share: f / share**2)
    assert not verdict and "one of them" in verdict.hint


@pytest.mark.parametrize(
    ("corners_wh", "square_mm", "paper", "dpi"),
    [((9, 6), 25, "A4", 150), ((8, 5), 40, "A3", 100), ((7, 5), 27, "Letter", 200)],
)
def test_a_printed_board_is_found_and_to_scale(corners_wh, square_mm, paper, dpi):
    page = n08.board_page(corners_wh, square_mm=square_mm, paper=paper, dpi=dpi)
    assert page.dtype == np.uint8 and page.shape[1] == round(n08.PAPERS_MM[paper][0] / 25.4 * dpi)
    found = find_board(page, corners_wh)
    assert found.corners_wh == corners_wh
    grid = found.corners_px.reshape(corners_wh[1], corners_wh[0], 2)
    across = np.abs(grid[0, -1] - grid[0, 0]).max()
    assert across == pytest.approx((corners_wh[0] - 1) * square_mm / 25.4 * dpi, abs=1.0)
    ruler = np.flatnonzero((page == n08.GREY).sum(axis=1) > 90 / 25.4 * dpi)
    columns = np.flatnonzero(page[ruler[0]] == n08.GREY)
    columns = columns[columns <= columns[0] + 101 / 25.4 * dpi]
    assert np.ptp(columns) == pytest.approx(100 / 25.4 * dpi, abs=3)


def test_a_board_too_large_for_the_paper_is_refused_with_the_size_that_fits():
    with pytest.raises(LanelibError, match="use at most 26 mm"):
        n08.board_page((9, 6), square_mm=30, paper="A4")
    n08.board_page((9, 6), square_mm=26, paper="A4", dpi=72)
    with pytest.raises(LanelibError, match="paper must be one of"):
        n08.board_page(paper="A0")


def test_boards_held_up_are_seen_and_flat_ones_refused():
    page = n08.board_page(dpi=150)
    flat = [n08.held_up(page, (640, 360), [(x, 40), (x + 330, 40), (x + 330, 273), (x, 273)]) for x in (20, 120, 280)]
    assert all(find_board(picture).corners_wh == (9, 6) for picture in flat)
    with pytest.raises(LanelibError, match="tilted|no finite solution"):
        calibrate([(str(i), picture) for i, picture in enumerate(flat)])


def test_a_zoom_enlarges_the_middle():
    frame = np.zeros((90, 160, 3), np.uint8)
    cv2.rectangle(frame, (72, 37), (87, 52), (255, 255, 255), -1)  # 16 x 16 in the middle
    lit = (n08.zoomed(frame, 0.5)[:, :, 0] > 127).sum()
    assert lit == pytest.approx(32 * 32, rel=0.05)


def test_a_wider_believed_road_looks_wider_from_above():
    camera = Camera.ideal((320, 180), hfov_deg=60)
    frame = np.full((180, 320, 3), 90, np.uint8)
    low, high = (Rig(camera, BirdsEye.from_mounting(camera, height_m=h, pitch_deg=3)) for h in (1.2, 1.5))
    edge = low.birdseye.points_from_road([[-1.8, 6.0], [-1.8, 30.0]])
    beside = np.array([*edge, (0, edge[1][1]), (0, 179)]).round().astype(np.int32)
    cv2.fillPoly(frame, [beside], (255, 255, 255))  # all left of x = -1.8 m is white

    def left_of_the_middle(rig):
        picture = n08.from_above(rig, frame)
        height, width = picture.shape[:2]
        row = picture[round(0.78 * height), : width // 2, 1].astype(int)  # 12 m ahead, between two marks of the ruler
        return width // 2 - (width // 4 + int(np.argmin(row[width // 4 :] > 170)))

    assert left_of_the_middle(high) / left_of_the_middle(low) == pytest.approx(1.5 / 1.2, rel=0.12)


def test_rigs_that_are_wrong_in_one_thing():
    camera = Camera(np.array([[800.0, 0, 330], [0, 790, 170], [0, 0, 1]]), np.zeros(5), (640, 360))
    rig = Rig(camera, BirdsEye.from_mounting(camera, height_m=1.3, pitch_deg=2, yaw_deg=-1))
    assert n08.mounted(rig, yaw_deg=3.0).mounting == pytest.approx(rig.mounting | {"yaw_deg": 3.0}, abs=1e-6)
    longer = n08.with_focal_length(rig, 1.25)
    road = np.array([[-1.8, 8.0], [1.9, 8.0], [-1.8, 22.0]])
    believed = longer.birdseye.road_from_points(rig.birdseye.points_from_road(road))
    assert believed[1, 0] - believed[0, 0] == pytest.approx(3.7, rel=0.01)
    assert believed[2, 1] / believed[0, 1] == pytest.approx(22 / 8, rel=0.02)
    assert believed[:, 1] == pytest.approx(1.25 * road[:, 1], rel=0.02)


def test_a_command_shows_what_it_said(tmp_path):
    said = n08.command("lanelib calibrate nothing -o c.json", tmp_path)
    assert repr(said).startswith("$ lanelib calibrate nothing") and "lanelib: " in said.text
    assert "usage" not in n08.command("lanelib --help", tmp_path, without=("usage",)).text


def test_a_command_shows_its_tables_as_tables():
    said = n08.Said("lanelib calibrate boards", "| a | b |\n|---|---|\n| 1 | 2 |\n\nwrote it\n  fx 1")
    table = "| a | b |\n|---|---|\n| 1 | 2 |"
    assert said._repr_markdown_() == (
        f"```text\n$ lanelib calibrate boards\n```\n\n{table}\n\n```text\n\nwrote it\n  fx 1\n```"
    )
    assert n08.Said("lanelib", "done")._repr_markdown_() == "```text\n$ lanelib\ndone\n```"


def test_clauses_are_broken_apart_but_not_in_brackets():
    said = n08.Said("lanelib rig a.jpg", "height 1.2 m; focal 1109 px (assumed; by dashes 945); from 2 (of 2) frames")
    assert said.clauses.text.splitlines() == [
        "height 1.2 m;", "    focal 1109 px (assumed; by dashes 945);", "    from 2 (of 2) frames"
    ]
    wide = n08.Said("lanelib rig " + "picture.jpg " * 12, "word " * 40)
    for last in ("-o my_rig.json", "--lane-width 3.66"):  # nor between an option and its value
        assert n08.Said(f"lanelib rig {'a ' * 37}{last}", "").clauses.words.endswith(f" a \\\n    {last}")
    assert max(map(len, repr(wide.clauses).splitlines())) <= 100 and " \\\n" in repr(wide.clauses)


def test_a_command_says_every_letter_whatever_the_system_prefers(tmp_path, monkeypatch):
    for name, value in (("LC_ALL", "C"), ("PYTHONUTF8", "0"), ("PYTHONCOERCECLOCALE", "0")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("PYTHONIOENCODING", raising=False)
    assert "lanelib: 道.jsonl: needed" in n08.command("lanelib evaluate 道.jsonl 路.jsonl", tmp_path).text
