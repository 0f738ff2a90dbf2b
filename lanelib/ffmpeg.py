"""What ffmpeg says about a video file: `probe`, and the few things every ffmpeg process here has in common.

The ffmpeg program is the one that comes with the package imageio-ffmpeg. It is given absolute `file:` names, so that
no name can be taken for an option or a network address, and a list of containers it may open, so that a text file or a
playlist that points elsewhere is refused instead of being played.
"""

import contextlib
import math
import os
import re
import subprocess
import sys
import threading
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import IO

import imageio_ffmpeg

from lanelib.errors import LanelibError

# 8K is 33 megapixels; a larger frame is a damaged header or a decompression bomb. One BGR frame is then at most 192 MB.
MAX_MEGAPIXELS = 64
# Containers of cameras, phones and editors, and the common sound files (so that the answer can be "only sound").
CONTAINERS = ("mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,ogg,asf,flv,mxf,dv,h264,hevc,m4v,mjpeg,"
              "nut,wav,mp3,aac,flac")
# Outputs, and the sound that players understand inside each; anything else is encoded to AAC.
COPIED_AUDIO = {
    ".mp4": frozenset({"aac", "mp3", "opus", "ac3", "eac3", "alac", "flac"}),
    ".m4v": frozenset({"aac", "alac", "ac3"}),
    ".mov": frozenset({"aac", "alac", "ac3", "mp3"}),
}
# Containers with an index, in which a time is found exactly; others are read from their start.
INDEXED = ("mov,mp4", "matroska", "avi")
# The YUV matrices that cameras use.
COLOR_MATRICES = frozenset({"bt709", "smpte170m", "bt470bg", "bt2020nc", "smpte240m", "fcc"})
# Reading the header of a healthy local file takes well under a second; all packets of a long one can take minutes.
PROBE_TIMEOUT_S, PACKETS_TIMEOUT_S = 60.0, 1800.0

PIXEL_FORMATS = ("bgr24", "yuv420p", "nv12")
PIPE_BYTES = 1 << 20
MAX_MESSAGES = 20  # of ffmpeg's, kept for the report

# Ctrl-C in a terminal reaches only Python, which then ends its children in order: they have a session of their own, on
# Windows a console that nobody sees (without a flag, one would flash up beside a notebook).
POPEN_OPTIONS = {"start_new_session": True}
if sys.platform == "win32":
    POPEN_OPTIONS = {"creationflags": subprocess.CREATE_NO_WINDOW}


@dataclass(frozen=True)
class VideoInfo:
    """What a file says about itself: `size_wh` as displayed (upright, with square pixels), times in seconds.

    `n_frames` is duration times frame rate, an estimate good to a frame or two, unless `n_frames_exact`; 0 when the
    file does not say. `rotation_deg` is the counter-clockwise turn that the file asks players for (reading does it).
    `color_matrix` is "bt709", "smpte170m" … or None when the file leaves it open.
    """

    path: Path
    size_wh: tuple[int, int]
    fps: float
    n_frames: int
    n_frames_exact: bool
    duration_s: float
    rotation_deg: int
    codec: str
    container: str = ""
    audio_codec: str | None = None
    color_matrix: str | None = None

    @property
    def has_audio(self) -> bool:
        """Whether there is a sound track."""
        return self.audio_codec is not None

    def __str__(self) -> str:
        about = "" if self.n_frames_exact else "about "
        return (f"{self.path.name}: {self.size_wh[0]}x{self.size_wh[1]}, {self.codec}, {self.fps:.5g} frames/s, "
                f"{self.duration_s:.2f} s, {about}{self.n_frames} frames{', sound' if self.has_audio else ''}")


