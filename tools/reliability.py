"""The long campaign behind docs/RELIABILITY.md: thousands of bad inputs, faults in the middle of work, a long run.

    python tools/reliability.py                 about 40 minutes
    python tools/reliability.py --minutes 5     reduced

Not part of `make test`; the same promises in small are in tests/test_fuzz.py, whose functions, files and commands are
used here. Inputs are tried in processes of their own, so that even an end by a signal inside a library is counted.
"""

import argparse
import contextlib
import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import clips  # noqa: E402
import cv2  # noqa: E402
import numpy as np  # noqa: E402
import psutil  # noqa: E402
import test_fuzz as fuzz  # noqa: E402

from lanelib import cli, datasets  # noqa: E402
from lanelib.birdseye import BirdsEye  # noqa: E402
from lanelib.camera import Camera  # noqa: E402
from lanelib.errors import LanelibError  # noqa: E402
from lanelib.finder import LaneFinder  # noqa: E402
from lanelib.pictures import write_bytes  # noqa: E402
from lanelib.rig import Rig  # noqa: E402

CAMPAIGNS = {
    "arrays of any shape into the image functions": "arrays",
    "arrays of any shape into the finder, all models": "finder",
    "random homographies, cameras and rigs": "numbers",
    "damaged JPEG, PNG, MP4, rig and camera files into the loaders": "loaders",
    "damaged files into the commands": "commands",
}
TOO_LONG_S = 30.0  # for one input; on an idle machine the slowest needs less than two


# ---------------------------------------------------------------------------------------------- inputs
def random_array(rng: np.random.Generator) -> np.ndarray:
    """uint8 of any shape, contents and layout in memory."""
    frames = [(90, 160, 3), (90, 160), (90, 160, 4), (135, 160), (180, 320, 3), (270, 320), (720, 1280, 3)]
    shape = tuple(rng.integers(0, 12, rng.integers(0, 5))) if rng.random() < 0.5 else frames[rng.integers(len(frames))]
    array = rng.integers(0, 256, shape, np.uint8)
    kind = rng.integers(6)
    if kind == 0:
        array[...] = rng.integers(0, 256)
    elif kind == 1 and array.ndim >= 2:
        array[:] = array[:1]  # upright stripes
    elif kind == 2 and shape == (90, 160, 3):
        array = fuzz.ROAD_BGR + array % np.uint8(rng.integers(1, 60))
    turn = rng.integers(4)
    if turn == 0 and array.ndim:
        array = array[::-1]
    elif turn == 1 and array.ndim >= 2:
        array = array.swapaxes(0, 1)
    return array


def random_number(rng: np.random.Generator) -> float:
    """Mostly tame, sometimes as wild as a float can be."""
    wild = [0.0, -0.0, float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, 1e-12]
    return float(rng.normal() * 10.0 ** rng.integers(-3, 5)) if rng.random() < 0.9 else wild[rng.integers(len(wild))]


def harmed(data: bytes, rng: np.random.Generator) -> bytes:
    """Good bytes with one to four pieces overwritten, left out, doubled or cut off, or a number of a text changed."""
    values = [b"0", b"-1", b"1e999", b"NaN", b"null", b"[]", b"1e-300", b"9" * 30, b'"x"', b"{}", b"true"]
    for _ in range(rng.integers(1, 5) if rng.random() < 0.2 else 1):
        if not data:
            break
        at, n = int(rng.integers(len(data))), int(rng.integers(1, 64))
        kind = rng.integers(6)
        if kind == 0:
            data = data[:at] + rng.bytes(n) + data[at + n :]
        elif kind == 1:
            data = data[:at] + data[at + n :]
        elif kind == 2:
            data = data[: at + n] + data[at:]
        elif kind == 3 and rng.random() < 0.3:
            data = data[:at]
        elif kind == 4:
            data = data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]
        else:
            end = at
            while end < len(data) and data[end : end + 1] in b"0123456789.e-+":
                end += 1
            data = data[:at] + values[rng.integers(len(values))] + data[max(end, at + 1) :]
    return data


