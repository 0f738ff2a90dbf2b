"""roadmemory.py: on a road whose curvature is known at every metre, the car is told the bend that it is in."""

from dataclasses import replace

import numpy as np
import pytest
from roads import SIZE_WH, Lane7, paint_frame, rig

from lanelib import roadmemory
from lanelib.finder import LaneFinder
from lanelib.jointfit import centre_curvature
from lanelib.lane import Lane, Line
from lanelib.road import Road
from lanelib.roadmemory import RoadMemory, advance_m, driven

# Straight, into a bend of R 80 m over 40 m, out of it into one of R 60 m to the other side: a forest road.
FOREST = Road([0, 20, 60, 90, 140, 170], [0, 0, 1 / 80, 1 / 80, -1 / 60, -1 / 60])
AHEAD_M = np.linspace(5, 25, 21)


def frame(road: Road, s_m: float) -> tuple[np.ndarray, Lane]:
    """What one frame tells at ``s_m``: the best parabola through what is seen of the true centre line, as a joint fit's
    mean (7,) and as a lane. The car is on the centre line and points along it."""
    theta = road.heading(s_m)
    away = road.point(s_m + AHEAD_M) - road.point(s_m)
    x, y = away @ [np.cos(theta), np.sin(theta)], away @ [-np.sin(theta), np.cos(theta)]
    bend, heading, centre = np.polyfit(y, x, 2)
    lines = [Line(np.array([bend, heading, centre + side * 1.8]), (5.0, 25.0)) for side in (-1, 1)]
    return np.array([centre, heading, bend, 0, 3.6, 0, 0]), Lane(*lines)


def drive(road: Road, *, speed: float = 1.0, to_m: float = 180.0):
    """Curvature and offset of the frames alone, with memory, and true curvature, along a drive at ``speed`` times what
    the memory believes."""
    memory, s, rows = RoadMemory(), 0.0, []
    while s < to_m:
        mean, lane = frame(road, s)
        before = memory.travelled_m
        told = memory.update(lane, mean, measured=True)
        rows.append((s, lane.curvature_1pm, told.curvature_1pm, road.curvature(s), lane.offset_m, told.offset_m))
        s += speed * (memory.travelled_m - before)
    return np.array(rows).T


def test_one_frame_tells_the_bend_ahead_and_the_memory_the_one_here():
    """The frame's parabola has the curvature of 15 m ahead, the middle of its view; the car's true offset is 0."""
    s, alone, told, true, offset_alone, offset = drive(FOREST)
    known = s > 20
    error, before = np.abs(told - true)[known], np.abs(alone - true)[known]
    assert before.mean() > 0.003 and error.mean() < before.mean() / 3 and error.max() < 0.0045
    assert np.abs(offset[known]).mean() < np.abs(offset_alone[known]).mean() / 2


@pytest.mark.parametrize("speed", [0.5, 0.7, 1.5])
def test_the_speed_need_not_be_known_well(speed):
    s, alone, told, true, _, _ = drive(FOREST, speed=speed)
    known = s > 25
    assert np.abs(told - true)[known].mean() < np.abs(alone - true)[known].mean() / 1.9


@pytest.mark.parametrize("k", [0.0, 1 / 900, -1 / 100])
def test_a_steady_bend_stays_what_it_is(k):
    """Nothing to correct: the memory agrees with the frames; a parabola through a circle is a little off itself."""
    s, alone, told, true, offset_alone, offset = drive(Road([0], [k]), to_m=60.0)
    np.testing.assert_allclose(told, true, atol=0.04 * abs(k) + 1e-9)
    np.testing.assert_allclose(offset, offset_alone, atol=0.01)


def test_before_the_place_was_seen_the_frame_speaks_alone():
    memory = RoadMemory()
    mean, lane = frame(FOREST, 30.0)
    assert memory.update(lane, mean, measured=True) is lane
    assert np.isnan(memory.curvature_1pm(0.0)) and np.isnan(RoadMemory().curvature_1pm(0.0))
    assert [memory.curvature_1pm(15.0)] == pytest.approx(centre_curvature(mean, [15.0]))


