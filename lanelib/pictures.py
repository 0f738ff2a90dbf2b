"""Read and write single pictures, and list those of a folder: a bad file is one clear line.

OpenCV's own reader returns None without a reason, decodes what is left of a truncated JPEG, trusts any size the
header states, and lets libjpeg print on the terminal. Here the bytes are checked before they are decoded.
"""

import os
import re
import struct
import tempfile
import threading
import zlib
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np

from lanelib.errors import LanelibError
from lanelib.files import files_in, write_bytes

MAX_MEGAPIXELS = 120.0  # above any camera a car carries (8K is 33) and common phones (108); 360 MB once decoded
MAX_FILE_BYTES = 1 << 29  # 512 MB: an uncompressed picture of the largest size, with room to spare
PICTURE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png")  # of what can be read and written here
JPEG_START, PNG_START, BMP_START = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"BM"
# An entropy-coded JPEG scan ends at the first 0xFF that is neither stuffed (FF00), a restart (FFD0-D7) nor fill (FFFF).
JPEG_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
# What libjpeg (jerror.h), libpng and OpenCV say on standard error while they decode
DECODER_WORDS = re.compile(
    rb"Corrupt JPEG data|Premature end of JPEG|Invalid SOS parameters|Inconsistent progression|Unknown Adobe color"
    rb"|Warning: unknown JFIF|Application transferred|libpng (warning|error)|\[ ?(WARN|ERROR|INFO):"
)
_stderr_lock = threading.Lock()


def read_image(path, *, max_megapixels: float = MAX_MEGAPIXELS) -> np.ndarray:
    """Read a JPEG, PNG or BMP file.

    Grey, palette, four-channel and 16-bit pictures are converted (alpha is dropped, 16 bits become the upper 8); the
    orientation a phone noted in the file is applied.

    Parameters
    ----------
    path : str or Path
    max_megapixels : larger pictures are refused by the size in their header, before anything is decoded

    Returns
    -------
    frame_bgr : ndarray of shape (H, W, 3), uint8, BGR

    Raises
    ------
    LanelibError : missing, not a file, unreadable, empty, not a picture, truncated, damaged or too large
    """
    data = _read_bytes(Path(path))
    (width, height), fault = _inspect(data, path)
    if width * height > max_megapixels * 1e6:
        raise LanelibError(
            f"{path}: need a picture of at most {max_megapixels:g} megapixels, found {width}x{height} "
            f"({width * height / 1e6:.0f} megapixels); make it smaller"
        )
    if fault:
        raise LanelibError(f"{path}: need a whole picture, {fault}; copy or save it again")
    try:
        with _native_stderr() as said:
            frame_bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        frame_bgr = None
    if frame_bgr is None or frame_bgr.size == 0:
        raise LanelibError(f"{path}: need a picture, found a damaged one that cannot be decoded; save it again")
    if "Corrupt JPEG data" in said[0] or "Premature end" in said[0]:
        raise LanelibError(f"{path}: need a whole picture, found damaged JPEG data; copy or save it again")
    return frame_bgr


