"""The stills: read the descriptions, build each world, shoot it, write picture and truth."""

import time
import tomllib

import numpy as np

from lanelib.road import CarPose

from .files import is_current, remember, scene_key, update_truth, write_jpeg
from .lens import HERE, ROOT, true_lens
from .shoot import redevelop, shoot, truth_of
from .world import World

FOLDER = ROOT / "test_images" / "rendered"
LIGHT = ROOT / "build" / "light"  # not in git
LOOK = 2  # raise when the code changes what the pictures look like


def merged(base, own):
    """Own values over the layout's; tables are merged, everything else is replaced."""
    out = dict(base)
    for k, v in own.items():
        out[k] = merged(base[k], v) if isinstance(v, dict) and isinstance(base.get(k), dict) else v
    return out


def layouts():
    """The roads of stills.toml by name, each with what it takes from another."""
    found = tomllib.loads((HERE / "scenes" / "stills.toml").read_text())["layouts"]
    for name, layout in found.items():
        if "like" in layout:
            found[name] = merged(found[layout["like"]], layout)
    return found


def describe():
    roads = layouts()
    pictures = tomllib.loads((HERE / "scenes" / "stills.toml").read_text())["picture"]
    return [merged(roads[p["layout"]], p) for p in pictures]


def render_stills(names=None, *, spp=24, force=False, shrink=1, folder=FOLDER):
    """Render the named stills (all if None) whose description changed; truth goes to truth.json beside them.

    The traced light is kept in build/light/: where only the camera or the air changed, it is developed again.
    """
    scenes = describe()
    order = [s["name"] for s in scenes]
    for scene in scenes:
        name, stem = scene["name"], scene["name"].rsplit(".", 1)[0]
        samples, seed = scene.get("spp", spp), scene.get("seed", 1)
        key = scene_key("still", LOOK, scene, true_lens().to_dict(), samples)
        if (names and stem not in names) or (not force and is_current(f"test_images/{name}", key, folder / name)):
            continue
        start, cpu = time.time(), time.process_time()
        traced = {k: v for k, v in scene.items() if k not in ("camera", "air", "tags", "quality")}
        kept = LIGHT / f"{stem}-{scene_key('light', LOOK, traced, true_lens().to_dict(), samples, shrink)}.npz"
        pose = CarPose(0.0, scene["pose"]["d"], scene["pose"]["heading"])
        if kept.exists() and not force:
            with np.load(kept) as z:
                frame = redevelop(z["light"], z["depth"], scene, seed)
            truth = truth_of(World(scene), pose, raw_file=name, tags=scene["tags"])
        else:
            frame, truth = shoot(
                World(scene),
                pose,
                spp=samples,
                seed=seed,
                shrink=shrink,
                raw_file=name,
                tags=scene["tags"],
                max_depth=6,
                keep=kept,
            )
        write_jpeg(folder / name, frame, scene.get("quality", 92))
        update_truth(folder / "truth.json", "frames", truth, order)
        if shrink == 1 and folder == FOLDER:
            remember(f"test_images/{name}", key)
        print(f"{name}: {time.process_time() - cpu:.0f} CPU s, {time.time() - start:.0f} s", flush=True)
