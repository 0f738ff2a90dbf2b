"""Checkers of notebook 04."""

from __future__ import annotations

import numpy as np

from lanelib.exercises.judges import array, first_failed, function, never_raises, not_yet, number


def _sums(width: int, **stripes: float) -> np.ndarray:
    """A column histogram with a stripe (five columns wide) at each column of ``stripes``, c120=80 for 80 at 120."""
    sums = np.zeros(width)
    for column, height in stripes.items():
        at = int(column[1:])
        sums[at - 2 : at + 3] += height * np.array([0.4, 0.8, 1.0, 0.8, 0.4])
    return sums


@never_raises
def check_start_columns(answer):
    """Columns of the highest peak left and right of ``centre``, from a column histogram (W,)."""
    cases = [
        ((_sums(480, c150=200, c310=90), 240), [150, 310]),
        ((_sums(480, c60=300, c150=200, c420=70, c330=90), 240), [60, 330]),
        ((_sums(480, c90=60, c180=220, c300=50, c380=140), 240), [180, 380]),  # neither the first nor the nearest
        ((_sums(300, c40=50, c130=400, c260=60), 100), [40, 130]),  # the middle of the road is not that of the picture
    ]
    slips = {
        "these are the heights of the peaks; their columns are asked for":
            lambda sums, centre: (sums[:centre].max(), sums[centre:].max()),
        "the middle of the array is not the middle of the lane: split it at `centre`":
            lambda sums, _: [len(half) * i + np.argmax(half) for i, half in enumerate(np.split(sums, 2))],
        "these are the first columns with anything in them; the highest are asked for":
            lambda sums, centre: (np.flatnonzero(sums[:centre])[0], centre + np.flatnonzero(sums[centre:])[0]),
        "these are the peaks nearest to `centre`; the highest are asked for":
            lambda sums, centre: (np.flatnonzero(sums[:centre])[-1], centre + np.flatnonzero(sums[centre:])[0]),
        "a reversed array counts from its end: the left column is counted from `centre` here":
            lambda sums, centre: (np.argmax(sums[:centre][::-1]), centre + np.argmax(sums[centre:])),
    }
    verdict = function(answer, cases, array, rel=0.0, tolerance=3.0, columns="left, right", slips=slips)
    if not verdict and callable(answer):
        try:
            got = np.asarray(answer(*cases[0][0]), float).ravel()
        except Exception:
            return verdict
        if len(got) == 2 and abs(got[1] - (310 - 240)) <= 3:
            return not_yet("the right column is counted from `centre`; add it: argmax of a slice begins at 0 again")
    return verdict


@never_raises
def check_bend_in_metres(answer):
    """A of x = A y² + B y + C in metres from a of u = a v² + b v + c in pixels; sx, sy metres a column and a row."""
    verdict = None
    for a, sx, sy in ((2e-4, 0.025, 0.053), (-7.5e-5, 3.7 / 700, 30 / 720), (1e-3, 0.01, 0.04)):
        mistakes = {
            "x is in columns and y in rows: is each multiplied by its own scale?": a * sy / sx**2,
            "the right power of the rows' scale? y is squared, so its scale is, too": a * sx / sy,
            "y = (v0 - v) sy, so v = v0 - y / sy: divide by the rows' scale, do not multiply": a * sx * sy**2,
            "the columns' scale is missing": a / sy**2,
            "this is the inverse: from metres to pixels": a * sy**2 / sx,
            "still in pixels": a,
            "the rows' scale is missing": a * sx,
        }
        verdict = function(answer, [((a, sx, sy), a * sx / sy**2)], number, unit="1/m", rel=0.003, mistakes=mistakes,
                           sign="y = y0 - s_y v has a minus, and y² has none")
        if not verdict:
            return verdict
    return verdict


def _curvature(line) -> float:
    a, b, _ = line
    return -2 * a / (1 + b * b) ** 1.5