# ---------------------------------------------------------------------------------------------- one worker
class Tried:
    """What a worker tried and what came of it."""

    def __init__(self):
        self.inputs = self.results = self.refused = 0
        self.faults: list[str] = []
        self.slowest_s = 0.0

    def call(self, what: str, function, *arguments) -> None:
        """One input: a result, or one LanelibError of one line; anything else is a fault."""
        begin = time.monotonic()
        self.inputs += 1
        try:
            function(*arguments)
            self.results += 1
        except LanelibError as error:
            self.refused += 1
            if len(str(error).splitlines()) != 1:
                self.faults.append(f"{what}: an error of several lines")
        except Exception as error:
            self.faults.append(f"{what}: {type(error).__name__}: {' '.join(str(error).split())[:160]}")
        self.slowest_s = max(self.slowest_s, time.monotonic() - begin)
        if time.monotonic() - begin > TOO_LONG_S:
            self.faults.append(f"{what}: took {time.monotonic() - begin:.0f} s")


def worker(name: str, seconds: float, seed: int) -> None:
    """Try inputs of one campaign for so long; prints what came of it as JSON."""
    cv2.setNumThreads(1)
    np.seterr(all="ignore")
    rng, tried = np.random.default_rng(seed), Tried()
    me = psutil.Process()
    until = time.monotonic() + seconds
    with tempfile.TemporaryDirectory(prefix="reliability") as folder:
        os.chdir(folder)
        step = {"arrays": arrays, "finder": finders, "numbers": numbers, "loaders": loaders, "commands": commands}[name]
        one = step(rng, tried, Path(folder))
        one()
        before = me.num_fds(), me.num_threads()
        while time.monotonic() < until:
            one()
        left = {"handles": max(0, me.num_fds() - before[0]), "processes": len(me.children(recursive=True)),
                "threads": max(0, me.num_threads() - before[1]),
                "files": sum(1 for p in Path(folder).iterdir() if ".part" in p.name)}  # fmt: skip
        os.chdir(ROOT)
    said = {key: getattr(tried, key) for key in ("inputs", "results", "refused", "faults", "slowest_s")}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    sys.__stdout__.write(json.dumps({**said, "left": left, "peak_mb": peak}) + "\n")


def arrays(rng, tried, place):
    """Every image function with one array."""

    def one():
        array = random_array(rng)
        for name, function in fuzz.IMAGE_FUNCTIONS.items():
            if name not in fuzz.SLOW or rng.random() < 0.1:
                tried.call(f"{name} of {array.shape}", function, array.copy() if "_" in name else array)

    return one


def finders(rng, tried, place):
    """Several finders that keep their trackers throughout: nothing, noise, roads, other sizes, one after the other."""
    options = [{}, {"order": "textbook"}, {"recipe": "clahe-colour-sobel"}, {"recipe": "sobel-or-colour"},
               {"smoothing": "average"}, {"smoothing": "exponential"}, {"track": False}]  # fmt: skip
    all_ = [LaneFinder(fuzz.RIG, **o) for o in options]

    def look(finder, array, planes):
        result = (finder.process_yuv420 if planes else finder.process)(array)
        json.dumps(result.to_row("x"), allow_nan=False)
        if not (np.isfinite(result.left_px).all() and np.isfinite(result.right_px).all()):
            raise ArithmeticError("not a number in a line")

    def one():
        array = random_array(rng)
        for finder in all_:
            tried.call(f"finder of {array.shape}", look, finder, array, rng.random() < 0.3)

    return one


def numbers(rng, tried, place):
    """A homography, a camera and a rig of random numbers, used on a road."""

    def use(rig):
        json.dumps(LaneFinder(rig).process(fuzz.ROAD_BGR).to_row("x"), allow_nan=False)

    def one():
        values = [random_number(rng) for _ in range(18)]
        matrix = np.array(values[:9]).reshape(3, 3)
        if rng.random() < 0.5:  # near the good one
            matrix = fuzz.RIG.birdseye.road_from_image * (1 + rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-4, 0))
        tried.call("homography", lambda: use(Rig(fuzz.CAMERA, BirdsEye(matrix, fuzz.SIZE_WH))))
        f = abs(values[9])
        tried.call("camera", lambda: Camera([[f, 0, values[10]], [0, f, values[11]], [0, 0, 1]], values[12:17],
                                            fuzz.SIZE_WH).undistort(fuzz.ROAD_BGR))  # fmt: skip
        lens = np.array(values[12:17]) / 1e3
        tried.call("lens", lambda: use(Rig(Camera(fuzz.CAMERA.camera_matrix, lens, fuzz.SIZE_WH), fuzz.RIG.birdseye)))
        tried.call("mounting", lambda: use(Rig(fuzz.CAMERA, BirdsEye.from_mounting(
            fuzz.CAMERA, height_m=values[0], pitch_deg=values[1], yaw_deg=values[2], roll_deg=values[3]))))  # fmt: skip

    return one


