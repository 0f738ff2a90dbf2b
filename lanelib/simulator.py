"""A light road simulator: `render_road(scene)` gives a picture and its exact truth in well under 100 ms at 640x360.

For widgets ("bend the road and watch the estimate") and for tests. Every pixel's ray is followed to the flat road; the
road's own coordinates (s, d) of that point say what lies there: asphalt, paint, grass. No objects, no path tracing:
for pictures that pass for photographs see `render/` and `test_images/rendered/`, which share the geometry.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np

from lanelib.errors import LanelibError
from lanelib.road import CarPose, Marking, Mounting, Road, fold_radius2, frame_truth

# Reflectances (linear, RGB), typical values: fresh asphalt 0.04-0.06, worn 0.10-0.15, concrete 0.25-0.35, white
# thermoplastic 0.6-0.8, yellow about (0.6, 0.35, 0.05); dry grass of a Californian summer.
ASPHALT_RGB, CONCRETE_RGB = (0.075, 0.074, 0.073), (0.31, 0.30, 0.275)
PAINT_RGB = {"white": (0.72, 0.71, 0.68), "yellow": (0.66, 0.37, 0.045)}
GRASS_RGB, HILL_RGB = (0.27, 0.215, 0.10), (0.10, 0.11, 0.085)
SUN_RGB, SKYLIGHT_RGB = (1.0, 0.94, 0.84), (0.10, 0.13, 0.18)  # in the shade only the sky's share is left: about 1/8
HAZE_RGB = np.array([0.42, 0.47, 0.53], np.float32)  # air at the horizon
EXPOSURE = 2.4  # paint in the sun just below white, dry asphalt at a grey level of about 100, as real dash cams do
TILE = 512  # pixels of the repeating noise tile


@dataclass(frozen=True)
class Scene:
    """Everything `render_road` needs. The default is a straight two-line lane seen at 640x360 through a mild lens.

    camera_matrix (3, 3) and distortion (5,) belong to `size_wh`. `left` and `right` are the lane's lines, `others`
    further paint that is no lane (neighbouring lanes, old markings). light scales sun and sky alike; shade_m is a list
    of (from, to) stretches in the shade of trees; concrete_m the same for the surface. noise is the standard deviation
    in grey levels (a dash cam by day: 2-3).
    """

    road: Road = field(default_factory=lambda: Road([0], [0.0]))
    left: Marking | None = Marking(-1.83, "yellow")
    right: Marking | None = Marking(1.83, "white", gap_m=10.97, phase_m=7.0)
    others: tuple[Marking, ...] = (Marking(5.49, "white", gap_m=10.97, phase_m=7.9),)
    pose: CarPose = CarPose()
    mounting: Mounting = Mounting(1.22, 1.4)
    size_wh: tuple[int, int] = (640, 360)
    camera_matrix: tuple = ((577.5, 0, 332.4), (0, 576.0, 193.1), (0, 0, 1))
    distortion: tuple = (-0.242, -0.030, -0.0008, 0.0003, 0.0)
    road_edges_m: tuple[float, float] = (-3.2, 8.6)
    light: float = 1.0
    shade_m: tuple[tuple[float, float], ...] = ()
    concrete_m: tuple[tuple[float, float], ...] = ()
    noise: float = 2.5
    seed: int = 0


@lru_cache(maxsize=4)
def _rays(size_wh, camera_matrix, distortion):
    """Normalised undistorted coordinates (H, W, 2) of every pixel centre, float32 (fixed-point iteration)."""
    (w, h), k = size_wh, np.array(camera_matrix)
    k1, k2, p1, p2, k3 = distortion
    v, u = np.mgrid[0:h, 0:w]
    yd = (v - k[1, 2]) / k[1, 1]
    xd = (u - k[0, 2] - k[0, 1] * yd) / k[0, 0]
    x, y = xd.copy(), yd.copy()
    for _ in range(25):  # converges where the lens does not fold over; 25 steps: far below 0.001 px
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = ((xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
                (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial)
    if not (np.isfinite(x).all() and (x * x + y * y).max() < fold_radius2(distortion)):
        raise LanelibError("needed a lens that maps the whole frame, got a distortion that folds over inside it: "
                           "use smaller coefficients or a longer focal length")
    return np.stack([x, y], -1).astype(np.float32)


@lru_cache(maxsize=8)
def _tile(seed, blur_px):
    """Repeating Gaussian noise (TILE, TILE), standard deviation 1, blurred; float32."""
    noise = np.random.default_rng(seed).standard_normal((TILE, TILE))
    f = np.fft.fftfreq(TILE)
    smooth = np.fft.ifft2(np.fft.fft2(noise) * np.exp(-2 * (np.pi * blur_px) ** 2 * (f[:, None] ** 2 + f**2))).real
    return (smooth / smooth.std()).astype(np.float32)


def _noise(seed, blur_px, s, d, period_s_m, period_d_m):
    """The tile looked up at (s, d), repeating every period."""
    return cv2.remap(_tile(seed, blur_px), np.mod(d * np.float32(TILE / period_d_m), TILE).astype(np.float32),
                     np.mod(s * np.float32(TILE / period_s_m), TILE).astype(np.float32), cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_WRAP)


def render_road(scene: Scene) -> tuple[np.ndarray, dict]:
    """(frame_bgr, truth): the picture (H, W, 3) uint8 and the dict of `lanelib.road.frame_truth`.

    The same scene gives the same picture. Raises LanelibError for a road that is not flat.
    """
    if np.any(scene.road.grades):
        raise LanelibError("needed a flat road, got one with a grade: the simulator has no hills, render/ has")
    matrix, distortion = np.asarray(scene.camera_matrix, float), np.asarray(scene.distortion, float)
    truth = frame_truth(scene.road, scene.pose, scene.mounting, matrix, distortion, scene.size_wh, scene.left,
                        scene.right)
    w, h = scene.size_wh
    lens = _rays(tuple(scene.size_wh), tuple(map(tuple, matrix)), tuple(map(float, scene.distortion)))
    to_car = scene.mounting.rotation().astype(np.float32)  # rows: camera axes in road axes
    rays = lens[..., :1] * to_car[0] + lens[..., 1:] * to_car[1] + to_car[2]
    down = -rays[..., 2] / np.hypot(rays[..., 0], rays[..., 1])  # > 0 below the horizon
    light = _backdrop(rays, down)
    first = int(np.argmax((down > 0.002).any(1)))  # the row from which there is ground: 0.002 is 600 m away
    below = down[first:] > 0.002
    if below.any():
        far = np.float32(scene.mounting.height_m) / np.maximum(-rays[first:, :, 2], 0.0015)
        ground = _ground(scene, rays[first:, :, :2] * far[..., None], far, below)
        haze = np.exp(-far / 900)[..., None]  # distant ground takes the colour of the air
        ground = ground * haze + HAZE_RGB * (1 - haze)
        light[first:] = np.where(below[..., None], ground, light[first:])
    return _develop(light * np.float32(scene.light), scene), truth


def _backdrop(rays, down):
    """Sky, brighter and paler at the horizon, and a line of hills: (H, W, 3) float32 linear RGB."""
    up = np.clip(-down, 0, 0.6)[..., None]
    light = HAZE_RGB + (np.float32([0.10, 0.22, 0.42]) - HAZE_RGB) * np.sqrt(up / 0.6)
    bearing = np.arctan2(rays[..., 0], rays[..., 1])
    ridge = 0.02 + 0.012 * np.sin(3.1 * bearing + 1) + 0.006 * np.sin(11 * bearing) + 0.003 * np.sin(37 * bearing)
    hill = np.clip((ridge + down) * 400, 0, 1)[..., None]
    return light * (1 - hill) + (np.float32(HILL_RGB) * 0.7 + 0.08) * hill


def _ground(scene, xy_car, far, below):
    """Light from the ground (rows, W, 3): surface, paint, shade. xy_car in the car's axes, far in focal lengths."""
    m = scene.pose.world_from_car(scene.road).astype(np.float32)
    xy = xy_car @ m[:2, :2].T + m[:2, 3]
    guess = np.float32(scene.pose.s_m) + np.minimum(xy_car[..., 1], 500)
    xy = np.where(below[..., None], xy, m[:2, 3]).astype(np.float32)
    s, d = scene.road.locate(xy, s_guess=np.where(below, guess, scene.pose.s_m))
    # footprint of a pixel on the road: across D / f, along D^2 / (f h); an oblique line also smears sideways
    fx = np.float32(scene.camera_matrix[0][0])
    across = far / fx
    along = across * far / np.float32(scene.mounting.height_m)
    oblique = np.abs(xy_car[..., 0]) / np.maximum(xy_car[..., 1], 1)
    across = np.hypot(across, 0.75 * oblique * along).astype(np.float32)

    grain = _noise(scene.seed + 1, 1.0, s, d, 3.1, 3.1) / (1 + (along / 0.03) ** 2)
    patches = _noise(scene.seed + 2, 9.0, s, d, 61.0, 37.0)
    lane = np.abs(np.mod(d + 1.83, 3.66) - 1.83)
    tracks = np.exp(-(((lane - 0.85) / 0.3) ** 2))[..., None]
    albedo = np.float32(ASPHALT_RGB) * (1 + 0.22 * grain + 0.07 * patches)[..., None] * (1 + 0.06 * tracks)
    for start, end in scene.concrete_m:
        inside = (np.clip((s - start) / along + 0.5, 0, 1) * np.clip((end - s) / along + 0.5, 0, 1))[..., None]
        joint = np.clip((0.01 - np.abs(np.mod(s, 4.57) - 2.3)) / along + 0.5, 0, 1) * np.minimum(1, 0.02 / along)
        concrete = np.float32(CONCRETE_RGB) * (1 + 0.10 * grain + 0.08 * patches)[..., None]
        albedo += (concrete * (1 - 0.6 * joint[..., None] - 0.25 * tracks) - albedo) * inside
    chips = _noise(scene.seed + 3, 1.3, s, d, 2.3, 2.3) / (1 + (along / 0.05) ** 2)
    chips = chips + 0.7 * _noise(scene.seed + 4, 4.0, s, d, 9.0, 7.0)
    for marking in (scene.left, scene.right, *scene.others):
        if marking is None:
            continue
        stripe = np.clip((marking.width_m / 2 - np.abs(d - np.float32(marking.d_m))) / across + 0.5, 0, 1)
        stripe *= np.minimum(1, marking.width_m / across) * marking.coverage(s, along)
        stripe /= 1 + np.exp(2.6 * (5.5 * marking.wear - 3.5 - chips))  # wear: chipped where the noise is low
        albedo += (np.float32(PAINT_RGB[marking.color]) - albedo) * stripe[..., None].astype(np.float32)
    left_edge, right_edge = scene.road_edges_m
    road = np.clip(np.minimum(d - left_edge, right_edge - d) / across + 0.5, 0, 1)[..., None]
    grass = np.float32(GRASS_RGB) * (1 + 0.35 * grain + 0.25 * patches)[..., None]
    albedo = grass + (albedo - grass) * road
    sun = np.ones_like(s)
    for start, end in scene.shade_m:
        leaves = _noise(scene.seed + 5, 7, s, d, 23.0, 19.0) + 0.6 * _noise(scene.seed + 6, 3, s, d, 17.0, 13.0)
        stretch = np.clip((s - start) / 1.5, 0, 1) * np.clip((end - s) / 1.5, 0, 1)
        sun = sun * (1 - stretch * np.clip(0.6 + 1.5 * leaves, 0, 1))
    return albedo * (np.float32(SUN_RGB) * sun[..., None] + np.float32(SKYLIGHT_RGB))


