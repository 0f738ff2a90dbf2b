"""The clips: frames rendered one by one into a working folder, encoded when a clip (or a part of it) is there.

Every frame is a picture and its truth in two files, each written under a temporary name and renamed; whatever exists
is not rendered again. So a run can be stopped at any moment and continued, and a part can be encoded as a clip.
"""

import gc
import json
import subprocess
import time
import tomllib

import cv2
import imageio_ffmpeg
import numpy as np

from lanelib.road import CarPose, Mounting

from .files import is_current, remember, scene_key, write_bytes, write_json
from .lens import HERE, ROOT, true_lens
from .shoot import shoot
from .stills import layouts, merged
from .world import World, mounting_of

FOLDER = ROOT / "test_videos" / "rendered"
WORK = ROOT / "build" / "frames"  # not in git
LOOK = 1
CRF, EXPOSURE_S = 22, 1 / 400  # H.264 quality; shutter of a dash cam in daylight


def describe():
    """{name: scene}: the clips of videos.toml with their layouts."""
    roads = layouts()
    about = tomllib.loads((HERE / "scenes" / "videos.toml").read_text())
    return {c["name"]: merged(roads[c["layout"]], c) for c in about["clip"]}


class Drive:
    """Where the car is and how it moves: smooth, seeded sums of sines of a car's own frequencies.

    Lateral wander of a driver (0.05-0.15 Hz, some 15 cm), heading as its derivative, pitch and roll of the body on its
    springs (1.1-1.6 Hz, tenths of a degree) with single bumps of the scene, height from the same bumps.
    """

    def __init__(self, clip):
        self.clip, self.rng = clip, np.random.default_rng(clip.get("seed", 1))
        self.phase = self.rng.uniform(0, 2 * np.pi, 12)
        self.speed, self.mounting = clip["speed"], mounting_of(clip)

    def lateral(self, t):
        p, amount = self.phase, self.clip.get("wander_m", 0.16)
        slow, quick = np.sin(2 * np.pi * 0.07 * t + p[0]), np.sin(2 * np.pi * 0.17 * t + p[1])
        return self.clip["pose"]["d"] + amount * (slow + 0.45 * quick + 0.15 * np.sin(2 * np.pi * 0.41 * t + p[2]))

    def pose(self, t) -> CarPose:
        h = 0.01
        drift = (self.lateral(t + h) - self.lateral(t - h)) / (2 * h)
        s_m = self.clip.get("s_start", 0.0) + self.speed * t
        return CarPose(s_m, float(self.lateral(t)), -float(np.arctan2(drift, self.speed)))

    def mounted(self, t) -> Mounting:
        p, rough = self.phase, self.clip.get("rough", 1.0)
        pitch = rough * (
            0.05 * np.sin(2 * np.pi * 1.13 * t + p[3])
            + 0.035 * np.sin(2 * np.pi * 1.71 * t + p[4])
            + 0.012 * np.sin(2 * np.pi * 4.3 * t + p[5])
        )
        lift = rough * 0.004 * np.sin(2 * np.pi * 1.2 * t + p[6])
        for moment, amount in self.clip.get("bumps", []):  # a bump: damped swing at the body's own frequency
            u = t - moment
            if u > 0:
                swing = amount * np.exp(-u / 0.35)
                pitch += swing * np.sin(2 * np.pi * 1.5 * u)
                lift += 0.03 * swing * np.sin(2 * np.pi * 1.3 * u)
        roll = rough * (0.07 * np.sin(2 * np.pi * 0.9 * t + p[7]) + 0.02 * np.sin(2 * np.pi * 2.6 * t + p[8]))
        m = self.mounting
        return Mounting(m.height_m + lift, m.pitch_deg + float(pitch), m.roll_deg + float(roll), m.yaw_deg)


def frame_count(clip):
    return round(clip["seconds"] * clip["fps"])


