"""Mitsuba 3 with our own rays: every sample goes from its exact pixel position through the exact inverse of the lens.

Mitsuba's sensors and a remapped wide picture are not used: this way the camera of the truth file is the camera of the
picture, to rounding, with no resampling. A sample's position is its pixel's centre plus Gaussian jitter (the pixel
filter by importance sampling, so all weights are 1); motion blur takes the pose at a random moment of the exposure.
"""

import glob
import json
import os
import re

from .lens import Lens

if "DRJIT_LIBLLVM_PATH" not in os.environ:  # Debian's LLVM 14 and 15 do not work with Mitsuba 3.9, 19 does
    found = [
        (int(re.search(r"libLLVM[-.]?(?:so\.)?(\d+)", p)[1]), p)
        for p in glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")
        if re.search(r"libLLVM[-.]?(?:so\.)?(\d+)", p)
    ]
    found = [f for f in found if f[0] >= 16]
    if found:
        os.environ["DRJIT_LIBLLVM_PATH"] = min(found, key=lambda f: abs(f[0] - 19))[1]

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
dr.set_thread_count(int(os.environ.get("RENDER_THREADS", "2")))

FILTER_SD_PX = 0.42  # a Gaussian of this width is about what a sharp lens and a square pixel give together


def unproject(u, v, lens: Lens, steps: int = 5):
    """Normalised undistorted coordinates of pixels: Newton on Brown-Conrady, in Dr.Jit (1e-7 after five steps)."""
    k = lens.camera_matrix
    k1, k2, p1, p2, k3 = (float(a) for a in lens.distortion)
    xd, yd = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    x, y = mi.Float(xd), mi.Float(yd)
    for _ in range(steps):
        r2 = x * x + y * y
        g = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2 * k2 + 3 * k3 * r2)
        ex = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - xd
        ey = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - yd
        a = g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        b = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        e = g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        det = dr.rcp(a * e - b * b)
        x, y = x - (e * ex - b * ey) * det, y - (a * ey - b * ex) * det
    return x, y


