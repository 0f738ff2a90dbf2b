"""What each command of the command line does. Here files meet functions; `arguments.py` says what may be given.

Every command takes the parsed arguments and a `Console`, and returns the exit code: 0, or 2 where some of the input
could not be used and the rest was done.
"""

import argparse
import json
import os
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from itertools import chain
from pathlib import Path

import numpy as np

from lanelib import datasets, rigs
from lanelib.camera import Camera
from lanelib.errors import BAD_INPUT, LanelibError
from lanelib.files import write_bytes
from lanelib.finder import LaneFinder, Rig
from lanelib.outputs import (
    Console,
    check_place,
    free_name,
    identities,
    json_lines,
    make_folder,
    picture_output,
    raw_names,
    refuse_one_name,
    refuse_other_kind,
    refuse_same,
    taken_names,
    video_output,
    with_folders,
    write_row,
)
from lanelib.pictures import PICTURE_SUFFIXES, read_image
from lanelib.pipeline import progress_bar
from lanelib.runs import describe, picture_of, run_video, write_pictures
from lanelib.threshold import recipe_by_name
from lanelib.video import probe

MAX_FRAMES_OF_CLIP = 40  # for a rig; more only repeat each other
CTRL_C_S = 0.2  # Windows answers it only between two waits for a thread
Work = tuple[Path, str, Path | None]  # a video, its `raw_file`, and where it is drawn to


# ---------------------------------------------------------------------------------------------- calibrate, rig, fetch
def calibrate(args: argparse.Namespace, console: Console) -> int:
    """Chessboards to a calibration file."""
    from lanelib import calibration

    pictures = list(with_folders(args.boards))
    for path in pictures:
        if os.path.isdir(path):
            raise LanelibError(f"{path}: needed a folder with chessboard pictures (JPEG, PNG or BMP), found none in it")
    check_place(args.output, sources=pictures)
    found = calibration.calibrate(pictures, board_wh=args.board, square_m=args.square, flat=not args.bent)
    for line in calibration_report(found):
        console.result(line)
    console.result(f"wrote {found.save(args.output)}")
    return 0


def calibration_report(found) -> Iterator[str]:
    """Lines about a `calibration.Calibration`: every board, the error of all, the intrinsics with their deviations."""
    from lanelib.evaluate import table

    rows = [["picture", "corners", "rms px", "used", "remark"]]
    for board in found.boards:
        grid = "-" if board.corners_wh is None else f"{board.corners_wh[0]}x{board.corners_wh[1]}"
        rms = "-" if board.rms_px is None else f"{board.rms_px:.2f}"
        rows.append([board.name, grid, rms, "yes" if board.used else "no", board.reason])
    yield table(rows, left=(0, 4))
    used = [board for board in found.boards if board.used]
    corners = sum(board.corners_wh[0] * board.corners_wh[1] for board in used)
    camera = found.camera
    yield (
        f"{len(used)} of {len(found.boards)} pictures used, {'flat' if found.flat else 'bent'} board, "
        f"{camera.size_wh[0]}x{camera.size_wh[1]}: RMS reprojection error {found.rms_px:.3f} px over {corners} corners"
    )
    matrix = camera.camera_matrix
    values = {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    values |= dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion, strict=True))
    for name, value in values.items():
        pixels = name[0] in "fc"
        digits, unit = (1, " px") if pixels else (4, "")
        yield f"  {name} {value:9.{digits}f} +- {camera.std[name]:.{digits}f}{unit}"


def rig(args: argparse.Namespace, console: Console) -> int:
    """A rig from frames of straight road."""
    from lanelib.autorig import MAXIMUM_FRAMES, find_rig

    check_place(args.output, sources=[*args.frames, args.camera])
    camera = None if str(args.camera) == "none" else Camera.load(args.camera)
    frames = []
    for path in (args.frames[i] for i in rigs.spread(len(args.frames), MAXIMUM_FRAMES)):
        if path.suffix.lower() in datasets.VIDEO_SUFFIXES:
            frames += rigs.frames_of_video(path, MAX_FRAMES_OF_CLIP)
        else:
            frames.append(read_image(path))
    if camera is not None and args.dash_period is not None:
        raise LanelibError("--dash-period sets the focal length, and --camera gives one already: leave one of them out")
    estimate = find_rig(
        frames, camera, lane_width_m=args.lane_width, name=args.output.stem, dash_period_m=args.dash_period
    )
    console.result(estimate.notes)
    console.result(f"wrote {estimate.rig.save(args.output)}")
    return 0


