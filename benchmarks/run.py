"""`make bench`: what each stage costs, in ratios that hold on another machine, and docs/PERFORMANCE.md.

    python benchmarks/run.py            about 6 minutes, writes docs/PERFORMANCE.md
    python benchmarks/run.py --quick    under 2 minutes, fewer rounds, prints only (--write: writes, too)
"""

import argparse
import os
import statistics
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__" and os.environ.get("OPENBLAS_NUM_THREADS") != "1":  # read when numpy is loaded: begin again
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    os.execv(sys.executable, [sys.executable, *sys.argv])

import cv2
import numpy as np
from measure import (
    RIG_FILE,
    ROOT,
    ffmpeg,
    in_streams,
    in_turn,
    interleaved,
    machine,
    peak_megabytes,
    simulated_frames,
    times_as_much,
    write_clip,
)

from lanelib import calibration, draw, jointfit, threshold, windows
from lanelib.draw.overlays import _card as read_out
from lanelib.evaluate import table
from lanelib.files import write_bytes
from lanelib.finder import LaneFinder
from lanelib.hypotheses import hypotheses
from lanelib.paint import evidence_of, paint_points
from lanelib.pictures import read_image
from lanelib.result import line_at_rows
from lanelib.rig import SCAN_COLUMN_M, Rig
from lanelib.runs import run_video
from lanelib.video import read_frames

SIZES = ((640, 360), (960, 540), (1280, 720), (1920, 1080), (2560, 1440), (3840, 2160))
PRESETS = ("veryfast", "medium")


def yuv420(frame: np.ndarray) -> np.ndarray:
    """A BGR frame as a decoder gives it."""
    return cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)


# ---------------------------------------------------------------------------------------------- stages
def stage_costs(rig: Rig, stills: list[np.ndarray], rounds: int) -> tuple[dict[str, float], dict[str, float]]:
    """ms of each stage of the finder's order and of the textbook order on the same stills."""
    finder = LaneFinder(rig, track=False)
    view = finder.view(rig.size_wh)
    ready = []
    for frame in stills:
        channels = view.paint_channels(frame)
        z = evidence_of(*channels, column_m=SCAN_COLUMN_M)
        points = view.points(paint_points(z))
        starts = hypotheses(points)
        result = finder.process(frame)
        mask = finder.recipe.function(rig.camera.undistort(frame))
        above = view.metric.warp(mask)
        pixels = windows.find_pixels(above, view.metric.grid)
        ready.append(dict(frame=frame, yuv=yuv420(frame), channels=channels, z=z, points=points, starts=starts,
                          result=result, undistorted=rig.camera.undistort(frame), mask=mask, above=above, pixels=pixels,
                          canvas=frame.copy(), canvas_yuv=yuv420(frame)))
    ready = [r for r in ready if r["result"].fit is not None]

    step = np.diag(np.square([0.1, 0.02, 8e-4, 1e-6, 0.03, 0.004, 6e-5]))

    def track(r):
        fit = r["result"].fit
        prior, reach_m = jointfit.Prior(fit.mean, fit.covariance + step), jointfit.TRACK_REACH_M
        jointfit.fit(r["points"], fit.mean, prior=prior, gates=jointfit.TRACK_GATES, reach_m=reach_m)

    def card(r):
        read_out.cache_clear()  # in a video the numbers change with every frame
        return draw.overlay_yuv420(r["canvas_yuv"], r["result"])

    own = {
        "warp to brightness and yellow, BGR frame": lambda r: view.paint_channels(r["frame"]),
        "warp to brightness and yellow, YUV planes": lambda r: view.paint_channels(r["yuv"]),
        "evidence": lambda r: evidence_of(*r["channels"], column_m=SCAN_COLUMN_M),
        "points": lambda r: view.points(paint_points(r["z"])),
        "hypotheses (fresh search)": lambda r: hypotheses(r["points"]),
        "fits (fresh search)": lambda r: jointfit.fits(r["points"], r["starts"]),
        "fit (tracking)": track,
        "lines in metres": lambda r: view.lane(r["result"].fit),
        "lines in pixels (on demand)": lambda r: view.lines_px(r["result"].lane),
        "overlay, BGR": lambda r: draw.overlay_bgr(r["canvas"], r["result"]),
        "overlay, YUV planes": lambda r: draw.overlay_yuv420(r["canvas_yuv"], r["result"]),
        "the same, new numbers in the read-out": card,
    }
    textbook = {
        "one cv2.undistort call": lambda r: cv2.undistort(r["frame"], rig.camera.camera_matrix, rig.camera.distortion),
        "undistort by a kept table": lambda r: rig.camera.undistort(r["frame"]),
    }
    textbook |= {
        f"threshold, {name}": lambda r, function=recipe.function: function(r["undistorted"])
        for name, recipe in threshold.RECIPES.items()
    }
    textbook |= {
        "paint response (in place of the mask, for the joint fit)": lambda r: threshold.paint_response(
            r["undistorted"], horizon_row=rig.birdseye.horizon_row_px, camera_height_m=view.height_m),
        "warp": lambda r: view.metric.warp(r["mask"]),
        "sliding windows": lambda r: windows.find_pixels(r["above"], view.metric.grid),
        "two fits": lambda r: windows.fit_lines(r["pixels"], view.metric.grid),
    }
    costs = interleaved(own | textbook, ready, rounds=rounds)
    return {name: costs[name] for name in own}, {name: costs[name] for name in textbook}


