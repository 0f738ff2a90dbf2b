"""A rig from pictures of fairly straight road: no chessboard, no tape measure, no prior knowledge of the mounting.

Parallel lines meet in the picture at the vanishing point of the road; it gives pitch and yaw. The lane's width then gives the
height of the camera (see ``birdseye``). Three steps, each coarser than the next:

1. **Vote.** Paint is a ridge in the picture too. Every paint point (u, v) and every possible vanishing point (u0, v0) make one
   slope s = (u - u0) / (v - v0), the lateral position x / height on the road, whatever the focal length. Where (u0, v0) is right,
   the points of a line fall on one s: a Hough transform over (u0, v0, s). Pairs of peaks left and right of the car are lanes.
2. **Verify.** The best candidates become rigs; the one in which ``LaneFinder`` explains most paint over all frames is taken.
3. **Refine.** The finder's joint fit measures pitch, heading and width of the lane in every frame; the rig is corrected until
   their medians over the straight frames are zero, zero and the lane's width.

The focal length cannot be seen in one straight lane. Dashes show it: their period on the road is set by regulation, and
metres along the road are proportional to the focal length, y = height f / (v - v0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanelib.birdseye import BirdsEye, angles_from_vanishing_point
from lanelib.camera import Camera
from lanelib.channels import as_bgr
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder
from lanelib.jointfit import BEND, HEADING, PITCH, UNKNOWN_ROAD, WIDTH, distance, line_x, supported_rows
from lanelib.paint import PAINT_WIDTH_M, paint_channels, paint_evidence, ridge_response, weight_of
from lanelib.result import LaneResult
from lanelib.rig import SCAN_COLUMN_M, Rig

LANE_WIDTH_M = 3.7  # 12 ft, US motorways (AASHTO Green Book)
HFOV_DEG = 60.0  # dashboard cameras look 50-70 degrees wide when their pictures are cropped to 16:9; only lengths along the road depend on it
DASH_PERIODS_M = {"California": 14.63, "federal": 12.19}  # 12 + 36 ft (Caltrans detail 8-14); 10 + 30 ft (US manual, sec. 3A.06)

VOTE_WIDTH_PX = 640  # the vote's picture: paint is still 2 px wide where the vote needs it
PAINT_WIDTHS_PX = (3, 7)  # each also tries 2.3 times its width (see ``paint``): 3-16 px of 640, far to near
VOTE_POINTS = 2500  # the strongest paint points of a frame that vote
HORIZON_ROWS = (0.10, 0.65)  # of the height, from a camera that looks steeply down to one that looks up
VANISHING_COLUMNS = (0.15, 0.85)  # of the width: a yaw of 20 degrees
VOTE_STEP = 0.0125  # of height and width: half the slope bin for a point in the middle of the road
SLOPE_BIN, SLOPE_REACH = 0.06, 4.5  # 7 cm of road for a camera at 1.2 m; lines leave most pictures at 4
USUAL_HEIGHT_M, HEIGHT_SPREAD = 1.4, 0.35  # cars 1.1-1.7 m, lorries to 2.8 m: log-normal, so that half the lane or two lanes lose
HEIGHTS_M = (0.8, 3.2)
STRAIGHT_1PM = 1 / 1500  # the lane leaves a straight line by 0.3 m in 30 m
CURVED_1PM = 1 / 300  # beyond, heading at the car and the bend trade places in the fit
BOTH_LINES_ROWS = 6.0  # rows of paint on the weaker line, of 136: a dash near the car has 15, a speck 3
MINIMUM_VALUE = 0.25  # of a rig (see ``tried``)
CLIMBS, CLIMB_STEP = 4, 0.05  # steps and their length, of the height: what the fit's own search for pitch (0.7 deg) just reaches
CAR_HEADING, CAR_PITCH = 0.008, 0.004  # spread in rad within and between clips: how parallel cars drive, how much they nod
DASH_RANGE_M = (5.0, 45.0)  # three periods; beyond, a pixel is longer than a third of a dash
DASH_PERIODS_TRIED_M = (7.5, 22.0)  # of the world's roads: 8-18 m, and focal lengths guessed 20 % wrong
DASH_CORRELATION = 0.6  # of a profile with a square wave; broken solid lines reach less
MAXIMUM_FRAMES = 48  # of a clip, evenly spaced; more only repeat each other


@dataclass(frozen=True, eq=False)
class DashPeriod:
    """Length of dash plus gap along a dashed line, on the rig's scale, metres. Falsy with a ``reason`` where none was seen."""

    period_m: float = math.nan
    std_m: float = math.nan
    n_lines: int = 0
    reason: str = ""

    def __bool__(self):
        return not self.reason

    def __iter__(self):
        return iter((self.period_m, self.std_m))

    def __repr__(self):
        if not self:
            return f"no dash period: {self.reason}"
        name, length = min(DASH_PERIODS_M.items(), key=lambda item: abs(math.log(self.period_m / item[1])))
        off = 100 * (self.period_m / length - 1)
        return (f"dash period {self.period_m:.2f} +- {self.std_m:.2f} m measured on {self.n_lines} lines: {length} expected ({name}), "
                f"longitudinal scale off by {off:+.1f} %")


