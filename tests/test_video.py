"""Reading, writing and processing video, on clips whose every frame carries its number."""

import io
import os
import runpy
import signal
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import clips
import cv2
import numpy as np
import psutil
import pytest

from lanelib import ffmpeg, matroska
from lanelib.datasets import project_root
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, Rig
from lanelib.pipeline import ProgressBar, process_video
from lanelib.runs import run_video
from lanelib.video import VideoWriter, _ReadingLog, probe, read_frames

ROOT = Path(__file__).resolve().parents[1]
posix = pytest.mark.skipif(os.name == "nt", reason="signals, pipes and limits of Unix")


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """20 frames, 25 a second, 160x96."""
    return clips.clip(tmp_path_factory.mktemp("clips") / "plain.mp4")


@pytest.fixture(autouse=True)
def no_process_left():
    """No test may leave an ffmpeg or a thread of this package behind."""
    yield
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        left = [p for p in psutil.Process().children(recursive=True) if "ffmpeg" in p.name()]
        threads = [t.name for t in threading.enumerate() if t.name in ("ffmpeg-log", "decode", "encode")]
        if not left and not threads:
            return
        time.sleep(0.05)
    pytest.fail(f"left behind: {left}, {threads}")


def numbers(path: Path, **options) -> list[int]:
    with read_frames(path, **options) as frames:
        return [clips.frame_number(frame.frame_bgr) for frame in frames]


def one_line(error: pytest.ExceptionInfo, *words: str) -> None:
    text = str(error.value)
    assert "\n" not in text and len(text) < 400
    for word in words:
        assert word in text


def test_probe_asks_again_only_about_another_version_of_the_file(tmp_path, monkeypatch):
    asked = []
    run = ffmpeg._run
    monkeypatch.setattr(ffmpeg, "_run", lambda *arguments: asked.append(arguments) or run(*arguments))
    path = clips.clip(tmp_path / "a.mp4", n_frames=5, size_wh=(128, 64))
    assert probe(path) == probe(str(path)) and probe(path).size_wh == (128, 64)
    assert len(asked) == 1
    clips.clip(path, n_frames=9, size_wh=(64, 128))
    assert probe(path).size_wh == (64, 128) and len(asked) == 2
    path.unlink()
    with pytest.raises(LanelibError, match="found nothing there"):
        probe(path)


# --- probe ---------------------------------------------------------------------------------------------------------


def test_probe_says_what_the_file_says(tmp_path):
    path = clips.clip(tmp_path / "a.mp4", n_frames=33, size_wh=(128, 64), fps=30000 / 1001, audio_s=1.0)
    info = probe(path)
    assert info.size_wh == (128, 64) and info.codec == "h264" and info.has_audio and info.audio_codec == "aac"
    assert info.fps == pytest.approx(30000 / 1001, rel=1e-9)
    assert info.duration_s == pytest.approx(33 * 1001 / 30000, abs=0.02)
    assert abs(info.n_frames - 33) <= 1 and not info.n_frames_exact
    exact = probe(path, exact=True)
    assert exact.n_frames == 33 and exact.n_frames_exact
    assert "128x64" in str(exact) and "33 frames" in str(exact) and "about" not in str(exact)


@pytest.mark.parametrize("printed, rate", [
    (25.0, Fraction(25)), (29.97, Fraction(30000, 1001)), (12.5, Fraction(25, 2)), (23.98, Fraction(24000, 1001)),
    (59.94, Fraction(60000, 1001)), (30.0, Fraction(30)), (24.0, Fraction(24)),
])
def test_the_rate_behind_a_rounded_figure(printed, rate):
    assert ffmpeg.exact_rate(printed) == rate


def test_probe_measures_the_rate_where_the_header_misleads(tmp_path):
    times_ms = [0, 40, 50, 200, 1000, 1033]
    path = clips.variable_rate(tmp_path / "v.mkv", times_ms)  # the header says 1000 frames a second
    info = probe(path, exact=True)
    assert info.n_frames == 6 and info.fps == pytest.approx(5 / 1.033, rel=1e-6)


