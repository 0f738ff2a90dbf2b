"""Plain files in and out: a good one is never half written, a pipe is never waited for.

What is written has a name of its own until it is whole (`parts`).
"""

import errno
import os
from contextlib import suppress
from pathlib import Path

from lanelib.errors import LanelibError
from lanelib.names import natural_key
from lanelib.parts import is_special, prefix_of, remove_abandoned


def write_bytes(path, data: bytes) -> Path:
    """Write a file under a temporary name in the same folder, then rename it: a killed run leaves the old file or none.

    Into a device or pipe the bytes are written as they are.

    Raises
    ------
    LanelibError : the place cannot be written
    """
    path = Path(path)
    temporary = None
    try:
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder")
        if is_special(path):
            path.write_bytes(data)
            return path
        remove_abandoned(path)
        # chosen before it exists: whatever comes in between, Ctrl-C too, can take it away
        temporary = path.with_name(f"{prefix_of(path)}{os.urandom(4).hex()}.part")
        with open(temporary, "xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None:
            with suppress(OSError, ValueError):
                os.unlink(temporary)
        if not isinstance(error, OSError | ValueError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise LanelibError(f"{path}: need a place that can be written, found: {reason}; choose another") from None
    return path


def read_text(path, *, max_bytes: int = 1 << 24) -> str:
    """The text (UTF-8, with the mark in front that Windows' editors put or without) of an ordinary file of at most
    `max_bytes` (16 MB: the largest calibration has 100 kB).

    A pipe would be waited for and /dev/zero read for ever. Raises OSError, whose strerror says what is wrong, or
    UnicodeDecodeError.
    """
    status = os.stat(path)
    if is_special(path):
        raise OSError(errno.EINVAL, "a device or pipe, which is no file", str(path))
    if status.st_size > max_bytes:
        raise OSError(errno.EFBIG, f"a file of {status.st_size / 1e6:.0f} MB, too large for this", str(path))
    return Path(path).read_text(encoding="utf-8-sig")


def files_in(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """The files of a folder with one of these suffixes in natural order, without hidden ones (macOS puts one beside
    each, `._a.jpg`); none where there is no folder."""
    if not folder.is_dir():
        return []
    found = (p for p in folder.iterdir() if p.suffix.lower() in suffixes and p.is_file() and p.name[0] != ".")
    return sorted(found, key=lambda path: natural_key(path.name))
