"""Trees, bushes and grass as triangle soup: thousands of Mitsuba instances are slow, one merged mesh is not."""

from functools import cache

import numpy as np

from .tracer import diffuse, mesh

# light shines through (diff_trans): without it leaves are black
LEAVES = {"type": "principledthin", "base_color": {"type": "mesh_attribute", "name": "vertex_color"},
          "roughness": 0.55, "diff_trans": 1.0, "eta": 1.3}
# height, leaf length, number of leaves, colour, branch angle, spread of leaves about their twig, droop, trunk share
SPECIES = {
    "oak": dict(h=9.0, leaf=0.085, n=260000, color=(0.130, 0.148, 0.056), angle=(0.42, 0.95), spread=0.027, droop=0.0,
                trunk=0.17),
    "gum": dict(h=17.0, leaf=0.12, n=330000, color=(0.155, 0.162, 0.084), angle=(0.28, 0.62), spread=0.022, droop=0.5,
                trunk=0.24),
    "bare": dict(h=10.0, leaf=0.09, n=45000, color=(0.170, 0.145, 0.078), angle=(0.36, 0.80), spread=0.018, droop=0.1,
                 trunk=0.20),
    "pine": dict(h=14.0, leaf=0.11, n=190000, color=(0.060, 0.080, 0.040), angle=None, spread=0.03, droop=0.1,
                 trunk=0.1),
    "bush": dict(h=2.4, leaf=0.06, n=42000, color=(0.105, 0.115, 0.050), angle=None, spread=0.0, droop=0.0, trunk=0.0),
}
THINNER = (1.0, 2.4, 5.5, 14.0, 40.0)  # leaves are this many times fewer (and larger) at each level of detail
LEVEL_FROM_M = (16.0, 36.0, 80.0, 170.0)  # distance at which the next level begins


@cache
def tree(species: str, variant: int, level: int):
    """(bark points, bark faces, leaf points, leaf faces, leaf colours) of one plant standing at the origin."""
    sp = SPECIES[species]
    rng = np.random.default_rng(1000 * variant + sum(map(ord, species)))
    h, n = sp["h"], int(sp["n"] / THINNER[level])
    segments, tips = [], []
    if species == "pine":
        segments.append((np.zeros(3), np.array([0, 0, h]), h * 0.016, 0.02))
        for z in np.arange(0.12 * h, h * 0.98, h / 26):
            reach = (h - z) * 0.27 * rng.uniform(0.75, 1.15) + 0.15
            for a in rng.uniform(0, 2 * np.pi, 7):
                tip = np.array([np.cos(a) * reach, np.sin(a) * reach, z - 0.16 * reach])
                segments.append((np.array([0, 0, z]), tip, 0.035, 0.01))
                tips += [np.array([0, 0, z]) * (1 - f) + tip * f for f in (0.45, 0.6, 0.75, 0.88, 1.0)]
    elif species == "bush":
        p = rng.normal(0, 1, (700, 3))
        p /= np.linalg.norm(p, axis=1, keepdims=True)
        lump = (
            1
            + 0.28 * np.sin(3.1 * p[:, 0] + variant) * np.cos(2.7 * p[:, 1])
            + 0.15 * np.sin(7 * p[:, 2] + p[:, 0] * 5)
        )
        tips = list(
            p * lump[:, None] * np.array([0.55, 0.55, 0.45]) * h * rng.uniform(0.6, 1, (700, 1)) + [0, 0, 0.42 * h]
        )
    else:

        def grow(p, direction, length, radius, depth):
            for _ in range(3):
                direction = direction + rng.normal(0, 0.13, 3) + np.array([0, 0, 0.04])
                direction /= np.linalg.norm(direction)
                q = p + direction * length / 3
                segments.append((p, q, radius, radius * 0.88))
                p, radius = q, radius * 0.9
                if depth >= 2:
                    tips.append(p)
            if depth < 5:
                for _ in range(3):
                    side = rng.normal(0, 1, 3)
                    side -= side @ direction * direction
                    side /= np.linalg.norm(side)
                    turn = rng.uniform(*sp["angle"])
                    grow(
                        p,
                        direction * np.cos(turn) + side * np.sin(turn),
                        length * rng.uniform(0.66, 0.88),
                        radius * 0.66,
                        depth + 1,
                    )

        grow(
            np.array([0, 0, -0.2]),
            np.array([rng.normal(0, 0.06), rng.normal(0, 0.06), 1.0]),
            h * sp["trunk"],
            h * 0.026,
            0,
        )
    tips = np.array(tips)
    scale = h / max(tips[:, 2].max(), 1e-3)
    drop = np.array([0, 0, -0.05 * h * (species in ("oak", "gum"))])  # crowns hang lower than their twigs
    bark_points, bark_faces = _tubes(segments, 5 if level < 2 else 3, 0.0022 * level**2)
    # leaves come in clumps about the twigs, denser about some than about others: that makes gaps in the crown
    weight = rng.gamma(1.2 if species in ("gum", "bare") else 2.0, 1.0, len(tips))
    at = rng.choice(len(tips), n, p=weight / weight.sum())
    sd = sp["spread"] * h / scale
    centre = (tips[at] + np.clip(rng.normal(0, 1, (n, 3)), -1.7, 1.7) * sd * (0.6 + rng.random((n, 1)))) * scale
    centre = centre + drop * rng.random((n, 1)) ** 2
    a = rng.normal(0, 1, (n, 3)) + np.array([0, 0, -2.0 * sp["droop"]])
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(a, rng.normal(0, 1, (n, 3)))
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    size = sp["leaf"] * THINNER[level] ** 0.46 * rng.uniform(0.6, 1.35, (n, 1))
    points = np.stack([centre - a * size * 0.6, centre + b * size * 0.30, centre + a * size * 0.6], 1).reshape(-1, 3)
    clump = rng.normal(0, 1, len(tips))[at]
    tone = np.clip(rng.uniform(0.65, 1.4, n) * (1 + 0.16 * clump), 0.3, 2)
    color = np.array(sp["color"])[None] * tone[:, None]
    color[:, 0] *= 1 + 0.12 * clump + rng.normal(0, 0.07, n)
    color = np.repeat(np.clip(color, 0.008, 0.6), 3, 0)
    return (
        (bark_points * scale).astype(np.float32),
        bark_faces.astype(np.uint32),
        points.astype(np.float32),
        np.arange(3 * n, dtype=np.uint32).reshape(-1, 3),
        color.astype(np.float32),
    )


