"""Predictions against labels or truth: the scores of every frame, by tag and by clip, as tables."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.labels import read_labels, read_rows
from lanelib.scores import DISTANCES_M, FrameScore, MetricScore, PixelScore, frame_score, metric_score, pixel_score
from lanelib.timescores import ClipScore, clip_score, lag_s

__all__ = [
    "DISTANCES_M",
    "ClipScore",
    "Evaluation",
    "FrameScore",
    "MetricScore",
    "PixelScore",
    "clip_score",
    "evaluate",
    "fixed",
    "frame_score",
    "lag_s",
    "metric_score",
    "pixel_score",
    "read_labels",
    "read_rows",
    "score",
    "table",
]

PIXEL_HEAD = ["frames", "n", "TuSimple", "strict", "lanes", "seen", "mean px", "p95 px"]
METRIC_HEAD = ["found", "false", *(f"cm at {d:.0f} m" for d in DISTANCES_M), "offset cm", "width cm", "heading mrad",
               "bend %", "straight 1/km"]
CLIP_HEAD = ["clip", "frames", "jitter cm", "lag s", "reset s", "wrong for s"]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that `evaluate` found; prints as tables.

    `unpredicted`: how many labelled frames have no prediction; they count as missed.
    """

    frames: tuple[FrameScore, ...]
    pixels: PixelScore
    metric: bool
    unpredicted: int = 0

    def by_tag(self) -> dict[str, tuple[FrameScore, ...]]:
        """Frames by tag, "all" first."""
        tags = sorted({tag for frame in self.frames for tag in frame.tags})
        return {"all": self.frames} | {t: tuple(f for f in self.frames if t in f.tags) for t in tags}

    def clips(self) -> tuple[ClipScore, ...]:
        """Measures over time of every clip."""
        names = dict.fromkeys(frame.clip for frame in self.frames if frame.clip)
        return tuple(clip_score([f for f in self.frames if f.clip == name]) for name in names)

    def to_dict(self) -> dict:
        """Plain numbers for JSON; null where a number is not known."""
        tags = {
            tag: vars(pixel_score(frames)) | (vars(metric_score(frames)) if self.metric else {})
            for tag, frames in self.by_tag().items()
        }
        clips = [vars(clip) for clip in self.clips()]
        return _without_nan({"tags": tags, "clips": clips, "unpredicted": self.unpredicted})

    def __str__(self) -> str:
        """A table by tag, and one by clip where there are clips."""
        rows = [PIXEL_HEAD + METRIC_HEAD * self.metric]
        for tag, frames in self.by_tag().items():
            rows.append(_pixel_row(tag, pixel_score(frames), frames) + (_metric_row(frames) if self.metric else []))
        text = table(rows)
        if clips := self.clips():
            text += "\n\n" + table([CLIP_HEAD, *map(_clip_row, clips)])
        return text


def evaluate(labels: str | Path, predictions: str | Path) -> Evaluation:
    """Score a file of predictions ("-": standard input) against labels or a `truth.json`."""
    rows, camera = read_labels(labels)
    return score(rows, read_rows(predictions), camera)


def score(labels: Mapping[str, dict], predictions: Mapping[str, dict], camera: Camera | None = None) -> Evaluation:
    """Score rows against labels, both by `raw_file`; a frame that is not predicted is missed.

    Names match whole, else by the file's name alone where one label and one prediction have it.
    """
    if labels and all("rvec" in row for row in labels.values()):
        raise LanelibError("evaluate: needed labels of lanes, found the truth of chessboards; name another file")
    ours, theirs = _by_last_part(labels), _by_last_part(predictions)
    partners = {last: predictions[theirs[last]] for last in ours.keys() & theirs.keys()}
    found = [predictions.get(name) or partners.get(Path(name).name) for name in labels]
    if not any(found):
        raise LanelibError(
            f"evaluate: needed predictions for the labelled frames (such as {next(iter(labels), '')!r}), "
            f"found others (such as {next(iter(predictions), '')!r}); are these the same pictures?"
        )
    frames = tuple(frame_score(row, other, camera) for row, other in zip(labels.values(), found, strict=True))
    return Evaluation(frames, pixel_score(frames), camera is not None, found.count(None))


def _by_last_part(names: Iterable[str]) -> dict[str, str]:
    """Names by their last part, where no other ends in the same."""
    n = Counter(Path(name).name for name in names)
    return {Path(name).name: name for name in names if n[Path(name).name] == 1}


def table(rows: list[list[str]], *, left: tuple[int, ...] = (0,)) -> str:
    """Rows of texts as a Markdown table: the first row is its head; the columns `left` begin at the left.

    >>> print(table([["name", "n"], ["a", "10"]]))
    | name |  n |
    |------|---:|
    | a    | 10 |
    """
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    rule = "|".join("-" * (w + 1) + ("-" if i in left else ":") for i, w in enumerate(widths))
    lines = []
    for row in rows:
        cells = [t.ljust(w) if i in left else t.rjust(w) for i, (t, w) in enumerate(zip(row, widths, strict=True))]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([lines[0], f"|{rule}|", *lines[1:]])


def _pixel_row(tag: str, s: PixelScore, frames) -> list[str]:
    shares = [fixed(v, 3) for v in (s.tusimple, s.strict, s.lanes, s.seen)]
    return [tag, str(len(frames)), *shares, fixed(s.mean_px, 2), fixed(s.p95_px, 1)]


def _metric_row(frames) -> list[str]:
    s = metric_score(frames)
    metres = [_cm(v) for v in (*s.lateral_m, s.offset_m, s.width_m)]
    bends = [fixed(s.heading_rad * 1e3, 1), fixed(s.curvature * 100, 1), fixed(s.curvature_1pm * 1e3, 2)]
    return [fixed(s.found, 3), f"{s.false_lanes}/{s.empty}", *metres, *bends]


def _clip_row(s: ClipScore) -> list[str]:
    return [s.clip, str(s.frames), _cm(s.jitter_m), *(fixed(v, 2) for v in (s.lag_s, s.reset_s, s.wrong_s))]


def fixed(value: float, digits: int) -> str:
    """A number with so many decimals; "-" for NaN and infinity."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _cm(value_m: float) -> str:
    return fixed(value_m * 100, 1)


def _without_nan(value):
    if isinstance(value, dict):
        return {key: _without_nan(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