@never_raises
def check_curvature_of_lane(answer):
    """Signed curvature of the lane at the car from (A, B, C) of both lines, 1/m, positive to the left."""
    verdict = None
    pairs = [
        ((-1.1e-3, 0.0, -1.9), (-1.0e-3, 0.0, 1.7)),
        ((-9e-4, 0.01, -1.9), (-6e-5, -0.01, 1.7)),  # one line nearly straight: radii must not be averaged
        ((2e-3, 0.5, -1.9), (2.2e-3, 0.5, 1.7)),  # the car stands across: the slope matters
    ]
    for left, right in pairs:
        one, other = _curvature(left), _curvature(right)
        true = (one + other) / 2
        radius = (1 / abs(one) + 1 / abs(other)) / 2
        mistakes = {
            "these are radii averaged; one nearly straight line then rules. Average curvatures": np.sign(true) / radius,
            "this is a radius in metres; the curvature is asked for": 1 / true,
            "the slope is missing: divide by (1 + B²)^(3/2)": -(left[0] + right[0]),
            "half of it: the second derivative of A y² is 2 A (and ** 3 / 2 is not ** (3 / 2))": true / 2,
            "the sum of both lines; take their mean": 2 * true,
            "1000 times too large: 1/km where 1/m is wanted": 1000 * true,
            "this is the left line's; the lane's is the mean of both": one,
            "this is the right line's; the lane's is the mean of both": other,
            "the slope at y = 0 is B, and this uses C": -sum(a / (1 + c * c) ** 1.5 for a, _, c in (left, right)),
            "the coefficients are (A, B, C), highest power first; this takes C for A":
                -sum(c / (1 + b * b) ** 1.5 for _, b, c in (left, right)),
            "the exponent of (1 + B²) is 3/2; this has 1/2": -sum(a / (1 + b * b) ** 0.5 for a, b, _ in (left, right)),
            "the exponent of (1 + B²) is 3/2; this has 1": -sum(a / (1 + b * b) for a, b, _ in (left, right)),
            "the exponent of (1 + B²) is 3/2; this has 3": -sum(a / (1 + b * b) ** 3 for a, b, _ in (left, right)),
            "(1 + B²)^(3/2) divides, this multiplies by it":
                -sum(a * (1 + b * b) ** 1.5 for a, b, _ in (left, right)),
            "B is squared under the exponent": -sum(a / (1 + b) ** 1.5 for a, b, _ in (left, right)),
        }
        verdict = function(answer, [((left, right), true)], number, unit="1/m", rel=0.005, mistakes=mistakes,
                           sign="positive to the left, and x'' < 0 bends to the left")
        if not verdict:
            return verdict
    return verdict


@never_raises
def check_fit_shared(answer):
    """(centre, heading, bend, width) of x = centre ∓ width / 2 + heading y + bend y², from points of both lines."""

    def points(side, y, centre, heading, bend, width):
        y = np.asarray(y, float)
        return np.column_stack([centre + side * width / 2 + heading * y + bend * y * y, y])

    cases, noisy, rng = [], [], np.random.default_rng(4)
    for numbers, left_y, right_y in (
        ((0.2, -0.01, -1e-3, 3.6), np.linspace(4, 38, 40), np.linspace(5, 30, 25)),
        ((-0.3, 0.02, 2e-3, 3.3), np.linspace(4, 30, 30), [14.0, 15.5, 17.0]),  # one dash on the right
        ((0.0, 0.0, 1.5e-3, 4.0), [9.0, 10.0, 11.0], np.linspace(4, 30, 30)),
    ):
        given = points(-1, left_y, *numbers), points(1, right_y, *numbers)
        cases.append((given, np.array(numbers)))
        shaken = tuple(xy + np.column_stack([rng.normal(0, 0.03, len(xy)), np.zeros(len(xy))]) for xy in given)
        noisy.append((shaken, np.array(numbers)))
    columns = "centre, heading, bend, width"

    def judge(result, expected, **options):
        if isinstance(result, tuple) and len(result) == 4 and np.size(result[0]) == 4:
            return not_yet("`np.linalg.lstsq` returns four things; the numbers are the first of them")
        return array(result, expected, **options)

    verdict = function(answer, cases, judge, rel=1e-3, tolerance=1e-6, columns=columns)
    if verdict:  # three points decide on a parabola, and with 3 cm of noise on a wild one
        verdict = function(answer, noisy, array, tolerance=0.08, columns=columns)
        if not verdict:
            return not_yet(
                f"{verdict.hint}. Right without noise; with 3 cm of it, a line of three points needs the other one: "
                "is each fitted on its own? Stack the rows of both into one matrix and solve it once"
            )
    elif callable(answer):
        for hint, change in (
            ("the first number is the left line at the car; the lane's centre is half a width further right",
             lambda c, h, b, w: (c - w / 2, h, b, w)),
            ("the width is twice what it should be: its column is -1/2 for left points and +1/2 for right ones",
             lambda c, h, b, w: (c, h, b, 2 * w)),
            ("the width is half of what it should be: its column is -1/2 for left points and +1/2 for right ones",
             lambda c, h, b, w: (c, h, b, w / 2)),
            ("the width's sign is reversed: -1/2 for the points on the left, +1/2 for those on the right",
             lambda c, h, b, w: (c, h, b, -w)),
            ("the width came out second; centre, heading, bend, width is wanted", lambda c, h, b, w: (c, w, h, b)),
            ("this is the curvature; the bend is A, the number that stands before y²",
             lambda c, h, b, w: (c, h, -2 * b, w)),
            ("twice the bend: it is A, the number that stands before y²", lambda c, h, b, w: (c, h, 2 * b, w)),
            ("the heading's sign is reversed: y grows ahead, and x to the right", lambda c, h, b, w: (c, -h, b, w)),
            ("this is (bend, heading, centre, width); centre, heading, bend, width is wanted",
             lambda c, h, b, w: (b, h, c, w)),
        ):
            wrong = [(given, np.array(change(*expected))) for given, expected in cases]
            if function(answer, wrong, array, rel=1e-3, tolerance=1e-6):
                return not_yet(hint)
    return verdict


