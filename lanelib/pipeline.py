"""A whole video through a function: decode, process and encode at the same time.

ffmpeg decodes and encodes in two processes of their own; two threads keep the pipes to them busy (a read or write of a
pipe lets other Python threads run), and the function runs in the thread that called. Short queues in between hold the
faster stage back, so memory does not grow with the length.
"""

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lanelib.errors import LanelibError
from lanelib.video import Damage, Frame, FrameReader, VideoWriter, checked_output, read_frames

if TYPE_CHECKING:
    from tqdm import tqdm

FrameFunction = Callable[[np.ndarray, int, float], np.ndarray | None]
# Frames waiting between two stages: enough to even out a slow frame, 4 MB each way at 1280x720 in yuv420p.
QUEUE_FRAMES = 3


@dataclass(frozen=True)
class Summary:
    """What `process_video` did; prints as one line."""

    source: Path
    output: Path | None
    frames_in: int
    frames_out: int
    seconds: float
    damage: Damage

    def __str__(self) -> str:
        rate = self.frames_in / self.seconds if self.seconds > 0 else 0.0
        where = f", wrote {self.frames_out} to {self.output}" if self.output else ""
        about = f"; damaged input: {self.damage}" if self.damage else ""
        done = f"{self.frames_in} frames in {self.seconds:.1f} s ({rate:.0f} a second)"
        return f"{self.source.name}: {done}{where}{about}"


def process_video(
    source: str | Path, function: FrameFunction, *, output: str | Path | None = None, start_s: float = 0.0,
    end_s: float | None = None, on_progress: Callable[[int, int], None] | None = None,
    preset: str = "veryfast", crf: float = 20, pixel_format: str = "bgr24", audio: bool = True, first_row: int = 0,
) -> Summary:
    """Call `function(frame, index, time_s)` for every frame in order, and write what it returns to `output`.

    The function may change the frame it is given and return it; for None nothing is written. Times and sound of the
    source are kept (a section starts at 0). `on_progress(done, expected)` is called after each frame.
    `pixel_format` is that of the frames in and out, as for `read_frames`; "yuv420p" is the cheapest. `first_row`: see
    `read_frames`; with it there can be no `output`.
    An exception in any stage stops all of them, leaves no output, and is raised once.
    """
    began = time.perf_counter()
    if output is not None:
        if first_row:
            raise LanelibError(f"needed whole frames for an output, found first_row {first_row}; leave it out")
        output = checked_output(output, source=source)
    with ExitStack() as stack:
        reader = stack.enter_context(read_frames(
            source, start_s=start_s, end_s=end_s, pixel_format=pixel_format, first_row=first_row))
        expected = _expected(reader, start_s, end_s)
        writer = None
        if output is not None:
            writer = stack.enter_context(VideoWriter(
                output, fps=reader.info.fps, preset=preset, crf=crf, pixel_format=pixel_format,
                audio_from=source if audio else None, audio_start_s=start_s,
                audio_duration_s=None if end_s is None else end_s - start_s, color_matrix=reader.info.color_matrix))
        frames = stack.enter_context(_ReadAhead(reader))
        sink = stack.enter_context(_WriteBehind(writer)) if writer is not None else None
        frames_in = 0
        for frame in frames:
            result = function(frame.frame_bgr, frame.index, frame.time_s)
            if sink is not None and result is not None:
                sink.put(result, frame.time_s - start_s)
            frames_in += 1
            if on_progress is not None:
                on_progress(frames_in, expected)
        if not frames_in:
            raise LanelibError(_no_frames(reader, start_s, end_s))
    return Summary(reader.info.path, output, frames_in, writer.frames if writer is not None else 0,
                   time.perf_counter() - began, reader.damage)


def progress_bar(label: str = "", *, quiet: bool = False) -> "ProgressBar":
    """A bar for `on_progress`: `with progress_bar("clip.mp4") as bar: process_video(…, on_progress=bar)`.

    In a notebook it is a widget, in a terminal a line on stderr; elsewhere (a log file, a pipe) and with `quiet` none.
    """
    return ProgressBar(label, quiet=quiet)