@dataclass(frozen=True, eq=False)
class RigEstimate:
    """A rig and how well it is known. ``std``: standard deviation by name (height_m, pitch_deg, yaw_deg, focal_px; None where it was
    assumed): the spread of single frames, which a nodding car and a weaving driver cause too; of one frame, the fit's own."""

    rig: Rig
    vanishing_px: tuple[float, float]
    height_m: float
    pitch_deg: float
    yaw_deg: float
    focal_px: float
    std: dict
    n_frames: int
    dash: DashPeriod
    notes: str

    def __repr__(self):
        return f"RigEstimate({self.notes})"


# ---------------------------------------------------------------------------------------------- 1. vote
def picture_points(undistorted_bgr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Paint crests of a picture (H, W, 3) as the camera sees it: pixels (N, 2), weights (N,); of all widths paint has, far to near."""
    h, w = undistorted_bgr.shape[:2]
    scale = min(1.0, VOTE_WIDTH_PX / w)
    small = cv2.resize(undistorted_bgr, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    z = np.zeros(small.shape[:2], np.float32)
    for channel in paint_channels(small):
        for width in PAINT_WIDTHS_PX:
            z = cv2.max(z, ridge_response(channel, column_m=PAINT_WIDTH_M / width))
    z = cv2.blur(z, (3, 3))
    z[: int(HORIZON_ROWS[0] * len(z))] = 0
    row, column = np.nonzero((z[:, 1:-1] >= z[:, :-2]) & (z[:, 1:-1] > z[:, 2:]))
    weight = weight_of(z[row, column + 1])
    best = np.argsort(-weight, kind="stable")[:VOTE_POINTS]
    best = best[weight[best] > 0]
    return np.column_stack([(column[best] + 1.5) * w / small.shape[1] - 0.5, (row[best] + 0.5) * h / small.shape[0] - 0.5]), weight[best]


def vote_grid(size_wh) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (px) of the possible vanishing points."""
    w, h = size_wh
    return np.arange(*VANISHING_COLUMNS, VOTE_STEP) * w, np.arange(*HORIZON_ROWS, VOTE_STEP) * h


def slope_peaks(points_px, weights, columns, row, height_px) -> np.ndarray:
    """For vanishing points (columns, row): how far the paint at every slope stands out of its surroundings, (columns, slopes)."""
    n = int(round(2 * SLOPE_REACH / SLOPE_BIN))
    below = points_px[:, 1] > row + 0.04 * height_px  # nearer to the horizon one pixel is a lane wide
    u, v, weight = points_px[below, 0], points_px[below, 1], weights[below]
    bins = ((u - np.asarray(columns)[:, None]) / (v - row) + SLOPE_REACH) / SLOPE_BIN
    index = bins.astype(np.int32)
    inside = (bins >= 0) & (index < n)
    index += np.arange(len(columns), dtype=np.int32)[:, None] * n
    table = np.bincount(index[inside], np.broadcast_to(weight, index.shape)[inside], len(columns) * n).reshape(-1, n).astype(np.float32)
    sharp = cv2.sepFilter2D(table, -1, np.array([0.5, 1, 0.5]), np.ones(1), borderType=cv2.BORDER_CONSTANT)
    around = cv2.blur(table, (25, 1), borderType=cv2.BORDER_CONSTANT)  # 1.5 slopes: about a lane's half
    return np.maximum(sharp - 4 * around, 0)  # twice what an even spread would give


def best_pairs(peaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each row of peaks (M, slopes) the best pair of lines left and right of the car: score (M,) and slope difference (M,).

    Both lines must be there (geometric mean), at a distance that a usual camera height explains.
    """
    slopes = (np.arange(peaks.shape[1]) + 0.5) * SLOPE_BIN - SLOPE_REACH
    root = np.sqrt(peaks)
    left, right = root * (slopes < -0.2), root * (slopes > 0.2)  # a car does not straddle its line: 0.25 m
    best, difference = np.zeros(len(peaks)), np.full(len(peaks), np.nan)
    usual = UNKNOWN_ROAD.mean[WIDTH]
    for k in range(int(usual / HEIGHTS_M[1] / SLOPE_BIN), int(usual / HEIGHTS_M[0] / SLOPE_BIN) + 1):
        score = (left[:, :-k] * right[:, k:]).max(axis=1) * height_prior(usual / (k * SLOPE_BIN))
        better = score > best
        best[better], difference[better] = score[better], k * SLOPE_BIN
    return best, difference


def height_prior(height_m: float) -> float:
    """How usual a camera height is, 0..1."""
    return math.exp(-0.5 * (math.log(height_m / USUAL_HEIGHT_M) / HEIGHT_SPREAD) ** 2)


def candidates(pictures: list[np.ndarray], *, count: int = 8) -> list[tuple[tuple[float, float], float]]:
    """The most promising (vanishing point in px, height in m for a lane of the usual width), best first, of undistorted pictures."""
    h, w = pictures[0].shape[:2]
    columns, rows = vote_grid((w, h))
    total = np.zeros((len(rows), len(columns)), np.float32)
    differences = []
    for picture in pictures:
        points, weights = picture_points(picture)
        scored = [best_pairs(slope_peaks(points, weights, columns, row, h)) for row in rows]
        one = np.array([s for s, _ in scored], np.float32)
        total += cv2.GaussianBlur(one, (5, 5), 1.0)  # the car nods and weaves: neighbours agree
        differences.append((one, np.array([d for _, d in scored])))
    peak = (total >= cv2.dilate(total, np.ones((5, 5)))) & (total > 0)
    found = []
    for i, j in sorted(zip(*np.nonzero(peak)), key=lambda ij: -total[ij])[:count]:
        near = slice(max(i - 1, 0), i + 2), slice(max(j - 1, 0), j + 2)
        score = np.concatenate([s[near].ravel() for s, _ in differences])
        difference = np.concatenate([d[near].ravel() for _, d in differences])
        order = np.argsort(difference[score > 0])
        middle = np.searchsorted(np.cumsum(score[score > 0][order]), score.sum() / 2)
        found.append(((float(columns[j]), float(rows[i])), float(UNKNOWN_ROAD.mean[WIDTH] / difference[score > 0][order][middle])))
    return found


# ---------------------------------------------------------------------------------------------- 2. verify
def rig_at(camera: Camera, vanishing_px, height_m: float, name: str = "rig") -> Rig:
    """The rig of a level camera that sees the road's direction at ``vanishing_px`` from ``height_m``."""
    pitch_deg, yaw_deg = angles_from_vanishing_point(camera.camera_matrix, vanishing_px)
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=height_m, pitch_deg=pitch_deg, yaw_deg=yaw_deg), name)


