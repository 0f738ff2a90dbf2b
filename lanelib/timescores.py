"""How a lane behaves over time: jitter, lag, reset, how long a wrong one stays, and its hardest moments."""

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lanelib.errors import LanelibError
from lanelib.scores import AT_10_M, AT_20_M, NAN, FrameScore


@dataclass(frozen=True)
class ClipScore:
    """Behaviour over time; NaN where nothing can be said.

    `jitter_m`: root mean square of the change of the centre's error at 10 m from frame to frame; `lag_s`: the delay at
    which predicted and true centre at 20 m agree best; `reset_s`: the longest time from where a lane begins to the
    first right one; `wrong_s`: the longest time on a wrong one.
    """

    clip: str
    frames: int
    jitter_m: float
    lag_s: float
    reset_s: float
    wrong_s: float


def clip_score(frames: Iterable[FrameScore]) -> ClipScore:
    """Jitter, lag, reset time and time on a wrong lane of one clip's frames (with `time_s`)."""
    frames = sorted(frames, key=lambda f: f.time_s if math.isfinite(f.time_s) else 0.0)
    if not frames:
        raise LanelibError("clip_score: needed frames of a clip, found none")
    time_s = np.array([f.time_s for f in frames])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frame with neither line has no mean: NaN is right
        centre = np.array([np.nanmean(f.lateral_m, axis=0) for f in frames])
    steps = np.diff(centre[:, AT_10_M])
    steps = steps[np.isfinite(steps)]
    truth = np.array([f.centre_m[AT_20_M] for f in frames])
    return ClipScore(
        clip=frames[0].clip,
        frames=len(frames),
        jitter_m=float(np.sqrt(np.mean(steps**2))) if len(steps) else NAN,
        lag_s=lag_s(time_s, truth, truth + centre[:, AT_20_M]),
        reset_s=_reset_s(frames, time_s),
        wrong_s=_longest_s([f.wrong for f in frames], time_s),
    )


def lag_s(
    time_s: np.ndarray, truth: np.ndarray, found: np.ndarray, *, longest_s: float = 1.0, moving: float = 0.05
) -> float:
    """The delay (s) by which `found` (N,) follows `truth` (N,): where found(t) - truth(t - delay) varies least.

    Delays of -0.2 .. `longest_s` in steps of 10 ms are tried. NaN for fewer than 25 common samples, and where the truth
    moves (standard deviation) by less than `moving`: then any delay fits.
    """
    known = np.isfinite(time_s) & np.isfinite(truth)
    if known.sum() < 25 or np.std(truth[known]) < moving:
        return NAN
    delays = np.arange(-0.2, longest_s + 0.005, 0.01)
    inside = np.isfinite(found) & (time_s > time_s[known][0] + longest_s) & (time_s < time_s[known][-1] - 0.2)
    if inside.sum() < 25:
        return NAN
    spread = [np.std(found[inside] - np.interp(time_s[inside] - d, time_s[known], truth[known])) for d in delays]
    return float(round(delays[int(np.argmin(spread))], 2))


def hardest(badness: Sequence[float], *, apart: int, count: int | None = None) -> list[int]:
    """Indices of the ``count`` worst frames (default: all that are), worst first, no two within ``apart`` frames.

    >>> hardest([1, 5, 4, 0, 3], apart=1)
    [1, 4]
    """
    chosen: list[int] = []
    for i in np.argsort(-np.asarray(badness), kind="stable").tolist():
        if all(abs(i - j) > apart for j in chosen):
            chosen.append(i)
    return chosen[:count]


def _reset_s(frames: list[FrameScore], time_s: np.ndarray) -> float:
    """The longest time from where a lane (or the clip) begins to the first right one."""
    waits, begin = [], None
    for i, frame in enumerate(frames):
        if not frame.has_lane:
            begin = None
        elif begin is None and (i == 0 or not frames[i - 1].has_lane):
            begin = time_s[i]
        if begin is not None and frame.claimed and not frame.wrong:
            waits.append(time_s[i] - begin)
            begin = None
    if begin is not None:
        waits.append(time_s[-1] - begin)
    return float(max(waits, default=NAN))


def _longest_s(flags: list[bool], time_s: np.ndarray) -> float:
    """The longest time for which the flag stays, each frame counting until the next one."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    longest = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        longest = max(longest, run)
    return longest * step
