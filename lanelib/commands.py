"""What each command of the command line does. Here files meet functions; `cli.py` reads the arguments.

Every command takes the parsed arguments and a `Console`, and returns the exit code: 0, or 2 where some of the input could
not be used and the rest was done.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np

from lanelib import datasets, draw, rigs
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, LaneResult, Rig
from lanelib.pictures import read_image, write_bytes, write_image
from lanelib.pipeline import Summary, process_video, progress_bar

OUTPUT = "lanelib_output"  # where results go of pictures that are of no data set and without -o
MAX_FRAMES_OF_CLIP = 40  # for a rig; more only repeat each other


class Console:
    """What the user reads: results on stdout, what went on and what went wrong on stderr.

    `to_stderr`: stdout carries JSON, so that results are said on stderr too. `quiet`: only what went wrong.
    """

    def __init__(self, *, quiet: bool = False, to_stderr: bool = False):
        self.quiet, self._results = quiet, sys.stderr if to_stderr else sys.stdout

    def result(self, text: object) -> None:
        """What the command was asked for: tables, and where what was written."""
        if not self.quiet:
            self._results.write(f"{text}\n")

    def note(self, text: object) -> None:
        """What was chosen or went on."""
        if not self.quiet:
            sys.stderr.write(f"lanelib: {text}\n")
            sys.stderr.flush()

    def complain(self, text: object) -> None:
        """What could not be done; one line whatever is in it."""
        sys.stderr.write(f"lanelib: {' '.join(str(text).split())}\n")
        sys.stderr.flush()


# ---------------------------------------------------------------------------------------------- calibrate, rig, fetch
def calibrate(args: argparse.Namespace, console: Console) -> int:
    """Chessboards to a calibration file."""
    from lanelib import calibration

    pictures = list(_with_folders(args.boards))
    check_place(args.output, sources=pictures)
    found = calibration.calibrate(pictures, board_wh=args.board, square_m=args.square, flat=not args.bent)
    for line in calibration_report(found):
        console.result(line)
    console.result(f"wrote {found.save(args.output)}")
    return 0


def calibration_report(found) -> Iterator[str]:
    """Lines about a `calibration.Calibration`: every board, the overall error, the intrinsics with standard deviations."""
    from lanelib.evaluate import table

    rows = [["picture", "corners", "rms px", "used", "remark"]]
    for board in found.boards:
        grid = "-" if board.corners_wh is None else f"{board.corners_wh[0]}x{board.corners_wh[1]}"
        rms = "-" if board.rms_px is None else f"{board.rms_px:.2f}"
        rows.append([board.name, grid, rms, "yes" if board.used else "no", board.reason])
    yield table(rows)
    used = [board for board in found.boards if board.used]
    corners = sum(board.corners_wh[0] * board.corners_wh[1] for board in used)
    camera = found.camera
    yield (f"{len(used)} of {len(found.boards)} pictures used, {'flat' if found.flat else 'bent'} board, "
           f"{camera.size_wh[0]}x{camera.size_wh[1]}: RMS reprojection error {found.rms_px:.3f} px over {corners} corners")
    matrix = camera.camera_matrix
    values = {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    values |= dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion, strict=True))
    for name, value in values.items():
        pixels = name[0] in "fc"
        digits, unit = (1, " px") if pixels else (4, "")
        yield f"  {name} {value:9.{digits}f} +- {camera.std[name]:.{digits}f}{unit}"


def rig(args: argparse.Namespace, console: Console) -> int:
    """A rig from frames of straight road."""
    from lanelib.autorig import find_rig

    check_place(args.output, sources=args.frames)
    camera = None if str(args.camera) == "none" else Camera.load(args.camera)
    frames = []
    for path in args.frames:
        if path.suffix.lower() in datasets.VIDEO_SUFFIXES:
            frames += rigs.frames_of_video(path, MAX_FRAMES_OF_CLIP)
        else:
            frames.append(read_image(path))
    estimate = find_rig(frames, camera, lane_width_m=args.lane_width, name=args.output.stem)
    console.result(estimate.notes)
    console.result(f"wrote {estimate.rig.save(args.output)}")
    return 0


def fetch(args: argparse.Namespace, console: Console) -> int:
    """Bring a public data set."""
    from lanelib import fetch as fetching

    console.result(fetching.fetch(args.name, progress=console.note))
    return 0


# ---------------------------------------------------------------------------------------------- image
def image(args: argparse.Namespace, console: Console) -> int:
    """The lane in single pictures, each on its own; one that cannot be used does not stop the others."""
    failed = 0
    chooser = RigChooser(args.rig, args.pictures, console)
    names = _raw_names(args.pictures)
    taken: set[Path] = set()
    finders: dict[int, LaneFinder] = {}
    with json_lines(args.json, sources=args.pictures) as write_row:
        for path, raw_file in zip(args.pictures, names, strict=True):
            try:
                frame = read_image(path)
                chosen = chooser.for_picture(path, frame)
                if id(chosen) not in finders:
                    finders[id(chosen)] = LaneFinder(chosen, recipe=args.recipe, track=False)
                finder = finders[id(chosen)]  # the chooser keeps every rig, so that no id comes twice
                result = finder.process(frame)
                write_row(result.to_row(raw_file))
                out = _free_name(_picture_output(path, args.output, alone=len(args.pictures) == 1), taken)
                _refuse_same(out, args.pictures)
                _make_folder(out.parent)
                write_image(out, draw.overlay(frame, result))
                stages = write_stages(out, frame, finder) if args.stages else []
                more = f" and {len(stages)} stages" if stages else ""
                console.result(f"{path}: {describe(result)}; wrote {out}{more}")
            except LanelibError as error:
                failed += 1
                console.complain(error)
    _say_json(args.json, console)
    if failed and len(args.pictures) > 1:
        console.complain(f"{failed} of {len(args.pictures)} pictures could not be used")
    return 2 if failed else 0


def write_stages(out: Path, frame: np.ndarray, finder: LaneFinder) -> list[Path]:
    """Every intermediate picture beside `out`, numbered in the order of the pipeline."""
    from lanelib.stages import stages

    return [write_image(out.with_name(f"{out.stem}_{i}_{name}.jpg"), picture)
            for i, (name, picture) in enumerate(stages(frame, finder).items(), 1)]


def describe(result: LaneResult) -> str:
    """A result in words, on one line."""
    if not result:
        return f"no lane: {result.reason}"
    radius = result.radius_m
    side = "right" if result.offset_m > 0 else "left"
    bend = ("straight" if radius is None or not np.isfinite(radius)
            else f"radius {radius:.0f} m to the {'left' if result.curvature_1pm > 0 else 'right'}")
    return (f"{result.status}, {bend}, {abs(result.offset_m):.2f} m {side} of centre, lane {result.width_m:.2f} m wide, "
            f"confidence {result.confidence:.2f}")


# ---------------------------------------------------------------------------------------------- video
def video(args: argparse.Namespace, console: Console) -> int:
    """The lane in videos; one that cannot be used does not stop the others."""
    if len(args.videos) > 1 and args.output is not None and args.output.suffix.lower() in datasets.VIDEO_SUFFIXES:
        raise LanelibError(f"{args.output}: needed a folder as output of {len(args.videos)} videos, found the name of a video")
    failed = 0
    taken: set[Path] = set()
    with json_lines(args.json, sources=args.videos) as write_row:
        for path in args.videos:
            try:
                out = None if args.no_video else _free_name(_video_output(path, args.output), taken)
                summary, counts = one_video(path, out, args, write_row, console)
                console.result(f"{summary}; lane {counts}")
                if summary.damage.truncated:
                    raise LanelibError(f"{path}: needed a whole video, found one that ends too early; what there is was done")
            except LanelibError as error:
                failed += 1
                console.complain(error)
    _say_json(args.json, console)
    if failed and len(args.videos) > 1:
        console.complain(f"{failed} of {len(args.videos)} videos could not be used")
    return 2 if failed else 0


def one_video(path: Path, out: Path | None, args: argparse.Namespace, write_row, console: Console) -> tuple[Summary, str]:
    """One video from file to file. Frames are processed in order: each lane is tracked from the one before."""
    info = rigs.probe(path)
    if args.rig is not None:
        chosen = rigs.load_rig(args.rig)
    else:
        choice = rigs.rig_of_set(path) or rigs.choose_rig(rigs.frames_of_video(path), map(Rig.load, rigs.known_rigs()))
        console.note(f"{path.name}: {choice}")
        chosen = choice.rig
    rigs.check_fits(chosen, info.size_wh, path)
    if out is not None:
        _make_folder(out.parent)
    finder = LaneFinder(chosen, recipe=args.recipe)
    counts = dict.fromkeys(("measured", "held", "none"), 0)

    def step(frame: np.ndarray, index: int, time_s: float) -> np.ndarray | None:
        result = finder.process(frame)
        counts[result.status] += 1
        write_row(result.to_row(f"{path.name}:{index:06d}"))
        return None if out is None else view(args.view, frame, result, finder)

    with progress_bar(path.name, quiet=console.quiet) as bar:
        summary = process_video(path, step, output=out, start_s=args.start, end_s=args.end, on_progress=bar, preset=args.preset)
    if not summary.frames_in:
        raise LanelibError(f"{path}: needed frames between --start {args.start:g} s and the end, found none; choose another section")
    return summary, ", ".join(f"{name} {n}" for name, n in counts.items())


VIEWS = ("overlay", "diagnostic", "birdseye")


def view(name: str, frame: np.ndarray, result: LaneResult, finder: LaneFinder) -> np.ndarray:
    """The picture of one frame that was asked for."""
    if name == "diagnostic":
        return draw.diagnostic(frame, result, finder)
    if name == "birdseye":
        return draw.birdseye(frame, result, finder)
    return draw.overlay(frame, result)


def live(args: argparse.Namespace, console: Console) -> int:
    """A camera or stream, shown as it comes."""
    from lanelib import live as streaming

    rig_given = None if args.rig is None else rigs.load_rig(args.rig)
    finder, waiting = None, []

    def step(frame: np.ndarray, index: int, time_s: float) -> np.ndarray:
        nonlocal finder
        if finder is None:
            chosen = rig_given
            if chosen is None:
                waiting.append(frame)
                if len(waiting) < rigs.TRIAL_FRAMES:
                    return frame
                choice = rigs.choose_rig(waiting, map(Rig.load, rigs.known_rigs()))
                console.note(choice)
                chosen = choice.rig
                waiting.clear()
            rigs.check_fits(chosen, frame.shape[1::-1], args.source)
            finder = LaneFinder(chosen, recipe=args.recipe)
        return view(args.view, frame, finder.process(frame), finder)

    summary = streaming.live(args.source, step, host=args.host, port=args.port, max_frames=args.frames,
                             window=False if args.page else None, on_status=console.note)
    console.result(summary)
    return 0


# ---------------------------------------------------------------------------------------------- evaluate, course
def evaluate(args: argparse.Namespace, console: Console) -> int:
    """Predictions against labels or truth."""
    from lanelib import evaluate as evaluation

    found = evaluation.evaluate(args.labels, args.predictions)
    if args.json is None or str(args.json) != "-":
        console.result(found)
    if args.json is not None:
        text = json.dumps(found.to_dict(), indent=1) + "\n"
        if str(args.json) == "-":
            sys.stdout.write(text)
        else:
            check_place(args.json, sources=[args.labels, args.predictions])
            console.result(f"wrote {write_bytes(args.json, text.encode())}")
    return 0


def course(args: argparse.Namespace, console: Console) -> int:
    """The main job."""
    from lanelib.course import run_course

    return run_course(args.sets or None, videos=not args.no_videos, preset=args.preset, console=console)


# ---------------------------------------------------------------------------------------------- helpers
class RigChooser:
    """The rig for each picture: the one given, that of its data set, or the known one that explains the pictures best."""

    def __init__(self, given: str | None, pictures: list[Path], console: Console):
        self._given = None if given is None else rigs.load_rig(given)
        self._pictures, self._console = pictures, console
        self._of_folder: dict[Path, Rig | None] = {}
        self._of_shape: dict[float, Rig] = {}

    def for_picture(self, path: Path, frame: np.ndarray) -> Rig:
        """LanelibError where no rig fits the picture."""
        size_wh = frame.shape[1::-1]
        chosen = self._given or self._from_set(path)
        if chosen is None:
            shape = round(size_wh[0] / size_wh[1], 2)
            if shape not in self._of_shape:
                choice = rigs.choose_rig(self._trial(path, frame, shape), map(Rig.load, rigs.known_rigs()))
                self._of_shape[shape] = choice.rig
                self._console.note(choice)
            chosen = self._of_shape[shape]
        rigs.check_fits(chosen, size_wh, path)
        return chosen

    def _from_set(self, path: Path) -> Rig | None:
        folder = path.resolve().parent
        if folder not in self._of_folder:
            choice = rigs.rig_of_set(path)
            if choice:
                self._console.note(choice)
            self._of_folder[folder] = choice.rig if choice else None
        return self._of_folder[folder]

    def _trial(self, path: Path, frame: np.ndarray, shape: float) -> list[np.ndarray]:
        """The picture and others of the same proportions, as far as they can be read."""
        others = [p for p in self._pictures if p != path and self._of_folder.get(p.resolve().parent) is None]
        frames = [frame]
        for i in rigs.spread(len(others), rigs.TRIAL_FRAMES - 1):
            with suppress(LanelibError):  # said when its turn comes
                other = read_image(others[i])
                if round(other.shape[1] / other.shape[0], 2) == shape:
                    frames.append(other)
        return frames


@contextmanager
def json_lines(path: Path | None, *, sources: Iterable[Path] = ()):
    """A function that writes a row; the file has its name only when the block ends ("-": stdout, None: nowhere).

    Where the block ends with an exception, a file that was there before stays as it was.
    """
    if path is None:
        yield lambda row: None
        return
    if str(path) == "-":
        yield lambda row: _write_row(sys.stdout, row)
        return
    special = path.exists() and not path.is_file() and not path.is_dir()  # /dev/null, a named pipe: nothing to rename
    if not special:
        check_place(path, sources=sources)
    part = path if special else path.with_name(f".{path.name[:200]}.{os.getpid()}.part")
    with _says_where(path):
        file = part.open("w", encoding="utf-8")

    def write(row: dict) -> None:
        with _says_where(path):
            _write_row(file, row)

    try:
        yield write
        with _says_where(path):
            file.close()
            if not special:
                os.replace(part, path)
    finally:
        with suppress(OSError):
            file.close()
        if not special:
            part.unlink(missing_ok=True)


@contextmanager
def _says_where(path: Path):
    """An error of the system while `path` is written, as one line."""
    try:
        yield
    except OSError as error:
        raise LanelibError(f"{path}: needed a place for the results, found: {error.strerror}; choose another") from None


def _write_row(file: IO[str], row: dict) -> None:
    file.write(json.dumps(row, allow_nan=False) + "\n")


def _say_json(path: Path | None, console: Console) -> None:
    if path is not None and str(path) != "-":
        console.result(f"wrote {path}")


def check_place(path: Path, *, sources: Iterable[Path] = ()) -> None:
    """LanelibError, before any work is done, where `path` cannot be written or is one of the files that are read."""
    if path.is_dir():
        raise LanelibError(f"{path}: needed the name of a file to write, found a folder; name a file in it")
    if not path.parent.is_dir():
        raise LanelibError(f"{path}: needed an existing folder for the output, found none; make {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise LanelibError(f"{path}: needed a folder with write permission, found none on {path.parent}; choose another")
    _refuse_same(path, sources)


def _refuse_same(out: Path, sources: Iterable[Path]) -> None:
    if out.exists() and any(source.exists() and os.path.samefile(out, source) for source in sources):
        raise LanelibError(f"{out}: needed another file for the output than for the input, found the same; choose another -o")


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LanelibError(f"{folder}: needed a folder for the output, found: {error.strerror}; choose another -o") from None


def _folder_for(path: Path, given: Path | None, kind: str) -> Path:
    """Where results of `path` go: -o, else the output folder of its data set, else OUTPUT."""
    if given is not None:
        return given
    found = rigs.set_of(path)
    return getattr(found, kind) if found else Path(OUTPUT)


def _picture_output(path: Path, given: Path | None, *, alone: bool) -> Path:
    if given is not None and alone and given.suffix.lower() in datasets.PICTURE_SUFFIXES and not given.is_dir():
        return given
    return _folder_for(path, given, "output_images") / f"{path.stem}.jpg"


def _video_output(path: Path, given: Path | None) -> Path:
    if given is not None and given.suffix.lower() in datasets.VIDEO_SUFFIXES and not given.is_dir():
        return given
    return _folder_for(path, given, "output_videos") / f"{path.stem}.mp4"


def _free_name(path: Path, taken: set[Path]) -> Path:
    """`path`, or NAME-2, NAME-3 … where this run has written that name already."""
    free, n = path, 1
    while free in taken:
        n += 1
        free = path.with_name(f"{path.stem}-{n}{path.suffix}")
    taken.add(free)
    return free


def _raw_names(paths: list[Path]) -> list[str]:
    """`raw_file` of each picture: the file's name, or the path as given where several have that name."""
    names = [path.name for path in paths]
    return [path.as_posix() if names.count(path.name) > 1 else path.name for path in paths]


def _with_folders(paths: Iterable[Path]) -> Iterator[Path]:
    """Files as they are, folders as the pictures in them in natural order."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        inside = [p for p in path.iterdir() if p.suffix.lower() in datasets.PICTURE_SUFFIXES and p.is_file()]
        if not inside:
            raise LanelibError(f"{path}: needed a folder with chessboard pictures, found none in it; check the name")
        yield from sorted(inside, key=lambda p: datasets.natural_key(p.name))
