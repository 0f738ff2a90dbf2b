"""SIGINT, SIGTERM and SIGKILL at random moments of the commands that work for a while; what they leave behind.

Promised: nothing under its final name is half-written, no process stays, Ctrl-C is answered in one line with exit code
130 and SIGTERM with 143. After SIGKILL nobody can tidy up, so unfinished files (hidden, `.part`) may stay; the next run
of the same command takes them away, except the `.part` of a download, which it goes on with.
"""

import contextlib
import hashlib
import http.server
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import chessboards  # noqa: E402
import cv2  # noqa: E402
import psutil  # noqa: E402
from test_cli import make_rig  # noqa: E402

from lanelib.errors import LanelibError  # noqa: E402
from lanelib.ffmpeg import packet_times  # noqa: E402
from lanelib.pictures import read_image  # noqa: E402
from lanelib.road import CarPose  # noqa: E402
from lanelib.simulator import Scene, render_road  # noqa: E402
from lanelib.video import VideoWriter  # noqa: E402

COMMANDS = {
    "video": "video road.mp4 --rig rig.json -o out.mp4 --json out.jsonl --quiet",
    "image": "image {pictures} --rig rig.json -o shots --stages --json shots.jsonl --quiet",
    "calibrate": "calibrate boards -o camera.json",
    "course": "course --sets mine --quiet",
    "fetch": "fetch udacity",
}
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
FETCHED = {f"test_images/udacity/{i}.bin": bytes([i]) * 150_000 for i in range(5)}
# What `lanelib` does, with SIGINT as in a terminal (in the background it would be ignored); says when it is there.
PROGRAM = """
import signal, sys, os
signal.signal(signal.SIGINT, signal.default_int_handler)
import lanelib.__main__ as program
if len(sys.argv) > 1 and sys.argv[1] == "fetch":  # another list of files, and no search in a package index
    import json, pathlib
    from lanelib import fetch
    fetch.manifest = lambda name: json.loads(os.environ["TEST_MANIFEST"])
    fetch._default_root = lambda: pathlib.Path("fetched")
    fetch.PackageIndex.bring = lambda self, wanted, root, say: ()
    fetch._path_in_repository = lambda path: path
from lanelib import cli
was, told = cli._on_signal, []
def on_signal(number, handler):  # what main does first, and last
    old = was(number, handler)
    if number == signal.SIGTERM:
        os.write(1, b"main has ended" if told else b".")
        told.append(number)
    return old
cli._on_signal = on_signal
sys.exit(program.main())
"""


@dataclass
class Found:
    """How often a command was interrupted, and what was wrong afterwards."""

    injected: int = 0
    wrong: list[str] = field(default_factory=list)
    parts: int = 0


