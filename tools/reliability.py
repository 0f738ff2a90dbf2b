"""The campaigns behind docs/RELIABILITY.md: thousands of bad inputs, faults in the middle of work, a clip of hours.

    python tools/reliability.py                 bad input and faults, about 40 minutes
    python tools/reliability.py --minutes 2     reduced
    python tools/reliability.py --long          only a clip of 2 hours, about half an hour

Each writes its section of the report; the others stay. Not part of `make test`; the same promises in small are in
tests/test_fuzz.py, whose functions, files and commands are used here, and in tests/test_reliability.py. Inputs are
tried in processes of their own, so that even an end by a signal inside a library is counted.
"""

import argparse
import contextlib
import io
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tools")]

import clips  # noqa: E402
import cv2  # noqa: E402
import interrupts  # noqa: E402
import longrun  # noqa: E402
import numpy as np  # noqa: E402
import psutil  # noqa: E402
import test_fuzz as fuzz  # noqa: E402

from lanelib import cli, datasets  # noqa: E402
from lanelib.birdseye import BirdsEye  # noqa: E402
from lanelib.camera import Camera  # noqa: E402
from lanelib.errors import LanelibError  # noqa: E402
from lanelib.files import write_bytes  # noqa: E402
from lanelib.finder import LaneFinder  # noqa: E402
from lanelib.rig import Rig  # noqa: E402

CAMPAIGNS = {
    "arrays of any shape into the image functions": "arrays",
    "arrays of any shape into the finder, all models": "finder",
    "random homographies, cameras and rigs": "numbers",
    "damaged JPEG, PNG, MP4, rig and camera files into the loaders": "loaders",
    "damaged files into the commands": "commands",
}
REPORT = ROOT / "docs" / "RELIABILITY.md"
BAD, MID, LONG = "## Bad input", "## Faults in mid-work", "## A long clip"
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
                "files": sum(1 for p in Path(folder).iterdir() if ".part" in p.name)}
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
               {"smoothing": "average"}, {"smoothing": "exponential"}, {"track": False}]
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
                                            fuzz.SIZE_WH).undistort(fuzz.ROAD_BGR))
        lens = np.array(values[12:17]) / 1e3
        tried.call("lens", lambda: use(Rig(Camera(fuzz.CAMERA.camera_matrix, lens, fuzz.SIZE_WH), fuzz.RIG.birdseye)))
        tried.call("mounting", lambda: use(Rig(fuzz.CAMERA, BirdsEye.from_mounting(
            fuzz.CAMERA, height_m=values[0], pitch_deg=values[1], yaw_deg=values[2], roll_deg=values[3]))))

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
                            stderr=subprocess.PIPE, **options)


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
                         "rig big.jpg --camera camera.json -o disk/out.json"):
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
                found["files"] += sum(p.name.startswith(".") for p in disk.iterdir())  # kept rows have no dot
                for path in disk.iterdir():
                    path.unlink()
        finally:
            subprocess.run(["umount", disk], check=False)
    return found


def long_clip(hours: float, fps: int) -> str:
    """The section about a clip of hours, run now."""
    with tempfile.TemporaryDirectory(prefix="reliability") as folder:
        command = f"python tools/reliability.py --long --hours {hours:g} --fps {fps}"
        return longrun.long_run(lanelib, Path(folder), hours, fps=fps).markdown(command)


# ---------------------------------------------------------------------------------------------- the report
def bad_input(minutes: float, seed: int) -> str:
    """The section about bad input, tried now."""
    rows, faults, inputs, left = [], [], 0, 0
    seconds = 60 * minutes / len(CAMPAIGNS)
    for i, (title, name) in enumerate(CAMPAIGNS.items()):
        say(title)
        command = [sys.executable, __file__, "--worker", name, "--seconds", str(seconds), "--seed", str(seed + i)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=3 * seconds + 300, cwd=ROOT)
            result = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None
            why = "" if result else f"exit code {done.returncode}: {done.stderr.splitlines()[-1:]}"
        except subprocess.TimeoutExpired:
            result, why = None, "did not end"
        if result is None:
            faults.append(f"{title}: {why}")
            rows.append([title, "-", "-", "-", "1", "-", "-", "-"])
            continue
        faults += [f"{title}: {fault}" for fault in sorted(set(result["faults"]))[:10]]
        rows.append([title, *(f"{result[k]:,}" for k in ("inputs", "results", "refused")), str(len(result["faults"])),
                     str(sum(result["left"].values())), f"{result['slowest_s']:.1f}", f"{result['peak_mb']:.0f}"])
        inputs, left = inputs + result["inputs"], left + sum(result["left"].values())
        if any(result["left"].values()):
            faults.append(f"{title}: left behind {result['left']}")
    head = ["", "inputs", "results", "refused in one line", "faults", "left behind", "slowest, s", "peak MB"]
    return "\n".join([
        BAD, "",
        f"Written by `python tools/reliability.py --only bad --minutes {minutes:g} --seed {seed}`. A fault is anything "
        "but a result or one error of one line: a traceback, an end by a signal, more than "
        f"{TOO_LONG_S:.0f} s for one input.", "",
        f"**{inputs:,} inputs tried, kinds of fault found: {len(faults)}, things left behind: {left}.**", "",
        "| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1),
        *("| " + " | ".join(row) + " |" for row in rows),
        "", "`left behind` counts open files, threads, child processes and temporary files after the last input. Times "
        "are wall time on a busy machine.", "", found(faults)])


