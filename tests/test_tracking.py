"""tracking.py: hold and forget, hand over, smooth: on fits of known truth, and through the finder on known roads."""

from dataclasses import replace

import numpy as np
import pytest
from roads import SIZE_WH, Lane7, joined, points_on_grid, points_on_lane, rig

from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder
from lanelib.jointfit import (
    BEND,
    CENTRE,
    HEADING,
    HILL,
    PITCH,
    UNKNOWN_ROAD,
    WIDTH,
    confidence_of,
    differ,
    energy_of,
    fit,
    line_x,
)
from lanelib.rig import View
from lanelib.tracking import (
    ALPHA,
    DRIFTS,
    HOLD_FRAMES,
    LEAST_PACE,
    MOST_PACE,
    SMOOTHING,
    STEP_STD,
    LaneTracker,
    handed_over,
)

LANE = Lane7(centre=0.2, heading=0.01, bend=-1 / 800, width=3.6)
BLANK = np.zeros((SIZE_WH[1], SIZE_WH[0], 3), np.uint8)


def fitted(lane):
    return fit(points_on_lane(lane, y_m=np.linspace(35, 6, 60)), lane.mean)


LANE_FIT = fitted(LANE)


class PointsFinder(LaneFinder):
    """A finder that is handed paint points instead of pictures: everything after the evidence is the real thing."""

    def see(self, *lanes, rng=None, px=1.0, drop=0.0, gaps=None):
        """Process a frame in which these lanes' lines (none: nothing) are painted."""
        view = self.view(SIZE_WH)
        kwargs = {"height_m": view.height_m, "focal_px": view.focal_px, "rng": rng, "px": px, "drop": drop}
        seen = [points_on_grid(lane, view.grid, gaps=gaps, **kwargs) for lane in lanes]
        nothing = points_on_lane(LANE, sides=(), y_m=view.grid.y_m, height_m=view.height_m, focal_px=view.focal_px)
        self.now = joined(nothing, *seen)
        return self.process(BLANK)

    def points(self, frame, view):
        black = np.zeros((len(view.grid.y_m), len(view.grid.x_m)), np.uint8)
        return self.now, (black, black)


RIG = rig()


def finder(**kwargs):
    return PointsFinder(RIG, **kwargs)


# ---------------------------------------------------------------------------------------------- hold and forget
def test_time_passes_as_fast_at_any_rate():
    """What is forgotten, learned and believed to change in a second is the same whatever the number of frames."""
    fit = fitted(LANE)
    for fps in (6.25, 12.5, 25.0, 50.0, 100.0):
        tracker = LaneTracker(fps=fps)
        tracker.update(fit)
        wanders = np.diag(tracker.predict().covariance - fit.covariance)[[CENTRE, BEND]] * fps
        np.testing.assert_allclose(wanders, 25 * STEP_STD[[CENTRE, BEND]] ** 2, rtol=0.15)
        assert tracker._drifts[CENTRE] ** fps == pytest.approx(DRIFTS[CENTRE] ** 25)
        assert (1 - tracker._alpha[CENTRE]) ** fps == pytest.approx((1 - ALPHA[CENTRE]) ** 25)
        assert sum(tracker.update(None, "fog").status == "held" for _ in range(200)) == pytest.approx(
            0.48 * fps, abs=0.51
        )
        tracker.update(fit)
        sure = [tracker.decide_to_search(replace(fit, rms_px=1.0), lost=False) for _ in range(300)]
        assert np.diff(np.flatnonzero(sure)) == pytest.approx(fps, abs=1)
        lane = View(rig()).lane(fit)
        before = tracker.road.travelled_m
        for _ in range(round(4 * fps)):
            tracker.at_car(lane, measured=True)
        assert tracker.road.travelled_m - before == pytest.approx(4 * np.sqrt(2 * 400), rel=0.02)  # R 400 m
    assert LaneTracker(fps=1e9).pace == LEAST_PACE and LaneTracker(fps=1e-3).pace == MOST_PACE
    for none in (0, -25, np.nan, np.inf):
        with pytest.raises(LanelibError, match="above 0 frames a second"):
            LaneTracker(fps=none)


