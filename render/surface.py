"""What the road and the ground are made of: procedural reflectance, evaluated at every point a ray meets.

The road mesh carries (s, d) as texture coordinates, so paint lies exactly where lanelib.road says. Nothing is baked:
stripes and dashes are box-filtered in closed form over the footprint of the sample, and a noise layer fades out where
the footprint outgrows it, so that neither near nor far road aliases.
"""

import drjit as dr

from .noise import tile
from .tracer import mi

PIXEL_RAD = 1 / 1155  # angle of one pixel
SAMPLE_FOOTPRINT = 0.5  # samples jitter over the pixel already, so one sample covers about half of it
PAINT = {"white": (0.72, 0.71, 0.68), "yellow": (0.63, 0.36, 0.050)}
LANE_M = 3.66
_textures, _configs = {}, {}


def _noise(key, s, d, period_s, period_d):
    """Repeating noise of standard deviation 1: key = (seed, sd along s, sd along d) in texels of 1024 (512)."""
    if key not in _textures:
        seed, sd_s, sd_d = key
        t = tile(seed, float(sd_s), float(sd_d), 512 if min(sd_s, sd_d) > 2 else 1024)
        _textures[key] = mi.Texture2f(mi.TensorXf(t[..., None].copy()), wrap_mode=dr.WrapMode.Repeat)
    u, v = s / period_s, d / period_d
    return _textures[key].eval(mi.Point2f(u - dr.floor(u), v - dr.floor(v)))[0]


def _fade(footprint, scale):
    return 1 / (1 + dr.square(footprint / scale))


def _stripe(x, half, f):
    """Share of the footprint f inside |x| < half, and no brighter than the stripe is wide."""
    return dr.clip((half - dr.abs(x)) / f + 0.5, 0, 1) * dr.minimum(1, 2 * half / f)


def _between(s, start, end, f):
    return dr.clip((s - start) / f + 0.5, 0, 1) * dr.clip((end - s) / f + 0.5, 0, 1)


def _dashes(s, marking, f):
    period, length = marking["dash"] + marking["gap"], marking["dash"]
    s = s - marking.get("phase", 0.0)

    def upto(u):
        n = dr.floor(u / period)
        return n * length + dr.minimum(u - n * period, length)

    return dr.clip((upto(s + f / 2) - upto(s - f / 2)) / f, 0, 1)


def _footprints(si):
    away = si.t * (PIXEL_RAD * SAMPLE_FOOTPRINT)
    steep = dr.maximum(dr.abs(si.wi.z), 0.004)
    return away, away / steep


def _mix(a, b, share):
    return a + (b - a) * share


