"""A rig from pictures of fairly straight road: no chessboard, no tape measure, no prior knowledge of the mounting.

Parallel lines meet in the picture at the vanishing point of the road; it gives pitch and yaw. The lane's width then
gives the height of the camera (see ``birdseye``). Three steps, each finer than the one before:

1. **Vote** (``vanishing``): candidates for the vanishing point and the height, from paint in the picture.
2. **Verify**: candidates become rigs; the one in which ``LaneFinder`` explains most paint over all frames is taken.
3. **Refine**: the finder's joint fit measures pitch, heading and width of the lane in every frame; the rig is
   corrected until their medians over the straight frames are zero, zero and the lane's width.

The focal length does not show in a straight lane. Dashes show it (``dashes``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from lanelib.birdseye import BirdsEye, angles_from_vanishing_point
from lanelib.camera import Camera
from lanelib.channels import as_bgr
from lanelib.dashes import DASH_PERIODS_M, DashPeriod, dash_period
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder
from lanelib.jointfit import BEND, HEADING, PITCH, UNKNOWN_ROAD, WIDTH, JointFit, supported_rows
from lanelib.rig import Rig
from lanelib.vanishing import candidates, height_prior

LANE_WIDTH_M = 3.7  # 12 ft, US motorways (AASHTO Green Book)
# dashboard cameras, cropped to 16:9, look 50-70 degrees wide (phones along their longer side, however they are held);
# only lengths along the road depend on it
HFOV_DEG = 60.0
NEARLY_STRAIGHT_1PM = 1 / 1500  # the lane leaves a straight line by 0.3 m in 30 m
CURVED_1PM = 1 / 150  # beyond, heading at the car and the bend trade places in the fit
BOTH_LINES_ROWS = 4.0  # rows of paint on the weaker line, of 112: a dash near the car has 12, four dots 5, a speck 3
# of a rig for one frame (see ``tried``): faint dots on concrete have 0.3, pictures upside down seldom more. For n
# frames less by n^(1/4): frames without a road do not agree on a rig (they reach 0.2), and some may be empty
MINIMUM_VALUE = 0.32
UNCERTAIN_PITCH, UNCERTAIN_HEADING = np.deg2rad((0.5, 1.5))  # standard deviations that make a rig useless
# steps and their length, of the picture's height: what the fit's own search for pitch (0.7 deg) just reaches
CLIMBS, CLIMB_STEP = 4, 0.05
# rad, of one frame: how parallel to its lane a car drives, how much it nods
CAR_HEADING, CAR_PITCH = 0.008, 0.004
FEW_FRAMES = 5  # fewer than that, of a clip, are worth a word
SEARCH_FRAMES, MAXIMUM_FRAMES = 8, 48  # of a clip, evenly spaced: to find the rig, and to refine it


@dataclass(frozen=True, eq=False)
class RigEstimate:
    """A rig and how well it is known. ``std``: standard deviation by name (height_m, pitch_deg, yaw_deg, focal_px;
    None where it was assumed): the spread of single frames, which a nodding car and a weaving driver cause too; of
    one frame, the fit's own."""

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


# ---------------------------------------------------------------------------------------------- 2. verify
def rig_at(camera: Camera, vanishing_px, height_m: float, name: str = "rig") -> Rig:
    """The rig of a level camera that sees the road's direction at ``vanishing_px`` from ``height_m``."""
    pitch_deg, yaw_deg = angles_from_vanishing_point(camera.camera_matrix, vanishing_px)
    return Rig(camera, BirdsEye.from_mounting(camera, height_m=height_m, pitch_deg=pitch_deg, yaw_deg=yaw_deg), name)


def vanishing_point(rig: Rig) -> tuple[float, float]:
    """Undistorted pixel of the road's direction, straight ahead at infinity."""
    u, v, w = rig.birdseye.image_from_road[:, 1]
    return float(u / w), float(v / w)


def look(rig: Rig, frames: list[np.ndarray]) -> list[JointFit]:
    """The lanes that a finder with this rig sees, each frame on its own."""
    try:
        finder = LaneFinder(rig, track=False)
        return [r.fit for r in map(finder.process, frames) if r.fit is not None]
    except LanelibError:  # a rig that sees no road
        return []


