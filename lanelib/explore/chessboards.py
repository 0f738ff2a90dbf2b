"""Board browser: every picture of a calibration, its corners seen and projected, and the error of each board."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanelib import draw
from lanelib.calibration import BoardView, Calibration, board_points
from lanelib.channels import as_bgr
from lanelib.draw.lettering import shortened
from lanelib.draw.marks import line_in_place
from lanelib.errors import LanelibError
from lanelib.explore.detection import stacked
from lanelib.explore.kit import Explorer, button, choice, counter
from lanelib.explore.look import PANEL_WIDTH, Look, Reading
from lanelib.pictures import read_image

CHART_HEIGHT = 130  # px


def projected_corners(board: BoardView, calibration: Calibration) -> np.ndarray | None:
    """Where the calibrated camera shows the corners of a board in the pose that fits it best, (w * h, 2) px.

    None where no corners were found, or where the board is bent and not seen whole.
    """
    if board.corners_px is None or board.corners_wh is None:
        return None
    points = board_points(board.corners_wh) if calibration.flat else calibration.board_m
    seen, camera = np.asarray(board.corners_px, np.float64).reshape(-1, 1, 2), calibration.camera
    if len(points) != len(seen):
        return None
    points = np.asarray(points, np.float64)
    ok, rvec, tvec = cv2.solvePnP(points, seen, camera.camera_matrix, camera.distortion)
    if not ok:
        return None
    return cv2.projectPoints(points, rvec, tvec, camera.camera_matrix, camera.distortion)[0].reshape(-1, 2)


def board_look(calibration: Calibration, number: int, picture: np.ndarray, *, gain: float = 30) -> Look:
    """One board: its corners, the misses of the projected ones ``gain`` times enlarged, and all boards' errors."""
    boards = calibration.boards
    board = boards[number]
    frame = as_bgr(picture)
    size_wh = calibration.camera.size_wh
    if (frame.shape[1], frame.shape[0]) != size_wh:
        frame = cv2.resize(frame, size_wh, interpolation=cv2.INTER_AREA)
    plain, worst = frame, None
    projected = projected_corners(board, calibration)
    if board.corners_px is not None and board.corners_wh is not None:
        seen = np.asarray(board.corners_px, float).reshape(-1, 2)
        frame = draw.draw_corners(frame, seen, board.corners_wh)
        if projected is not None:
            off = projected - seen
            worst = float(np.hypot(*off.T).max())
            for here, arrow in zip(seen, off * gain, strict=True):
                ends, width_px = np.array([here, here + arrow]), max(2, size_wh[0] / 500)
                line_in_place(frame, ends, draw.bgr("text"), width_px, outline=True)
    panel_wh = (PANEL_WIDTH, round(PANEL_WIDTH * size_wh[1] / size_wh[0]))
    panels = [
        cv2.resize(p, panel_wh, interpolation=cv2.INTER_AREA) for p in (frame, calibration.camera.undistort(plain))
    ]
    shown = draw.side_by_side(
        panels, [f"corners; misses {gain:g} times enlarged", "undistorted"], height=panel_wh[1], cap_px=10
    )
    chart = _errors_chart(calibration, number, (shown.shape[1], CHART_HEIGHT))
    used = sum(b.used for b in boards)
    readings = (
        Reading("picture", board.name),
        Reading("used", "yes" if board.used else "no"),
        Reading("corners found", "–" if board.corners_wh is None else f"{board.corners_wh[0]} × {board.corners_wh[1]}"),
        Reading("rms of this board", board.rms_px, "px", 3),
        Reading("worst corner", worst, "px", 2),
        Reading("rms of all", calibration.rms_px, "px", 3),
        Reading("boards used", f"{used} of {len(boards)}"),
        *([Reading("remark", board.reason)] if board.reason else []),
    )
    return Look(stacked([shown, chart]), readings)


def _errors_chart(calibration: Calibration, number: int, size_wh: tuple[int, int]) -> np.ndarray:
    """A bar for every board, the chosen one orange; boards that were not used have none."""
    width, height = size_wh
    out = np.full((height, width, 3), draw.bgr("card"), np.uint8)
    errors = [b.rms_px if b.used and b.rms_px is not None else 0.0 for b in calibration.boards]
    top = 1.1 * max(max(errors), calibration.rms_px, 1e-9)
    left, base, room = 16, height - 24, height - 54
    step = (width - 32) / len(errors)
    for i, error in enumerate(errors):
        x0, x1 = left + i * step + 0.12 * step, left + (i + 0.88) * step
        y = base - room * error / top
        colour = draw.bgr("held" if i == number else "accent" if error else "rule")
        cv2.rectangle(out, (round(x0), round(min(y, base - 2))), (round(x1), base), colour, -1)
        name = Path(calibration.boards[i].name).stem
        digits = "".join(c for c in name if c.isdigit()) or name
        words, ink = shortened(digits, 9, max(step - 2, 9)), draw.bgr("text" if i == number else "label")
        draw.put_text(out, words, ((x0 + x1) / 2, base + 17), ink, cap_px=9, align="centre")
    y = base - room * calibration.rms_px / top
    line_in_place(out, [(left, y), (width - left, y)], draw.bgr("text"), 1, dashed=True)
    title = f"rms of each board, px; dashed: all together, {calibration.rms_px:.2f}"
    draw.put_text(out, title, (10, 18), draw.bgr("title"), cap_px=10)
    return out


def boards(calibration: Calibration, pictures) -> Explorer:
    """Browse the boards of a calibration. ``pictures``: as `calibrate` took them, a folder, paths or pairs (name,
    image); a picture is read when it is shown."""
    if isinstance(pictures, str | Path):
        pictures = [path for path in Path(pictures).iterdir() if path.is_file()]
    source = {p[0] if isinstance(p, tuple) else Path(p).name: p[1] if isinstance(p, tuple) else p for p in pictures}
    names = [board.name for board in calibration.boards]
    missing = [name for name in names if name not in source]
    if missing:
        raise LanelibError(f"boards: the pictures of the calibration are needed, {missing[0]!r} is not among them")

    @lru_cache(maxsize=4)
    def picture_of(name: str) -> np.ndarray:
        return source[name] if isinstance(source[name], np.ndarray) else read_image(source[name])

    def make(number, gain) -> Look:
        return board_look(calibration, number, picture_of(names[number]), gain=gain)

    controls = {
        "number": choice("picture", [(name, i) for i, name in enumerate(names)], 0),
        "gain": counter("enlarge misses", 30, 1, 100, tip="how many times the misses are drawn enlarged"),
    }
    errors = [board.rms_px if board.used and board.rms_px is not None else -1.0 for board in calibration.boards]

    def go(step: int):
        explorer.set(number=(controls["number"].value + step) % len(names))

    buttons = [
        button("Previous", lambda: go(-1), tip="the board before"),
        button("Next", lambda: go(1), tip="the next board"),
        button("Worst", lambda: explorer.set(number=int(np.argmax(errors))), tip="the board with the largest error"),
    ]
    explorer = Explorer(
        "Chessboards", make, controls, buttons=buttons, alt="chessboard with corners, errors of all boards"
    )
    return explorer
