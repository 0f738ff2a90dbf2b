"""Where results go: which file, made so that it is whole or not there, and what is said about it."""

import json
import os
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from lanelib import datasets, rigs
from lanelib.errors import LanelibError, one_line
from lanelib.parts import is_special, numbered, part_of, remove_abandoned
from lanelib.pictures import PICTURE_SUFFIXES, pictures_in

OTHER_PICTURES = (".gif", ".heic", ".pdf", ".svg", ".tif", ".tiff", ".webp")
OUTPUT = "lanelib_output"  # folder of results of pictures that are of no data set, without -o


class Console:
    """What the user reads: results on stdout, what went on and what went wrong on stderr.

    `to_stderr`: stdout carries JSON, so that results are said on stderr too. `quiet`: only what went wrong. `came`: the
    signals that came so far.
    """

    def __init__(self, *, quiet: bool = False, to_stderr: bool = False, came: Sequence[int] = ()):
        self.quiet, self._results, self._came = quiet, sys.stderr if to_stderr else sys.stdout, came

    def result(self, text: object) -> None:
        """What the command was asked for: tables, and where what was written."""
        if not self.quiet:
            self._results.write(f"{text}\n")

    def note(self, text: object) -> None:
        """What was chosen or went on."""
        if not self.quiet:
            sys.stderr.write(f"lanelib: {text}\n")
            sys.stderr.flush()

    def wrote(self, path: Path | None) -> None:
        """That a file of results is there now (None and "-": nothing was to be written)."""
        if path is not None and str(path) != "-":
            self.result(f"wrote {path}")

    def complain(self, text: object) -> None:
        """What could not be done; one line whatever is in it. Where a signal came, a library has made this failure of
        it: KeyboardInterrupt, so that the run ends."""
        if self._came:
            raise KeyboardInterrupt
        sys.stderr.write(f"lanelib: {one_line(text, text)}\n")
        sys.stderr.flush()


@contextmanager
def json_lines(path: Path | None, *, sources: Iterable[Path] = ()):
    """A function that writes a row; the file has its name only when the block ends ("-": stdout, None: nowhere).

    Where the block ends with an exception, a file that was there before stays as it was; the rows so far are kept
    beside it as `NAME.partial.jsonl`, and a note on the exception (`add_note`) says so.
    """
    if path is None:
        yield lambda row: None
        return
    if str(path) == "-":

        def say(row: dict) -> None:
            with _says_where("stdout"):
                write_row(sys.stdout, row)

        yield say
        return
    check_place(path, sources=sources)
    special = is_special(path)
    if not special:
        remove_abandoned(path)
    part = path if special else part_of(path)
    with _says_where(path):
        file = part.open("w", encoding="utf-8", newline="\n")

    def write(row: dict) -> None:
        with _says_where(path):
            write_row(file, row)

    try:
        yield write
        with _says_where(path):
            file.close()
            if not special:
                os.replace(part, path)
    except BaseException as error:
        with suppress(OSError):
            file.close()
        if not special and (kept := _keep_rows(part, path)):
            error.add_note(f"the rows so far are in {kept}")
        raise
    finally:
        with suppress(OSError):
            file.close()
        with suppress(OSError):  # on Windows somebody may have it open
            if not special:
                part.unlink(missing_ok=True)


def _keep_rows(part: Path, path: Path) -> Path | None:
    """Give the whole rows of an unfinished file a name that is seen; None where there are none, or it cannot be."""
    kept = path.with_name(f"{path.stem}.partial{path.suffix}")
    with suppress(OSError):
        with part.open("rb+") as file:
            if not file.truncate(file.read().rfind(b"\n") + 1):  # a full disk may have cut the last one
                return None
        os.replace(part, kept)
        return kept
    return None


