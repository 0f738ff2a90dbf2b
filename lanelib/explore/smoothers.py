"""Smoothing explorer: a recorded clip smoothed again in four ways; error, jitter and lag against truth, live."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lanelib.draw import SMOOTHER_COLOURS
from lanelib.errors import LanelibError
from lanelib.evaluate import lag_s
from lanelib.explore.chart import Curve, line_chart
from lanelib.explore.kit import Explorer, choice, counter, slider
from lanelib.explore.look import WIDTH_PX, Look, Reading
from lanelib.jointfit import CENTRE, RATE, UNKNOWN_ROAD, JointFit, Prior, line_x, rate_std
from lanelib.tracking import HOLD_FRAMES, SMOOTHING, STEP_STD, LaneTracker

FPS = 25.0
AHEAD_M = (0.0, 10.0, 20.0, 30.0)


def fused(fit: JointFit, prediction: Prior) -> JointFit:
    """A frame's fit under the prediction of the frames before: the Kalman filter's update, in information form.

    The frame was fitted under the unknown road (mean b, covariance S), which must not count again:

        R^-1 = C^-1 - S^-1,   P^-1 = Pp^-1 + R^-1,   m = P (Pp^-1 mp + C^-1 c - S^-1 b)

    where c, C are the fit's mean and covariance and mp, Pp the prediction's.
    """
    unknown = np.diag(UNKNOWN_ROAD.covariance).copy()
    unknown[RATE] = min(unknown[RATE], rate_std(fit.mean) ** 2)  # as the fit itself believed
    frame, before = np.linalg.inv(fit.covariance), np.linalg.inv(prediction.covariance)
    covariance = np.linalg.inv(before + frame - np.diag(1 / unknown))
    mean = covariance @ (before @ prediction.mean + frame @ fit.mean - UNKNOWN_ROAD.mean / unknown)
    return replace(fit, mean=mean, covariance=covariance)


def smoothed(
    fits: Sequence[JointFit | None],
    *,
    smoothing: str = "kalman",
    n: int = 6,
    alpha: float = 0.3,
    step: float = 1.0,
    hold_frames: int = HOLD_FRAMES,
) -> tuple[list[np.ndarray | None], list[str]]:
    """The clip's fits (each frame on its own) through a `LaneTracker`: per frame the smoothed mean (7,) or None, and
    the status. ``step`` scales the Kalman filter's process noise: more follows faster and jitters more."""
    tracker = LaneTracker(smoothing=smoothing, n=n, alpha=alpha, step_std=step * STEP_STD, hold_frames=hold_frames)
    means, statuses = [], []
    for fit in fits:
        prediction = tracker.predict() if smoothing == "kalman" else None
        event = tracker.update(fit if fit is None or prediction is None else fused(fit, prediction))
        means.append(None if tracker.shown is None else tracker.shown.mean)
        statuses.append(event.status)
    return means, statuses


def centre_at(mean: np.ndarray | None, y_m: float) -> float:
    """x of the lane's centre at a distance, metres; NaN without a lane."""
    return math.nan if mean is None else float(line_x(y_m, mean, -1) + line_x(y_m, mean, 1)) / 2


def true_centre_at(truth: Mapping | None, y_m: float) -> float:
    """The same of a frame of the truth; NaN where there is none."""
    if not truth or len(truth.get("lanes_road_m", ())) != 2:
        return math.nan
    lines = (np.asarray(line, float).T for line in truth["lanes_road_m"])
    return float(np.mean([np.interp(y_m, y, x, left=np.nan, right=np.nan) for x, y in lines]))


def with_losses(fits: Sequence[JointFit | None], *, lost: int, noise_m: float, seed: int = 1) -> list[JointFit | None]:
    """The clip made harder: ``lost`` frames in a row missed every second, and the centre shaken by ``noise_m``
    (standard deviation). The fit's covariance grows by as much, for a measurement knows how bad it is."""
    random = np.random.default_rng(seed)
    harder: list[JointFit | None] = []
    for i, fit in enumerate(fits):
        shake = random.normal() * noise_m
        if fit is None or (lost and i % round(FPS) >= round(FPS) - lost):
            harder.append(None)
            continue
        mean, covariance = fit.mean.copy(), fit.covariance.copy()
        mean[CENTRE] += shake
        covariance[CENTRE, CENTRE] += noise_m**2
        harder.append(replace(fit, mean=mean, covariance=covariance))
    return harder