def vanishing_point(rig: Rig) -> tuple[float, float]:
    """Undistorted pixel of the road's direction, straight ahead at infinity."""
    u, v, w = rig.birdseye.image_from_road[:, 1]
    return float(u / w), float(v / w)


def look(rig: Rig, frames: list[np.ndarray]) -> list[LaneResult]:
    """The lanes that a finder with this rig sees, each frame on its own."""
    try:
        finder = LaneFinder(rig, track=False)
        return [r for r in map(finder.process, frames) if r]
    except LanelibError:  # a rig that sees no road
        return []


def both_lines(results: list[LaneResult]) -> list[LaneResult]:
    """Those with paint on both lines: one line and an assumed width do not show the height."""
    return [r for r in results if r.fit.support.sum(axis=1).min() > BOTH_LINES_ROWS]


def empty_inside(finder: LaneFinder, frame_bgr: np.ndarray, result: LaneResult) -> float:
    """1 for a lane without a third line between its two, 0.4 for one with: then it is two lanes, and the rig half as high as true."""
    (points, _), mean = finder.points(frame_bgr, finder.view(result.size_wh)), result.fit.mean
    inside = np.zeros(7)
    inside[WIDTH] = 1
    supports = [supported_rows(points, mean + inside * (2 * x - mean[WIDTH]))[0].sum(axis=1).max()
                for x in np.arange(0, 0.3 * mean[WIDTH], 0.1)]
    weaker = max(result.fit.support.sum(axis=1).min(), 1.0)
    return 1 - 0.6 * float(np.clip(max(supports) / weaker - 0.25, 0, 1))


