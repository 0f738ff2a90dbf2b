"""dashes: the period of painted dashes, on drawn roads and as a check of the longitudinal scale."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import rig_of_scene

from lanelib.camera import Camera
from lanelib.dashes import DASH_SYSTEMATIC, DashPeriod, dash_likelihood, dash_period
from lanelib.rig import Rig
from lanelib.road import CarPose, Marking, Mounting
from lanelib.simulator import Scene, render_road

MATRIX = ((900.0, 0, 479.5), (0, 900.0, 269.5), (0, 0, 1))
PERIODS = np.geomspace(7.5, 22, 240)


def clip(period_m, n, *, left=None) -> list[Scene]:
    """n frames with a solid (or the given) left and a dashed right line, 7.3 m apart along the road."""
    right = Marking(1.75, dash_m=period_m / 4, gap_m=period_m * 3 / 4, phase_m=2.0)
    left = left or Marking(-1.75, "yellow")
    return [
        Scene(
            left=left,
            right=right,
            others=(),
            pose=CarPose(7.3 * i, 0.1),
            mounting=Mounting(1.5, 3.0, 0, 1.0),
            size_wh=(960, 540),
            camera_matrix=MATRIX,
            distortion=(0,) * 5,
            seed=i,
        )
        for i in range(n)
    ]


@settings(max_examples=30, deadline=None)
@given(st.floats(9, 18), st.floats(0, 1))
def test_a_clean_profile_has_its_period(period, phase):
    y = 1 / np.linspace(1 / 45, 1 / 5, 80)
    weight = ((y / period + phase) % 1 < 0.25).astype(float)
    curve, best = dash_likelihood(y, weight, PERIODS, np.full_like(y, 0.1))
    assert best > 0.8
    # two and a half periods in view, their far edges between samples metres apart: on a fine grid at most 0.096
    assert PERIODS[curve.argmax()] == pytest.approx(period, rel=0.11)


@pytest.mark.parametrize("period_m", [9.0, 12.19, 14.63])
def test_dashes_of_three_countries(period_m):
    scenes = clip(period_m, 4)
    found = dash_period(rig_of_scene(scenes[0]), [render_road(s)[0] for s in scenes])
    assert found and found.n_lines >= 3
    assert found.period_m == pytest.approx(period_m, rel=0.03)
    assert abs(found.period_m - period_m) < 3 * found.std_m < 0.2 * period_m


def test_many_frames_do_not_take_the_systematic_part_away():
    scenes = clip(12.19, 2)
    found = dash_period(rig_of_scene(scenes[0]), [render_road(s)[0] for s in scenes] * 8)
    assert found.n_lines > 8
    assert DASH_SYSTEMATIC <= found.std_m / found.period_m < 1.5 * DASH_SYSTEMATIC


def test_a_wrong_focal_length_shows_in_the_period():
    """Metres along the road are proportional to the focal length that the rig believes in."""
    scenes = clip(12.19, 4)
    frames = [render_road(s)[0] for s in scenes]
    rig = rig_of_scene(scenes[0])
    stretched = rig.birdseye.road_from_image.copy()
    stretched[1] *= 1.15
    wrong = Rig(Camera.ideal((960, 540), focal_px=900 * 1.15), type(rig.birdseye)(stretched, (960, 540)))
    assert dash_period(wrong, frames).period_m == pytest.approx(1.15 * 12.19, rel=0.03)


def test_solid_lines_have_no_period():
    frames = [render_road(s)[0] for s in clip(14.63, 2)]
    rig = rig_of_scene(clip(14.63, 1)[0])
    solid = [render_road(replace(s, right=Marking(1.75)))[0] for s in clip(14.63, 2)]  # the same road, painted through
    found = dash_period(rig, solid)
    assert not found and "no dashed line" in repr(found)
    assert dash_period(rig, frames)


def test_no_lane_no_period():
    rig = rig_of_scene(clip(14.63, 1)[0])
    assert not dash_period(rig, [np.zeros((540, 960, 3), np.uint8)])


def test_the_line_says_what_was_expected():
    text = repr(DashPeriod(14.34, 0.2, 7))
    assert "14.34 +- 0.20 m" in text and "14.63 (California)" in text and "-2.0 %" in text
    assert "12.19 (federal)" in repr(DashPeriod(12.0, 0.2, 1))
    assert "near no norm" in repr(DashPeriod(18.0, 0.2, 1)) and "%" not in repr(DashPeriod(18.0, 0.2, 1))
    assert DashPeriod(18.0, 0.2, 1).compared(18).endswith("measured on 1 line: set to 18 m as given")
    assert tuple(DashPeriod(12.0, 0.2, 1)) == (12.0, 0.2)
