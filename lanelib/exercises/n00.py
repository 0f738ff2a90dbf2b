"""Checkers of notebook 00."""

from __future__ import annotations

import math

from lanelib.exercises.judges import function, never_raises, number


@never_raises
def check_offset_of(answer):
    """Where the car is in its lane, from x of both lines at the car; metres, positive to the right of the centre."""
    cases = [((-1.75, 1.95), -0.10), ((-2.05, 1.60), 0.225), ((-1.85, 1.85), 0.0)]
    sign = "a car right of the centre has both lines farther to its left, so their mean is negative"
    return function(answer, cases, number, unit="m", tolerance=1e-6, sign=sign)


@never_raises
def check_sideways_m(answer):
    """How far a bend leads aside after some distance; the parabola's and the circle's formula both pass."""
    cases = [((600.0, 30.0), 0.75), ((1000.0, 30.0), 0.45), ((250.0, 20.0), 0.8)]
    first = cases[0][0]
    mistakes = {
        "twice: x = y² / (2 R)": first[1] ** 2 / first[0],
        "this is A = 1 / (2 R); it has to be multiplied by y²": 1 / (2 * first[0]),
        "y enters as its square: x = y² / (2 R)": first[1] / (2 * first[0]),
    }
    return function(answer, cases, number, unit="m", rel=0.005, mistakes=mistakes)


@never_raises
def check_seconds_to_line(answer):
    """When a car that drifts reaches the line."""
    cases = [
        ((0.9, 1.0, 100.0), 0.9 / (math.sin(math.radians(1.0)) * 100 / 3.6)),
        ((0.5, 2.0, 50.0), 0.5 / (math.sin(math.radians(2.0)) * 50 / 3.6)),
    ]
    first = cases[0][0]
    mistakes = {
        "the sine wants radians: math.radians(degrees)": first[0] / (math.sin(first[1]) * first[2] / 3.6),
        "the speed is in km/h; divide it by 3.6 for m/s": first[0] / (math.sin(math.radians(first[1])) * first[2]),
        "degrees where radians are wanted, and km/h where m/s is": first[0] / (math.sin(first[1]) * first[2]),
        "the speed was multiplied by 3.6; km/h divided by 3.6 is m/s": first[0]
        / (math.sin(math.radians(first[1])) * first[2] * 3.6),
        "this is in milliseconds": 1000 * cases[0][1],
        "this is the time along the road; what counts is the part of the speed across it": first[0] / (first[2] / 3.6),
    }
    # a tenth of a second is as near as anyone would say it
    return function(answer, cases, number, unit="s", tolerance=0.05, mistakes=mistakes)