def trace(
    scene,
    lens: Lens,
    world_from_camera: np.ndarray,
    *,
    spp: int,
    seed: int = 0,
    max_depth: int = 5,
    end_pose: np.ndarray | None = None,
    still=None,
    aovs: str = "",
    clamp: float = 50.0,
    per_pass: int = 8,
    shrink: int = 1,
):
    """Linear RGB (H, W, 3) float32, and with aovs (as Mitsuba's `aov` integrator names them) their channels as well.

    world_from_camera (4, 4): camera axes x right, y down, z ahead. end_pose: the pose at the end of the exposure;
    still: a scene of what moves with the camera (the bonnet).
    clamp bounds a sample's radiance (fireflies). shrink renders every shrink-th pixel's area: a smaller picture.
    """
    path = {"type": "path", "max_depth": max_depth, "rr_depth": 3}
    integrator = mi.load_dict({"type": "aov", "aovs": aovs, "image": path} if aovs else path)
    w, h = lens.size_wh[0] // shrink, lens.size_wh[1] // shrink
    total, passes, done = None, max(1, -(-spp // per_pass)), 0
    for number in range(passes):
        n_here = min(per_pass, spp - done)
        done += n_here
        n = w * h
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed * 1009 + number, n * n_here)
        index = dr.arange(mi.UInt32, n * n_here) // n_here
        jitter = mi.warp.square_to_std_normal(sampler.next_2d())
        u = mi.Float(index % w) * shrink + (shrink - 1) / 2 + jitter.x * (FILTER_SD_PX * shrink)
        v = mi.Float(index // w) * shrink + (shrink - 1) / 2 + jitter.y * (FILTER_SD_PX * shrink)
        x, y = unproject(u, v, lens)
        d = dr.normalize(mi.Vector3f(x, y, 1))
        direction, origin = _posed(world_from_camera, d)
        if end_pose is not None:
            tau = sampler.next_1d()
            if still is not None:  # what moves with the camera does not blur
                tau = dr.select(still.ray_test(mi.Ray3f(origin, direction)), 0.0, tau)
            direction_1, origin_1 = _posed(end_pose, d)
            direction = dr.normalize(dr.lerp(direction, direction_1, tau))
            origin = dr.lerp(origin, origin_1, tau)
        light, _, extra = integrator.sample(scene, sampler, mi.RayDifferential3f(origin, direction))
        light = dr.minimum(light, clamp)
        channels = [light.x, light.y, light.z, *extra[4:]] if aovs else [light.x, light.y, light.z]
        dr.eval(channels)
        block = np.stack([np.array(c, dtype=np.float32).reshape(n, n_here).sum(1) for c in channels], -1)
        total = block if total is None else total + block
    return (total / spp).reshape(h, w, -1)


def _posed(pose, d):
    """Direction and origin in the world; opaque numbers, so that the next frame's pose needs no new kernel."""
    m = [[dr.opaque(mi.Float, float(pose[i, j])) for j in range(4)] for i in range(3)]
    rows = [m[i][0] * d.x + m[i][1] * d.y + m[i][2] * d.z for i in range(3)]
    return mi.Vector3f(*rows), mi.Point3f(*[m[i][3] for i in range(3)])


def mesh(name: str, points, faces, bsdf: dict, *, uv=None, colors=None, smooth: bool = False):
    """A triangle mesh; colors (n, 3) become the vertex attribute `vertex_color`."""
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    points, faces = np.asarray(points, np.float32), np.asarray(faces, np.uint32)
    m = mi.Mesh(
        name, len(points), len(faces), has_vertex_texcoords=uv is not None, has_vertex_normals=smooth, props=properties
    )
    if colors is not None:
        m.add_attribute("vertex_color", 3, np.asarray(colors, np.float32).ravel())
    params = mi.traverse(m)
    params["vertex_positions"] = mi.Float(points.ravel())  # a bare numpy array would be read number by number
    params["faces"] = mi.UInt32(faces.ravel())
    if uv is not None:
        params["vertex_texcoords"] = mi.Float(np.asarray(uv, np.float32).ravel())
    params.update()
    if smooth:
        m.recompute_vertex_normals()
    return m


def box(x0, x1, y0, y1, z0, z1):
    """(points, faces) of a box."""
    p = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
    f = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                  [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return p, f


def by_material(parts):
    """One mesh per material."""
    groups = {}
    for p, f, bsdf in parts:
        groups.setdefault(json.dumps(bsdf), []).append((p, f))
    out = []
    for bsdf, group in groups.items():
        start = np.cumsum([0] + [len(p) for p, _ in group])
        points, faces = [p for p, _ in group], [f + k for (_, f), k in zip(group, start, strict=False)]
        out.append(mesh("m", np.vstack(points), np.vstack(faces), json.loads(bsdf)))
    return out


def bitmap(values, **options) -> dict:
    """A raw (linear) float texture; row 0 is v = 0 (seen in Mitsuba 3.9)."""
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32)),
        "raw": True,
        **options,
    }


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Two triangles for every cell of a (rows, columns) grid of points."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[:-1, 1:], i[1:, 1:]
    return np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (c, b, d))])


def rgb(value) -> dict:
    return {"type": "rgb", "value": [float(v) for v in value]}


def diffuse(color) -> dict:
    return {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(color)}}


def glossy(color, roughness=0.5, specular=0.5, metallic=0.0, clearcoat=0.0) -> dict:
    return {
        "type": "twosided",
        "b": {
            "type": "principled",
            "base_color": rgb(color),
            "roughness": roughness,
            "specular": specular,
            "metallic": metallic,
            "clearcoat": clearcoat,
            "clearcoat_gloss": 0.9,
        },
    }


VERTEX_COLOR = {
    "type": "twosided",
    "b": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}},
}
