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
import test_fuzz as fuzz

from lanelib import cli, mjpeg
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
        if then == "silent":
            while self.server.going:
                time.sleep(0.05)
            return
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


@pytest.mark.parametrize("plan", [[(0, "refuse")], [(0, "garbage")], [(0, "stall")], [(0, "drop")], [(0, "silent")]])
@pytest.mark.parametrize("scheme", ["http", "rtsp"])
def test_a_stream_that_never_was(plan, scheme):
    """For "rtsp" it is a server that speaks another language, or none."""
    with FaultyCamera(plan) as camera, pytest.raises(LanelibError) as error:
        next(frames_from_device_or_url(camera.url.replace("http", scheme), **QUICK))
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


# --- a camera that is plugged in, without one ------------------------------------------------------------------------


class FakeCapture:
    """Stands for `cv2.VideoCapture`: connection i gives plan[i] frames, then does what it says; then it is absent.

    "fails": read() returns no picture, as when the cable is pulled. "raises": as some drivers do. "hangs": read() does
    not come back until it is let go.
    """

    def __init__(self, plan):
        self.plan, self.opened, self.released, self.let_go = plan, 0, 0, threading.Event()

    def __call__(self, *_):
        number, self.opened = self.opened, self.opened + 1
        return FakeConnection(self, *(self.plan[number] if number < len(self.plan) else (None, "absent")))


class FakeConnection:
    def __init__(self, camera, n_frames, then, size_wh=SIZE_WH):
        self.camera, self.n_frames, self.then, self.size_wh, self.count = camera, n_frames, then, size_wh, 0

    def isOpened(self):
        return self.then != "absent"

    def read(self):
        if self.count == self.n_frames:
            if self.then == "raises":
                raise cv2.error("ioctl(VIDIOC_QBUF): No such device\nsecond line")
            if self.then == "hangs":
                self.camera.let_go.wait(20)
            return False, None
        self.count += 1
        time.sleep(0.01)
        return True, clips.picture(self.count - 1, self.size_wh)

    def release(self):
        self.camera.released += 1


@pytest.fixture
def plug_in(monkeypatch):
    """A function that plugs in a camera 0 with a plan; unplugged, its threads end."""
    cameras = []

    def make(*plan):
        cameras.append(FakeCapture(plan))
        monkeypatch.setattr("lanelib.live.cv2.VideoCapture", cameras[-1])
        monkeypatch.setattr("lanelib.live._source", lambda source: ("device", 0))
        return cameras[-1]

    yield make
    for camera in cameras:
        camera.let_go.set()


@pytest.mark.parametrize("fault", ["fails", "raises", "hangs"])
def test_a_camera_that_is_plugged_out_and_in_again_goes_on(plug_in, fault):
    camera, said, seen = plug_in((8, fault), (None, "absent"), (10**6, "fails")), [], []
    source = frames_from_device_or_url(0, on_status=said.append, timeout_s=0.4, wait_s=0.05)
    for frame in source:
        seen.append((camera.opened, frame.index, frame.time_s))
        if camera.opened == 3 and len(seen) > 12:
            break
    source.close()
    assert {opened for opened, _, _ in seen} == {1, 3}
    assert [index for _, index, _ in seen] == sorted({index for _, index, _ in seen})
    assert [time_s for _, _, time_s in seen] == sorted(time_s for _, _, time_s in seen)
    why = {"fails": "it ended", "raises": "No such device second line", "hangs": "no frame within 0.4 s"}[fault]
    assert [why in line for line in said] == [False, True, False, False] and "cannot be opened" in said[2]
    assert sum("connected" in line for line in said) == 2 and all("\n" not in line for line in said)
    camera.let_go.set()
    deadline = time.monotonic() + 5
    while camera.released < 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert camera.released == camera.opened == 3  # the one that hung, too, once its read came back