def smoothing_look(
    fits: Sequence[JointFit | None],
    truth: Sequence[Mapping | None] | None = None,
    *,
    ahead_m: float = 20.0,
    lost: int = 0,
    noise_m: float = 0.0,
    fps: float = FPS,
    **tracker,
) -> Look:
    """The lane's centre ``ahead_m`` ahead over the clip: true, of each frame alone, and smoothed; below, the errors.

    ``tracker``: the arguments of `smoothed`. Error: root mean square; jitter: that of the error's change from frame to
    frame; lag: the delay at which smoothed and true centre agree best (`evaluate.lag_s`).
    """
    fits = with_losses(fits, lost=lost, noise_m=noise_m)
    alone, colour = SMOOTHER_COLOURS["each frame alone"], SMOOTHER_COLOURS[tracker.get("smoothing", "kalman")]
    means, statuses = smoothed(fits, **tracker)
    time_s = np.arange(len(fits)) / fps
    raw = np.array([centre_at(None if fit is None else fit.mean, ahead_m) for fit in fits])
    found = np.array([centre_at(mean, ahead_m) for mean in means])
    true = np.array([true_centre_at(t, ahead_m) for t in truth]) if truth is not None else np.full(len(fits), np.nan)
    curves = [Curve("each frame alone", time_s, raw, alone, points=True), Curve("smoothed", time_s, found, colour)]
    if truth is not None:
        curves.insert(0, Curve("truth", time_s, true, "text", 1.5))
    held = np.array([status == "held" for status in statuses])
    starts = np.flatnonzero(held & ~np.r_[False, held[:-1]])
    ends = np.flatnonzero(held & ~np.r_[held[1:], False]) + 1
    shaded = np.column_stack([starts, ends]) / fps - 0.5 / fps
    title = f"centre of the lane {ahead_m:g} m ahead, m (orange: held)"
    charts = [line_chart(curves, (WIDTH_PX, 220), title=title, x_unit="s", shaded=shaded)]
    readings = []
    if truth is not None:
        errors = [
            Curve("each frame alone", time_s, 100 * (raw - true), alone, points=True),
            Curve("smoothed", time_s, 100 * (found - true), colour),
        ]
        largest = np.nanpercentile(np.abs(np.concatenate([raw - true, found - true, [0.01]])), 99) * 110
        charts.append(line_chart(errors, (WIDTH_PX, 150), title="error, cm", x_unit="s", y_range=(-largest, largest)))
        for name, x in (("", found), (", each frame alone", raw)):
            readings += [
                Reading(f"error{name}", 100 * _rms(x - true), "cm", 1),
                Reading(f"jitter{name}", 100 * _rms(np.diff(x - true)), "cm a frame", 2),
            ]
        readings.append(Reading("lag", lag_s(time_s, true, found), "s", 2))
    else:
        readings += [
            Reading("jitter", 100 * _rms(np.diff(found)), "cm a frame", 2),
            Reading("jitter, each frame alone", 100 * _rms(np.diff(raw)), "cm a frame", 2),
        ]
    readings += [
        Reading("frames held", statuses.count("held"), digits=0),
        Reading("frames without", statuses.count("none"), digits=0),
    ]
    return Look(np.vstack(charts), tuple(readings))


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def smoothing(results: Sequence, truth: Sequence[Mapping | None] | None = None, *, fps: float = FPS) -> Explorer:
    """Explore smoothing over a recorded clip.

    ``results``: one `LaneResult` (or `JointFit`, or None) a frame, found without tracking: ``LaneFinder(rig,
    track=False)``. ``truth``: the frames' entries of `truth.load_truth` in the same order. The Kalman filter here takes
    each frame's fit as it is; in `LaneFinder` the prediction also guides which paint is looked at.
    """
    fits = [getattr(result, "fit", result) for result in results]
    if not fits or not all(fit is None or isinstance(fit, JointFit) for fit in fits):
        raise LanelibError("smoothing: one LaneResult a frame is needed, found none; use LaneFinder(rig, track=False)")
    if truth is not None and len(truth) != len(fits):
        raise LanelibError(f"smoothing: one truth a result is needed, found {len(truth)} for {len(fits)}")
    truth = None if truth is None else list(truth)
    n = counter("n frames", 6, 1, 30, tip="of the weighted average")
    alpha = slider("alpha", 0.3, 0.02, 1, 0.02, tip="of exponential smoothing: 1 follows at once")
    step = slider("process noise", 1.0, 0.1, 5, 0.1, digits=1, tip="of the Kalman filter, times the usual one")

    def make(**state) -> Look:
        n.disabled, alpha.disabled = state["smoothing"] != "average", state["smoothing"] != "exponential"
        step.disabled = state["smoothing"] != "kalman"
        return smoothing_look(fits, truth, fps=fps, **state)

    controls = {
        "smoothing": choice("smoothing", SMOOTHING, "kalman"),
        "n": n,
        "alpha": alpha,
        "step": step,
        "hold_frames": counter("hold frames", HOLD_FRAMES, 0, 50, tip="frames for which a lost lane is held"),
        "lost": counter("lose frames", 0, 0, 20, tip="so many frames in a row every second"),
        "noise_m": slider("shake, m", 0.0, 0, 0.5, 0.01, tip="noise added to every measurement"),
        "ahead_m": choice("look at", [(f"{y:g} m ahead", y) for y in AHEAD_M], 20.0),
    }
    return Explorer("Smoothing explorer", make, controls, alt="lane centre over time: true, measured and smoothed")
