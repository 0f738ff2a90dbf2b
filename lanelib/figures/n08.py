"""Figures of notebook 08: a chessboard to print, the road from above as different rigs believe it, a command."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from lanelib import draw
from lanelib.autorig import rig_at, vanishing_point
from lanelib.birdseye import BirdsEye, Grid
from lanelib.errors import LanelibError
from lanelib.figures.pictures import show
from lanelib.finder import LaneFinder
from lanelib.rig import Rig

PAPERS_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0), "Letter": (279.4, 215.9)}  # across; ISO 216, ANSI Y14.1
MM_PER_INCH = 25.4
MARGIN_MM = 8.0  # most printers leave 4-6 mm white
GREY = 110
PAGE_COLUMNS = 96  # of text in a notebook, seen on a code-hosting page


def board_page(
    corners_wh: tuple[int, int] = (9, 6), *, square_mm: float = 25.0, paper: str = "A4", dpi: int = 300
) -> np.ndarray:
    """A page (H, W) uint8 with a chessboard of ``corners_wh`` inner corners, and a ruler to check the printer.

    Raises LanelibError where the board with a white margin of half a square does not fit on the paper.
    """
    if paper not in PAPERS_MM:
        raise LanelibError(f"paper must be one of {', '.join(PAPERS_MM)}, found {paper!r}")
    paper_mm, per_mm = PAPERS_MM[paper], dpi / MM_PER_INCH
    squares = np.array(corners_wh) + 1
    room_mm = np.array(paper_mm) - 2 * MARGIN_MM - np.array([0, 10])  # 10 mm below for the ruler
    if (squares * square_mm > room_mm).any():
        largest = float(np.floor((room_mm / squares).min()))
        raise LanelibError(
            f"{squares[0]}x{squares[1]} squares of {square_mm:g} mm do not fit on {paper}; use at most {largest:g} mm"
        )
    width, height = (round(side * per_mm) for side in paper_mm)
    page = np.full((height, width), 255, np.uint8)
    left, top = (np.array(paper_mm) - [0, 10] - squares * square_mm) / 2
    edges = [np.round((start + square_mm * np.arange(n + 1)) * per_mm).astype(int)
             for start, n in ((left, squares[0]), (top, squares[1]))]
    for i in range(squares[1]):
        for j in range(squares[0]):
            if (i + j) % 2 == 0:
                page[edges[1][i] : edges[1][i + 1], edges[0][j] : edges[0][j + 1]] = 0
    _ruler(page, per_mm, round((paper_mm[1] - MARGIN_MM - 2) * per_mm), round(left * per_mm))
    text = f"100 mm    {corners_wh[0]}x{corners_wh[1]} inner corners, squares of {square_mm:g} mm; print at 100 %"
    at = (round((left + 104) * per_mm), round((paper_mm[1] - MARGIN_MM) * per_mm))
    draw.put_text(page, text, at, GREY, cap_px=2.6 * per_mm)
    return page


def _ruler(page: np.ndarray, per_mm: float, row: int, start: int) -> None:
    """100 mm with a mark every 10."""
    thick = max(1, round(0.3 * per_mm))
    page[row : row + thick, start : start + round(100 * per_mm)] = GREY
    for mark in range(0, 101, 10):
        column = start + round(mark * per_mm)
        page[row - round(2 * per_mm) : row + thick, column : column + thick] = GREY


def held_up(page: np.ndarray, size_wh: tuple[int, int], corners_px, *, blur_px: float = 0.0) -> np.ndarray:
    """A picture (H, W, 3) uint8 BGR of the page as a pinhole camera sees it with its corners at ``corners_px`` (4, 2),
    clockwise from the upper left; on a grey wall."""
    height, width = page.shape
    source = np.array([(0, 0), (width - 1, 0), (width - 1, height - 1), (0, height - 1)], np.float32)
    homography = cv2.getPerspectiveTransform(source, np.asarray(corners_px, np.float32))
    small = cv2.GaussianBlur(page, (0, 0), max(0.5, 0.4 * width / np.ptp(np.asarray(corners_px)[:, 0])))
    picture = np.full(size_wh[::-1], 150, np.uint8)
    cv2.warpPerspective(small, homography, size_wh, picture, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    if blur_px:
        picture = cv2.GaussianBlur(picture, (0, 0), blur_px)
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)


def mounted(rig: Rig, **mounting: float) -> Rig:
    """The rig's camera at another height_m, pitch_deg, yaw_deg or roll_deg; what is not named stays."""
    return replace(rig, birdseye=BirdsEye.from_mounting(rig.camera, **{**rig.mounting, **mounting}))