def test_a_car_that_weaves_is_followed_better_by_who_knows_the_rate():
    """Half a metre to either side in four seconds, seen 6 times a second."""
    off = {}
    for told in (25.0, 6.25):
        tracker, errors = LaneTracker(fps=told), []
        for k in range(60):
            truth = replace(LANE, centre=0.5 * np.sin(2 * np.pi * k / 6.25 / 4))
            prior = tracker.predict()
            p = points_on_lane(truth)
            tracker.update(fit(p, truth.mean, prior=tracker.fit_prior(prior) if prior else UNKNOWN_ROAD))
            errors.append(tracker.shown.mean[CENTRE] - truth.centre)
        off[told] = np.sqrt(np.mean(np.square(errors[20:])))
    assert off[6.25] < 0.5 * off[25.0]


def test_the_rate_is_measured_where_it_is_not_what_was_said():
    tracker = LaneTracker(fps=30)
    for i in range(60):
        tracker.tell_time(i / 30 + 0.001 * (i % 2))
    assert tracker.fps == 30  # rounded times are no other rate
    for i in range(60):
        tracker.tell_time(2 + i / 10)
    assert tracker.fps == pytest.approx(10) and tracker.hold_frames == 5
    for _ in range(60):
        tracker.tell_time(8.0)  # a clock that stands still says nothing
    assert tracker.fps == pytest.approx(10, rel=0.5)


@pytest.mark.parametrize("number, jump", [(CENTRE, 0.2), (HEADING, 0.03), (BEND, 5e-3), (WIDTH, 0.3)])
def test_a_jump_is_shown_at_once_and_noise_is_calmed(number, jump):
    """Whatever jumps, a swerving car or a bump, no line is shown more than 1.3 mrad (1.5 px of 1280) beside the line of
    the frame's own fit; a tenth of that is noise, of which less than a half is shown."""
    one = np.eye(7)[number]
    tracker = LaneTracker()
    for mean in (LANE_FIT.mean, LANE_FIT.mean, LANE_FIT.mean + jump * one):
        tracker.predict()
        tracker.update(replace(LANE_FIT, mean=mean))
    y, sides = np.array([[6.0], [10.0], [20.0]]), np.array([-1, 1])
    beside = lambda a, b: np.abs((line_x(y, a, sides) - line_x(y, b, sides)) / y).max()  # noqa: E731
    assert 0.0005 < beside(tracker.shown.mean, mean) < 0.0014
    rng, tracker, shown, seen = np.random.default_rng(3), LaneTracker(), [], []
    unit = 0.00013 / beside(LANE_FIT.mean, LANE_FIT.mean + 1e-4 * one) * 1e-4
    for _ in range(200):
        tracker.predict()
        seen.append(LANE_FIT.mean + rng.normal(0, unit) * one)
        tracker.update(replace(LANE_FIT, mean=seen[-1]))
        shown.append(tracker.shown.mean)
    assert np.std(np.diff(shown, axis=0)) < np.std(np.diff(seen, axis=0)) / 2


def test_after_a_gap_the_lane_is_shown_as_it_is_seen():
    """The car moved by 10 cm while nothing was seen: what is shown does not creep there from the held lane."""
    tracker, moved = LaneTracker(), replace(LANE_FIT, mean=LANE_FIT.mean + 0.1 * np.eye(7)[CENTRE])
    for fit_or_none in (LANE_FIT, LANE_FIT, None, None, None, moved):
        tracker.predict()
        tracker.update(fit_or_none)
    assert tracker.shown.mean[CENTRE] == moved.mean[CENTRE]
    tracker.predict()
    tracker.update(replace(moved, mean=moved.mean - 0.005 * np.eye(7)[CENTRE]))  # a little noise is calmed again
    assert abs(tracker.shown.mean[CENTRE] - moved.mean[CENTRE]) < 0.003


