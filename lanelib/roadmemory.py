"""The road's memory: the bend that was 20 m ahead is now here, and then it was seen.

A camera sees no road at the car, only from some metres on, and one frame tells one curvature for all of it, that of
its middle; on a road that tightens, the car is told a bend that it will reach in a second. But a second ago the place
where it is now lay in the middle of the view. So every curvature is kept with its place on the road, and read when the
car is there.

How far the car has come is not measured. It is taken to drive as drivers do: ``FASTEST_MPS`` on straight road, in bends
with 2 m/s^2 of lateral acceleration, and no faster out of a bend than cars speed up. Curvature changes over tens of
metres, so that need not be exact: a car half as fast is still told half the error, one 1.5 times as fast two thirds of
it, only one twice as fast gains nothing on a winding road (tests/test_roadmemory.py; the rendered forest).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from lanelib.jointfit import centre_curvature
from lanelib.lane import Here, Lane

FASTEST_MPS, LATERAL_MPS2, FRAME_S = 30.0, 2.0, 0.04
SPEED_UP_MPS2, SLOW_DOWN_MPS2 = 2.0, 4.0
# What one frame says of the bend holds for the middle of what it saw, but for no place farther than this: most paint is
# seen near by. Speed is judged by the bend here and ``BEYOND_M`` ahead.
MIDDLE_M, BEYOND_M = 25.0, 30.0
BLUR_M = 2.0  # looks at places twice as far away no longer count, nearer ones the more
NEAR_M = 7.0  # from here on the fit's line is right; nearer, few rows or none have paint, and it is prolonged
STEPS_M = [0.0, NEAR_M / 3, 2 * NEAR_M / 3, NEAR_M]
WEIGHTS_M = [NEAR_M / 6, NEAR_M / 3, NEAR_M / 3, NEAR_M / 6]  # the trapezoidal rule


class RoadMemory:
    """The state: ``travelled_m`` so far, and what was seen where."""

    def __init__(self) -> None:
        self.travelled_m = 0.0
        self._step_m: float | None = None  # of the last frame
        self._looks: deque[tuple[float, float]] = deque()  # place and curvature, from behind the car to ahead of it

    def update(self, lane: Lane, mean: np.ndarray, *, measured: bool, frame_s: float = FRAME_S) -> Lane:
        """One frame of ``frame_s`` seconds further: its ``lane`` with what is known of the road at the car.

        What the joint fit's ``mean`` (7,) says of the road ahead is kept, where it was ``measured``. Where nothing is
        known of the road at the car yet, the lane comes back as it was.
        """
        middle = min(MIDDLE_M, sum(lane.y_range_m) / 2)
        here, ahead, beyond, *told = centre_curvature(mean, (0.0, middle, BEYOND_M, *STEPS_M))
        self._step_m = driven(self._step_m, advance_m(max(abs(here), abs(beyond)), frame_s), frame_s)
        self.travelled_m += self._step_m
        if measured:
            self._looks.append((self.travelled_m + middle, ahead))
        # two looks behind the car stay: what is between them and those ahead is known
        while len(self._looks) > 2 and self._looks[1][0] < self.travelled_m - 2 * BLUR_M:
            self._looks.popleft()
        reach_m = self.travelled_m + NEAR_M + 2 * BLUR_M
        near = [look for look in self._looks if look[0] < reach_m]
        known = [self.curvature_1pm(y, near) for y in STEPS_M]
        if any(map(math.isnan, known)):
            return lane
        # x'' = -k, and the line is right at NEAR_M: a curvature that is greater by dk(y) on this side of it moves the
        # line at the car by minus the integral of dk y dy, and the offset by as much the other way
        shift = sum((k - t) * y * w for k, t, y, w in zip(known, told, STEPS_M, WEIGHTS_M, strict=True))
        return replace(lane, here=Here(known[0], lane.offset_m + shift))

    def curvature_1pm(self, ahead_m: float, near: Iterable[tuple[float, float]] | None = None) -> float:
        """Signed curvature of the road at a distance from the car, 1/m.

        NaN before the first and beyond the last place that was seen. (Looks may lie some metres apart, where the view
        grew or shrank: between them it is interpolated.) ``near``: those looks that may be near enough, where they are
        known.
        """
        asked, total, weighted = self.travelled_m + ahead_m, 0.0, 0.0
        for place, curvature in self._looks if near is None else near:
            weight = 1 - abs(place - asked) / (2 * BLUR_M)
            if weight > 0:
                total += weight
                weighted += weight * curvature
        if total > 0:
            return weighted / total
        if not self._looks:
            return math.nan
        place, curvature = np.array(sorted(self._looks)).T
        return float(np.interp(asked, place, curvature, left=math.nan, right=math.nan))


def advance_m(sharpest_1pm: float, frame_s: float = FRAME_S) -> float:
    """How far a car comes in a frame on a road of this curvature, about."""
    return frame_s * min(math.sqrt(LATERAL_MPS2 / max(sharpest_1pm, 1e-9)), FASTEST_MPS)


def driven(last_m: float | None, wanted_m: float, frame_s: float = FRAME_S) -> float:
    """The way of this frame, where the last one's was ``last_m``: a car changes its speed only so fast."""
    if last_m is None:
        return wanted_m
    return min(max(wanted_m, last_m - SLOW_DOWN_MPS2 * frame_s**2), last_m + SPEED_UP_MPS2 * frame_s**2)
