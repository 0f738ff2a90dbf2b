"""Strangers: motorways that nobody chose, seen by cameras that nobody calibrated. For tools/strangers.py; not shipped.

Each camera has a focal length, a lens, a height and angles of its own, and takes five pictures of roads drawn by lot:
three to five lanes and the car in any of them, dashes or Botts' dots or both, paint from fresh to nearly gone, asphalt
or concrete, sun from any side or overcast and wet, cars, cracks, a barrier. Number n is the same picture on every run.
"""

import json

import numpy as np

from lanelib.road import CarPose

from .files import write_jpeg, write_json
from .lens import ROOT, Lens
from .shoot import shoot
from .stills import layouts, merged
from .world import World, mounting_of

FOLDER = ROOT / "build" / "strangers"  # not in git
PICTURES = 5  # of each camera
UNSEEN = 12  # the pictures of the cameras before this one were looked at while the finder was made
SIZE_WH = (1280, 720)


def camera_of(rng) -> tuple[Lens, dict, dict]:
    """(lens, mounting, camera): a dashboard camera of 50 to 80 degrees, and how it develops its pictures."""
    f = rng.uniform(750, 1350)
    matrix = [[f, 0, 640 + rng.uniform(-15, 15)], [0, f * rng.uniform(0.995, 1.005), 360 + rng.uniform(-15, 15)]]
    lens = Lens(np.array([*matrix, [0, 0, 1]]), np.array([rng.uniform(-0.12, 0.02), 0, 0, 0, 0]), SIZE_WH)
    mounting = {
        "height_m": rng.uniform(1.15, 1.75),
        "pitch_deg": rng.uniform(-4, 4),
        "roll_deg": rng.normal(0, 0.5),
        "yaw_deg": rng.normal(0, 1.2),
    }
    develops = {
        "blur_px": rng.uniform(0.5, 1.2),
        "noise": rng.uniform(0.002, 0.005),
        "saturation": rng.uniform(0.8, 1.2),
        "contrast": rng.uniform(1, 1.25),
    }
    return lens, mounting, develops | {"bonnet": rng.random() < 0.4}


def markings_of(rng, left_m: float, lanes: int, own: int, width_m: float, style: str) -> list[dict]:
    """The lines from left to right: edges solid, between the lanes dashes, dots, or both; ours are told by `lane`."""
    phase, lines = rng.uniform(0, 14), []
    for k in range(lanes + 1):
        d, ours = left_m + k * width_m, {own: {"lane": "left"}, own + 1: {"lane": "right"}}.get(k, {})
        if k in (0, lanes):
            lines.append({"d": d, "width": 0.15, "color": "white" if k else "yellow"} | ours)
            continue
        if "dash" in style:
            reflectors = bool(rng.random() < 0.4)
            dash = {"d": d, "dash": 3.66, "gap": 10.97, "phase": phase + rng.normal(0, 0.5), "reflectors": reflectors}
            lines.append(dash | ours)
        if "dots" in style:  # Botts' dots: four, 1.22 m apart, every 14.63 m
            first = phase + (5.5 if "dash" in style else 0.0)
            for i in range(4):
                glue = {"d": d, "width": 0.10, "dash": 0.10, "gap": 14.53, "phase": first + 1.22 * i, "rgb": [0.03] * 3}
                lines.append(glue | {"dome": True} | (ours if "dash" not in style and i == 0 else {}))
    return lines


def traffic_of(rng, left_m: float, lanes: int, own: int, width_m: float) -> list[dict]:
    """Cars in every lane, in ours from 22 m on."""
    cars = []
    for k in range(lanes):
        s = rng.uniform(14, 50) if k != own else rng.uniform(22, 70)
        while s < 180 and rng.random() < 0.75:
            paint = np.clip(rng.choice([0.02, 0.1, 0.4, 0.6]) * (1 + 0.2 * rng.normal(size=3)), 0, 0.8).tolist()
            d = left_m + (k + 0.5) * width_m + rng.normal(0, 0.2)
            cars.append({"s": s, "d": d, "shape": str(rng.choice(["saloon", "suv"])), "rgb": paint})
            s += rng.uniform(14, 60)
    return cars