@posix
def test_probe_errors_are_one_line_each(tmp_path):
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.mp4").write_text("no video\n" * 200)
    (tmp_path / "list.mp4").write_text(f"#EXTM3U\n#EXTINF:1,\nfile:{clips.clip(tmp_path / 'real.mp4')}\n")
    cv2.imwrite(str(tmp_path / "picture.jpg"), np.zeros((20, 20, 3), np.uint8))
    os.mkfifo(tmp_path / "pipe.mp4")
    cut = clips.clip(tmp_path / "whole.mp4", n_frames=10).read_bytes()  # the index is at the end
    (tmp_path / "cut.mp4").write_bytes(cut[: len(cut) // 2])
    clips.audio_only(tmp_path / "sound.mp4")
    clips.no_frames(tmp_path / "none.mp4")
    for name, word in [("missing.mp4", "nothing there"), (".", "directory"), ("empty.mp4", "empty"),
                       ("text.mp4", "else"), ("list.mp4", "else"), ("picture.jpg", "else"), ("pipe.mp4", "pipe"),
                       ("cut.mp4", "index is missing"), ("sound.mp4", "only sound"),
                       ("none.mp4", "without a single frame")]:
        with pytest.raises(LanelibError) as error:
            probe(tmp_path / name)
        one_line(error, word, str(tmp_path))


def test_a_frame_above_the_stated_size_is_refused(tmp_path, plain, monkeypatch):
    monkeypatch.setattr(ffmpeg, "MAX_MEGAPIXELS", 0.01)
    with pytest.raises(LanelibError) as error:
        probe(plain)
    one_line(error, "160x96", "0.01 megapixels")


def test_corrupted_bytes_of_a_file_never_raise_anything_else(tmp_path):
    whole = clips.clip(tmp_path / "whole.mp4", n_frames=6, size_wh=(64, 48)).read_bytes()
    rng = np.random.default_rng(5)
    outcomes = set()
    for trial in range(25):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 1 + trial):
            data[at] = rng.integers(256)
        path = tmp_path / "fuzzed.mp4"
        path.write_bytes(bytes(data[: rng.integers(1, len(data)) if trial % 5 == 0 else len(data)]))
        try:
            with read_frames(path) as frames:
                outcomes.add(sum(1 for _ in frames) > 0)
        except LanelibError as error:
            assert "\n" not in str(error)
            outcomes.add(False)
    assert outcomes == {True, False}


# --- reading -------------------------------------------------------------------------------------------------------


def test_every_frame_once_in_order_with_its_time(plain):
    with read_frames(plain) as frames:
        read = list(frames)
    assert [f.index for f in read] == list(range(20))
    assert [clips.frame_number(f.frame_bgr) for f in read] == list(range(20))
    assert [f.time_s for f in read] == pytest.approx([i / 25 for i in range(20)])
    assert read[0].frame_bgr.shape == (96, 160, 3) and read[0].frame_bgr.dtype == np.uint8
    assert not frames.damage and str(frames.damage) == "no damage"
    assert list(frames) == []


def test_the_same_pictures_as_opencv_reads(plain):
    capture = cv2.VideoCapture(str(plain))
    for frame in read_frames(plain):
        ok, expected = capture.read()
        assert ok and np.abs(frame.frame_bgr.astype(int) - expected).max() <= 2
    capture.release()


def test_colours_are_bgr(plain):
    frame = next(iter(read_frames(plain)))
    np.testing.assert_allclose(frame.frame_bgr[70:90, 2:6].mean(axis=(0, 1)), (30, 60, 220), atol=25)


@pytest.mark.parametrize("pixel_format, code", [("yuv420p", cv2.COLOR_YUV2BGR_I420), ("nv12", cv2.COLOR_YUV2BGR_NV12)])
def test_planes_hold_the_same_picture(plain, pixel_format, code):
    for planes, bgr in zip(read_frames(plain, pixel_format=pixel_format), read_frames(plain), strict=True):
        assert planes.frame_bgr.shape == (144, 160)
        difference = cv2.cvtColor(planes.frame_bgr, code).astype(int) - bgr.frame_bgr
        assert np.abs(difference).mean() < 2.5


def test_variable_frame_rate_keeps_its_times(tmp_path):
    times_ms = [0, 40, 50, 200, 1000, 1033]
    for name in ("v.mkv", "v.mp4"):
        with read_frames(clips.variable_rate(tmp_path / name, times_ms)) as frames:
            read = [(clips.frame_number(f.frame_bgr), f.time_s) for f in frames]
        assert [n for n, _ in read] == list(range(6))
        assert [t for _, t in read] == pytest.approx([t / 1000 for t in times_ms], abs=1e-6)


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".ts"])  # .ts starts at 1.4 s
@pytest.mark.parametrize("start_s, end_s", [(0.2, None), (0.2, 0.6), (0.21, 0.59), (0, 0.36), (0.76, 9), (0.72, 0.75),
                                            (0.001, 0.04)])
def test_a_section_holds_exactly_its_frames(plain, tmp_path, start_s, end_s, suffix):
    path = tmp_path / f"a{suffix}"
    clips.ffmpeg("-i", plain, "-c", "copy", path)
    expected = [i for i in range(20) if start_s <= i / 25 < (end_s or 99)]
    with read_frames(path, start_s=start_s, end_s=end_s) as frames:
        read = list(frames)
    assert [clips.frame_number(f.frame_bgr) for f in read] == expected
    assert [f.index for f in read] == expected
    assert [f.time_s for f in read] == pytest.approx([i / 25 for i in expected], abs=1e-5)


def test_a_section_that_is_not_numbered_is_not_looked_for(plain, monkeypatch):
    monkeypatch.setattr("lanelib.video.packet_times", None)
    with read_frames(plain, start_s=0.4, numbered=False) as frames:
        assert [(f.index, clips.frame_number(f.frame_bgr)) for f in frames] == [(i, 10 + i) for i in range(10)]


