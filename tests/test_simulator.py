"""simulator.py: the paint in the picture lies where the truth says, and a scene is its picture."""

from dataclasses import replace

import numpy as np
import pytest

from lanelib.errors import LanelibError
from lanelib.road import CarPose, Marking, Mounting, Road
from lanelib.simulator import Scene, render_road

CLEAN = {"left": Marking(-1.75, "white", 0.15, wear=0.0), "right": Marking(1.95, "white", 0.15, wear=0.0),
         "others": (), "noise": 0.0}
SCENES = {
    "straight": Scene(**CLEAN),
    "left bend": Scene(road=Road([0, 30], [0, 1 / 160]), pose=CarPose(5.0, 0.4, -0.02), **CLEAN),
    "right bend, tilted camera": Scene(road=Road([0], [-1 / 250]), mounting=Mounting(1.5, 2.5, 1.5, -1.2), **CLEAN),
    "full size": Scene(size_wh=(1280, 720), camera_matrix=((1155, 0, 665.3), (0, 1152, 386.7), (0, 0, 1)), **CLEAN),
}


@pytest.mark.parametrize("name", SCENES)
def test_paint_is_where_the_truth_says(name):
    """The centroid of what is brighter than the asphalt along a row, within 0.5 px of the projected line."""
    scene = SCENES[name]
    frame, truth = render_road(scene)
    grey, misses = frame[..., 1].astype(float), []
    for line in truth["lanes"]:
        for row, x in zip(truth["h_samples"], line, strict=True):
            half = 4 + (row - scene.size_wh[1] * 0.55) * 0.12
            # the window is centred on the pixel, so that a half-filled edge does not pull the centroid
            c = round(x)
            if row < scene.size_wh[1] * 0.62 or x == -2 or not half < c < scene.size_wh[0] - 1 - half:
                continue
            u = np.arange(c - int(half), c + int(half) + 1)
            dark, bright = np.percentile(grey[row, u], 20), grey[row, u].max()
            weight = np.clip(grey[row, u] - dark - 0.4 * (bright - dark), 0, None)  # above the grain of the asphalt
            misses.append((weight @ u) / weight.sum() - x)
    assert len(misses) > 12
    assert np.abs(np.mean(misses)) < 0.15 and np.percentile(np.abs(misses), 95) < 0.5


def test_the_same_scene_is_the_same_picture_and_another_seed_another():
    scene = Scene(shade_m=((8, 20),), concrete_m=((15, 40),))
    a, b = render_road(scene), render_road(scene)
    assert a[0].shape == (360, 640, 3) and a[0].dtype == np.uint8
    assert (a[0] == b[0]).all() and a[1] == b[1]
    assert (render_road(replace(scene, seed=1))[0] != a[0]).mean() > 0.3


def test_light_shade_surface_and_wear_do_what_they_say():
    def paint_to_road(scene):
        frame, truth = render_road(scene)
        rows = np.arange(250, 350, 10)
        x = np.array([round(truth["lanes"][0][truth["h_samples"].index(r)]) for r in rows])
        grey = frame.mean(2)
        return grey[rows, x].mean(), grey[rows, x + 60].mean()

    paint, road = paint_to_road(Scene())
    assert paint > 1.4 * road
    assert paint_to_road(Scene(light=0.35))[1] < 0.75 * road
    assert paint_to_road(Scene(shade_m=((0, 60),)))[1] < 0.8 * road
    assert paint_to_road(Scene(concrete_m=((0, 60),)))[1] > 1.2 * road
    worn = replace(Scene().left, wear=0.9)
    assert paint_to_road(Scene(left=worn))[0] < 0.8 * paint


def test_a_road_without_lines_has_an_empty_truth():
    frame, truth = render_road(Scene(left=None, right=None, others=()))
    assert truth["lanes"] == [] and frame.std() > 10


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(LanelibError, match="flat"):
        render_road(Scene(road=Road([0, 9], [0, 0], [0, 0.1])))
    with pytest.raises(LanelibError, match="folds"):
        render_road(Scene(distortion=(-0.9, 0, 0, 0, 0)))
