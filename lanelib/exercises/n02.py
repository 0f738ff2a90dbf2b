"""Checkers of notebook 02."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from lanelib.exercises.judges import array, first_failed, function, never_raises, not_yet, right
from lanelib.exercises.verdict import Verdict
from lanelib.road import Marking
from lanelib.simulator import Scene, render_road

NEEDED = 0.55  # of precision and recall each: the better half of what simple recipes reach, and no more


@never_raises
def check_precision_recall(answer):
    """(precision, recall) of a mask against the paint, both arrays in which 0 is no and anything else is yes."""
    rng = np.random.default_rng(3)
    paint = (rng.random((40, 60)) < 0.1).astype(np.uint8) * 255
    mask = np.where(rng.random((40, 60)) < 0.7, paint, 0)
    mask[rng.random((40, 60)) < 0.05] = 255
    # 0/255 first; then the other ways to write the same
    given = [(mask, paint), (mask > 0, paint), ((mask > 0).astype(np.uint8), paint > 0)]
    cases = [(one, np.array(_score(mask, paint))) for one in given]

    def slipped(score):
        """A wrong pair, from hits, and the numbers of pixels found, painted, and of all."""
        def pair(mask, paint):
            on, painted = mask != 0, paint != 0
            return score((on & painted).sum(), on.sum(), painted.sum(), on.size)

        return pair

    slips = {
        "these are the two, but exchanged: precision divides by the mask, recall by the paint":
            slipped(lambda hits, on, painted, _: (hits / painted, hits / on)),
        "in per cent; a share is 0 to 1": slipped(lambda hits, on, painted, _: (100 * hits / on, 100 * hits / painted)),
        "turned over: the hits are divided, they do not divide":
            slipped(lambda hits, on, painted, _: (on / hits, painted / hits)),
        "this is one number, the overlap (intersection over union); a pair is asked for":
            slipped(lambda hits, on, painted, _: hits / (on + painted - hits)),
        "this is F1; precision and recall on their own are asked for":
            slipped(lambda hits, on, painted, _: 2 * hits / (on + painted)),
        "the precision alone; a pair (precision, recall) is asked for": slipped(lambda hits, on, *_: hits / on),
        "the first is right; recall is the share of the *paint* that was found, not of the road":
            slipped(lambda hits, on, painted, size: (hits / on, (on - hits) / (size - painted))),
        "one is 0/1 here, the other 0/255: count the pixels that are not 0, do not add up their values":
            slipped(lambda hits, on, painted, _: (hits / on, hits / painted / 255)),
        "255 times 255 wraps around in 8 bits; make the masks bool first (not 0 means yes)":
            slipped(lambda hits, on, painted, _: (hits / on / 255, hits / painted / 255)),
    }

    def judge(value, expected, *, mistakes):
        values = np.asarray(value, float).ravel() if np.size(value) == 2 else None
        if values is not None and np.isnan(values).any():
            return not_yet("nothing was counted; `== 1` and `== 255` do not fit all masks, `!= 0` does")
        verdict = array(value, expected, rel=0, tolerance=0.006, mistakes=mistakes)  # two decimals will do
        if verdict or values is None or any(verdict.hint == hint for hint in mistakes):
            return verdict
        if (values > 1.001).any():
            return not_yet("a share is at most 1; count pixels that are not 0, do not add up their 255s (which wrap)")
        if np.allclose(values, values[0]):
            return not_yet("both are the same; the hits are divided by the mask once, and once by the paint")
        return verdict

    return function(answer, cases, judge, slips=slips)


def _ridge(row: np.ndarray, distance: int) -> np.ndarray:
    padded = np.pad(row.astype(float), distance, mode="edge")
    return row - np.maximum(padded[: -2 * distance], padded[2 * distance :])


@never_raises
def check_ridge(answer):
    """Centre minus the brighter side, for a row of uint8 and a distance in pixels; both ends repeat the last pixel."""
    rng = np.random.default_rng(4)
    cases = []
    for distance in (2, 5):
        row = rng.integers(0, 255, 60).astype(np.uint8)
        cases.append((row, distance, _ridge(row, distance)))

    def judge(value, expected, distance):
        values = np.asarray(value)
        inner = slice(distance, -distance)
        if values.shape == expected.shape:
            if np.allclose(values[inner], np.maximum(expected, 0)[inner]):
                return not_yet("no value is below 0: they were cut off there; a valley is negative")
            if np.allclose(values[inner], np.abs(expected)[inner]):
                return not_yet("no value is below 0: the sign is lost; a valley is negative")
            if values.dtype == np.uint8 or (values.min(initial=0) >= 0 and expected.min() < 0):
                return not_yet("no value is below 0: uint8 wraps around (3 - 5 is 254); convert to float or int first")
            if values.dtype == np.int8 or np.allclose(values[inner], expected.astype(np.int8)[inner]):
                return not_yet("int8 ends at 127, and grey levels at 255; convert to float or int")
            row, padded = judge.row, np.pad(judge.row.astype(float), distance, mode="edge")
            left, right_side = padded[: -2 * distance], padded[2 * distance :]
            for hint, other in {
                "compare with the brighter side, not with the mean: a step is no ridge": (left + right_side) / 2,
                "compare with the brighter side, not with the darker one": np.minimum(left, right_side),
                "compare with both sides, not with the left one only": left,
                "compare with both sides, not with the right one only": right_side,
                "take the brighter side away once, not the sum of both": left + right_side,
            }.items():
                if np.allclose(values[inner].astype(float), (row - other)[inner]):
                    return not_yet(hint)
            for other in (2, 1, 2 * distance, distance + 1, distance - 1):
                if other != distance and np.allclose(values[10:-10], _ridge(judge.row, other)[10:-10]):
                    return not_yet(f"the sides are {other} away from the centre, `distance` is {distance}")
            if not (inside := array(values[inner], expected[inner], unit="grey levels", rel=1e-6)):
                return inside
            if not np.allclose(values, expected):
                ends = f"right but for the first and the last {distance} pixels"
                return not_yet(f"{ends}: beyond the end the last pixel is repeated (`np.roll` fetches the other end)")
            return right()
        if values.shape == expected[inner].shape:
            return not_yet(f"shape {expected.shape} is needed, found {values.shape}: the ends are missing")
        return array(value, expected)

    verdict = right()
    for row, distance, expected in cases:
        judge.row = row
        judged = function(answer, [((row, distance), expected)], judge, distance=distance)
        verdict = first_failed(verdict, judged)
    return verdict


@never_raises
def check_yellow(answer):
    """A mask of yellow paint, (H, W, 3) BGR in, that must hold in the sun and when all values are halved."""
    sunny, yellow, road = _yellow_road()
    for light, when in ((1.0, "in the sun"), (0.5, "at half the light")):
        frame = cv2.convertScaleAbs(sunny, alpha=light)
        given = frame.copy()
        verdict = function(answer, [((given,), yellow)], _shape_of_mask)
        if not verdict:
            return verdict
        mask = np.asarray(answer(given)) != 0
        precision, recall = _score(mask & road, yellow)
        if precision >= NEEDED and recall >= NEEDED:
            continue
        other = np.asarray(answer(np.ascontiguousarray(frame[..., ::-1]))) != 0
        if min(_score(other & road, yellow)) >= NEEDED:
            return not_yet("it works on RGB; frames here are BGR: frame_bgr[:, :, 0] is blue")
        found = f"{when} precision is {precision:.2f} and recall {recall:.2f}, {NEEDED} each is needed"
        if min(_score(~mask & road, yellow)) >= NEEDED:
            return not_yet("inverted: what should be set is not, and the other way round")
        if recall >= NEEDED:
            return not_yet(f"{found}: too much passes: white paint, grey road, or differences of uint8 that wrap?")
        if light < 1:
            return not_yet(f"{found}: a number that fits the sun does not fit the shade; compare with the brightness")
        return not_yet(f"{found}: too little passes; which channels of yellow are high, which is low?")
    return right("it holds at half the light, too")


def _shape_of_mask(value, yellow) -> Verdict:
    values = np.asarray(value)
    if values.shape != yellow.shape:
        return array(values, yellow.astype(float))
    if len(np.unique(values)) > 2:
        return not_yet(f"a mask has two values, found {len(np.unique(values))}; compare with a number")
    return right()


def _score(mask: np.ndarray, paint: np.ndarray) -> tuple[float, float]:
    on, painted = mask != 0, paint != 0
    hits = (on & painted).sum()
    return float(hits / max(on.sum(), 1)), float(hits / max(painted.sum(), 1))


@cache
def _yellow_road() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A simulated frame with a yellow and a white line, where its yellow paint is, and where the road is judged."""
    line = Marking(-1.83, "yellow", width_m=0.15, wear=0.0)
    scene = Scene(left=line, right=Marking(1.83, "white", width_m=0.15, wear=0.0), noise=2.0, seed=8)
    frame, truth = render_road(scene)
    height, width = frame.shape[:2]
    yellow, road = np.zeros((height, width), bool), np.zeros((height, width), bool)
    columns = np.arange(width)
    rows = np.arange(230, 340)
    left, right_line = (np.interp(rows, truth["h_samples"], x) for x in truth["lanes"])
    per_m = (right_line - left) / truth["lane_width_m"]
    yellow[rows] = np.abs(columns - left[:, None]) <= (0.075 * per_m + 0.3)[:, None]
    near = (columns > (left - per_m)[:, None]) & (columns < (right_line + per_m)[:, None])
    road[rows] = near & ~((np.abs(columns - left[:, None]) <= (0.075 * per_m + 1.5)[:, None]) & ~yellow[rows])
    return frame, yellow, road