@pytest.mark.parametrize("start_s, end_s", [(-1, None), (0.5, 0.5), (2, 1), (0.8, None), (50, None)])
def test_a_section_that_cannot_be(plain, start_s, end_s):
    with pytest.raises(LanelibError) as error:
        read_frames(plain, start_s=start_s, end_s=end_s)
    one_line(error, "start")


def test_times_of_a_long_file_are_exact(tmp_path):
    """Two hours into a file, where six digits of seconds would have lost the milliseconds."""
    path = clips.clip(tmp_path / "late.mkv", n_frames=4, options=["-output_ts_offset", 7200.04])
    sound = tmp_path / "two.mkv"
    clips.ffmpeg("-f", "lavfi", "-t", 0.5, "-i", "sine", "-i", path, "-copyts", "-map", 0, "-map", 1,
                 "-c:v", "copy", "-c:a", "aac", sound)
    with read_frames(sound) as frames:
        assert [f.time_s for f in frames] == pytest.approx([7200.04 + i / 25 for i in range(4)], abs=1.1e-3)


def test_one_frame(tmp_path):
    assert numbers(clips.clip(tmp_path / "one.mp4", n_frames=1)) == [0]


def test_ten_bit(tmp_path):
    assert numbers(clips.clip(tmp_path / "ten.mp4", pix_fmt="yuv420p10le")) == list(range(20))


def test_rotation_is_applied(tmp_path):
    path = clips.rotated(tmp_path / "up.mp4")
    info = probe(path)
    assert info.size_wh == (96, 160) and info.rotation_deg == 90
    with read_frames(path) as frames:
        read = [cv2.rotate(f.frame_bgr, cv2.ROTATE_90_CLOCKWISE) for f in frames]
    assert [clips.frame_number(f) for f in read] == list(range(20))


def test_pixels_that_are_not_square_are_made_so(tmp_path):
    """720 x 576 as television has it, for a wide picture and for a narrow one; a ratio that rounds away is none."""
    for sar, shown in {"64/45": (1024, 576), "1/2": (720, 1152), "719/720": (720, 576)}.items():
        path = clips.clip(tmp_path / "tv.mp4", n_frames=3, size_wh=(720, 576), options=["-vf", f"setsar={sar}"])
        assert probe(path).size_wh == shown
        with read_frames(path) as frames:
            first = next(frames).frame_bgr
        assert first.shape[1::-1] == shown and clips.frame_number(first) == 0


@pytest.mark.parametrize("pixel_format", ["yuv420p", "nv12"])
def test_full_range_comes_as_video_range(tmp_path, pixel_format):
    """Cameras that store Y as 0..255: the planes are those of the same picture stored as 16..235."""
    read = {}
    for name, options in {"pc": ["-vf", "scale=out_range=pc"], "tv": []}.items():
        path = clips.clip(tmp_path / f"{name}.mkv", n_frames=2, codec="ffv1", options=[*options, "-color_range", name])
        with read_frames(path, pixel_format=pixel_format) as frames:
            read[name] = next(frames).frame_bgr.astype(int)
    assert np.abs(read["pc"] - read["tv"])[:96].max() <= 3 and read["tv"][:96].max() > 150