def fetch(args: argparse.Namespace, console: Console) -> int:
    """Bring a public data set."""
    from lanelib import fetch as fetching

    console.result(fetching.fetch(args.name, progress=console.note))
    return 0


# ---------------------------------------------------------------------------------------------- image, video, live
def image(args: argparse.Namespace, console: Console) -> int:
    """The lane in single pictures, each on its own; one that cannot be used does not stop the others."""
    recipe_by_name(args.recipe)
    pictures = list(with_folders(args.pictures))
    refuse_one_name(args.output, pictures, PICTURE_SUFFIXES, "pictures")
    refuse_other_kind(args.output)
    failed = 0
    taken = taken_names(args.json)
    sources = [*pictures, *_rig_files(args)]
    read = identities(sources)
    chooser = rigs.RigChooser(args.rig, pictures, console.note)

    @cache
    def finder_of(rig: Rig) -> LaneFinder:
        return LaneFinder(rig, recipe=args.recipe, track=False, neighbours=args.neighbours)

    with json_lines(args.json, sources=sources) as write_row:
        for path, raw_file in zip(pictures, raw_names(pictures), strict=True):
            try:
                with _system_errors_of(path):
                    frame = read_image(path)
                    finder = finder_of(chooser.for_picture(path, frame))
                    result = finder.process(frame)
                    write_row(result.to_row(raw_file))
                    out = free_name(picture_output(path, args.output, alone=len(pictures) == 1), taken)
                    make_folder(out.parent)
                    wrote = write_pictures(frame, result, finder, out, with_stages=args.stages, read=read)
                    more = f" and {len(wrote) - 1} stages" if len(wrote) > 1 else ""
                    console.result(f"{path}: {describe(result)}; wrote {out}{more}")
            except LanelibError as error:
                failed += 1
                console.complain(error)
    console.wrote(args.json)
    return _outcome(failed, len(pictures), "pictures", console)


def _rig_files(args: argparse.Namespace) -> list[Path]:
    """The rigs that may be read: no output may be one of them."""
    return [*rigs.known_rigs(), *([] if args.rig is None else [Path(args.rig)])]