def test_the_rate_may_change_and_nothing_is_forgotten():
    tracker = LaneTracker()
    tracker.update(fitted(LANE))
    known = tracker.fit
    tracker.set_fps(10)
    assert tracker.fit is known and tracker.fps == 10 and tracker.hold_frames == 5
    assert LaneTracker(hold_frames=7, fps=10).hold_frames == 7


@pytest.mark.parametrize("fps, frames", [(1, 1), (2, 1), (3, 1), (30, 14), (60, 29), (1000, 480)])
def test_a_lane_is_held_for_half_a_second_at_any_rate(fps, frames):
    assert LaneTracker(fps=fps).hold_frames == frames


@pytest.mark.parametrize("hold_frames", [0, 3, HOLD_FRAMES])
def test_a_lane_is_held_for_so_long_and_then_forgotten(hold_frames):
    tracker = LaneTracker(hold_frames=hold_frames)
    assert tracker.update(None, "nothing yet").status == "none"
    tracker.update(fitted(LANE))
    events = [tracker.update(None, "fog") for _ in range(hold_frames + 3)]
    assert [e.status for e in events] == ["held"] * hold_frames + ["none"] * 3
    assert [e.missed for e in events[:hold_frames]] == list(range(1, hold_frames + 1))
    assert all(e.reason == "fog" for e in events)
    assert all(e.missed == 0 for e in events[hold_frames:]) and tracker.missed == 0  # of a lane that is held
    assert tracker.fit is None and tracker.predict() is None


def test_while_held_the_lane_stays_and_its_uncertainty_grows():
    tracker = LaneTracker()
    tracker.update(fitted(LANE))
    before, spread = tracker.fit.mean.copy(), [np.diag(tracker.fit.covariance)]
    for _ in range(5):
        tracker.update(None, "")
        spread.append(np.diag(tracker.fit.covariance))
    np.testing.assert_allclose(tracker.fit.mean[:PITCH], before[:PITCH])
    assert (np.diff(spread, axis=0)[:, [CENTRE, HEADING, BEND, WIDTH, PITCH]] > 0).all()
    assert tracker.update(fitted(LANE)).status == "measured" and tracker.missed == 0


def test_while_held_the_pitch_returns_to_the_usual_one():
    """Nobody saw whether the car still nods, or the hill goes on; where the lane is was seen."""
    lane = replace(LANE, pitch=0.012, hill=1e-4)
    tracker, held = LaneTracker(), []
    tracker.update(fitted(lane))
    tracker.fit = replace(tracker.fit, mean=lane.mean.copy())
    for _ in range(6):
        held.append(np.abs(tracker.fit.mean - tracker.background.mean))
        tracker.update(None, "")
    assert (np.diff(held, axis=0)[:, [PITCH, HILL]] < 0).all()


def test_the_prediction_ends_in_knowing_nothing():
    tracker = LaneTracker(hold_frames=10**6)
    tracker.update(fitted(replace(LANE, centre=0.6, pitch=0.01)))
    for _ in range(30000):
        prior = tracker.predict()
        tracker.fit = replace(tracker.fit, mean=prior.mean, covariance=prior.covariance)
    unknown = tracker.background
    spread = np.diag(unknown.covariance)
    assert np.abs((prior.mean - unknown.mean) / np.sqrt(spread)).max() < 0.02
    keep = [CENTRE, HEADING, BEND, WIDTH, PITCH]
    np.testing.assert_allclose(np.diag(prior.covariance)[keep], spread[keep], rtol=0.02)


def test_one_frame_ahead_the_prediction_is_nearly_the_last_lane():
    tracker = LaneTracker()
    tracker.update(fitted(LANE))
    prior, last = tracker.predict(), tracker.fit
    at = np.array([0.0, 6, 15, 25])
    assert max(np.abs(line_x(at, prior.mean, s) - line_x(at, last.mean, s)).max() for s in (-1, 1)) < 0.06
    assert (np.diag(prior.covariance) >= 0.9 * np.diag(last.covariance)).all()
    assert (np.diag(prior.covariance) <= np.diag(UNKNOWN_ROAD.covariance) * 1.001).all()


