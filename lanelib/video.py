"""Frames out of a video file and into one, one at a time: `read_frames` and `VideoWriter`.

ffmpeg decodes and encodes in its own process; raw frames pass through a pipe, so memory does not depend on the length.
Every frame carries its own time: read from ffmpeg's `showinfo` filter, written in the framing of Matroska. Nothing is
duplicated or dropped to reach a constant rate.

The cheapest pixel format is "yuv420p", in which practically every video is stored: no colour conversion either way. A
frame is then one array of H*3/2 rows: H rows of luma Y, then the quarter-size U and V planes, as OpenCV's
COLOR_YUV2BGR_I420 takes it ("nv12": U and V interleaved, COLOR_YUV2BGR_NV12).
"""

import contextlib
import io
import math
import queue
import re
import subprocess
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lanelib.channels import yuv420_planes
from lanelib.errors import LanelibError
from lanelib.ffmpeg import (
    INDEXED,
    MAX_MESSAGES,
    PIXEL_FORMATS,
    POPEN_OPTIONS,
    VideoInfo,
    end_process,
    ffmpeg_exe,
    file_url,
    input_options,
    packet_times,
    packets_end_s,
    plain,
    probe,
    widen_pipe,
)
from lanelib.video_writer import VideoWriter, checked_output

__all__ = ["Damage", "Frame", "FrameReader", "VideoInfo", "VideoWriter", "checked_output", "probe", "read_frames"]


EPSILON_S = 1e-6  # a frame at exactly the start is in the section, whatever rounding says


class Frame(NamedTuple):
    """`index` in the file from 0, `time_s` from the file's start, the picture in the format asked for."""

    index: int  # type: ignore[assignment]  # it takes the place of tuple.index, which no one asks a frame for
    time_s: float
    frame_bgr: np.ndarray


@dataclass(frozen=True)
class Damage:
    """What was wrong with a file; false when nothing was.

    `corrupt_frames` were delivered with areas that the decoder guessed, `lost_packets` could not be decoded and are
    missing, `truncated` says that the file ends before its own index or duration does.
    """

    corrupt_frames: int = 0
    lost_packets: int = 0
    truncated: bool = False
    messages: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.corrupt_frames or self.lost_packets or self.truncated or self.messages)

    def __str__(self) -> str:
        parts = []
        if self.truncated:
            parts.append("the file ends too early, it is cut off or damaged")
        if self.corrupt_frames:
            parts.append(f"{self.corrupt_frames} frame(s) partly guessed")
        if self.lost_packets:
            parts.append(f"{self.lost_packets} frame(s) lost")
        if self.messages:
            parts.append(f"ffmpeg says: {self.messages[0]}")
        return "; ".join(parts) or "no damage"


def read_frames(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None, pixel_format: str = "bgr24",
    threads: int = 1, first_row: int = 0, numbered: bool = True,
) -> "FrameReader":
    """Open a video for reading; use it in a `with` block, or loop over it to the end.

    Yields `Frame`s whose time is in [start_s, end_s), upright (rotation applied), at the size of the first frame. In
    the YUV formats an odd width or height is made even by repeating the last column or row. A damaged file yields
    what can be decoded; see `.damage`. `threads` are the decoder's (0: one per core): one costs the least CPU, decodes
    720p at about 300 frames a second beside whatever Python does, and guesses the same in damaged frames every time.
    `first_row` (even, for "yuv420p"): what lies above is not needed; it comes as zeros, and is not copied.
    `numbered` False: `index` counts from the section's first frame, and the file is not read up to there.
    Raises LanelibError for what `probe` refuses, a wrong section or format, and a file without a single good frame.
    """
    return FrameReader(
        path, start_s=start_s, end_s=end_s, pixel_format=pixel_format, threads=threads, first_row=first_row,
        numbered=numbered)


