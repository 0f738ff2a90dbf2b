"""Frames into a video file: `VideoWriter`.

Raw frames with their times go through a pipe to ffmpeg, which encodes them in its own process.
"""

import contextlib
import io
import os
import subprocess
import threading
import weakref
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple

import numpy as np

from lanelib import matroska
from lanelib.errors import LanelibError
from lanelib.ffmpeg import (
    COLOR_MATRICES,
    COPIED_AUDIO,
    MAX_MESSAGES,
    PIXEL_FORMATS,
    POPEN_OPTIONS,
    end_process,
    exact_rate,
    ffmpeg_exe,
    file_url,
    input_options,
    probe,
    reason,
    widen_pipe,
)
from lanelib.parts import is_special, part_of, remove_abandoned, set_aside


class _Encoder(NamedTuple):
    """ffmpeg at work: its process, the pipe to it, who hears what it says, and how to leave nothing of it behind."""

    process: "subprocess.Popen[bytes]"
    pipe: IO[bytes]
    log_thread: threading.Thread
    abandon: weakref.finalize


class VideoWriter:
    """Writes H.264 in yuv420p that plays in browsers, complete under its name or not at all.

    Use it in a `with` block. The file grows as `.NAME.PID.part.mp4` beside its final name and is renamed when the block
    ends without an exception. Frames are (H, W, 3) uint8 BGR, or YUV planes (`pixel_format` "yuv420p" or "nv12").
    An odd width or height is made even by repeating the last column or row, so nothing is lost and no pixel moves.

    size_wh : of the frames; None takes it from the first frame. fps : the nominal rate, and the spacing of frames
    written without a time. preset, crf : x264's speed and quality (18 looks the same as the source, 28 is small).
    audio_from : a file whose sound track is kept (from `audio_start_s`, for `audio_duration_s`); copied where the
    container can hold it, else encoded to AAC. color_matrix : the YUV matrix of the planes, or to be used for BGR; None
    leaves it open, as in the source (players and OpenCV then assume BT.601).
    Raises LanelibError: output name, folder, same file as `audio_from`, frame of another size, ffmpeg's failure.
    """

    def __init__(
        self, path: str | Path, *, size_wh: tuple[int, int] | None = None, fps: float = 25.0, preset: str = "veryfast",
        crf: float = 20, pixel_format: str = "bgr24", audio_from: str | Path | None = None, audio_start_s: float = 0.0,
        audio_duration_s: float | None = None, color_matrix: str | None = "bt709", threads: int = 0,
    ):
        self.path = checked_output(path, source=audio_from)
        if pixel_format not in PIXEL_FORMATS:
            raise LanelibError(f"needed a pixel format of {', '.join(PIXEL_FORMATS)}, found {pixel_format!r}")
        if not fps > 0:
            raise LanelibError(f"{path}: needed a frame rate above 0, found {fps:g}")
        self.size_wh, self.frames = size_wh, 0
        self._rate, self._preset, self._crf, self._pixel_format = exact_rate(fps), preset, crf, pixel_format
        self._audio = (audio_from, audio_start_s, audio_duration_s)
        self._color_matrix = color_matrix if color_matrix in COLOR_MATRICES else None
        self._threads = threads
        self._part = part_of(self.path, suffix=f".part{self.path.suffix}")  # ffmpeg goes by the ending
        self._said: list[str] = []
        self._encoder: _Encoder | None = None  # from the first frame on
        self._last_us = -1
        # Ticks of the output: a whole number per frame, and at most 1/30000 s for other times.
        self._timescale = self._rate.numerator * -(-30000 // self._rate.numerator)

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()

    def write(self, frame: np.ndarray, *, time_s: float | None = None) -> None:
        """Append a frame at `time_s` from the start (default: the next one at the nominal rate)."""
        encoder = self._encoder or self._start(frame, time_s or 0.0)
        if frame.dtype != np.uint8 or frame.shape != self._shape:
            raise LanelibError(f"{self.path}: needed every frame as uint8 of shape {self._shape}, "
                               f"found {frame.dtype} of shape {frame.shape}")
        if self._pixel_format == "bgr24" and (frame.shape[0] % 2 or frame.shape[1] % 2):
            frame = np.pad(frame, ((0, frame.shape[0] % 2), (0, frame.shape[1] % 2), (0, 0)), mode="edge")
        time_us = round((self.frames / self._rate if time_s is None else time_s) * 1_000_000)
        # A player needs ascending times: one that stands still or goes back moves up by a tick.
        time_us = max(time_us, self._last_us + -(-1_000_000 // self._timescale) if self.frames else 0)
        try:
            _pour(encoder.pipe, matroska.frame_header(time_us, frame.nbytes))
            _pour(encoder.pipe, np.ascontiguousarray(frame).data)
        except (OSError, ValueError):  # ffmpeg is gone: a broken pipe, or on Windows an invalid argument
            raise self._failure(encoder) from None
        self._last_us, self.frames = time_us, self.frames + 1

    def close(self) -> None:
        """Finish the file and give it its name; LanelibError if ffmpeg could not."""
        encoder = self._encoder
        if encoder is None:
            raise LanelibError(f"{self.path}: needed at least one frame to write, found none")
        with contextlib.suppress(OSError):
            encoder.pipe.close()
        if encoder.process.wait() != 0:
            raise self._failure(encoder)
        encoder.log_thread.join()
        encoder.abandon.detach()
        try:
            os.replace(self._part, self.path)
        except OSError as error:  # it is a folder by now, or open in a player
            kept = set_aside(self._part, self.path)
            raise LanelibError(f"{self.path}: cannot have its name: {error.strerror}; it was kept as {kept}") from None

    def abort(self) -> None:
        """End ffmpeg and remove what was written so far."""
        if self._encoder is not None:
            self._encoder.abandon()

    def interrupt(self) -> None:
        """End a write that waits for ffmpeg in another thread; abort() must follow."""
        if self._encoder is not None:
            self._encoder.process.kill()

    def _failure(self, encoder: _Encoder) -> LanelibError:
        with contextlib.suppress(OSError):
            encoder.pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            encoder.process.wait(timeout=10)  # its last words tell why
        encoder.abandon()
        why = reason("\n".join(self._said)) if self._said else f"it ended with status {encoder.process.returncode}"
        return LanelibError(f"{self.path}: cannot write the video, ffmpeg says: {why}")

    def _start(self, first: np.ndarray, first_s: float) -> _Encoder:
        if self.size_wh is None:
            if first.ndim != (3 if self._pixel_format == "bgr24" else 2):
                raise LanelibError(f"{self.path}: needed {self._pixel_format} frames, found shape {first.shape}")
            rows = first.shape[0] if self._pixel_format == "bgr24" else first.shape[0] * 2 // 3
            self.size_wh = (first.shape[1], rows)
        remove_abandoned(self.path)
        width, height = (n + n % 2 for n in self.size_wh)
        planes = self._pixel_format != "bgr24"
        self._shape = (height * 3 // 2, width) if planes else (self.size_wh[1], self.size_wh[0], 3)
        matrix = self._color_matrix
        exact = "scale=out_range=tv:flags=bicubic+accurate_rnd"  # else white comes out grey
        filters = [] if planes else [f"{exact}{f':out_color_matrix={matrix}' if matrix else ''}"]
        filters += ["format=yuv420p", f"setparams=range=tv{f':colorspace={matrix}' if matrix else ''}"]
        process = subprocess.Popen(
            [ffmpeg_exe(), "-hide_banner", "-nostats", "-y", "-loglevel", "level+warning", "-probesize", "32",
             "-analyzeduration", "0", "-itsoffset", f"{first_s:.6f}",  # else ffmpeg moves the first frame to 0
             "-f", "matroska", "-i", "pipe:0", *self._audio_input(), "-map", "0:v:0",
             "-vf", ",".join(filters), "-c:v", "libx264", "-preset", self._preset, "-crf", f"{self._crf:g}",
             "-threads", str(self._threads), "-fps_mode", "passthrough", "-enc_time_base", f"1/{self._timescale}",
             "-video_track_timescale", str(self._timescale), "-movflags", "+faststart", file_url(self._part)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, bufsize=0, **POPEN_OPTIONS)
        assert process.stdin is not None
        widen_pipe(process.stdin)
        log_thread = threading.Thread(target=_collect, args=(process.stderr, self._said), daemon=True,
                                      name="ffmpeg-log")
        log_thread.start()
        abandon = weakref.finalize(self, end_process, process, log_thread, self._part)
        self._encoder = _Encoder(process, process.stdin, log_thread, abandon)
        with contextlib.suppress(OSError):
            _pour(process.stdin, matroska.file_header((width, height), self._pixel_format, self._rate))
        return self._encoder

    def _audio_input(self) -> list[str]:
        source, start_s, duration_s = self._audio
        if source is None or (codec := probe(source).audio_codec) is None:
            return []
        section = ["-ss", f"{start_s:.6f}"] * bool(start_s)
        section += ["-t", f"{duration_s:.6f}"] if duration_s is not None else []
        return [*section, *input_options(), "-i", file_url(source), "-map", "1:a:0",
                "-c:a", "copy" if codec in COPIED_AUDIO[self.path.suffix.lower()] else "aac"]


def checked_output(path: str | Path, *, source: str | Path | None = None) -> Path:
    """The path, if a video can be written there without touching `source`; else LanelibError."""
    path = Path(path)
    if path.suffix.lower() not in COPIED_AUDIO:
        raise LanelibError(f"{path}: needed an output name ending in .mp4, found {path.suffix or 'no ending'!r}")
    if path.is_dir():
        raise LanelibError(f"{path}: needed an output file name, found a directory; name a file in it")
    if is_special(path):
        raise LanelibError(f"{path}: needed an output file name, found a device or pipe; name a file")
    if not path.parent.is_dir():
        raise LanelibError(f"{path}: needed an existing folder for the output, found none; make {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise LanelibError(f"{path}: needed a folder with write permission, found none on {path.parent}; use another")
    if source is not None and path.exists() and Path(source).exists() and os.path.samefile(path, source):
        raise LanelibError(f"{path}: needed another file for the output than for the input, found the same; rename one")
    return path


def _pour(pipe: IO[bytes], data: bytes | memoryview) -> None:
    """Write all of it (a pipe may take a part only)."""
    view = memoryview(data).cast("B")
    while view:
        view = view[pipe.write(view):]


def _collect(pipe: io.FileIO, said: list[str]) -> None:
    with io.BufferedReader(pipe) as lines:
        for raw in lines:
            if len(said) < MAX_MESSAGES:
                said.append(raw.decode("utf-8", "replace"))
