"""Warm ground beside the road: counted row by row against ground drawn from another formula."""

from dataclasses import replace

import numpy as np
import pytest
from roads import Lane7, joined, points_on_grid, rig

from lanelib.birdseye import Grid
from lanelib.finder import LaneFinder
from lanelib.jointfit import PITCH, fit
from lanelib.rig import View
from lanelib.tracking import BETTER_ENERGY, LaneTracker
from lanelib.verge import COVERED_M, FAR_M, MOST_VALUE, ROW_VALUE, SHINE, STRIP_M, WARMER, verge_objection, verge_rows

HEIGHT_M = 1.3
GRID = Grid(np.arange(-130, 131) * 0.06, np.linspace(60**-0.5, 5**-0.5, 100) ** -2)  # not the finder's
LANES = {
    "straight": Lane7(width=3.5),
    "bend": Lane7(0.3, -0.03, 0.004, 1e-5, 3.4),
    "nod and hill": Lane7(-0.2, 0.02, -0.002, 0.0, 3.7, pitch=-0.006, hill=2e-4),
}


def ground(lane: Lane7, left_m=np.inf, right_m=np.inf, *, strip_m=20.0, warm=60, road=15) -> np.ndarray:
    """Yellowness of a scan: warm ground from so far outside of the lane's left and right line on (negative: inside),
    ``strip_m`` wide."""
    depression = HEIGHT_M / GRID.y_m + lane.pitch  # of what the rig takes for the road at y_m, seen by the nodding car
    y = np.array([np.roots([lane.hill / 2, d, -HEIGHT_M]).max() for d in depression])  # h - hill y^2 / 2 = d y
    picture = np.full((len(GRID.y_m), len(GRID.x_m)), road, np.uint8)
    for side, from_m in ((-1, left_m), (1, right_m)):
        outside_m = side * (GRID.x_m * (y / GRID.y_m)[:, None] - lane.x(y, side)[:, None])
        picture[(outside_m > from_m) & (outside_m < from_m + strip_m)] = warm
    return picture


def rows_of(yellow, found, grid=GRID, brightness=100):
    """``verge_rows`` where everything is equally bright."""
    return verge_rows(np.full_like(yellow, brightness), yellow, grid, found)


def fitted(lane: Lane7):
    points = points_on_grid(replace(lane, hill=0.0), GRID, height_m=HEIGHT_M, focal_px=1000.0)
    return replace(fit(points, lane.mean), mean=lane.mean)


def near_rows(lane: Lane7) -> int:
    depression = HEIGHT_M / GRID.y_m + lane.pitch
    return int(sum(np.roots([lane.hill / 2, d, -HEIGHT_M]).max() < FAR_M for d in depression))


@pytest.mark.parametrize("lane", LANES.values(), ids=LANES)
def test_every_row_counts_where_the_ground_reaches_into_the_lane(lane):
    rows, found = near_rows(lane), fitted(lane)
    assert 40 < rows < 90
    for inside_m, expected in ((COVERED_M + 0.15, rows), (COVERED_M - 0.15, 0), (-0.5, 0)):
        left = rows_of(ground(lane, left_m=-inside_m), found)
        right = rows_of(ground(lane, right_m=-inside_m), found)
        assert left == pytest.approx((expected, 0), abs=2), inside_m
        assert right == pytest.approx((0, expected), abs=2), inside_m


def test_only_ground_that_is_warmer_and_wider_than_paint_counts():
    lane = LANES["straight"]
    found, rows = fitted(lane), near_rows(lane)
    for strip_m, counts in ((0.55, False), (STRIP_M + 0.2, True)):  # two yellow lines and their gap; leaves
        assert (rows_of(ground(lane, right_m=-0.4, strip_m=strip_m), found)[1] > rows / 2) == counts
    for warmer, counts in ((WARMER - 2, False), (WARMER + 2, True)):
        warm = ground(lane, right_m=-0.5, road=4, warm=round(SHINE * 4 + warmer))
        assert (rows_of(warm, found)[1] > rows / 2) == counts
    assert rows_of(np.full_like(warm, 90), found) == (0, 0)  # the light is warm, or a bonnet is red
    assert rows_of(255 - ground(lane, right_m=-0.5), found) == (0, 0)  # the ground is the colder one


def test_a_low_sun_makes_a_road_shine_but_no_verge_of_it():
    """Twice as bright and twice as yellow is the same road; three times as yellow is not; ground in the shade is seen
    as well as in the sun."""
    lane = LANES["straight"]
    found, rows = fitted(lane), near_rows(lane)
    shining, soil, shaded = ((40, 160), (56, 160)), ((80, 160), (40, 80), (40, 40)), ((28, 40),)
    for warm, grey in (*shining, *soil, *shaded):
        counts = (warm, grey) in soil
        yellow = ground(lane, left_m=-0.6, road=20, warm=warm)
        brightness = np.where(yellow == warm, np.uint8(grey), np.uint8(80))
        assert (verge_rows(brightness, yellow, GRID, found)[0] > rows / 2) == counts, (warm, grey)


