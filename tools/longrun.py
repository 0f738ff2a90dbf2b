"""A clip of hours through `lanelib video`: does memory stay, does every frame arrive, once, in order, at its time?

The clip is a synthetic drive of 256 frames, repeated without encoding it again. Its frames carry their number as a row
of black and white blocks, stand at uneven times as those of a phone do, and every loop has a second without any road,
so that the lane is lost and searched again. `python tools/reliability.py --long` runs two hours of it; `--fps` makes it
shorter where 180,000 frames take too long.
"""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import clips  # noqa: E402
import numpy as np  # noqa: E402
import psutil  # noqa: E402

from lanelib import road  # noqa: E402
from lanelib.birdseye import BirdsEye  # noqa: E402
from lanelib.camera import Camera  # noqa: E402
from lanelib.ffmpeg import ffmpeg_exe, file_url, packet_times  # noqa: E402
from lanelib.rig import Rig  # noqa: E402
from lanelib.simulator import Scene, render_road  # noqa: E402

SIZE_WH, BITS = (320, 180), 8
LOOP = 2**BITS  # frames
DARK = range(230, LOOP)  # without a road
BLOCKS_XYWH = (160, 4, 160, 20)  # where the number stands: in the sky, beside the panel that lanelib draws
SAMPLE_S = 1.0
ROLES = ("Python", "decoder", "encoder")
CAMERA = Camera(np.array(Scene().camera_matrix), np.array(Scene().distortion), Scene().size_wh).scaled(SIZE_WH)
RIG = Rig(CAMERA, BirdsEye.from_mounting(CAMERA, height_m=1.22, pitch_deg=1.4), "long")


@dataclass
class LongRun:
    """What went in, what came out, and the memory of every process on the way (time in s, MB in order of ROLES)."""

    frames: int
    fps: float
    took_s: float = 0.0
    code: int | None = None
    said: str = ""
    rows: int = 0
    measured: int = 0
    in_order: int = 0
    written: int = 0
    worst_time_ms: float = float("nan")
    misplaced: int = 0
    sound_off_s: float = float("nan")
    memory: list[tuple[float, list[float]]] = field(default_factory=list)

    @property
    def film_s(self) -> float:
        """How long the clip is."""
        return self.frames / self.fps

    def peak(self) -> float:
        """MB of all processes together."""
        return max((sum(mb) for _, mb in self.memory), default=0.0)

    def level(self, share: float) -> list[float]:
        """The median memory in MB of each process around this share of the run (a twentieth of it)."""
        until = self.memory[-1][0]
        near = [mb for t, mb in self.memory if abs(t / until - share) <= 0.025] or [self.memory[-1][1]]
        return np.median(near, axis=0).tolist()

    def faults(self) -> list[str]:
        """What is wrong, a line each; empty when all is well."""
        checks = {
            f"exit code {self.code}, said {self.said[-200:]!r}": self.code == 0 and not self.said,
            f"{self.rows} rows of {self.frames} frames": self.rows == self.frames,
            f"{self.in_order} rows in order": self.in_order == self.frames,
            f"{self.written} of {self.frames} frames written": self.written == self.frames,
            f"{self.misplaced} frames of the result are not the frame of the source": self.misplaced == 0,
            f"times off by up to {self.worst_time_ms:.3f} ms": self.worst_time_ms < 0.1,
            f"sound off by {self.sound_off_s:.3f} s": abs(self.sound_off_s) < 0.1,
        }
        return [text for text, good in checks.items() if not good]

    def markdown(self, command: str) -> str:
        """The section of the report."""
        shares = (0.05, 0.25, 0.5, 0.75, 0.95)
        rows = [(f"{100 * s:.0f} %", *(f"{mb:.1f}" for mb in (*self.level(s), sum(self.level(s))))) for s in shares]
        early, late = self.level(shares[0]), self.level(shares[-1])
        hours = 0.9 * self.film_s / 3600
        grew = ", ".join(f"{name} {(b - a) / hours:+.1f}" for name, a, b in zip(ROLES, early, late, strict=True))
        return "\n".join([
            "## A long clip", "",
            f"Written by `{command}`: a synthetic drive of {LOOP} frames at uneven times, looped, with a sound track; "
            "`lanelib video` decodes it, finds and draws the lane, encodes it and writes a row a frame.", "",
            f"- {self.film_s / 3600:.2g} hours of film, {self.frames:,} frames of {SIZE_WH[0]}x{SIZE_WH[1]} at "
            f"{self.fps:g} a second, took {self.took_s / 60:.0f} minutes of wall time on a busy machine",
            f"- {self.in_order:,} rows in order, {self.measured:,} of them with a measured lane (in a tenth of the "
            f"frames there is no road); {self.written:,} frames written",
            f"- frames of the result that are not the source's frame of that place (each carries its number): "
            f"{self.misplaced}; largest difference of a frame's time: {self.worst_time_ms:.3f} ms; the sound's "
            f"length differs by {self.sound_off_s:.3f} s",
            f"- peak memory of all processes together {self.peak():.0f} MB; from early to late it grew, in MB per hour "
            f"of film: {grew} (ffmpeg keeps an index of the packets it has written)", "",
            "| after | " + " | ".join(f"{name}, MB" for name in ROLES) + " | together, MB |",
            "|---|" + "---:|" * (len(ROLES) + 1),
            *("| " + " | ".join(row) + " |" for row in rows), "",
            "Faults: " + ("; ".join(self.faults()) or "none") + ".", ""])


