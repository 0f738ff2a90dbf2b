"""What the explorers show in the browser tests, made alike in the notebook's kernel and in the tests' own process."""

from pathlib import Path

import numpy as np

from lanelib import LaneFinder, Rig
from lanelib.birdseye import BirdsEye
from lanelib.calibration import BoardView, Calibration, board_points
from lanelib.camera import Camera
from lanelib.explore import scene_of, simulated_rig
from lanelib.road import CarPose, Mounting, Road
from lanelib.simulator import Scene, render_road
from lanelib.video import VideoWriter

SIZE_WH = (1280, 720)
CAMERA = Camera([[1130.0, 0, 652.0], [0, 1126.0, 371.0], [0, 0, 1]], [-0.21, 0.02, 0.0008, -0.0004, 0.0], SIZE_WH)
MOUNTING = {"height_m": 1.31, "pitch_deg": 2.2, "yaw_deg": 0.6}
RIG = Rig(CAMERA, BirdsEye.from_mounting(CAMERA, **MOUNTING), "browser")
CLIP_FRAMES, DARK_FRAME = 24, 15


def frame_and_truth():
    """A gentle bend to the left, the car right of the centre: (frame_bgr, truth)."""
    mounting = Mounting(MOUNTING["height_m"], MOUNTING["pitch_deg"], yaw_deg=MOUNTING["yaw_deg"])
    scene = Scene(
        road=Road([0], [1 / 700]),
        pose=CarPose(3.0, 0.25, 0.004),
        mounting=mounting,
        size_wh=SIZE_WH,
        camera_matrix=tuple(map(tuple, CAMERA.camera_matrix.tolist())),
        distortion=tuple(CAMERA.distortion.tolist()),
    )
    return render_road(scene)


def drive():
    """Frames and truths of a short drive; one frame is nearly black."""
    states = [
        {"bend_1pkm": 1 + i / 24, "offset_m": 0.3 * np.cos(i / 20), "along_m": float(i)} for i in range(CLIP_FRAMES)
    ]
    states[DARK_FRAME]["light"] = 0.0005
    pairs = [render_road(scene_of(**state)) for state in states]
    return [frame for frame, _ in pairs], [truth for _, truth in pairs]


def results_of(frames):
    """Each frame on its own."""
    finder = LaneFinder(simulated_rig(), track=False)
    return [finder.process(frame) for frame in frames]


def write_clip(path: Path) -> Path:
    frames, _ = drive()
    with VideoWriter(path, size_wh=frames[0].shape[1::-1], fps=25) as writer:
        for frame in frames:
            writer.write(frame)
    return path


def calibration():
    """Three boards whose corners were found with a known error, one not found, and blank pictures of them."""
    camera = Camera(CAMERA.camera_matrix, CAMERA.distortion, SIZE_WH, 0.3)
    random = np.random.default_rng(4)
    points = board_points((9, 6)).astype(float)
    boards, pictures = [], []
    for i, (noise, tilt) in enumerate(((0.2, 0.3), (0.6, -0.4), (0.3, 0.2))):
        turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        seen = camera.project(points @ turn.T + (-4 + i, -2.5, 12)) + random.normal(0, noise, (54, 2))
        boards.append(BoardView(f"board{i + 1}.png", True, "", noise * 2**0.5, (9, 6), seen))
        pictures.append((f"board{i + 1}.png", np.full((720, 1280, 3), 90 + 40 * i, np.uint8)))
    boards.append(BoardView("board4.png", False, "no chessboard in view"))
    pictures.append(("board4.png", np.zeros((720, 1280, 3), np.uint8)))
    return Calibration(camera, tuple(boards), 0.55, True, board_points((9, 6))), pictures
