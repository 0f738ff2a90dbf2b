"""A camera or network stream, frame by frame, and a window or web page to watch the result in.

A source may be absent, stall, or be unplugged at any moment, and a read from it may hang. So it is read in a thread of
its own which keeps only the newest frame; the reader waits for that with a time limit and, past it, connects anew a
bounded number of times. Every way this can end is a `LanelibError` that says what happened.
"""

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from lanelib.errors import LanelibError
from lanelib.mjpeg import MjpegServer
from lanelib.video import Frame, read_frames

__all__ = ["LiveSummary", "MjpegServer", "can_show_window", "frames_from_device_or_url", "live"]

URL_SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "rtp", "udp", "srt")
StatusFunction = Callable[[str], None]


def frames_from_device_or_url(
    source: str | int | Path, *, timeout_s: float = 5.0, reconnects: int = 3, wait_s: float = 1.0,
    on_status: StatusFunction | None = None,
) -> Generator[Frame, None, None]:
    """Frames (BGR) of a camera (index or device path), a stream (URL) or, once through, a video file.

    Of a camera or stream always the newest frame is given: what came while the caller was busy is skipped, which
    shows in `Frame.index`; `time_s` counts from the first frame. `timeout_s`: longest wait for a connection or frame
    (5 s: several key-frame intervals of common network cameras). `reconnects`: how often in a row a lost source is
    tried again, `wait_s` apart. `on_status` is told of every connection and loss in one line.
    Raises LanelibError: source absent, not a picture source, or lost and not found again.
    """
    kind, address = _source(source)
    if kind == "file":
        with read_frames(str(source)) as frames:
            yield from frames
        return
    name, say = _shown(source), on_status or (lambda _: None)
    began_s, index, failures, last = None, 0, 0, -1
    while True:
        grabber, connected_s = _Grabber(address, timeout_s), None
        try:
            for number, frame in grabber.frames():
                now_s = time.monotonic()
                if connected_s is None:
                    say(f"{name}: connected, {frame.shape[1]}x{frame.shape[0]}")
                    connected_s = now_s
                began_s = now_s if began_s is None else began_s
                if now_s - connected_s > timeout_s:
                    failures = 0  # steady again
                yield Frame(index + number, now_s - began_s, frame)
                last = number
            raise AssertionError("frames() ends by raising")
        except _LostError as lost:
            if began_s is None:
                raise LanelibError(f"{name}: needed a camera or stream, found none ({lost}); "
                                   "check that it is plugged in, switched on and not in use") from None
            if failures >= reconnects:
                raise LanelibError(f"{name}: needed the source to go on, lost it ({lost}) and did not find it again in "
                                   f"{reconnects} attempts; check the cable or network and start again") from None
            failures += 1
            index += last + 1
            last = -1
            say(f"{name}: {lost}, connecting again ({failures} of {reconnects})")
            time.sleep(wait_s)
        finally:
            grabber.stop()


@dataclass(frozen=True)
class LiveSummary:
    """What `live` showed, and why it ended."""

    frames: int
    seconds: float
    reason: str

    def __str__(self) -> str:
        rate = self.frames / self.seconds if self.seconds > 0 else 0.0
        return f"{self.frames} frames in {self.seconds:.1f} s ({rate:.0f} a second), ended: {self.reason}"


def live(
    source: str | int | Path, function: Callable[[np.ndarray, int, float], np.ndarray | None], *,
    window: bool | None = None, host: str = "127.0.0.1", port: int = 0, max_frames: int | None = None,
    timeout_s: float = 5.0, reconnects: int = 3, on_status: StatusFunction | None = None,
) -> LiveSummary:
    """Show `function(frame_bgr, index, time_s)` of every frame until the source ends or a key (q, Esc) is pressed.

    In a window where there is a display and OpenCV was built with one, otherwise (or with `window=False`) as a web page
    on `host` and `port` (0: any free one; the address goes to `on_status`). A file is shown at its own speed. The
    function may return None to show nothing. Raises LanelibError as `frames_from_device_or_url` does, and for
    `window=True` where no window can be shown.
    """
    window = can_show_window() if window is None else window
    if window and not can_show_window():
        raise LanelibError("needed a display and an OpenCV with windows, found none (opencv-python-headless has none); "
                           "use the web page instead")
    say = on_status or (lambda _: None)
    is_file = _source(source)[0] == "file"
    began_s, shown, reason = time.monotonic(), 0, "the file was shown to its end"
    with ExitStack() as stack:
        frames = stack.enter_context(closing(frames_from_device_or_url(
            source, timeout_s=timeout_s, reconnects=reconnects, on_status=on_status)))
        if window:
            stack.callback(cv2.destroyAllWindows)
            show: Callable[[np.ndarray], bool | None] = _show_in_window
        else:
            server = stack.enter_context(MjpegServer(host=host, port=port))
            say(f"watch at {server.url}")
            show = server.publish
        for frame in frames:
            if is_file:
                time.sleep(max(0.0, began_s + frame.time_s - time.monotonic()))
            picture = function(frame.frame_bgr, frame.index, frame.time_s)
            shown += 1
            if picture is not None and show(picture) is False:
                reason = "the window was closed"
                break
            if max_frames is not None and shown >= max_frames:
                reason = f"{max_frames} frames were asked for"
                break
    return LiveSummary(shown, time.monotonic() - began_s, reason)