def test_300_frames_of_nothing_then_a_lane():
    f = finder()
    assert f.see(LANE).status == "measured"
    statuses = [f.see().status for _ in range(300)]
    assert statuses == ["held"] * HOLD_FRAMES + ["none"] * (300 - HOLD_FRAMES)
    result = f.see(replace(LANE, centre=-0.7, bend=1 / 300))  # another road by now
    assert result.status == "measured" and result.offset_m == pytest.approx(0.7, abs=0.05)
    assert result.reason == ""


def test_reset_forgets_the_lane():
    tracker = LaneTracker(smoothing="average")
    for _ in range(4):
        tracker.update(fitted(LANE))
    tracker.reset()
    assert tracker.fit is None and tracker.predict() is None and True
    far = replace(LANE, centre=-0.8)
    tracker.update(fitted(far))
    assert tracker.fit.mean[CENTRE] == pytest.approx(-0.8, abs=0.01)  # no mean with what was before
    f = finder()
    f.see(LANE)
    f.reset()
    assert f.see().status == "none"


def test_a_fresh_tracker_is_of_the_same_make():
    """The finder's reset keeps what its tracker was told, whatever kind of tracker it is."""
    f = finder()
    f.tracker = LaneTracker(
        smoothing="exponential", hold_frames=3, n=2, alpha=0.9, step_std=2 * STEP_STD, fps=30
    )
    f.see(LANE)
    old = f.tracker
    f.reset()
    new = f.tracker
    assert new is not old and new.fit is None
    for of in ("smoothing", "hold_frames", "n", "alpha", "fps"):
        assert getattr(new, of) == getattr(old, of)
    np.testing.assert_array_equal(new.step_std, old.step_std)
    new.set_fps(10)
    assert new.hold_frames == 3 and new._history.maxlen == 1

    class Other(LaneTracker):
        """Another kind."""

    assert isinstance(Other().fresh(), Other) and LaneTracker().fresh().hold_frames == HOLD_FRAMES


def test_a_held_lane_is_trusted_less_from_frame_to_frame():
    f = finder()
    f.see(LANE)
    for missed in range(1, HOLD_FRAMES + 1):
        result = f.see()
        trust = 1 - missed / (HOLD_FRAMES + 1)
        assert result.confidence == pytest.approx(confidence_of(result.fit) * trust)
        assert confidence_of(result.fit) > 0.3


# ---------------------------------------------------------------------------------------------- other lanes
def neighbours(lane):
    """The lane, the one to its left and the one to its right."""
    return [replace(lane, centre=lane.centre + i * lane.width) for i in (0, -1, 1)]


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_lane_change_hands_over_once(direction):
    """The car crosses into the next lane within 3 s: the ego lane changes once, not back, and within a second of the
    moment when the car's middle crosses the line."""
    f, rng = finder(), np.random.default_rng(7)
    t = np.arange(0, 200) / 25
    shift = 3.6 / (1 + np.exp(-(t - 4) / 0.4))  # of the car, to the new lane
    speed = np.gradient(shift, t) / 28  # heading against the lane at 28 m/s
    offsets = []
    for moved, heading in zip(direction * shift, direction * speed, strict=True):
        result = f.see(*neighbours(Lane7(-moved, -heading, 0, 0, 3.6)), rng=rng, drop=0.3)
        assert result.status == "measured"
        offsets.append(result.offset_m * direction)
    offsets = np.array(offsets)
    own = np.rint((shift - offsets) / 3.6)  # which lane each frame speaks of: 0 the first, 1 the second
    assert set(own) == {0, 1} and (np.diff(own) >= 0).all()
    crossed, handed = int(np.argmax(shift > 1.8)), int(np.argmax(own == 1))
    assert 0 <= handed - crossed <= 25
    assert np.abs(shift - 3.6 * own - offsets).max() < 0.15  # at 2.25 m/s sideways: 0.07 s


