"""The main job of `make`: every data set that is there, from chessboards to annotated videos.

For each set, in this order: calibrate (`output_images/SET/calibration.json`, and pictures before and after
undistortion), every picture with all stages, every video, the write-up. Folders are named by notebook and step, as
`02_mask` (see `writeup_figures`). What cannot be done is said, the rest goes on, and the end says what was missed.
"""

from collections.abc import Iterable
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from lanelib import calibration, datasets, rigs
from lanelib.errors import BAD_INPUT, FAULT, LanelibError, one_line
from lanelib.evaluate import Evaluation, evaluate, table
from lanelib.files import write_bytes
from lanelib.finder import LaneFinder, Rig
from lanelib.labels import read_rows
from lanelib.outputs import Console, free_name, json_lines, make_folder
from lanelib.pictures import read_image
from lanelib.pipeline import progress_bar
from lanelib.runs import TALLY_HEAD, Tally, run_video
from lanelib.video import probe
from lanelib.writeup import write_up
from lanelib.writeup_figures import OVERLAY, write_before_after, write_boards, write_clip, write_errors, write_steps

BEFORE_AFTER = 2  # boards, and road pictures, shown before and after undistortion


@dataclass
class Report:
    """What was done with one set: lines for the summary, and what failed."""

    name: str
    lines: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    faults: int = 0
    calibrated: calibration.Calibration | None = None
    scores: dict[str, Evaluation] = field(default_factory=dict)  # of pictures and clips with truth

    def markdown(self) -> str:
        """The summary of the set."""
        parts = [f"# {self.name}", *self.lines]
        if self.rows:
            parts.append(table([TALLY_HEAD, *self.rows]))
        if self.failures:
            parts.append("Could not be done:\n\n" + "\n".join(f"- {failure}" for failure in self.failures))
        return "\n\n".join(parts) + "\n"


def run_course(
    names: Iterable[str] | None = None, *, videos: bool = True, preset: str = "veryfast", console: Console | None = None
) -> int:
    """Run everything on the sets `names` (None: all that are there).

    Returns the exit code: 0, 2 where some input could not be used, 1 where lanelib itself failed on some.
    """
    console = console or Console(quiet=True)
    names = list(dict.fromkeys(names)) if names is not None else list(datasets.available())
    if not names:
        raise LanelibError("course: needed at least one data set, found none; bring one with `lanelib fetch udacity`")
    sets = [datasets.get(name) for name in names]  # a name that is not there is said before hours of work
    reports = []
    for data_set in sets:
        console.note(data_set)
        report = run_set(data_set, videos=videos, preset=preset, console=console)
        reports.append(report)
        console.result("\n" + report.markdown())
    failures = [f"{report.name}: {failure}" for report in reports for failure in report.failures]
    for failure in failures:
        console.complain(f"not done: {failure}")
    return FAULT if any(report.faults for report in reports) else BAD_INPUT if failures else 0


def run_set(data_set: datasets.DataSet, *, videos: bool, preset: str, console: Console) -> Report:
    """One set; its summary is written to `output_images/SET/summary.md`."""
    report = Report(data_set.name)
    make_folder(data_set.output_images)
    with _goes_on(report, console):
        if data_set.boards():
            _calibrate(data_set, report, console)
    rig = None
    if data_set.images() or (videos and data_set.videos()):
        with _goes_on(report, console):
            rig = _rig_of(data_set, report, console)
    if rig is not None:
        if data_set.images():
            with _goes_on(report, console):
                _pictures(data_set, rig, report, console)
        if videos and data_set.videos():
            with _goes_on(report, console):
                make_folder(data_set.output_videos / OVERLAY)
                _videos(data_set, rig, preset, report, console)
    for name, text in (
        ("summary.md", report.markdown()),
        ("WRITEUP.md", write_up(data_set, rig, report.calibrated, report.scores)),
    ):
        write_bytes(data_set.output_images / name, text.encode())
        console.note(f"wrote {data_set.output_images / name}")
    return report


@contextmanager
def _goes_on(report: Report, console: Console):
    """A failure inside is said and noted in the report, and the run goes on."""
    try:
        yield
        return
    except BrokenPipeError:
        raise
    except LanelibError as error:
        text = one_line(error, error)
    except Exception as error:
        report.faults += 1
        text = one_line(f"a fault of lanelib ({type(error).__name__}: {error}); please report it", error)
    report.failures.append(text)
    console.complain(text)


