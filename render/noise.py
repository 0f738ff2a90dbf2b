"""Repeating Gaussian noise, blurred exactly (by FFT, so that it tiles)."""

from functools import lru_cache

import numpy as np


def wrap_blur(a, sd_x, sd_y=None):
    """Periodic Gaussian blur."""
    sd_y = sd_x if sd_y is None else sd_y
    fy, fx = np.fft.fftfreq(a.shape[0])[:, None], np.fft.rfftfreq(a.shape[1])[None]
    return np.fft.irfft2(np.fft.rfft2(a) * np.exp(-2 * np.pi**2 * ((sd_x * fx) ** 2 + (sd_y * fy) ** 2)), a.shape)


@lru_cache(maxsize=64)
def tile(seed: int, sd_x: float, sd_y: float | None = None, n: int = 1024) -> np.ndarray:
    """(n, n) float32 noise of mean 0 and standard deviation 1."""
    a = wrap_blur(np.random.default_rng(seed).standard_normal((n, n)), sd_x, sd_y)
    return ((a - a.mean()) / a.std()).astype(np.float32)


def look(t, x, y, period_x, period_y):
    """Bilinear look-up of a repeating tile at (x, y); the tile repeats every period."""
    n = t.shape[0]
    u, v = np.mod(x * (n / period_x), n), np.mod(y * (n / period_y), n)
    iu, iv = np.floor(u).astype(int), np.floor(v).astype(int)
    fu, fv = u - iu, v - iv
    a, b, iu1, iv1 = iu % n, iv % n, (iu + 1) % n, (iv + 1) % n
    return (t[b, a] * (1 - fu) + t[b, iu1] * fu) * (1 - fv) + (t[iv1, a] * (1 - fu) + t[iv1, iu1] * fu) * fv


def fractal(x, y, seed, octaves=5, period=300.0):
    """Sum of noise at halving scales; the largest features are about period / 12."""
    total = 0.0
    for o in range(octaves):
        total = total + look(tile(seed + o, 30.0, None, 512), x, y, period / 2**o, period / 2**o) * 0.5**o
    return total
