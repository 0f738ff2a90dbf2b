"""What was built beside the road: barriers, guard rails, walls, signs, bridges, poles."""

import numpy as np

from .noise import tile
from .tracer import bitmap, box, by_material, glossy, grid_faces, mesh, rgb


def furniture(world):
    """Barriers, rails, signs, bridges and poles of the scene."""
    for k, b in enumerate(world.scene.get("barriers", [])):
        KINDS[b["kind"]](world, k, b)
    for k, sign in enumerate(world.scene.get("signs", [])):
        _sign(world, k, sign)
    for k, bridge in enumerate(world.scene.get("overpasses", [])):
        _overpass(world, k, bridge)
    concrete, steel = [], []
    for pole in world.scene.get("poles", []):
        for s in np.arange(pole["from"], pole["to"], pole["every"]):
            base = world.at(s, pole["d"], 0)
            p, f = box(-0.09, 0.09, -0.09, 0.09, 0, pole.get("height", 9.0))
            steel.append((p + base, f, glossy((0.30, 0.31, 0.31), 0.5, 0.5, 0.4)))
    for k, part in enumerate(by_material(concrete + steel)):
        world.parts[f"pole{k}"] = part
    _domes(world)


def _jersey(world, k, b):
    d, dark = b["d"], b.get("tone", 0.30)
    t = dark * (1 + 0.03 * tile(91, 1, 1) + 0.06 * tile(92, 6, 2) + 0.10 * tile(93, 30, 3))
    texture = bitmap(np.clip(t, 0.02, 0.6)[..., None] * np.array([1, 0.97, 0.91]))
    profile = [(d - 0.35, 0), (d - 0.35, 0.08), (d - 0.18, 0.33), (d - 0.10, 0.81),
               (d + 0.10, 0.81), (d + 0.18, 0.33), (d + 0.35, 0.08), (d + 0.35, 0)]
    tall = b.get("height", 0.81) / 0.81
    world.sweep(
        f"jersey{k}",
        [(x, z * tall) for x, z in profile],
        {"type": "twosided", "b": {"type": "diffuse", "reflectance": texture}},
        uv_scale=0.12,
        s0=b.get("from"),
        s1=b.get("to"),
    )
    if b.get("rail"):
        world.sweep(
            f"rail{k}",
            [(d - 0.05, 1.02), (d - 0.05, 1.14), (d + 0.05, 1.14), (d + 0.05, 1.02), (d - 0.05, 1.02)],
            glossy((0.45, 0.46, 0.47), 0.45, 0.5, 0.5),
        )
        _posts(world, f"railposts{k}", d, 2.5, (0.07, 0.06), (0.8, 1.08), (0.4, 0.4, 0.4))


def _guardrail(world, k, b):
    d, side = b["d"], -np.sign(b["d"])
    wave = [(0.02, 0.45), (-0.03, 0.49), (-0.03, 0.53), (0.03, 0.58),
            (0.03, 0.62), (-0.03, 0.67), (-0.03, 0.71), (0.02, 0.75)]
    world.sweep(
        f"beam{k}",
        [(d - side * x, z) for x, z in wave],
        glossy((0.42, 0.43, 0.44), 0.42, 0.5, 0.65),
        s0=b.get("from"),
        s1=b.get("to"),
    )
    _posts(world, f"beamposts{k}", d - side * 0.12, 1.9, (0.08, 0.06), (-0.2, 0.72), (0.22, 0.18, 0.14))


def _wall(world, k, b):
    d, h = b["d"], b.get("height", 2.5)
    t = b.get("tone", 0.25) * (1 + 0.08 * tile(94, 1, 1) + 0.15 * tile(95, 3, 40) + 0.12 * tile(96, 30, 12))
    texture = bitmap(np.clip(t, 0.02, 0.6)[..., None] * np.array([1, 0.96, 0.88]))
    world.sweep(
        f"wall{k}",
        [(d, -0.1), (d, h), (d + 0.3 * np.sign(d), h)],
        {"type": "twosided", "b": {"type": "diffuse", "reflectance": texture}},
        uv_scale=0.07,
        s0=b.get("from"),
        s1=b.get("to"),
    )


def _posts(world, name, d, every, half, z, color):
    points, faces = [], []
    for i, s in enumerate(np.arange(world.s0 + 5, world.s1 - 300, every)):
        p, f = box(-half[0], half[0], -half[1], half[1], *z)
        points.append(p + world.at(s, d))
        faces.append(f + 8 * i)
    world.parts[name] = mesh(name, np.vstack(points), np.vstack(faces), glossy(color, 0.6))


DOME_M, DOME_HIGH_M = 0.05, 0.019  # radius and height of a Botts' dot: 4 inches across, 3/4 inch high


def _domes(world):
    """Botts' dots: markings with ``dome`` stand up from the road, which is what makes them seen from afar; the older
    the paint, the more are dirty or gone."""
    surface = world.scene["surface"]
    lines = [m for m in surface["markings"] if m.get("dome")]
    if not lines:
        return
    rng, wear = np.random.default_rng(world.scene.get("seed", 1)), surface.get("wear", 0.3)
    rise, turn = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2 * np.pi, 13))
    out, up = DOME_M * np.cos(rise * np.pi / 2), DOME_HIGH_M * np.sin(rise * np.pi / 2)
    cap = np.stack([out * np.cos(turn), out * np.sin(turn), up], -1).reshape(-1, 3)
    points, faces, colors = [], [], []
    for m in lines:
        period, first = m["dash"] + m["gap"], m.get("phase", 0.0) + m["dash"] / 2
        for s in first + period * np.arange(np.ceil((world.s0 - first) / period), (world.s1 - first) / period):
            gone, dirt = rng.random() < 0.5 * wear**2, rng.uniform(0, 0.7) * wear
            if not gone:
                faces.append(grid_faces(*rise.shape) + len(cap) * len(points))
                points.append(cap + world.at(s, m["d"]))
                colors.append(np.full((len(cap), 3), 0.72 * (1 - dirt)) * (1, 0.99, 0.95))
    ceramic = glossy((1, 1, 1), 0.3)
    ceramic["b"]["base_color"] = {"type": "mesh_attribute", "name": "vertex_color"}
    world.parts["domes"] = mesh("domes", np.vstack(points), np.vstack(faces), ceramic, colors=np.vstack(colors))