def corrected(rig: Rig, results: list[LaneResult]) -> Rig:
    """The rig turned and raised so that the median lane of ``results`` is level, straight ahead and of the usual width."""
    mean = np.median([r.fit.mean for r in results], axis=0)
    mounting = dict(rig.mounting)
    mounting["pitch_deg"] += math.degrees(mean[PITCH])
    mounting["yaw_deg"] -= math.degrees(math.atan(mean[HEADING]))
    mounting["height_m"] *= UNKNOWN_ROAD.mean[WIDTH] / mean[WIDTH]
    return replace(rig, birdseye=BirdsEye.from_mounting(rig.camera, **mounting))


def tried(rig: Rig, frames: list[np.ndarray]) -> tuple[float, Rig]:
    """(value, rig): the rig once corrected, and how much paint it explains, about 1 a frame at best; 0 where it finds no lane."""
    results = look(rig, frames)
    if not results:
        return 0.0, rig
    rig = corrected(rig, both_lines(results) or results)
    value, finder = 0.0, LaneFinder(rig, track=False)
    for frame in frames:
        result = finder.process(frame)
        if result:  # an easy frame has 100 rows of paint; the root, so that no frame decides alone
            rows = result.fit.support.sum(axis=1)
            value += math.sqrt(rows.sum() / 100) * result.confidence * min(1, rows.min() / BOTH_LINES_ROWS) * empty_inside(finder, frame, result)
    return value / len(frames) * math.sqrt(height_prior(rig.mounting["height_m"])), rig