def test_driving_on_the_line_does_not_flicker():
    """0.15 m to and fro around the line, and scattered by 2 px: the same lane all the time."""
    f, rng, lanes = finder(), np.random.default_rng(3), []
    for i in range(150):
        moved = 1.3 + min(i, 50) / 100 + 0.15 * np.sin(i / 5) * (i > 50)
        result = f.see(*neighbours(Lane7(-moved, 0, 0, 0, 3.6)), rng=rng, px=2.0, drop=0.3)
        lanes.append(round((moved - result.offset_m) / 3.6))
    assert np.count_nonzero(np.diff(lanes)) <= 1


def test_handed_over_moves_by_a_width_beyond_the_margin():
    here = fitted(replace(LANE, centre=0.0))
    for centre, moves in ((2.0, 0), (2.1, -1), (-2.0, 0), (-2.1, 1)):
        mean = here.mean.copy()
        mean[CENTRE], mean[WIDTH] = centre, 3.6
        after, handover = handed_over(replace(here, mean=mean))
        assert handover == (moves != 0)
        assert after.mean[CENTRE] == pytest.approx(centre + moves * 3.6)


@pytest.mark.parametrize("wrong", [Lane7(-0.9, 0, 0, 0, 3.3), Lane7(0.3, -0.09, 0, 0, 3.9)])
def test_a_wrong_lane_is_not_held(wrong):
    """The first frames show something else (old markings of a works site); when only the true lane is there, it takes
    over within half a second, and a clear one within a second although some of the old paint is still to be seen."""
    for remains in (0.0, 0.3):
        f, rng, truth = finder(), np.random.default_rng(5), Lane7(0.5, 0.02, -1 / 700, 0, 3.7)
        for _ in range(20):
            assert f.see(wrong, rng=rng, drop=0.2)
        results = []
        for _ in range(40):
            view = f.view(SIZE_WH)
            kwargs = {"height_m": view.height_m, "focal_px": view.focal_px, "rng": rng, "px": 1.0}
            old = points_on_grid(wrong, view.grid, drop=1 - remains, **kwargs)
            f.now = joined(points_on_grid(truth, view.grid, drop=0.1, **kwargs), old)
            results.append(f.process(BLANK))
        right = [bool(r) and abs(r.offset_m + 0.5) < 0.15 and abs(r.width_m - 3.7) < 0.2 for r in results]
        assert all(right[25 if remains else 13 :]), right


def test_a_sure_lane_is_checked_once_a_second_and_one_less_sure_more_often():
    sure = fitted(LANE)
    for rms_px, every in ((1.0, 25), (3.0, 10)):
        fit, tracker = replace(sure, rms_px=rms_px), LaneTracker()
        tracker.update(fit)
        checked = np.flatnonzero([tracker.decide_to_search(fit, lost=False) for _ in range(80)])
        assert len(checked) >= 3 and set(np.diff(checked)) == {every}


def test_another_lane_must_be_worth_more_than_the_same_one_put_right():
    old = fitted(LANE)
    worth = energy_of(old.mean, old.support, UNKNOWN_ROAD)
    same = replace(old, mean=old.mean + 0.01 * (np.arange(7) == PITCH))
    other = replace(old, mean=old.mean - 0.6 * (np.arange(7) == CENTRE), support=old.support * 1.01)
    assert not differ(same.mean, old.mean) and differ(other.mean, old.mean)
    for more, taken in ((2.5, (False, False)), (4.0, (True, False)), (5.5, (True, True))):
        for rival, takes in zip((same, other), taken, strict=True):
            tracker = LaneTracker()
            outcome = [tracker.challenge(old, replace(rival, energy=worth + more), lost=False) for _ in range(2)]
            assert outcome == [False, takes]


