"""The campaigns of tools/ in small: commands interrupted, a looped clip; and the functions of the report itself."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("the campaigns send signals of Unix", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

import interrupts  # noqa: E402
import longrun  # noqa: E402
import reliability  # noqa: E402

linux = pytest.mark.skipif(sys.platform != "linux", reason="signals, and processes by their command lines")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("interrupts")
    interrupts.prepare(folder)
    return folder


# ---------------------------------------------------------------------------------------------- signals
@linux
@pytest.mark.parametrize("name", interrupts.COMMANDS)
def test_a_command_interrupted_in_the_middle(place, name):
    """Ctrl-C, SIGTERM and SIGKILL, one after the other; then it runs through and takes away what SIGKILL left."""
    found = interrupts.Found()
    with interrupts.SlowServer() as server:
        for number, after_s in ((signal.SIGKILL, 0.5), (signal.SIGTERM, 0.4), (signal.SIGINT, 0.6)):
            interrupts.interrupt(name, number, after_s, place, server, found)
        interrupts.run_through(name, place, server, found)
    assert not found.wrong and found.injected
    assert not interrupts.unfinished(place) and not interrupts.left_behind(place)


@linux
def test_ctrl_c_in_the_first_moment_is_one_line(place):
    """While OpenCV is still being loaded, which takes a second on a slow machine."""
    found = interrupts.Found()
    with interrupts.SlowServer() as server:
        for after_s in (0.0, 0.05, 0.1):
            interrupts.interrupt("image", signal.SIGINT, after_s, place, server, found)
    assert not found.wrong and found.injected == 3


def test_the_command_line_answers_before_opencv_is_loaded():
    program = "import sys, lanelib.cli; assert not {'cv2', 'numpy', 'argparse'} & {*sys.modules}"
    subprocess.run([sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)


def test_what_is_not_whole_is_seen(tmp_path):
    """The judge of the campaign itself: it must see a half file under its final name."""
    interrupts.prepare(tmp_path)
    assert all(interrupts.whole(path, tmp_path) for path in tmp_path.rglob("*"))
    for name in ("road0.png", "rig.json", "road.mp4"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        assert not interrupts.whole(tmp_path / name, tmp_path), name
    (tmp_path / "rows.jsonl").write_text('{"a": 1}\n{"a"')
    (tmp_path / "empty.md").write_text("")
    assert not interrupts.whole(tmp_path / "rows.jsonl", tmp_path)
    assert not interrupts.whole(tmp_path / "empty.md", tmp_path)


# ---------------------------------------------------------------------------------------------- the long clip
def test_a_looped_clip_keeps_frames_times_and_memory(tmp_path):
    """Four loops: every frame at its place, its time and with its number, a row of each; the sound is kept."""
    run = longrun.long_run(reliability.lanelib, tmp_path, 4 * longrun.LOOP / 25 / 3600)
    assert run.frames == 1024 and not run.faults(), run.faults()
    assert 0.7 * run.frames < run.measured < 0.96 * run.frames
    text = run.markdown("x")
    assert "1,024 rows in order" in text and "Faults: none." in text


@pytest.mark.parametrize("change, words", [
    ({"rows": 99}, "99 rows"), ({"in_order": 99}, "in order"), ({"written": 101}, "101 of 100"),
    ({"code": 2}, "code 2"),
    ({"misplaced": 1}, "not the frame"), ({"worst_time_ms": 0.5}, "0.500 ms"), ({"sound_off_s": 1.0}, "sound off"),
    ({"said": "lanelib: damaged"}, "damaged"), ({"worst_time_ms": float("nan")}, "nan"),
])
def test_a_fault_of_the_long_clip_is_named(change, words):
    good = {"frames": 100, "fps": 25, "rows": 100, "in_order": 100, "written": 100, "code": 0, "misplaced": 0,
            "worst_time_ms": 0.01, "sound_off_s": 0.0}
    assert not longrun.LongRun(**good).faults()
    faults = longrun.LongRun(**good | change).faults()
    assert len(faults) == 1 and words in faults[0]


# ---------------------------------------------------------------------------------------------- the report
def test_a_section_is_exchanged_and_the_others_stay():
    report = "# R\n\nhead\n\n## A\n\na\n\n## B\n\nb\n\n## Z\n\nz\n"
    with_b = reliability.with_section(report, "## B\n\nnew\n")
    assert with_b == report.replace("b\n", "new\n", 1)
    with_c = reliability.with_section(report, "## C\n\nc\n")
    assert with_c == report + "\n## C\n\nc\n"


def test_the_report_is_whole_and_found_nothing():
    own = reliability.sections(reliability.REPORT.read_text(encoding="utf-8"))
    assert list(own) == [reliability.BAD, reliability.MID, reliability.LONG]
    for text in own.values():
        assert "Written by `python tools/reliability.py" in text and text.rstrip().endswith("Faults: none.")