def test_odd_size(tmp_path):
    path = clips.odd(tmp_path / "odd.mp4")
    bgr = next(iter(read_frames(path))).frame_bgr
    assert bgr.shape == (97, 161, 3)
    planes = next(iter(read_frames(path, pixel_format="yuv420p"))).frame_bgr
    assert planes.shape == (98 * 3 // 2, 162)
    np.testing.assert_array_equal(planes[:97, 161], planes[:97, 160])
    np.testing.assert_array_equal(planes[97, :162], planes[96, :162])


def test_a_size_that_changes_is_scaled_to_the_first_and_said(tmp_path):
    path = clips.changing_size(tmp_path / "size.h264")
    with read_frames(path) as frames:
        read = list(frames)
    assert [f.frame_bgr.shape for f in read] == [(96, 160, 3)] * 20
    assert [clips.frame_number(f.frame_bgr) for f in read] == [*range(10), *range(10)]
    assert "from 160x96 to 128x64" in str(frames.damage)


def test_names_that_look_like_options_or_addresses(tmp_path, plain, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("-i.mp4", "with space.mp4", "straße 道路.mp4", "http:x.mp4", "%03d.mp4", "a|b.mp4"):
        Path(name).write_bytes(plain.read_bytes())
        assert numbers(Path(name)) == list(range(20))
        with VideoWriter(Path(name).with_suffix(".m4v")) as writer:
            writer.write(clips.picture(3, (64, 48)))
        assert numbers(Path(name).with_suffix(".m4v")) == [3]


# --- damage --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cut.mp4", "cut.mkv", "cut.avi"])
@pytest.mark.parametrize("audio_s", [0, 1.6])
def test_a_truncated_file_yields_its_frames_and_says_so(tmp_path, name, audio_s):
    if name == "cut.avi" and audio_s:
        pytest.skip("an AVI without its index says nothing about its length, and sound may go on after the pictures")
    path = clips.truncated(tmp_path / name, keep=0.45, audio_s=audio_s)
    with read_frames(path) as frames:
        read = [clips.frame_number(f.frame_bgr) for f in frames]
    assert 3 <= len(read) < 38
    assert read[:-1] == list(range(len(read) - 1))
    assert frames.damage.truncated and "cut off" in str(frames.damage)
    with read_frames(path) as frames:  # the judgement stays when the block ends
        seen = sum(1 for _ in frames), frames.damage
    assert seen == (len(read), frames.damage) and frames.damage.truncated
    whole = tmp_path / f"whole_{name}"
    with read_frames(whole) as frames:
        assert len(list(frames)) == 38
    assert not frames.damage


def test_corrupt_packets_are_skipped_and_counted(tmp_path):
    path = clips.corrupt(tmp_path / "bad.mp4")
    with read_frames(path) as frames:
        read = [(f.index, f.time_s) for f in frames]
    damage = frames.damage
    assert damage.corrupt_frames > 0 and damage.lost_packets > 0 and damage.messages
    assert len(read) + damage.lost_packets == 40
    assert not damage.truncated
    assert read[-1][1] == pytest.approx(39 / 25)  # the times of those that are left have not moved
    assert "lost" in str(damage) and "\n" not in str(damage)


def test_a_file_shorter_than_its_header_says(plain):
    with read_frames(plain) as frames:
        frames.info = replace(frames.info, duration_s=1.0)  # it has 0.8 s, and ffmpeg finds nothing wrong
        assert len(list(frames)) == 20
    assert frames.damage.truncated


def test_a_last_frame_shown_for_long_is_no_cut(tmp_path):
    """Ten slides, the last one for three seconds: nothing is missing."""
    path = clips.clip(tmp_path / "slides.mp4", n_frames=10)
    slow = tmp_path / "slow.mp4"
    clips.ffmpeg("-i", path, "-c", "copy", "-bsf:v", "setts=duration='if(eq(N,9),38400,DURATION)'", slow)
    assert probe(slow).duration_s > 3
    with read_frames(slow) as frames:
        assert len(list(frames)) == 10
    assert not frames.damage


def test_a_decoder_that_is_killed_is_no_end(tmp_path):
    """As by a system that is out of memory; beside a sound track nothing else would tell."""
    path = clips.clip(tmp_path / "long.mp4", n_frames=200, size_wh=(640, 360), audio_s=8)
    with read_frames(path) as frames:
        next(frames)
        frames._process.kill()
        assert len(list(frames)) < 199
    assert frames.damage.truncated and "ended" in str(frames.damage)


def test_messages_in_the_middle_of_other_lines_are_seen():
    """ffmpeg's threads write to stderr at once; what one writes in pieces another may interrupt, without a prefix."""
    said = (b"[info] Stream mapping:\n[Parsed_showinfo_0 @ 0x1] [info] config in time_base: 1/25, frame_rate: 25/1\n"
            b"[Parsed_showinfo_0 @ 0x1] [info] n:   0 pts:      3 pts_time:0.12 fmt:yuv420p s:160x96 i:P "
            b"File ended prematurely\n\n[Parsed_showinfo_0 @ 0x1] [info] color_range:tvcorrupt decoded frame\n"
            b"[Parsed_showinfo_0 @ 0x1] [info] color_space:x[d @ 0x2] [error] Error submitting packet to decoder: no\n")
    log = _ReadingLog(io.BytesIO(said))
    log.thread.join()
    damage = log.damage(truncated=False)
    assert log.next_time() == pytest.approx(0.12)
    assert (damage.truncated, damage.corrupt_frames, damage.lost_packets) == (True, 1, 1)
    assert damage.messages == ("Error submitting packet to decoder: no",)


def test_a_file_of_which_nothing_decodes(tmp_path):
    whole = clips.clip(tmp_path / "whole.mp4")
    data = bytearray(whole.read_bytes())
    start, end = data.find(b"mdat") + 4, data.rfind(b"moov") - 4
    data[start:end] = b"\xff" * (end - start)
    (tmp_path / "bad.mp4").write_bytes(data)
    with pytest.raises(LanelibError) as error:
        numbers(tmp_path / "bad.mp4")
    one_line(error, "bad.mp4", "none")


# --- leaving nothing behind ----------------------------------------------------------------------------------------


def test_stopping_early_ends_ffmpeg(tmp_path):
    path = clips.clip(tmp_path / "long.mp4", n_frames=250, size_wh=(320, 192))
    with read_frames(path) as frames:
        next(frames)
        process = frames._process
    assert process.returncode is not None
    with pytest.raises(RuntimeError, match="mine"), read_frames(path) as frames:
        for _ in frames:
            raise RuntimeError("mine")
    assert frames._process.returncode is not None
    for _ in read_frames(path):  # no with block, not exhausted: the garbage collector ends it
        break


# --- writing -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size_wh, fps", [((160, 96), 30000 / 1001), ((161, 97), 25), ((160, 97), 12.5),
                                          ((320, 180), 50)])