def _develop(light, scene):
    """Linear RGB to frame_bgr as a small camera does: lens blur, vignette, exposure, shoulder, sRGB, noise."""
    h, w = light.shape[:2]
    v, u = np.ogrid[0:h, 0:w]
    vignette = 1 - 0.25 * ((u - w / 2) ** 2 + (v - h / 2) ** 2) / (w * w / 4 + h * h / 4)
    light = cv2.GaussianBlur(light * vignette[..., None].astype(np.float32), (0, 0), 0.5)  # 0.5 px: a sharp lens
    x = np.linspace(0, 1, 4096) ** 2 * 4
    y = EXPOSURE * x / (1 + 0.55 * EXPOSURE * x)  # soft shoulder: whites bend over instead of clipping
    curve = np.where(y < 0.0031308, 12.92 * y, 1.055 * np.maximum(y, 1e-9) ** (1 / 2.4) - 0.055)
    curve = (255 * curve).astype(np.float32)
    grey = curve[np.minimum(np.sqrt(np.maximum(light, 0) / 4) * 4095, 4095).astype(np.uint16)]
    if scene.noise > 0:
        rng = np.random.default_rng(scene.seed)
        grey += rng.standard_normal(grey.shape, dtype=np.float32) * np.float32(scene.noise)
    return np.ascontiguousarray(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., ::-1])