def whole_frames(rig: Rig, frames: list[np.ndarray], rounds: int, measure=interleaved) -> dict[str, float]:
    """ms from frame to geometry on consecutive frames, the trackers following, beside one cv2.undistort call."""
    finders = {
        "tracking, YUV planes": LaneFinder(rig).process_yuv420,
        "tracking, BGR": LaneFinder(rig).process,
        "fresh search, YUV planes": LaneFinder(rig, track=False).process_yuv420,
        "fresh search, BGR": LaneFinder(rig, track=False).process,
        "textbook order, recipe paint": LaneFinder(rig, order="textbook").process,
    }
    for name in threshold.RECIPES:
        if name != threshold.DEFAULT_RECIPE:
            finders[f"textbook order, recipe {name}"] = LaneFinder(rig, recipe=name).process
    camera = rig.camera
    cases = {
        name: (lambda pair, f=function, i=int("YUV" in name): f(pair[i])) for name, function in finders.items()
    } | {
        "one cv2.undistort call": lambda pair: cv2.undistort(pair[0], camera.camera_matrix, camera.distortion)
    }
    return measure(cases, [(frame, yuv420(frame)) for frame in frames], rounds=rounds)


def agreement_px(rig: Rig, stills: list[np.ndarray]) -> tuple[float, float, float, int]:
    """Mean, median and largest of the frames' mean difference between the lines of the two orders, px."""
    finders = [LaneFinder(rig, order=order, track=False) for order in ("finder", "textbook")]
    rows, width = np.arange(0, rig.size_wh[1], 10), rig.size_wh[0]
    means = []
    for frame in stills:
        one, other = (finder.process(frame) for finder in finders)
        if one and other:
            pairs = ((one.left_px, other.left_px), (one.right_px, other.right_px))
            lines = [[np.array(line_at_rows(px, rows, width)) for px in pair] for pair in pairs]
            means.append(np.mean(np.concatenate([np.abs(a - b)[(a >= 0) & (b >= 0)] for a, b in lines])))
    return float(np.mean(means)), float(np.median(means)), float(np.max(means)), len(means)


def sizes(rig: Rig, frames: list[np.ndarray], rounds: int) -> dict[tuple[int, int], dict[str, float]]:
    """ms per frame at other sizes of the same frames, all sizes in turn."""
    cases, inputs = {}, []
    for frame in frames:
        inputs.append({size: yuv420(cv2.resize(frame, size, interpolation=cv2.INTER_AREA)) for size in SIZES})
    for size in SIZES:
        tracking, fresh = LaneFinder(rig), LaneFinder(rig, track=False)
        cases[size, "tracking"] = lambda all_, s=size, f=tracking: f.process_yuv420(all_[s])
        cases[size, "fresh search"] = lambda all_, s=size, f=fresh: f.process_yuv420(all_[s])
    costs = interleaved(cases, inputs, rounds=rounds)
    return {size: {what: costs[size, what] for what in ("tracking", "fresh search")} for size in SIZES}