def road_albedo(s, d, fd, fs, c):
    """Linear RGB reflectance at (s, d), footprints fd across and fs along; c: the `surface` table of a scene."""
    seed = c.get("seed", 0)
    age, wear, oil = c.get("age", 0.4), c.get("wear", 0.3), c.get("oil", 1.0)
    grain = _noise((seed + 1, 1.0, 1.0), s, d, 2.7, 2.7) * _fade(fs, 0.012)
    coarse = _noise((seed + 2, 2.2, 2.2), s, d, 6.1, 6.1) * _fade(fs, 0.05)
    blotch = _noise((seed + 3, 5.0, 5.0), s, d, 17.0, 13.0)
    streak = _noise((seed + 4, 40.0, 2.5), s, d, 190.0, 14.3) * _fade(fd, 0.15)
    broad = _noise((seed + 5, 9.0, 9.0), s, d, 67.0, 41.0)
    lane = d + LANE_M / 2
    lane = lane - dr.floor(lane / LANE_M) * LANE_M - LANE_M / 2
    tracks = dr.exp(-dr.square((dr.abs(lane) - 0.82) / 0.28))
    middle = dr.exp(-dr.square(lane / 0.35))
    grey = (0.034 + 0.055 * age) * (
        1
        + 0.15 * grain
        + 0.055 * coarse
        + 0.02 * blotch
        + 0.05 * streak
        + 0.04 * broad
        + (0.12 * age - 0.03) * tracks * (1 + 0.4 * streak)
        - 0.14 * oil * middle * (1 + 0.4 * streak + 0.3 * blotch)
    )
    tint = (1.0, 0.985, 0.965) if age > 0.3 else (0.97, 0.985, 1.03)
    color = mi.Color3f(*[grey * t for t in tint])
    for p in c.get("patches", []):  # a strip of other asphalt: age of its own
        inside = _between(s, p["from"], p["to"], fs)
        inside *= _between(d, p["left"] + 0.01 * blotch, p["right"] + 0.01 * blotch, fd)
        other = (0.034 + 0.055 * p["age"]) * (1 + 0.18 * grain + 0.12 * coarse + 0.05 * streak)
        color = _mix(color, mi.Color3f(other * 0.98, other * 0.985, other), inside)
        rim = _stripe(d - p["left"] - 0.01 * blotch, 0.018, fd) + _stripe(d - p["right"] - 0.01 * blotch, 0.018, fd)
        color *= 1 - 0.55 * rim * _between(s, p["from"], p["to"], fs) * c.get("seams", 1.0)
    if c.get("concrete"):
        slab = dr.floor(s / 4.57)
        number = dr.sin(slab * 12.9898 + dr.floor((d + LANE_M / 2) / LANE_M) * 78.2) * 43758.5
        shade = 0.93 + 0.14 * (number - dr.floor(number))
        stain = dr.clip(
            0.46 * tracks * (0.6 + 0.9 * streak) + 0.34 * middle * (0.8 + 0.7 * streak) + 0.16 * streak, 0, 0.8
        )
        stain *= 0.75 + 0.25 * dr.clip(broad, -1, 1)
        blot = dr.clip(0.8 * broad + 0.9 * streak + 0.25 * blotch - 1.2, 0, 1) * 0.3
        base = 0.265 * (1 + 0.08 * grain + 0.05 * coarse + 0.03 * blotch + 0.10 * streak + 0.09 * broad)
        base *= shade * (1 - 0.6 * dr.clip(stain, 0, 1) * oil) * (1 - blot)
        along = s + 2.28
        along = dr.abs(along - dr.floor(along / 4.57) * 4.57 - 2.28)
        joints = dr.clip((0.007 - along) / fs + 0.5, 0, 1) * dr.minimum(1, 0.014 / fs)
        joints = dr.maximum(joints, _stripe(dr.abs(lane) - LANE_M / 2 + 0.14, 0.008, fd) * c.get("seams", 1.0))
        base *= 1 - 0.7 * joints
        where = mi.Float(0)
        for start, end in c["concrete"]:
            where = dr.maximum(where, _between(s, start + 0.05 * blotch, end + 0.05 * blotch, fs))
        color = _mix(color, mi.Color3f(base, base * 0.97, base * 0.90), where)
    for t in c.get("tar", []):  # sealed cracks and seams along the road
        drawn = t.get("scale", 1.0)  # 1: a crack that grew; 4 and more: a joint that a machine drew
        wobble = t.get("wobble", 0.05) * (
            _noise((seed + 7, 12.0, 40.0), s, s * 0 + t["d"] * 3.1, 41.0 * drawn, 9.0)
            + 0.25 / drawn * _noise((seed + 8, 3.0, 40.0), s, s * 0 + t["d"], 23.0, 9.0)
        )
        line = _stripe(d - t["d"] - wobble, t.get("width", 0.05) / 2 * (1 + 0.25 * blotch), fd)
        line *= _between(s, t.get("from", -1e4), t.get("to", 1e4), fs)
        if t.get("broken", False):
            line *= dr.clip(3 * _noise((seed + 9, 14.0, 300.0), s, s * 0 + t["d"], 260.0, 9.0) + 1, 0, 1)
        color = _mix(color, mi.Color3f(t.get("tone", 0.016)), line * t.get("strength", 0.9))
    if c.get("cracks", 0):
        cell = dr.floor(s / 13.0)
        r = dr.sin(cell * 12.9898 + seed) * 43758.5
        r -= dr.floor(r)
        wander = _noise((seed + 11, 300.0, 7.0), s * 0 + cell * 5.1, d, 9.0, 11.0) * 0.16
        crack = _stripe(s - (cell + 0.2 + 0.6 * r) * 13.0 - wander, 0.02, fs) * dr.select(r < c["cracks"], 1.0, 0.0)
        crack *= dr.clip(1.2 + _noise((seed + 12, 4.0, 4.0), s, d, 9.0, 12.0), 0, 1)
        color = _mix(color, mi.Color3f(0.018), 0.8 * crack)
    # wear: fine times coarse noise, a soft threshold: chipped paint with the aggregate showing
    chips = 0.9 * _noise((seed + 21, 1.3, 1.3), s, d, 1.9, 1.9) * _fade(fs, 0.012)
    chips += 0.8 * _noise((seed + 22, 4.0, 3.0), s, d, 9.0, 7.0) + 0.55 * _noise(
        (seed + 23, 20.0, 20.0), s, d, 43.0, 17.0
    )
    edge = _noise((seed + 24, 2.0, 2.0), s, d, 3.1, 3.1) * 0.005
    dirt = 1 - 0.09 * blotch - 0.10 * dr.clip(coarse, -1, 1)
    for m in c.get("markings", []):
        w = m.get("wear", wear)
        keep = 1 / (1 + dr.exp(2.6 * (3.4 * w - 2.2 - chips)))
        cover = _stripe(d - m["d"] + edge, m.get("width", 0.12) / 2, fd)
        if m.get("gap", 0):
            cover *= _dashes(s + edge, m, fs)
        if "from" in m:
            cover *= _between(s, m["from"], m["to"], fs)
        if m.get("ghost"):  # ground off: a scoured strip, lighter and rougher, with remains of paint
            scour = cover * dr.clip(0.75 + 0.4 * blotch, 0, 1)
            color = _mix(color, color * 1.32 + 0.012, scour)
            cover *= dr.clip(1.5 * chips - 1.0, 0, 1) * 0.5
            keep = mi.Float(1)
        paint = mi.Color3f(*m.get("rgb", PAINT[m.get("color", "white")])) * dirt * c.get("retro", 1.0)
        color = _mix(color, paint, cover * keep)
        if m.get("reflectors"):  # raised markers, 10 cm, in the middle of the gap
            period = m["dash"] + m["gap"]
            u = s - m.get("phase", 0) - m["dash"] - m["gap"] / 2
            u -= dr.floor(u / period + 0.5) * period
            dot = _stripe(u, 0.05, fs) * _stripe(d - m["d"], 0.05, fd)
            color = _mix(color, paint * 0.9, dot)
    if c.get("wet", 0.0):
        color *= 1 - 0.45 * c["wet"]
    return dr.clip(color, 0.006, 6.0)