def can_show_window() -> bool:
    """Whether `cv2.imshow` can work here: an OpenCV with windows, and a display."""
    gui = re.search(r"GUI:\s*(\S+)", cv2.getBuildInformation())
    if gui is None or gui[1] == "NONE":
        return False
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _show_in_window(picture: np.ndarray) -> bool:
    """False when q or Esc was pressed."""
    cv2.imshow("lanelib", picture)
    return cv2.waitKey(1) & 0xFF not in (ord("q"), 27)


def _source(source: str | int | Path) -> tuple[str, str | int]:
    """("device" | "url" | "file", what OpenCV or ffmpeg opens)."""
    text = str(source)
    if text.isdecimal():
        if sys.platform == "linux" and not Path(f"/dev/video{text}").exists():
            found = ", ".join(sorted(p.name.removeprefix("video") for p in Path("/dev").glob("video*"))) or "no camera"
            raise LanelibError(f"camera {text}: needed a connected camera, found {found}; plug it in or name another")
        return "device", int(text)
    if scheme := re.match(r"([a-zA-Z][a-zA-Z0-9+.-]+)://", text):
        if scheme[1].lower() not in URL_SCHEMES:
            raise LanelibError(f"{_shown(source)}: needed an address beginning with {', '.join(URL_SCHEMES)}, found "
                               f"{scheme[1]}; give a file by its plain name")
        return "url", text
    if text.startswith("/dev/"):
        if not os.path.exists(text):
            raise LanelibError(f"{text}: needed a connected camera, found nothing there; plug it in or name another")
        return "device", text
    return "file", text


def _shown(source: str | int | Path) -> str:
    """The source as it may be printed: without a password."""
    return re.sub(r"//[^/@]*@", "//…@", str(source))


class _LostError(Exception):
    """The source gives no more frames; the text says why."""


class _Grabber:
    """Reads a source in a thread and keeps the newest frame."""

    def __init__(self, address: str | int, timeout_s: float):
        self._address, self._timeout_s = address, timeout_s
        self._changed = threading.Condition()
        self._newest: tuple[int, np.ndarray] | None = None
        self._over = ""
        self._stopped = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="camera")
        self._thread.start()

    def frames(self) -> Iterator[tuple[int, np.ndarray]]:
        """(number since connecting, frame), the newest each time; ends by raising _LostError."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._over or self._newest is not None, self._timeout_s)
                newest, self._newest, over = self._newest, None, self._over
            if newest is None:
                raise _LostError(over or f"no frame within {self._timeout_s:g} s")
            yield newest

    def stop(self) -> None:
        """End the thread; one that hangs in a read is left to end by itself at OpenCV's own time limit."""
        self._stopped = True
        self._thread.join(timeout=0.5)

    def _run(self) -> None:
        capture, number = None, 0
        try:
            capture = self._open()
            if not capture.isOpened():
                self._end("it cannot be opened")
                return
            while not self._stopped:
                good, frame = capture.read()
                if not good or frame is None:
                    self._end("it ended" if number else "it gives no picture")
                    return
                with self._changed:
                    self._newest = (number, frame)
                    self._changed.notify_all()
                number += 1
        except Exception as error:  # whatever it is must reach the thread that waits
            self._end(f"OpenCV says: {' '.join(str(error).split())}")
        finally:
            if capture is not None:
                capture.release()

    def _open(self) -> cv2.VideoCapture:
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # silent; OpenCV reads it when it first needs ffmpeg
        log = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # it moved in OpenCV 5
        level = log.getLogLevel()
        log.setLogLevel(0)  # silent: what went wrong is said by the LanelibError, in one line
        try:
            if isinstance(self._address, int):
                return cv2.VideoCapture(self._address)
            if self._address.startswith("/dev/"):
                return cv2.VideoCapture(self._address, cv2.CAP_V4L2)
            limit_ms = int(1000 * self._timeout_s)
            return cv2.VideoCapture(self._address, cv2.CAP_FFMPEG, [
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, limit_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, limit_ms])
        finally:
            log.setLogLevel(level)

    def _end(self, why: str) -> None:
        with self._changed:
            self._over = why
            self._changed.notify_all()