def test_what_is_written_is_read_back(tmp_path, size_wh, fps):
    path = tmp_path / "out.mp4"
    with VideoWriter(path, size_wh=size_wh, fps=fps) as writer:
        for i in range(12):
            writer.write(clips.picture(i, size_wh))
        assert not path.exists()
    info = probe(path, exact=True)
    assert info.size_wh == (size_wh[0] + size_wh[0] % 2, size_wh[1] + size_wh[1] % 2)
    assert info.n_frames == 12 and info.fps == pytest.approx(fps, rel=1e-9) and info.codec == "h264"
    with read_frames(path) as frames:
        for i, frame in enumerate(frames):
            assert clips.frame_number(frame.frame_bgr) == i
            assert frame.time_s == pytest.approx(i / fps, abs=2e-6)
            cropped = frame.frame_bgr[: size_wh[1], : size_wh[0]].astype(int)  # padded right and below: nothing moved
            assert np.abs(cropped - clips.picture(i, size_wh)).mean() < 5
            padding = frame.frame_bgr[:, size_wh[0] - 1 :].astype(int)  # the last column and, if any, its copy
            assert np.abs(padding[:, -1] - padding[:, 0]).mean() < 5
    assert os.listdir(tmp_path) == ["out.mp4"]
    data = path.read_bytes()
    assert data.find(b"moov") < data.find(b"mdat")  # plays while it loads
    said = clips.ffmpeg("-i", path, "-f", "null", "-")
    assert "yuv420p(tv, bt709" in said


def test_given_times_are_kept(tmp_path):
    times_s = [0.0, 0.04, 0.05, 0.2, 1.0, 1.0333, 1.0333, 0.5]  # the last two stand still and go back
    with VideoWriter(tmp_path / "v.mp4") as writer:
        for i, time_s in enumerate(times_s):
            writer.write(clips.picture(i, (160, 96)), time_s=time_s)
    with read_frames(tmp_path / "v.mp4") as frames:
        read = list(frames)
    assert [clips.frame_number(f.frame_bgr) for f in read] == list(range(8))
    assert [f.time_s for f in read[:6]] == pytest.approx(times_s[:6], abs=2e-5)
    assert read[5].time_s < read[6].time_s < read[7].time_s < 1.04


def test_pictures_that_begin_after_the_sound_stay_where_they_are(tmp_path):
    source = clips.clip(tmp_path / "in.mp4", audio_s=1.0)
    with VideoWriter(tmp_path / "out.mp4", audio_from=source) as writer:
        for i in range(5):
            writer.write(clips.picture(i, (160, 96)), time_s=0.4 + i / 25)
    with read_frames(tmp_path / "out.mp4") as frames:
        assert [f.time_s for f in frames] == pytest.approx([0.4 + i / 25 for i in range(5)], abs=1e-4)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "nv12"])
def test_planes_go_through_unchanged(tmp_path, plain, pixel_format):
    with read_frames(plain, pixel_format=pixel_format) as frames:
        planes = [f.frame_bgr for f in frames]
    with VideoWriter(tmp_path / "out.mp4", pixel_format=pixel_format, crf=0) as writer:  # crf 0 is lossless
        for frame in planes:
            writer.write(frame)
    with read_frames(tmp_path / "out.mp4", pixel_format=pixel_format) as frames:
        for frame, expected in zip(frames, planes, strict=True):
            np.testing.assert_array_equal(frame.frame_bgr, expected)


@pytest.mark.parametrize("name, codec", [("a.mp4", "aac"), ("p.avi", "pcm_s16le")])
def test_the_sound_is_kept(tmp_path, name, codec):
    source = clips.clip(tmp_path / name, audio_s=0.8, audio_codec=codec)
    assert process_video(source, lambda f, i, t: f, output=tmp_path / "out.mp4").frames_out == 20
    assert probe(tmp_path / "out.mp4").audio_codec == "aac"
    process_video(source, lambda f, i, t: f, output=tmp_path / "out.mp4", audio=False)
    assert not probe(tmp_path / "out.mp4").has_audio


def test_output_names_that_cannot_be(tmp_path, plain):
    os.symlink(plain, tmp_path / "link.mp4")
    before = plain.read_bytes()
    for path, word in [(tmp_path / "no" / "a.mp4", "folder"), (tmp_path / "a.txt", ".mp4"), (plain, "same"),
                       (tmp_path / "link.mp4", "same")]:
        with pytest.raises(LanelibError) as error:
            process_video(plain, lambda f, i, t: f, output=path)
        one_line(error, word)
    assert plain.read_bytes() == before


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tmp_path, plain):
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(LanelibError) as error:
        process_video(plain, lambda f, i, t: f, output=tmp_path / "locked" / "a.mp4")
    one_line(error, "permission")