def road_roughness(s, d, fs, c):
    """Wet patches are smooth, dry ones and the aggregate's tips rough."""
    if not c.get("wet", 0.0):
        return mi.Float(c.get("roughness", 0.7))
    seed = c.get("seed", 0)
    lane = d + LANE_M / 2
    lane = lane - dr.floor(lane / LANE_M) * LANE_M - LANE_M / 2
    water = 0.7 * _noise((seed + 4, 40.0, 2.5), s, d, 190.0, 14.3)
    water += 0.8 * _noise((seed + 5, 9.0, 9.0), s, d, 67.0, 41.0)
    water += 0.5 * _noise((seed + 3, 5.0, 5.0), s, d, 17.0, 13.0)
    water += 1.0 * dr.exp(-dr.square((dr.abs(lane) - 0.82) / 0.3))  # it stands in the wheel tracks
    return dr.clip(0.55 - 0.16 * c["wet"] * (0.6 + water), c.get("smoothest", 0.2), 0.7)


def ground_albedo(p, f, c):
    """Dry grass, green patches and bare soil at world point p."""
    seed = c.get("seed", 0) + 100
    fine = _noise((seed, 1.2, 1.2), p.x, p.y, 4.3, 4.3) * _fade(f, 0.03)
    tufts = _noise((seed + 1, 5.0, 5.0), p.x, p.y, 19.0, 19.0) * _fade(f, 0.4)
    field = _noise((seed + 2, 12.0, 12.0), p.x, p.y, 130.0, 130.0)
    field += 0.6 * _noise((seed + 3, 12.0, 12.0), p.x, p.y, 41.0, 41.0)
    dry = mi.Color3f(*c.get("dry_rgb", (0.255, 0.200, 0.112)))
    green = mi.Color3f(*c.get("green_rgb", (0.085, 0.10, 0.035)))
    clumps = _noise((seed + 4, 2.0, 2.0), p.x, p.y, 37.0, 37.0) * _fade(f, 0.3)
    share = dr.clip(c.get("green", 0.2) + 0.26 * field + 0.16 * tufts + 0.10 * clumps, 0, 1)
    color = _mix(dry, green, share) * (1 + 0.26 * fine + 0.14 * tufts + 0.24 * clumps + 0.10 * field)
    soil = dr.clip(0.35 * field - 0.25 * tufts - 0.25, 0, 0.7)
    return dr.clip(_mix(color, mi.Color3f(0.27, 0.22, 0.165) * (1 + 0.2 * fine), soil), 0.01, 0.7)


class _Texture(mi.Texture):
    def __init__(self, props):
        mi.Texture.__init__(self, props)
        self.config = _configs[props["config"]]

    def mean(self):
        return mi.Float(0.2)

    def max(self):
        return mi.Float(1.0)

    def is_spatially_varying(self):
        return True


class RoadAlbedo(_Texture):
    def eval(self, si, active=True):
        fd, fs = _footprints(si)
        return road_albedo(si.uv.x, si.uv.y, fd, fs, self.config)


class RoadRoughness(_Texture):
    def eval_1(self, si, active=True):
        return road_roughness(si.uv.x, si.uv.y, _footprints(si)[1], self.config)


class GroundAlbedo(_Texture):
    def eval(self, si, active=True):
        fd, fs = _footprints(si)
        return ground_albedo(si.p, dr.sqrt(fd * fs), self.config)


for _name, _kind in (("road_albedo", RoadAlbedo), ("road_roughness", RoadRoughness), ("ground_albedo", GroundAlbedo)):
    mi.register_texture(_name, lambda props, kind=_kind: kind(props))


def procedural(kind: str, config: dict) -> dict:
    """A texture dict for Mitsuba; the table stays on our side, Mitsuba gets its name."""
    name = f"{kind}{len(_configs)}"
    _configs[name] = config
    return {"type": kind, "config": name}


def road_bsdf(surface: dict) -> dict:
    """The road's material from the scene's `surface` table."""
    rough = procedural("road_roughness", surface) if surface.get("wet") else surface.get("roughness", 0.7)
    return {
        "type": "twosided",
        "b": {
            "type": "principled",
            "base_color": procedural("road_albedo", surface),
            "roughness": rough,
            "specular": surface.get("specular", 0.35),
        },
    }
