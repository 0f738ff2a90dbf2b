"""Chessboard photographs: a printed sheet on a painted wall, path-traced through the true lens."""

import tomllib

import cv2
import numpy as np

from .develop import develop
from .files import is_current, remember, scene_key, update_truth, write_jpeg
from .lens import HERE, ROOT, true_lens
from .noise import wrap_blur
from .tracer import bitmap, glossy, grid_faces, mesh, mi, rgb, trace

FOLDER = ROOT / "camera_cal" / "rendered"
SQUARES_WH = (10, 7)
MARGIN = (22 / 64, 44 / 64)  # white border beside and above the squares, in squares: whole texels of print_sheet
PAPER_OFF_WALL_M = 0.0008
LOOK = 3  # raise when the code below changes what the pictures look like


def describe():
    return tomllib.loads((HERE / "scenes" / "boards.toml").read_text())


def print_sheet(n=64):
    """The printed page as reflectances (rows, columns, 3): toner is not black and paper not white."""
    j, i = np.mgrid[0 : SQUARES_WH[1] * n, 0 : SQUARES_WH[0] * n] // n
    bx, by = (round(m * n) for m in MARGIN)
    white = np.pad(((i + j) % 2 == 1).astype(np.float32), ((by, by), (bx, bx)), constant_values=1)
    grain = cv2.GaussianBlur(np.random.default_rng(1).standard_normal(white.shape).astype(np.float32), (0, 0), 3)
    toner = np.array([0.028, 0.028, 0.032]) * (1 + 1.5 * np.abs(grain))[..., None]
    return white[..., None] * np.array([0.79, 0.80, 0.82]) + (1 - white[..., None]) * toner


def plaster(n=1024, seed=3):
    """Height of roller-painted plaster: bumps with flat tops."""
    rng, h = np.random.default_rng(seed), np.zeros((n, n))
    for sd, amount in ((2, 0.12), (5, 0.45), (11, 1.0), (30, 0.9)):
        g = wrap_blur(rng.standard_normal((n, n)), sd)
        h += amount * g / g.std()
    return wrap_blur(np.where(h > 0.2, 0.2 + (h - 0.2) * 0.8, 0.2 - (0.2 - h) * 0.12), 1.2)


def board_pose(board, square_m, board_wh):
    """rvec, tvec, world_from_camera (4, 4). The world is the board: x right, y down, z into the wall; corner 0 at 0."""
    lens = true_lens()
    a, b, c = np.radians(board["tilt"])
    rotate = [cv2.Rodrigues(np.array(v, float))[0] for v in ((0, 0, c), (b, 0, 0), (0, a, 0))]
    r = rotate[0] @ rotate[1] @ rotate[2]
    at = cv2.undistortPoints(np.array([[board["at"]]], float), lens.camera_matrix, lens.distortion).ravel()
    centre = np.array([(board_wh[0] - 1) / 2, (board_wh[1] - 1) / 2, 0]) * square_m
    t = board["distance"] * np.array([at[0], at[1], 1]) - r @ centre
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = r.T, -r.T @ t
    return cv2.Rodrigues(r)[0].ravel(), t, pose