def search(frames: list[np.ndarray], camera: Camera, name: str) -> tuple[float, Rig | None]:
    """The best rig for some frames: of the vote's candidates, then of its neighbours (in a curve the vote is drawn aside)."""
    trials = [tried(rig_at(camera, *c, name), frames) for c in candidates([camera.undistort(f) for f in frames])]
    value, rig = max(trials, key=lambda t: t[0], default=(0.0, None))
    for _ in range(CLIMBS):
        if rig is None or not value:
            break
        (u, v), height_m = vanishing_point(rig), rig.mounting["height_m"]
        step = CLIMB_STEP * camera.size_wh[1]
        around = [tried(rig_at(camera, (u + du * step, v + dv * step), height_m, name), frames)
                  for du, dv in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        better = max(around, key=lambda t: t[0])
        if better[0] < 1.02 * value:
            break
        value, rig = better
    return value, rig


# ---------------------------------------------------------------------------------------------- 3. refine
def straight_of(results: list[LaneResult]) -> list[LaneResult]:
    """The results on straight road; where there is none, the straightest third of those in gentle curves."""
    found = sorted(results, key=lambda r: abs(r.fit.mean[BEND]))
    straight = [r for r in found if abs(2 * r.fit.mean[BEND]) < STRAIGHT_1PM]
    return straight or [r for r in found if abs(2 * r.fit.mean[BEND]) < CURVED_1PM][: math.ceil(len(found) / 3)]


def refined(rig: Rig, frames: list[np.ndarray], *, rounds: int = 4) -> tuple[Rig, list[LaneResult]]:
    """The rig corrected on straight frames ``rounds`` times (each leaves a few hundredths of the error), and what it then sees."""
    for _ in range(rounds):
        used = straight_of(both_lines(look(rig, frames)))
        if not used:
            break
        rig = corrected(rig, used)
    used = straight_of(both_lines(look(rig, frames)))
    if not used:
        raise LanelibError("a rig needs straight road, found only curves; give frames of a straight stretch")
    return rig, used


def find_rig(frames_bgr, camera: Camera | None = None, *, lane_width_m: float = LANE_WIDTH_M, name: str = "rig",
             hfov_deg: float = HFOV_DEG, dash_period_m: float | None = None) -> RigEstimate:
    """The rig of the camera that took ``frames_bgr``: one picture (H, W, 3) uint8 BGR or a list of them, of fairly straight road.

    ``camera``: its calibration, or None: no distortion, principal point in the middle, the focal length that ``hfov_deg`` gives;
    with ``dash_period_m`` (see ``DASH_PERIODS_M``) the one that gives the dashes that period. The car is taken to drive parallel
    to its lane: of one frame that is an assumption, over a clip it averages out. Roll is taken as 0.

    Raises LanelibError where the frames do not allow it: no pair of lines, only curves, different sizes, no frame.
    """
    frames, camera, assumed = _usable(frames_bgr, camera, lane_width_m, hfov_deg)
    value, rig = search(frames[:: math.ceil(len(frames) / 8)], camera, name)
    if rig is None or value < MINIMUM_VALUE:
        raise LanelibError("a rig needs a lane with a line on either side of the car, found no clear pair in "
                           f"{len(frames)} frame{'s'[: len(frames) > 1]}; give frames of straight, marked road")
    rig, used = refined(rig, frames)
    scale = lane_width_m / UNKNOWN_ROAD.mean[WIDTH]
    dash = dash_period(rig, frames)
    focal_std = None if assumed or not camera.std else camera.std.get("fx")
    if dash_period_m is not None:
        if not assumed:
            raise LanelibError("a calibrated camera has its focal length, found a dash period too; give one of the two")
        for _ in range(3):  # the fit's own noise shifts with the focal length: twice is enough, the third shows it
            if not dash:
                raise LanelibError(f"the focal length needs dashes to measure, found {dash.reason}; give frames with a dashed line")
            camera = Camera.ideal(camera.size_wh, focal_px=camera.camera_matrix[0, 0] * dash_period_m / (dash.period_m * scale))
            rig, used = refined(rig_at(camera, vanishing_point(rig), rig.mounting["height_m"], name), frames, rounds=2)
            dash = dash_period(rig, frames)
        focal_std = float(camera.camera_matrix[0, 0] * dash.std_m / dash.period_m)
    dash = replace(dash, period_m=dash.period_m * scale, std_m=dash.std_m * scale)
    rig = replace(rig, birdseye=replace(rig.birdseye, road_from_image=np.diag([scale, scale, 1]) @ rig.birdseye.road_from_image))
    return _estimate(rig, used, frames, dash, focal_std, lane_width_m, assumed, dash_period_m)


def _usable(frames_bgr, camera, lane_width_m, hfov_deg):
    """The frames (a clip thinned), the camera of their size, and whether it is only assumed; LanelibError for what cannot be used."""
    frames = [frames_bgr] if isinstance(frames_bgr, np.ndarray) and frames_bgr.ndim < 4 else list(frames_bgr)
    if not frames:
        raise LanelibError("a rig needs at least one frame of straight road, found none; give a picture or a clip")
    if not 2 < lane_width_m < 6:
        raise LanelibError(f"a lane is 2 to 6 m wide, found {lane_width_m}; give its width in metres")
    every = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MAXIMUM_FRAMES)).round().astype(int))
    frames = [as_bgr(frames[i]) for i in every]
    size_wh = frames[0].shape[1::-1]
    if any(f.shape[1::-1] != size_wh for f in frames):
        raise LanelibError("the frames of a rig must all have one size, found several; give frames of one camera")
    if min(size_wh) < 100:
        raise LanelibError(f"a rig needs pictures of at least 100x100, found {size_wh[0]}x{size_wh[1]}; give the camera's own")
    return frames, Camera.ideal(size_wh, hfov_deg=hfov_deg) if camera is None else camera.scaled(size_wh), camera is None