def faults_in_work(minutes: float, seed: int) -> str:
    """The section about signals and full disks, tried now."""
    with tempfile.TemporaryDirectory(prefix="reliability") as folder:
        place = Path(folder)
        originals(place)
        frame = cv2.resize(fuzz.ROAD_BGR, (320, 180), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(place / "big.jpg"), cv2.resize(frame, (1280, 720)), [cv2.IMWRITE_JPEG_QUALITY, 98])
        raw = b"".join(np.roll(frame, i % 2, axis=1).tobytes() for i in range(200))
        clips.ffmpeg("-f", "rawvideo", "-pix_fmt", "bgr24", "-s", "320x180", "-r", 25, "-i", "pipe:0", "-c:v",
                     "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", place / "long.mp4", data=raw)
        say("full disk")
        full = full_disk(place)
        (place / "interrupts").mkdir()
        say("signals")
        hit = interrupts.campaign(place / "interrupts", 60 * minutes, seed)
    disk = (f"{full['faults injected']} commands onto a file system of 4 to 128 kB: {len(full['crashes'])} ended with "
            f"anything but exit code 0 or 2 and one line a complaint, {full['files']} temporary files left."
            if full["faults injected"] else "A full disk was not tried (mounting needs root).")
    return "\n".join([
        MID, "",
        f"Written by `python tools/reliability.py --only faults --minutes {minutes:g} --seed {seed}`.", "",
        f"**{hit.injected + full['faults injected']} faults injected, {len(hit.wrong) + len(full['crashes'])} with "
        "anything wrong afterwards.**", "",
        f"- SIGINT, SIGTERM and SIGKILL at random moments of `lanelib {'`, `'.join(interrupts.COMMANDS)}`: "
        f"{hit.injected} runs. Wrong would be: another exit code than 130, 143 and -9, more than its one line, a "
        "process or temporary file that stayed, a file under its final name that is not whole. After SIGKILL nobody "
        f"can tidy up: {hit.parts} hidden unfinished files were there in the end, and one more run of each command "
        "took them away.",
        f"- {disk}", "", found(hit.wrong + full["crashes"])])


def found(faults: list[str]) -> str:
    """The last lines of a section."""
    return "Faults: none.\n" if not faults else "Faults:\n\n" + "\n".join(f"- `{fault}`" for fault in faults) + "\n"


def sections(report: str) -> dict[str, str]:
    """Heading: the whole section from its heading on."""
    parts = re.split(r"^(?=## )", report, flags=re.MULTILINE)[1:]
    return {part.splitlines()[0]: part for part in parts}


def with_section(report: str, section: str) -> str:
    """The report with this section, in the place of the one of its heading or at the end."""
    own = sections(report) | {section.splitlines()[0]: section}
    return report.partition("## ")[0] + "\n".join(part.rstrip("\n") + "\n" for part in own.values())


def say(text: str) -> None:
    """To the terminal."""
    sys.stderr.write(f"reliability: {text}\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("bad", "faults", "long"), help="one section; the others stay")
    parser.add_argument("--long", action="store_const", dest="only", const="long", help="the same as --only long")
    parser.add_argument("--minutes", type=float, default=20.0, help="for each of the first two sections, about")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hours", type=float, default=2.0, help="of the long clip")
    parser.add_argument("--fps", type=int, default=25, help="of the long clip")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=10.0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(arguments.worker, arguments.seconds, arguments.seed)
    else:
        make = {"bad": lambda: bad_input(arguments.minutes, arguments.seed),
                "faults": lambda: faults_in_work(arguments.minutes, arguments.seed),
                "long": lambda: long_clip(arguments.hours, arguments.fps)}
        for name in [arguments.only] if arguments.only else ("bad", "faults"):
            section = make[name]().replace(str(ROOT), ".")
            write_bytes(REPORT, with_section(REPORT.read_text(encoding="utf-8"), section).encode())
            sys.stdout.write(section)