def test_bad_frames_are_refused_and_nothing_stays(tmp_path):
    for first, second in [(clips.picture(0, (64, 48)), clips.picture(0, (48, 64))), (np.zeros((4, 4)), None),
                          (np.zeros((4, 4, 4), np.uint8), None), (np.zeros((4, 4, 3)), None)]:
        with pytest.raises(LanelibError) as error, VideoWriter(tmp_path / "a.mp4") as writer:
            writer.write(first)
            writer.write(second)
        one_line(error, "shape")
    with pytest.raises(LanelibError, match="at least one frame"), VideoWriter(tmp_path / "a.mp4"):
        pass
    for options in ({"preset": "warp"}, {"fps": 0}, {"pixel_format": "rgb"}):
        with pytest.raises(LanelibError) as error, VideoWriter(tmp_path / "a.mp4", **options) as writer:
            writer.write(clips.picture(0, (64, 48)))
        one_line(error)
    assert os.listdir(tmp_path) == []


def test_white_stays_white(tmp_path):
    with VideoWriter(tmp_path / "white.mp4", crf=1) as writer:
        writer.write(np.full((96, 160, 3), 255, np.uint8))
    with read_frames(tmp_path / "white.mp4", pixel_format="yuv420p") as frames:
        assert {*np.unique(next(frames).frame_bgr[:96])} == {235}


@pytest.mark.parametrize("suffix", ["mp4", "m4v", "mov"])
@pytest.mark.parametrize("codec", ["libopus", "flac", "libmp3lame"])
def test_sound_fits_the_container(tmp_path, suffix, codec):
    source = clips.clip(tmp_path / "in.mkv", audio_s=0.8, audio_codec=codec)
    process_video(source, lambda frame, *_: frame, output=tmp_path / f"out.{suffix}")
    assert probe(tmp_path / f"out.{suffix}").has_audio


def test_an_old_output_survives_a_failed_run(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"yesterday's")
    with pytest.raises(KeyError), VideoWriter(path) as writer:
        writer.write(clips.picture(0, (64, 48)))
        raise KeyError
    assert path.read_bytes() == b"yesterday's" and os.listdir(tmp_path) == ["a.mp4"]


def test_what_cannot_be_removed_hides_no_error(tmp_path, monkeypatch):
    """As on Windows, while a scanner for viruses looks at it; the next run takes it away."""

    def refused(path, missing_ok=False):
        raise PermissionError(13, "used by another process", str(path))

    with monkeypatch.context() as windows, pytest.raises(KeyError), VideoWriter(tmp_path / "a.mp4") as writer:
        windows.setattr(Path, "unlink", refused)
        writer.write(clips.picture(0, (64, 48)))
        raise KeyError