def _calibrate(data_set: datasets.DataSet, report: Report, console: Console) -> None:
    boards = data_set.boards()
    found = report.calibrated = calibration.calibrate(boards)
    path = found.save(data_set.output_images / "calibration.json")
    used = sum(board.used for board in found.boards)
    report.lines.append(
        f"Calibration: {used} of {len(boards)} chessboards used, RMS reprojection error {found.rms_px:.3f} px"
    )
    report.lines += [f"- {board!r}" for board in found.boards if not board.used]
    console.note(f"{report.lines[0]}; wrote {path}")
    folder = data_set.output_images
    write_before_after([*boards[:BEFORE_AFTER], *data_set.images()[:BEFORE_AFTER]], found.camera, folder)
    write_boards(boards, found, folder)


def _rig_of(data_set: datasets.DataSet, report: Report, console: Console) -> Rig:
    """The set's own rig; else the known one that explains its pictures (or its first video) best."""
    if data_set.has_rig:
        return Rig.load(data_set.rig_file)
    if data_set.images():
        images = data_set.images()
        frames = []
        for i in rigs.spread(len(images), rigs.TRIAL_FRAMES):
            with suppress(LanelibError):  # said when its turn comes
                frames.append(read_image(images[i]))
        frames = [frame for frame in frames if frame.shape == frames[0].shape]
    else:
        frames = rigs.frames_of_video(data_set.videos()[0])
    choice = rigs.choose_rig(frames, rigs.all_known())
    camera = data_set.output_images / "calibration.json" if report.calibrated else "none"
    make = f"make one: lanelib rig FRAMES --camera {camera} -o {data_set.rig_file}"
    console.note(f"{data_set.name} has no rig of its own; {choice}; {make}")
    report.lines.append(f"No rig of its own; {choice}; {make}")
    return choice.rig


def _pictures(data_set: datasets.DataSet, rig: Rig, report: Report, console: Console) -> None:
    """Each picture on its own, with all stages."""
    images = data_set.images()
    finder, tally = LaneFinder(rig, track=False), Tally("pictures")
    rows = data_set.output_images / "lanes.jsonl"
    taken: set[str] = set()
    with json_lines(rows) as write_row, progress_bar(f"{data_set.name} pictures", quiet=console.quiet) as bar:
        for number, path in enumerate(images, 1):
            with _goes_on(report, console):
                frame = read_image(path)
                rigs.check_fits(rig, frame.shape[1::-1], path)
                result = finder.process(frame)
                tally.add(result)
                write_row(result.to_row(path.name))
                stem = free_name(Path(f"{path.stem}.jpg"), taken).stem
                write_steps(frame, result, finder, data_set.output_images, stem)
            bar(number, len(images))
    report.rows.append(tally.row())
    console.note(f"{data_set.name}: {tally.frames} pictures, {tally}; wrote {data_set.output_images}")
    _score("pictures", data_set.test_images, rows, report)
    if "pictures" in report.scores:
        write_errors(report.scores["pictures"].frames, data_set.output_images)


def _videos(data_set: datasets.DataSet, rig: Rig, preset: str, report: Report, console: Console) -> None:
    """Each video on its own; they do not depend on each other."""
    rows, truth = [], data_set.video_truth()
    taken: set[str] = set()
    for path in data_set.videos():
        with _goes_on(report, console):
            out = free_name(data_set.output_videos / OVERLAY / f"{path.stem}.mp4", taken)
            rigs.check_fits(rig, probe(path).size_wh, path)
            rows.append(out.with_suffix(".jsonl"))
            with json_lines(rows[-1]) as write_row, progress_bar(path.name, quiet=console.quiet) as bar:
                summary, tally = run_video(path, out, rig, preset=preset, write_row=write_row, on_progress=bar)
            report.rows.append(tally.row())
            console.note(f"{summary}; {tally}")
            write_clip(out, list(read_rows(rows[-1]).values()), truth, probe(path).fps, data_set.output_images)
            if summary.damage.truncated:
                raise LanelibError(f"{path}: the file ends too early; what there is was done")
    _score_videos(data_set, rows, report)


def _score(what: str, folder: Path, rows: Path, report: Report) -> None:
    """Against the truth, where `folder` has it."""
    if (folder / "truth.json").is_file():
        found = report.scores[what] = evaluate(folder, rows)
        report.lines.append(f"Against the truth of the {what} ({rows.name}):\n\n{found}")


def _score_videos(data_set: datasets.DataSet, rows: list[Path], report: Report) -> None:
    if (data_set.test_videos / "truth.json").is_file():
        together = data_set.output_videos / "lanes.jsonl"
        text = "".join(path.read_text(encoding="utf-8") for path in rows if path.is_file())
        _score("clips", data_set.test_videos, write_bytes(together, text.encode()), report)
