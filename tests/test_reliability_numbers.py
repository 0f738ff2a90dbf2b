"""What a finder must survive by its numbers: lines that cross, lanes at the border, jumps, frames of changing size.

The plainer cases stand with their modules: black, white, noise and no paint in test_finder.py, singular fits and A = 0
in test_lane.py, 300 frames of nothing, a lane change and a wrong lane in test_tracking.py.
"""

import json
import math

import numpy as np
import pytest
from roads import ASPHALT, Lane7, joined, paint_frame, points_on_grid, rig
from test_finder import all_finite, check_lines
from test_tracking import BLANK, SIZE_WH, finder

from lanelib.finder import LaneFinder
from lanelib.tracking import HOLD_FRAMES

SMALL = (640, 360)
RIG = rig(SMALL)
LANE = Lane7(centre=-0.3, heading=0.02, bend=-1 / 900, width=3.6)
ROAD = paint_frame(LANE, size_wh=SMALL, dashed=(1,))
ORDERS = [{}, {"order": "textbook"}, {"recipe": "clahe-colour-sobel"}, {"recipe": "sobel-or-colour"}]


def x_shaped(at_m: float) -> np.ndarray:
    """A lane whose lines cross `at_m` ahead of the car."""
    extra = [((lambda y, s=s: s * 1.8 * (1 - y / at_m)), 0.13, (205, 210, 208)) for s in (-1, 1)]
    return paint_frame(LANE, size_wh=SMALL, colours=(ASPHALT,) * 2, extra=extra)


def all_paint(kind: str) -> np.ndarray:
    """The whole road painted: evenly, in stripes along it (one every 0.3 m), or across it."""
    if kind == "even":
        return paint_frame(LANE, size_wh=SMALL, colours=((205, 210, 208),) * 2, paint_m=8.0)
    if kind == "along":
        extra = [((lambda y, x=x: 0 * y + x), 0.15, (205, 210, 208)) for x in np.arange(-9, 9, 0.3)]
        return paint_frame(LANE, size_wh=SMALL, extra=extra)
    frame = paint_frame(LANE, size_wh=SMALL)
    frame[180::8] = 205
    return frame


PICTURES = {f"lines cross at {m} m": x_shaped(m) for m in (6, 12, 25)}
PICTURES |= {f"paint everywhere, {kind}": all_paint(kind) for kind in ("even", "along", "across")}


@pytest.mark.parametrize("options", ORDERS, ids=lambda o: str(o) if o else "default")
@pytest.mark.parametrize("name", PICTURES)
def test_numbers_stay_numbers(name, options):
    """As the first frame, and again in the same tracker; then the true road is found, within a second."""
    tracked = LaneFinder(RIG, **options)
    for _ in range(3):
        all_finite(tracked.process(PICTURES[name]))
    for _ in range(1 if options else HOLD_FRAMES + 13):
        result = tracked.process(ROAD)
        all_finite(result)
    if not options:
        check_lines(result, LANE)


@pytest.mark.parametrize("at_m", [6, 12, 25])
def test_lines_that_cross_are_never_reported_as_a_lane_that_crosses(at_m):
    result = LaneFinder(RIG).process(x_shaped(at_m))
    if result.lane is not None:
        width = result.lane.right.x(np.linspace(4, 30, 60)) - result.lane.left.x(np.linspace(4, 30, 60))
        assert width.min() > 2


@pytest.mark.parametrize("centre", [-1.75, -1.6, 1.6, 1.75])
def test_a_lane_at_the_border_is_measured_where_it_is(centre):
    """The car drives nearly on a line; the other leaves the frame well before it reaches the car."""
    lane = Lane7(centre=centre, width=3.6)
    result = LaneFinder(RIG).process(paint_frame(lane, size_wh=SMALL))
    all_finite(result)
    assert result.status == "measured" and result.offset_m == pytest.approx(-centre, abs=0.08)
    inside = [(p[:, 0] >= 0) & (p[:, 0] < SMALL[0]) for p in (result.left_px, result.right_px)]
    assert all(i.any() for i in inside)
    assert all(0 <= x < SMALL[0] or x == -2 for lane in result.to_row("x")["lanes"] for x in lane)


