"""Checkers of notebook 00."""

from __future__ import annotations

from lanelib.exercises.judges import function, never_raises, number


@never_raises
def check_offset_of(answer):
    """Where the car is in its lane, from x of both lines at the car; metres, positive to the right of the centre."""
    cases = [((-1.75, 1.95), -0.10), ((-2.05, 1.60), 0.225), ((-1.85, 1.85), 0.0)]
    sign = "right of the centre is positive, and then both lines lie farther to the left"
    return function(answer, cases, number, unit="m", tolerance=1e-6, sign=sign)
