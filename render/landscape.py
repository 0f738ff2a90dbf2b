"""The ground beside the road and the hills behind it."""

import numpy as np

from .noise import fractal
from .surface import procedural
from .tracer import grid_faces, mesh, mi


def height(world, s, d):
    """Height of the ground beside the road above the road."""
    hills = world.scene.get("hills", {})
    left, right = world.outer
    u = np.maximum(0, np.where(d > 0, d - right, left - d))
    lumps = np.clip(0.75 + 0.45 * fractal(s, d, 300 + world.scene.get("seed", 1), 3, 840.0), 0.05, 3)
    rise = np.where(d > 0, hills.get("right", 10.0), hills.get("left", 8.0))
    z = rise * np.clip((u - hills.get("flat", 4.0)) / 60, 0, 1.6) ** 1.25 * lumps
    ditch = hills.get("ditch", 0.25) * np.exp(-(((u - 2.5) / 1.3) ** 2))
    bank = hills.get("bank", 0.0) * np.clip((u - 1.5) / 5, 0, 1) ** 1.5
    return (
        z
        + bank
        - ditch
        - 0.05 * np.minimum(u, 1)
        + 0.06 * fractal(s, d, 350, 3, 18.0) * np.clip(u, 0, 1)
        + 0.35 * fractal(s, d, 360, 4, 110.0) * np.clip((u - 6) / 10, 0, 1)
    )


def terrain(world):
    """Ground on both sides, a plain beyond it, three rings of hills."""
    ground = {
        "type": "twosided",
        "b": {"type": "diffuse", "reflectance": procedural("ground_albedo", world.scene.get("ground", {}))},
    }
    bend = np.abs(world.road.curvatures_1pm).max()
    reach = min(190.0, 0.8 / bend if bend > 0 else 190.0)
    steps = np.r_[np.arange(0, 6, 0.5), np.arange(6, 30, 1.5), np.arange(30, 191, 4)]
    for name, side in (("ground_left", -1), ("ground_right", 1)):
        edge = world.outer[0] if side < 0 else world.outer[1]
        d = edge + side * steps[steps <= reach + 6]
        s = world.stations(1.0, 5.0)
        s2, d2 = np.meshgrid(s, d, indexing="ij")
        points = world.at(s2, d2, height(world, s2, d2))
        faces = grid_faces(len(s), len(d))
        world.parts[name] = mesh(
            name, points.reshape(-1, 3), faces if side < 0 else faces[:, ::-1], ground, smooth=True
        )
    plain = (
        mi.ScalarTransform4f().translate([0, 300, float(world.road.elevation(world.s1)) - 2.0]).scale([6000, 6000, 1])
    )
    world.parts["plain"] = {"type": "rectangle", "to_world": plain, "bsdf": ground}
    far = world.scene.get("hills", {}).get("far", 1.0)
    for k, (radius, tall, color) in enumerate(
        ((900, 30, (0.105, 0.11, 0.065)), (1900, 95, (0.085, 0.10, 0.070)), (4200, 240, (0.07, 0.085, 0.07)))
    ):
        a = np.linspace(-np.pi, np.pi, 1400)
        crest = tall * far * np.clip(0.5 + 0.36 * fractal(a * 90 + 77 * k, 0 * a + 3.0, 500 + k, 6, 260.0), 0.04, 2)
        ring = np.c_[np.sin(a), np.cos(a)] * radius
        points = np.concatenate(
            [np.c_[ring * f, crest * z - 25 * (z == 0)] for f, z in ((1, 0), (1.03, 0.5), (1.06, 1))]
        )
        points[:, 1] += 250
        mottle = 1 + 0.25 * fractal(np.tile(a * 900, 3), np.repeat([0, 30, 60], 1400), 520 + k, 4, 90.0)
        world.parts[f"hill{k}"] = mesh(
            "hill",
            points,
            grid_faces(3, 1400),
            {
                "type": "twosided",
                "b": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}},
            },
            colors=np.clip(np.array(color) * mottle[:, None], 0.02, 0.5),
        )