def originals(place: Path) -> dict[str, bytes]:
    """Good files of every kind in `place`."""
    fuzz.RIG.save(place / "rig.json")
    fuzz.CAMERA.save(place / "camera.json")
    cv2.imwrite(str(place / "road.jpg"), fuzz.ROAD_BGR)
    cv2.imwrite(str(place / "road.png"), fuzz.ROAD_BGR)
    clips.clip(place / "clip.mp4", n_frames=4, size_wh=fuzz.SIZE_WH)
    truth = {"raw_file": "road.png", "h_samples": [50, 60, 70], "lanes": [[60, 50, 40], [100, 110, 120]]}
    (place / "labels.json").write_text(json.dumps(truth) + "\n")
    return {path.name: path.read_bytes() for path in place.iterdir()}


def loaders(rng, tried, place):
    """A damaged file of each kind into its loader; videos, which need a process each, one time in ten."""
    good = originals(place)

    def one():
        for name, (load, _) in fuzz.LOADERS.items():
            if name != "clip.mp4" or rng.random() < 0.1:
                bad = place / f"bad_{name}"
                bad.write_bytes(harmed(good[name], rng))
                tried.call(f"damaged {name}", load, bad)

    return one


def commands(rng, tried, place):
    """A damaged file into a command in this process: exit code 0 or 2, each complaint one line."""
    good = originals(place)
    datasets.roots = lambda: ()
    lines = list(fuzz.COMMANDS.values())

    def run(line):
        said, out = io.StringIO(), io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            code = cli.main(line)
        err = said.getvalue()
        if code == 2:
            if not err or not all(e.startswith("lanelib: ") for e in err.splitlines()):
                raise RuntimeError(f"bad words: {err[:120]!r}")
            raise LanelibError("refused")
        if code:
            raise RuntimeError(f"exit code {code}: {err[:120]!r}")

    def one():
        target, line, _ = lines[rng.integers(len(lines))]
        bad = f"bad_{target}"
        (place / bad).write_bytes(harmed(good[target], rng))
        tried.call(line.replace("{}", bad), run, line.replace("{}", bad).split())

    return one


# ---------------------------------------------------------------------------------------------- faults in mid-work
def lanelib(*arguments: object, **options) -> subprocess.Popen:
    """The command line as a process."""
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import lanelib.__main__ as m"
    return subprocess.Popen([sys.executable, "-c", f"{program}; m.sys.exit(m.main())", *map(str, arguments)],
                            env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True, stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, **options)  # fmt: skip


def naming(text: str) -> int:
    """How many processes have this in their arguments."""
    n = 0
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            n += text in " ".join(process.cmdline())
    return n


def signals(place: Path, seconds: float, rng: random.Random) -> dict:
    """SIGINT, SIGTERM, SIGKILL at any moment of a video command; what it leaves."""
    clips.ffmpeg("-stream_loop", 99, "-i", place / "road.mp4", "-c", "copy", place / "long.mp4")
    found = {"faults injected": 0, "crashes": [], "processes": 0, "files": 0, "hidden parts after SIGKILL": 0}
    until = time.monotonic() + seconds
    expected = {signal.SIGINT: (130,), signal.SIGTERM: (143,), signal.SIGKILL: (-9,)}
    while time.monotonic() < until:
        for number, codes in expected.items():
            out = place / "out.mp4"
            out.write_text("from before")
            process = lanelib("video", "long.mp4", "--rig", "rig.json", "-o", "out.mp4", "--json", "out.jsonl",
                              cwd=place)  # fmt: skip
            deadline = time.monotonic() + 60
            while process.poll() is None and not list(place.glob(".out*.part*")) and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(rng.uniform(0, 0.8))
            process.send_signal(number)
            try:
                err = process.communicate(timeout=60)[1]
            except subprocess.TimeoutExpired:
                process.kill()
                err = process.communicate()[1]
                found["crashes"].append(f"{signal.Signals(number).name}: did not end within 60 s")
            found["faults injected"] += 1
            if process.returncode not in codes or len(err.splitlines()) > 1:
                found["crashes"].append(f"{number.name}: exit code {process.returncode}, said {err[:120]!r}")
            if out.read_bytes()[:11] != b"from before" or (place / "out.jsonl").exists():
                found["files"] += 1
            deadline = time.monotonic() + 5
            while naming(str(place)) and time.monotonic() < deadline:
                time.sleep(0.05)
            found["processes"] += naming(str(place))
            parts = [p for p in place.iterdir() if ".part" in p.name]
            found["hidden parts after SIGKILL" if number == signal.SIGKILL else "files"] += len(parts)
            for path in parts:
                path.unlink()
    return found


