"""Files from outside: a download that resumes, an archive that stays in its folder, a hash before a name.

What arrives is written to `NAME.part` beside its place; `accept` gives it its name if its SHA-256 is the one that
was expected. So whatever happens, and whenever, no wrong or half file stands under its final name.
"""

import contextlib
import os
import shutil
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import BinaryIO

import pooch

from lanelib.errors import LanelibError

# Seconds without an answer or a byte before a server counts as out of reach.
SILENCE_S = 20
# The largest clip of the public set has 26 MB; a member that claims more is not unpacked, a file that has more is not
# downloaded (a server may send for ever, and packed zeros unpack to a thousand times their size).
MAX_MEMBER_BYTES = 64_000_000


def kept_part(final: Path) -> Path:
    """Where a download is written before it gets its name; one that broke off stays there, to be gone on with."""
    return final.with_name(final.name + ".part")


def file_hash(path: Path) -> str:
    """SHA-256 of a file in hexadecimal."""
    return pooch.file_hash(str(path), alg="sha256")


def check(path: Path, sha256: str, *, what: str, source: str) -> None:
    """Remove the file and raise LanelibError if its SHA-256 is not the expected one."""
    if (found := file_hash(path)) != sha256:
        path.unlink()
        raise LanelibError(
            f"{what} from {source}: SHA-256 {sha256} was expected, {found} was found; the file was thrown away:"
            " try again, and if it stays so the source has changed"
        )


def accept(part: Path, final: Path, sha256: str, *, what: str, source: str) -> int:
    """Give a file that is the right one its final name; its size in bytes. Else as `check`."""
    check(part, sha256, what=what, source=source)
    with _writing(final):
        os.replace(part, final)
        return final.stat().st_size


def download(url: str, part: Path, *, source: str, silence_s: float = SILENCE_S) -> None:
    """Download `url` to `part`; where `part` exists, go on from its end.

    Raises LanelibError naming the address and the reason, also for more than MAX_MEMBER_BYTES. After a break in the
    middle `part` holds what had arrived; where the server answered with an error, or nothing arrived, there is no
    `part` afterwards.
    """
    with _writing(part):
        start = part.stat().st_size if part.exists() else 0
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
        get = pooch.HTTPDownloader(chunk_size=1 << 16, timeout=silence_s, headers=headers)
        try:
            with open(part, "ab") as out:
                get(url, _Bounded(out), None)
        except _TooLargeError:
            part.unlink()
            raise LanelibError(f"{source}: {url} is refused: it has more than {MAX_MEMBER_BYTES} bytes") from None
        except OSError as error:  # all errors of requests are OSErrors; only the system's own have a number
            if error.errno is not None:
                raise
            answer = getattr(error, "response", None)
            if answer is not None or not part.stat().st_size:
                part.unlink()
            why = f"no answer ({type(error).__name__}), check the network"
            if answer is not None:  # it has no such file, or cannot go on from `start`
                why = f"the server answered {answer.status_code}"
            raise LanelibError(f"{source}: {url} could not be downloaded: {why}") from None


class _TooLargeError(Exception):
    """More came than any file of the set has."""


class _Bounded:
    """An open file, at its end, that takes MAX_MEMBER_BYTES at most."""

    def __init__(self, file: BinaryIO):
        self._file = file

    def write(self, data: bytes) -> int:
        if self._file.tell() + len(data) > MAX_MEMBER_BYTES:
            raise _TooLargeError
        return self._file.write(data)

    def flush(self) -> None:
        self._file.flush()


def unpack(archive: Path, places: Mapping[str, Path]) -> Iterator[tuple[str, Path]]:
    """Write the members of a zip file that are named in `places` to their place, one after the other.

    Nothing else is written, so no member can choose where it lands; an archive with a member that points outside
    its folder is refused all the same, as is a member above MAX_MEMBER_BYTES. Members that are not there are
    passed over. Raises LanelibError.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = {info.filename: info for info in opened.infolist()}
            if outside := [name for name in members if _points_outside(name)]:
                raise LanelibError(f"{archive.name} is refused: its member {outside[0]!r} points outside its folder")
            for name in (name for name in places if name in members):
                if (size := members[name].file_size) > MAX_MEMBER_BYTES:
                    limit = f"{size} bytes, at most {MAX_MEMBER_BYTES} are unpacked"
                    raise LanelibError(f"{archive.name} is refused: its member {name} has {limit}")
                with _writing(places[name]), opened.open(name) as packed, open(places[name], "wb") as out:
                    shutil.copyfileobj(packed, out)
                yield name, places[name]
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise LanelibError(f"{archive.name} cannot be unpacked: {error}; try again") from None


def _points_outside(name: str) -> bool:
    """Whether an archive's member would leave the folder it is unpacked in, on any system."""
    return "\\" in name or name[1:2] == ":" or name.startswith("/") or ".." in PurePosixPath(name).parts


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Make the folder of `path`; say in one line why it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except LanelibError:
        raise
    except OSError as error:
        why = error.strerror or error
        raise LanelibError(f"{path} cannot be written: {why}; make room or check the rights") from None
