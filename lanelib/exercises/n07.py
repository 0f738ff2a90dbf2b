"""Checkers of notebook 07."""

from __future__ import annotations

import cv2
import numpy as np

from lanelib.birdseye import BirdsEye, rotation_from_angles
from lanelib.camera import Camera
from lanelib.exercises.judges import array, function, never_raises, not_yet, number
from lanelib.rig import Rig

_MATRIX = np.array([[900.0, 0, 640], [0, 905, 350], [0, 0, 1]])
_LENS = np.array([-0.28, 0.09, 0.001, -0.0005, 0.0])
_POINTS_M = np.array([[-1.8, 6.0], [1.9, 6.0], [-1.8, 25.0], [3.4, 14.0], [0.0, 40.0]])


@never_raises
def check_pixels_of_road(answer):
    """Road points (N, 2), metres, to pixels of the frame as given, through homography and lens."""
    camera = Camera(_MATRIX, _LENS, (1280, 720))
    rig = Rig(camera, BirdsEye.from_mounting(camera, height_m=1.4, pitch_deg=4.0, yaw_deg=-1.0))
    rotation = rotation_from_angles(pitch_deg=4.0, yaw_deg=-1.0)
    road = np.column_stack([_POINTS_M, np.zeros(len(_POINTS_M))])
    vector = cv2.Rodrigues(rotation)[0]
    shift = -rotation @ np.array([0, 0, 1.4])
    expected = cv2.projectPoints(road, vector, shift, _MATRIX, _LENS)[0].reshape(-1, 2)
    plain = cv2.projectPoints(road, vector, shift, _MATRIX, None)[0].reshape(-1, 2)

    mistakes = {
        "the lens knows pixels, and these are metres: first `rig.birdseye.points_from_road`":
            camera.distort_points(_POINTS_M),
        "the other order: first from the road to undistorted pixels, then through the lens":
            rig.birdseye.points_from_road(camera.distort_points(_POINTS_M)),
    }

    def judge(value, wanted):
        if np.shape(value) == np.shape(wanted):
            if np.isnan(np.asarray(value, float)).any():
                return not_yet("some pixels are NaN: no place on the road ahead; are x and y in order? And "
                               "`road_from_points` is for pixels, its inverse is needed here")
            if np.abs(np.asarray(value, float) - plain).max() < 0.5:
                return not_yet("these are undistorted pixels; the lens comes after: `rig.camera.distort_points`")
            if np.abs(np.asarray(value, float) - camera.undistort_points(plain)).max() < 0.5:
                return not_yet("the lens the wrong way round: from the road to the frame as given a point is distorted")
        return array(value, wanted, unit="px", rel=0, tolerance=0.55, columns="x, y", mistakes=mistakes)  # whole pixels

    return function(answer, [((_POINTS_M, rig), expected)], judge)


@never_raises
def check_speedup(answer):
    """Amdahl's law: how many times faster everything gets when a share of it gets ``factor`` times faster."""
    share, factor = 0.6, 10.0
    mistakes = {
        "this forgets the rest, which takes as long as before: 1 - share": factor / share,
        "this is the new time as a part of the old one; the speed-up is one divided by it":
            (1 - share) + share / factor,
        "this is the mean of speeds; times add up, speeds do not": (1 - share) + share * factor,
        "this is the gain of the quick part alone; the rest takes as long as before": factor,
        "the rest alone is left: that is the limit for an endless factor": 1 / (1 - share),
        "a part that gets faster takes *less* time: divide by the factor": 1 / ((1 - share) + share * factor),
        "this is the time saved, as a part of the old one; old time by new time is asked": share - share / factor,
        "by how much more is one less than how many times": 1 / ((1 - share) + share / factor) - 1,
        "speeds do not add up, times do: what is the new time, if the old one is 1?": 1 + share * factor,
        "times do add up: the old one is 1 = (1 - share) + share; what is the new one?": share * factor,
        "the rest is 1 - share; here rest and share are swapped": 1 / (share + (1 - share) / factor),
    }

    def judge(value, expected):
        return number(value, expected, mistakes=mistakes if abs(expected - 1 / 0.46) < 1e-9 else {})

    cases = [((share, factor), 1 / 0.46), ((0.5, 1e9), 2.0), ((0.0, 7.0), 1.0), ((1.0, 7.0), 7.0)]
    return function(answer, cases, judge)


@never_raises
def check_frame_rates(answer):
    """Frames a second of stages (ms) one after the other, and overlapped: a pair."""
    slips = {
        "for the second: the stages work at the same time, and the slowest sets the pace":
            lambda ms: (1000 / sum(ms), 1000 / min(ms)),
        "for the second: the slowest stage sets the pace, and that need not be the last":
            lambda ms: (1000 / sum(ms), 1000 / ms[-1]),
        "for the second: not the mean; the others wait for the slowest":
            lambda ms: (1000 / sum(ms), 1000 * len(ms) / sum(ms)),
        "for the second: rates of stages do not add up; each frame goes through all of them":
            lambda ms: (1000 / sum(ms), sum(1000 / one for one in ms)),
        "for the first: rates of stages do not add up, their times do":
            lambda ms: (sum(1000 / one for one in ms), 1000 / max(ms)),
        "for the first: a frame takes the sum of the times, not their mean":
            lambda ms: (1000 * len(ms) / sum(ms), 1000 / max(ms)),
        "for the second: stages that overlap do not wait for their sum": lambda ms: (1000 / sum(ms),) * 2,
        "for the first: one after the other, the times add up": lambda ms: (1000 / max(ms),) * 2,
        "frames a millisecond; a second has 1000 of them": lambda ms: (1 / sum(ms), 1 / max(ms)),
        "a second has 1000 milliseconds, not 60": lambda ms: (60 / sum(ms), 60 / max(ms)),
        "these are milliseconds a frame; frames a second are 1000 divided by them": lambda ms: (sum(ms), max(ms)),
    }
    cases = [((ms,), np.array([1000 / sum(ms), 1000 / max(ms)])) for ms in ([5.0, 2.0, 13.0], [9.0, 2.0, 4.0])]
    # whole frames will do
    return function(answer, cases, array, unit="frames a second", rel=0.01, tolerance=1.0, slips=slips,
                    columns="one after the other, overlapped")
