"""Road simulator: a road of your making, seen by a camera, and what the pipeline says about it."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from lanelib import draw, threshold
from lanelib.birdseye import BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.draw.panels import pixels_of_road
from lanelib.explore.detection import lane_readings, stacked
from lanelib.explore.kit import Explorer, button, choice, counter, slider, tick
from lanelib.explore.look import Look, Reading
from lanelib.finder import LaneFinder
from lanelib.jointfit import PITCH
from lanelib.rig import Rig
from lanelib.road import CarPose, Marking, Mounting, Road
from lanelib.scores import frame_score
from lanelib.simulator import Scene, render_road

SIZE_WH = (480, 270)  # 30 ms a picture; the finder looks at 301 x 112 points of it anyway
LANE_M = 3.66
SHADE_M = ((8.0, 26.0),)
CONCRETE_M = ((15.0, 60.0),)
GRID = Grid.uniform(x_range_m=(-6, 6), y_range_m=(3, 43), size_wh=(240, 360))  # of the view from above


def scene_of(
    *,
    bend_1pkm: float = 0.0,
    offset_m: float = 0.0,
    heading_deg: float = 0.0,
    pitch_deg: float = 0.0,
    wear: float = 0.2,
    light: float = 1.0,
    noise: float = 2.5,
    along_m: float = 0.0,
    shade: bool = False,
    concrete: bool = False,
) -> Scene:
    """The scene of the simulator's controls. ``bend_1pkm``: curvature in 1/km, positive to the left; ``offset_m``:
    the car, positive right of the lane's centre; ``pitch_deg``: how much the car nods beyond what the rig knows."""
    base = Scene()
    scale = SIZE_WH[0] / base.size_wh[0]
    camera = Camera(np.array(base.camera_matrix), np.array(base.distortion), base.size_wh).scaled(SIZE_WH)
    half, dashes = LANE_M / 2, {"gap_m": 10.97, "wear": wear}
    here = [(a + along_m, b + along_m) for a, b in SHADE_M] if shade else ()
    slab = [(a + along_m, b + along_m) for a, b in CONCRETE_M] if concrete else ()
    return Scene(
        road=Road([0], [bend_1pkm / 1000]),
        left=Marking(-half, "yellow", wear=wear),
        right=Marking(half, "white", phase_m=7.0, **dashes),
        others=(Marking(3 * half, "white", phase_m=7.9, **dashes),),
        pose=CarPose(along_m, offset_m, np.deg2rad(heading_deg)),
        mounting=Mounting(base.mounting.height_m, base.mounting.pitch_deg + pitch_deg),
        size_wh=SIZE_WH,
        camera_matrix=tuple(map(tuple, camera.camera_matrix.tolist())),
        light=light,
        shade_m=tuple(here),
        concrete_m=tuple(slab),
        noise=noise * min(1.0, scale * 2),
    )


@lru_cache(maxsize=1)
def simulated_rig() -> Rig:
    """The rig of the simulator's camera on a car that does not nod."""
    scene = scene_of()
    camera = Camera(np.array(scene.camera_matrix), np.array(scene.distortion), scene.size_wh)
    angles = {"height_m": scene.mounting.height_m, "pitch_deg": scene.mounting.pitch_deg}
    return Rig(camera, BirdsEye.from_mounting(camera, **angles), "simulated")


@lru_cache(maxsize=8)
def _finder(recipe: str) -> LaneFinder:
    return LaneFinder(simulated_rig(), recipe=recipe, track=False)


def simulator_look(*, recipe: str = threshold.DEFAULT_RECIPE, **state) -> Look:
    """The simulated frame with the lane that was found, the road from above with the true lines in white, and the
    estimate beside the truth. ``state``: the arguments of `scene_of`."""
    frame, truth = render_road(scene_of(**state))
    finder = _finder(recipe)
    result = finder.process(frame)
    view = finder.view(SIZE_WH)
    above = cv2.remap(frame, *_table(), cv2.INTER_LINEAR)
    # on the rig's flat plane the true lines lie where the nodding camera shows them
    nodding = view.rig.birdseye.pitched(view.rig.camera, np.deg2rad(state.get("pitch_deg", 0.0)))
    for line in truth["lanes_road_m"]:
        ahead = np.array([(x, y) for x, y in line if y > 2])
        on = view.rig.birdseye.road_from_points(nodding.points_from_road(ahead))
        above = draw.draw_line(above, pixels_of_road(GRID, on[(on[:, 1] > 0) & (on[:, 1] < 60)]), "text", width_px=3)
    above = draw.birdseye(above, GRID, lane=result.lane)
    large = cv2.resize(draw.overlay(frame, result, text=False), (640, 360), interpolation=cv2.INTER_CUBIC)
    picture = draw.side_by_side([large, above], ["lane as found", "from above; truth in white"], height=360, cap_px=10)
    score = frame_score(truth, result.to_row("simulated") if result else None, view.rig.camera)
    errors = np.concatenate(score.errors_px) if score.errors_px else np.empty(0)
    errors = errors[np.isfinite(errors)]
    centre = 100 * np.abs(score.lateral_m).mean(axis=0)
    pitch = float(np.rad2deg(result.fit.mean[PITCH])) if result.fit is not None else None
    readings = [
        *lane_readings(result, truth),
        Reading("nod of the car", pitch, "°", 2, state.get("pitch_deg", 0.0), signed=True),
        Reading("confidence", 100 * result.confidence, "%", 0),
        Reading("error in the frame", float(errors.mean()) if len(errors) else None, "px of 1280", 1),
        Reading("error at 10 m", float(centre[1]), "cm", 1),
        Reading("error at 20 m", float(centre[2]), "cm", 1),
    ]
    return Look(stacked([picture]), tuple(readings))


@lru_cache(maxsize=1)
def _table():
    rig = simulated_rig()
    return rig.birdseye.table(rig.camera, GRID)


def simulator(**start) -> Explorer:
    """Explore a simulated road; ``start``: values that controls begin with (the arguments of `scene_of`, `recipe`)."""
    controls = {
        "bend_1pkm": slider(
            "bend, 1/km", 0, -12, 12, 0.1, digits=1, tip="curvature, positive to the left; 5 is R 200 m"
        ),
        "offset_m": slider("offset, m", 0, -1.5, 1.5, 0.05, tip="the car's place, positive right of the centre"),
        "heading_deg": slider("heading, °", 0, -4, 4, 0.1, digits=1, tip="where the lane leads, positive to the right"),
        "pitch_deg": slider(
            "nod, °", 0, -2, 2, 0.05, tip="the car's nose down (positive) or up; the rig does not know"
        ),
        "wear": slider("wear of paint", 0.2, 0, 1, 0.02, tip="0 is new paint, 1 is none"),
        "light": slider("light", 1.0, 0.02, 2.5, 0.02, tip="1 is full sun"),
        "noise": slider("noise", 2.5, 0, 30, 0.5, digits=1, tip="standard deviation in grey levels"),
        "along_m": counter("along, m", 0, 0, 400, tip="drive along the road: the dashes move"),
        "recipe": choice("recipe", tuple(threshold.RECIPES), threshold.DEFAULT_RECIPE),
        "shade": tick("shade of trees"),
        "concrete": tick("concrete ahead"),
    }
    for name, value in start.items():
        controls[name].value = value
    first = {name: control.value for name, control in controls.items()}
    reset = button("Reset", lambda: explorer.set(**first), tip="all controls as at the start")
    explorer = Explorer(
        "Road simulator",
        simulator_look,
        controls,
        buttons=[reset],
        alt="simulated road with the lane found, and the road from above",
    )
    return explorer