def _sign(world, k, sign):
    """A board on a post: kind = "diamond" (yellow warning) or "board" (green, white rim)."""
    z, w, h = sign.get("z", 2.2), sign.get("width", 0.9), sign.get("height", 0.9)
    beside = abs(sign["d"]) > world.outer[1]  # else it stands on the road
    z0 = float(world.height(np.array([sign["s"]]), np.array([sign["d"]]))[0]) if beside else 0.0
    base = world.at(sign["s"], sign["d"]) + [0, 0, z0]
    theta = float(world.road.heading(sign["s"]))
    right, up = np.array([np.cos(theta), np.sin(theta), 0]), np.array([0, 0, 1.0])
    color = sign.get("rgb", [0.75, 0.42, 0.02] if sign["kind"] == "diamond" else [0.02, 0.20, 0.08])
    turn = np.array([[1, 1], [-1, 1]]) / np.sqrt(2) if sign["kind"] == "diamond" else np.eye(2)
    for j, (scale, c) in enumerate(
        ((1.0, (0.72, 0.72, 0.70) if sign["kind"] == "board" else (0.02, 0.02, 0.02)), (0.94, color))
    ):
        q = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2 * scale @ turn.T
        back = -0.012 * j * np.array([-np.sin(theta), np.cos(theta), 0])
        points = base + back + [0, 0, z + h / 2] + q[:, :1] * right + q[:, 1:] * up
        world.parts[f"sign{k}{j}"] = mesh("sign", points, [[0, 1, 2], [0, 2, 3]], glossy(c, 0.45, 0.4))
    if sign["kind"] == "board":  # lines of text seen from too far to read
        rng, n = np.random.default_rng(k), 0
        for row in np.linspace(0.25, -0.25, max(1, round(h / 0.6))):
            x = -0.38 * w
            while x < 0.3 * w:
                length = rng.uniform(0.05, 0.16) * w
                low, high = row * h - 0.07 * h, row * h + 0.07 * h
                q = np.array([[x, low], [x + length, low], [x + length, high], [x, high]])
                front = -0.03 * np.array([-np.sin(theta), np.cos(theta), 0])
                points = base + [0, 0, z + h / 2] + front + q[:, :1] * right + q[:, 1:] * up
                white = glossy((0.6, 0.6, 0.58), 0.5)
                world.parts[f"text{k}_{n}"] = mesh("text", points, [[0, 1, 2], [0, 2, 3]], white)
                x, n = x + length * 1.12, n + 1
    for j, x in enumerate((0.0,) if w < 1.5 else (-w / 3, w / 3)):
        p, f = box(-0.05, 0.05, -0.05, 0.05, -0.5, z + 0.1)
        world.parts[f"signpost{k}{j}"] = mesh(
            "post", p + base + x * right + [0, 0.06, 0], f, glossy((0.35, 0.33, 0.30), 0.6)
        )


def _overpass(world, k, o):
    s, depth, clear = o["s"], o.get("depth", 13.0), o.get("clear", 5.4)
    theta = float(world.road.heading(s)) + np.radians(o.get("skew", 0.0))
    turn = np.array([[np.cos(theta), -np.sin(theta), 0], [np.sin(theta), np.cos(theta), 0], [0, 0, 1]])
    origin = world.at(s, 0.0)
    left, right = world.outer
    t = o.get("tone", 0.33) * (1 + 0.06 * tile(97, 1, 1) + 0.10 * tile(98, 4, 40) + 0.08 * tile(99, 30, 12))
    concrete = {
        "type": "twosided",
        "b": {"type": "diffuse", "reflectance": rgb(np.array([1, 0.95, 0.88]) * float(t.mean()))},
    }
    boxes = [
        (-90, 90, 0, depth, clear, clear + 1.1),
        (-90, 90, -0.2, 0.1, clear + 0.9, clear + 2.3),
        (-90, 90, depth - 0.1, depth + 0.2, clear + 0.9, clear + 2.3),
    ]
    for x in o.get("piers", [left - 2.5, right + 2.0, world.scene["edges"][0] - 0.6]):
        boxes += [(x - 0.5, x + 0.5, depth * f - 0.6, depth * f + 0.6, -0.5, clear + 0.2) for f in (0.25, 0.75)]
    for side, edge in ((-1, left), (1, right)):  # abutments: slopes of concrete
        boxes += [tuple(sorted((edge + side * 9, edge + side * 14))) + (-2, depth + 2, -0.5, clear + 0.2)]
    parts = [(box(*b)[0] @ turn.T + origin, box(*b)[1], concrete) for b in boxes]
    for j, part in enumerate(by_material(parts)):
        world.parts[f"bridge{k}{j}"] = part


KINDS = {"jersey": _jersey, "guardrail": _guardrail, "wall": _wall}