def test_held_frames_drive_on_over_what_was_seen():
    """No paint for 10 m: the bend comes as it was seen before; then it is unknown."""
    memory, s = RoadMemory(), 0.0
    while s < 50.0:
        mean, lane = frame(FOREST, s)
        memory.update(lane, mean, measured=True)
        s = memory.travelled_m
    held = []
    for _ in range(60):
        told = memory.update(lane, mean, measured=False)
        held.append((told.curvature_1pm, FOREST.curvature(memory.travelled_m), told is lane))
    told, true, alone = np.array(held).T
    known = int(np.argmax(alone))
    assert 10 < known < 50 and alone[known:].all()
    assert np.abs(told - true)[:known].max() < 0.0025


def test_between_two_looks_the_road_is_interpolated():
    """The view grew from 10 to 30 m at once: nobody looked at the 10 m between. No flicker comes of it."""
    memory, told = RoadMemory(), []
    for i in range(60):
        mean, lane = frame(FOREST, memory.travelled_m)
        far = 15.0 if i < 12 else 45.0
        lines = (replace(line, y_range_m=(5.0, far)) for line in (lane.left, lane.right))
        told.append(memory.update(replace(lane, left=next(lines), right=next(lines)), mean, measured=True))
    places = np.sort([place for place, _ in memory._looks])
    known = np.array([lane.here is not None for lane in told])
    assert np.diff(places).max() < 14 and known[np.argmax(known) :].all() and known.sum() > 40
    assert np.abs(np.diff([lane.curvature_1pm for lane in told])[known[1:] & known[:-1]]).max() < 0.0012


def test_the_offset_is_the_integral_of_what_the_frame_missed():
    """A bend that begins only now: the frame prolongs its curvature k back to the car, the memory knows straight road.
    From NEAR_M back the line then departs by k NEAR_M^2 / 2."""
    memory, k = RoadMemory(), 0.01
    for i in range(40):
        mean = np.array([0, 0, -k / 2 if i == 39 else 0.0, 0, 3.6, 0, 0])
        lines = [Line(np.array([mean[2], 0, side * 1.8]), (5.0, 25.0)) for side in (-1, 1)]
        told = memory.update(Lane(*lines), mean, measured=True)
    assert told.curvature_1pm == pytest.approx(0, abs=1e-6)
    assert told.offset_m == pytest.approx(-k * roadmemory.NEAR_M**2 / 2, rel=0.15)  # four points of a parabola


def test_advance_is_that_of_drivers():
    assert advance_m(0.0) == pytest.approx(1.2)  # 108 km/h at 25 frames a second
    assert advance_m(1 / 50) == pytest.approx(0.4)  # 36 km/h: 2 m/s^2 at R 50 m


def test_no_car_leaps_from_a_bend_to_full_speed():
    """From 40 km/h in a bend to 108 km/h on the straight takes ten seconds at 2 m/s^2, and half of it back."""
    bend, straight = advance_m(1 / 60), advance_m(0.0)
    speeding = [bend]
    while speeding[-1] < straight:
        speeding.append(driven(speeding[-1], straight))
    assert 0.04 * len(speeding) == pytest.approx((straight - bend) / 0.04 / 2.0, rel=0.02)
    slowing = [straight]
    while slowing[-1] > bend:
        slowing.append(driven(slowing[-1], bend))
    assert 0.04 * len(slowing) == pytest.approx((straight - bend) / 0.04 / 4.0, rel=0.02)
    assert driven(None, 0.7) == 0.7 and driven(0.5, 0.5) == 0.5


def test_the_finder_uses_it_while_tracking_only():
    """A steady bend, painted: known after some metres, forgotten with the lane."""
    lane = Lane7(bend=-1 / 600, width=3.6)
    picture, finder = paint_frame(lane, noise=0), LaneFinder(rig())
    results = [finder.process(picture) for _ in range(40)]
    assert results[0].lane.here is None and results[-1].lane.here is not None
    assert results[-1].curvature_1pm == pytest.approx(1 / 300, rel=0.1)
    finder.reset()
    assert finder.process(picture).lane.here is None
    assert LaneFinder(rig(), track=False).process(picture).lane.here is None
    assert picture.shape[1::-1] == SIZE_WH


def test_a_lane_without_memory_is_as_before():
    _, lane = frame(FOREST, 70.0)
    assert replace(lane, here=None).curvature_1pm == lane.curvature_1pm