# ---------------------------------------------------------------------------------------------- files
def files(rig: Rig, clip: Path, place: Path, rounds: int) -> dict[str, list[float]]:
    """Seconds of processor time of whole files, each kind in turn, round by round."""

    def read():
        with read_frames(clip, pixel_format="yuv420p") as frames:
            for _ in frames:
                pass

    jobs = {
        "decode alone (ffmpeg to null)": lambda: ffmpeg("-threads", 1, "-i", clip, "-f", "null", "-"),
        "decode alone (frames in Python)": read,
        "file to geometry": lambda: run_video(clip, None, rig),
    }
    taken = in_turn(jobs, rounds=2 * rounds)  # these take little time
    for preset in PRESETS:
        taken |= in_turn({
            f"bare transcode, {preset}": lambda p=preset: ffmpeg(
                "-threads", 1, "-i", clip, "-c:v", "libx264", "-preset", p, "-crf", 20, "-pix_fmt", "yuv420p",
                "-movflags", "+faststart", place / "bare.mp4"),
            f"file to annotated file, {preset}": lambda p=preset: run_video(clip, place / "out.mp4", rig, preset=p),
        }, rounds=rounds)
    return taken


def lengths(clip: Path, place: Path, times: tuple[int, ...], n_frames: int) -> list[list[str]]:
    """Frames, peak memory of the command line alone and with its ffmpegs, by length of the clip."""
    rows = []
    for n in times:
        long = place / f"times{n}.mp4"
        ffmpeg("-stream_loop", n - 1, "-i", clip, "-c", "copy", long)
        command = [sys.executable, "-m", "lanelib", "video", str(long), "--rig", str(RIG_FILE), "--quiet"]
        plain = peak_megabytes([*command, "--no-video", "--json", str(place / "out.jsonl")])
        drawn = peak_megabytes([*command, "--preset", "veryfast", "-o", str(place / "out.mp4")])
        rows.append([str(n * n_frames), *(f"{mb:.0f}" for mb in (*plain, *drawn))])
    return rows


def calibrate() -> float:
    """Seconds of processor time for the 20 rendered boards, reading included."""
    boards = sorted((ROOT / "camera_cal" / "rendered").glob("*.jpg"))
    return in_turn({"boards": lambda: calibration.calibrate(boards)}, rounds=1)["boards"][0]


# ---------------------------------------------------------------------------------------------- the report
class Report:
    """The lines of docs/PERFORMANCE.md, and what is held against a target on the way."""

    def __init__(self):
        self.lines: list[str] = []
        self.goals: list[list[str]] = []

    def section(self, title: str, *lines: str) -> None:
        """A heading and what stands below it."""
        self.lines += [title, "", *lines, ""]

    def goal(self, what: str, allowed: float, reached: float, unit: str = "", *, least: bool = False) -> None:
        """A figure that was `reached`, and the most that is allowed (or the least)."""
        met = reached >= allowed if least else reached <= allowed
        bound = f"{'at least' if least else 'at most'} {allowed:g}{unit}"
        self.goals.append([what, bound, f"{reached:.3g}{unit}", "yes" if met else "**no**"])

    def targets(self) -> list[list[str]]:
        """The targets as rows of a table."""
        return [["", "target", "reached", "met"], *self.goals]


