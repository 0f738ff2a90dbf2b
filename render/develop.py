"""From light to a file: what a small camera does to a picture."""

import cv2
import numpy as np


def srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def develop(light, *, exposure=1.0, white_balance=(1, 1, 1), contrast=1.0, saturation=1.0, noise=0.004, seed=0, sharpen=0.4,
            vignette=0.25, blur_px=0.6, edge_blur_px=0.0, bloom=0.0, shoulder=True, grain_px=0.6):
    """Linear RGB (H, W, 3) to frame_bgr uint8.

    Order as in a camera: lens (bloom, blur growing towards the corners, vignette), sensor (shot and read noise, softened
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
    return (np.clip(y, 0, 1)[..., ::-1] * 255 + 0.5).astype(np.uint8)