def test_a_camera_that_is_plugged_out_for_good_ends_in_one_line(plug_in, capsys):
    camera = plug_in((8, "fails"))
    began_s = time.monotonic()
    with pytest.raises(LanelibError) as error:
        for _ in frames_from_device_or_url(0, reconnects=2, timeout_s=0.4, wait_s=0.05):
            pass
    assert "lost it (it cannot be opened) and did not find it again in 2 attempts" in str(error.value)
    assert camera.opened == camera.released == 3 and time.monotonic() - began_s < 10
    assert capsys.readouterr() == ("", "")


def test_a_camera_that_gives_no_picture_was_never_there(plug_in):
    plug_in((0, "fails"))
    with pytest.raises(LanelibError, match="0: needed a camera or stream, found none .it gives no picture.; check"):
        next(frames_from_device_or_url(0, **QUICK))


def test_a_camera_that_comes_back_with_another_size(plug_in):
    plug_in((8, "fails"), (10**6, "fails", (128, 64)))
    source = frames_from_device_or_url(0, timeout_s=0.4, wait_s=0.05)
    shapes = [frame.frame_bgr.shape for frame in itertools.islice(source, 20)]
    source.close()
    assert set(shapes) == {(96, 160, 3), (64, 128, 3)}


def test_an_attempt_counts_again_only_after_a_steady_while(plug_in):
    """A loose contact: a frame or two, then nothing, over and over. It must come to an end."""
    camera = plug_in(*[(2, "fails")] * 50)
    with pytest.raises(LanelibError, match="3 attempts"):
        for _ in frames_from_device_or_url(0, timeout_s=0.4, wait_s=0.01):
            pass
    assert camera.opened == 4


