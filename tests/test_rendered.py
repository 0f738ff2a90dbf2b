"""The shipped pictures: their truth is true. Paint lies where the truth says, boards give the true camera back."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanelib.evaluate import metric_score, score
from lanelib.finder import LaneFinder, Rig
from lanelib.labels import read_labels
from lanelib.road import Mounting
from lanelib.video import probe, read_frames

ROOT = Path(__file__).resolve().parents[1]
BOARDS, STILLS = ROOT / "camera_cal" / "rendered", ROOT / "test_images" / "rendered"
CLIPS = ROOT / "test_videos" / "rendered"


def truth_of(folder):
    return json.loads((folder / "truth.json").read_text())


def camera_of(truth):
    return np.array(truth["camera"]["camera_matrix"]), np.array(truth["camera"]["distortion"])


@pytest.fixture(scope="module")
def corners():
    """{name: corners (54, 2)} of the shipped boards that OpenCV's classic finder finds."""
    found = {}
    for board in truth_of(BOARDS)["boards"]:
        grey = cv2.imread(str(BOARDS / board["raw_file"]), cv2.IMREAD_GRAYSCALE)
        assert grey.shape == (720, 1280)
        ok, c = cv2.findChessboardCorners(grey, tuple(board["board_wh"]))
        if ok:
            c = cv2.cornerSubPix(grey, np.float32(c).reshape(-1, 1, 2), (7, 7), (-1, -1), (3, 40, 1e-3))
            found[board["raw_file"]] = c.reshape(-1, 2)
    return found


def board_points(board):
    w, h = board["board_wh"]
    points = np.zeros((w * h, 3), np.float32)
    points[:, :2] = np.mgrid[0:w, 0:h].T.reshape(-1, 2) * board["square_m"]
    return points


def test_there_are_twenty_boards_and_four_cannot_be_used(corners):
    boards = truth_of(BOARDS)["boards"]
    assert [b["raw_file"] for b in boards] == [f"calibration{i}.jpg" for i in range(1, 21)]
    useless = {b["raw_file"] for b in boards if {"partial", "blurred"} & set(b["tags"])}
    assert len(useless) == 4
    assert set(corners) == {b["raw_file"] for b in boards} - useless


def test_corners_lie_where_the_truth_says(corners):
    truth = truth_of(BOARDS)
    k, distortion = camera_of(truth)
    for board in truth["boards"]:
        if board["raw_file"] not in corners:
            continue
        rvec, tvec = np.array(board["rvec"]), np.array(board["tvec"])
        expected = cv2.projectPoints(board_points(board), rvec, tvec, k, distortion)[0].reshape(-1, 2)
        got = corners[board["raw_file"]]
        miss = min((c - expected for c in (got, got[::-1])), key=lambda m: np.abs(m).max())  # read from either end
        assert np.linalg.norm(miss, axis=1).mean() < 0.2, board["raw_file"]
        assert np.abs(miss.mean(0)).max() < 0.15, board["raw_file"]  # half a pixel here would be a wrong convention


def test_calibration_gives_the_true_camera_back(corners):
    truth = truth_of(BOARDS)
    k_true, d_true = camera_of(truth)
    used = [b for b in truth["boards"] if b["raw_file"] in corners]
    points, pixels = [board_points(b) for b in used], [corners[b["raw_file"]] for b in used]
    rms, k, d, *_ = cv2.calibrateCamera(points, pixels, (1280, 720), None, None)
    assert rms < 0.3
    assert abs(k[0, 0] / k_true[0, 0] - 1) < 0.003 and abs(k[1, 1] / k_true[1, 1] - 1) < 0.003
    assert abs(k[0, 2] - k_true[0, 2]) < 3 and abs(k[1, 2] - k_true[1, 2]) < 3
    x, y = np.meshgrid(np.linspace(-0.68, 0.68, 81), np.linspace(-0.42, 0.42, 51))  # rays that fill the frame
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], -1)
    zero = np.zeros(3)
    there = [cv2.projectPoints(rays, zero, zero, a, b)[0].reshape(-1, 2) for a, b in ((k_true, d_true), (k, d))]
    inside = ((there[0] >= 0) & (there[0] <= [1279, 719])).all(1)
    assert (there[0][inside].min(0) < 25).all() and (there[0][inside].max(0) > [1254, 694]).all()
    there = [uv[inside] for uv in there]
    miss = np.linalg.norm(there[1] - there[0], axis=1)
    assert miss.mean() < 0.5 and miss.max() < 1.5