class FrameReader:
    """An iterator of `Frame`s; `info` is what the file says, `damage` what was found (complete at the end)."""

    def __init__(
        self, path: str | Path, *, start_s: float, end_s: float | None, pixel_format: str, threads: int, first_row: int,
        numbered: bool,
    ):
        if pixel_format not in PIXEL_FORMATS:
            raise LanelibError(f"needed a pixel format of {', '.join(PIXEL_FORMATS)}, found {pixel_format!r}")
        self.info = info = probe(path)
        if start_s < 0 or (end_s is not None and end_s <= start_s):
            raise LanelibError(f"{path}: needed 0 <= start < end in seconds, found start {start_s:g} and end {end_s}")
        if 0 < info.duration_s <= start_s:
            raise LanelibError(f"{path}: needed a start within its {info.duration_s:.2f} s, found {start_s:g} s")
        self._start_s, self._end_s = start_s, end_s
        before = packet_times(info.path, end_s=start_s) if start_s and numbered else []
        self._next_index = sum(time < start_s - EPSILON_S for time in before)
        width, height = info.size_wh
        filters = f"showinfo=checksum=0,scale={width}:{height}"
        if pixel_format != "bgr24":
            filters += ":out_range=tv"  # some cameras store Y as 0..255; here it is always 16..235
        if pixel_format != "bgr24" and (width % 2 or height % 2):
            filters += (f",pad={width + width % 2}:{height + height % 2}"
                        f",fillborders=right={width % 2}:bottom={height % 2}:mode=smear")
            width, height = width + width % 2, height + height % 2
        self.shape = (height, width, 3) if pixel_format == "bgr24" else (height * 3 // 2, width)
        if first_row and (pixel_format != "yuv420p" or first_row % 2 or not 0 <= first_row < height):
            raise LanelibError(f"{path}: needed an even first row of yuv420p, 0 to {height - 2}, found {first_row} of "
                               f"{pixel_format}")
        self._first_row = first_row
        if first_row:
            filters += f",crop={width}:{height - first_row}:0:{first_row}"
        # ffmpeg seeks to a frame before and keeps the file's times; the exact cut is made here, in __next__.
        seek_s = max(0.0, start_s - 1 / info.fps) if info.container.startswith(INDEXED) else 0.0
        seek = ["-ss", f"{seek_s:.6f}", "-copyts", "-start_at_zero"] * bool(seek_s)
        self._process = subprocess.Popen(
            [ffmpeg_exe(), "-hide_banner", "-nostdin", "-nostats", "-loglevel", "level+info", "-threads", str(threads),
             *seek, *input_options(), "-i", file_url(info.path), "-map", "0:V:0", "-vf", filters,
             "-fps_mode", "passthrough", "-enc_time_base", "1/1000000", "-pix_fmt", pixel_format, "-f", "rawvideo",
             "pipe:1"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, **POPEN_OPTIONS)
        widen_pipe(self._process.stdout)
        self._log = _ReadingLog(self._process.stderr)
        self._close = weakref.finalize(self, end_process, self._process, self._log.thread)
        self._count, self._last_s, self.damage = 0, start_s - 1 / info.fps, Damage()

    def __enter__(self) -> "FrameReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        if not self._close.alive:
            raise StopIteration
        time_s = -math.inf
        while time_s < self._start_s - EPSILON_S:
            picture = self._picture()
            if not all(_fill(self._process.stdout, part) for part in self._parts(picture)):
                self._finish()
                raise StopIteration
            shown_s = self._log.next_time()
            time_s = self._last_s + 1 / self.info.fps if shown_s is None else shown_s
        if self._end_s is not None and time_s >= self._end_s - EPSILON_S:
            self.close()
            raise StopIteration
        frame = Frame(self._next_index, time_s, picture)
        self._next_index, self._count, self._last_s = self._next_index + 1, self._count + 1, time_s
        return frame

    def _picture(self) -> np.ndarray:
        """Room for a frame. (Zeros cost nothing where nobody looks.)"""
        return (np.zeros if self._first_row else np.empty)(self.shape, np.uint8)

    def _parts(self, picture: np.ndarray) -> list[np.ndarray]:
        """The parts of the frame that ffmpeg sends, one after the other."""
        if not self._first_row:
            return [picture]
        y, u, v = yuv420_planes(picture)
        return [y[self._first_row :], u[self._first_row // 2 :], v[self._first_row // 2 :]]

    def close(self) -> None:
        """End ffmpeg; needed only when the frames were not read to the end. A second call does no harm."""
        if self._close.alive:
            self._close()
            self.damage = self._log.damage(truncated=False)

    def interrupt(self) -> None:
        """End a read that waits for ffmpeg in another thread; close() must follow."""
        self._process.kill()

    def _finish(self) -> None:
        """At the end of the frames: judge whether it came too early."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=10)  # ffmpeg still says what was wrong
        status = self._process.poll()
        self.close()
        killed = status is None or status < 0 or (status > 0 and not self._log.damage(truncated=False))
        if killed:  # damage alone has other words
            self._log.note(f"the decoder ended with status {status}")
        # Two frames of slack for rounded durations; a sound track that is longer than the pictures is no damage.
        slack_s = 2 / self.info.fps
        early = self._end_s is None and self.info.duration_s - self._last_s - 1 / self.info.fps > slack_s
        early = early and (bool(self._log.damage(truncated=False)) or not self.info.has_audio)
        if early:  # unless the last frame is to be shown for so long
            early = self.info.duration_s - packets_end_s(self.info.path) > slack_s
        self.damage = self._log.damage(truncated=early or killed)
        if self._count == 0 and (self.damage or not self._start_s):
            why = self.damage.messages[0] if self.damage.messages else "it holds no frames"
            raise LanelibError(f"{self.info.path}: needed at least one frame that can be decoded, found none ({why}); "
                               "copy or record it again")


class _ReadingLog:
    """Reads what the decoding ffmpeg says, in a thread: the frames' times, and the signs of damage."""

    def __init__(self, pipe: io.FileIO):
        self._times: queue.SimpleQueue[float | None] = queue.SimpleQueue()
        self._corrupt = self._lost = 0
        self._cut, self._decoding, self._size = False, False, ""
        self._tick_s = 0.0
        self._messages: list[str] = []
        self.thread = threading.Thread(target=self._read, args=(pipe,), daemon=True, name="ffmpeg-log")
        self.thread.start()

    def next_time(self) -> float | None:
        """The time of the next frame in seconds, or None when ffmpeg knows none."""
        try:
            return self._times.get(timeout=10)  # its line was written before its picture: it is here or nearly so
        except queue.Empty:
            return None

    def damage(self, *, truncated: bool) -> Damage:
        return Damage(self._corrupt, self._lost, self._cut or truncated, tuple(self._messages))

    def _read(self, pipe: io.FileIO) -> None:
        with io.BufferedReader(pipe) as lines:  # the pipe itself would read byte by byte
            for raw in lines:
                self._take(raw.decode("utf-8", "replace"))

    def _take(self, line: str) -> None:
        # ffmpeg's threads write at once, and showinfo writes its lines in pieces: another thread's message can stand in
        # the middle of such a line, without its prefix. So every sign is looked for in every line.
        if shown := re.search(r"n: *\d+ pts: *(-?\d+|NOPTS) +pts_time:.* s:(\d+x\d+) i:", line):
            self._times.put(None if shown[1] == "NOPTS" else int(shown[1]) * self._tick_s)
            if self._size and self._size != shown[2]:
                self.note(f"frames change from {self._size} to {shown[2]}, scaled to the first size")
            self._size = shown[2]
        elif base := re.search(r"config in time_base: (\d+)/(\d+)", line):
            self._tick_s = int(base[1]) / int(base[2])
        elif "Stream mapping:" in line:
            self._decoding = True
        self._corrupt += line.count("corrupt decoded frame")
        self._lost += line.count("Error submitting packet") + line.count("Decoding error")
        half_a_packet = "corrupt input packet" in line and "mpegts" not in line  # only the end of a file has that
        if half_a_packet or re.search(r"partial file|File ended prematurely", line):
            self._cut = True
        two_at_one_time = "[rawvideo @" in line  # legal here
        if "[error]" in line and (self._decoding or "[in#" in line) and not two_at_one_time:
            self.note(plain(line))

    def note(self, message: str) -> None:
        """Keep a message, once."""
        if message not in self._messages and len(self._messages) < MAX_MESSAGES:
            self._messages.append(message)


def _fill(pipe: io.FileIO, array: np.ndarray) -> bool:
    """Read the array full; False at the end of the stream."""
    view, filled = array.data.cast("B"), 0
    while filled < len(view):
        got = pipe.readinto(view[filled:])
        if not got:
            return False
        filled += got
    return True
