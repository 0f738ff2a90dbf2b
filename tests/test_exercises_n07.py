"""Checkers and figures of notebook 07."""

import subprocess
import sys

import numpy as np
import pytest

from lanelib import exercises
from lanelib.figures import n07
from lanelib.figures.style import INK


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
        (lambda p, rig: rig.camera.distort_points(p), "these are metres"),
        (lambda p, rig: rig.birdseye.points_from_road(rig.camera.distort_points(p)), "the other order"),
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
        (lambda s, f: s * f, "times do add up"),
        (lambda s, f: f, "quick part alone"),
        (lambda s, f: 1 / ((1 - s) + s / f) - 1, "one less than"),
        (..., "nothing here"),
    ],
)
def test_wrong_speedup(wrong, hint):
    verdict = exercises.check_speedup(wrong)
    assert not verdict and hint in verdict.hint, verdict


def test_frame_rates():
    assert exercises.check_frame_rates(lambda ms: (1000 / sum(ms), 1000 / max(ms)))
    assert exercises.check_frame_rates(lambda ms: [int(1000 / sum(ms)), int(1000 / max(ms))])
    assert exercises.check_frame_rates(lambda ms: np.array([1e3 / np.sum(ms), 1 / (np.max(ms) / 1e3)]))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda ms: (1000 / sum(ms), 1000 / min(ms)), "slowest sets the pace"),
        (lambda ms: (1000 / sum(ms), 1000 / ms[-1]), "need not be the last"),
        (lambda ms: (1000 / sum(ms), 1000 * len(ms) / sum(ms)), "not the mean"),
        (lambda ms: (1 / sum(ms), 1 / max(ms)), "millisecond"),
        (lambda ms: (sum(ms), max(ms)), "milliseconds a frame"),
        (lambda ms: (1000 / max(ms), 1000 / sum(ms)), "order"),
        (lambda ms: 1000 / sum(ms), "2 numbers are needed"),
        (lambda ms: (1000 / sum(ms), sum(1000 / one for one in ms)), "do not add up"),
        (lambda ms: (1000 / sum(ms), 1000 / sum(ms)), "do not wait for their sum"),
        (lambda ms: (60 / sum(ms), 60 / max(ms)), "not 60"),
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


@pytest.mark.skipif(sys.platform == "win32", reason="counts page faults as Unix does")
def test_the_stopwatch_does_not_count_how_memory_is_fetched():
    """A new process gives back all that a step needed, and fetches it one page fault at a time at its next call."""
    code = """if True:
        import resource
        import numpy as np
        from lanelib.figures import n07
        faults = []
        def step():
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            arrays = [np.ones(6 << 20, np.uint8) for _ in range(5)]
            del arrays
            faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
        n07.milliseconds({"step": step}, repeat=4)
        print(faults[-1])
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 100  # of 7680 pages


def test_what_costs_more_is_told_from_calls_in_turn():
    some, much = np.ones((100, 100)), np.ones((400, 400))
    assert n07.more_ms(lambda: much @ much, than=lambda: some @ some, repeat=9) > 0.1
    assert n07.more_ms(lambda: some @ some, than=lambda: much @ much, repeat=9) < -0.1
    assert abs(n07.more_ms(lambda: some @ some, than=lambda: some @ some)) < 0.05


def test_a_step_has_one_colour_in_all_bars_and_is_named():
    orders = {"textbook": {"undistort": 5.0, "warp": 0.2, "draw": 2.0}, "ours": {"warp": 0.3, "draw the polygon": 0.5}}
    figure = n07.stacked(orders)
    bars = [tuple(patch.get_facecolor()) for patch in figure.axes[0].patches]
    assert bars[1] == bars[3] and bars[2] == bars[4] and len(set(bars)) == 3
    assert [text.get_text() for text in figure.legends[0].texts] == ["undistort", "warp", "draw", "draw the polygon"]


@pytest.mark.parametrize(
    ("colour", "letters"),
    [("#000000", "#ffffff"), ("#0072b2", "#ffffff"), ("#d55e00", "#ffffff"), ("#56b4e9", INK), ("#ffffff", INK)],
)
def test_letters_can_be_read_on_their_colour(colour, letters):
    assert n07.ink_on(colour) == letters