def test_the_rig_is_the_true_camera_and_road():
    rig, truth = json.loads((ROOT / "rigs" / "rendered.json").read_text()), truth_of(STILLS)
    assert rig["camera"] == truth["camera"] == truth_of(BOARDS)["camera"]
    k, d = camera_of(truth)
    frame = next(f for f in truth["frames"] if f["raw_file"] == "straight_lines1.jpg")
    np.testing.assert_allclose(rig["road_from_image"], Mounting(**frame["mounting"]).road_from_image(k), atol=1e-9)
    for line, plan in zip(frame["lanes"], frame["lanes_road_m"], strict=True):
        rows, x = np.array(frame["h_samples"], float), np.array(line)
        seen = x != -2
        flat = cv2.undistortPoints(np.stack([x, rows], -1)[seen].reshape(-1, 1, 2), k, d, P=k)
        road = cv2.perspectiveTransform(flat, np.array(rig["road_from_image"])).reshape(-1, 2)
        near = road[:, 1] < 60  # farther away a hundredth of a pixel, as the truth is rounded, is centimetres
        expected = np.interp(road[near, 1], np.array(plan)[:, 1], np.array(plan)[:, 0])
        assert near.sum() > 12
        np.testing.assert_allclose(road[near, 0], expected, atol=0.02)


@pytest.mark.parametrize("name", ["straight_lines1", "straight_lines2", "test1", "test2", "test3", "test6"])
def test_paint_lies_where_the_truth_says(name):
    """Centroid of what is brighter than the road about the lines, on rows where paint is visible: within 0.5 px."""
    truth = truth_of(STILLS)
    frame = next(f for f in truth["frames"] if f["raw_file"] == f"{name}.jpg")
    misses = paint_misses(cv2.imread(str(STILLS / frame["raw_file"])), frame)
    assert len(misses) > 15
    assert abs(np.median(misses)) < 0.5 and np.median(np.abs(misses)) < 0.75


def paint_misses(frame_bgr, frame):
    """Pixels from the true line to the centroid of the paint about it, a number for each row where paint is visible."""
    picture, misses = frame_bgr.max(-1).astype(float), []
    for line, visible in zip(frame["lanes"], frame["visible"], strict=True):
        for row, x, paint in zip(frame["h_samples"], line, visible, strict=True):
            if not paint or not 470 <= row <= 660:
                continue
            half = round(4 + (row - 420) * 0.14)
            c = round(x)
            if c - half < 0 or c + half >= 1280:
                continue
            strip, u = picture[row - 1:row + 2, c - half:c + half + 1].mean(0), np.arange(c - half, c + half + 1)
            dark, bright = np.percentile(strip, 25), strip.max()
            weight = np.clip(strip - dark - 0.5 * (bright - dark), 0, None)
            misses.append(weight @ u / weight.sum() - x)
    return misses


def test_every_still_has_its_truth_and_the_hard_ones_say_why():
    frames = {f["raw_file"]: f for f in truth_of(STILLS)["frames"]}
    for path in STILLS.glob("*.jpg"):
        frame = frames[path.name]
        assert cv2.imread(str(path)).shape == (720, 1280, 3) and frame["tags"]
        rows = len(frame["h_samples"])
        assert all(len(line) == rows for line in frame["lanes"] + frame["visible"])
        if "no lane" in frame["tags"]:
            assert frame["lanes"] == [] and frame["radius_m"] is None
        else:
            left, right = np.array(frame["lanes"])
            both = (left != -2) & (right != -2)
            assert both.sum() >= 10 and (right[both] > left[both]).all()
            assert 3.2 < frame["lane_width_m"] < 3.8 and abs(frame["offset_m"]) < 1.83
    assert set(frames) == {p.name for p in STILLS.glob("*.jpg")}


