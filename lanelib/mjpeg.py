"""A web page with a moving picture: `MjpegServer`.

Motion JPEG over HTTP is an answer that never ends: one JPEG after the other, each replacing the last
(`multipart/x-mixed-replace`). Every browser shows it in an ordinary <img>. The server answers two addresses, `/` and
`/stream.mjpg`, and reads no file. It listens on the loopback interface, which other machines cannot reach, unless
another host is asked for.
"""

import contextlib
import ipaddress
import socket
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

from lanelib.errors import LanelibError

BOUNDARY = "lanelib-frame"
PAGE = b"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>lanelib live</title>
<style>html,body{margin:0;height:100%;background:#111}img{width:100%;height:100%;object-fit:contain}</style></head>
<body><img src="/stream.mjpg" alt="live view of the lane"></body></html>
"""
# More viewers than this are turned away: each has a thread, and its own copy of every frame on the wire.
MAX_VIEWERS = 8
# A viewer that takes no data for this long is dropped, and closing waits for no one longer.
CLIENT_TIMEOUT_S = 5.0
# A request must be there, whole, this long after the connection: one byte now and then would hold a thread for ever.
REQUEST_TIMEOUT_S = 5.0
# More connections than this are closed unread; viewers, and as many again that only ask for the page.
MAX_CONNECTIONS = 2 * MAX_VIEWERS


class MjpegServer:
    """Serves the frame last published until closed; a context manager. `url` is the page's address.

    `quality` is that of the JPEGs (80: no visible blocks, about 100 kB at 1280x720). A frame is encoded only when
    somebody looks. Raises LanelibError when the address cannot be had.
    """

    def __init__(self, *, host: str = "127.0.0.1", port: int = 0, quality: int = 80):
        self._changed = threading.Condition()
        self._frame: np.ndarray | None = None
        self._jpeg: bytes | None = None
        self._number = 0
        self._quality = quality
        self.viewers = 0
        self.closed = False
        try:
            self._server = _Server((host, port), self)
        except (OSError, OverflowError) as error:
            raise LanelibError(f"cannot serve on {host}:{port} ({error}); choose another port, or 0 for any") from None
        self.host, self.port = host, self._server.server_address[1]
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True,
                                        name="mjpeg-server")
        self._thread.start()

    def __enter__(self) -> "MjpegServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publish(self, frame_bgr: np.ndarray) -> None:
        """Show this (H, W, 3) or (H, W) uint8 frame from now on."""
        if frame_bgr.dtype != np.uint8 or frame_bgr.ndim not in (2, 3) or frame_bgr.size == 0:
            raise LanelibError(f"needed a uint8 frame to show, found {frame_bgr.dtype} of shape {frame_bgr.shape}")
        with self._changed:
            self._frame, self._jpeg, self._number = frame_bgr.copy(), None, self._number + 1
            self._changed.notify_all()

    def newest(self, after: int, timeout_s: float) -> tuple[int, bytes | None]:
        """(number, JPEG) of the newest frame once it is newer than `after`; (after, None) when the wait is over."""
        with self._changed:
            if not self._changed.wait_for(lambda: self.closed or self._number > after, timeout_s) or self.closed:
                return after, None
            if self._jpeg is None and self._frame is not None:
                self._jpeg = cv2.imencode(".jpg", self._frame, [cv2.IMWRITE_JPEG_QUALITY, self._quality])[1].tobytes()
            return self._number, self._jpeg

    def admit(self, change: int) -> bool:
        """Count a viewer in (1) or out (-1); False where there are too many."""
        with self._changed:
            if self.viewers + change > MAX_VIEWERS:
                return False
            self.viewers += change
            return True

    def close(self) -> None:
        """Stop serving and wait for the viewers' threads. A second call does no harm."""
        if self.closed:
            return
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = False  # so that server_close waits for them
    block_on_close = True
    allow_reuse_address = False  # a port in use is an error, not shared

    def __init__(self, address: tuple[str, int], owner: MjpegServer):
        self.owner = owner
        self._unread: dict[socket.socket, float] = {}  # connections whose request is not there yet, and since when
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        # Not HTTPServer's: that one asks the name service for this machine's name, which can take seconds.
        socket.socket.bind(self.socket, self.server_address)
        self.server_address = bound = self.socket.getsockname()
        self.server_name, self.server_port = bound[:2]

    def verify_request(self, request: socket.socket, *_: object) -> bool:  # type: ignore[override]  # TCP: a socket
        """Whether there is room for another connection."""
        with self._lock:
            if len(self._open) >= MAX_CONNECTIONS:
                return False
            self._open.add(request)
            self._unread[request] = time.monotonic()
            return True

    def request_is_read(self, request: socket.socket) -> None:
        """From now on only the handler's own time limit counts."""
        with self._lock:
            self._unread.pop(request, None)

    def shutdown_request(self, request: socket.socket) -> None:  # type: ignore[override]  # TCP: a socket
        """The end of every connection."""
        with self._lock:
            self._open.discard(request)
            self._unread.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Ten times a second: end the connections whose request does not come."""
        with self._lock:
            late = [r for r, since_s in self._unread.items() if time.monotonic() - since_s > REQUEST_TIMEOUT_S]
        for request in late:
            with contextlib.suppress(OSError):
                request.shutdown(socket.SHUT_RDWR)  # its handler reads the end of the stream

    def handle_error(self, request: object, client_address: object) -> None:
        """A viewer that goes away in the middle is no news."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version = "lanelib"
    sys_version = ""
    timeout = CLIENT_TIMEOUT_S

    def do_GET(self) -> None:  # the name that http.server calls
        """The page, the stream, or 404."""
        if not self._host_is_ours():
            self.send_error(HTTPStatus.FORBIDDEN)
        elif self.path == "/":
            self._head("text/html; charset=utf-8", len(PAGE))
            self.wfile.write(PAGE)
        elif self.path == "/stream.mjpg":
            self._stream(self.server.owner)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def parse_request(self) -> bool:
        """As always, and noted."""
        good = super().parse_request()
        self.server.request_is_read(self.connection)
        return good

    def log_message(self, *_: object) -> None:
        """Nothing is printed."""

    def _host_is_ours(self) -> bool:
        """On loopback, only requests that name it: a web page elsewhere must not reach us under its own name."""
        if not _is_loopback(self.server.owner.host):
            return True
        name = self.headers.get("Host", "").rpartition(":")[0] or self.headers.get("Host", "")
        return _is_loopback(name.strip("[]"))

    def _stream(self, owner: MjpegServer) -> None:
        if not owner.admit(1):
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, "too many viewers")
            return
        try:
            self._head(f"multipart/x-mixed-replace; boundary={BOUNDARY}", None)
            number = 0
            while not owner.closed:
                number, jpeg = owner.newest(number, 1.0)
                if jpeg is not None:
                    part = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    self.wfile.write(part.encode() + jpeg + b"\r\n")
        except OSError:
            pass  # the viewer went away
        finally:
            owner.admit(-1)

    def _head(self, kind: str, length: int | None) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Content-Security-Policy", "default-src 'none'; img-src 'self'; style-src 'unsafe-inline'")
        self.end_headers()


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