def board_scene(board, light, square_m, seed):
    """The sheet, the wall, the lamps."""
    w, h = ((n + 2 * m) * square_m for n, m in zip(SQUARES_WH, MARGIN, strict=True))
    x0, y0 = (-(1 + m) * square_m for m in MARGIN)
    nx, ny = 60, 46
    x, y = np.meshgrid(np.linspace(x0, x0 + w, nx), np.linspace(y0, y0 + h, ny))
    pattern_x, pattern_y = (
        np.clip((p - lo) / size * 2 - 1, -1, 1)
        for p, lo, size in ((x, -square_m, SQUARES_WH[0] * square_m), (y, -square_m, SQUARES_WH[1] * square_m))
    )
    bow = board.get("bow", 0.0) * 1e-3 * (1 - pattern_x**2) * (0.7 + 0.3 * pattern_y)
    # the squares lie flat (bow apart), the margins curl towards the camera
    margin = MARGIN[1] * square_m
    low, high = np.maximum(0, (y - (y0 + h - 0.9 * margin)) / margin), np.maximum(0, (y0 + 0.9 * margin - y) / margin)
    z = (
        -bow
        - low**2 * 0.007 * (1 + 0.8 * np.sin(40 * x + seed))
        - high**2 * 0.005 * (1 + 0.6 * np.sin(31 * x + 2 * seed))
    )
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    uv = np.stack([(x - x0) / w, (y - y0) / h], -1).reshape(-1, 2)
    paper = {
        "type": "twosided",
        "b": {
            "type": "principled",
            "base_color": bitmap(print_sheet(), wrap_mode="clamp"),
            "roughness": 0.55,
            "specular": 0.35,
        },
    }
    flip = mi.ScalarTransform4f().translate([0, 0, PAPER_OFF_WALL_M]).rotate([1, 0, 0], 180)
    wall_paint = {
        "type": "bumpmap",
        "scale": 0.00025,
        "arbitrary": bitmap(plaster()[..., None], to_uv=mi.ScalarTransform4f().scale([5, 5, 1])),
        "bsdf": {"type": "principled", "base_color": rgb(light["wall"]), "roughness": 0.45, "specular": 0.4},
    }
    d = {
        "type": "scene",
        "sheet": mesh("sheet", points, grid_faces(ny, nx), paper, uv=uv, smooth=True),
        "wall": {"type": "rectangle", "to_world": flip.scale([2, 2, 1]), "bsdf": wall_paint},
        "room": {"type": "constant", "radiance": rgb(light["ambient"])},
    }
    for k, lamp in enumerate(light["lamps"]):
        look = mi.ScalarTransform4f().look_at(origin=lamp["from"], target=[0.1, 0.06, 0], up=[0, 1, 0.01])
        d[f"lamp{k}"] = {
            "type": "rectangle",
            "to_world": look.scale([lamp["half_size"]] * 2 + [1]),
            "emitter": {"type": "area", "radiance": rgb(lamp["radiance"])},
        }
    if board.get("shadow"):  # somebody stands in the light: a soft edge across the sheet
        lamp = np.array(light["lamps"][0]["from"])
        middle = np.array([0.03, 0.15, 0]) + 0.33 * lamp
        look = mi.ScalarTransform4f().look_at(origin=middle.tolist(), target=lamp.tolist(), up=[0.4, 1, 0.01])
        d["person"] = {"type": "disk", "to_world": look.scale([0.16, 0.10, 1]), "bsdf": glossy([0.1, 0.08, 0.07], 0.9)}
    return mi.load_dict(d)


def render_boards(names=None, *, spp=24, force=False, shrink=1, folder=FOLDER):
    """Render the named boards (all if None) whose description changed; truth goes to truth.json beside them."""
    about, lens = describe(), true_lens()
    square_m, board_wh = about["square_m"], about["board_wh"]
    for k, board in enumerate(about["board"]):
        name, light = board["name"], about["lights"][board["light"]]
        key = scene_key("board", LOOK, board, light, square_m, about["seed"], lens.to_dict(), spp)
        if (names and name.rsplit(".", 1)[0] not in names) or (
            not force and is_current(f"camera_cal/{name}", key, folder / name)
        ):
            continue
        rvec, tvec, pose = board_pose(board, square_m, board_wh)
        end = None
        if "blur" in board:
            end = pose.copy()
            end[:2, 3] += board["blur"]
        light_rgb = trace(
            board_scene(board, light, square_m, k),
            lens,
            pose,
            end_pose=end,
            spp=spp,
            seed=about["seed"] + k,
            max_depth=4,
            shrink=shrink,
            per_pass=12,
        )
        exposure = light["exposure"] * 0.95 / np.percentile(light_rgb, 97)
        frame = develop(
            light_rgb,
            exposure=exposure,
            noise=0.0035,
            seed=k,
            vignette=0.28,
            sharpen=0.5,
            saturation=0.9,
            contrast=1.1,
            shoulder=False,
            edge_blur_px=1.6,
            blur_px=0.6,
        )
        write_jpeg(folder / name, frame)
        entry = {
            "raw_file": name,
            "rvec": np.round(rvec, 8).tolist(),
            "tvec": np.round(tvec, 8).tolist(),
            "square_m": square_m,
            "board_wh": board_wh,
            "tags": board.get("tags", []) + (["bowed"] if "bow" in board else []) + [board["light"]],
        }
        update_truth(folder / "truth.json", "boards", entry, [b["name"] for b in about["board"]])
        if shrink == 1 and folder == FOLDER:
            remember(f"camera_cal/{name}", key)
        print(f"{name}: board {k + 1} of {len(about['board'])}", flush=True)