def render_clips(names=(), *, spp=4, frames=None, every=1, shrink=1, work=None):
    """Render what is missing of the named clips, frame by frame."""
    for name, clip in describe().items():
        if names and name.rsplit(".", 1)[0] not in names:
            continue
        folder, own_spp = (work or WORK) / name.rsplit(".", 1)[0], clip.get("spp", spp)
        key, key_file = _key(clip, own_spp, shrink), folder / "key.json"
        if key_file.exists() and json.loads(key_file.read_text())["key"] != key:
            found = f"holds frames of another description of {name}"
            raise SystemExit(f"{folder} {found}: move or remove it, then run again")
        write_json(key_file, {"key": key, "spp": own_spp, "shrink": shrink})
        drive, fps, world, section = Drive(clip), clip["fps"], None, None
        total = min(frame_count(clip), frames or 10**9)
        for i in range(0, total, every):
            picture, about = folder / f"{i:06d}.png", folder / f"{i:06d}.json"
            if picture.exists() and about.exists():
                continue
            started, cpu, t = time.time(), time.process_time(), i / fps
            if world is None or section != i // (fps * clip["section_s"]):  # detailed trees only near this section
                section, world = i // (fps * clip["section_s"]), None
                gc.collect()  # the last section's meshes, before the next ones are made
                t0 = section * clip["section_s"]
                world = World(clip, s_from=drive.pose(t0).s_m, s_to=drive.pose(t0 + clip["section_s"]).s_m, moving=True)
            frame, truth = shoot(
                world,
                drive.pose(t),
                time_s=t,
                mounting=drive.mounted(t),
                spp=own_spp,
                seed=i,
                shrink=shrink,
                raw_file=f"{name}:{i:06d}",
                tags=_tags(clip, drive.pose(t).s_m),
                max_depth=clip.get("max_depth", 4),
                end=(drive.pose(t + EXPOSURE_S), drive.mounted(t + EXPOSURE_S)),
            )
            truth["time_s"] = round(t, 4)
            write_bytes(about, json.dumps(truth).encode())
            write_bytes(picture, cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes())
            took = f"{time.process_time() - cpu:.1f} CPU s, {time.time() - started:.1f} s"
            print(f"{name} frame {i + 1} of {total}: {took}", flush=True)


def _key(clip, spp, shrink):
    """Tells whether frames come from this description; its length changes no frame."""
    about = {k: v for k, v in clip.items() if k != "seconds"}
    return scene_key("clip", LOOK, about, true_lens().to_dict(), spp, shrink)


def _tags(clip, s):
    """The clip's tags and those of the stretches [from, to, tag] the car is in or looks into (40 m ahead)."""
    return clip["tags"] + [tag for start, end, tag in clip.get("stretches", []) if start - 40 < s < end]


def encode_clips(names=()):
    """H.264 (yuv420p, fast start) and truth.json from the frames that are there, as far as they go without a gap."""
    truth_path = FOLDER / "truth.json"
    for name, clip in describe().items():
        folder = WORK / name.rsplit(".", 1)[0]
        n = 0
        while (folder / f"{n:06d}.png").exists() and (folder / f"{n:06d}.json").exists() and n < frame_count(clip):
            n += 1
        if n == 0 or (names and name.rsplit(".", 1)[0] not in names):
            continue
        key = scene_key(json.loads((folder / "key.json").read_text()), n, CRF)
        if is_current(f"test_videos/{name}", key, FOLDER / name):
            continue
        FOLDER.mkdir(parents=True, exist_ok=True)
        part = FOLDER / f"{name}.part.mp4"
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-framerate", str(clip["fps"]),
                   "-i", str(folder / "%06d.png"), "-frames:v", str(n), "-c:v", "libx264", "-preset", "slow",
                   "-crf", str(CRF), "-pix_fmt", "yuv420p", "-threads", "2", "-movflags", "+faststart", str(part)]
        subprocess.run(command, check=True)
        part.replace(FOLDER / name)
        truth = json.loads(truth_path.read_text()) if truth_path.exists() else {"format": "lanelib-truth/1"}
        truth["camera"] = true_lens().to_dict()
        kept = [f for f in truth.get("frames", []) if not f["raw_file"].startswith(f"{name}:")]
        own = [json.loads((folder / f"{i:06d}.json").read_text()) for i in range(n)]
        truth["frames"] = sorted(kept + own, key=lambda f: f["raw_file"])
        write_bytes(truth_path, _compact(truth).encode())
        remember(f"test_videos/{name}", key)
        print(f"{name}: {n} of {frame_count(clip)} frames, {(FOLDER / name).stat().st_size / 1e6:.1f} MB", flush=True)


def _compact(truth):
    """One frame a line."""
    head = json.dumps({k: v for k, v in truth.items() if k != "frames"})[:-1]
    frames = ",\n".join(json.dumps(f, separators=(",", ":")) for f in truth["frames"])
    return f'{head}, "frames": [\n{frames}\n]}}\n'