def report(quick: bool) -> str:
    """Measure everything and say it in Markdown."""
    cv2.setNumThreads(1)
    rig = Rig.load(RIG_FILE)
    paths = sorted((ROOT / "test_images" / "rendered").glob("*.jpg"))
    stills = [frame for frame in map(read_image, paths) if frame.shape[1::-1] == rig.size_wh]
    out = Report()
    out.section(
        "# Performance",
        "Written by `make bench`. Ratios are what to compare: each was taken in one interleaved run.",
        "",
        *(f"- {line}" for line in machine()),
        f"- input: {len(stills)} pictures of `test_images/rendered`, {rig.size_wh[0]}x{rig.size_wh[1]}",
    )
    say("stages")
    say_stages(out, rig, stills[:6] if quick else stills, 3 if quick else 9)
    say("frames")
    frames, source = drive(quick)
    forth_and_back = frames + frames[::-1]  # without a jump where it begins again
    say_frames(out, rig, forth_and_back[:: 2 if quick else 1], f"{source}, {len(frames)} frames forth and back", quick)
    say_agreement(out, rig, stills)
    say("sizes")
    say_sizes(out, rig, frames[: 4 if quick else 12], 3 if quick else 9)
    with tempfile.TemporaryDirectory(prefix="bench") as folder:
        clip, film = Path(folder) / "clip.mp4", forth_and_back * (1 if quick else 2)
        write_clip(film, clip, size_wh=rig.size_wh)
        say("files")
        say_files(out, rig, clip, len(film), 2 if quick else 5)
        say("memory")
        say_memory(out, clip, (1, 4) if quick else (1, 4, 12), len(film))
    say("calibration")
    seconds = calibrate()
    out.section("## Calibration", f"The 20 boards of `camera_cal/rendered`, reading included: {seconds:.2f} s of "
                "processor time.")
    out.goal("20 boards calibrated", 3, seconds, " s")
    rows, met = out.targets(), sum(row[-1] == "yes" for row in out.goals)
    out.section(f"## Targets: {met} of {len(out.goals)} met", *markdown_rows(rows))
    say("\n" + table([[cell.replace("*", "") for cell in row] for row in rows], left=(0, 1)))
    return "\n".join(out.lines)


def drive(quick: bool) -> tuple[list[np.ndarray], str]:
    """Consecutive frames of 1280x720, and where they are from."""
    shipped = ROOT / "test_videos" / "rendered" / "project_video.mp4"
    if not shipped.exists():
        return simulated_frames(12 if quick else 30), "a drive of `lanelib.simulator`"
    with read_frames(shipped) as reader:
        frames = [frame.frame_bgr for frame, _ in zip(reader, range(24 if quick else 60), strict=False)]
    return frames, "`test_videos/rendered/project_video.mp4`"


def say_stages(out: Report, rig: Rig, stills: list[np.ndarray], rounds: int) -> None:
    """What each stage costs."""
    own, textbook = stage_costs(rig, stills, rounds)
    one_call = textbook["one cv2.undistort call"]
    out.section("## Stages, ms a frame", *markdown(["finder's order", "ms", "of one cv2.undistort"], own, one_call),
                "", *markdown(["textbook order", "ms", "of one cv2.undistort"], textbook, one_call))


def say_frames(out: Report, rig: Rig, frames: list[np.ndarray], source: str, quick: bool) -> None:
    """What a whole frame costs in each order, model and format."""
    whole = whole_frames(rig, frames, 2 if quick else 5, in_streams)
    cold = whole_frames(rig, frames, 2 if quick else 3)
    call, cold_call = whole["one cv2.undistort call"], cold["one cv2.undistort call"]
    head = ["", "in a stream, ms", "of one cv2.undistort", "between other work, ms", "of one cv2.undistort"]
    rows = [[name, f"{ms:.2f}", f"{ms / call:.3f}", f"{cold[name]:.2f}", f"{cold[name] / cold_call:.3f}"]
            for name, ms in whole.items()]
    out.section(
        f"## Frame to geometry, ms a frame ({source})",
        "In a stream each row goes over all frames in a loop of its own, as in a process that does nothing else; this "
        "is what the targets below are held against. Between other work the rows take turns frame by frame, and each "
        "finds the processor's caches full of the others' data.",
        "",
        *markdown_rows([head, *rows]),
    )
    out.goal("frame to geometry while tracking, of one cv2.undistort call (YUV planes, as videos are processed)", 0.15,
             whole["tracking, YUV planes"] / call)
    out.goal("the same from BGR frames", 0.15, whole["tracking, BGR"] / call)
    out.goal("fresh search, of one cv2.undistort call (YUV planes)", 0.5, whole["fresh search, YUV planes"] / call)
    out.goal("the same from BGR frames", 0.5, whole["fresh search, BGR"] / call)
    out.goal("textbook order over finder's order, recipe and model as by default (YUV planes)", 40,
             whole["textbook order, recipe paint"] / whole["tracking, YUV planes"], least=True)