def both_lines(fits: list[JointFit]) -> list[JointFit]:
    """Those with paint on both lines: one line and an assumed width do not show the height."""
    return [fit for fit in fits if min(fit.rows) > BOTH_LINES_ROWS]


def typical_std(fits: list[JointFit]) -> np.ndarray:
    """Standard deviations (7,) of a single fit as it knows them itself: the median of all."""
    return np.sqrt(np.median([np.diag(fit.covariance) for fit in fits], axis=0))


def empty_inside(finder: LaneFinder, frame_bgr: np.ndarray, fit: JointFit) -> float:
    """1 for a lane without a third line between its two, 0.4 for one with: then it is two lanes, and the rig half as
    high as true."""
    (points, _), mean = finder.points(frame_bgr, finder.view((frame_bgr.shape[1], frame_bgr.shape[0]))), fit.mean
    inside = np.zeros(7)
    inside[WIDTH] = 1
    supports = [
        supported_rows(points, mean + inside * (2 * x - mean[WIDTH]))[0].sum(axis=1).max()
        for x in np.arange(0, 0.3 * mean[WIDTH], 0.1)
    ]
    weaker = max(min(fit.rows), 1.0)
    return 1 - 0.6 * float(np.clip(max(supports) / weaker - 0.25, 0, 1))


def corrected(rig: Rig, fits: list[JointFit]) -> Rig:
    """The rig turned and raised so that the median lane of ``fits`` is level, straight ahead and of the usual width."""
    mean = np.median([fit.mean for fit in fits], axis=0)
    mounting = dict(rig.mounting)
    mounting["pitch_deg"] += math.degrees(mean[PITCH])
    mounting["yaw_deg"] -= math.degrees(math.atan(mean[HEADING]))
    mounting["height_m"] *= UNKNOWN_ROAD.mean[WIDTH] / mean[WIDTH]
    return replace(rig, birdseye=BirdsEye.from_mounting(rig.camera, **mounting))


def tried(rig: Rig, frames: list[np.ndarray]) -> tuple[float, Rig]:
    """(value, rig): the rig once corrected, and how much paint it explains, about 1 a frame at best; 0 where it
    finds no lane."""
    fits = look(rig, frames)
    if not fits:
        return 0.0, rig
    rig = corrected(rig, both_lines(fits) or fits)
    value, finder = 0.0, LaneFinder(rig, track=False, neighbours=2)
    for frame in frames:
        result = finder.process(frame)
        if result.fit is None:
            continue
        rows = sum(result.fit.rows) + sum(neighbour.line.support for neighbour in result.neighbours)
        paint = math.sqrt(rows / 100)  # an easy frame has 100; the root, so that no frame decides alone
        both = min(1, min(result.fit.rows) / BOTH_LINES_ROWS)
        value += paint * result.confidence * both * empty_inside(finder, frame, result.fit)
    return value / len(frames) * math.sqrt(height_prior(rig.mounting["height_m"])), rig


def search(frames: list[np.ndarray], camera: Camera, name: str) -> tuple[float, Rig | None]:
    """The best rig for some frames: of the vote's candidates, then of its neighbours (in a curve the vote is drawn
    aside)."""
    trials = [tried(rig_at(camera, *c, name), frames) for c in candidates([camera.undistort(f) for f in frames])]
    value, rig = max(trials, key=lambda t: t[0], default=(0.0, None))
    for _ in range(CLIMBS):
        if rig is None or not value:
            break
        (u, v), height_m = vanishing_point(rig), rig.mounting["height_m"]
        step = CLIMB_STEP * camera.size_wh[1]
        around = [
            tried(rig_at(camera, (u + du * step, v + dv * step), height_m, name), frames)
            for du, dv in ((-1, 0), (1, 0), (0, -1), (0, 1))
        ]
        better = max(around, key=lambda t: t[0])
        if better[0] < 1.02 * value:
            break
        value, rig = better
    return value, rig


# ---------------------------------------------------------------------------------------------- 3. refine
def straight_of(fits: list[JointFit]) -> list[JointFit]:
    """The fits on straight road; where there is none, the straightest third of those in gentle curves."""
    found = sorted(fits, key=lambda fit: abs(fit.mean[BEND]))
    straight = [fit for fit in found if abs(2 * fit.mean[BEND]) < NEARLY_STRAIGHT_1PM]
    return straight or [fit for fit in found if abs(2 * fit.mean[BEND]) < CURVED_1PM][: math.ceil(len(found) / 3)]