@contextmanager
def _says_where(path: Path | str):
    """An error of the system while `path` is written, as one line; a reader who has gone ends all."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise LanelibError(f"{path}: needed a place for the results, found: {error.strerror}; choose another") from None


def write_row(file: IO[str], row: dict) -> None:
    """A row as one line of JSON."""
    file.write(json.dumps(row, allow_nan=False) + "\n")


def check_place(path: Path, *, sources: Iterable[Path] = ()) -> None:
    """LanelibError, before any work is done, where `path` cannot be written or is one of the files that are read."""
    if path.is_dir():
        raise LanelibError(f"{path}: needed the name of a file to write, found a folder; name a file in it")
    if is_special(path):
        return
    if not path.parent.is_dir():
        raise LanelibError(f"{path}: needed an existing folder for the output, found none; make {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise LanelibError(
            f"{path}: needed a folder with write permission, found none on {path.parent}; choose another"
        )
    refuse_same(path, identities(sources))


def identities(paths: Iterable[Path]) -> set[tuple[int, int]]:
    """What the system knows the files by that are there: the same for every link to one."""
    found = set()
    for path in paths:
        with suppress(OSError, ValueError):  # not there, or no name at all: said when its turn comes
            status = os.stat(path)
            found.add((status.st_dev, status.st_ino))
    return found


def refuse_same(out: Path, sources: Collection[tuple[int, int]]) -> None:
    """LanelibError where `out` is one of the files that are read, given by their `identities`."""
    if not identities([out]).isdisjoint(sources):
        raise LanelibError(
            f"{out}: needed another file for the output than for the input, found the same; choose another -o"
        )


def make_folder(folder: Path) -> None:
    """Make the folder with those above it; LanelibError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LanelibError(
            f"{folder}: needed a folder for the output, found: {error.strerror}; choose another -o"
        ) from None


def _folder_for(path: Path, given: Path | None, kind: str) -> Path:
    """Where results of `path` go: -o, else the output folder of its data set, else OUTPUT."""
    if given is not None:
        return given
    found = rigs.set_of(path)
    return getattr(found, kind) if found else Path(OUTPUT)


def picture_output(path: Path, given: Path | None, *, alone: bool) -> Path:
    """Name of a picture's overlay: in the folder `given` or the usual one; `given` itself for a picture `alone`."""
    if given is not None and alone and given.suffix.lower() in PICTURE_SUFFIXES and not given.is_dir():
        return given
    return _folder_for(path, given, "output_images") / f"{path.stem}.jpg"


def video_output(path: Path, given: Path | None) -> Path:
    """Name of the result of a video: `given`, or in the folder `given` or the usual one."""
    if given is not None and given.suffix.lower() in datasets.VIDEO_SUFFIXES and not given.is_dir():
        return given
    return _folder_for(path, given, "output_videos") / f"{path.stem}.mp4"


def taken_names(json: Path | None) -> set[str]:
    """For `free_name`: what a run writes beside its pictures or videos."""
    return set() if json is None else {str(json).casefold()}


def free_name(path: Path, taken: set[str]) -> Path:
    """`path`, or NAME-2, NAME-3 … where this run has written that name already.

    `A.jpg` and `a.jpg` count as one name, as on macOS and Windows; `taken` holds the names in small letters.
    """
    free = next(name for name in numbered(path) if str(name).casefold() not in taken)
    taken.add(str(free).casefold())
    return free


def refuse_other_kind(given: Path | None) -> None:
    """LanelibError where -o names a picture of a kind that is not written; else it would become a folder's name."""
    if given is not None and given.suffix.lower() in OTHER_PICTURES and not given.is_dir():
        raise LanelibError(
            f"{given}: needed a folder, or a name that ends in .jpg or .png, found {given.suffix}; choose another -o"
        )


def refuse_one_name(given: Path | None, paths: list[Path], suffixes: Iterable[str], what: str) -> None:
    """LanelibError where -o names a single picture or video, and there are several (`what`) to write."""
    if len(paths) > 1 and given is not None and given.suffix.lower() in suffixes and not given.is_dir():
        raise LanelibError(f"{given}: needed a folder as output of {len(paths)} {what}, found the name of one")


def raw_names(paths: list[Path]) -> list[str]:
    """`raw_file` of each picture or video: the file's name, or the path as given where several have that name."""
    count = Counter(path.name for path in paths)
    return [path.as_posix() if count[path.name] > 1 else path.name for path in paths]


def with_folders(paths: Iterable[Path]) -> Iterator[Path]:
    """Files as they are, folders as the pictures in them in natural order; a folder without any as it is."""
    for path in paths:
        inside = pictures_in(path) if os.path.isdir(path) else []  # of a name too long, Path.is_dir raises
        yield from inside or [path]