def test_the_command_ends_with_a_status(plug_in, capsys, tmp_path, monkeypatch):
    """Unplugged in the middle: `lanelib live` says so, tries again, and ends with exit code 2."""
    plug_in((60, "fails", (160, 90)), (60, "fails", (160, 90)))
    fuzz.RIG.save(tmp_path / "rig.json")
    sleep = time.sleep
    monkeypatch.setattr("lanelib.live.time.sleep", lambda seconds: sleep(min(seconds, 0.02)))
    assert cli.main(["live", "0", "--rig", str(tmp_path / "rig.json"), "--page"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("lanelib: ") for line in lines)
    assert "watch at http://127.0.0.1:" in lines[0] and sum("connecting again" in line for line in lines) == 3
    assert "did not find it again in 3 attempts" in lines[-1]


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


def ask(server: MjpegServer, data: bytes, *, wait_s: float = 5.0) -> bytes:
    """What comes back for these bytes until the server hangs up (or `wait_s` without a byte)."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=wait_s) as connection:
        answer = b""
        try:
            connection.sendall(data)
            while got := connection.recv(65536):
                answer += got
        except (TimeoutError, ConnectionError):
            pass
        return answer


HOST = b"Host: localhost\r\n"
BAD_REQUESTS = {
    "a line of 70 kB": (b"GET /" + b"a" * 70_000 + b" HTTP/1.0\r\n\r\n", b"414"),
    "a header of 70 kB": (b"GET / HTTP/1.0\r\nX: " + b"a" * 70_000 + b"\r\n\r\n", b"431"),
    "a thousand headers": (b"GET / HTTP/1.0\r\n" + b"X: y\r\n" * 1000 + b"\r\n", b"431"),
    "bytes": (bytes(range(256)) * 20 + b"\r\n\r\n", b"400"),
    "another version": (b"GET / HTTP/9.0\r\n" + HOST + b"\r\n", b"505"),
    "an encrypted hello": (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", b"400"),
    "a proxy's request": (b"GET http://example.org/ HTTP/1.0\r\n" + HOST + b"\r\n", b"404"),
    "a tunnel": (b"CONNECT example.org:443 HTTP/1.0\r\n" + HOST + b"\r\n", b"501"),
    "a path that goes up": (b"GET /../../etc/passwd HTTP/1.0\r\n" + HOST + b"\r\n", b"404"),
    "a path on the disk": (b"GET //etc/passwd HTTP/1.0\r\n" + HOST + b"\r\n", b"404"),
    "backslashes": (b"GET /..\\..\\secret HTTP/1.0\r\n" + HOST + b"\r\n", b"404"),
    "a method of one's own": (b"BREW / HTTP/1.0\r\n" + HOST + b"\r\n", b"501"),
    "no host": (b"GET / HTTP/1.1\r\n\r\n", b"403"),
}


@pytest.mark.parametrize("name", BAD_REQUESTS)
def test_whatever_is_asked_the_answer_is_a_refusal(name, capfd):
    data, status = BAD_REQUESTS[name]
    with MjpegServer() as server:
        answer = ask(server, data)
        assert status in answer.split(b"\r\n")[0][:13] or (b"Error code: " + status) in answer
        assert b"root:" not in answer and len(answer) < 2000
        assert request(server, "/").status == 200  # and it goes on
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("begin", [b"", b"G", b"GET / HTTP/1.0\r\n", b"GET / HTTP/1.0\r\nHost: localhost\r\nX: "])
def test_a_request_that_comes_drop_by_drop_is_cut_off(monkeypatch, begin):
    """A byte now and then resets the limit of a single read; the limit of the whole request stays."""
    monkeypatch.setattr(mjpeg, "REQUEST_TIMEOUT_S", 0.6)
    with MjpegServer() as server, socket.create_connection(("127.0.0.1", server.port), timeout=0.1) as drip:
        began_s, cut = time.monotonic(), False
        drip.sendall(begin)
        while not cut and time.monotonic() - began_s < 8:
            try:
                drip.sendall(b"x")
                cut = drip.recv(100) == b""
            except TimeoutError:
                pass
            except OSError:
                cut = True
        assert cut and time.monotonic() - began_s > 0.5


def test_a_viewer_is_not_cut_off_by_the_limit_of_requests(monkeypatch):
    monkeypatch.setattr(mjpeg, "REQUEST_TIMEOUT_S", 0.2)
    with MjpegServer() as server:
        answer = request(server, "/stream.mjpg")
        time.sleep(0.6)
        server.publish(clips.picture(1, SIZE_WH))
        assert answer.readline().startswith(b"--lanelib-frame")
        answer.close()


def test_more_connections_than_stated_are_closed_unread(monkeypatch):
    monkeypatch.setattr(mjpeg, "MAX_CONNECTIONS", 3)
    with MjpegServer() as server:
        idle = [socket.create_connection(("127.0.0.1", server.port), timeout=5) for _ in range(3)]
        deadline = time.monotonic() + 5
        while len(server._server._open) < 3 and time.monotonic() < deadline:
            time.sleep(0.02)
        assert ask(server, b"GET / HTTP/1.0\r\n" + HOST + b"\r\n") == b""
        for connection in idle:
            connection.close()
        deadline = time.monotonic() + 5
        while server._server._open and time.monotonic() < deadline:
            time.sleep(0.02)
        assert request(server, "/").status == 200


def test_a_slow_viewer_does_not_hold_up_the_others(monkeypatch):
    monkeypatch.setattr(mjpeg._Handler, "timeout", 1.0)
    noise = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), np.uint8)
    with MjpegServer() as server:
        slow = socket.create_connection(("127.0.0.1", server.port))
        slow.sendall(b"GET /stream.mjpg HTTP/1.0\r\n" + HOST + b"\r\n")  # and takes nothing
        quick, sizes = request(server, "/stream.mjpg"), []
        for i in range(12):
            noise[0] = i
            server.publish(noise)
            assert quick.readline().startswith(b"--lanelib-frame")
            quick.readline()
            sizes.append(int(quick.readline().split(b":")[1]))
            quick.readline()
            quick.read(sizes[-1])
            quick.readline()
        deadline = time.monotonic() + 8
        while server.viewers > 1 and time.monotonic() < deadline:  # the one that takes nothing is dropped
            server.publish(noise)
            time.sleep(0.1)
        assert len(sizes) == 12 and server.viewers == 1
        quick.close()
        slow.close()


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