def test_on_windows_ctrl_c_is_pythons_alone_and_no_console_flashes_up(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(subprocess, "CREATE_NO_WINDOW", 0x08000000, raising=False)
    assert runpy.run_path(ffmpeg.__file__)["POPEN_OPTIONS"] == {"creationflags": 0x08000000}


def run_python(code: str, *arguments: object) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-W", "error", "-c", textwrap.dedent(code), *map(str, arguments)],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            env={**os.environ, "PYTHONPATH": str(ROOT)})


@posix
def test_disk_full_says_why(tmp_path):
    """A limit on the size of written files stands for a full disk: it needs no other file system."""
    process = run_python("""
        import resource, signal, sys
        import numpy as np
        from lanelib.errors import LanelibError
        from lanelib import video_writer
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        video_writer.POPEN_OPTIONS["restore_signals"] = False  # ffmpeg gets an error, not the signal
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        rng = np.random.default_rng(0)
        try:
            with video_writer.VideoWriter(sys.argv[1]) as writer:
                for _ in range(60):
                    writer.write(rng.integers(0, 256, (240, 320, 3), np.uint8))
        except LanelibError as error:
            print(error)
    """, tmp_path / "big.mp4")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert out.count("\n") == 1 and "File too large" in out and "big.mp4" in out
    assert os.listdir(tmp_path) == []


@posix
@pytest.mark.parametrize("sent", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_killed_in_the_middle_nothing_has_the_final_name(tmp_path, sent):
    source = clips.clip(tmp_path / "in.mp4", n_frames=50)
    process = run_python("""
        import signal, sys, time
        from lanelib.pipeline import process_video
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
        def slow(frame, index, time_s):
            print(index, flush=True)
            time.sleep(0.1)
            return frame
        process_video(sys.argv[1], slow, output=sys.argv[2])
    """, source, tmp_path / "out.mp4")
    for line in process.stdout:
        if int(line) == 5:
            break
    children = psutil.Process(process.pid).children(recursive=True)
    assert any("ffmpeg" in child.name() for child in children)
    process.send_signal(signal.Signals[sent])
    err = process.communicate(timeout=30)[1]
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
    assert not (tmp_path / "out.mp4").exists()
    if sent == "SIGINT":  # Python could clean up
        assert err.count("KeyboardInterrupt") == 1
        assert sorted(os.listdir(tmp_path)) == ["in.mp4"]


# --- decode, process, encode ---------------------------------------------------------------------------------------


def test_order_count_and_times(tmp_path):
    times_ms = [0, 40, 50, 200, 1000, 1033, 1100, 1200, 1300, 1400, 1500, 1600]
    source = clips.variable_rate(tmp_path / "in.mkv", times_ms)
    calls, progress = [], []

    def inverted(frame, index, time_s):
        calls.append((index, time_s))
        return 255 - frame

    summary = process_video(source, inverted, output=tmp_path / "out.mp4",
                            on_progress=lambda done, expected: progress.append((done, expected)))
    assert summary.frames_in == summary.frames_out == 12 and not summary.damage
    assert [t for _, t in calls] == pytest.approx([t / 1000 for t in times_ms])
    assert [done for done, _ in progress] == list(range(1, 13))
    with read_frames(tmp_path / "out.mp4") as frames:
        read = list(frames)
    assert [255 - clips.frame_number(f.frame_bgr) for f in read] == list(range(12))
    assert [f.time_s for f in read] == pytest.approx([t / 1000 for t in times_ms], abs=2e-3)
    assert "12 frames" in str(summary) and "out.mp4" in str(summary)


def test_a_section_starts_at_zero_and_keeps_its_part_of_the_sound(tmp_path):
    source = clips.clip(tmp_path / "in.mp4", n_frames=50, audio_s=2.0)
    summary = process_video(source, lambda f, i, t: f, output=tmp_path / "out.mp4", start_s=0.4, end_s=1.2)
    assert summary.frames_out == 20
    with read_frames(tmp_path / "out.mp4") as frames:
        read = [(clips.frame_number(f.frame_bgr), f.time_s) for f in frames]
    assert [n for n, _ in read] == list(range(10, 30))
    assert [t for _, t in read] == pytest.approx([i / 25 for i in range(20)], abs=1e-4)
    info = probe(tmp_path / "out.mp4")
    assert info.has_audio and info.duration_s == pytest.approx(0.8, abs=0.06)


def test_frames_for_which_nothing_is_returned_are_left_out(tmp_path, plain):
    summary = process_video(plain, lambda f, i, t: f if i % 2 else None, output=tmp_path / "out.mp4")
    assert (summary.frames_in, summary.frames_out) == (20, 10)
    assert numbers(tmp_path / "out.mp4") == list(range(1, 20, 2))


def test_without_output_nothing_is_written(tmp_path, plain):
    seen = []
    summary = process_video(plain, lambda f, i, t: seen.append(i), pixel_format="yuv420p")
    assert seen == list(range(20)) and summary.output is None and summary.frames_out == 0


@pytest.mark.parametrize("at", [0, 7, 19])
def test_an_exception_in_the_function_is_raised_once(tmp_path, plain, at):
    def fails(frame, index, time_s):
        if index == at:
            raise ZeroDivisionError("mine")
        return frame

    with pytest.raises(ZeroDivisionError, match="mine"):
        process_video(plain, fails, output=tmp_path / "out.mp4")
    assert os.listdir(tmp_path) == []


def test_an_exception_in_the_encoder_is_raised_once(tmp_path, plain):
    for function in (lambda f, i, t: f[:, : 160 - 2 * i], lambda f, i, t: "text", lambda f, i, t: f.astype(float)):
        with pytest.raises((LanelibError, AttributeError)):
            process_video(plain, function, output=tmp_path / "out.mp4")
    assert os.listdir(tmp_path) == []


def test_the_damage_of_the_source_is_in_the_summary(tmp_path):
    source = clips.truncated(tmp_path / "cut.mp4", keep=0.45)
    summary = process_video(source, lambda f, i, t: f, output=tmp_path / "out.mp4")
    assert summary.damage.truncated and "cut off" in str(summary)
    assert probe(tmp_path / "out.mp4", exact=True).n_frames == summary.frames_out < 38


def test_memory_does_not_grow_with_a_slow_function(tmp_path):
    """Back-pressure: a slow function holds the decoder back, so only a few frames exist at a time."""
    source = clips.clip(tmp_path / "in.mp4", n_frames=120, size_wh=(640, 480))
    alive, most = 0, 0
    real_empty = np.empty

    def counted(shape, dtype):
        nonlocal alive, most
        array = real_empty(shape, dtype)
        alive += 1
        most = max(most, alive)
        return array

    def slow(frame, index, time_s):
        nonlocal alive
        time.sleep(0.002)
        alive -= 1

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lanelib.video.np.empty", counted)
        process_video(source, slow)
    assert most <= 7


@posix
def test_two_thousand_frames_no_drift_and_constant_memory(tmp_path):
    import resource

    source = clips.clip(tmp_path / "short.mp4", n_frames=50, size_wh=(96, 64), fps=30000 / 1001)
    long = tmp_path / "long.mp4"
    clips.ffmpeg("-stream_loop", 39, "-i", source, "-c", "copy", long)
    peaks = []

    def watch(frame, index, time_s):
        assert abs(time_s - index * 1001 / 30000) < 0.002
        if index in (300, 1999):
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        return frame

    summary = process_video(long, watch, output=tmp_path / "out.mp4", preset="ultrafast")
    assert summary.frames_out == 2000 == probe(tmp_path / "out.mp4", exact=True).n_frames
    assert peaks[1] - peaks[0] < 5_000  # kB; 1700 frames would be 31 MB


def test_progress_bar_is_silent_where_nobody_looks(capfd, monkeypatch):
    with ProgressBar("clip", quiet=False) as bar:
        bar(1, 10)
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with ProgressBar("clip", quiet=True) as bar:
        bar(1, 10)
    assert capfd.readouterr().err == ""
    with ProgressBar("clip", quiet=False) as bar:
        for done in range(1, 13):
            bar(done, 10)
    assert "clip" in capfd.readouterr().err


# --- the framing ---------------------------------------------------------------------------------------------------


def test_matroska_header_is_what_ffmpeg_reads(tmp_path):
    """A file written by hand, described and decoded by ffmpeg."""
    size_wh = (62, 34)
    frames = [clips.picture(i, size_wh) for i in range(3)]
    data = matroska.file_header(size_wh, "bgr24", Fraction(10))
    for time_us, frame in zip((0, 100_000, 70_000_000_000), frames, strict=True):
        data += matroska.frame_header(time_us, frame.nbytes) + frame.tobytes()
    (tmp_path / "raw.mkv").write_bytes(data)
    with read_frames(tmp_path / "raw.mkv") as read:
        for frame, expected, time_s in zip(read, frames, (0, 0.1, 70_000), strict=True):
            np.testing.assert_array_equal(frame.frame_bgr, expected)
            assert frame.time_s == pytest.approx(time_s)
    assert read.info.fps == 10


# ------------------------------------------------------------------------------------ only a part of each frame
@pytest.mark.parametrize("size_wh", [(160, 96), (162, 98), (161, 97)])
@pytest.mark.parametrize("first_row", [2, 40, 94])
def test_rows_above_the_first_are_zeros_and_the_others_as_they_are(tmp_path, size_wh, first_row):
    path = clips.clip(tmp_path / "a.mkv", n_frames=4, size_wh=size_wh, pix_fmt="yuv444p", options=["-qp", 0])
    with read_frames(path, pixel_format="yuv420p") as whole, read_frames(
            path, pixel_format="yuv420p", first_row=first_row) as part:
        pairs = list(zip(whole, part, strict=True))
    assert len(pairs) == 4 and whole.info.size_wh == size_wh
    for full, cut in pairs:
        assert (full.index, full.time_s) == (cut.index, cut.time_s) and full.frame_bgr.shape == cut.frame_bgr.shape
        height = full.frame_bgr.shape[0] * 2 // 3
        for first, rows in ((first_row, slice(0, height)), (first_row // 2, slice(height, None))):
            parts = [f.frame_bgr[rows] for f in (full, cut)]
            if rows.start:  # U above V, half as wide
                parts = [p.reshape(2, height // 2, -1).swapaxes(0, 1) for p in parts]
            assert not parts[1][:first].any() and np.array_equal(parts[0][first:], parts[1][first:])


@pytest.mark.parametrize(("pixel_format", "first_row"), [("bgr24", 2), ("nv12", 2), ("yuv420p", 3), ("yuv420p", 96)])
def test_a_first_row_that_cannot_be_is_refused(tmp_path, pixel_format, first_row):
    path = clips.clip(tmp_path / "a.mp4", n_frames=2)
    with pytest.raises(LanelibError, match="needed an even first row of yuv420p, 0 to 94, found"):
        read_frames(path, pixel_format=pixel_format, first_row=first_row)


def test_parts_of_frames_are_never_written(tmp_path):
    path = clips.clip(tmp_path / "a.mp4", n_frames=2)
    with pytest.raises(LanelibError, match="needed whole frames for an output"):
        process_video(path, lambda *a: a[0], output=tmp_path / "b.mp4", pixel_format="yuv420p", first_row=40)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


def test_a_video_without_pictures_is_read_from_the_horizon_on_with_the_same_rows():
    clip, rows = project_root() / "test_videos" / "rendered" / "project_video.mp4", []
    rig = Rig.load(project_root() / "rigs" / "rendered.json")
    run_video(clip, None, rig, end_s=0.5, write_row=rows.append)
    finder = LaneFinder(rig)
    with read_frames(clip, end_s=0.5, pixel_format="yuv420p") as frames:
        whole = [finder.process_yuv420(f.frame_bgr).to_row(f"{clip.name}:{f.index:06d}") for f in frames]
    assert len(rows) == len(whole) > 10
    for row in (*rows, *whole):
        del row["run_time"]
    assert rows == whole