def full_disk(place: Path) -> dict:
    """Every command that writes, onto a file system of some kilobytes (root only)."""
    found = {"faults injected": 0, "crashes": [], "files": 0}
    disk = place / "disk"
    disk.mkdir()
    for size in ("4k", "32k", "128k"):
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", disk], capture_output=True)
        if done.returncode:
            return found
        try:
            for line in ("image big.jpg --rig rig.json -o disk/out.png",
                         "image big.jpg --rig rig.json -o disk/out.png --stages --json disk/out.jsonl",
                         "video long.mp4 --rig rig.json -o disk/out.mp4",
                         "video long.mp4 --rig rig.json --no-video --json disk/out.jsonl",
                         "rig big.jpg --camera camera.json -o disk/out.json"):  # fmt: skip
                process = lanelib(*line.split(), cwd=place)
                try:
                    err = process.communicate(timeout=180)[1]
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.communicate()
                    err = "did not end within 180 s"
                found["faults injected"] += 1
                if process.returncode not in (0, 2) or not all(e.startswith("lanelib: ") for e in err.splitlines()):
                    found["crashes"].append(f"{size}: {line}: exit code {process.returncode}, said {err[-160:]!r}")
                found["files"] += sum(".part" in p.name for p in disk.iterdir())
                for path in disk.iterdir():
                    path.unlink()
        finally:
            subprocess.run(["umount", disk], check=False)
    return found


