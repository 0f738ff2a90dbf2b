"""Unfinished files: a file being written has a hidden name of its own, and gets its final name only when it is whole.

The hidden name holds the number of the process that writes. So two runs never write into each other's file, and what a
killed run has left behind can be told from what another one is writing: the next run that writes the same file takes
it away.
"""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path

NAME_BYTES = 200  # of the final name at most: with dot, number and ending it stays below the 255 that systems allow


def part_of(final: Path, *, suffix: str = ".part") -> Path:
    """Where this process writes what will be `final`: `.NAME.PID.part`, in the same folder."""
    return final.with_name(f"{prefix_of(final)}{suffix.removeprefix('.')}")


def prefix_of(final: Path) -> str:
    """How the names of this process's unfinished files for `final` begin."""
    return f".{_short(final)}.{os.getpid()}."


def is_special(path: Path) -> bool:
    """Whether a device or pipe stands there (/dev/null, a named pipe): it is written into, never replaced by a file."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # nothing there, or no name at all
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def numbered(path: Path) -> Iterator[Path]:
    """`path`, NAME-2, NAME-3 … without end."""
    yield path
    yield from (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in count(2))


def set_aside(part: Path, final: Path) -> Path:
    """Name the finished `part` NAME-2, NAME-3 … beside `final`, whose name it could not have; returns where it is now.

    Where even that cannot be, it stays where it was.
    """
    try:
        return part.rename(next(name for name in numbered(final) if not name.exists()))
    except OSError:
        return part


def remove_abandoned(final: Path) -> None:
    """Remove unfinished files for `final` whose process is no more (it was killed, or the power went).

    Only names that `part_of` gives, or `prefix_of` begins, and only where the whole final name is in them.
    Never raises: what cannot be removed stays.
    """
    name = _short(final)
    if name != final.name:  # cut off: it may stand for another file, too
        return
    own = re.compile(re.escape(f".{name}.") + r"(\d+)\.([a-z0-9_]{8}\.)?part(\.\w+)?")
    with suppress(OSError):
        for entry in os.scandir(final.parent):
            if (match := own.fullmatch(entry.name)) and not _is_running(int(match[1])):
                with suppress(OSError):
                    os.unlink(entry.path)


def _short(final: Path) -> str:
    return os.fsencode(final.name)[:NAME_BYTES].decode("utf-8", "ignore")


def _is_running(process: int) -> bool:
    """Whether there is a process of this number; on Windows a file that somebody writes cannot be removed anyway."""
    if os.name == "nt":
        return False
    try:
        os.kill(process, 0)  # signal 0 only asks
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