def _estimate(rig, used, frames, dash, focal_std, lane_width_m, assumed, dash_period_m) -> RigEstimate:
    """Numbers, their spread and the sentence about them."""
    means = np.array([r.fit.mean for r in used])
    own = np.sqrt(np.median([np.diag(r.fit.covariance) for r in used], axis=0))
    spread = np.maximum(means.std(axis=0, ddof=1), own) if len(used) > 2 else np.hypot(own, [0, CAR_HEADING, 0, 0, 0, CAR_PITCH, 0])
    m = rig.mounting
    std = {"height_m": float(m["height_m"] * spread[WIDTH] / UNKNOWN_ROAD.mean[WIDTH]), "pitch_deg": math.degrees(spread[PITCH]),
           "yaw_deg": math.degrees(spread[HEADING]), "focal_px": focal_std}
    focal = float(rig.camera.camera_matrix[0, 0])
    bend = float(np.median(np.abs([2 * r.fit.mean[BEND] for r in used])))
    how = "calibrated" if not assumed else "assumed" if dash_period_m is None else f"from dashes every {dash_period_m} m, +- {focal_std:.0f}"
    words = [f"{rig.name}: height {m['height_m']:.2f} +- {std['height_m']:.2f} m (lane {lane_width_m} m)",
             f"pitch {m['pitch_deg']:.2f} +- {std['pitch_deg']:.2f} deg", f"yaw {m['yaw_deg']:.2f} +- {std['yaw_deg']:.2f} deg",
             f"focal length {focal:.0f} px ({how})", f"from {len(used)} of {len(frames)} frame{'s'[: len(frames) > 1]}", repr(dash)]
    if bend > STRAIGHT_1PM:
        words.append(f"no straight road seen, the straightest has a radius of {1 / bend:.0f} m: yaw is less certain")
    notes = "; ".join(words)
    return RigEstimate(replace(rig, notes=notes), vanishing_point(rig), m["height_m"], m["pitch_deg"], m["yaw_deg"], focal, std, len(used),
                       dash, notes)


