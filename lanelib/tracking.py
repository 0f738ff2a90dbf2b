"""The only state over time: what the last frames said about the lane, and what to do when a frame says nothing.

The state is the joint fit's seven numbers (see ``jointfit.NAMES``). Four ways of smoothing can be compared:

    none         each frame speaks for itself
    average      mean of the last n frames, each weighted with the inverse variance of its own fit
    exponential  s = s + alpha (measured - s)
    kalman       prediction with process noise, then the frame's fit under that prediction as prior (the default:
                 of the last three the least error, jitter and lag, as notebook 05 measures)

The Kalman filter predicts that centre, heading and bend go on changing as they did, at rates that an alpha-beta filter
knows; what is shown is that filter's lane, a little calmer than the fits themselves.

A missed frame is an event of its own (``update(None, reason)``): the last good lane is held for a bounded time, then
forgotten.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from lanelib.errors import LanelibError
from lanelib.jointfit import (
    CENTRE,
    PITCH,
    RATE,
    UNKNOWN_ROAD,
    WIDTH,
    JointFit,
    Prior,
    confidence_of,
    differ,
    energy_of,
    holds_car,
    rate_std,
)
from lanelib.lane import Lane
from lanelib.roadmemory import RoadMemory

FPS = 25.0  # every number of frames, and every share of a frame, below is for so many frames a second
MEASURED_FRAMES = 25  # by so many the rate is measured, again and again: less light or a busy computer change it ...
ANOTHER_RATE = 0.02  # ... and is another one when it differs by this share
LEAST_PACE, MOST_PACE = 0.1, 5.0  # the model takes rates above 250 and below 5 frames a second for these
# How far each number departs from its prediction: standard deviation of a step from frame to frame at 25 frames a
# second. Centre: 0.4 m/s sideways; heading: 0.09 radians a second; bend: from straight to R 50 m in a second; rate: by
# its memory, below; width: 0.2 m/s; pitch: 6 degrees a second over bumps. A third of these does as well,
# three times costs half a centimetre 20 m ahead on a motorway; a tenth and ten times double the error there and more
# (notebook 05).
STEP_STD = np.array([0.016, 0.0035, 4e-4, np.nan, 0.0075, 0.004, 6e-5])
# What is shown lies ALPHA of the way from where it was going to the new fit. How the lane changes from frame to frame
# is learned from each surprise by BETA of it, and forgotten within a second or two. (Alpha-beta filter: Brookner,
# Tracking and Kalman Filtering Made Easy, ch. 1.) Less of either is calmer on a straight road ...
ALPHA, BETA = np.array([0.2, 0.3, 0.4, 0.5, 0.3]), 0.2  # ALPHA of centre, heading, bend, rate, width
# ... and late where the car swerves or bounces: so no line is shown further beside the paint of this frame than a pixel
# or two, as a bearing at some distances
CALM_RAD = 0.0013
BEARINGS = np.array([[1 / y, 1, y, y * y, side / 2 / y] for y in (6.0, 10.0, 20.0) for side in (-1, 1)])
# Which numbers go on changing as they did. Bumps come without warning: pitch and hill are shown as seen.
DRIFTS = np.array([0.98, 0.95, 0.95, 0.0, 0.0, 0.0, 0.0])
LEARNED, LEARNING = [WIDTH, PITCH], 0.02  # of the drive: with a memory of 50 frames, quicker at its beginning
# Lanes of one drive differ less than those of all roads: this takes the place of the unknown road's spread of widths
DRIVE_COVARIANCE = UNKNOWN_ROAD.covariance.copy()
DRIVE_COVARIANCE[WIDTH, WIDTH] = 0.25**2
JUMPS = np.array([0.4, 0.07, 0.01, np.inf, 0.4, np.inf, np.inf])  # a larger surprise is another lane
# The share of the rate that stays from one frame to the next: with none of it, bends that tighten come late; with all
# of it, they overshoot.
RATE_MEMORY = 0.8
CLEAR_ROWS = 5.0  # with so many rows of paint on the weaker line the tracked lane is beyond doubt ...
# ... unless it has less paint than this share of the last second's: it may have left the prediction behind
FADING = 0.8
# A fresh search checks the lane after so many frames even without doubt: a guard rail's foot has paint enough to be
# followed. Above SURE once a second will do: no wrong lane of the Udacity clips came above a confidence of 0.8
CHECK_EVERY, CHECK_SURE_EVERY, SURE = 10, 25, 0.9
LOOK_AGAIN = 4  # in doubt, every fourth frame is searched afresh ...
# ... and what is found takes over when it is worth so much more, in two frames running: the same lane with a better
# pitch, or another lane, which on a followed road is the less likely
BETTER_ENERGY, OTHER_ENERGY = 3.0, 5.0
FIT_ADDS = 4.0  # a fit was worth at most 3.2 more than its start was estimated to be, in every check of every clip
LOOK_AT_WIDTH = 8  # whether a line is a double one is looked at in every eighth frame
HOLD_FRAMES = 12  # half a second at 25 frames a second: longer, and the car has left what was known
SMOOTHING = ("none", "average", "exponential", "kalman")


@dataclass(frozen=True)
class Event:
    """What one frame did to the tracker: ``status`` measured, held or none; ``missed``: for so many frames in a row the
    lane has been held (0 where there is none to hold); ``reason`` of a miss; ``handover``: the car has changed over to
    the lane beside."""

    status: str
    missed: int = 0
    reason: str = ""
    handover: bool = False


class LaneTracker:
    """Follows one lane from frame to frame.

    Use: ``prior = tracker.predict()``; fit the frame under it; ``event = tracker.update(fit)`` or
    ``tracker.update(None, "why")``; the smoothed lane is ``tracker.shown`` (None when there is none). ``tracker.fit``
    is what the next prediction starts from.

    ``smoothing``: one of `SMOOTHING`; ``n``: frames of the average; ``alpha``: of the exponential; ``step_std`` (7,):
    the process noise of a frame at 25 frames a second. ``fps``: frames a second; ``hold_frames``: for how many a lost
    lane is held, by default half a second's, but one at least. Raises LanelibError for an unknown smoothing, and for a
    rate not above 0.
    """

    def __init__(
        self,
        *,
        smoothing: str = "kalman",
        hold_frames: int | None = None,
        n: int = 6,
        alpha: float = 0.3,
        step_std: np.ndarray = STEP_STD,
        fps: float = FPS,
    ):
        if smoothing not in SMOOTHING:
            raise LanelibError(f"smoothing must be one of {', '.join(SMOOTHING)}, found {smoothing!r}")
        self.smoothing, self.n, self.alpha = smoothing, n, alpha
        self._hold_frames, self._step_std = hold_frames, np.asarray(step_std, float)
        self.set_fps(fps)
        self._times_s: list[float] = []
        self._history: deque[JointFit] = deque(maxlen=max(n - 1, 0))
        self._learned, self._lessons = UNKNOWN_ROAD.mean[LEARNED], 0
        self._frames = 0
        self.reset()

    def fresh(self) -> LaneTracker:
        """A tracker that was told the same and has seen nothing."""
        smoothing, hold, n, alpha = self.smoothing, self._hold_frames, self.n, self.alpha
        return type(self)(
            smoothing=smoothing, hold_frames=hold, n=n, alpha=alpha, step_std=self._step_std, fps=self.fps
        )

    def set_fps(self, fps: float) -> None:
        """From now on so many frames a second; what is known stays."""
        if not 0 < fps < np.inf:
            raise LanelibError(f"a tracker needs a rate above 0 frames a second, found {fps}")
        self.fps = fps
        self.pace = min(max(FPS / fps, LEAST_PACE), MOST_PACE)  # frames of the model in one of ours
        half_a_second = max(round(HOLD_FRAMES * fps / FPS), 1)  # of real time, whatever the model takes the rate for
        self.hold_frames = half_a_second if self._hold_frames is None else self._hold_frames
        self.step_std = self._step_std * np.sqrt(self.pace)
        self._drifts = DRIFTS**self.pace
        self._alpha, self._beta = 1 - (1 - ALPHA) ** self.pace, 1 - (1 - BETA) ** self.pace

    def tell_time(self, time_s: float) -> None:
        """When the next frame was taken, in seconds: where frames come at another rate than was said, or at changing
        ones, it is measured."""
        self._times_s.append(time_s)
        if len(self._times_s) > MEASURED_FRAMES:
            span_s = self._times_s[-1] - self._times_s[0]
            self._times_s = [time_s]
            if span_s > 0 and abs(MEASURED_FRAMES / span_s / self.fps - 1) > ANOTHER_RATE:
                self.set_fps(MEASURED_FRAMES / span_s)

    def reset(self) -> None:
        """Forget the lane (what was learned of the drive stays)."""
        self.fit: JointFit | None = None
        self.shown: JointFit | None = None
        self._drift = np.zeros(7)  # how the lane changes from frame to frame
        self._expected: np.ndarray | None = None  # the mean of the last prediction
        self.missed = 0  # frames in a row for which the lane has been held
        self.road = RoadMemory()
        self._history.clear()
        self._doubts, self._unchecked, self._usual_rows = 0, 0, 0.0
        self._rival: np.ndarray | None = None

    @property
    def background(self) -> Prior:
        """What is believed of a road of which nothing is known, on this drive: the car's load and a rig made on
        another day tilt the camera by a degree, and a road's lanes stay about as wide as they were; both are learned
        over some seconds."""
        mean = UNKNOWN_ROAD.mean.copy()
        mean[LEARNED] = self._learned
        return Prior(mean, DRIVE_COVARIANCE if self._lessons else UNKNOWN_ROAD.covariance)

    def predict(self) -> Prior | None:
        """Where the lane should be in the next frame; None when nothing is known.

        Each number is an Ornstein-Uhlenbeck process: it wanders by ``step_std`` a frame and is drawn back to the
        unknown road, m' = b + r (m - b), P' = r P r + (1 - r^2) S with r = sqrt(1 - step^2 / S), so that a long gap
        ends in knowing nothing rather than in nonsense.
        """
        if self.fit is None:
            return None
        base = self.background.mean
        spread = DRIVE_COVARIANCE.diagonal().copy()
        spread[RATE] = min(spread[RATE], rate_std(self.fit.mean) ** 2)
        r = np.sqrt(1 - np.fmin(self.step_std**2 / spread, 1))
        r[RATE] = RATE_MEMORY**self.pace
        covariance = self.fit.covariance * np.outer(r, r)
        covariance.flat[:: len(r) + 1] += (1 - r**2) * spread
        self._expected = mean = base + r * (self.fit.mean - base) + self._drift
        return Prior(mean, covariance)

    def fit_prior(self, prediction: Prior) -> Prior:
        """Under which prior to fit a frame: the prediction (kalman), or the unknown road (the other smoothers)."""
        return prediction if self.smoothing == "kalman" else self.background

    def update(self, fit: JointFit | None, reason: str = "") -> Event:
        """Take in a frame's fit, or that it had none."""
        if fit is None:
            self.missed += 1
            prediction = self.predict()
            if self.fit is None or prediction is None or self.missed > self.hold_frames:
                self.reset()
                return Event("none", 0, reason)
            held = self.fit.mean.copy()  # the lane stays where it was; only what no one saw (pitch, hill) relaxes
            held[PITCH:] = prediction.mean[PITCH:]
            self.fit = replace(self.fit, mean=held, covariance=prediction.covariance)
            self._show(self.fit, anew=True)
            return Event("held", self.missed, reason)
        again, self.missed = self.missed > 0, 0
        if self.fit is None:
            self._usual_rows = sum(fit.rows)
        smoothed = self._smooth(fit)
        if self.fit is not None and self.fit.inward_m != fit.inward_m:
            # a double line stays one while a frame is unsure of it
            left, right = (old + 0.4 * (new - old) for old, new in zip(self.fit.inward_m, fit.inward_m, strict=True))
            smoothed = replace(smoothed, inward_m=(left, right))
        self._lessons += 1
        self._learned += max(LEARNING * self.pace, 1 / (self._lessons + 2)) * (smoothed.mean[LEARNED] - self._learned)
        self.fit, handover = handed_over(smoothed)
        if handover:
            self._history.clear()
        self._history.append(self.fit if handover else fit)
        self._show(self.fit, anew=handover or again)  # after a gap there is nothing to be calm against
        return Event("measured", 0, "", handover)

    def at_car(self, lane: Lane, *, measured: bool) -> Lane:
        """The ``shown`` lane with what was seen of the road at the car when it lay ahead; once a frame. The classic
        smoothers stay what they are."""
        if self.smoothing != "kalman" or self.shown is None:
            return lane
        return self.road.update(lane, self.shown.mean, measured=measured, frame_s=self.pace / FPS)

    def recall_inward(self) -> tuple[float, float] | None:
        """How much further in a double line's boundary lies, as the last frames said; None when it is time to look
        again. Counts the frame: to be called once in each."""
        self._frames += 1
        return None if self.fit is None or self._frames % LOOK_AT_WIDTH == 0 else self.fit.inward_m

    def decide_to_search(self, fit: JointFit, *, lost: bool) -> bool:
        """Whether this frame is to be searched afresh beside the tracked ``fit`` (``lost``: it failed its tests).
        Keeps account of paint, doubts and checks: to be called once a frame."""
        rows = sum(fit.rows)
        fading = rows < FADING * self._usual_rows
        self._usual_rows += 0.1 * (rows - self._usual_rows)
        self._unchecked += 1
        if not lost and not fading and min(fit.rows) >= CLEAR_ROWS:
            self._doubts = 0
            look = self._unchecked * self.pace >= (CHECK_SURE_EVERY if confidence_of(fit) > SURE else CHECK_EVERY)
        else:
            self._doubts += 1
            look = self._doubts % LOOK_AGAIN == 1
        look = look or self._rival is not None
        if look:
            self._unchecked = 0
        return look

    def energy_needed(self, tracked: JointFit, *, other: bool = False) -> float:
        """What a lane must be worth to take over from the ``tracked`` one; ``other``: it is not the same lane."""
        more = OTHER_ENERGY if other else BETTER_ENERGY
        return energy_of(tracked.mean, tracked.support, self.background) - tracked.objection + more

    def start_needed(self, tracked: JointFit) -> float:
        """What a start must be estimated to be worth, so that its fit could take over."""
        return self.energy_needed(tracked) - FIT_ADDS

    def challenge(self, tracked: JointFit, fresh: JointFit | None, *, lost: bool) -> bool:
        """Let the lane of a fresh search challenge the tracked one. True where it explains the frame better, for the
        second time in succession: the old one is then forgotten (``reset``). It may be the same lane with the pitch
        right, or another one with more paint: where a road winds, what is usual elsewhere speaks against the lane that
        was followed, and must not decide alone."""
        rival = fresh
        if rival is not None and not lost:
            other = differ(rival.mean, tracked.mean)
            worth_more = rival.worth > self.energy_needed(tracked, other=other)
            if not worth_more or (other and sum(rival.rows) <= sum(tracked.rows)):
                rival = None
        confirmed = rival is not None and self._rival is not None and not differ(rival.mean, self._rival)
        self._rival = None if rival is None else rival.mean
        if confirmed:
            road = self.road  # another lane, the same road
            self.reset()
            self.road = road
        return confirmed

    def _show(self, fit: JointFit, *, anew: bool) -> None:
        """Learn from the surprise how the lane changes, and calm what is shown; ``anew`` where the lane is no
        continuation of the last one."""
        last, self.shown = self.shown, fit
        if not anew and self.smoothing == "kalman" and last is not None and self._expected is not None:
            surprise = fit.mean - self._expected
            if (np.abs(surprise) < JUMPS).all():
                self._drift = self._drifts * (self._drift + self._beta * surprise)
                calm = (1 - self._alpha) * (fit.mean - last.mean - self._drift)[:PITCH]
                seen = np.abs(BEARINGS @ calm).max()
                mean = fit.mean.copy()
                mean[:PITCH] -= calm * min(1.0, CALM_RAD / seen) if seen > 0 else 0.0
                self.shown = replace(fit, mean=mean)
                return
        self._drift = np.zeros(7)

    def _smooth(self, fit: JointFit) -> JointFit:
        if self.fit is None or self.smoothing in ("none", "kalman"):  # kalman: the prior was in the fit
            return fit
        if self.smoothing == "exponential":
            return replace(fit, mean=self.fit.mean + self.alpha * (fit.mean - self.fit.mean))
        fits = [*self._history, fit]
        weights = np.array([1 / np.diag(f.covariance) for f in fits])
        return replace(fit, mean=np.sum(weights * [f.mean for f in fits], axis=0) / weights.sum(axis=0))


def handed_over(fit: JointFit) -> tuple[JointFit, bool]:
    """On a lane change the ego lane becomes the neighbour: once the car's centre is ``jointfit.BESIDE_M`` beyond a
    line (so that driving on the line does not flicker), the lane moves over by its width."""
    if holds_car(fit.mean):
        return fit, False
    centre, width = fit.mean[CENTRE], fit.mean[WIDTH]
    mean = fit.mean.copy()
    mean[CENTRE] -= np.sign(centre) * width
    return replace(fit, mean=mean), True
