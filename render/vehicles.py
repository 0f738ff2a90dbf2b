"""Cars: a lofted body with windows, lamps, plate, bumper, wheels. Good from about 25 m, like soap when closer."""

from functools import cache

import numpy as np

from .tracer import box, diffuse, glossy, grid_faces

LENGTH_M = 4.8
# Stations from tail to nose: top, belt line, half width, half width of the roof, bottom.
X = np.array([0, 0.04, 0.18, 0.5, 0.95, 1.35, 1.8, 2.4, 3.0, 3.5, 3.9, 4.35, 4.65, 4.8])
SHAPES = {
    "saloon": dict(
        top=[0.86, 0.98, 1.03, 1.06, 1.10, 1.30, 1.42, 1.45, 1.40, 1.18, 0.98, 0.90, 0.80, 0.66], height=1.0
    ),
    "suv": dict(top=[0.90, 1.28, 1.52, 1.64, 1.69, 1.71, 1.72, 1.72, 1.66, 1.40, 1.10, 1.02, 0.92, 0.72], height=1.06),
}
BELT = np.array([0.84, 0.92, 0.96, 0.98, 0.99, 1.0, 1.0, 0.99, 0.97, 0.95, 0.93, 0.87, 0.77, 0.64])
HALF = np.array([0.74, 0.83, 0.88, 0.91, 0.92, 0.925, 0.925, 0.925, 0.925, 0.92, 0.91, 0.88, 0.80, 0.66])
ROOF = np.array([0.66, 0.74, 0.78, 0.76, 0.72, 0.64, 0.60, 0.59, 0.60, 0.68, 0.76, 0.74, 0.66, 0.54])
FLOOR = np.array([0.42, 0.30, 0.26, 0.24, 0.22, 0.2, 0.2, 0.2, 0.2, 0.2, 0.22, 0.24, 0.3, 0.4])


def _smooth(values, xs):
    y = np.interp(xs, X, values)
    kernel = np.array([1, 2, 3, 2, 1]) / 9
    return np.convolve(np.pad(y, 2, mode="edge"), kernel, "valid")


@cache
def car(color=(0.02, 0.02, 0.022), shape="saloon"):
    """[(points, faces, bsdf)]: x to the nose (tail at 0), y left, z up."""
    xs, columns = np.linspace(0, LENGTH_M, 72), 41
    top, belt, half, roof, floor = (_smooth(v, xs) for v in (np.array(SHAPES[shape]["top"]), BELT, HALF, ROOF, FLOOR))
    if shape == "suv":
        roof = roof * 1.12
    points, along = np.zeros((len(xs), columns, 3)), np.linspace(0, 1, columns)
    for i in range(len(xs)):
        mid = floor[i] * 0.45 + belt[i] * 0.55
        outline = np.array(
            [
                [half[i] * 0.86, floor[i]],
                [half[i] * 0.97, floor[i] + 0.08],
                [half[i], mid],
                [half[i] * 0.975, belt[i] - 0.03],
                [half[i] * 0.955, belt[i]],
                [(roof[i] * 0.75 + half[i] * 0.25) * 0.98, belt[i] + (top[i] - belt[i]) * 0.45],
                [roof[i] * 0.97, belt[i] + (top[i] - belt[i]) * 0.88],
                [roof[i] * 0.75, belt[i] + (top[i] - belt[i]) * 0.985],
                [0, top[i] + 0.012],
            ]
        )
        h = np.interp(along[columns // 2 :], np.linspace(0.5, 1, 9), outline[::-1, 0])
        z = np.interp(along[columns // 2 :], np.linspace(0.5, 1, 9), outline[::-1, 1])
        points[i, columns // 2 :, 1], points[i, columns // 2 :, 2] = -h, z
        points[i, : columns // 2, 1], points[i, : columns // 2, 2] = h[:0:-1], z[:0:-1]
        points[i, :, 0] = xs[i]
    flat, faces = points.reshape(-1, 3), grid_faces(len(xs), columns)
    c = flat[faces].mean(1)
    above, room = c[:, 2] - np.interp(c[:, 0], xs, belt), np.interp(c[:, 0], xs, top - belt)
    slope = np.interp(c[:, 0], xs, np.abs(np.gradient(top, xs)))
    cabin = (c[:, 0] > (0.95 if shape == "saloon" else 0.06)) & (c[:, 0] < 3.62)
    side = cabin & (above > 0.03) & (above < room - 0.10) & (np.abs(c[:, 1]) > 0.5) & (c[:, 0] > 0.9) & (c[:, 0] < 3.4)
    side &= ~((c[:, 0] > 2.25) & (c[:, 0] < 2.33))
    screens = cabin & (above > 0.06) & (above < room - 0.05) & (slope > 0.22)
    screens &= np.abs(c[:, 1]) < 0.62 - 0.12 * np.clip(above / 0.4, 0, 1)
    glass = side | screens
    cap = len(flat)
    flat = np.vstack([flat, [[0, 0, 0.62]]])
    tail = np.array([[i, cap, (i + 1) % columns] for i in range(columns)])
    paint, black = glossy(color, 0.3, 0.5, 0.2, 0.8), glossy((0.015, 0.015, 0.016), 0.6)
    parts = [
        (flat, np.vstack([faces[~glass], tail]), paint),
        (flat, faces[glass], glossy((0.012, 0.014, 0.016), 0.15, 0.35)),
    ]
    red = glossy((0.42, 0.012, 0.012), 0.2, 0.6)
    low = 0.74 if shape == "saloon" else 0.95
    for sign in (1, -1):
        y = sorted((sign * 0.50, sign * 0.82))
        parts.append((*box(-0.02, 0.10, *y, low, low + 0.13), red))
        parts.append((*box(2.95, 3.1, *sorted((sign * 0.90, sign * 1.04)), 0.95, 1.08), paint))
    parts.append((*box(-0.02, 0.05, -0.26, 0.26, 0.62, 0.75), glossy((0.72, 0.72, 0.70), 0.5)))
    parts.append((*box(-0.04, 0.25, -0.74, 0.74, 0.27, 0.44), black))
    parts.append((*box(0.1, 4.6, -0.78, 0.78, 0.16, 0.27), diffuse((0.01, 0.01, 0.01))))
    k, tyre, rim = 28, glossy((0.015, 0.015, 0.015), 0.8), glossy((0.42, 0.42, 0.43), 0.35, 0.5, 0.8)
    t = np.arange(k) * 2 * np.pi / k
    i, j = np.arange(k), (np.arange(k) + 1) % k
    for x in (0.95, 3.85):
        for sign in (1, -1):
            for r, bsdf, out in ((0.335, tyre, 0.915), (0.215, rim, 0.919)):
                ring = np.c_[x + r * np.cos(t), np.zeros(k), 0.335 + r * np.sin(t)]
                inner, outer = ring + [0, sign * 0.70, 0], ring + [0, sign * out, 0]
                p = np.vstack([inner, outer, [[x, sign * out, 0.335]]])
                f = np.concatenate(
                    [np.stack(q, 1) for q in ((i, j, k + i), (j, k + j, k + i), (k + i, k + j, 0 * i + 2 * k))]
                )
                parts.append((p, f, bsdf))
    return parts