@contextmanager
def _system_errors_of(path: Path):
    """What the system refuses while one file is worked on fails that file alone; a reader who has gone ends all."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise LanelibError(
            f"{path}: needed files and processes of the system, found: {error.strerror or error}; try it alone"
        ) from None


def video(args: argparse.Namespace, console: Console) -> int:
    """The lane in videos; one that cannot be used does not stop the others."""
    recipe_by_name(args.recipe)
    refuse_one_name(args.output, args.videos, datasets.VIDEO_SUFFIXES, "videos")
    failed = 0
    taken = taken_names(args.json)
    sources = [*args.videos, *_rig_files(args)]
    outputs = [None if args.no_video else free_name(video_output(path, args.output), taken) for path in args.videos]
    read = identities(sources)
    for out in filter(None, outputs):
        refuse_same(out, read)
    with json_lines(args.json, sources=sources) as write_row:
        work = list(zip(args.videos, raw_names(args.videos), outputs, strict=True))
        for error in _videos(work, args, write_row, console):
            if error is not None:
                failed += 1
                console.complain(error)
    console.wrote(args.json)
    return _outcome(failed, len(args.videos), "videos", console)


def _videos(works: list[Work], args: argparse.Namespace, write_row, console: Console) -> Iterator[LanelibError | None]:
    """What went wrong with each video, in the order given; None where nothing did.

    With `--jobs` above 1 so many are worked on at a time, each in its thread with ffmpeg processes of its own;
    what comes out is the same, because nothing is shared: rows wait in a temporary file until it is their turn.
    """
    if args.jobs == 1 or len(works) == 1:
        for work in works:
            yield _tried(work, args, write_row, console, None)
        return
    stop = threading.Event()
    with ExitStack() as stack:
        files: list[Path | None] = [None] * len(works)
        if args.json is not None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lanelib-")))
            files = [folder / f"{number}.jsonl" for number in range(len(works))]
        rows = [_rows_in(file) for file in files]
        stack.callback(_pass_on, chain(*rows), write_row)  # on Ctrl-C: what the others have found so far
        pool = stack.enter_context(ThreadPoolExecutor(args.jobs))
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        stack.callback(stop.set)  # on Ctrl-C the others end, too, and leave nothing half-written
        pairs = zip(files, works, strict=True)
        futures = [pool.submit(_tried_apart, file, work, args, console, stop) for file, work in pairs]
        for future, rows_of_one in zip(futures, rows, strict=True):
            while not wait([future], CTRL_C_S).done:
                pass
            error = future.result()
            _pass_on(rows_of_one, write_row)
            yield error


def _rows_in(file: Path | None) -> Iterator[dict]:
    """The rows that wait in a file, if it is there once the first one is asked for."""
    if file is not None and file.exists():
        with file.open(encoding="utf-8") as lines:
            yield from (json.loads(line) for line in lines if line.endswith("\n"))  # a full disk may cut the last


def _pass_on(rows: Iterable[dict], write_row) -> None:
    for row in rows:
        write_row(row)


def _drop_row(row: dict) -> None:
    pass


def _tried_apart(file: Path | None, work: Work, args, console, stop: threading.Event) -> LanelibError | None:
    """As `_tried`, with the rows in a file of their own."""
    if file is None:
        return _tried(work, args, _drop_row, console, stop)
    try:
        with _system_errors_of(work[0]), file.open("w", encoding="utf-8") as lines:
            return _tried(work, args, partial(write_row, lines), console, stop)
    except LanelibError as error:
        return error


def _tried(work: Work, args, write_row, console, stop: threading.Event | None) -> LanelibError | None:
    try:
        with _system_errors_of(work[0]):
            _one_video(work, args, write_row, console, stop)
    except LanelibError as error:
        return error
    return None


def _one_video(work: Work, args, write_row, console: Console, stop: threading.Event | None) -> None:
    path, raw_file, out = work
    info = probe(path)
    if args.rig is not None:
        rig = rigs.load_rig(args.rig)
    else:
        choice = rigs.rig_of_set(path) or rigs.choose_rig(rigs.frames_of_video(path), rigs.all_known())
        console.note(f"{path.name}: {choice}")
        rig = choice.rig
    rigs.check_fits(rig, info.size_wh, path)
    if out is not None:
        make_folder(out.parent)
    with progress_bar(path.name, quiet=console.quiet or stop is not None) as bar:

        def on_progress(done: int, expected: int) -> None:
            if stop is not None and stop.is_set():
                raise LanelibError(f"{path}: stopped, because the run was interrupted")
            bar(done, expected)

        summary, tally = run_video(
            path, out, rig, raw_file=raw_file, recipe=args.recipe, neighbours=args.neighbours, view=args.view,
            start_s=args.start, end_s=args.end, preset=args.preset, write_row=write_row,
            on_progress=on_progress)
    console.result(f"{summary}; {tally}")
    if summary.damage.truncated:
        raise LanelibError(f"{path}: needed a whole video, found one that ends too early; what there is was done")


def _outcome(failed: int, n: int, what: str, console: Console) -> int:
    if failed and n > 1:
        console.complain(f"{failed} of {n} {what} could not be used")
    return BAD_INPUT if failed else 0


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
                choice = rigs.choose_rig(waiting, rigs.all_known())
                console.note(choice)
                chosen = choice.rig
                waiting.clear()
            rigs.check_fits(chosen, frame.shape[1::-1], args.source)
            finder = LaneFinder(chosen, recipe=args.recipe, neighbours=args.neighbours)
        finder.tracker.tell_time(time_s)
        return picture_of(args.view, frame, finder.process(frame), finder)

    window = False if args.page else None
    summary = streaming.live(
        args.source, step, window=window, host=args.host, port=args.port, max_frames=args.frames, on_status=console.note
    )
    console.result(summary)
    return 0


# ---------------------------------------------------------------------------------------------- evaluate, course
def evaluate(args: argparse.Namespace, console: Console) -> int:
    """Predictions against labels or truth."""
    from lanelib import evaluate as evaluation

    to_file = args.json is not None and str(args.json) != "-"
    if to_file:
        check_place(args.json, sources=[args.labels, args.labels / "truth.json", args.predictions])
    found = evaluation.evaluate(args.labels, args.predictions)
    if found.unpredicted:
        n = len(found.frames)
        console.note(f"{found.unpredicted} of {n} labelled frames have no prediction and count as missed")
    if args.json is None or to_file:
        console.result(found)
    if args.json is not None:
        text = json.dumps(found.to_dict(), indent=1) + "\n"
        if to_file:
            console.result(f"wrote {write_bytes(args.json, text.encode())}")
        else:
            sys.stdout.write(text)
    return 0


def course(args: argparse.Namespace, console: Console) -> int:
    """The main job."""
    from lanelib.course import run_course

    return run_course(args.sets or None, videos=not args.no_videos, preset=args.preset, console=console)