@pytest.mark.parametrize("jump", [-1.4, -0.6, 0.6, 1.4])
def test_a_lane_that_jumps_is_followed_within_a_second(jump):
    """From one frame to the next the lane is elsewhere (a cut, a gap in the recording). Held at most half a second,
    right within one, and never in a third place for longer than the old one may be held."""
    f, rng = finder(), np.random.default_rng(11)
    before, after = Lane7(0.3, 0, -1 / 900, 0, 3.6), Lane7(0.3 + jump, 0, -1 / 900, 0, 3.6)
    for _ in range(30):
        assert f.see(before, rng=rng, drop=0.2).status == "measured"
    offsets = []
    for _ in range(40):
        result = f.see(after, rng=rng, drop=0.2)
        all_finite(result)
        offsets.append(result.offset_m if result else math.nan)
    old, new = (np.abs(np.array(offsets) + lane.centre) < 0.15 for lane in (before, after))
    assert new[25:].all(), offsets
    assert np.count_nonzero(old) <= HOLD_FRAMES and np.count_nonzero(~old & ~new) <= HOLD_FRAMES


def test_a_lane_seen_once_in_ten_frames_is_never_held_beyond_the_bound():
    """Flickering sight: between two sightings the lane is held HOLD_FRAMES at most, then it is none."""
    for gap in (HOLD_FRAMES - 1, HOLD_FRAMES + 5):
        f, statuses = finder(), []
        for i in range(6 * (gap + 1)):
            result = f.see(LANE) if i % (gap + 1) == 0 else f.see()
            statuses.append(result.status)
        runs = "".join(s[0] for s in statuses).split("m")
        assert all(set(run) <= {"h", "n"} and len(run.rstrip("n")) == min(gap, HOLD_FRAMES) for run in runs[1:-1])
        assert all("nh" not in run for run in runs)


def test_a_wrong_lane_beside_a_clear_one_is_left_within_a_second_at_any_phase():
    """However the frames of search fall (every fourth in doubt, seldom without): 25 frames, at 12 phases."""
    wrong, truth = Lane7(-0.9, 0, 0, 0, 3.3), Lane7(0.5, 0.02, -1 / 700, 0, 3.7)
    for phase in range(12):
        f, rng = finder(), np.random.default_rng(phase)
        for _ in range(10 + phase):
            assert f.see(wrong, rng=rng, drop=0.2)
        view, good = f.view(SIZE_WH), []
        kwargs = {"height_m": view.height_m, "focal_px": view.focal_px, "rng": rng, "px": 1.0}
        for _ in range(30):
            old = points_on_grid(wrong, view.grid, drop=0.7, **kwargs)
            f.now = joined(points_on_grid(truth, view.grid, drop=0.1, **kwargs), old)
            result = f.process(BLANK)
            good.append(bool(result) and abs(result.offset_m + 0.5) < 0.15)
        assert all(good[25:]), (phase, good)


def test_frames_of_changing_size_mid_clip():
    """Twice the size, other proportions, nothing, one pixel, and back: a number or a reason for each, no harm done."""
    sizes = [SMALL, (1280, 720), (320, 180), SMALL]
    f = LaneFinder(RIG)
    for round_ in range(4):
        for size_wh in sizes:
            result = f.process(paint_frame(LANE, size_wh=size_wh, dashed=(1,), seed=round_))
            assert result.status == "measured" and result.size_wh == size_wh
            check_lines(result, LANE, tolerance_m=0.08)
        for shape in ((480, 480, 3), (0, 0, 3), (1, 1, 3), (360, 640, 2)):
            result = f.process(np.full(shape, 90, np.uint8))
            all_finite(result)
            assert result.status == "none" and result.reason
            json.dumps(result.to_row("x"), allow_nan=False)
    for _ in range(2 * HOLD_FRAMES):  # other proportions for a second: what was known is forgotten, not kept for ever
        assert f.process(np.zeros((480, 480, 3), np.uint8)).status == "none"
    assert f.tracker.fit is None
    check_lines(f.process(ROAD), LANE)
