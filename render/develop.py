"""From light to a file: what a small camera does to a picture."""

import cv2
import numpy as np


def srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def develop(
    light,
    *,
    exposure=1.0,
    white_balance=(1, 1, 1),
    contrast=1.0,
    saturation=1.0,
    noise=0.004,
    seed=0,
    sharpen=0.4,
    vignette=0.25,
    blur_px=0.6,
    edge_blur_px=0.0,
    bloom=0.0,
    shoulder=True,
    grain_px=0.6,
    rain=0,
):
    """Linear RGB (H, W, 3) to frame_bgr uint8.

    As in a camera: lens (bloom, blur growing towards the corners, vignette), sensor (shot and read noise, softened
    as demosaicing does), colour, tone curve, sharpening. noise is the read noise in units of white.
    """
    rng = np.random.default_rng(seed)
    h, w = light.shape[:2]
    img = light.astype(np.float32) * np.float32(exposure) * np.asarray(white_balance, np.float32)
    v, u = np.mgrid[0:h, 0:w].astype(np.float32)
    r2 = ((u - w / 2) ** 2 + (v - h / 2) ** 2) / (w * w / 4 + h * h / 4)
    scale = w / 1280
    if bloom:
        glow = cv2.GaussianBlur(img, (0, 0), w / 40) * 0.6 + cv2.GaussianBlur(img, (0, 0), w / 10) * 0.4
        img = img * (1 - bloom) + glow * bloom
    if blur_px:
        img = cv2.GaussianBlur(img, (0, 0), blur_px * scale)
    if edge_blur_px:
        soft, share = cv2.GaussianBlur(img, (0, 0), edge_blur_px * scale), np.clip(r2 * 1.4 - 0.3, 0, 1)[..., None]
        img = img * (1 - share) + soft * share
    img *= (1 - vignette * r2)[..., None]
    grain = cv2.GaussianBlur(rng.standard_normal((h, w, 3), dtype=np.float32), (0, 0), grain_px)
    grain *= 1 / max(grain.std(), 1e-6)
    img = img + grain * np.sqrt(np.maximum(img, 0) * noise * 0.02 + noise**2)
    grey = img @ np.float32([0.2126, 0.7152, 0.0722])
    img = np.maximum(grey[..., None] + (img - grey[..., None]) * saturation, 0)
    if shoulder:
        img = img * (1 + img / 4.84) / (1 + img) * 1.35  # extended Reinhard, white at 2.2
    y = srgb(img).astype(np.float32)
    y = np.clip((y - 0.5) * contrast + 0.5, 0, 1.2)
    if sharpen:
        y = y + sharpen * (y - cv2.GaussianBlur(y, (0, 0), 1.2))
    frame = np.ascontiguousarray((np.clip(y, 0, 1)[..., ::-1] * 255 + 0.5).astype(np.uint8))
    return droplets(frame, seed=seed, number=rain) if rain else frame


def droplets(frame_bgr, *, seed, number=150, largest_px=17):
    """Rain on the windscreen: each drop is a small lens that shows the scene upside down and smaller."""
    rng = np.random.default_rng(seed)
    h, w = frame_bgr.shape[:2]
    v, u = np.mgrid[0:h, 0:w].astype(np.float32)
    map_u, map_v, rim = u.copy(), v.copy(), np.zeros((h, w), np.float32)
    for _ in range(number):
        r = largest_px * (w / 1280) * (0.12 + 0.88 * rng.random() ** 3)
        cu, cv = rng.uniform(0, w), rng.uniform(0, h)
        tall, bend = rng.uniform(1.0, 1.35), rng.uniform(0.15, 0.4)
        a, b = max(0, int(cv - 2 * r)), min(h, int(cv + 2 * r) + 1)
        c, d = max(0, int(cu - 2 * r)), min(w, int(cu + 2 * r) + 1)
        du, dv = u[a:b, c:d] - cu, (v[a:b, c:d] - cv) / tall
        rr = np.sqrt(du**2 + dv**2) / r * (1 + bend * 0.3 * np.sin(3 * np.arctan2(dv, du) + cu))
        inside = rr < 1
        pull = 3.2 * r * rr
        map_u[a:b, c:d][inside] = (cu - du * pull / r * 2.2)[inside]
        map_v[a:b, c:d][inside] = (cv - dv * pull / r * 3.0)[inside]
        rim[a:b, c:d] = np.maximum(rim[a:b, c:d], np.clip((rr - 0.6) / 0.4, 0, 1) * (rr < 1))
    soft = cv2.GaussianBlur(frame_bgr, (0, 0), 2.5 * w / 1280)
    out = cv2.remap(soft, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101).astype(np.float32)
    drop = cv2.GaussianBlur((map_u != u).astype(np.float32), (0, 0), 1.0 * w / 1280)[..., None]
    out = out * (1 - 0.22 * cv2.GaussianBlur(rim, (0, 0), 1.0)[..., None]) + 6
    veil = cv2.GaussianBlur(frame_bgr, (0, 0), 3.0 * w / 1280).astype(np.float32)
    base = 0.55 * frame_bgr + 0.45 * veil  # a film of water between the wiper's strokes
    return np.clip(base * (1 - drop) + out * drop + 0.5, 0, 255).astype(np.uint8)
