"""The live view: sources that are absent, stall or drop, and what the web page serves."""

import http.client
import itertools
import os
import socket
import socketserver
import subprocess
import sys
import threading
import time
from pathlib import Path

import clips
import cv2
import numpy as np
import pytest

from lanelib import mjpeg
from lanelib.errors import LanelibError
from lanelib.live import can_show_window, frames_from_device_or_url, live
from lanelib.mjpeg import MjpegServer

ROOT = Path(__file__).resolve().parents[1]
SIZE_WH = (160, 96)
QUICK = {"timeout_s": 1.0, "wait_s": 0.05}


@pytest.fixture(autouse=True)
def no_thread_left():
    yield
    deadline = time.monotonic() + 8
    while left := [t.name for t in threading.enumerate() if t.name in ("camera", "mjpeg-server")]:
        assert time.monotonic() < deadline, left
        time.sleep(0.05)


class FaultyCamera(socketserver.ThreadingTCPServer):
    """A network camera: connection i sends plan[i] frames 20 ms apart, then stalls or drops; then it refuses."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, plan: list[tuple[int, str]]):
        self.plan, self.connections, self.going = plan, 0, True
        super().__init__(("127.0.0.1", 0), _Connection)
        self.url = f"http://user:secret@127.0.0.1:{self.server_address[1]}/stream.mjpg"
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def __exit__(self, *_):
        self.going = False
        self.shutdown()
        self.server_close()


class _Connection(socketserver.BaseRequestHandler):
    def handle(self):
        number, self.server.connections = self.server.connections, self.server.connections + 1
        self.request.recv(4096)
        n_frames, then = self.server.plan[number] if number < len(self.server.plan) else (0, "refuse")
        if then == "refuse":
            self.request.sendall(b"HTTP/1.0 404 Not Found\r\n\r\n")
            return
        if then == "garbage":
            self.request.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<html>not a stream</html>")
            return
        try:
            self.request.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=b\r\n\r\n")
            for i in range(n_frames):
                jpeg = cv2.imencode(".jpg", clips.picture(i, SIZE_WH))[1].tobytes()
                head = b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
                self.request.sendall(head + jpeg + b"\r\n")
                time.sleep(0.02)
            while then == "stall" and self.server.going:
                time.sleep(0.05)
        except OSError:
            pass


def test_a_stream_is_read_until_it_is_lost_for_good():
    said = []
    with FaultyCamera([(30, "drop")]) as camera:
        frames = []
        with pytest.raises(LanelibError) as error:
            for frame in frames_from_device_or_url(camera.url, reconnects=2, on_status=said.append, **QUICK):
                frames.append(frame)
        assert camera.connections == 3
    assert len(frames) >= 5
    numbers = [clips.frame_number(f.frame_bgr) for f in frames]
    assert numbers == sorted(set(numbers)) and set(numbers) <= set(range(30))
    assert [f.time_s for f in frames] == sorted(f.time_s for f in frames) and frames[0].time_s == 0
    assert all(a.index < b.index for a, b in itertools.pairwise(frames))
    assert "2 attempts" in str(error.value) and "\n" not in str(error.value)
    assert "connected, 160x96" in said[0] and sum("connecting again" in line for line in said) == 2
    assert "secret" not in str(error.value) + "".join(said)


@pytest.mark.parametrize("fault", ["stall", "drop"])
def test_reconnects_and_goes_on(fault):
    said = []
    with FaultyCamera([(15, fault), (15, fault), (400, "stall")]) as camera:
        source = frames_from_device_or_url(camera.url, reconnects=3, on_status=said.append, **QUICK)
        indices, connected = [], []
        for frame in source:
            indices.append(frame.index)
            connected.append(sum("connected," in line for line in said))
            if connected[-1] == 3 and connected.count(3) >= 5:
                break
        source.close()
    assert set(connected) == {1, 2, 3} and indices == sorted(set(indices))


def test_a_stalled_source_ends_within_the_bound():
    with FaultyCamera([(15, "stall")] * 3) as camera:
        began_s = time.monotonic()
        with pytest.raises(LanelibError, match="did not find it again|lost"):
            for _ in frames_from_device_or_url(camera.url, reconnects=2, **QUICK):
                pass
        assert time.monotonic() - began_s < 30
        assert camera.connections == 3


@pytest.mark.parametrize("plan", [[(0, "refuse")], [(0, "garbage")], [(0, "stall")], [(0, "drop")]])
def test_a_stream_that_never_was(plan):
    with FaultyCamera(plan) as camera, pytest.raises(LanelibError) as error:
        next(frames_from_device_or_url(camera.url, **QUICK))
    assert "needed a camera or stream" in str(error.value) and "\n" not in str(error.value)
    assert "secret" not in str(error.value)


@pytest.mark.parametrize("source, words", [
    ("97", "connected camera"), (97, "connected camera"), ("/dev/video97", "nothing there"),
    ("missing.mp4", "nothing there"), ("file:///etc/passwd", "plain name"), ("gopher://x/", "address"),
    ("http://127.0.0.1:9/x", "needed a camera or stream"),
])
def test_a_source_that_is_absent(source, words):
    with pytest.raises(LanelibError) as error:
        next(frames_from_device_or_url(source, **QUICK))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_nothing_is_printed_for_an_absent_source():
    """In a process of its own: OpenCV reads how much its ffmpeg may say only once."""
    code = """
