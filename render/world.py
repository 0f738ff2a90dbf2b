"""From a scene description (a table of scenes/*.toml) to a Mitsuba scene.

World axes: x right and y ahead at s = 0, z up. Everything beside the road is placed in (s, d), metres along the
reference line (the middle of the lane the camera is in) and to the right of it.
"""

import json

import numpy as np

from lanelib.road import CarPose, Marking, Mounting, Road

from .noise import fractal, tile
from .plants import Garden
from .surface import procedural, road_bsdf
from .tracer import bitmap, diffuse, glossy, grid_faces, mesh, mi, rgb
from .vehicles import _box, car

AHEAD_M, BEHIND_M = 620.0, 45.0


class World:
    """One built scene: `mitsuba` (loaded), `road`, and the hood's pieces. Static but for cars and the camera."""

    def __init__(self, scene: dict, *, s_from=0.0, s_to=0.0, moving=False):
        r = scene["road"]
        self.scene = scene
        self.road = Road(r["stations"], r["curvature"], r.get("grade"), s_min_m=s_from - BEHIND_M - 60,
                         s_max_m=s_to + AHEAD_M + 400)
        self.s0, self.s1 = s_from - BEHIND_M, s_to + AHEAD_M
        self.rng = np.random.default_rng(scene.get("seed", 1))
        self.parts = {"type": "scene"}
        self.garden = Garden()
        self.lights()
        self.pavement()
        self.terrain()
        self.furniture()
        self.plants(s_from, s_to)
        self.parts.update(self.garden.meshes())
        self.group = None
        for k, part in enumerate([] if moving else _by_material(self.cars_at(0.0))):
            self.parts[f"car{k}"] = part

    # --- helpers -------------------------------------------------------------------------------------------------
    def at(self, s, d, z=0.0):
        """World points (..., 3)."""
        s, d, z = np.broadcast_arrays(np.asarray(s, float), d, z)
        return np.concatenate([self.road.point(s, d), (self.road.elevation(s) + z)[..., None]], -1)

    def stations(self, near=1.0, far=5.0, s0=None, s1=None):
        s0, s1 = self.s0 if s0 is None else s0, self.s1 if s1 is None else s1
        fine = np.arange(s0, min(s1, s0 + BEHIND_M + 160 + (self.s1 - AHEAD_M - self.s0 - BEHIND_M)), near)
        return np.concatenate([fine, np.arange(fine[-1] + far, s1 + far, far)]) if fine[-1] < s1 - far else fine

    def sweep(self, name, profile, bsdf, *, near=1.0, far=5.0, s0=None, s1=None, uv_scale=1.0, uv_is_sd=False):
        """A profile [(d, z), ...] drawn along the road."""
        s, profile = self.stations(near, far, s0, s1), np.asarray(profile, float)
        points = self.at(s[:, None], profile[None, :, 0], profile[None, :, 1])
        if uv_is_sd:
            uv = np.stack(np.broadcast_arrays(s[:, None], profile[None, :, 0]), -1)
        else:
            length = np.r_[0, np.cumsum(np.hypot(*np.diff(profile, axis=0).T))]
            uv = np.stack(np.broadcast_arrays(s[:, None] * uv_scale, length[None] * uv_scale), -1)
        self.parts[name] = mesh(name, points.reshape(-1, 3), grid_faces(len(s), len(profile))[:, ::-1], bsdf,
                                uv=uv.reshape(-1, 2))

    # --- light ---------------------------------------------------------------------------------------------------
    def lights(self):
        sky = self.scene["sky"]
        kind = sky.get("kind", "clear")
        if kind == "clear":
            el, az = np.radians([sky["elevation"], sky["azimuth"]])  # azimuth: clockwise from ahead at s = 0
            sun = [float(np.cos(el) * np.sin(az)), float(np.cos(el) * np.cos(az)), float(np.sin(el))]
            self.parts["sky"] = {"type": "sunsky", "sun_direction": sun, "turbidity": sky.get("turbidity", 3.0),
                                 "albedo": 0.2, "sun_scale": sky.get("sun", 1.0), "sky_scale": sky.get("sky", 1.0)}
            self.sun = sun
        else:  # overcast or night: a painted dome
            h, w = 128, 256
            v = np.linspace(0, np.pi, h)[:, None]
            up = np.clip(np.cos(v), 0, 1)
            x, y = np.broadcast_arrays(np.arange(w)[None] * 2.0, np.arange(h)[:, None] * 3.0)
            cloud = fractal(x, y, 900 + self.scene.get("seed", 1), 4, 512.0)
            dome = (0.85 + 0.45 * up) * (1 + sky.get("clouds", 0.12) * cloud)  # thin overcast: little brighter overhead
            dome = np.clip(dome, 0.02, None)[..., None] * np.array(sky.get("rgb", [0.95, 1.0, 1.08]))
            to_world = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
            self.parts["sky"] = {"type": "envmap", "bitmap": mi.Bitmap((dome * sky.get("level", 0.12)).astype(np.float32)),
                                 "to_world": to_world}

    def headlights(self, world_from_car):
        """Low beams, for the night: two spots 0.65 m above the road."""
        out = {}
        for k, x in enumerate((-0.62, 0.62)):
            o = world_from_car @ np.array([x, 1.9, 0.66, 1])
            target = world_from_car @ np.array([x + 0.9, 40.0, -0.15, 1])
            look = mi.ScalarTransform4f().look_at(origin=o[:3].tolist(), target=target[:3].tolist(), up=[0, 0, 1])
            out[f"beam{k}"] = {"type": "spot", "to_world": look, "intensity": rgb([26.0, 24.5, 21.5]), "cutoff_angle": 34.0,
                               "beam_width": 5.0}
        return out

    # --- road and ground ------------------------------------------------------------------------------------------
    def pavement(self):
        left, right = self.scene["edges"]
        tight = np.abs(self.road.curvatures_1pm).max() > 1 / 300
        bend = 0.25 if tight else 0.5
        columns = np.linspace(left, right, 7)
        self.sweep("road", np.c_[columns, 0 * columns], road_bsdf(self.scene["surface"]), near=bend, far=2 * bend, uv_is_sd=True)
        opposite = self.scene.get("opposite")
        if opposite:
            asphalt = dict(self.scene["surface"], markings=[{"d": opposite[1] - 0.9, "color": "yellow"},
                                                            {"d": opposite[1] - 4.6, "dash": 3.66, "gap": 10.97}], tar=[])
            self.sweep("opposite", [(opposite[0], -0.01), (opposite[1], -0.01)], road_bsdf(asphalt), near=1, uv_is_sd=True)
            self.sweep("median", [(opposite[1], -0.02), (left, -0.02)], diffuse((0.17, 0.145, 0.11)))

    def height(self, s, d):
        """Height of the ground beside the road above the road."""
        hills = self.scene.get("hills", {})
        left, right = self.outer
        u = np.maximum(0, np.where(d > 0, d - right, left - d))
        lumps = np.clip(0.75 + 0.45 * fractal(s, d, 300 + self.scene.get("seed", 1), 3, 840.0), 0.05, 3)
        rise = np.where(d > 0, hills.get("right", 10.0), hills.get("left", 8.0))
        z = rise * np.clip((u - hills.get("flat", 4.0)) / 60, 0, 1.6) ** 1.25 * lumps
        ditch = hills.get("ditch", 0.25) * np.exp(-(((u - 2.5) / 1.3) ** 2))
        bank = hills.get("bank", 0.0) * np.clip((u - 1.5) / 5, 0, 1) ** 1.5
        return z + bank - ditch - 0.05 * np.minimum(u, 1) + 0.06 * fractal(s, d, 350, 3, 18.0) * np.clip(u, 0, 1) \
            + 0.35 * fractal(s, d, 360, 4, 110.0) * np.clip((u - 6) / 10, 0, 1)

    @property
    def outer(self):
        left, right = self.scene["edges"]
        return (self.scene["opposite"][0] if self.scene.get("opposite") else left), right

    def terrain(self):
        ground = {"type": "twosided", "b": {"type": "diffuse",
                                            "reflectance": procedural("ground_albedo", self.scene.get("ground", {}))}}
        bend = np.abs(self.road.curvatures_1pm).max()
        reach = min(190.0, 0.8 / bend if bend > 0 else 190.0)
        steps = np.r_[np.arange(0, 6, 0.5), np.arange(6, 30, 1.5), np.arange(30, 191, 4)]
        for name, side in (("ground_left", -1), ("ground_right", 1)):
            edge = self.outer[0] if side < 0 else self.outer[1]
            d = edge + side * steps[steps <= reach + 6]
            s = self.stations(1.0, 5.0)
            s2, d2 = np.meshgrid(s, d, indexing="ij")
            points = self.at(s2, d2, self.height(s2, d2))
            faces = grid_faces(len(s), len(d))
            self.parts[name] = mesh(name, points.reshape(-1, 3), faces if side < 0 else faces[:, ::-1], ground, smooth=True)
        plain = mi.ScalarTransform4f().translate([0, 300, float(self.road.elevation(self.s1)) - 2.0]).scale([6000, 6000, 1])
        self.parts["plain"] = {"type": "rectangle", "to_world": plain, "bsdf": ground}
        far = self.scene.get("hills", {}).get("far", 1.0)
        for k, (radius, tall, color) in enumerate(((900, 30, (0.105, 0.11, 0.065)), (1900, 95, (0.085, 0.10, 0.070)),
                                                   (4200, 240, (0.07, 0.085, 0.07)))):
            a = np.linspace(-np.pi, np.pi, 1400)
            crest = tall * far * np.clip(0.5 + 0.36 * fractal(a * 90 + 77 * k, 0 * a + 3.0, 500 + k, 6, 260.0), 0.04, 2)
            ring = np.c_[np.sin(a), np.cos(a)] * radius
            points = np.concatenate([np.c_[ring * f, crest * z - 25 * (z == 0)] for f, z in ((1, 0), (1.03, .5), (1.06, 1))])
            points[:, 1] += 250
            mottle = 1 + 0.25 * fractal(np.tile(a * 900, 3), np.repeat([0, 30, 60], 1400), 520 + k, 4, 90.0)
            self.parts[f"hill{k}"] = mesh("hill", points, grid_faces(3, 1400), {
                "type": "twosided", "b": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}},
                colors=np.clip(np.array(color) * mottle[:, None], 0.02, 0.5))

    # --- things that were built -----------------------------------------------------------------------------------
    def furniture(self):
        for k, b in enumerate(self.scene.get("barriers", [])):
            getattr(self, "_" + b["kind"])(k, b)
        for k, sign in enumerate(self.scene.get("signs", [])):
            self._sign(k, sign)
        for k, bridge in enumerate(self.scene.get("overpasses", [])):
            self._overpass(k, bridge)
        concrete, steel = [], []
        for pole in self.scene.get("poles", []):
            for s in np.arange(pole["from"], pole["to"], pole["every"]):
                base = self.at(s, pole["d"], 0)
                p, f = _box(-.09, .09, -.09, .09, 0, pole.get("height", 9.0))
                steel.append((p + base, f, glossy((.30, .31, .31), .5, .5, .4)))
        for k, part in enumerate(_by_material(concrete + steel)):
            self.parts[f"pole{k}"] = part

    def _jersey(self, k, b):
        d, dark = b["d"], b.get("tone", 0.30)
        t = dark * (1 + 0.03 * tile(91, 1, 1) + 0.06 * tile(92, 6, 2) + 0.10 * tile(93, 30, 3))
        texture = bitmap(np.clip(t, 0.02, 0.6)[..., None] * np.array([1, 0.97, 0.91]))
        profile = [(d - .35, 0), (d - .35, .08), (d - .18, .33), (d - .10, .81), (d + .10, .81), (d + .18, .33), (d + .35, .08), (d + .35, 0)]
        tall = b.get("height", 0.81) / 0.81
        self.sweep(f"jersey{k}", [(x, z * tall) for x, z in profile], {"type": "twosided", "b": {"type": "diffuse", "reflectance": texture}},
                   uv_scale=0.12, s0=b.get("from"), s1=b.get("to"))
        if b.get("rail"):
            self.sweep(f"rail{k}", [(d - .05, 1.02), (d - .05, 1.14), (d + .05, 1.14), (d + .05, 1.02), (d - .05, 1.02)],
                       glossy((.45, .46, .47), .45, .5, .5))
            self._posts(f"railposts{k}", d, 2.5, (.07, .06), (.8, 1.08), (.4, .4, .4))

    def _guardrail(self, k, b):
        d, side = b["d"], -np.sign(b["d"])
        wave = [(.02, .45), (-.03, .49), (-.03, .53), (.03, .58), (.03, .62), (-.03, .67), (-.03, .71), (.02, .75)]
        self.sweep(f"beam{k}", [(d - side * x, z) for x, z in wave], glossy((.42, .43, .44), .42, .5, .65), s0=b.get("from"), s1=b.get("to"))
        self._posts(f"beamposts{k}", d - side * .12, 1.9, (.08, .06), (-.2, .72), (.22, .18, .14))

    def _wall(self, k, b):
        d, h = b["d"], b.get("height", 2.5)
        t = b.get("tone", 0.25) * (1 + 0.08 * tile(94, 1, 1) + 0.15 * tile(95, 3, 40) + 0.12 * tile(96, 30, 12))
        texture = bitmap(np.clip(t, 0.02, 0.6)[..., None] * np.array([1, 0.96, 0.88]))
        self.sweep(f"wall{k}", [(d, -.1), (d, h), (d + .3 * np.sign(d), h)], {"type": "twosided", "b": {"type": "diffuse", "reflectance": texture}},
                   uv_scale=0.07, s0=b.get("from"), s1=b.get("to"))

    def _posts(self, name, d, every, half, z, color):
        points, faces = [], []
        for i, s in enumerate(np.arange(self.s0 + 5, self.s0 + 60 + (self.s1 - self.s0 - AHEAD_M) + 260, every)):
            p, f = _box(-half[0], half[0], -half[1], half[1], *z)
            points.append(p + self.at(s, d))
            faces.append(f + 8 * i)
        self.parts[name] = mesh(name, np.vstack(points), np.vstack(faces), glossy(color, .6))

    def _sign(self, k, sign):
        """A board on a post: kind = "diamond" (yellow warning) or "board" (green, white rim)."""
        base, z, w, h = self.at(sign["s"], sign["d"]), sign.get("z", 2.2), sign.get("width", 0.9), sign.get("height", 0.9)
        z0 = float(self.height(np.array([sign["s"]]), np.array([sign["d"]]))[0]) if abs(sign["d"]) > self.outer[1] else 0.0
        base = base + [0, 0, z0]
        theta = float(self.road.heading(sign["s"]))
        right, up = np.array([np.cos(theta), np.sin(theta), 0]), np.array([0, 0, 1.0])
        color = sign.get("rgb", [.75, .42, .02] if sign["kind"] == "diamond" else [.02, .20, .08])
        turn = np.array([[1, 1], [-1, 1]]) / np.sqrt(2) if sign["kind"] == "diamond" else np.eye(2)
        for j, (scale, c) in enumerate(((1.0, (.72, .72, .70) if sign["kind"] == "board" else (.02, .02, .02)), (0.94, color))):
            q = np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2 * scale @ turn.T
            back = -0.012 * j * np.array([-np.sin(theta), np.cos(theta), 0])
            points = base + back + [0, 0, z + h / 2] + q[:, :1] * right + q[:, 1:] * up
            self.parts[f"sign{k}{j}"] = mesh("sign", points, [[0, 1, 2], [0, 2, 3]], glossy(c, .45, .4))
        if sign["kind"] == "board":  # lines of text seen from too far to read
            rng, n = np.random.default_rng(k), 0
            for row in np.linspace(0.25, -0.25, max(1, round(h / 0.6))):
                x = -0.38 * w
                while x < 0.3 * w:
                    length = rng.uniform(0.05, 0.16) * w
                    q = np.array([[x, row * h - .07 * h], [x + length, row * h - .07 * h], [x + length, row * h + .07 * h], [x, row * h + .07 * h]])
                    points = base + [0, 0, z + h / 2] - 0.03 * np.array([-np.sin(theta), np.cos(theta), 0]) + q[:, :1] * right + q[:, 1:] * up
                    self.parts[f"text{k}_{n}"] = mesh("text", points, [[0, 1, 2], [0, 2, 3]], glossy((.6, .6, .58), .5))
                    x, n = x + length * 1.12, n + 1
        for j, x in enumerate((0.0,) if w < 1.5 else (-w / 3, w / 3)):
            p, f = _box(-.05, .05, -.05, .05, -.5, z + 0.1)
            self.parts[f"signpost{k}{j}"] = mesh("post", p + base + x * right + [0, 0.06, 0], f, glossy((.35, .33, .30), .6))

    def _overpass(self, k, o):
        s, depth, clear = o["s"], o.get("depth", 13.0), o.get("clear", 5.4)
        theta = float(self.road.heading(s)) + np.radians(o.get("skew", 0.0))
        turn = np.array([[np.cos(theta), -np.sin(theta), 0], [np.sin(theta), np.cos(theta), 0], [0, 0, 1]])
        origin = self.at(s, 0.0)
        left, right = self.outer
        t = o.get("tone", .33) * (1 + 0.06 * tile(97, 1, 1) + 0.10 * tile(98, 4, 40) + 0.08 * tile(99, 30, 12))
        concrete = {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(np.array([1, .95, .88]) * float(t.mean()))}}
        boxes = [(-90, 90, 0, depth, clear, clear + 1.1), (-90, 90, -.2, .1, clear + .9, clear + 2.3), (-90, 90, depth - .1, depth + .2, clear + .9, clear + 2.3)]
        for x in o.get("piers", [left - 2.5, right + 2.0, self.scene["edges"][0] - .6]):
            boxes += [(x - .5, x + .5, depth * f - .6, depth * f + .6, -.5, clear + .2) for f in (.25, .75)]
        for side, edge in ((-1, left), (1, right)):  # abutments: slopes of concrete
            boxes += [tuple(sorted((edge + side * 9, edge + side * 14))) + (-2, depth + 2, -.5, clear + .2)]
        parts = [(_box(*b)[0] @ turn.T + origin, _box(*b)[1], concrete) for b in boxes]
        for j, part in enumerate(_by_material(parts)):
            self.parts[f"bridge{k}{j}"] = part

    # --- things that grow -----------------------------------------------------------------------------------------
    def plants(self, s_from, s_to):
        q = self.scene
        for species, s, d, size, *variant in q.get("trees", []):
            self._plant(species, s, d, size, s_from, s_to, variant[0] if variant else 0)
        for wood in q.get("woods", []):
            rng = np.random.default_rng(wood.get("seed", 5))
            for _ in range(wood["number"]):
                s = rng.uniform(wood.get("from", s_from + 20), wood.get("to", s_to + 520))
                u = wood.get("clear", 3.5) + rng.gamma(wood.get("shape", 1.6), wood.get("depth", 14.0))
                side = {"left": -1, "right": 1}.get(wood.get("side"), rng.choice([-1, 1]))
                d = self.outer[1] + u if side > 0 else self.outer[0] - u
                species = wood["species"][rng.integers(len(wood["species"]))]
                self._plant(species, s, d, rng.uniform(*wood.get("size", (0.6, 1.15))), s_from, s_to, int(rng.integers(3)))
        grass = q.get("grass", {"number": 6000})
        per_cell = grass["number"] // 12  # number: tufts in the first 120 m, cells of 10 m seeded by their place
        for cell in range(int(s_from // 10), int((s_to + 130) // 10)):
            rng = np.random.default_rng(9000 + cell)
            s, side = 10 * (cell + rng.random(per_cell)), rng.random(per_cell) < grass.get("left", 0.25)
            u = 0.3 + rng.gamma(1.3, 2.6, per_cell)
            size = rng.uniform(0.6, 1.5, per_cell) * grass.get("size", 1.0)
            d = np.where(side, self.outer[0] - u, self.outer[1] + u)
            z = self.height(s[None], d[None])[0]
            at = self.at(s, d, z)
            for i in range(int(per_cell * np.clip(1.15 - (10 * cell - s_to) / 130, 0.15, 1.0))):
                self.garden.grass(at[i], variant=i % 3, size=size[i])

    def _plant(self, species, s, d, size, s_from, s_to, variant):
        turn, tone = self.rng.uniform(0, 6.28), self.rng.uniform(0.8, 1.2)
        if not self.s0 < s < self.s1:
            return
        z = float(self.height(np.array([[s]]), np.array([[d]]))[0, 0])
        away = max(0.0, s - s_to) + (0 if s > s_from else s_from - s) if s_to > s_from else np.hypot(s - s_from, d)
        self.garden.plant(species, self.at(s, d, z), away_m=away, variant=variant, size=size, turn=turn, tone=tone,
                          simpler=self.scene.get("simpler", 0))

    # --- traffic and the car the camera is in -----------------------------------------------------------------------
    def cars_at(self, time_s):
        """[(points, faces, bsdf)] of all cars at a moment: each has s, d, speed (m/s), rgb, shape."""
        parts = []
        for c in self.scene.get("cars", []):
            s = c["s"] + c.get("speed", 0.0) * time_s
            if not self.s0 + 10 < s < self.s1 - 10:
                continue
            d = c["d"] + c.get("drift", 0.0) * time_s
            ahead = -1.0 if c.get("oncoming") else 1.0
            theta = float(self.road.heading(s)) - c.get("drift", 0.0) / max(c.get("speed", 25.0), 5.0)
            forward = ahead * np.array([-np.sin(theta), np.cos(theta), 0])
            left = np.array([-forward[1], forward[0], 0])
            m = np.stack([forward, left, [0, 0, 1]], 1)
            origin = self.at(s, d)
            parts += [(p @ m.T + origin, f, b) for p, f, b in car(tuple(c.get("rgb", (.03, .03, .03))), c.get("shape", "saloon"))]
        return parts

    def tail_lamps(self, time_s=0.0):
        """Glowing lamps for the night: small disks at each car."""
        out = {}
        for k, c in enumerate(self.scene.get("cars", [])):
            s = c["s"] + c.get("speed", 0.0) * time_s
            theta = float(self.road.heading(s))
            behind = np.array([np.sin(theta), -np.cos(theta), 0])
            side = np.array([np.cos(theta), np.sin(theta), 0])
            white = c.get("oncoming")
            for j, x in enumerate((-.66, .66)):
                o = self.at(s, c["d"], .66 if white else .82) + side * x + behind * (5.0 if white else .08)
                look = mi.ScalarTransform4f().look_at(origin=o.tolist(), target=(o + behind).tolist(), up=[0, 0, 1])
                size = .075 if white else .085
                out[f"lamp{k}{j}"] = {"type": "disk", "to_world": look.scale([size, size, 1]), "emitter": {
                    "type": "area", "radiance": rgb([160, 150, 130] if white else [7.0, .25, .12])}}
        return out

    def hood(self, world_from_car):
        """The bonnet at the lower edge of the frame: dull dark red paint that mirrors the sky."""
        h = self.scene.get("hood", {})
        u, v = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(0, 1, 30), indexing="ij")
        x, y = u * 1.02, 0.5 + v * 1.2
        z = 0.956 - 0.10 * v**2 - 0.045 * u**2 - 0.03 * np.maximum(0, v - 0.85) * 8
        z = z + 0.014 * np.exp(-(((np.abs(u) - 0.52) / 0.09) ** 2)) + 0.004 * np.sin(5 * u + 1)
        points = np.stack([x, y, z + h.get("raise", 0.0), np.ones_like(x)], -1).reshape(-1, 4) @ np.asarray(world_from_car).T
        return {"hood": mesh("hood", points[:, :3], grid_faces(80, 30), glossy(h.get("rgb", (.075, .043, .036)), .5, .5, .1, .2),
                             smooth=True)}

    def load(self, pose: CarPose, *, time_s=None, mounting=None):
        """The Mitsuba scene with the hood (and, for clips, the cars) where they are at this moment."""
        m = pose.world_from_car(self.road)
        parts = dict(self.parts)
        if time_s is not None:  # what stands still is put into one group, so that only the rest is built anew
            if self.group is None:
                lights = {k: v for k, v in parts.items() if k == "sky"}
                self.group = mi.load_dict({"type": "shapegroup", **{k: v for k, v in parts.items() if k not in ("sky", "type")}})
                self.parts = {"type": "scene", **lights}
            parts = {**self.parts, "group": self.group, "still": {"type": "instance", "group": self.group}}
        if self.scene.get("hood", {}).get("show", True):  # the bonnet moves with the camera, both sit on the same body
            nominal = camera_pose(np.eye(4), mounting_of(self.scene))
            parts.update(self.hood(camera_pose(m, mounting or mounting_of(self.scene)) @ np.linalg.inv(nominal)))
        if self.scene["sky"].get("kind") == "night":
            parts.update(self.headlights(m))
            parts.update(self.tail_lamps(time_s or 0.0))
        if time_s is not None:
            parts.update({f"car{k}": part for k, part in enumerate(_by_material(self.cars_at(time_s)))})
        return mi.load_dict(parts)


def _by_material(parts):
    """One mesh per material."""
    groups = {}
    for p, f, bsdf in parts:
        groups.setdefault(json.dumps(bsdf), []).append((p, f))
    out = []
    for bsdf, group in groups.items():
        start = np.cumsum([0] + [len(p) for p, _ in group])
        out.append(mesh("m", np.vstack([p for p, _ in group]),
                        np.vstack([f + k for (_, f), k in zip(group, start, strict=False)]), json.loads(bsdf)))
    return out


def lane_of(scene) -> tuple[Marking | None, Marking | None]:
    """The two lines of the lane the camera is in, from the markings tagged lane = "left" / "right"."""
    lines = {m["lane"]: m for m in scene["surface"].get("markings", []) if "lane" in m}

    def line(m):
        return m and Marking(m["d"], m.get("color", "white"), m.get("width", 0.12), m.get("dash", 3.66), m.get("gap", 0.0),
                             m.get("phase", 0.0), m.get("wear", 0.3))

    return line(lines.get("left")), line(lines.get("right"))


def mounting_of(scene) -> Mounting:
    m = scene["mounting"]
    return Mounting(m["height_m"], m["pitch_deg"], m["roll_deg"], m["yaw_deg"])


def camera_pose(world_from_car, mounting: Mounting) -> np.ndarray:
    """(4, 4) world_from_camera."""
    car_from_camera = np.eye(4)
    car_from_camera[:3, :3] = mounting.rotation().T
    car_from_camera[2, 3] = mounting.height_m
    return world_from_car @ car_from_camera