def _tubes(segments, sides, thinnest):
    segments = [s for s in segments if s[2] > thinnest]
    if not segments:
        return np.zeros((3, 3)), np.array([[0, 1, 2]])
    p, q = np.array([s[0] for s in segments]), np.array([s[1] for s in segments])
    r0, r1 = np.array([s[2] for s in segments]), np.array([s[3] for s in segments])
    axis = (q - p) / (np.linalg.norm(q - p, axis=1, keepdims=True) + 1e-9)
    u = np.cross(axis, [0.3, 0.5, 0.8])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axis, u)
    t = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(t)[None, :, None] * u[:, None] + np.sin(t)[None, :, None] * v[:, None]
    points = np.concatenate([p[:, None] + ring * r0[:, None, None], q[:, None] + ring * r1[:, None, None]], 1)
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    one = np.concatenate([np.stack([i, j, sides + i], 1), np.stack([j, sides + j, sides + i], 1)])
    faces = one[None] + (np.arange(len(segments)) * 2 * sides)[:, None, None]
    return points.reshape(-1, 3), faces.reshape(-1, 3)


@cache
def tuft(variant: int):
    """A tuft of dry grass: blades of one triangle."""
    rng = np.random.default_rng(50 + variant)
    n, h = 60, (0.32, 0.45, 0.22)[variant % 3]
    color = ((0.42, 0.345, 0.20), (0.36, 0.305, 0.175), (0.27, 0.255, 0.13))[variant % 3]
    base = np.c_[rng.normal(0, 0.16, (n, 2)), np.zeros(n)]
    top = base + np.c_[rng.normal(0, 0.12, (n, 2)), rng.uniform(0.4, 1.1, n) * h]
    wide = np.c_[rng.normal(0, 0.008, (n, 2)), np.zeros(n)]
    points = np.stack([base - wide, base + wide, top], 1).reshape(-1, 3)
    return points, np.arange(3 * n).reshape(-1, 3), np.repeat(np.array(color) * rng.uniform(0.6, 1.3, (n, 1)), 3, 0)


BRIGHTER = 1.4  # a leaf that also lets light through shows only half of its albedo on either side


class Garden:
    """Collects plants, then gives two meshes: bark and leaves."""

    def __init__(self):
        self.bark, self.leaves, self.triangles = [], [], 0

    def plant(self, species, at, *, away_m, variant=0, size=1.0, turn=0.0, tone=1.0, simpler=0, pruned=None):
        level = min(len(THINNER) - 1, int(np.searchsorted(LEVEL_FROM_M, away_m)) + simpler)
        bark, bark_faces, leaf, leaf_faces, color = tree(species, variant, level)
        m = size * np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]], np.float32)
        at = np.float32(at)
        bark, leaf = bark @ m.T + at, leaf @ m.T + at
        if pruned is not None:  # tells which points may not be there
            bark_faces, leaf_faces = (f[~pruned(p)[f].any(1)] for p, f in ((bark, bark_faces), (leaf, leaf_faces)))
        self.bark.append((bark, bark_faces))
        self.leaves.append((leaf, leaf_faces, color * np.float32(tone * BRIGHTER)))
        self.triangles += len(bark_faces) + len(leaf_faces)

    def grass(self, at, *, variant, size):
        points, faces, color = tuft(variant)
        self.leaves.append(((points * size + at).astype(np.float32), faces.astype(np.uint32), color.astype(np.float32)))
        self.triangles += len(faces)

    def meshes(self) -> dict:
        out = {}
        if self.bark:
            p, f = _merge(self.bark)
            out["bark"] = mesh("bark", p, f, diffuse((0.10, 0.085, 0.068)))
        if self.leaves:
            p, f = _merge(self.leaves)
            out["leaves"] = mesh("leaves", p, f, LEAVES, colors=np.vstack([part[2] for part in self.leaves]))
        return out


def _merge(parts):
    start = np.cumsum([0] + [len(p[0]) for p in parts])
    faces = [p[1] + np.uint32(k) for p, k in zip(parts, start, strict=False)]
    return np.vstack([p[0] for p in parts]), np.vstack(faces)
