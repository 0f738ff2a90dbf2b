"""Checkers and figures of notebook 07."""

import numpy as np
import pytest

from lanelib import exercises
from lanelib.figures import n07


def test_pixels_of_road():
    assert exercises.check_pixels_of_road(
        lambda p, rig: rig.camera.distort_points(rig.birdseye.points_from_road(p))
    )

    def by_hand(points, rig):
        h = np.linalg.inv(rig.birdseye.road_from_image)
        u, v, w = h @ np.column_stack([points, np.ones(len(points))]).T
        return rig.camera.distort_points(np.column_stack([u / w, v / w])).tolist()

    assert exercises.check_pixels_of_road(by_hand)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda p, rig: rig.birdseye.points_from_road(p), "undistorted pixels"),
        (lambda p, rig: rig.camera.undistort_points(rig.birdseye.points_from_road(p)), "wrong way round"),
        (lambda p, rig: rig.camera.distort_points(rig.birdseye.points_from_road(p))[:, ::-1], "order of the last axis"),
        (lambda p, rig: rig.camera.distort_points(rig.birdseye.points_from_road(p))[0], "shape"),
        (lambda p, rig: rig.camera.distort_points(rig.birdseye.road_from_points(p)), "its inverse"),
        (lambda p, rig: None, "return"),
    ],
)
def test_wrong_pixels_of_road(wrong, hint):
    verdict = exercises.check_pixels_of_road(wrong)
    assert not verdict and hint in verdict.hint, verdict


def test_speedup():
    assert exercises.check_speedup(lambda s, f: 1 / ((1 - s) + s / f))
    assert exercises.check_speedup(lambda s, f: f / (f - s * (f - 1)))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda s, f: f / s if s else 1.0, "forgets the rest"),
        (lambda s, f: (1 - s) + s / f, "one divided by it"),
        (lambda s, f: (1 - s) + s * f, "speeds do not"),
        (lambda s, f: 1 / (s + (1 - s) / f), "swapped"),
        (lambda s, f: s * f, "too large"),
        (..., "nothing here"),
    ],
)
def test_wrong_speedup(wrong, hint):
    verdict = exercises.check_speedup(wrong)
    assert not verdict and hint in verdict.hint, verdict


def test_frame_rates():
    assert exercises.check_frame_rates(lambda ms: (1000 / sum(ms), 1000 / max(ms)))
    assert exercises.check_frame_rates(lambda ms: np.array([1e3 / np.sum(ms), 1 / (np.max(ms) / 1e3)]))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda ms: (1000 / sum(ms), 1000 / min(ms)), "slowest sets the pace"),
        (lambda ms: (1000 / sum(ms), 1000 * len(ms) / sum(ms)), "not the mean"),
        (lambda ms: (1 / sum(ms), 1 / max(ms)), "millisecond"),
        (lambda ms: (sum(ms), max(ms)), "milliseconds a frame"),
        (lambda ms: (1000 / max(ms), 1000 / sum(ms)), "order"),
        (lambda ms: 1000 / sum(ms), "shape"),
    ],
)
def test_wrong_frame_rates(wrong, hint):
    verdict = exercises.check_frame_rates(wrong)
    assert not verdict and hint in verdict.hint, verdict


@pytest.mark.parametrize("spans", [[5.0, 2.0, 13.0], [7.0, 1.0, 3.0], [2.0, 9.0, 4.0]])
def test_schedules_take_the_sum_or_the_slowest(spans):
    one = n07._schedule(spans, 6, overlapped=False)
    both = n07._schedule(spans, 6, overlapped=True)
    assert one[-1][-1] + spans[-1] == pytest.approx(6 * sum(spans))
    assert both[-1][-1] + spans[-1] == pytest.approx(sum(spans) + 5 * max(spans))


def test_the_stopwatch_counts_work_and_figures_close():
    much = np.ones((700, 700))
    times = n07.milliseconds({"none": lambda: None, "some": lambda: much @ much}, repeat=2)
    assert 0 <= times["none"] < times["some"]
    import matplotlib.pyplot as plt

    n07.stacked({"a": times, "b": {"x": 1.0}})
    n07.timelines({"decode": 5, "work": 2})
    n07.over_size([5, 10], {"median": [1, 2]})
    assert plt.get_fignums() == []