# ---------------------------------------------------------------------------------------------- the dashes
def line_profile(finder: LaneFinder, frame_bgr: np.ndarray, result: LaneResult, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Paint weight 0..1 along the left (``side`` -1) or right (+1) line of ``result``: distances (N,) in m, descending; weights (N,)."""
    view, mean = finder.view(result.size_wh), result.fit.mean
    z, _ = paint_evidence(view.scan(frame_bgr), column_m=SCAN_COLUMN_M)
    y = distance(1 / view.grid.y_m, mean, view.height_m)
    column = view.grid.column_of(line_x(y, mean, side) / y * view.grid.y_m)
    rows = np.flatnonzero((y > DASH_RANGE_M[0]) & (y < DASH_RANGE_M[1]) & (column > 4) & (column < len(view.grid.x_m) - 5))
    around = z[rows[:, None], np.round(column[rows]).astype(int)[:, None] + np.arange(-3, 4)]  # 15 cm either side
    return y[rows], weight_of(around.max(axis=1))


def dash_likelihood(y_m, weight, periods_m, blur_m) -> tuple[np.ndarray, float]:
    """Log likelihood (P,) of each period for one profile (N,), and the best correlation found.

    A square wave of every phase and of two duty cycles, blurred as the picture blurs it (``blur_m`` (N,)), is compared with the profile;
    log L = -n / 2 log(1 - r^2) for correlation r of n independent values, here a quarter of the rows.
    """
    w = weight - weight.mean()
    phases = np.arange(32) / 32
    likelihood, best = np.zeros(len(periods_m)), 0.0
    for i, period in enumerate(periods_m):
        u = y_m[None, :] / period - phases[:, None]
        half = blur_m[None, :] / (2 * period)
        r = max(float(_correlation(_covered(u, half, duty), w).max()) for duty in (0.25, 0.4))
        best = max(best, r)
        likelihood[i] = -len(w) / 8 * math.log(1 - min(max(r, 0.0), 0.999) ** 2)
    return likelihood, best


def _covered(u, half, duty):
    """Share of [u - half, u + half] covered by paint that fills the first ``duty`` of every period (Marking.coverage does the same)."""
    upto = lambda t: np.floor(t) * duty + np.minimum(t - np.floor(t), duty)  # noqa: E731
    return (upto(u + half) - upto(u - half)) / (2 * half)


def _correlation(templates, w):
    t = templates - templates.mean(axis=1, keepdims=True)
    return t @ w / np.sqrt((t * t).sum(axis=1) * (w @ w) + 1e-9)


def dash_period(rig: Rig, frames: list[np.ndarray]) -> DashPeriod:
    """The period of the dashes along the ego lane's lines in ``frames`` (a list of (H, W, 3) uint8 BGR), measured on the rig's scale.

    Each dashed line of each frame gives a likelihood over periods; their sum has its peak at the period, its spread under
    resampling of the lines (bootstrap, Efron 1979) gives the standard deviation.
    """
    finder = LaneFinder(rig, track=False)
    periods = np.geomspace(*DASH_PERIODS_TRIED_M, 240)
    focal_px, height_m = rig.camera.camera_matrix[1, 1], rig.mounting["height_m"]
    curves = []
    for frame in frames:
        result = finder.process(frame)
        if not result or abs(2 * result.fit.mean[BEND]) > CURVED_1PM:
            continue
        for side in (-1, 1):
            y, weight = line_profile(finder, frame, result, side)
            if len(y) < 30 or not 0.08 < weight.mean() < 0.7:
                continue
            blur = np.maximum(y * y / (focal_px * height_m), np.abs(np.gradient(y)))  # a pixel's length on the road; a row's
            curve, best = dash_likelihood(y, weight, periods, blur)
            if best > DASH_CORRELATION:
                curves.append(curve)
    if not curves:
        return DashPeriod(reason="no dashed line was clear enough")
    curves = np.array(curves)
    total = curves.sum(axis=0)
    top = int(total.argmax())
    if top in (0, len(periods) - 1):
        return DashPeriod(n_lines=len(curves), reason=f"no period between {periods[0]:.0f} and {periods[-1]:.0f} m")
    likely = np.exp(np.clip(total - total.max(), -50, 0))
    mean = float(likely @ np.log(periods) / likely.sum())
    std = math.sqrt(float(likely @ (np.log(periods) - mean) ** 2 / likely.sum()))
    if len(curves) > 4:
        rng = np.random.default_rng(0)
        again = [periods[curves[rng.integers(len(curves), size=len(curves))].sum(axis=0).argmax()] for _ in range(100)]
        std = max(std, float(np.std(np.log(again))))
    return DashPeriod(math.exp(mean), math.exp(mean) * std, len(curves))
