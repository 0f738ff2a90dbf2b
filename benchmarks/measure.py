"""How things are measured here: processor time, one thread, everything that is compared in one interleaved loop.

Wall time on a shared machine says more about its other users. Processor time still drifts (clock rate, caches), so
two figures are only compared when they were taken turn by turn: their ratio then holds to a few per cent.
"""

import os
import platform
import resource
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import psutil

from lanelib.rig import Rig
from lanelib.road import CarPose, Mounting, Road
from lanelib.simulator import Scene, render_road

ROOT = Path(__file__).resolve().parents[1]
RIG_FILE = ROOT / "rigs" / "rendered.json"


def interleaved(cases: dict[str, Callable], inputs: list, *, rounds: int) -> dict[str, float]:
    """Milliseconds of processor time of each case per input: in each round every input goes to every case, the order
    turning by one each time; of the rounds the median, over the inputs the mean."""
    names, taken = list(cases), {name: [[] for _ in inputs] for name in cases}
    for turn in range(rounds + 1):
        for i, value in enumerate(inputs):
            shift = (turn + i) % len(names)
            for name in names[shift:] + names[:shift]:
                begin = time.process_time_ns()
                cases[name](value)
                if turn:  # the first round fills tables and caches
                    taken[name][i].append(time.process_time_ns() - begin)
    return {name: statistics.mean(statistics.median(t) for t in times) / 1e6 for name, times in taken.items()}


def in_streams(cases: dict[str, Callable], inputs: list, *, rounds: int) -> dict[str, float]:
    """Milliseconds of processor time per input when each case has the processor to itself: it goes over all inputs in
    a loop of its own, the cases in turn; the median of the rounds."""
    taken: dict[str, list[float]] = {name: [] for name in cases}
    for turn in range(rounds + 1):
        for name, case in cases.items():
            begin = time.process_time_ns()
            for value in inputs:
                case(value)
            if turn:
                taken[name].append((time.process_time_ns() - begin) / len(inputs))
    return {name: statistics.median(times) / 1e6 for name, times in taken.items()}


def cpu_seconds(function: Callable[[], object]) -> float:
    """Processor time of this process and of the children that ended meanwhile (ffmpeg)."""

    def spent() -> float:
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time() + children.ru_utime + children.ru_stime

    begin = spent()
    function()
    return spent() - begin


def in_turn(jobs: dict[str, Callable[[], object]], *, rounds: int) -> dict[str, list[float]]:
    """Seconds of processor time of whole jobs, one after the other in turn, round by round."""
    taken: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            taken[name].append(cpu_seconds(job))
    return taken


def times_as_much(one: list[float], other: list[float]) -> float:
    """How many times as much processor time one job took as another of ``in_turn``: the median of the rounds, because
    a shared machine is faster in one minute and slower in the next."""
    return statistics.median(a / b for a, b in zip(one, other, strict=True))


def peak_megabytes(command: list[str]) -> tuple[float, float]:
    """Peak memory (resident, MB) of a command alone, and of it and all its children together, sampled every 20 ms."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT)
    alone = together = 0
    watched = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            own = watched.memory_info().rss
            alone = max(alone, own)
            total = own
            for child in watched.children(recursive=True):
                total += child.memory_info().rss
            together = max(together, total)
        except psutil.Error:
            pass  # it ended while we looked
        time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"bench: this failed: {' '.join(command)}")
    return alone / 1e6, together / 1e6


def ffmpeg(*arguments: object) -> None:
    """Run ffmpeg to the end."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-nostdin", "-loglevel", "error", "-y"]
    subprocess.run([*command, *map(str, arguments)], check=True)


def simulated_frames(count: int) -> list[np.ndarray]:
    """1280x720 frames of a drive through a bend, as the camera of the rendered rig sees it."""
    rig = Rig.load(RIG_FILE)
    mounting = {name: float(value) for name, value in rig.mounting.items()}
    road = Road([0, 40, 120], [0, 1 / 700, 1 / 500])
    frames = []
    for i in range(count):
        scene = Scene(
            road=road, pose=CarPose(5 + 1.1 * i, 0.2), mounting=Mounting(**mounting), size_wh=rig.size_wh,
            camera_matrix=tuple(map(tuple, rig.camera.camera_matrix)), distortion=tuple(rig.camera.distortion),
            noise=1.5, seed=i)
        frames.append(render_road(scene)[0])
    return frames


def write_clip(frames: Iterable[np.ndarray], path: Path, *, size_wh: tuple[int, int], fps: int = 25) -> None:
    """An H.264 clip as a camera would write it (constant quality, a key frame every two seconds)."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo",
               "-pix_fmt", "bgr24", "-s", f"{size_wh[0]}x{size_wh[1]}", "-r", str(fps), "-i", "pipe:0", "-c:v",
               "libx264", "-preset", "fast", "-crf", "20", "-g", str(2 * fps), "-pix_fmt", "yuv420p", str(path)]
    subprocess.run(command, input=b"".join(f.tobytes() for f in frames), check=True)


def machine() -> list[str]:
    """What this was measured on, without names of hosts or paths."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    version = subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-version"], capture_output=True, text=True, check=True)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return [
        f"{model}, {os.cpu_count()} cores, {psutil.virtual_memory().total / 2**30:.0f} GB, {platform.system()}",
        f"Python {platform.python_version()}, numpy {np.__version__}, OpenCV {cv2.__version__}, "
        f"ffmpeg {version.stdout.split()[2]}",
        f"one thread; processor time, not wall time; load of the machine {load:.1f}",
    ]
