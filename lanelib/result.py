"""LaneResult: what one frame said, in metres and in pixels of the frame as given."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lanelib.jointfit import JointFit
from lanelib.lane import Check, Lane
from lanelib.neighbours import Neighbour


class OnDemand:
    """A dataclass field: an array, or a function without arguments that makes it when it is first asked for."""

    def __init__(self, default):
        self.default = default

    def __set_name__(self, owner, name: str) -> None:
        self.key = f"_{name}"

    def __get__(self, instance, owner) -> np.ndarray:
        if instance is None:  # how dataclasses ask for the default
            return self.default
        value = vars(instance)[self.key]
        if callable(value):
            value = vars(instance)[self.key] = value()
        return value

    def __set__(self, instance, value: np.ndarray | Callable[[], np.ndarray]) -> None:
        vars(instance)[self.key] = value


def no_line() -> np.ndarray:
    """A line without points."""
    return np.empty((0, 2))


@dataclass(frozen=True, eq=False)
class LaneResult:
    """What one frame said. ``status``: "measured", "held" (from frames before) or "none"; then ``reason`` says why.

    ``left_px``, ``right_px``: (N, 2) pixels of the frame as given, from near to far, over the part where the lane was
    seen. ``neighbours``: lanes beside the ego lane, left ones first, where they were asked for and seen.
    """

    lane: Lane | None
    status: str
    reason: str = ""
    confidence: float = 0.0
    checks: tuple[Check, ...] = ()
    left_px: OnDemand = OnDemand(no_line)
    right_px: OnDemand = OnDemand(no_line)
    size_wh: tuple[int, int] = (0, 0)
    milliseconds: float = 0.0
    fit: JointFit | None = None
    neighbours: tuple[Neighbour, ...] = ()

    def __bool__(self):
        return self.lane is not None

    def __getstate__(self):
        _ = self.left_px, self.right_px  # functions do not travel to other processes
        return vars(self)

    @property
    def radius_m(self) -> float | None:
        """Radius of curvature at the car, m; ``inf`` on a straight road; None without a lane."""
        return self.lane.radius_m if self.lane else None

    @property
    def curvature_1pm(self) -> float | None:
        """Signed curvature at the car, 1/m, positive to the left; None without a lane."""
        return self.lane.curvature_1pm if self.lane else None

    @property
    def offset_m(self) -> float | None:
        """Lateral offset, m, positive when the car is right of the lane's centre; None without a lane."""
        return self.lane.offset_m if self.lane else None

    @property
    def width_m(self) -> float | None:
        """Width of the lane at the car, m; None without a lane."""
        return float(self.lane.width_m()) if self.lane else None

    def to_row(self, raw_file: str, *, step_px: int = 10) -> dict:
        """This result as one line of the TuSimple layout (docs/ARCHITECTURE.md), over the rows where the lane was seen.

        Far boundaries of neighbours follow the ego lane's two lines, so that these stay the first.
        """
        w, h = self.size_wh
        every = (self.left_px, self.right_px, *(n.points_px for n in self.neighbours))
        lines = [line_at_rows(p, np.arange(0, h, step_px), w) for p in every]
        seen = [i for i in range(len(lines[0])) if any(line[i] >= 0 for line in lines)]
        rows = range(seen[0], seen[-1] + 1) if seen else range(0)
        row = {
            "raw_file": raw_file,
            "h_samples": [i * step_px for i in rows],
            "lanes": [[line[i] for i in rows] for line in lines] if seen else [],
            "run_time": round(self.milliseconds, 3),
            "status": self.status,
            "reason": self.reason,
            "confidence": round(self.confidence, 3),
            "radius_m": _rounded(self.radius_m, 1),
            "curvature_1pm": _rounded(self.curvature_1pm, 7),
            "offset_m": _rounded(self.offset_m, 3),
            "lane_width_m": _rounded(self.width_m, 3),
        }
        if self.neighbours:
            row["neighbours"] = [neighbour.to_dict() for neighbour in self.neighbours]
        return row

    def __repr__(self):
        return f"LaneResult({self.status}, confidence {self.confidence:.2f}, {self.lane or self.reason})"


def _rounded(value: float | None, digits: int) -> float | None:
    """For JSON: None where there is no number, or none that is finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)


def line_at_rows(points_px: np.ndarray, rows: np.ndarray, width: int) -> list[float]:
    """x of a line (N, 2), near to far, at rows of the picture; -2 outside the line or picture (as TuSimple)."""
    if len(points_px) < 2:
        return [-2] * len(rows)
    # from near to far a line climbs; beyond a crest it would turn back
    falling = np.flatnonzero(np.diff(points_px[:, 1]) >= 0)
    points_px = points_px[: falling[0] + 1] if len(falling) else points_px
    if len(points_px) < 2:
        return [-2] * len(rows)
    x = np.interp(rows, points_px[::-1, 1], points_px[::-1, 0], left=-2, right=-2)
    return [round(float(v), 2) if 0 <= v <= width - 1 else -2 for v in x]
