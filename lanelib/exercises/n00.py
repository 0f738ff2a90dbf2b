"""Checkers of notebook 00."""

from __future__ import annotations

import math

from lanelib.exercises.judges import function, never_raises, number


@never_raises
def check_offset_of(answer):
    """Where the car is in its lane, from x of both lines at the car; metres, positive to the right of the centre."""
    cases = [((-1.75, 1.95), -0.10), ((-2.05, 1.60), 0.225), ((-1.85, 1.85), 0.0)]
    sign = "a car right of the centre has both lines farther to its left, so their mean is negative"
    slips = {
        "this is the lane's width; where between the lines is its centre?": lambda left, right: right - left,
        "this is half the lane's width; where between the lines is its centre?": lambda left, right: (right - left) / 2,
        "this is how far away the left line is; the offset is counted from the lane's centre": lambda left, _: -left,
    }
    return function(answer, cases, number, unit="m", tolerance=1e-6, sign=sign, slips=slips)


@never_raises
def check_sideways_m(answer):
    """How far a bend leads aside after some distance; the parabola's and the circle's formula both pass."""
    cases = [((600.0, 30.0), 0.75), ((1000.0, 30.0), 0.45), ((250.0, 20.0), 0.8)]
    slips = {
        "twice what it should be: is A 1 / R here?": lambda radius, y: y**2 / radius,
        "this is A alone; the parabola is x = A y²": lambda radius, _: 1 / (2 * radius),
        "y enters as its square: the parabola is x = A y²": lambda radius, y: y / (2 * radius),
        "this is the slope of the parabola, not its x": lambda radius, y: y / radius,
        "Python divides by 2 and multiplies by R in `/ 2 * R`; put 2 * R in brackets":
            lambda radius, y: y**2 / 2 * radius,
        "this is where the circle is, from its centre; how far is that from the straight line?":
            lambda radius, y: math.sqrt(radius**2 - y**2),
    }
    return function(answer, cases, number, unit="m", rel=0.005, slips=slips, sign="give the distance without a sign")


@never_raises
def check_seconds_to_line(answer):
    """When a car that drifts reaches the line."""
    def right_way(gap_m, angle_deg, speed_kmh):
        return gap_m / (math.sin(math.radians(angle_deg)) * speed_kmh / 3.6)

    # the first case tells the mistakes apart, the second is the question at the beginning of the notebook
    cases = [(given, right_way(*given)) for given in ((0.9, 2.0, 30.0), (0.9, 1.0, 100.0), (0.5, 2.0, 50.0))]
    slips = {
        "the sine wants radians: math.radians(degrees)": lambda gap, angle, kmh: gap / (math.sin(angle) * kmh / 3.6),
        "the speed is in km/h; divide it by 3.6 for m/s": lambda gap, angle, kmh: right_way(gap, angle, 3.6 * kmh),
        "degrees where radians are wanted, and km/h where m/s is":
            lambda gap, angle, kmh: gap / (math.sin(angle) * kmh),
        "the speed was multiplied by 3.6; km/h divided by 3.6 is m/s":
            lambda gap, angle, kmh: right_way(gap, angle, 3.6**2 * kmh),
        "this is in milliseconds": lambda *given: 1000 * right_way(*given),
        "this is the time along the road; what counts is the part of the speed across it":
            lambda gap, _, kmh: gap / (kmh / 3.6),
        "degrees are no sine: how much of the speed is across the road?":
            lambda gap, angle, kmh: gap / (angle * kmh / 3.6),
        "this is the speed across the road, in m/s; how long does it take for the gap?":
            lambda gap, *given: 1 / right_way(1, *given),
        "these are the metres along the road; how long does the car take for them?":
            lambda gap, angle, _: gap / math.sin(math.radians(angle)),
    }
    # a tenth of a second is as near as anyone would say it
    return function(answer, cases, number, unit="s", tolerance=0.05, slips=slips)
