"""The pictures of a write-up, each in a folder named by notebook and step: `02_mask/test1.jpg`.

What a notebook shows for one example of the shipped set is made here for every board, picture and clip of any set.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lanelib import draw, figures, stages
from lanelib.calibration import Calibration
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, LaneResult
from lanelib.outputs import free_name, make_folder
from lanelib.pictures import read_image, write_image
from lanelib.scores import AT_20_M, FrameScore
from lanelib.timescores import hardest
from lanelib.video import read_frames

FOLDERS = {  # stage: notebook and step
    "undistorted": "01_undistorted",
    "mask": "02_mask",
    "evidence": "02_evidence",
    "birdseye": "03_birdseye",
    "birdseye_mask": "03_birdseye_mask",
    "windows": "04_windows",
    "fit": "04_fit",
    "diagnostic": "05_diagnostic",
}
BEFORE_AFTER, BOARDS = "01_before_after", "01_boards"
OVERLAY, OVER_TIME, HARDEST, ERRORS = "05_overlay", "05_over_time", "05_hardest", "06_errors"
MOMENTS, APART_S = 8, 0.5  # hardest moments of a clip; of two within half a second one is enough


def write_steps(frame: np.ndarray, result: LaneResult, finder: LaneFinder, folder: Path, stem: str) -> list[Path]:
    """One frame (H, W, 3) BGR with its lane as `folder/STEM.jpg`, and each stage of it in its own folder."""
    wrote = [write_image(folder / f"{stem}.jpg", draw.overlay(frame, result))]
    pictures = stages.stages(frame, finder, result)
    pictures["diagnostic"] = draw.diagnostic(frame, pictures, result)
    for stage, into in FOLDERS.items():
        wrote.append(write_image(_made(folder / into) / f"{stem}.jpg", pictures[stage]))
    return wrote


def write_before_after(paths: Sequence[Path], camera: Camera, folder: Path) -> None:
    """Pictures as given beside undistorted ones, where they can be read and have the camera's proportions."""
    taken: set[str] = set()
    for path in paths:
        try:
            frame = read_image(path)
            fitting = camera.scaled(frame.shape[1::-1])
        except LanelibError:
            continue
        both = np.hstack([frame, fitting.undistort(frame)])
        write_image(free_name(_made(folder / BEFORE_AFTER) / f"{path.stem}.jpg", taken), both)


def write_boards(paths: Sequence[Path], found: Calibration, folder: Path) -> None:
    """All boards that can be read with their corners, and the error of each."""
    pictures = map(_read_or_none, paths)
    into = _made(folder / BOARDS)
    figures.save(figures.boards(pictures, found.boards), into / "corners.jpg")
    figures.save(figures.board_errors(found.boards, rms_px=found.rms_px), into / "errors.png")


def _read_or_none(path: Path) -> np.ndarray | None:
    try:
        return read_image(path)
    except LanelibError:  # the calibration has said it
        return None


def write_clip(video: Path, rows: Sequence[dict], truth: Mapping[str, dict], fps: float, folder: Path) -> None:
    """Curvature, offset and confidence over time, and the hardest moments of an annotated `video`; ``rows`` as
    `--json` writes them, ``truth`` by `raw_file` (may be empty)."""
    timed = [row | {"time_s": i / fps} for i, row in enumerate(rows)]
    known = [truth[row["raw_file"]] | {"time_s": row["time_s"]} for row in timed if row["raw_file"] in truth]
    figure = figures.over_time(
        timed, known or None, quantities=("curvature_1pm", "offset_m", "confidence"), fps=fps, title=video.stem
    )
    figures.save(figure, _made(folder / OVER_TIME) / f"{video.stem}.png")
    worst = hardest([1 - row["confidence"] for row in rows], apart=round(APART_S * fps), count=MOMENTS)
    shown = {frame.index: frame.frame_bgr for frame in read_frames(video) if frame.index in worst}
    there = [i for i in sorted(worst) if i in shown]
    if there:
        sheet = figures.contact_sheet(
            [shown[i] for i in there],
            [f"{i / fps:.1f} s: confidence {rows[i]['confidence']:.2f}" for i in there],
            marks=[rows[i]["status"] for i in there],
        )
        figures.save(sheet, _made(folder / HARDEST) / f"{video.stem}.jpg")


def write_errors(frames: Sequence[FrameScore], folder: Path) -> None:
    """The worse line's error 20 m ahead of every picture with truth, in cm."""
    found = [frame for frame in frames if frame.claimed and frame.has_lane]
    errors = {frame.name: 100 * float(np.nanmax(np.abs(frame.lateral_m[:, AT_20_M]))) for frame in found}
    errors = {name: error for name, error in errors.items() if np.isfinite(error)}
    if errors:
        worst_first = dict(sorted(errors.items(), key=lambda item: -item[1]))
        figure = figures.bars(worst_first, unit="cm", title="error of the worse line 20 m ahead", digits=1, log=True)
        figures.save(figure, _made(folder / ERRORS) / "pictures.png")


def _made(folder: Path) -> Path:
    make_folder(folder)
    return folder