def test_another_lane_must_have_more_paint_whatever_speaks_against_the_old_one():
    """In a hairpin the lane has a heading and a pitch that no road is expected to have; one whose numbers are usual,
    but on which less paint lies, is not therefore the better one."""
    old = fitted(LANE)
    worth = energy_of(old.mean, old.support, UNKNOWN_ROAD)
    for share, takes in ((0.97, False), (1.03, True)):
        other = replace(
            old, mean=old.mean - 0.6 * (np.arange(7) == CENTRE), support=old.support * share, energy=worth + 20
        )
        tracker = LaneTracker()
        assert [tracker.challenge(old, other, lost=False) for _ in range(2)] == [False, takes]
        assert [LaneTracker().challenge(old, other, lost=True)] == [False]
        same = replace(other, mean=old.mean)
        tracker = LaneTracker()
        assert [tracker.challenge(old, same, lost=False) for _ in range(2)] == [False, True]


def test_a_rival_must_win_twice_and_then_the_old_lane_is_forgotten():
    tracker, old = LaneTracker(smoothing="average"), fitted(LANE)
    rival = fitted(replace(LANE, centre=-0.6))
    weak = replace(old, support=old.support * 0.05)
    tracker.update(old)
    assert not tracker.challenge(weak, rival, lost=False) and tracker.fit is not None
    assert not tracker.challenge(weak, None, lost=False)  # a frame without it in between: it must begin again
    assert not tracker.challenge(weak, rival, lost=False)
    road = tracker.road
    assert tracker.challenge(weak, rival, lost=False) and tracker.fit is None
    assert tracker.road is road  # another lane, the same road
    tracker.update(rival)
    assert tracker.fit.mean[CENTRE] == pytest.approx(-0.6, abs=0.01)  # no mean with the lane that was left
    # the same lane again is no rival, nor is one that has less paint
    assert not any(tracker.challenge(rival, rival, lost=False) for _ in range(3))
    assert not any(tracker.challenge(rival, replace(old, energy=0.0), lost=False) for _ in range(3))


# ---------------------------------------------------------------------------------------------- smoothing
AT_M = np.array([0.0, 10.0, 20.0])


def drive(smoothing, seed=0, n=240):
    """A road that swings from left to right, a car that weaves and nods, a dashed line on the right; four of
    five points are missing, the others scattered by 2.5 px.

    Estimated and true x of the lane's centre at AT_M, (n, 3) each."""
    f, rng, found, true = finder(smoothing=smoothing), np.random.default_rng(seed), [], []
    for i in range(n):
        t = i / 25
        pitch = np.radians(0.1 * np.sin(2 * np.pi * 1.3 * t))
        lane = Lane7(
            0.3 * np.sin(2 * np.pi * t / 6),
            0.012 * np.cos(2 * np.pi * t / 6),
            np.sin(2 * np.pi * t / 7) / 700,
            0.0,
            3.65,
            pitch,
        )
        result = f.see(lane, rng=rng, px=2.5, drop=0.8, gaps={1: (3.66, 14.63, -28 * t % 14.63)})
        assert result.status == "measured"
        found.append((result.lane.left.x(AT_M) + result.lane.right.x(AT_M)) / 2)
        true.append(lane.x(AT_M, 0))
    return np.array(found), np.array(true)


def jitter(found, true):
    """Root mean square of the error's change from frame to frame, at each of AT_M."""
    return np.sqrt(np.mean(np.diff(found - true, axis=0) ** 2, axis=0))


def lag_frames(found, true):
    """The delay in frames at which the estimate at 20 m follows the truth best."""
    delays = range(15)
    misfit = [np.mean((found[15:, 2] - true[15 - d : len(true) - d, 2]) ** 2) for d in delays]
    return delays[int(np.argmin(misfit))]


@pytest.fixture(scope="module")
def drives():
    return {smoothing: drive(smoothing) for smoothing in SMOOTHING}