def with_focal_length(rig: Rig, factor: float) -> Rig:
    """The rig as it comes out when the focal length is taken ``factor`` times too long: the vanishing point is seen
    where it is, the lane has its width; only lengths along the road are wrong."""
    matrix = np.diag([factor, factor, 1.0]) @ rig.camera.camera_matrix
    matrix[:2, 2] = rig.camera.camera_matrix[:2, 2]
    return rig_at(replace(rig.camera, camera_matrix=matrix), vanishing_point(rig), rig.mounting["height_m"], rig.name)


def from_above(rig: Rig, frame_bgr: np.ndarray, *, size_wh: tuple[int, int] = (240, 420)) -> np.ndarray:
    """The road of a frame as this rig believes it, 12 m wide and 36 m long, with rulers and the lane it finds."""
    rig = rig.scaled(frame_bgr.shape[1::-1])
    grid = Grid.uniform(x_range_m=(-6, 6), y_range_m=(4, 40), size_wh=size_wh)
    picture = cv2.remap(frame_bgr, *rig.birdseye.table(rig.camera, grid), cv2.INTER_LINEAR)
    return draw.birdseye(picture, grid, lane=LaneFinder(rig, track=False).process(frame_bgr).lane)


def rigs_from_above(rigs: Mapping[str, Rig], frame_bgr: np.ndarray) -> Figure:
    """The same frame from above as each rig believes it: straight, parallel and as wide as it is, or not."""
    return show({name: from_above(rig, frame_bgr) for name, rig in rigs.items()}, columns=len(rigs))


def zoomed(frame_bgr: np.ndarray, share: float) -> np.ndarray:
    """The middle ``share`` of the frame, enlarged to the old size: a digital zoom, or a stabiliser's crop."""
    height, width = frame_bgr.shape[:2]
    w, h = round(width * share), round(height * share)
    x, y = (width - w) // 2, (height - h) // 2
    return cv2.resize(frame_bgr[y : y + h, x : x + w], (width, height), interpolation=cv2.INTER_CUBIC)


class Said:
    """What a command said, shown as in a terminal."""

    def __init__(self, words: str, text: str):
        self.words, self.text = words, text

    def __repr__(self) -> str:
        return f"$ {self.words}\n{self.text}"

    def _repr_markdown_(self) -> str:
        """Its tables as tables of the page, the rest as it stands."""
        parts = [["$ " + self.words]]
        for line in self.text.splitlines():
            if line.startswith("|") != parts[-1][-1].startswith("|"):
                parts.append([])
            parts[-1].append(line)
        return "\n\n".join("\n".join(part if part[0].startswith("|") else ["```text", *part, "```"]) for part in parts)

    @property
    def clauses(self) -> Said:
        """The same, each clause on a line of its own (what is in brackets stays together), none wider than a page."""
        lines = re.sub(r"; (?![^(]*\))", ";\n    ", self.text).splitlines()
        text = "\n".join(textwrap.fill(line, PAGE_COLUMNS, subsequent_indent=" " * 8) for line in lines)
        kept = re.sub(r"( -\S+) (?!-)", "\\1\0", self.words)  # an option and its value stay together
        words = textwrap.wrap(kept, PAGE_COLUMNS - 6, break_on_hyphens=False)
        return Said(" \\\n    ".join(words).replace("\0", " "), text)


def command(words: str, folder: Path, *, without: tuple[str, ...] = ()) -> Said:
    """Run ``lanelib …`` in a folder, as in a terminal. ``without``: lines with one of these texts are left out."""
    program, *arguments = words.split()
    assert program == "lanelib"
    in_utf8 = [sys.executable, "-X", "utf8", "-m", "lanelib", *arguments]  # a pipe on Windows knows few letters
    done = subprocess.run(in_utf8, cwd=folder, capture_output=True, encoding="utf-8", check=False)
    lines = (done.stdout + done.stderr).splitlines()
    return Said(words, "\n".join(line for line in lines if not any(part in line for part in without)))
