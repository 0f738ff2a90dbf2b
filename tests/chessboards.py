"""Pictures of chessboards with exact truth: one ray per sample of every pixel, met with the board."""

from functools import cache

import cv2
import numpy as np

from lanelib.camera import Camera

# Unlike the course's own camera in every number; the distortion moves the corners of the frame by some 40 px.
CAMERA = Camera([[602.0, 0, 333.0], [0, 596.0, 188.0], [0, 0, 1]], [-0.28, 0.09, 0.0012, -0.0008, -0.01], (660, 390))
SAMPLES = 2  # per pixel and axis


@cache
def _rays(camera: Camera) -> np.ndarray:
    """(3, H * S, W * S): the ray (x, y, 1) of each sample, from a table every 4 samples, linear in between."""
    width, height = camera.size_wh
    step = 4 / SAMPLES
    u, v = np.arange(-3, width + 4, step), np.arange(-3, height + 4, step)
    at = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    table = (camera.undistort_points(at) - camera.camera_matrix[:2, 2]) / np.diag(camera.camera_matrix)[:2]
    table = table.reshape(len(v), len(u), 2)
    own = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    samples = [((np.arange(n)[:, None] + own).ravel() + 3) / step for n in (width, height)]
    map_x, map_y = np.meshgrid(*samples)
    x0, y0 = map_x.astype(int), map_y.astype(int)
    fx, fy = (map_x - x0)[..., None], (map_y - y0)[..., None]
    xy = (1 - fy) * ((1 - fx) * table[y0, x0] + fx * table[y0, x0 + 1]) + fy * (
        (1 - fx) * table[y0 + 1, x0] + fx * table[y0 + 1, x0 + 1]
    )
    return np.stack([xy[..., 0], xy[..., 1], np.ones_like(xy[..., 0])])


def bend_m(x: np.ndarray, bend: float, w: int) -> np.ndarray:
    """Depth of a board bent like a gutter, in squares; 0 at both ends of its rows."""
    return 4 * bend * (x / (w - 1)) * (1 - x / (w - 1))


def pose(rvec, centre, board_wh) -> tuple[np.ndarray, np.ndarray]:
    """Board to camera: rotation (3, 3) and translation (3,), in squares, with the board's middle at `centre`."""
    rotation = cv2.Rodrigues(np.asarray(rvec, np.float64))[0]
    middle = np.array([(board_wh[0] - 1) / 2, (board_wh[1] - 1) / 2, 0])
    return rotation, np.asarray(centre, np.float64) - rotation @ middle


def _wave(x: np.ndarray, softness: np.ndarray) -> np.ndarray:
    """+1 on the even squares, -1 on the odd ones, with linear flanks of that width."""
    to_edge = 0.5 - np.abs(x % 1 - 0.5)
    return np.where(np.floor(x) % 2 == 0, 1, -1) * np.minimum(to_edge / (softness / 2), 1)


def render(rvec, centre, *, board_wh=(7, 5), camera=CAMERA, bend=0.0, noise=2.0, seed=0) -> np.ndarray:
    """A picture (H, W), uint8, of a board of squares of side 1; the first square (between corners 0 and 1) is black."""
    rotation, translation = pose(rvec, centre, board_wh)
    w, h = board_wh
    rays = np.tensordot(rotation.T, _rays(camera), axes=1)
    eye = -rotation.T @ translation
    depth = 0.0
    for _ in range(8 if bend else 1):  # the ray meets z = bend(x): a fixed point, for a bend small beside the distance
        t = (depth - eye[2]) / rays[2]
        x, y = eye[0] + t * rays[0], eye[1] + t * rays[1]
        depth = bend_m(np.clip(x, -1, w), bend, w)
    pitch = np.abs(t) / (SAMPLES * camera.camera_matrix[0, 0])  # of the samples, in squares: edges are that soft, for
    colour = 125 - 95 * _wave(x, pitch) * _wave(y, pitch)  # sharp ones would move by up to half a sample
    colour[(x < -1) | (x > w) | (y < -1) | (y > h)] = 220  # white margin of one square
    colour[(x < -2) | (x > w + 1) | (y < -2) | (y > h + 1) | (t <= 0)] = 120
    height, width = (n // SAMPLES for n in colour.shape)
    frame = colour.reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    frame += np.random.default_rng(seed).normal(0, noise, frame.shape)
    return np.clip(np.round(frame), 0, 255).astype(np.uint8)


def true_corners(rvec, centre, *, board_wh=(7, 5), camera=CAMERA, bend=0.0) -> np.ndarray:
    """The pixels (w * h, 2) at which the inner corners lie, by OpenCV's own projection."""
    w, h = board_wh
    points = np.zeros((w * h, 3))
    points[:, :2] = np.mgrid[0:w, 0:h].T.reshape(-1, 2)
    points[:, 2] = bend_m(points[:, 0], bend, w)
    rotation, translation = pose(rvec, centre, board_wh)
    seen, _ = cv2.projectPoints(
        points, cv2.Rodrigues(rotation)[0], translation, camera.camera_matrix, camera.distortion
    )
    return seen.reshape(-1, 2)


# Twelve poses of a 7x5 board that fill the frame from corner to corner, tilted in different ways.
POSES = [
    ((0.0, 0.0, 0.05), (0.0, 0.0, 13.0)),
    ((0.5, 0.1, 0.0), (-2.5, -1.2, 14.0)),
    ((-0.5, 0.2, 0.1), (2.5, -1.2, 14.0)),
    ((0.1, 0.55, 0.0), (-3.0, 1.5, 15.0)),
    ((0.1, -0.55, -0.1), (3.0, 1.5, 15.0)),
    ((0.4, 0.4, 0.3), (0.0, 1.0, 12.5)),
    ((-0.4, -0.4, -0.3), (0.0, -1.0, 12.5)),
    ((0.0, 0.3, 1.2), (-2.0, 0.0, 17.0)),
    ((0.3, 0.0, -1.2), (2.0, 0.0, 17.0)),
    ((0.3, 0.3, 0.0), (-4.5, -2.5, 18.0)),
    ((0.3, -0.3, 0.0), (4.5, 2.5, 18.0)),
    ((-0.3, 0.2, 0.0), (4.5, -2.5, 18.0)),
]
