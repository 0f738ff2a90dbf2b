"""The stills: read the descriptions, build each world, shoot it, write picture and truth."""

import time
import tomllib

from lanelib.road import CarPose

from .files import is_current, remember, scene_key, update_truth, write_jpeg
from .lens import HERE, ROOT, true_lens
from .shoot import shoot
from .world import World

FOLDER = ROOT / "test_images" / "rendered"
LOOK = 1  # raise when the code changes what the pictures look like


def merged(base, own):
    """Own values over the layout's; tables are merged, everything else is replaced."""
    out = dict(base)
    for k, v in own.items():
        out[k] = merged(base[k], v) if isinstance(v, dict) and isinstance(base.get(k), dict) else v
    return out


def describe():
    about = tomllib.loads((HERE / "scenes" / "stills.toml").read_text())
    for name, layout in about["layouts"].items():
        if "like" in layout:
            about["layouts"][name] = merged(about["layouts"][layout["like"]], layout)
    return [merged(about["layouts"][p["layout"]], p) for p in about["picture"]]


def render_stills(names=None, *, spp=24, force=False, shrink=1, folder=FOLDER):
    scenes = describe()
    order = [s["name"] for s in scenes]
    for scene in scenes:
        name = scene["name"]
        key = scene_key("still", LOOK, scene, true_lens().to_dict(), spp)
        if names and name.rsplit(".", 1)[0] not in names:
            continue
        if not force and is_current(f"test_images/{name}", key, folder / name):
            continue
        start, cpu = time.time(), time.process_time()
        world = World(scene)
        built = time.process_time()
        pose = CarPose(0.0, scene["pose"]["d"], scene["pose"]["heading"])
        frame, truth, exposure = shoot(world, pose, spp=scene.get("spp", spp), seed=scene.get("seed", 1), shrink=shrink,
                                       raw_file=name, tags=scene["tags"])
        write_jpeg(folder / name, frame, scene.get("quality", 92))
        update_truth(folder / "truth.json", "frames", truth, order)
        if shrink == 1 and folder == FOLDER:
            remember(f"test_images/{name}", key)
        print(f"{name}: {world.garden.triangles / 1e6:.1f} M triangles of plants, build {built - cpu:.0f} CPU s, in all "
              f"{time.process_time() - cpu:.0f} CPU s, {time.time() - start:.0f} s, exposure {exposure:.2f}", flush=True)