def say_agreement(out: Report, rig: Rig, stills: list[np.ndarray]) -> None:
    """How far the lines of the two orders are apart."""
    mean, median, worst, n = agreement_px(rig, stills)
    about = f"mean of {n} pictures (median {median:.2f}, largest {worst:.1f} px)"
    out.goal(f"lines of the two orders apart, {about}", 1, mean, " px")


def say_sizes(out: Report, rig: Rig, frames: list[np.ndarray], rounds: int) -> None:
    """What larger and smaller frames cost."""
    by_size = sizes(rig, frames, rounds)
    base = by_size[1280, 720]
    rows = [[f"{w}x{h}", f"{ms['tracking']:.2f}", f"{ms['tracking'] / base['tracking']:.2f}",
             f"{ms['fresh search']:.2f}", f"{ms['fresh search'] / base['fresh search']:.2f}"]
            for (w, h), ms in by_size.items()]
    head = ["frame", "tracking", "over 720p", "fresh search", "over 720p"]
    out.section("## Frame size, ms a frame (YUV planes)", *markdown_rows([head, *rows]))
    out.goal("geometry at 3840x2160 over 1280x720, tracking", 2, by_size[3840, 2160]["tracking"] / base["tracking"])


def say_files(out: Report, rig: Rig, clip: Path, n_frames: int, rounds: int) -> None:
    """What a whole file costs, decoding and encoding included."""
    spent = files(rig, clip, clip.parent, rounds)
    seconds = {name: statistics.median(of_rounds) for name, of_rounds in spent.items()}
    rows = [[name, f"{s:.2f}", f"{1e3 * s / n_frames:.1f}"] for name, s in seconds.items()]
    out.section(
        f"## File to file, {n_frames} frames of 1280x720",
        *markdown_rows([["", "CPU s", "CPU ms a frame"], *rows]),
        "",
        "`bare transcode` is ffmpeg alone, file to file, with the same preset and quality. ffmpeg's decoder runs in "
        "one thread, x264 in its default number, in both.",
    )
    geometry = spent["file to geometry"]
    out.goal("file to geometry over decoding alone (ffmpeg to null)", 1.3,
             times_as_much(geometry, spent["decode alone (ffmpeg to null)"]))
    out.goal("file to geometry over decoding into Python", 1.3,
             times_as_much(geometry, spent["decode alone (frames in Python)"]))
    for preset in PRESETS:
        annotated, bare = spent[f"file to annotated file, {preset}"], spent[f"bare transcode, {preset}"]
        out.goal(f"file to annotated file over a bare transcode, {preset}", 1.10, times_as_much(annotated, bare))


def say_memory(out: Report, clip: Path, times: tuple[int, ...], n_frames: int) -> None:
    """How much memory longer clips need."""
    rows = lengths(clip, clip.parent, times, n_frames)
    head = ["frames", "geometry: Python", "with ffmpeg", "annotated: Python", "with ffmpeg"]
    out.section(
        "## Memory by length of the clip, MB at the peak",
        "Resident memory; `with ffmpeg` adds that of the decoder and the encoder (pages they share are counted twice).",
        "",
        *markdown_rows([head, *rows]),
    )
    out.goal("peak memory of Python, annotated file, longest clip", 400, float(rows[-1][3]), " MB")
    out.goal("the same with both ffmpeg processes", 400, float(rows[-1][4]), " MB")


def markdown(head: list[str], costs: dict[str, float], unit: float) -> list[str]:
    """A table of milliseconds and of their ratio to `unit`."""
    return markdown_rows([head, *([name, f"{ms:.2f}", f"{ms / unit:.3f}"] for name, ms in costs.items())])


def markdown_rows(rows: list[list[str]]) -> list[str]:
    """A Markdown table, the first row as its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|" + "|".join(["---"] + ["---:"] * (len(rows[0]) - 1)) + "|", *lines[1:]]


def say(text: str) -> None:
    """To the terminal."""
    print(text, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rounds; does not write the report")
    parser.add_argument("--write", action="store_true", help="write docs/PERFORMANCE.md even with --quick")
    arguments = parser.parse_args()
    text = report(arguments.quick)
    say(text)
    if arguments.write or not arguments.quick:
        say(f"wrote {write_bytes(ROOT / 'docs' / 'PERFORMANCE.md', text.encode()).relative_to(ROOT)}")
