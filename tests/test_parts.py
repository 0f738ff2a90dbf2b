"""parts.py: what a killed run left behind goes, what somebody else writes or owns stays."""

import _pyio
import os
import subprocess
import sys
from pathlib import Path

import clips
import numpy as np
import pytest

from lanelib import parts
from lanelib.errors import LanelibError
from lanelib.files import write_bytes
from lanelib.outputs import _keep_rows, json_lines
from lanelib.parts import part_of, prefix_of, remove_abandoned
from lanelib.pictures import write_image
from lanelib.video import VideoWriter

posix = pytest.mark.skipif(os.name == "nt", reason="there is no asking for a process by its number")


@pytest.fixture(scope="module")
def dead():
    """The number of a process that is no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def names(place: Path) -> set[str]:
    return {path.name for path in place.iterdir()}


def test_unfinished_files_are_hidden_beside_the_final_one(tmp_path):
    part = part_of(tmp_path / "a b.mp4", suffix=".part.mp4")
    assert part == tmp_path / f".a b.mp4.{os.getpid()}.part.mp4" and part.name.startswith(prefix_of(Path("a b.mp4")))


@posix
def test_only_what_is_clearly_abandoned_goes(tmp_path, dead):
    """The process that started these tests lives; so does this one."""
    gone = {f".out.mp4.{dead}.part.mp4", f".out.mp4.{dead}.part", f".out.mp4.{dead}.abcd_123.part"}
    stays = {f".out.mp4.{os.getpid()}.part.mp4", f".out.mp4.{os.getppid()}.abcd1234.part", ".out.mp4.part.mp4",
             f".other.mp4.{dead}.part.mp4", f".out.mp4.{dead}.1.part.mp4", f".out.mp4.5.{dead}.part",
             f"out.mp4.{dead}.part", f".out.mp4.{dead}.part.mp4.bak", f".out.mp4.{'9' * 30}.part", "out.mp4",
             f".outXmp4.{dead}.part", f".out.mp4.{dead}.partial"}
    for name in gone | stays:
        (tmp_path / name).write_text("")
    (tmp_path / f".out.mp4.{dead}.abcdefgh.part").mkdir()  # a folder is nobody's unfinished file
    remove_abandoned(tmp_path / "out.mp4")
    assert names(tmp_path) == stays | {f".out.mp4.{dead}.abcdefgh.part"}


@posix
def test_a_name_that_was_cut_off_is_not_clearly_anybodys(tmp_path, dead):
    long = "x" * parts.NAME_BYTES
    (tmp_path / f".{long}.{dead}.part").write_text("")
    remove_abandoned(tmp_path / (long + "y"))
    assert len(names(tmp_path)) == 1
    remove_abandoned(tmp_path / long)
    assert not names(tmp_path)


def test_a_folder_that_is_not_there_is_no_fault(tmp_path):
    remove_abandoned(tmp_path / "no" / "out.mp4")


def write_video(path):
    with VideoWriter(path, preset="ultrafast") as writer:
        writer.write(clips.picture(0, (64, 48)))


def write_rows(path):
    with json_lines(path) as write_row:
        write_row({"a": 1})


WRITERS = {
    "out.json": lambda path: write_bytes(path, b"{}"),
    "out.png": lambda path: write_image(path, np.zeros((4, 4, 3), np.uint8)),
    "out.jsonl": write_rows,
    "out.mp4": write_video,
}


@posix
@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_tidies_up_after_its_killed_predecessor(tmp_path, dead, name):
    mine = part_of(tmp_path / name, suffix=f".part{Path(name).suffix}" if name == "out.mp4" else ".part").name
    (tmp_path / mine.replace(str(os.getpid()), str(dead))).write_text("half")
    (tmp_path / f".other.{dead}.part").write_text("not ours")
    WRITERS[name](tmp_path / name)
    assert names(tmp_path) == {name, f".other.{dead}.part"}


@pytest.mark.parametrize("name", [n + "." + w for w in ("json", "jsonl", "mp4") for n in ("道" * 80, "a" * 249)])
def test_names_as_long_as_the_system_allows(tmp_path, name):
    name = name if len(os.fsencode(name)) <= 255 else name[-255:]
    WRITERS[f"out{Path(name).suffix}"](tmp_path / name)
    assert names(tmp_path) == {name}


def test_a_video_that_cannot_get_its_name_gets_another(tmp_path):
    path = tmp_path / "out.mp4"
    with pytest.raises(LanelibError) as error, VideoWriter(path, preset="ultrafast") as writer:
        writer.write(clips.picture(0, (64, 48)))
        path.mkdir()
        (path / "full").write_text("a folder came between")
    assert "kept as" in str(error.value) and "\n" not in str(error.value)
    assert names(tmp_path) == {"out.mp4", "out-2.mp4"}


def test_rows_are_the_same_bytes_on_every_system(tmp_path, monkeypatch):
    """Python's own writer of texts ends lines as os.linesep says."""
    with monkeypatch.context() as windows:
        windows.setattr("os.linesep", "\r\n")
        windows.setattr("io.open", _pyio.open)
        write_rows(tmp_path / "lanes.jsonl")
    assert (tmp_path / "lanes.jsonl").read_bytes() == b'{"a": 1}\n'


def test_rows_that_cannot_be_removed_hide_no_error(tmp_path, monkeypatch):
    """As on Windows, while somebody has them open."""

    def refused(path, missing_ok=False):
        raise PermissionError(13, "used by another process", str(path))

    with monkeypatch.context() as windows, pytest.raises(ZeroDivisionError), json_lines(tmp_path / "lanes.jsonl"):
        windows.setattr(Path, "unlink", refused)
        raise ZeroDivisionError


def test_rows_that_were_whole_are_kept_where_the_file_cannot_be(tmp_path):
    """An error in the middle, no rows at all, a place that has become a folder, a row cut off by a full disk."""
    path, kept = tmp_path / "lanes.jsonl", tmp_path / "lanes.partial.jsonl"
    path.write_text("from before")
    with pytest.raises(ZeroDivisionError) as caught, json_lines(path) as write_row:
        write_row({"raw_file": "a"})
        raise ZeroDivisionError
    assert caught.value.__notes__ == [f"the rows so far are in {kept}"] and path.read_text() == "from before"
    assert kept.read_text() == '{"raw_file": "a"}\n'
    kept.unlink()
    with pytest.raises(ZeroDivisionError) as caught, json_lines(path):
        raise ZeroDivisionError
    assert not hasattr(caught.value, "__notes__") and names(tmp_path) == {"lanes.jsonl"}
    path.unlink()
    with pytest.raises(LanelibError, match="needed a place") as caught, json_lines(path) as write_row:
        write_row({"raw_file": "a"})
        path.mkdir()
    assert caught.value.__notes__ and kept.read_text() == '{"raw_file": "a"}\n'
    part_of(path).write_text('{"raw_file": "b"}\n{"raw_')
    assert _keep_rows(part_of(path), path) == kept and kept.read_text() == '{"raw_file": "b"}\n'