def test_what_is_not_in_the_picture_is_not_known():
    lane = Lane7(centre=5.0, width=3.5)  # its right line is at 6.75 m, the picture ends at 7.8 m
    warm = ground(lane, right_m=-0.5)
    found = fitted(lane)
    assert rows_of(warm, found)[1] == pytest.approx(near_rows(lane), abs=2)
    columns = slice(0, int(GRID.column_of(6.75 + STRIP_M - COVERED_M)) - 1)  # narrower than the strip that is asked for
    part = Grid(GRID.x_m[columns], GRID.y_m)
    assert rows_of(warm[:, columns], found, part) == (0, 0)
    beside = fitted(Lane7(centre=6.2, width=4.4))  # its right line lies outside, the left half of the picture is warm
    warm = np.where(GRID.x_m < 0, np.uint8(60), np.full((len(GRID.y_m), len(GRID.x_m)), 15, np.uint8))
    assert rows_of(warm, beside) == (0, 0)
    far = Grid(GRID.x_m, np.linspace(60, 40, 20))
    assert rows_of(np.zeros((20, len(GRID.x_m)), np.uint8), found, far) == (0, 0)


def test_the_objection_grows_with_the_rows_to_a_limit():
    lane = LANES["straight"]
    warm, found = ground(lane, left_m=-0.5), fitted(lane)
    grey = np.full_like(warm, 100)
    assert verge_objection(grey, warm, GRID, found) == MOST_VALUE
    warm[np.arange(len(warm)) % 100 < 90] = 15  # ten rows are left, all near
    rows = rows_of(warm, found)
    assert rows == (10, 0) and verge_objection(grey, warm, GRID, found) == pytest.approx(10 * ROW_VALUE)


def test_of_two_lanes_with_nearly_the_same_paint_the_one_on_the_road_is_taken():
    """A solid line on the left; on the right a little paint 3.3 m and a little more 3.9 m away: without a verge the
    wider lane, where leaves begin at 3.5 m the narrower one. Clear paint on the right is not outvoted by leaves."""
    view = View(rig())
    camera = {"height_m": view.height_m, "focal_px": view.focal_px}
    narrow, wide = Lane7(centre=0.0, width=3.3), Lane7(centre=0.3, width=3.9)

    def right_line(lane, begin_m, end_m):
        both = points_on_grid(lane, view.grid, **camera)
        y = 1 / both.inverse
        return both.some((both.bearing > 0) & (y > begin_m) & (y < end_m))

    left = points_on_grid(narrow, view.grid, **camera)
    left = left.some(left.bearing < 0)
    grey = np.full((len(view.grid.y_m), len(view.grid.x_m)), 10, np.uint8)
    leaves = np.where(view.grid.x_m > -1.65 + 3.5, np.uint8(70), grey)
    little = joined(left, right_line(narrow, 8.0, 8.9), right_line(wide, 8.0, 9.1))
    for yellow, expected in ((grey, wide), (leaves, narrow)):
        found = LaneFinder(rig(), track=False)._best(little, (grey, yellow), view)[0]
        assert found.mean[4] == pytest.approx(expected.width, abs=0.15), expected
    clear = joined(left, right_line(wide, 6.0, 40.0))
    found = LaneFinder(rig(), track=False)._best(clear, (grey, leaves), view)[0]
    assert found.mean[4] == pytest.approx(wide.width, abs=0.05)


def test_a_tracked_lane_among_leaves_gives_way_sooner():
    """The same lane with a better pitch takes over when it is worth 3 more; of a lane in the leaves so much less."""
    lane = Lane7()
    tracked = fitted(lane)
    tracker = LaneTracker()
    tracker.update(tracked)
    nodded = tracked.mean + 0.01 * (np.arange(7) == PITCH)
    same = replace(tracked, mean=nodded, energy=tracker.energy_needed(tracked) - BETTER_ENERGY + 0.5)
    asked = replace(tracked, objection=MOST_VALUE)
    assert not any(tracker.challenge(tracked, same, lost=False) for _ in range(2))
    assert not any(tracker.challenge(asked, replace(same, objection=MOST_VALUE), lost=False) for _ in range(2))
    assert tracker.start_needed(asked) == pytest.approx(tracker.start_needed(tracked) - MOST_VALUE)
    assert [tracker.challenge(asked, same, lost=False) for _ in range(2)] == [False, True]