def long_run(place: Path, seconds: float) -> dict:
    """A looped clip, as long as the time allows (2 hours of film at most): frames in and out, memory on the way."""
    n = int(min(2 * 3600 * 25, max(2000, seconds * 130)))  # frames; about 130 a second on one busy core
    loops = -(-n // 20)
    clips.ffmpeg("-stream_loop", loops - 1, "-i", place / "road.mp4", "-c", "copy", place / "hours.mp4")
    begin, memory = time.monotonic(), []
    process = lanelib("video", "hours.mp4", "--rig", "rig.json", "--no-video", "--json", "hours.jsonl", "--quiet",
                      cwd=place)  # fmt: skip
    watched = psutil.Process(process.pid)
    while process.poll() is None:
        with contextlib.suppress(psutil.Error):
            own = watched.memory_info().rss
            memory.append((own, own + sum(c.memory_info().rss for c in watched.children(recursive=True))))
        time.sleep(0.1)
        if time.monotonic() - begin > 6 * seconds + 120:
            process.kill()
    err = process.communicate()[1]
    rows = 0
    if (place / "hours.jsonl").exists():
        with open(place / "hours.jsonl", encoding="utf-8") as file:
            rows = sum(json.loads(line)["raw_file"] == f"hours.mp4:{i:06d}" for i, line in enumerate(file))
    own = [m[0] / 1e6 for m in memory]
    early, late = own[len(own) // 4 :][:5], own[-max(len(own) // 10, 1) :]
    return {"frames": loops * 20, "rows in order": rows, "code": process.returncode, "err": err[-200:],
            "minutes of film": loops * 20 / 25 / 60, "took_s": time.monotonic() - begin, "peak": max(own, default=0),
            "peak with ffmpeg": max((m[1] / 1e6 for m in memory), default=0),
            "growth": max(late, default=0) - max(early, default=0)}  # fmt: skip


# ---------------------------------------------------------------------------------------------- the report
def campaign(minutes: float, seed: int) -> str:
    """Everything, as Markdown."""
    share = minutes * 60
    rows, faults = [], []
    for i, (title, name) in enumerate(CAMPAIGNS.items()):
        say(title)
        seconds = 0.11 * share
        command = [sys.executable, __file__, "--worker", name, "--seconds", str(seconds), "--seed", str(seed + i)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=3 * seconds + 120, cwd=ROOT)
            result = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None
            why = "" if result else f"exit code {done.returncode}: {done.stderr.splitlines()[-1:]}"
        except subprocess.TimeoutExpired:
            result, why = None, "did not end"
        if result is None:
            faults.append(f"{title}: {why}")
            rows.append([title, "-", "-", "-", "1", "-", "-", "-"])
            continue
        unlike = sorted(set(result["faults"]))
        faults += [f"{title}: {fault}" for fault in unlike[:10]]
        rows.append([title, *(f"{result[k]:,}" for k in ("inputs", "results", "refused")), str(len(result["faults"])),
                     str(sum(result["left"].values())), f"{result['slowest_s']:.1f}", f"{result['peak_mb']:.0f}"])
        if any(result["left"].values()):
            faults.append(f"{title}: left behind {result['left']}")
    with tempfile.TemporaryDirectory(prefix="reliability") as folder:
        place = Path(folder)
        originals(place)
        frame = cv2.resize(fuzz.ROAD_BGR, (320, 180), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(place / "big.jpg"), cv2.resize(frame, (1280, 720)), [cv2.IMWRITE_JPEG_QUALITY, 98])
        raw = b"".join(np.roll(frame, i % 2, axis=1).tobytes() for i in range(20))
        clips.ffmpeg("-f", "rawvideo", "-pix_fmt", "bgr24", "-s", "320x180", "-r", 25, "-i", "pipe:0", "-c:v",
                     "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", place / "road.mp4", data=raw)  # fmt: skip
        say("signals")
        hit = signals(place, 0.15 * share, random.Random(seed))
        say("full disk")
        full = full_disk(place)
        say("long run")
        run = long_run(place, 0.25 * share)
    faults += hit["crashes"] + full["crashes"]
    if run["code"] or run["rows in order"] != run["frames"]:
        faults.append(f"long run: exit code {run['code']}, {run['rows in order']} of {run['frames']}, {run['err']}")
    total = sum(int(row[1].replace(",", "")) for row in rows if row[1] != "-")
    head = ["", "inputs", "results", "refused in one line", "faults", "left behind", "slowest, s", "peak MB"]
    injected = hit["faults injected"] + full["faults injected"]
    disk = (f"{full['faults injected']} commands onto a file system of 4 to 128 kB: {len(full['crashes'])} ended with "
            f"anything but exit code 0 or 2 and one line a complaint, {full['files']} temporary files left."
            if full["faults injected"] else "A full disk was not tried (mounting needs root).")  # fmt: skip
    return "\n".join([
        "# Reliability", "",
        f"Written by `python tools/reliability.py --minutes {minutes:g} --seed {seed}`. A fault is anything but a "
        "result or one error of one line: a traceback, an end by a signal, more than "
        f"{TOO_LONG_S:.0f} s for one input.", "",
        f"**{total:,} inputs tried, {injected} faults injected, kinds of fault found: {len(faults)}.**", "",
        "## Bad input", "",
        "| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1),
        *("| " + " | ".join(row) + " |" for row in rows),
        "", "`left behind` counts open files, threads, child processes and temporary files after the last input. Times "
        "are wall time on a busy machine.", "",
        "## Faults in mid-work", "",
        f"- SIGINT, SIGTERM and SIGKILL at random moments of `lanelib video`: {hit['faults injected']} runs, "
        f"{len(hit['crashes'])} wrong endings, {hit['processes']} processes left, {hit['files']} outputs touched or "
        f"temporary files left. (After SIGKILL nobody can tidy up: {hit['hidden parts after SIGKILL']} hidden `.part` "
        "files stayed, none under a final name.)",
        f"- {disk}", "",
        "## A long run", "",
        f"- {run['frames']:,} frames ({run['minutes of film']:.0f} minutes of film, 320x180) in {run['took_s']:.0f} s; "
        f"{run['rows in order']:,} rows came out in order",
        f"- memory of Python at most {run['peak']:.0f} MB, with ffmpeg {run['peak with ffmpeg']:.0f} MB; from the "
        f"first quarter to the end it grew by {run['growth']:.1f} MB",
        "", "## Faults found", "", *([f"- `{fault}`" for fault in faults] or ["None."]), ""])  # fmt: skip


def say(text: str) -> None:
    """To the terminal."""
    sys.stderr.write(f"reliability: {text}\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=10.0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(arguments.worker, arguments.seconds, arguments.seed)
    else:
        text = campaign(arguments.minutes, arguments.seed).replace(str(ROOT), ".")
        write_bytes(ROOT / "docs" / "RELIABILITY.md", text.encode())
        sys.stdout.write(text)