from lanelib.errors import LanelibError
from lanelib.live import frames_from_device_or_url
for source in ("http://127.0.0.1:9/x", "rtsp://127.0.0.1:9/x", "/dev/null"):
    try:
        next(frames_from_device_or_url(source, timeout_s=1))
    except LanelibError:
        print("refused")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert (done.stdout, done.stderr) == ("refused\n" * 3, "")


def test_a_slow_reader_gets_the_newest_frame():
    with FaultyCamera([(100, "stall")]) as camera:
        source = frames_from_device_or_url(camera.url, **QUICK)
        first = next(source)
        time.sleep(0.8)  # 40 frames go by
        second, third = next(source), next(source)
        source.close()
    assert second.index - first.index > 10
    assert clips.frame_number(third.frame_bgr) - clips.frame_number(first.frame_bgr) > 10


# --- the web page --------------------------------------------------------------------------------------------------


def request(server: MjpegServer, path: str, *, method: str = "GET", host: str | None = None):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=5)
    connection.request(method, path, headers={"Host": host} if host else {})
    return connection.getresponse()


def test_serves_the_page_and_nothing_else(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.txt").write_text("secret")
    with MjpegServer() as server:
        page = request(server, "/")
        text = page.read().decode()
        assert page.status == 200 and '<img src="/stream.mjpg"' in text and "http" not in text
        for path in ("/secret.txt", "/../secret.txt", "/stream.mjpg/", "/stream.mjpg?x=1", "/index.html",
                     "/%2e%2e/secret.txt", "/stream.mjpg%00"):
            answer = request(server, path)
            assert answer.status == 404 and b"secret" not in answer.read()
        for method in ("POST", "PUT", "DELETE", "OPTIONS", "HEAD"):
            assert request(server, "/", method=method).status == 501


def test_streams_what_is_published():
    with MjpegServer(quality=95) as server:
        answer = request(server, "/stream.mjpg")
        assert answer.status == 200 and answer.getheader("Content-Type").startswith("multipart/x-mixed-replace")
        for i in range(3):
            server.publish(clips.picture(i, SIZE_WH))
            assert answer.readline().startswith(b"--lanelib-frame")
            assert answer.readline() == b"Content-Type: image/jpeg\r\n"
            length = int(answer.readline().split(b":")[1])
            answer.readline()
            picture = cv2.imdecode(np.frombuffer(answer.read(length), np.uint8), cv2.IMREAD_COLOR)
            answer.readline()
            assert clips.frame_number(picture) == i and picture.shape == (96, 160, 3)
        assert server.viewers == 1
        answer.close()


def test_a_published_frame_may_be_changed_afterwards():
    with MjpegServer() as server:
        frame = clips.picture(5, SIZE_WH)
        server.publish(frame)
        frame[:] = 0
        jpeg = server.newest(0, 1.0)[1]
    assert clips.frame_number(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)) == 5


def test_listens_on_loopback_only_and_answers_to_its_name_only():
    with MjpegServer() as server:
        assert server._server.socket.getsockname()[0] == "127.0.0.1"
        assert server.url == f"http://127.0.0.1:{server.port}/"
        for host, status in [("localhost", 200), (f"localhost:{server.port}", 200), (f"127.0.0.1:{server.port}", 200),
                             ("evil.example", 403), (f"evil.example:{server.port}", 403),
                             ("127.0.0.1.evil.example", 403)]:
            assert request(server, "/", host=host).status == status
    with MjpegServer(host="0.0.0.0") as server:
        assert request(server, "/", host="car.example").status == 200