class ProgressBar:
    """Callable (done, expected); shows nothing until first called."""

    def __init__(self, label: str, *, quiet: bool):
        self._label = label
        self._bar: tqdm | None = None
        self._shown = not quiet and (sys.stderr.isatty() or _in_notebook())

    def __call__(self, done: int, expected: int) -> None:
        """Move to `done` of about `expected` frames (0: unknown)."""
        if not self._shown:
            return
        if self._bar is None:
            from tqdm.auto import tqdm  # chooses between terminal and notebook

            self._bar = tqdm(total=expected or None, desc=self._label, unit="frame", file=sys.stderr)
        if self._bar.total is not None and done > self._bar.total:
            self._bar.total = done  # the expected number is an estimate
        self._bar.update(done - self._bar.n)

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()


def _in_notebook() -> bool:
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


def _no_frames(reader: FrameReader, start_s: float, end_s: float | None) -> str:
    until = "the end" if end_s is None else f"{end_s:g} s"
    lasts = f" of a video of {reader.info.duration_s:.2f} s" if reader.info.duration_s else ""
    return f"{reader.info.path}: needed frames from {start_s:g} s to {until}{lasts}, found none; choose another section"


def _expected(reader: FrameReader, start_s: float, end_s: float | None) -> int:
    """About how many frames the section has; 0 when the file does not say how long it is."""
    info = reader.info
    if end_s is None and info.duration_s == 0:
        return 0
    until_s = min(end_s if end_s is not None else info.duration_s, info.duration_s or float("inf"))
    return max(0, round((until_s - start_s) * info.fps))


class _Stage:
    """A thread with a short queue. The first exception in it is kept and raised in the thread that called."""

    def __init__(self, name: str):
        self._queue: queue.Queue[Any] = queue.Queue(QUEUE_FRAMES)
        self._stopped = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:
            self._error = error
        finally:
            self._stopped.set()

    def _work(self) -> None:
        raise NotImplementedError

    def _offer(self, item: object) -> bool:
        """Put, unless this stage has ended or is to end: then False."""
        while not self._stopped.is_set():
            try:
                self._queue.put(item, timeout=0.1)
            except queue.Full:
                continue
            return True
        return False

    def _take(self) -> Any:
        """Get; None at the end, and when this stage is to end."""
        while True:
            try:
                return self._queue.get(timeout=0.1)
            except queue.Empty:
                if self._stopped.is_set() and self._queue.empty():
                    return None

    def _raise(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error


class _ReadAhead(_Stage):
    """Iterates over the reader's frames, read in a thread."""

    def __init__(self, reader: FrameReader):
        self._reader = reader
        super().__init__("decode")

    def _work(self) -> None:
        for frame in self._reader:
            if not self._offer(frame):
                return
        self._offer(None)

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._take()) is not None:
            yield frame
        self._raise()

    def __enter__(self) -> "_ReadAhead":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._stopped.set()
        if kind is not None:
            self._reader.interrupt()  # a read that waits for ffmpeg ends
        self._thread.join()


class _WriteBehind(_Stage):
    """Writes frames in a thread; leaving the `with` block waits for the last one."""

    def __init__(self, writer: VideoWriter):
        self._writer = writer
        super().__init__("encode")

    def _work(self) -> None:
        while (item := self._take()) is not None:
            self._writer.write(item[0], time_s=item[1])

    def put(self, frame: np.ndarray, time_s: float) -> None:
        """Queue a frame; raises what the writer raised."""
        if not self._offer((frame, time_s)):
            self._raise()

    def __enter__(self) -> "_WriteBehind":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._offer(None)
        else:
            self._stopped.set()
            self._writer.interrupt()  # a write that waits for ffmpeg ends
        self._thread.join()
        if kind is None:
            self._raise()
