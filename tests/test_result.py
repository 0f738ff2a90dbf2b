"""result.py: the row of a result is that of the contract, and -2 wherever a line is not."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import SIZE_WH, Lane7, paint_frame, rig

from lanelib.finder import LaneFinder
from lanelib.lane import Lane, Line
from lanelib.result import LaneResult, line_at_rows

LANE = Lane(Line([-1 / 1200, 0.01, -2.1], (4, 40)), Line([-1 / 1200, 0.01, 1.6], (4, 40)))


def line_px(bottom, top, rows=(719, 430)):
    """A straight line in pixels, near to far."""
    v = np.linspace(*rows, 64)
    return np.column_stack([bottom + (top - bottom) * (719 - v) / (719 - 430), v])


def result(**kwargs):
    given = {
        "lane": LANE,
        "status": "measured",
        "confidence": 0.91234,
        "left_px": line_px(200, 600),
        "right_px": line_px(1100, 680),
        "size_wh": (1280, 720),
        "milliseconds": 3.14159,
    }
    return LaneResult(**(given | kwargs))


def test_the_row_is_that_of_the_contract():
    row = result().to_row("a/b.jpg")
    assert list(row) == [
        "raw_file",
        "h_samples",
        "lanes",
        "run_time",
        "status",
        "reason",
        "confidence",
        "radius_m",
        "curvature_1pm",
        "offset_m",
        "lane_width_m",
    ]
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert (row["raw_file"], row["status"], row["reason"]) == ("a/b.jpg", "measured", "")
    assert row["h_samples"] == list(range(430, 720, 10))
    assert [len(line) for line in row["lanes"]] == [29, 29]
    at = dict(zip(row["h_samples"], row["lanes"][0], strict=True))
    assert at[430] == pytest.approx(600, abs=0.01) and at[710] == pytest.approx(200 + 400 * 9 / 289, abs=0.01)
    assert row["offset_m"] == pytest.approx(0.25)
    assert row["lane_width_m"] == pytest.approx(3.7, abs=0.001)
    assert row["curvature_1pm"] == pytest.approx(1 / 600, rel=1e-3) and row["radius_m"] == pytest.approx(600, abs=0.3)


def test_outside_the_frame_and_beyond_its_end_a_line_is_not_seen():
    row = result(left_px=line_px(-100, 600), right_px=line_px(1500, 680, rows=(719, 500))).to_row("x")
    left, right = (dict(zip(row["h_samples"], line, strict=True)) for line in row["lanes"])
    assert row["h_samples"] == list(
        range(430, 680, 10)
    )  # where any of the two is seen: below, both have left the frame
    assert left[670] > 0 and left[430] == 600
    assert right[490] == right[430] == -2 and right[500] > 0 and right[650] == -2
    seen = [x for x in (*left.values(), *right.values()) if x != -2]
    assert all(0 <= x <= 1279 for x in seen)


def test_a_straight_lane_has_no_radius_but_null():
    straight = Lane(Line([0, 0, -1.8]), Line([0, 0, 1.8]))
    row = result(lane=straight).to_row("x")
    assert row["radius_m"] is None and row["curvature_1pm"] == 0
    assert result(lane=straight).radius_m == np.inf


def test_without_a_lane_there_is_the_reason():
    none = LaneResult(None, "none", "fog")
    assert not none and none.lane is None
    assert none.radius_m is none.offset_m is none.width_m is none.curvature_1pm is None
    row = none.to_row("x")
    assert (row["h_samples"], row["lanes"], row["status"], row["reason"]) == ([], [], "none", "fog")
    assert all(row[k] is None for k in ("radius_m", "curvature_1pm", "offset_m", "lane_width_m"))
    assert "fog" in repr(none) and "3.70 m wide" in repr(result())


def test_lines_may_be_worked_out_when_they_are_asked_for():
    """Once, and as if they had been there from the beginning."""
    calls = []

    def left():
        calls.append("left")
        return line_px(200, 600)

    late = result(left_px=left)
    assert calls == [] and late.offset_m == pytest.approx(0.25)
    assert late.to_row("x") == result().to_row("x")
    np.testing.assert_array_equal(late.left_px, line_px(200, 600))
    assert calls == ["left"]
    for copy in (replace(result(left_px=left), reason="copied"), pickle.loads(pickle.dumps(result(left_px=left)))):
        np.testing.assert_array_equal(copy.left_px, line_px(200, 600))
    with pytest.raises(AttributeError):
        late.left_px = line_px(0, 0)
    assert LaneResult(None, "none").right_px.shape == (0, 2)


def test_with_neighbours_too_lines_are_worked_out_when_they_are_asked_for():
    finder = LaneFinder(rig(), track=False, neighbours=1)
    found = finder.process(paint_frame(Lane7(width=3.6)))
    assert found.status == "measured" and callable(vars(found)["_left_px"])


def test_the_time_of_a_row_is_in_milliseconds():
    assert result(milliseconds=3.14159).to_row("x")["run_time"] == 3.142


def test_the_finders_lines_are_those_of_its_view():
    finder = LaneFinder(rig(), track=False)
    found = finder.process(paint_frame(Lane7(centre=0.2, heading=0.02, bend=-1 / 400, width=3.5)))
    left, right = finder.view(SIZE_WH).lines_px(found.lane)
    np.testing.assert_array_equal(found.left_px, left)
    np.testing.assert_array_equal(found.right_px, right)
    assert len(left) > 20 and found.milliseconds > 0


def test_beyond_a_crest_a_line_does_not_come_back():
    over = np.array([[200, 700], [400, 560], [500, 500], [520, 510], [530, 530.0]])
    x = line_at_rows(over, np.array([520, 560, 500, 490]), 1280)
    assert x == [pytest.approx(400 + 100 * 40 / 60, abs=0.01), 400, 500, -2]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-3000, 3000), st.floats(-500, 1500)), max_size=12), st.integers(1, 2000))
def test_any_points_give_x_inside_the_frame_or_minus_two(points, width):
    x = line_at_rows(np.array(points, float).reshape(-1, 2), np.arange(0, 720, 10), width)
    assert len(x) == 72 and all(v == -2 or 0 <= v <= width - 1 for v in x)


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-4, 3), st.floats(-5, 5), st.integers(2, 40))
def test_between_its_points_a_line_is_interpolated(slope, shift, n):
    v = np.linspace(700, 450, n)
    points = np.column_stack([600 + shift + slope * (700 - v) * 0.5, v])
    rows = np.arange(460, 700, 7)
    expected = 600 + shift + slope * (700 - rows) * 0.5
    inside = expected <= 1279
    found = np.array(line_at_rows(points, rows, 1280))
    np.testing.assert_allclose(found[inside], expected[inside], atol=0.006)
    assert (found[~inside] == -2).all()
