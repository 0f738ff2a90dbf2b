"""Video scrubber: any frame of a clip at any stage of the pipeline; play it, jump to its worst frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import ipywidgets as W
import numpy as np

from lanelib import draw
from lanelib.errors import LanelibError
from lanelib.explore.chart import Curve, line_chart
from lanelib.explore.detection import lane_readings, stacked
from lanelib.explore.kit import Explorer, button, choice, counter
from lanelib.explore.look import WIDTH_PX, Look, Reading
from lanelib.explore.player import Player
from lanelib.finder import LaneFinder
from lanelib.result import LaneResult
from lanelib.rig import Rig
from lanelib.scores import frame_score
from lanelib.stages import NAMES, diagnostic, stages
from lanelib.timescores import hardest
from lanelib.video import read_frames

STAGES = ("lane", "diagnostic", *(name for name in NAMES if name != "lane"))
LONGEST_S = 12.0  # of a clip, where nothing is said: 300 frames are 45 MB as JPEG and take some 5 s to look through
NEIGHBOURS = 12  # frames around a bad one that do not count as another bad moment: half a second


@dataclass(eq=False)
class Clip:
    """Frames of a video, looked at once in order: pictures as JPEG (a video cannot be entered anywhere within 100 ms),
    times and results; where there is truth, that of each frame."""

    finder: LaneFinder
    pictures: list[bytes]
    times_s: list[float]
    results: list[LaneResult]
    truths: list[Mapping | None]

    def __len__(self) -> int:
        return len(self.pictures)

    def frame(self, number: int) -> np.ndarray:
        """The picture of a frame, (H, W, 3) uint8 BGR."""
        picture = cv2.imdecode(np.frombuffer(self.pictures[number], np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return picture

    @cached_property
    def badness(self) -> np.ndarray:
        """How bad each frame is, (N,): its mean error in px of a 1280-wide frame (at most 100, so much as a missed lane
        counts) where truth is known, else 100 (1 - confidence), at least 50 where the lane is held from before."""
        return np.array([badness_of(*both, self._camera) for both in zip(self.results, self.truths, strict=True)])

    @property
    def _camera(self):
        return self.finder.rig.camera

    @cached_property
    def worst(self) -> list[int]:
        """Frames from the worst on, no two within the same half second."""
        return hardest(self.badness.tolist(), apart=NEIGHBOURS)


def badness_of(result: LaneResult, truth: Mapping | None, camera) -> float:
    """See `Clip.badness`."""
    if not truth:
        doubt = 100 * (1 - result.confidence)
        return 50 + doubt / 2 if result.status == "held" else doubt
    score = frame_score(
        truth, result.to_row("frame") if result else None, camera.scaled(result.size_wh) if result else None
    )
    if not score.has_lane or not score.claimed:
        return 100.0 * (score.has_lane != score.claimed)
    return float(np.mean(np.minimum(np.nan_to_num(np.concatenate(score.errors_px), nan=100.0), 100.0)))


def look_through(
    path: str | Path,
    rig: Rig,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    truth: Mapping[str, dict] | None = None,
    **finder,
) -> Clip:
    """Find the lane in a section of a video, in order, with tracking.

    ``truth``: of `truth.load_truth`; ``finder``: the options of `LaneFinder`.
    """
    made = LaneFinder(rig, **finder)
    end_s = start_s + LONGEST_S if end_s is None else end_s
    clip = Clip(made, [], [], [], [])
    name = Path(path).name
    with read_frames(path, start_s=start_s, end_s=end_s) as frames:
        for frame in frames:
            jpeg = cv2.imencode(".jpg", frame.frame_bgr, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
            clip.pictures.append(jpeg)
            clip.times_s.append(frame.time_s)
            clip.results.append(made.process(frame.frame_bgr))
            clip.truths.append((truth or {}).get(f"{name}:{frame.index:06d}"))
    if not clip.pictures:
        raise LanelibError(
            f"{path}: needed frames between {start_s:g} and {end_s:g} s, found none; choose another section"
        )
    return clip


def scrub_look(clip: Clip, number: int, stage: str = "lane") -> Look:
    """One frame of the clip at one stage, above the clip's course of badness; what was found in that frame."""
    frame, result, truth = clip.frame(number), clip.results[number], clip.truths[number]
    if stage == "lane":
        picture = draw.overlay(frame, result)
    elif stage == "frame":
        picture = frame
    elif stage == "diagnostic":
        picture = diagnostic(frame, clip.finder, result)
    else:
        picture = stages(frame, clip.finder, result)[stage]
    size_wh = (WIDTH_PX, round(WIDTH_PX * frame.shape[0] / frame.shape[1]))
    picture = draw.fitted(picture, size_wh)
    times = np.asarray(clip.times_s)
    title = "error, px (missed: 100)" if any(clip.truths) else "doubt, %: 100 - confidence (held: at least 50)"
    curve = Curve("worse is higher", times, clip.badness, "held")
    top, now_s = max(10.0, float(clip.badness.max()) * 1.05), float(times[number])
    chart = line_chart([curve], (WIDTH_PX, 96), title=title, x_unit="s", y_range=(0, top), cursor=now_s)
    readings = [
        Reading("frame", number, digits=0),
        Reading("time", clip.times_s[number], "s", 2),
        *lane_readings(result, truth),
        Reading("confidence", 100 * result.confidence, "%", 0),
        Reading("error" if truth else "doubt", float(clip.badness[number]), "px" if truth else "%", 1),
    ]
    return Look(stacked([picture, chart]), tuple(readings))


def scrub(
    path: str | Path,
    rig: Rig,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    truth: Mapping[str, dict] | None = None,
    **finder,
) -> Explorer:
    """Scrub through a section of a video (default: its first `LONGEST_S` seconds), which is looked through first.

    ``truth``: of `truth.load_truth` of the video's folder; ``finder``: the options of `LaneFinder`.
    """
    return scrub_clip(look_through(path, rig, start_s=start_s, end_s=end_s, truth=truth, **finder))


def scrub_clip(clip: Clip, *, stages_offered: Sequence[str] = STAGES) -> Explorer:
    """`scrub` of a clip that was looked through already."""
    last = len(clip) - 1
    number = counter("frame", 0, 0, max(last, 1))
    number.max = last
    number.layout.flex, number.layout.max_width = "1 1 100%", "100%"
    player = Player(last=last, layout=W.Layout(width="auto", flex="0 0 auto"))
    W.jslink((player, "value"), (number, "value"))
    visited = [-1]

    def jump(step: int):
        visited[0] = (visited[0] + step) % len(clip.worst)
        number.value = clip.worst[visited[0]]

    def make(**state) -> Look:
        return scrub_look(clip, **state)

    buttons = [
        player,
        button("Back", lambda: explorer.set(number=max(0, number.value - 1)), tip="one frame back"),
        button("On", lambda: explorer.set(number=min(last, number.value + 1)), tip="one frame on"),
        button("Next worst", lambda: jump(1), tip="the worst moment of the clip, then the next one"),
    ]
    controls = {"number": number, "stage": choice("stage", tuple(stages_offered), stages_offered[0])}
    explorer = Explorer(
        "Video scrubber", make, controls, buttons=buttons, alt="a frame of the clip, and the clip's course"
    )
    number.observe(lambda change: player.set_trait("answered", change["new"]), "value")  # after the explorer's answer
    return explorer