def refined(rig: Rig, frames: list[np.ndarray], *, rounds: int = 4) -> tuple[Rig, list[JointFit]]:
    """The rig corrected on straight frames ``rounds`` times (each leaves a few hundredths of the error), and what it
    then sees."""
    for step in range(rounds + 1):
        found = both_lines(look(rig, frames))
        used = straight_of(found)
        if not used:
            what = "curves" if found else "lanes with one line"
            raise LanelibError(f"a rig needs straight road with both lines, found only {what}; give other frames")
        rig = corrected(rig, used) if step < rounds else rig
    own = typical_std(used)
    if own[PITCH] > UNCERTAIN_PITCH or own[HEADING] > UNCERTAIN_HEADING:
        raise LanelibError(
            f"a rig needs clear lines, found lines that leave its pitch open by {math.degrees(own[PITCH]):.1f} and its "
            f"yaw by {math.degrees(own[HEADING]):.1f} deg; give more or better frames"
        )
    return rig, used


def find_rig(
    frames_bgr,
    camera: Camera | None = None,
    *,
    lane_width_m: float = LANE_WIDTH_M,
    name: str = "rig",
    hfov_deg: float = HFOV_DEG,
    dash_period_m: float | None = None,
) -> RigEstimate:
    """The rig of the camera that took ``frames_bgr``: one picture (H, W, 3) uint8 BGR or a list of them, of fairly
    straight road.

    ``camera``: its calibration, or None: no distortion, principal point in the middle, the focal length that
    ``hfov_deg`` along the picture's longer side gives; with ``dash_period_m`` (see ``DASH_PERIODS_M``) the one that
    gives the dashes that period. The car is taken to drive parallel to its lane: of one frame that is an assumption,
    over a clip it averages out. Roll is taken as 0.

    Raises LanelibError where the frames do not allow it: no pair of lines, only curves, different sizes, no frame.
    """
    frames, camera, assumed = _usable(frames_bgr, camera, lane_width_m, hfov_deg, dash_period_m)
    some = frames[:: math.ceil(len(frames) / SEARCH_FRAMES)]
    value, rig = search(some, camera, name)
    if rig is None or value < MINIMUM_VALUE / len(some) ** 0.25:
        raise LanelibError(
            "a rig needs a lane with a line on either side of the car, found no clear pair in "
            f"{len(frames)} frame{'s' if len(frames) > 1 else ''}; give frames of straight, marked road"
        )
    rig, used = refined(rig, frames)
    scale = lane_width_m / UNKNOWN_ROAD.mean[WIDTH]
    dash = dash_period(rig, frames)
    focal_std = None if assumed or not camera.std else camera.std.get("fx")
    if dash_period_m is not None:
        _check_measured(dash)
        for _ in range(3):  # the fit's own noise shifts with the focal length: twice is enough, the third shows it
            camera = Camera.ideal(
                camera.size_wh, focal_px=camera.camera_matrix[0, 0] * dash_period_m / (dash.period_m * scale)
            )
            rig, used = refined(rig_at(camera, vanishing_point(rig), rig.mounting["height_m"], name), frames, rounds=2)
            dash = dash_period(rig, frames)
            _check_measured(dash)
        focal_std = float(camera.camera_matrix[0, 0] * dash.std_m / dash.period_m)
    dash = replace(dash, period_m=dash.period_m * scale, std_m=dash.std_m * scale)
    rig = replace(
        rig, birdseye=replace(rig.birdseye, road_from_image=np.diag([scale, scale, 1]) @ rig.birdseye.road_from_image)
    )
    return _estimate(rig, used, frames, dash, focal_std, lane_width_m, assumed, dash_period_m)


def _check_measured(dash: DashPeriod) -> None:
    """LanelibError where there is no dash period to take the focal length from."""
    if not dash:
        raise LanelibError(
            f"the focal length needs dashes to measure, found {dash.reason}; give frames with a dashed line"
        )


