"""Cars: a lofted body with windows, lamps, plate, bumper and wheels. Good from about 25 m; closer they look like soap."""

import numpy as np

from .tracer import diffuse, glossy, grid_faces

LENGTH_M = 4.8
# Stations from tail to nose: top, belt line, half width, half width of the roof, bottom.
X = np.array([0, .04, .18, .5, .95, 1.35, 1.8, 2.4, 3.0, 3.5, 3.9, 4.35, 4.65, 4.8])
SHAPES = {
    "saloon": dict(top=[.86, .98, 1.03, 1.06, 1.10, 1.30, 1.42, 1.45, 1.40, 1.18, .98, .90, .80, .66], height=1.0),
    "suv": dict(top=[.90, 1.28, 1.52, 1.64, 1.69, 1.71, 1.72, 1.72, 1.66, 1.40, 1.10, 1.02, .92, .72], height=1.06),
}
BELT = np.array([.84, .92, .96, .98, .99, 1.0, 1.0, .99, .97, .95, .93, .87, .77, .64])
HALF = np.array([.74, .83, .88, .91, .92, .925, .925, .925, .925, .92, .91, .88, .80, .66])
ROOF = np.array([.66, .74, .78, .76, .72, .64, .60, .59, .60, .68, .76, .74, .66, .54])
FLOOR = np.array([.42, .30, .26, .24, .22, .2, .2, .2, .2, .2, .22, .24, .3, .4])


def _smooth(values, xs):
    y = np.interp(xs, X, values)
    kernel = np.array([1, 2, 3, 2, 1]) / 9
    return np.convolve(np.pad(y, 2, mode="edge"), kernel, "valid")


def _box(x0, x1, y0, y1, z0, z1):
    p = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
    f = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                  [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    return p, f


def car(color=(0.02, 0.02, 0.022), shape="saloon"):
    """[(points, faces, bsdf)]: x to the nose (tail at 0), y left, z up."""
    xs, columns = np.linspace(0, LENGTH_M, 72), 41
    top, belt, half, roof, floor = (_smooth(v, xs) for v in (np.array(SHAPES[shape]["top"]), BELT, HALF, ROOF, FLOOR))
    if shape == "suv":
        roof = roof * 1.12
    points, along = np.zeros((len(xs), columns, 3)), np.linspace(0, 1, columns)
    for i in range(len(xs)):
        mid = floor[i] * .45 + belt[i] * .55
        outline = np.array([[half[i] * .86, floor[i]], [half[i] * .97, floor[i] + .08], [half[i], mid],
                            [half[i] * .975, belt[i] - .03], [half[i] * .955, belt[i]],
                            [(roof[i] * .75 + half[i] * .25) * .98, belt[i] + (top[i] - belt[i]) * .45],
                            [roof[i] * .97, belt[i] + (top[i] - belt[i]) * .88],
                            [roof[i] * .75, belt[i] + (top[i] - belt[i]) * .985], [0, top[i] + .012]])
        h = np.interp(along[columns // 2:], np.linspace(.5, 1, 9), outline[::-1, 0])
        z = np.interp(along[columns // 2:], np.linspace(.5, 1, 9), outline[::-1, 1])
        points[i, columns // 2:, 1], points[i, columns // 2:, 2] = -h, z
        points[i, :columns // 2, 1], points[i, :columns // 2, 2] = h[:0:-1], z[:0:-1]
        points[i, :, 0] = xs[i]
    flat, faces = points.reshape(-1, 3), grid_faces(len(xs), columns)
    c = flat[faces].mean(1)
    above, room = c[:, 2] - np.interp(c[:, 0], xs, belt), np.interp(c[:, 0], xs, top - belt)
    slope = np.interp(c[:, 0], xs, np.abs(np.gradient(top, xs)))
    cabin = (c[:, 0] > (.95 if shape == "saloon" else .06)) & (c[:, 0] < 3.62)
    side = cabin & (above > .03) & (above < room - .10) & (np.abs(c[:, 1]) > .5) & (c[:, 0] > .9) & (c[:, 0] < 3.4)
    side &= ~((c[:, 0] > 2.25) & (c[:, 0] < 2.33))
    screens = cabin & (above > .06) & (above < room - .05) & (slope > .22) & (np.abs(c[:, 1]) < .62 - .12 * np.clip(above / .4, 0, 1))
    glass = side | screens
    cap = len(flat)
    flat = np.vstack([flat, [[0, 0, .62]]])
    tail = np.array([[i, cap, (i + 1) % columns] for i in range(columns)])
    paint, black = glossy(color, .3, .5, .2, .8), glossy((.015, .015, .016), .6)
    parts = [(flat, np.vstack([faces[~glass], tail]), paint), (flat, faces[glass], glossy((.012, .014, .016), .15, .35))]
    red = glossy((.42, .012, .012), .2, .6)
    low = .74 if shape == "saloon" else .95
    for sign in (1, -1):
        y = sorted((sign * .50, sign * .82))
        parts.append((*_box(-.02, .10, *y, low, low + .13), red))
        parts.append((*_box(2.95, 3.1, *sorted((sign * .90, sign * 1.04)), .95, 1.08), paint))
    parts.append((*_box(-.02, .05, -.26, .26, .62, .75), glossy((.72, .72, .70), .5)))
    parts.append((*_box(-.04, .25, -.74, .74, .27, .44), black))
    parts.append((*_box(.1, 4.6, -.78, .78, .16, .27), diffuse((.01, .01, .01))))
    k, tyre, rim = 28, glossy((.015, .015, .015), .8), glossy((.42, .42, .43), .35, .5, .8)
    t = np.arange(k) * 2 * np.pi / k
    i, j = np.arange(k), (np.arange(k) + 1) % k
    for x in (.95, 3.85):
        for sign in (1, -1):
            for r, bsdf, out in ((.335, tyre, .915), (.215, rim, .919)):
                ring = np.c_[x + r * np.cos(t), np.zeros(k), .335 + r * np.sin(t)]
                inner, outer = ring + [0, sign * .70, 0], ring + [0, sign * out, 0]
                p = np.vstack([inner, outer, [[x, sign * out, .335]]])
                f = np.concatenate([np.stack(q, 1) for q in ((i, j, k + i), (j, k + j, k + i), (k + i, k + j, 0 * i + 2 * k))])
                parts.append((p, f, bsdf))
    return parts