def drive() -> Iterator[np.ndarray]:
    """The frames of one loop (180, 320, 3) BGR: in a gentle bend the car weaves, twice a dash's period every 32 frames.

    32 pictures are enough, because only the number changes from one round to the next.
    """
    x, y, width, height = BLOCKS_XYWH
    way, matrix = road.Road([0, 1000], [1 / 600, 1 / 600]), CAMERA.camera_matrix.tolist()
    poses = [road.CarPose(s_m=2 * 14.63 * i / 32, d_m=0.4 * np.sin(2 * np.pi * i / 32)) for i in range(32)]
    rounds = [render_road(Scene(road=way, pose=pose, size_wh=SIZE_WH, camera_matrix=matrix))[0] for pose in poses]
    for i in range(LOOP):
        frame = rounds[i % 32].copy() if i not in DARK else np.full_like(rounds[0], 12)
        for bit in range(BITS):
            frame[y : y + height, x + bit * width // BITS : x + (bit + 1) * width // BITS] = 235 if i >> bit & 1 else 16
        yield frame


def make_clip(place: Path, hours: float, fps: int) -> tuple[Path, int]:
    """The looped clip with sound, and how many frames it has; each is up to 10 ms late."""
    loops = max(1, round(hours * 3600 * fps / LOOP))
    raw = b"".join(np.ascontiguousarray(frame).tobytes() for frame in drive())
    clips.ffmpeg("-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{SIZE_WH[0]}x{SIZE_WH[1]}", "-r", fps, "-i", "pipe:0",
                 "-vf", f"settb=1/1000,setpts=N*{1000 // fps}+mod(N*7\\,11)", "-fps_mode", "passthrough",
                 "-enc_time_base", "1/1000", "-c:v", "libx264", "-preset", "veryfast", "-crf", 18, "-pix_fmt",
                 "yuv420p", "-video_track_timescale", 90000, place / "loop.mp4", data=raw)
    film_s = loops * LOOP / fps
    subprocess.run([ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-y", "-stream_loop", str(loops - 1),
                    "-i", file_url(place / "loop.mp4"), "-f", "lavfi", "-t", f"{film_s:.3f}", "-i",
                    "sine=frequency=330:sample_rate=8000", "-map", "0:v", "-map", "1:a", "-c:v", "copy", "-c:a", "aac",
                    "-b:a", "16k", file_url(place / "hours.mp4")],
                   check=True, stdin=subprocess.DEVNULL)
    return place / "hours.mp4", loops * LOOP


def memory_of(process: psutil.Process) -> list[float]:
    """Resident MB of Python, of the decoding and of the encoding ffmpeg."""
    mb = [process.memory_info().rss / 1e6, 0.0, 0.0]
    for child in process.children(recursive=True):
        with contextlib.suppress(psutil.Error):
            line, rss = child.cmdline(), child.memory_info().rss / 1e6
            mb[1 if "pipe:1" in line else 2] += rss
    return mb


def read_numbers(video: Path) -> np.ndarray:
    """The number that every frame of the video carries (N,)."""
    x, y, width, height = BLOCKS_XYWH
    done = subprocess.run([ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-nostdin", "-threads", "1", "-i",
                           file_url(video), "-map", "0:v:0", "-vf", f"crop={width}:{height}:{x}:{y},"
                           f"scale={BITS}:1:flags=area,format=gray", "-fps_mode", "passthrough", "-f", "rawvideo",
                           "pipe:1"], check=True, stdout=subprocess.PIPE)
    bits = np.frombuffer(done.stdout, np.uint8).reshape(-1, BITS) > 127
    return bits @ (1 << np.arange(BITS))


def sound_s(video: Path) -> float:
    """How long the sound track is, from its packets."""
    done = subprocess.run([ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-nostdin", "-i", file_url(video),
                           "-map", "0:a:0", "-c", "copy", "-f", "framecrc", "pipe:1"],
                          check=True, capture_output=True, text=True)
    base = next(line for line in done.stdout.splitlines() if line.startswith("#tb 0: ")).split()[2]
    last = done.stdout.splitlines()[-1].split(",")
    tick_s = int(base.split("/")[0]) / int(base.split("/")[1])
    return (int(last[2]) + int(last[3])) * tick_s


def long_run(start, place: Path, hours: float, *, fps: int = 25) -> LongRun:
    """Make the clip in `place`, run it, compare. `start(*arguments, cwd=…)` starts the command line as a process."""
    source, frames = make_clip(place, hours, fps)
    RIG.save(place / "long_rig.json")
    run, out, rows = LongRun(frames, fps), place / "out.mp4", place / "out.jsonl"
    watch(run, start("video", source.name, "--rig", "long_rig.json", "-o", out.name, "--json", rows.name, "--quiet",
                     cwd=place))
    if rows.exists():
        count_rows(run, rows, source)
    if out.exists():
        compare(run, source, out)
    return run


def watch(run: LongRun, process: subprocess.Popen) -> None:
    """Wait for the command's end; note its memory on the way, how long it took, and what it said."""
    begin, watched = time.monotonic(), psutil.Process(process.pid)
    while process.poll() is None:
        with contextlib.suppress(psutil.Error):
            run.memory.append((time.monotonic() - begin, memory_of(watched)))
        time.sleep(SAMPLE_S)
    run.took_s = time.monotonic() - begin
    run.said, run.code = process.communicate()[1], process.returncode
    # Two processes work beside Python in the middle; while the file is opened and finished there are fewer.
    run.memory = [m for m in run.memory if all(m[1])] or run.memory


def count_rows(run: LongRun, rows: Path, source: Path) -> None:
    """How many rows there are, are where they belong, and have a measured lane."""
    with open(rows, encoding="utf-8") as lines:
        for i, line in enumerate(lines):
            row = json.loads(line)
            run.rows += 1
            run.in_order += row["raw_file"] == f"{source.name}:{i:06d}"
            run.measured += row["status"] == "measured"


def compare(run: LongRun, source: Path, out: Path) -> None:
    """Whether every frame of the source is in the result, in its place and at its time, and all of the sound."""
    was, is_ = packet_times(source), packet_times(out)
    run.written = len(is_)
    off = [abs((b - is_[0]) - (a - was[0])) for a, b in zip(was, is_, strict=False)]
    run.worst_time_ms = 1e3 * max(off, default=float("nan"))
    wanted, numbers = np.arange(run.frames) % LOOP, read_numbers(out)
    both = min(len(numbers), run.frames)
    run.misplaced = int(np.count_nonzero(numbers[:both] != wanted[:both])) + abs(len(numbers) - run.frames)
    run.sound_off_s = sound_s(out) - sound_s(source)