def write_image(path, image: np.ndarray, *, jpeg_quality: int = 92) -> Path:
    """Write a picture, completely or not at all; the suffix (.png, .jpg, .jpeg or .bmp) chooses the format.

    Parameters
    ----------
    path : str or Path, in a folder that exists
    image : ndarray of shape (H, W), (H, W, 3) BGR or (H, W, 4) BGRA, uint8
    jpeg_quality : 92: no visible blocks on lane edges, two thirds of the size of 98

    Raises
    ------
    LanelibError : not a uint8 picture, unknown suffix, or the place cannot be written
    """
    path = Path(path)
    image = np.asarray(image)
    channels = image.shape[2:] or (1,)
    if image.dtype != np.uint8 or image.size == 0 or image.ndim < 2 or channels not in ((1,), (3,), (4,)):
        raise LanelibError(f"{path}: need a uint8 picture of 1, 3 or 4 channels, found {image.dtype} {image.shape}")
    suffix = path.suffix.lower()
    if suffix not in PICTURE_SUFFIXES:
        raise LanelibError(f"{path}: need a name ending in .png, .jpg or .bmp, found {suffix or 'no suffix'!r}")
    options = [cv2.IMWRITE_JPEG_QUALITY, int(jpeg_quality)] if suffix in (".jpg", ".jpeg") else []
    try:
        done, data = cv2.imencode(suffix, image, options)
    except cv2.error:
        done = False
    if not done:
        raise LanelibError(f"{path}: need a size {suffix} can hold, found {image.shape[1]}x{image.shape[0]}; use .png")
    return write_bytes(path, data.tobytes())


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder, as `files_in`."""
    return files_in(folder, PICTURE_SUFFIXES)


def _read_bytes(path: Path) -> bytes:
    try:
        if not path.exists():
            raise LanelibError(f"{path}: need a picture, found no such file; check the name")
        if not path.is_file():
            folder = path.is_dir()
            what, which = ("a folder", " in it") if folder else ("something that is not a file", "")
            raise LanelibError(f"{path}: need a picture, found {what}; name JPEG, PNG or BMP files{which}")
        n_bytes = path.stat().st_size
        if n_bytes > MAX_FILE_BYTES:
            raise LanelibError(f"{path}: need a picture of at most {MAX_FILE_BYTES >> 20} MB, found {n_bytes >> 20} MB")
        data = path.read_bytes()
    except LanelibError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise LanelibError(f"{path}: need a picture, found a file that cannot be read: {reason}") from None
    if not data:
        raise LanelibError(f"{path}: need a picture, found an empty file; copy it again")
    return data


def _inspect(data: bytes, path) -> tuple[tuple[int, int], str]:
    """Size (width, height) from the header, and what is wrong with the rest ('' if nothing)."""
    try:
        if data.startswith(JPEG_START):
            return _inspect_jpeg(data)
        if data.startswith(PNG_START):
            return _inspect_png(data)
        if data.startswith(BMP_START) and len(data) > 26:
            width, height = struct.unpack_from("<ii", data, 18)
            n_bytes = struct.unpack_from("<I", data, 2)[0]
            return (abs(width), abs(height)), "found a truncated BMP" if n_bytes > len(data) else ""
    except struct.error:
        raise LanelibError(f"{path}: need a whole picture, found one truncated in its header; copy it again") from None
    raise LanelibError(f"{path}: need a JPEG, PNG or BMP picture, found something else; convert it") from None


def _inspect_jpeg(data: bytes) -> tuple[tuple[int, int], str]:
    """Walk the segments (ITU-T T.81, annex B): the size is in the frame header, the end is marker FFD9."""
    at, size_wh = 2, None
    while at < len(data):
        marker = JPEG_MARKER.search(data, at)
        if marker is None:
            break
        code, at = data[marker.start() + 1], marker.end()
        if code == 0xD9 and size_wh:
            return size_wh, ""
        if 0xC0 <= code <= 0xCF and code not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 3)
            size_wh = (width, height)
        at += struct.unpack_from(">H", data, at)[0] if at + 2 <= len(data) else len(data)
    if size_wh is None:
        raise struct.error("no frame header")
    return size_wh, "found a truncated JPEG (its end marker is missing)"


def _inspect_png(data: bytes) -> tuple[tuple[int, int], str]:
    """Walk the chunks (PNG specification, section 5): length, type, data, CRC, up to IEND."""
    size_wh = struct.unpack_from(">II", data, 16)
    at = len(PNG_START)
    while at + 12 <= len(data):
        n_bytes, kind = struct.unpack_from(">I4s", data, at)
        body_end = at + 8 + n_bytes
        if body_end + 4 > len(data):
            break
        if zlib.crc32(data[at + 4 : body_end]) != struct.unpack_from(">I", data, body_end)[0]:
            name = kind.decode() if kind.isalpha() else "unnamed"  # a damaged name may hold anything
            return size_wh, f"found a damaged PNG (checksum of its {name} part)"
        if kind == b"IEND":
            return size_wh, ""
        at = body_end + 4
    return size_wh, "found a truncated PNG (its end is missing)"


@contextmanager
def _native_stderr():
    """Catch what C libraries print to file descriptor 2; yields a list whose one text is complete afterwards.

    libjpeg reports damaged data only there. The descriptor is shared by all threads, hence the lock; what others print
    meanwhile is handed on.
    """
    said = [""]
    with _stderr_lock:
        try:
            keep = os.dup(2)
        except OSError:  # no standard error at all
            yield said
            return
        with tempfile.TemporaryFile() as caught:
            os.dup2(caught.fileno(), 2)
            try:
                yield said
            finally:
                os.dup2(keep, 2)
                os.close(keep)
                caught.seek(0)
                lines = caught.read().splitlines(keepends=True)
                ours = [line for line in lines if DECODER_WORDS.match(line)]
                said[0] = b"".join(ours).decode("utf-8", "replace")
                with suppress(OSError):  # nobody may be left who reads it
                    if len(lines) > len(ours):
                        os.write(2, b"".join(line for line in lines if not DECODER_WORDS.match(line)))