def test_the_filter_is_calmer_than_none_and_hardly_late(drives):
    """Less jitter, less error, and a lag of 0.16 s at most (the issue asks for 0.2 s)."""
    found, true = drives["kalman"]
    single, _ = drives["none"]
    assert (jitter(found, true) < [0.6 * jitter(single, true)[0], *(0.95 * jitter(single, true)[1:])]).all()
    error, error_single = (np.abs(x - true)[10:].mean(axis=0) for x in (found, single))
    assert error[0] < 0.85 * error_single[0] and (error < 1.05 * error_single).all()
    assert error.max() < 0.03 and np.abs(found - true)[10:].max() < 0.2
    assert lag_frames(found, true) <= 4


@pytest.mark.parametrize("smoothing", ["average", "exponential"])
def test_the_classic_smoothers_are_calm_and_late(drives, smoothing):
    """What notebook 05 shows: their jitter is well below that of none, and they pay for it in lag and error."""
    found, true = drives[smoothing]
    single, _ = drives["none"]
    assert (jitter(found, true) < 0.7 * jitter(single, true)).all()
    assert 1 <= lag_frames(found, true) <= 6 and lag_frames(single, true) == 0
    kalman = np.abs(drives["kalman"][0] - true)[10:].mean(axis=0)
    assert (np.abs(found - true)[10:].mean(axis=0) > 1.5 * kalman).all()


def test_average_weighs_by_each_fits_variance():
    tracker = LaneTracker(smoothing="average", n=3)
    fits = [fitted(replace(LANE, centre=c)) for c in (0.0, 0.3)]
    sure = replace(fits[0], covariance=fits[0].covariance / 9)
    tracker.update(sure)
    tracker.update(replace(fits[1], covariance=fits[0].covariance))
    assert tracker.fit.mean[CENTRE] == pytest.approx(0.1 * fits[1].mean[CENTRE] + 0.9 * fits[0].mean[CENTRE], abs=1e-6)
    for _ in range(2):  # the third frame after the first is the first without it
        tracker.update(fits[1])
    assert tracker.fit.mean[CENTRE] == pytest.approx(fits[1].mean[CENTRE], abs=1e-6)


def test_average_of_one_is_the_frame():
    tracker = LaneTracker(smoothing="average", n=1)
    for centre in (0.0, 0.3, -0.2):
        fit = fitted(replace(LANE, centre=centre))
        tracker.update(fit)
        assert tracker.fit.mean[CENTRE] == pytest.approx(fit.mean[CENTRE], abs=1e-12)


def test_exponential_closes_a_share_of_the_gap():
    tracker = LaneTracker(smoothing="exponential", alpha=0.25)
    fits = [fitted(replace(LANE, centre=c)) for c in (0.0, 0.4)]
    tracker.update(fits[0])
    gaps = []
    for _ in range(6):
        tracker.update(fits[1])
        gaps.append(fits[1].mean[CENTRE] - tracker.fit.mean[CENTRE])
    np.testing.assert_allclose(np.array(gaps[1:]) / gaps[:-1], 0.75, rtol=1e-6)


def test_only_the_filter_fits_under_its_prediction():
    for smoothing in SMOOTHING:
        tracker = LaneTracker(smoothing=smoothing)
        tracker.update(fitted(replace(LANE, centre=0.7)))
        prior = tracker.fit_prior(tracker.predict())
        expected = tracker.predict() if smoothing == "kalman" else tracker.background
        np.testing.assert_allclose(prior.mean, expected.mean)
        np.testing.assert_allclose(prior.covariance, expected.covariance)


def test_the_pitch_of_a_drive_is_learned():
    """A load in the boot: 0.8 degrees, seen in every frame of 10 s; a new search starts from there."""
    tracker = LaneTracker()
    for _ in range(250):
        tracker.update(fitted(replace(LANE, pitch=np.radians(0.8))))
    assert np.degrees(tracker.background.mean[PITCH]) == pytest.approx(0.8, abs=0.1)
    tracker.reset()
    assert np.degrees(tracker.background.mean[PITCH]) == pytest.approx(0.8, abs=0.1)
    assert LaneTracker().background.mean[PITCH] == 0


