"""One picture or one video, from file to file: read, find the lane, draw, write, and count what was found."""

import statistics
import time
from array import array
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from lanelib import draw, stages
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, LaneResult, Rig
from lanelib.outputs import refuse_same
from lanelib.pictures import write_image
from lanelib.pipeline import Summary, process_video
from lanelib.video import probe

STATUSES = ("measured", "held", "none")


@dataclass
class Tally:
    """What became of the frames of one picture folder or video; grows with `add`, by two numbers (16 bytes) a frame."""

    name: str
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(STATUSES, 0))
    confidences: array = field(default_factory=partial(array, "d"))  # a list would take 64 bytes a frame
    milliseconds: array = field(default_factory=partial(array, "d"))
    began_s: float = field(default_factory=time.perf_counter)

    def add(self, result: LaneResult) -> None:
        """Count one frame."""
        self.counts[result.status] += 1
        self.confidences.append(result.confidence)
        self.milliseconds.append(result.milliseconds)

    @property
    def frames(self) -> int:
        """How many frames were counted."""
        return len(self.confidences)

    def row(self) -> list[str]:
        """Name, frames, measured, held, none, median confidence, median ms to find a lane, seconds since it began."""
        both = ((self.confidences, 2), (self.milliseconds, 1))
        medians = [f"{statistics.median(values):.{digits}f}" if values else "-" for values, digits in both]
        seconds = time.perf_counter() - self.began_s
        return [self.name, str(self.frames), *(str(self.counts[s]) for s in STATUSES), *medians, f"{seconds:.1f}"]

    def __str__(self) -> str:
        """The lane's part of a summary in one line."""
        return "lane " + ", ".join(f"{name} {n}" for name, n in self.counts.items())


TALLY_HEAD = ["", "frames", "measured", "held", "none", "confidence", "ms a frame", "s in all"]


def write_pictures(
    frame: np.ndarray,
    result: LaneResult,
    finder: LaneFinder,
    out: Path,
    *,
    with_stages: bool = False,
    read: Collection[tuple[int, int]] = (),
) -> list[Path]:
    """Draw the result of one frame (H, W, 3) BGR to `out`; returns what was written.

    `with_stages`: also every intermediate picture beside it, numbered in the order of the pipeline. LanelibError,
    before anything is written, where one of them would replace a file that is `read` (`outputs.identities`).
    """
    pictures = {out: draw.overlay(frame, result)}
    if with_stages:
        views = stages.stages(frame, finder, result)
        views["diagnostic"] = draw.diagnostic(frame, views, result)
        for number, (name, picture) in enumerate(list(views.items())[1:], 1):  # the first is the frame itself
            pictures[out.with_name(f"{out.stem}_{number}_{name}.jpg")] = picture
    for path in pictures:
        refuse_same(path, read)
    return [write_image(path, picture) for path, picture in pictures.items()]


def run_video(
    path: Path,
    out: Path | None,
    rig: Rig,
    *,
    raw_file: str | None = None,
    recipe: str = "paint",
    neighbours: int = 0,
    view: str = "overlay",
    start_s: float = 0.0,
    end_s: float | None = None,
    preset: str = "veryfast",
    write_row: Callable[[dict], None] | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> tuple[Summary, Tally]:
    """The lane followed through one video, drawn to `out` (None: nowhere).

    `write_row` gets a row for each frame, whose `raw_file` is `NAME.mp4:000123`, counted from the beginning of the
    file; `raw_file`: in place of the name.
    """
    info, tally = probe(path), Tally(path.name)
    finder, size_wh = LaneFinder(rig, recipe=recipe, neighbours=neighbours, fps=info.fps), info.size_wh
    even = all(n % 2 == 0 for n in size_wh)
    planes = even and (view == "overlay" or out is None)  # as the file stores them: no colour conversion either way

    def step(frame: np.ndarray, index: int, time_s: float) -> np.ndarray | None:
        finder.tracker.tell_time(time_s)
        result = finder.process_yuv420(frame) if planes else finder.process(frame)
        tally.add(result)
        if write_row is not None:
            write_row(result.to_row(f"{raw_file or path.name}:{index:06d}"))
        if out is None:
            return None
        return draw.overlay_yuv420(frame, result) if planes else picture_of(view, frame, result, finder)

    only_road = planes and out is None and finder.order == "finder" and not neighbours
    pixel_format, first_row = "yuv420p" if planes else "bgr24", first_row_of(finder, size_wh) if only_road else 0
    summary = process_video(
        path, step, output=out, start_s=start_s, end_s=end_s, on_progress=on_progress, preset=preset,
        pixel_format=pixel_format, first_row=first_row)
    return summary, tally


def first_row_of(finder: LaneFinder, size_wh: tuple[int, int]) -> int:
    """The first row that the finder looks at in frames of this size; 0 where it cannot take them."""
    try:
        return finder.view(size_wh).first_row
    except LanelibError:
        return 0


def picture_of(view: str, frame: np.ndarray, result: LaneResult, finder: LaneFinder) -> np.ndarray:
    """The picture of one frame as `lanelib video --view` names it; the frame (H, W, 3) BGR may be drawn upon."""
    if view == "diagnostic":
        return stages.diagnostic(frame, finder, result)
    if view == "birdseye":
        return stages.birdseye(frame, finder, result)
    return draw.overlay_bgr(frame, result)


def describe(result: LaneResult) -> str:
    """A result in words, on one line."""
    if result.lane is None:
        return f"no lane: {result.reason}"
    lane = result.lane
    radius, offset_m = lane.radius_m, lane.offset_m
    side = "right" if offset_m > 0 else "left"
    bend = "straight"
    if np.isfinite(radius):
        bend = f"radius {radius:.0f} m to the {'left' if lane.curvature_1pm > 0 else 'right'}"
    return (
        f"{result.status}, {bend}, {abs(offset_m):.2f} m {side} of centre, lane {float(lane.width_m()):.2f} m wide, "
        f"confidence {result.confidence:.2f}"
    )