def test_a_port_in_use_is_an_error():
    with MjpegServer() as server, pytest.raises(LanelibError, match="another port"):
        MjpegServer(port=server.port)


def test_too_many_viewers_are_turned_away(monkeypatch):
    monkeypatch.setattr(mjpeg, "MAX_VIEWERS", 2)
    with MjpegServer() as server:
        answers = [request(server, "/stream.mjpg") for _ in range(3)]
        assert [a.status for a in answers] == [200, 200, 503]
        for answer in answers:
            answer.close()


def test_closing_does_not_wait_for_a_viewer_that_takes_nothing(monkeypatch):
    monkeypatch.setattr(mjpeg._Handler, "timeout", 0.5)
    with MjpegServer() as server:
        stuck = socket.create_connection(("127.0.0.1", server.port))
        stuck.sendall(b"GET /stream.mjpg HTTP/1.0\r\nHost: localhost\r\n\r\n")
        silent = socket.create_connection(("127.0.0.1", server.port))
        noise = np.random.default_rng(0).integers(0, 256, (1080, 1920, 3), np.uint8)
        for _ in range(8):
            server.publish(noise)
            time.sleep(0.03)
        closer = threading.Thread(target=server.close)
        closer.start()
        closer.join(timeout=10)
        assert not closer.is_alive()
        stuck.close()
        silent.close()


def test_bad_frames_are_refused():
    with MjpegServer() as server:
        for frame in (np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8), np.zeros(4, np.uint8)):
            with pytest.raises(LanelibError, match="uint8 frame"):
                server.publish(frame)


# --- together ------------------------------------------------------------------------------------------------------


def test_live_on_a_file_served_as_a_page(tmp_path):
    path = clips.clip(tmp_path / "a.mp4", n_frames=30)
    said, seen, streamed = [], [], []

    def function(frame, index, time_s):
        if index == 0:
            url = said[0].split()[-1]
            watcher.append(threading.Thread(target=watch, args=(url,)))
            watcher[0].start()
        seen.append((index, time_s))
        return 255 - frame

    def watch(url):
        for frame in frames_from_device_or_url(url + "stream.mjpg", timeout_s=2.0, reconnects=0):
            streamed.append(255 - clips.frame_number(frame.frame_bgr))
            if len(streamed) == 3:
                break

    watcher: list[threading.Thread] = []
    began_s = time.monotonic()
    summary = live(path, function, window=False, on_status=said.append)
    watcher[0].join()
    assert summary.frames == 30 and [i for i, _ in seen] == list(range(30))
    assert time.monotonic() - began_s > 29 / 25  # at the file's own speed
    assert "to its end" in summary.reason and "30 frames" in str(summary)
    assert len(streamed) == 3 and streamed == sorted(set(streamed))


def test_live_stops_at_max_frames_and_on_an_exception(tmp_path):
    path = clips.clip(tmp_path / "a.mp4", n_frames=30)
    assert live(path, lambda f, i, t: None, window=False, max_frames=4).frames == 4
    with pytest.raises(ZeroDivisionError):
        live(path, lambda f, i, t: 1 / 0, window=False)


@pytest.mark.skipif(can_show_window(), reason="there is a display and an OpenCV with windows")
def test_a_window_where_there_is_none(tmp_path):
    with pytest.raises(LanelibError, match="needed a display"):
        live(clips.clip(tmp_path / "a.mp4", n_frames=2), lambda f, i, t: f, window=True)


def test_a_window_is_used_where_there_is_one(tmp_path, monkeypatch):
    shown, keys = [], iter([-1, -1, ord("q")])
    monkeypatch.setattr("lanelib.live.can_show_window", lambda: True)
    monkeypatch.setattr(cv2, "imshow", lambda title, picture: shown.append(clips.frame_number(picture)))
    monkeypatch.setattr(cv2, "waitKey", lambda ms: next(keys))
    monkeypatch.setattr(cv2, "destroyAllWindows", lambda: shown.append("closed"))
    summary = live(clips.clip(tmp_path / "a.mp4", n_frames=9), lambda f, i, t: f)
    assert shown == [0, 1, 2, "closed"] and summary.frames == 3 and "window was closed" in summary.reason