def probe(path: str | Path, *, exact: bool = False) -> VideoInfo:
    """Read what a video file says about itself, without decoding it.

    With `exact` every packet is read (not decoded), so that the number of frames is counted and the mean frame rate
    measured. Raises LanelibError: missing, directory, empty, not a video, sound only, frames above MAX_MEGAPIXELS.
    """
    path = checked_file(path)
    about = path.stat()
    info = _probed(path, about.st_ino, about.st_size, about.st_mtime_ns)
    if not exact:
        return info
    times = packet_times(path)
    if not times:
        raise LanelibError(f"{path}: needed a video, found one without a single frame; record or download it again")
    fps = (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else info.fps
    fps = info.fps if abs(fps - info.fps) < 0.01 * info.fps else fps
    return replace(info, fps=fps, n_frames=len(times), n_frames_exact=True)


@lru_cache(maxsize=64)
def _probed(path: Path, *_version: int) -> VideoInfo:
    """What the file says, asked once for each version of it: reader, writer and whoever calls them all want to know."""
    return _parse(path, _run("-i", file_url(path))[1])


def packet_times(path: Path, *, end_s: float | None = None) -> list[float]:
    """The presentation times in seconds of the video packets (one packet, one frame), ascending; up to `end_s`."""
    return sorted(begin_s for begin_s, _ in _packets(path, end_s))


def packets_end_s(path: Path) -> float:
    """When the last frame ends, in seconds from the file's start; 0 without frames."""
    return max((end_s for _, end_s in _packets(path)), default=0.0)


def _packets(path: Path, end_s: float | None = None) -> list[tuple[float, float]]:
    """From when to when each video packet's frame is shown, seconds, in the order of the file; up to `end_s`."""
    # 2 s more: packets are stored in decoding order, in which a frame can stand after later ones.
    limit = [] if end_s is None else ["-t", f"{end_s + 2:.6f}"]
    out, said = _run(*limit, "-i", file_url(path), "-map", "0:V:0", "-c", "copy", "-copyts", "-start_at_zero",
                     "-f", "framecrc", "pipe:1", timeout_s=PACKETS_TIMEOUT_S)
    base = re.search(r"^#tb 0: (\d+)/(\d+)", out, re.MULTILINE)
    if base is None:
        raise LanelibError(f"{path}: cannot read its packets: {reason(said)}")
    tick_s = Fraction(int(base[1]), int(base[2]))
    rows = (row.split(",") for row in out.splitlines() if row and row[0] != "#")
    return [(float(int(row[2]) * tick_s), float((int(row[2]) + int(row[3])) * tick_s)) for row in rows]


def checked_file(path: str | Path) -> Path:
    """The path, if it is a readable regular file that is not empty; else LanelibError."""
    path = Path(path)
    if not path.exists():
        raise LanelibError(f"{path}: needed a video file, found nothing there; check the name")
    if path.is_dir():
        raise LanelibError(f"{path}: needed a video file, found a directory; name a file in it")
    if not path.is_file():
        raise LanelibError(f"{path}: needed a video file, found a device or pipe; save it to a file first")
    if not os.access(path, os.R_OK):
        raise LanelibError(f"{path}: needed a readable video file, found one without read permission; change it")
    if path.stat().st_size == 0:
        raise LanelibError(f"{path}: needed a video file, found an empty one; copy or download it again")
    return path


def file_url(path: str | Path) -> str:
    """The name as ffmpeg takes it literally, whatever it begins with."""
    return "file:" + os.path.abspath(path)


def input_options() -> list[str]:
    """Options in front of every `-i` of a file: allowed containers and protocols, largest frame."""
    return ["-protocol_whitelist", "file", "-format_whitelist", CONTAINERS, "-max_pixels", str(MAX_MEGAPIXELS * 10**6)]


def ffmpeg_exe() -> str:
    """The path of ffmpeg; LanelibError when imageio-ffmpeg has none for this machine."""
    try:
        return imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise LanelibError(f"needed the ffmpeg program of imageio-ffmpeg, found none ({error}); "
                           "set IMAGEIO_FFMPEG_EXE to an ffmpeg with libx264") from None


def exact_rate(fps: float) -> Fraction:
    """The rate behind a rounded figure: 29.97 is 30000/1001, 25 is 25, 12.5 is 25/2."""
    for nominal in (24, 30, 48, 60, 120, 240):
        if abs(fps - nominal * 1000 / 1001) < 0.0051:  # ffmpeg prints two decimals
            return Fraction(nominal * 1000, 1001)
    return Fraction(fps).limit_denominator(1000)


def plain(line: str) -> str:
    """A line of ffmpeg's from its message on, without prefixes as in `[h264 @ 0x55…] [error]`."""
    return re.sub(r"^(\[[^\]]*\] ?)+", "", re.sub(r"^.*\[error\] ", "", line.strip()))


def reason(said: str) -> str:
    """The first error that ffmpeg reported, in one line."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if "[error]" in line or "[fatal]" in line] or lines[-1:]
    return (plain(errors[0]) if errors else "") or "no reason given"


def widen_pipe(pipe: IO[bytes]) -> None:
    """A pipe of 1 MiB (Linux; 64 KiB otherwise) lets ffmpeg and Python switch less often."""
    with contextlib.suppress(ImportError, AttributeError, OSError):  # not Linux, or above the user's limit
        import fcntl

        fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def end_process(process: "subprocess.Popen[bytes]", log_thread: threading.Thread, part: Path | None = None) -> None:
    """Leave no process, thread, pipe or half-written file behind."""
    if process.poll() is None:
        process.kill()
    process.wait()
    log_thread.join()  # it reads to the end of stderr and closes it
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    if part is not None:
        with contextlib.suppress(OSError):  # on Windows somebody may have it open; the next run takes it away
            part.unlink(missing_ok=True)


def _run(*arguments: str, timeout_s: float = PROBE_TIMEOUT_S) -> tuple[str, str]:
    """Run ffmpeg on a file to the end; its standard output and what it said."""
    split = arguments.index("-i")
    command = [ffmpeg_exe(), "-hide_banner", "-nostdin", "-nostats", "-loglevel", "level+info", *arguments[:split],
               *input_options(), *arguments[split:]]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False,
                              timeout=timeout_s, **POPEN_OPTIONS)
    except subprocess.TimeoutExpired:
        name = arguments[split + 1].removeprefix("file:")
        raise LanelibError(f"{name}: needed a file that can be read, ffmpeg did not finish in {timeout_s:.0f} s; "
                           "copy it to a local disk") from None
    return done.stdout.decode("utf-8", "replace"), done.stderr.decode("utf-8", "replace")


def displayed(width: int, height: int, text: str) -> tuple[int, int]:
    """The size at which a stored picture is shown: where its pixels are not square, the shorter of their sides is
    drawn out. `text`: ffmpeg's description of the stream."""
    aspect = re.search(r"SAR (\d+):(\d+)", text)
    ratio = int(aspect[1]) / int(aspect[2]) if aspect and int(aspect[1]) and int(aspect[2]) else 1.0
    if ratio > 1:
        return 2 * round(width * ratio / 2), height
    return width, 2 * round(height / ratio / 2) if ratio < 1 else height


def _parse(path: Path, said: str) -> VideoInfo:
    """VideoInfo from ffmpeg's description of its input."""
    streams = re.findall(r"Stream #0:\S+?: (Video|Audio): (.*)", said)
    videos = [text for kind, text in streams if kind == "Video" and "attached pic" not in text]
    audios = [text for kind, text in streams if kind == "Audio"]
    if not streams and "Input #0" in said:
        raise LanelibError(f"{path}: needed a video, found a file without a single frame; record or download it again")
    if not streams:
        cut = "moov atom not found" in said
        why = "its index is missing: cut off, or never finished" if cut else reason(said).rpartition("input: ")[2]
        raise LanelibError(f"{path}: needed a video file, found something else ({why}); copy or record it again")
    if not videos:
        raise LanelibError(f"{path}: needed a video with pictures, found only sound; choose another file")
    text = videos[0]
    size = re.search(r", (\d+)x(\d+)[, ]?", text + ",")
    if size is None and (huge := re.search(r"Picture size (\d+x\d+) (?:is invalid|exceeds)", said)):
        raise LanelibError(f"{path}: needed frames of at most {MAX_MEGAPIXELS} megapixels, found {huge[1]}; "
                           "scale the video down first")
    if size is None or min(int(size[1]), int(size[2])) == 0:
        raise LanelibError(f"{path}: needed a video, found a video stream without a frame ({plain(text)[:60]}); "
                           "record or download it again")
    width, height = displayed(int(size[1]), int(size[2]), text)
    if width * height > MAX_MEGAPIXELS * 10**6:
        raise LanelibError(f"{path}: needed frames of at most {MAX_MEGAPIXELS} megapixels, "
                           f"found {width}x{height}; scale the video down first")
    turn = re.search(r"(?i)display ?matrix: rotation of (-?[\d.]+) degrees", said)
    rotation = round(float(turn[1])) % 360 if turn else 0
    rates = re.search(r"([\d.]+)(k?) fps", text) or re.search(r"([\d.]+)(k?) tbr", text)
    fps = float(exact_rate(float(rates[1]) * (1000 if rates[2] else 1))) if rates else 0.0
    span = re.search(r"Duration: (\d+):(\d+):([\d.]+)", said)
    duration = int(span[1]) * 3600 + int(span[2]) * 60 + float(span[3]) if span else 0.0
    color = re.search(r", \w+\(([^)]*)\), \d+x", text)  # as in "yuv420p(tv, bt709, progressive)"
    named = [word.split("/")[0] for word in color[1].split(", ")] if color else []
    matrix = next((word for word in named if word in COLOR_MATRICES), None)
    return VideoInfo(
        path=path, size_wh=(height, width) if rotation in (90, 270) else (width, height),
        fps=fps if fps > 0 else 25.0, n_frames=math.floor(duration * fps + 0.5), n_frames_exact=False,
        duration_s=duration, rotation_deg=rotation, codec=text.split()[0].rstrip(","),
        container=container[1] if (container := re.search(r"Input #0, (\S+), from", said)) else "",
        audio_codec=audios[0].split()[0].rstrip(",") if audios else None, color_matrix=matrix)