@pytest.mark.parametrize("name", ["project_video", "challenge_video", "harder_challenge_video"])
class TestClip:
    def test_each_frame_has_its_truth(self, name):
        frames = {k: f for k, f in read_labels(CLIPS)[0].items() if k.startswith(f"{name}.mp4:")}
        info = probe(CLIPS / f"{name}.mp4")
        assert info.size_wh == (1280, 720) and info.fps == 25.0
        assert list(frames) == [f"{name}.mp4:{i:06d}" for i in range(len(frames))] and len(frames) >= 200
        assert info.duration_s == pytest.approx(len(frames) / 25, abs=0.05)
        assert [f["time_s"] for f in frames.values()] == pytest.approx(np.arange(len(frames)) / 25, abs=1e-3)

    def test_the_car_moves_as_the_truth_says(self, name):
        """Sideways speed over the ground is forward speed times heading: offset and heading tell the same story."""
        frames = [f for k, f in read_labels(CLIPS)[0].items() if k.startswith(f"{name}.mp4:")]
        offset, time_s = np.array([f["offset_m"] for f in frames]), np.array([f["time_s"] for f in frames])
        heading = [
            np.mean([np.diff(np.interp([-2.0, 2.0], *np.array(line).T[::-1])) / 4 for line in f["lanes_road_m"]])
            for f in frames
        ]
        speed = {"project_video": 28.0, "challenge_video": 27.0, "harder_challenge_video": 14.0}[name]
        sideways = np.gradient(offset, time_s)[2:-2]
        np.testing.assert_allclose(sideways, -speed * np.array(heading)[2:-2], atol=0.06)
        assert np.abs(np.diff(offset)).max() < 0.05  # a car, not a slide

    def test_paint_lies_where_the_truth_says(self, name):
        truth = read_labels(CLIPS)[0]
        misses = []
        for frame in read_frames(CLIPS / f"{name}.mp4"):
            if frame.index % 25 == 12:
                known = truth[f"{name}.mp4:{frame.index:06d}"]
                if name == "harder_challenge_video":  # its left line is the right stripe of a double one
                    known = known | {key: known[key][1:] for key in ("lanes", "visible")}
                misses += paint_misses(frame.frame_bgr, known)
        assert len(misses) > 100
        assert abs(np.median(misses)) < 0.5 and np.median(np.abs(misses)) < 1.0

    def test_the_tracker_keeps_the_lane(self, name):
        """Centimetres, per cent, tenths of a second. Measured values are far better (README, results); these bounds are
        what must never break. In the forest the road's lines go on behind trees and round the next bend, where nobody
        sees them (pixels, 30 m), and the road tightens all the time (curvature and offset at the car, which lies before
        all that is seen)."""
        forest = name == "harder_challenge_video"
        pixels, far_m, offset_m, bend = (0.85, 0.4, 0.1, 0.5) if forest else (0.98, 0.1, 0.03, 0.1)
        labels, camera = read_labels(CLIPS)
        finder, rows = LaneFinder(Rig.load(ROOT / "rigs" / "rendered.json")), {}
        for frame in read_frames(CLIPS / f"{name}.mp4", end_s=11.0):
            key = f"{name}.mp4:{frame.index:06d}"
            rows[key] = finder.process(frame.frame_bgr).to_row(key)
        found = score({key: labels[key] for key in rows}, rows, camera)
        metric, clip = metric_score(found.frames), found.clips()[0]
        assert found.pixels.tusimple > pixels and not any(f.wrong for f in found.frames)
        assert metric.offset_m < offset_m and metric.lateral_m[1] < 0.03 and metric.lateral_m[3] < far_m
        assert metric.curvature < bend
        assert clip.jitter_m < 0.01 and not clip.lag_s > 0.2