class SlowServer(http.server.ThreadingHTTPServer):
    """Serves FETCHED in pieces, so that a download lasts about a second and can be resumed."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), _SlowAnswer)
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def __exit__(self, *_):
        self.shutdown()
        self.server_close()

    def handle_error(self, request, client_address):
        pass


class _SlowAnswer(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        data = FETCHED[self.path.lstrip("/")]
        start = int((self.headers.get("Range") or "bytes=0-").removeprefix("bytes=").rstrip("-"))
        if start >= len(data):
            return self.send_error(416)
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(data) - start))
        self.end_headers()
        for at in range(start, len(data), 50_000):
            self.wfile.write(data[at : at + 50_000])
            time.sleep(0.05)

    def log_message(self, *_):
        pass


def prepare(place: Path) -> None:
    """What the commands work on, in the folder `place`."""
    rig = make_rig("mine")
    for folder in ("boards", "tmp", "data/camera_cal/mine", "data/test_images/mine", "data/test_videos/mine",
                   "data/rigs"):
        (place / folder).mkdir(parents=True)
    rig.save(place / "rig.json")
    rig.save(place / "data/rigs/mine.json")
    frames = [render_road(Scene(pose=CarPose(3.0 * i, 0.1 * i), seed=i))[0] for i in range(6)]
    for path, n in ((place / "road.mp4", 40), (place / "data/test_videos/mine/road.mp4", 8)):
        with VideoWriter(path, fps=20, preset="ultrafast") as writer:
            for _ in range(n):
                for frame in frames:
                    writer.write(frame)
    for i, frame in enumerate(frames):
        cv2.imwrite(str(place / f"road{i}.png"), frame)
        if i < 2:
            cv2.imwrite(str(place / f"data/test_images/mine/road{i}.png"), frame)
    for i in range(6):
        board = chessboards.render((0.3 - 0.12 * i, 0.35 - 0.15 * i, 0.1 * i), (0.2 * i - 0.3, 0.1, 14.0),
                                   board_wh=(9, 6), seed=i)
        cv2.imwrite(str(place / f"boards/b{i}.png"), board)
        if i < 4:
            cv2.imwrite(str(place / f"data/camera_cal/mine/b{i}.png"), board)


def start(name: str, place: Path, server: SlowServer) -> subprocess.Popen:
    """The command as a process which has just come to its own first line."""
    sums = {path: hashlib.sha256(data).hexdigest() for path, data in FETCHED.items()}
    env = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(place / "tmp"), "LANELIB_DATA": str(place / "data"),
           "LANELIB_UDACITY_URL": f"http://127.0.0.1:{server.server_port}", "NO_PROXY": "127.0.0.1",
           "TEST_MANIFEST": json.dumps(sums)}
    line = COMMANDS[name].format(pictures=" ".join(sorted(p.name for p in place.glob("road*.png"))))
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, *line.split()], cwd=place, env=env,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.read(1)
    return process


def interrupt(name: str, number: signal.Signals, after_s: float, place: Path, server: SlowServer, found: Found) -> None:
    """Start, wait, send the signal; note what is wrong afterwards. A command that was ready sooner does not count."""
    before = unfinished(place)
    process = start(name, place, server)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(after_s)
    late = process.poll() is not None
    if not late:
        process.send_signal(number)
    try:
        out, err = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        err = f"did not end within 60 s; {err}"
    # main() had ended well, and the signal hit Python's own last breath
    late = late or process.returncode == 0 or (process.returncode == -number and "main has ended" in out)
    found.injected += not late
    lines = err.splitlines()
    good = all(line.startswith("lanelib: ") for line in lines)
    if not late:
        how = {signal.SIGINT: "interrupted", signal.SIGTERM: "ended by a signal"}.get(number)
        said = [line for line in lines if how and line.startswith(f"lanelib: {how}; ")]
        good &= process.returncode == CODES[number] and len(said) == (how is not None)
    where = f"{name}, {number.name} after {after_s:.2f} s"
    if not good:
        found.wrong.append(f"{where}: exit code {process.returncode}, said {' / '.join(err.split())[-300:]!r}")
    if number == signal.SIGKILL:
        alone_in(place)  # an ffmpeg that had just been started begins its file only now
    may_stay = unfinished(place) if number == signal.SIGKILL else before
    found.wrong += [f"{where}: {fault}" for fault in left_behind(place, may_stay)]


def alone_in(place: Path) -> list[str]:
    """The processes that are still at work in this place after some seconds; none, as a rule."""
    deadline = time.monotonic() + 5
    while (stay := naming(str(place))) and time.monotonic() < deadline:
        time.sleep(0.05)
    return stay


def left_behind(place: Path, may_stay: Sequence[Path] = ()) -> list[str]:
    """Processes, temporary files that may not stay, and files under a final name that are not whole."""
    faults = [f"a process stayed: {line[:120]}" for line in alone_in(place)]
    faults += [f"a temporary file stayed: {path.name}" for path in unfinished(place) if path not in may_stay]
    return faults + [f"{path.relative_to(place)} is not whole" for path in place.rglob("*") if not whole(path, place)]


def unfinished(place: Path) -> list[Path]:
    """Hidden files, and those of Python's in the temporary folder, of runs that did not come to their end."""
    return [path for path in place.rglob(".*") if ".part" in path.name] + list((place / "tmp").iterdir())


def whole(path: Path, place: Path) -> bool:
    """Whether a file that has its final name can be used to its end; others count as whole."""
    name = str(path.relative_to(place))
    if not path.is_file() or path.name.startswith(".") or name.startswith("tmp/") or path.suffix == ".part":
        return True
    if name.startswith("fetched/"):
        return path.read_bytes() == FETCHED[name.removeprefix("fetched/")]
    try:
        if path.suffix in (".png", ".jpg"):
            read_image(path)
        elif path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".jsonl":
            return path.read_text().endswith("\n") and all(json.loads(line) for line in path.read_text().splitlines())
        elif path.suffix == ".mp4":
            return len(packet_times(path)) == (48 if "data" in name else 240)
        return path.stat().st_size > 0
    except (LanelibError, ValueError):
        return False


def naming(text: str) -> list[str]:
    """Command lines of the other processes that have this in their arguments."""
    lines = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.pid != os.getpid() and text in (line := " ".join(process.cmdline())):
                lines.append(line)
    return lines


def campaign(place: Path, seconds: float, seed: int) -> Found:
    """Every command and signal in turn at random moments, for so long; in the end each runs through once more."""
    prepare(place)
    rng, found, lasts = random.Random(seed), Found(), {}
    with SlowServer() as server:
        for name in COMMANDS:
            lasts[name] = run_through(name, place, server, found)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for name in COMMANDS:
                for number in CODES:
                    if name == "fetch":
                        for path in (place / "fetched").rglob("*.bin"):
                            path.unlink()  # else there is nothing to do
                    interrupt(name, number, rng.uniform(0, lasts[name]), place, server, found)
        found.parts = len(unfinished(place))
        for name in COMMANDS:
            run_through(name, place, server, found)
    found.wrong += [f"a run after all did not take away {path.name}" for path in unfinished(place)]
    return found


def run_through(name: str, place: Path, server: SlowServer, found: Found) -> float:
    """Run a command to its end; how long it took from its own first line on."""
    process = start(name, place, server)
    begin = time.monotonic()
    err = process.communicate(timeout=600)[1]
    if process.returncode:
        found.wrong.append(f"{name}: exit code {process.returncode} undisturbed, said {err[-200:]!r}")
    return time.monotonic() - begin
