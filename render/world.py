"""From a scene description (a table of scenes/*.toml) to a Mitsuba scene.

World axes: x right and y ahead at s = 0, z up. Everything beside the road is placed in (s, d), metres along the
reference line (the middle of the lane the camera is in) and to the right of it.
"""

import numpy as np

from lanelib.road import CarPose, Marking, Mounting, Road

from .landscape import height, terrain
from .noise import fractal
from .plants import Garden
from .roadside import furniture
from .surface import road_bsdf
from .tracer import by_material, diffuse, glossy, grid_faces, mesh, mi, rgb
from .vehicles import car

AHEAD_M, BEHIND_M = 620.0, 45.0


class World:
    """One built scene: `mitsuba` (loaded), `road`, and the hood's pieces. Static but for cars and the camera."""

    def __init__(self, scene: dict, *, s_from=0.0, s_to=0.0, moving=False):
        r = scene["road"]
        self.scene = scene
        self.road = Road(
            r["stations"], r["curvature"], r.get("grade"), s_min_m=s_from - BEHIND_M - 60, s_max_m=s_to + AHEAD_M + 400
        )
        self.s0, self.s1 = s_from - BEHIND_M, s_to + AHEAD_M
        self.rng = np.random.default_rng(scene.get("seed", 1))
        self.parts = {"type": "scene"}
        self.garden = Garden()
        paved = self.at(np.arange(self.s0, self.s1, 0.4)[:, None], np.arange(self.outer[0], self.outer[1] + 0.4, 0.4))
        self.asphalt = np.unique(_cell(paved[..., :2].reshape(-1, 2)))  # the square metres that are paved
        self.lights()
        self.pavement()
        terrain(self)
        furniture(self)
        self.plants(s_from, s_to)
        self.parts.update(self.garden.meshes())
        self.group, self.bonnet = None, None
        for k, part in enumerate([] if moving else by_material(self.cars_at(0.0))):
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
        self.parts[name] = mesh(
            name, points.reshape(-1, 3), grid_faces(len(s), len(profile))[:, ::-1], bsdf, uv=uv.reshape(-1, 2)
        )

    # --- light ---------------------------------------------------------------------------------------------------
    def lights(self):
        sky = self.scene["sky"]
        kind = sky.get("kind", "clear")
        if kind == "clear":
            el, az = np.radians([sky["elevation"], sky["azimuth"]])  # azimuth: clockwise from ahead at s = 0
            sun = [float(np.cos(el) * np.sin(az)), float(np.cos(el) * np.cos(az)), float(np.sin(el))]
            self.parts["sky"] = {
                "type": "sunsky",
                "sun_direction": sun,
                "turbidity": sky.get("turbidity", 3.0),
                "albedo": 0.2,
                "sun_scale": sky.get("sun", 1.0),
                "sky_scale": sky.get("sky", 1.0),
            }
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
            self.parts["sky"] = {
                "type": "envmap",
                "bitmap": mi.Bitmap((dome * sky.get("level", 0.12)).astype(np.float32)),
                "to_world": to_world,
            }

    def headlights(self, world_from_car):
        """Low beams, for the night: two spots 0.65 m above the road."""
        out = {}
        for k, x in enumerate((-0.62, 0.62)):
            o = world_from_car @ np.array([x, 1.9, 0.66, 1])
            target = world_from_car @ np.array([x + 0.9, 40.0, -0.15, 1])
            look = mi.ScalarTransform4f().look_at(origin=o[:3].tolist(), target=target[:3].tolist(), up=[0, 0, 1])
            out[f"beam{k}"] = {
                "type": "spot",
                "to_world": look,
                "intensity": rgb([26.0, 24.5, 21.5]),
                "cutoff_angle": 34.0,
                "beam_width": 5.0,
            }
        return out

    # --- road and ground ------------------------------------------------------------------------------------------
    def pavement(self):
        left, right = self.scene["edges"]
        tight = np.abs(self.road.curvatures_1pm).max() > 1 / 300
        bend = 0.25 if tight else 0.5
        columns = np.linspace(left, right, 7)
        self.sweep(
            "road",
            np.c_[columns, 0 * columns],
            road_bsdf(self.scene["surface"]),
            near=bend,
            far=2 * bend,
            uv_is_sd=True,
        )
        opposite = self.scene.get("opposite")
        if opposite:
            asphalt = dict(
                self.scene["surface"],
                markings=[
                    {"d": opposite[1] - 0.9, "color": "yellow"},
                    {"d": opposite[1] - 4.6, "dash": 3.66, "gap": 10.97},
                ],
                tar=[],
            )
            self.sweep(
                "opposite", [(opposite[0], -0.01), (opposite[1], -0.01)], road_bsdf(asphalt), near=1, uv_is_sd=True
            )
            self.sweep("median", [(opposite[1], -0.02), (left, -0.02)], diffuse((0.17, 0.145, 0.11)))

    def height(self, s, d):
        """Height of the ground beside the road above the road."""
        return height(self, s, d)

    @property
    def outer(self):
        """Where the ground begins on the left and on the right, d in metres."""
        left, right = self.scene["edges"]
        return (self.scene["opposite"][0] if self.scene.get("opposite") else left), right

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
                self._plant(
                    species, s, d, rng.uniform(*wood.get("size", (0.6, 1.15))), s_from, s_to, int(rng.integers(3))
                )
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
        if not self.s0 < s < self.s1 or self._on_road(self.at(s, d)[:2]):
            return
        z = float(self.height(np.array([[s]]), np.array([[d]]))[0, 0])
        away = np.hypot(max(0.0, s - s_to) + max(0.0, s_from - s), d)
        if s_to > s_from:  # a clip is compressed and blurred by motion; behind the camera only the shadows are seen
            away = 2 * np.hypot(max(0.0, s - s_to) + 3 * max(0.0, s_from - s), d)
        self.garden.plant(
            species,
            self.at(s, d, z),
            away_m=away,
            variant=variant,
            size=size,
            turn=turn,
            tone=tone,
            simpler=self.scene.get("simpler", 0),
            pruned=self._over_road if self.scene.get("clearance_m") and abs(d) < 25 else None,
        )

    def _on_road(self, xy):
        """Where a road winds, what stands far beside one part of it may stand on the next."""
        return bool(np.isin(_cell(np.asarray(xy) + [[i, j] for i in (-1.5, 0, 1.5) for j in (-1.5, 0, 1.5)]),
                            self.asphalt).any())

    def _over_road(self, points):
        """Which points (n, 3) hang over the road lower than its keeper lets them."""
        low = points[:, 2] < self.road.elevation(self.s1 - AHEAD_M) + self.scene["clearance_m"]
        low[low] = np.isin(_cell(points[low, :2]), self.asphalt)
        return low

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
            parts += [
                (p @ m.T + origin, f, b)
                for p, f, b in car(tuple(c.get("rgb", (0.03, 0.03, 0.03))), c.get("shape", "saloon"))
            ]
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
            for j, x in enumerate((-0.66, 0.66)):
                o = self.at(s, c["d"], 0.66 if white else 0.82) + side * x + behind * (5.0 if white else 0.08)
                look = mi.ScalarTransform4f().look_at(origin=o.tolist(), target=(o + behind).tolist(), up=[0, 0, 1])
                size = 0.075 if white else 0.085
                out[f"lamp{k}{j}"] = {
                    "type": "disk",
                    "to_world": look.scale([size, size, 1]),
                    "emitter": {"type": "area", "radiance": rgb([160, 150, 130] if white else [7.0, 0.25, 0.12])},
                }
        return out

    def hood(self, world_from_car):
        """The bonnet at the lower edge of the frame: dull dark red paint that mirrors the sky."""
        h = self.scene.get("hood", {})
        u, v = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(0, 1, 30), indexing="ij")
        x, y = u * 1.02, 0.5 + v * 1.2
        z = 0.956 - 0.10 * v**2 - 0.045 * u**2 - 0.03 * np.maximum(0, v - 0.85) * 8
        z = z + 0.014 * np.exp(-(((np.abs(u) - 0.52) / 0.09) ** 2)) + 0.004 * np.sin(5 * u + 1)
        points = np.stack([x, y, z + h.get("raise", 0.0), np.ones_like(x)], -1).reshape(-1, 4)
        points = points @ np.asarray(world_from_car).T
        paint = glossy(h.get("rgb", (0.075, 0.043, 0.036)), 0.5, 0.5, 0.1, 0.2)
        return {"hood": mesh("hood", points[:, :3], grid_faces(80, 30), paint, smooth=True)}

    def load(self, pose: CarPose, *, time_s=None, mounting=None):
        """The Mitsuba scene with the hood (and, for clips, the cars) where they are at this moment."""
        m = pose.world_from_car(self.road)
        parts = dict(self.parts)
        if time_s is not None:  # what stands still is put into one group, so that only the rest is built anew
            if self.group is None:
                lights = {"sky": mi.load_dict(parts["sky"])}  # made once: its tables take seconds
                self.group = mi.load_dict(
                    {"type": "shapegroup", **{k: v for k, v in parts.items() if k not in ("sky", "type")}}
                )
                self.parts = {"type": "scene", **lights}
            parts = {**self.parts, "group": self.group, "still": {"type": "instance", "group": self.group}}
        if self.scene.get("hood", {}).get("show", True):  # the bonnet moves with the camera, both sit on the same body
            nominal = camera_pose(np.eye(4), mounting_of(self.scene))
            hood = self.hood(camera_pose(m, mounting or mounting_of(self.scene)) @ np.linalg.inv(nominal))
            self.bonnet = mi.load_dict({"type": "scene", **hood})
            parts.update(hood)
        if self.scene["sky"].get("kind") == "night":
            parts.update(self.headlights(m))
            parts.update(self.tail_lamps(time_s or 0.0))
        if time_s is not None:
            parts.update({f"car{k}": part for k, part in enumerate(by_material(self.cars_at(time_s)))})
        return mi.load_dict(parts)


def _cell(xy):
    """A number for each square metre of the ground; xy (n, 2)."""
    i = np.floor(xy).astype(np.int64)
    return i[:, 0] * 100_000 + i[:, 1]


def lane_of(scene) -> tuple[Marking | None, Marking | None]:
    """The two lines of the lane the camera is in, from the markings tagged lane = "left" / "right"."""
    lines = {m["lane"]: m for m in scene["surface"].get("markings", []) if "lane" in m}

    def line(m):
        return m and Marking(
            m["d"],
            m.get("color", "white"),
            m.get("width", 0.12),
            m.get("dash", 3.66),
            m.get("gap", 0.0),
            m.get("phase", 0.0),
            m.get("wear", 0.3),
        )

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