@never_raises
def check_offset_and_width(answer):
    """(offset, width) in metres at the car from (A, B, C) of both lines; the width across the lane."""
    cases = [
        (((1e-3, 0.0, -1.6), (1e-3, 0.0, 2.0)), [-0.2, 3.6]),
        (((0.0, 0.3, -2.3), (0.0, 0.3, 1.6)), [0.35, 3.9 / np.sqrt(1.09)]),
    ]
    slips = {
        "the coefficients are (A, B, C), highest power first: at y = 0 a line is at C":
            lambda left, right: (-(left[0] + right[0]) / 2, right[0] - left[0]),
        "the offset is twice what it should be: the centre is the mean of both lines":
            lambda left, right: (-left[2] - right[2], (right[2] - left[2]) / np.sqrt(1 + left[1] ** 2)),
        "the width is half of what it should be":
            lambda left, right: (-(left[2] + right[2]) / 2, (right[2] - left[2]) / 2 / np.sqrt(1 + left[1] ** 2)),
        "the width is negative: the right line has the larger x":
            lambda left, right: (-(left[2] + right[2]) / 2, (left[2] - right[2]) / np.sqrt(1 + left[1] ** 2)),
        "the width across the lane is *less* than along x":
            lambda left, right: (-(left[2] + right[2]) / 2, (right[2] - left[2]) * np.sqrt(1 + left[1] ** 2)),
        "the width has the root of 1 + B², not 1 + B² itself":
            lambda left, right: (-(left[2] + right[2]) / 2, (right[2] - left[2]) / (1 + left[1] ** 2)),
        "the exponent 3/2 belongs to the curvature; the width has the root of 1 + B²":
            lambda left, right: (-(left[2] + right[2]) / 2, (right[2] - left[2]) / (1 + left[1] ** 2) ** 1.5),
    }
    verdict = function(
        answer, cases, array, rel=2e-3, tolerance=6e-3, sign="right of the centre is positive", columns="offset, width",
        slips=slips,
    )
    if verdict or not callable(answer):
        return verdict

    def variant(offset_sign, across, *, offset_across=False):
        out = []
        for (left, right), _ in cases:
            slant = np.sqrt(1 + left[1] ** 2)
            offset = -offset_sign * (left[2] + right[2]) / 2 / (slant if offset_across else 1.0)
            out.append((offset, (right[2] - left[2]) / (slant if across else 1.0)))
        return out

    for hint, wrong in (
        ("measured along x; across a lane that leads away obliquely it is less: divide by √(1+B²)", variant(1, False)),
        (
            "the offset's sign is reversed: right of the centre is positive, and then both lines lie farther left",
            variant(-1, True),
        ),
        (
            "the width is measured across the lane, the offset along x: it stays as it is",
            variant(1, True, offset_across=True),
        ),
        ("both: the offset's sign is reversed, and the width is measured along x, not across", variant(-1, False)),
    ):
        renamed = [(given, list(values)) for (given, _), values in zip(cases, wrong, strict=True)]
        if function(answer, renamed, array, rel=2e-3, tolerance=1e-3):
            return not_yet(hint)
    return first_failed(verdict)
