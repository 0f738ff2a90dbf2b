"""One frame: trace, denoise, put the air in, develop, and say the truth."""

import drjit as dr
import mitsuba_oidn
import numpy as np

from lanelib.road import CarPose, frame_truth

from .develop import develop
from .lens import true_lens
from .tracer import mi, trace
from .world import camera_pose, lane_of, mounting_of

H_SAMPLES = range(400, 680, 10)  # below row 680 is the bonnet


def hidden_test(scene, world_from_car, mounting):
    """Tells for points (n, 3) in car axes which of them something stands in front of."""
    eye = (world_from_car @ np.array([0, 0, mounting.height_m, 1]))[:3]

    def hidden(points):
        world = np.c_[points, np.ones(len(points))] @ world_from_car.T
        ray = world[:, :3] + [0, 0, 0.03] - eye
        far = np.linalg.norm(ray, axis=1)
        rays = mi.Ray3f(mi.Point3f(*eye.tolist()), mi.Vector3f(*(ray / far[:, None]).T.astype(np.float32)))
        rays.maxt = mi.Float((far * 0.997).astype(np.float32))
        return np.array(scene.ray_test(rays))

    return hidden


def light_of(
    mitsuba_scene, pose4, *, spp, seed, shrink=1, end_pose=None, still=None, max_depth=5, clamp=30.0, lens=None
):
    """(light, depth): denoised linear RGB and mean distance (0 for the sky)."""
    out = trace(
        mitsuba_scene,
        lens or true_lens(),
        pose4,
        spp=spp,
        seed=seed,
        aovs="a:albedo,n:sh_normal,d:depth",
        shrink=shrink,
        end_pose=end_pose,
        still=still,
        max_depth=max_depth,
        clamp=clamp,
    )
    light, albedo, normal, depth = out[..., :3], np.clip(out[..., 3:6], 0, 1), out[..., 6:9], out[..., 9]
    light, albedo, normal = (np.ascontiguousarray(a) for a in (light, albedo, normal))
    return np.asarray(mitsuba_oidn.denoise(light, albedo, normal, hdr=True)), depth


def haze(light, depth, air):
    """Aerial perspective: distant things take the colour of the sky above the horizon."""
    visibility = air.get("visibility_m", 12000.0)
    sky = depth <= 0
    color = np.array(air["rgb"]) if "rgb" in air else None
    if color is None:
        rows = np.flatnonzero(sky.mean(1) > 0.2)
        color = light.mean((0, 1))
        if len(rows):
            band = slice(rows[-1] - max(2, len(rows) // 12), rows[-1] + 1)
            color = np.median(light[band][sky[band]], 0)
    keep = np.exp(-3.0 * depth / visibility)[..., None]
    veiled = light * keep + color * (1 - keep) * air.get("brightness", 0.85)
    return np.where(sky[..., None], light, veiled).astype(np.float32)


def shoot(
    world,
    pose: CarPose,
    *,
    spp=24,
    seed=0,
    shrink=1,
    raw_file="",
    tags=(),
    time_s=None,
    mounting=None,
    end=None,
    max_depth=5,
    keep=None,
    lens=None,
    h_samples=H_SAMPLES,
):
    """(frame_bgr, truth) of one moment.

    end: pose and mounting at the end of the exposure. keep: a file for the light before it is developed (float16), so
    that the camera's settings can be tuned with `redevelop` without tracing again. lens: another camera than the
    shipped pictures'.
    """
    scene = world.scene
    mounting = mounting or mounting_of(scene)
    loaded = world.load(pose, time_s=time_s, mounting=mounting)
    m = pose.world_from_car(world.road)
    light, depth = light_of(
        loaded,
        camera_pose(m, mounting),
        spp=spp,
        seed=seed,
        shrink=shrink,
        max_depth=max_depth,
        end_pose=None if end is None else camera_pose(end[0].world_from_car(world.road), end[1]),
        still=world.bonnet,
        lens=lens,
    )
    truth = truth_of(world, pose, mounting, loaded, raw_file, tags, lens=lens, h_samples=h_samples)
    dr.flush_malloc_cache()
    if keep is not None:
        keep.parent.mkdir(parents=True, exist_ok=True)
        np.savez(keep, light=np.minimum(light, 6e4).astype(np.float16), depth=depth.astype(np.float16))
    return redevelop(light, depth, scene, seed), truth


def truth_of(world, pose, mounting=None, loaded=None, raw_file="", tags=(), *, lens=None, h_samples=H_SAMPLES):
    """The truth of a moment; visibility is found by rays through the loaded scene."""
    lens, (left, right) = lens or true_lens(), lane_of(world.scene)
    mounting, loaded = mounting or mounting_of(world.scene), loaded or world.load(pose)
    hidden = hidden_test(loaded, pose.world_from_car(world.road), mounting)
    return frame_truth(
        world.road,
        pose,
        mounting,
        lens.camera_matrix,
        lens.distortion,
        lens.size_wh,
        left,
        right,
        raw_file=raw_file,
        tags=tags,
        h_samples=h_samples,
        hidden=hidden,
    )


def redevelop(light, depth, scene, seed):
    """The air and the camera: from traced light to frame_bgr."""
    return develop(
        haze(light.astype(np.float32), depth.astype(np.float32), scene.get("air", {})), seed=seed, **scene["camera"]
    )