def _usable(frames_bgr, camera, lane_width_m, hfov_deg, dash_period_m) -> tuple[list[np.ndarray], Camera, bool]:
    """The frames (a clip thinned), the camera of their size, and whether it is only assumed; LanelibError for what
    cannot be used."""
    if not isinstance(frames_bgr, Iterable):
        raise LanelibError(f"a rig needs a picture or a list of them, found {type(frames_bgr).__name__}; give frames")
    frames = [frames_bgr] if isinstance(frames_bgr, np.ndarray) and frames_bgr.ndim < 4 else list(frames_bgr)
    if not frames:
        raise LanelibError("a rig needs at least one frame of straight road, found none; give a picture or a clip")
    if not 2 < lane_width_m < 6:
        raise LanelibError(f"a lane is 2 to 6 m wide, found {lane_width_m}; give its width in metres")
    if dash_period_m is not None and camera is not None:
        raise LanelibError("a calibrated camera has its focal length, found a dash period too; give one of the two")
    if dash_period_m is not None and not 0 < dash_period_m < math.inf:
        raise LanelibError(f"a period of dashes is above 0 m, found {dash_period_m}; measure a dash and its gap")
    every = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MAXIMUM_FRAMES)).round().astype(int))
    frames = [as_bgr(frames[i]) for i in every]
    size_wh = frames[0].shape[1::-1]
    if any(f.shape[1::-1] != size_wh for f in frames):
        raise LanelibError("the frames of a rig must all have one size, found several; give frames of one camera")
    if min(size_wh) < 100:
        raise LanelibError(
            f"a rig needs pictures of at least 100x100, found {size_wh[0]}x{size_wh[1]}; give the camera's own"
        )
    if camera is not None:
        return frames, camera.scaled(size_wh), False
    wide = Camera.ideal(sorted(size_wh, reverse=True), hfov_deg=hfov_deg)  # a phone held upright has the same lens
    return frames, Camera.ideal(size_wh, focal_px=float(wide.camera_matrix[0, 0])), True


def _estimate(rig, used, frames, dash, focal_std, lane_width_m, assumed, dash_period_m) -> RigEstimate:
    """Numbers, their spread and the sentence about them."""
    means, own = np.array([fit.mean for fit in used]), typical_std(used)
    if len(used) > 2:
        spread = np.maximum(means.std(axis=0, ddof=1), own)
    else:
        spread = np.hypot(own, [0, CAR_HEADING, 0, 0, 0, CAR_PITCH, 0])
    m = rig.mounting
    std = {
        "height_m": float(m["height_m"] * spread[WIDTH] / UNKNOWN_ROAD.mean[WIDTH]),
        "pitch_deg": math.degrees(spread[PITCH]),
        "yaw_deg": math.degrees(spread[HEADING]),
        "focal_px": focal_std,
    }
    focal = float(rig.camera.camera_matrix[0, 0])
    bend = float(np.median(np.abs(2 * means[:, BEND])))
    if not assumed:
        rms = rig.camera.rms_px
        how = "calibrated" if rms is None else f"calibrated, RMS {rms:.2f} px"
    elif dash_period_m is not None:
        how = f"+- {focal_std:.0f} from dashes every {dash_period_m} m"
    else:
        how = "assumed"
        if dash:
            would = ", ".join(f"{focal * p / dash.period_m:.0f} if {p} m" for p in DASH_PERIODS_M.values())
            how += f"; by the dashes {would}"
    words = [
        f"{rig.name}: height {m['height_m']:.2f} +- {std['height_m']:.2f} m (lane {lane_width_m} m)",
        f"pitch {m['pitch_deg']:.2f} +- {std['pitch_deg']:.2f} deg",
        f"yaw {m['yaw_deg']:.2f} +- {std['yaw_deg']:.2f} deg",
        f"focal length {focal:.0f} px ({how})",
        f"from {len(used)} of {len(frames)} frame{'s' if len(frames) > 1 else ''}",
        dash.compared(dash_period_m),
    ]
    if len(used) < FEW_FRAMES and len(used) < len(frames) / 5:
        words.append(
            "little straight road with both lines was seen: yaw and pitch are less certain; give a clip of more of it"
        )
    if bend > NEARLY_STRAIGHT_1PM:
        words.append(f"no straight road seen, the straightest has a radius of {1 / bend:.0f} m: yaw is less certain")
    notes = "; ".join(words)
    angles = (m["height_m"], m["pitch_deg"], m["yaw_deg"])
    return RigEstimate(replace(rig, notes=notes), vanishing_point(rig), *angles, focal, std, len(used), dash, notes)