def road_of(number: int, mounting: dict, develops: dict) -> dict:
    """The description of picture `number`, as those of scenes/stills.toml."""
    rng = np.random.default_rng(number)
    lanes = int(rng.integers(3, 6))
    own, width_m = int(rng.integers(0, lanes)), rng.uniform(3.4, 3.75)
    left_m = -(own + 0.5) * width_m
    edges = [left_m - rng.uniform(0.6, 3), left_m + lanes * width_m + rng.uniform(1, 3.5)]
    style, sunny = str(rng.choice(["dash", "dots", "dots+dash"], p=[0.55, 0.2, 0.25])), rng.random() < 0.75
    wet, concrete, wear = not sunny and rng.random() < 0.5, rng.random() < 0.5, rng.uniform(0.15, 0.7)
    bend = rng.choice([0, rng.uniform(-1, 1) / 900])
    sun = {"kind": "clear", "elevation": rng.uniform(12, 65), "azimuth": rng.uniform(0, 360), "turbidity": 3.0}
    wood = {"number": 90, "species": ["oak", "gum", "bush"], "clear": rng.uniform(2, 9), "depth": 16, "seed": number}
    surface = {
        "seed": number,
        "age": rng.uniform(0.1, 0.9),
        "wear": wear,
        "oil": rng.uniform(0.5, 1.3),
        "cracks": rng.uniform(0, 0.8),
        "markings": markings_of(rng, left_m, lanes, own, width_m, style),
        "tar": [
            {"d": rng.uniform(-2.5, 2.5), "width": 0.06, "wobble": 0.04, "scale": float(rng.choice([1, 6]))}
            for _ in range(rng.integers(0, 3))
        ],
    }
    surface |= {"concrete": [[-60, 800]], "seams": rng.uniform(0.3, 1.6)} if concrete else {}
    surface |= {"wet": 1.0, "smoothest": 0.2, "specular": 0.5} if wet else {}
    tags = [style, "concrete" if concrete else "asphalt", "sun" if sunny else "overcast", *(["wet"] if wet else [])]
    tags += ["worn"] if wear > 0.5 else []
    own_camera = {k: v for k, v in develops.items() if k != "bonnet"}
    exposure = (2.9 if sunny else 3.9) * float(np.exp(rng.normal(0, 0.2)))
    return merged(layouts()["motorway_left"], {
        "name": f"{number:03d}.jpg", "seed": number, "tags": tags, "edges": edges,
        "opposite": [edges[0] - 18, edges[0] - 1.2] if rng.random() < 0.7 else [],
        "road": {"stations": [0, 80], "curvature": [bend, bend + rng.uniform(-1, 1) * 6e-4]},
        "pose": {"d": rng.normal(0, 0.25), "heading": rng.normal(0, 0.006)},
        "mounting": mounting,
        "barriers": [{"kind": str(rng.choice(["jersey", "guardrail"])), "d": edges[0] - 0.5}] * (rng.random() < 0.7),
        "sky": sun if sunny else {"kind": "overcast", "level": 0.16, "clouds": 0.2},
        "woods": [wood | {"from": rng.uniform(5, 60)}], "grass": {"number": 3000, "left": 0.3},
        "hood": {"show": develops["bonnet"]}, "camera": own_camera | {"exposure": exposure},
        "cars": traffic_of(rng, left_m, lanes, own, width_m), "surface": surface,
    })


def render_strangers(cameras: int, *, first=UNSEEN, spp=6, folder=FOLDER):
    """Five pictures of each of so many cameras into a folder of its own, with truth.json and the true rig.json; what
    is there stays."""
    for c in range(first, first + cameras):
        lens, mounting, develops = camera_of(np.random.default_rng(50_000 + c))
        here = folder / f"{c:02d}"
        if (here / "truth.json").exists():
            continue
        frames = []
        for number in range(PICTURES * c, PICTURES * (c + 1)):
            scene = road_of(number, mounting, develops)
            horizon = lens.camera_matrix[1, 2] - lens.camera_matrix[1, 1] * np.tan(np.deg2rad(mounting["pitch_deg"]))
            rows = range(max(0, int(horizon) // 10 * 10), SIZE_WH[1], 10)
            pose = CarPose(0.0, scene["pose"]["d"], scene["pose"]["heading"])
            about = {"raw_file": scene["name"], "tags": scene["tags"], "lens": lens, "h_samples": rows}
            frame, truth = shoot(World(scene), pose, spp=spp, seed=number, **about)
            write_jpeg(here / scene["name"], frame)
            frames.append(truth)
            print(f"{here.name}/{scene['name']}: {', '.join(scene['tags'])}", flush=True)
        rig = {"format": "lanelib-rig/1", "name": f"stranger {here.name}", "camera": lens.to_dict()}
        h = mounting_of({"mounting": mounting}).road_from_image(lens.camera_matrix)
        write_json(here / "rig.json", rig | {"road_from_image": h.tolist()})
        document = {"format": "lanelib-truth/1", "camera": lens.to_dict(), "frames": frames}
        write_json(here / "truth.json", json.loads(json.dumps(document, default=float)))  # last: the folder is whole