def test_the_width_of_the_lanes_of_a_drive_is_learned_quickly():
    """Narrow lanes, seen in 50 frames: a wide stripe of something else is then an unlikely lane."""
    tracker = LaneTracker()
    for _ in range(50):
        tracker.update(fitted(replace(LANE, width=3.0)))
    assert tracker.background.mean[WIDTH] == pytest.approx(3.0, abs=0.1)
    wide, narrow = (fitted(replace(LANE, width=w)) for w in (4.1, 3.1))
    worth = [energy_of(f.mean, f.support, tracker.background) for f in (narrow, wide)]
    assert worth[0] > worth[1] + 5
    assert LaneTracker().background.mean[WIDTH] == UNKNOWN_ROAD.mean[WIDTH]


def steady_change(tracker, steps, n=40):
    """``n`` frames of a lane whose numbers change by ``steps`` (7,) a frame, each fit half way between what was
    predicted and what is there; the last truth."""
    begin = fitted(LANE)
    for i in range(n):
        true = begin.mean + i * steps
        prediction = tracker.predict()
        mean = true if prediction is None else (true + prediction.mean) / 2
        tracker.update(replace(begin, mean=mean))
    return true


def test_a_steady_change_is_predicted_and_shown_without_lag():
    """The car drifts by 2 cm a frame and the bend tightens: after a second the prediction is where the lane will be,
    less what is forgotten of the change: a tenth of what a filter without drift lags (a whole step)."""
    steps = np.array([0.02, 0.002, 2e-5, 0, 0, 0, 0])
    tracker = LaneTracker()
    true = steady_change(tracker, steps)
    lag = (true - tracker.shown.mean)[:3] / steps[:3]
    assert (np.abs(lag) < 1.0).all()
    ahead = (true + steps - tracker.predict().mean)[:3] / steps[:3]
    assert (np.abs(ahead) < 1.0).all()


def test_what_is_shown_trembles_less_than_the_fits():
    """White noise of 1 cm on the centre: the change from frame to frame falls to less than 0.6 of it; pitch, which
    bumps change without warning, is shown as seen."""
    rng, tracker, begin = np.random.default_rng(1), LaneTracker(), fitted(LANE)
    seen, shown = [], []
    for _ in range(300):
        noise = np.zeros(7)
        noise[[CENTRE, PITCH]] = rng.normal(0, 0.01), rng.normal(0, 0.004)
        tracker.predict()
        tracker.update(replace(begin, mean=begin.mean + noise))
        seen.append(tracker.fit.mean)
        shown.append(tracker.shown.mean)
    seen, shown = np.array(seen)[20:], np.array(shown)[20:]
    # exponential smoothing by 0.5 leaves 0.41 of the change; following the drift adds to it
    assert np.diff(shown[:, CENTRE]).std() < 0.6 * np.diff(seen[:, CENTRE]).std()
    np.testing.assert_array_equal(shown[:, PITCH], seen[:, PITCH])


def test_a_jump_is_shown_at_once():
    tracker = LaneTracker()
    steady_change(tracker, np.zeros(7))
    tracker.update(fitted(replace(LANE, centre=LANE.centre + 0.6)))
    assert tracker.shown.mean[CENTRE] == pytest.approx(tracker.fit.mean[CENTRE], abs=1e-9)
    assert tracker.predict().mean[CENTRE] < tracker.fit.mean[CENTRE]  # no drift is left, only the pull to the middle


def test_the_other_smoothers_show_what_they_hold():
    for smoothing in SMOOTHING[:-1]:
        tracker = LaneTracker(smoothing=smoothing)
        steady_change(tracker, np.array([0.02, 0, 0, 0, 0, 0, 0]), n=10)
        assert tracker.shown is tracker.fit


def test_an_unknown_smoothing_is_refused():
    with pytest.raises(LanelibError, match="kalman.*'median'"):
        LaneTracker(smoothing="median")
