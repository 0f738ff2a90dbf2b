"""Measure the results table of README.md and write it there: `python tools/results.py` (`--check`: only compare).

Every rendered still on its own, and every rendered clip with the tracker, against their exact truth.
"""

import argparse
import math
import sys
from pathlib import Path

import cv2
import numpy as np

from lanelib import LaneFinder, Rig, datasets
from lanelib.evaluate import score, table
from lanelib.labels import read_labels
from lanelib.pictures import read_image
from lanelib.runs import run_video
from lanelib.scores import FrameScore, metric_score, pixel_score

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
BEGIN, END = "<!-- results: written by `python tools/results.py`, do not edit -->", "<!-- end of results -->"
ABOUT_STILLS = (
    "Each rendered still on its own, against its exact truth: the largest lateral error of either line, the error of "
    "the car's offset, and that of the curvature at the car in bends tighter than 1 km (one frame tells the bend "
    "ahead). "
    "**off**: found, but a line is 10 cm or more away at 5 or 10 m. Failures are left in."
)
ABOUT_CLIPS = "Clips, with the tracker; medians over the frames:"
FAR_OFF_CM = 10  # a line this far off at 5 or 10 m is called out: half a tyre


def main() -> int:
    """Write the table, or say whether the one that is there still holds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="exit 1 where README.md has another table")
    check = parser.parse_args().check
    text = README.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    new = f"{before}{BEGIN}\n\n{results()}\n{END}{after}"
    if check:
        print("README.md's results are up to date" if new == text else "README.md's results are out of date")
        return int(new != text)
    README.write_text(new, encoding="utf-8", newline="\n")
    print(f"wrote the results into {README.name}")
    return 0


def results() -> str:
    """The tables as Markdown."""
    data_set = datasets.get("rendered")
    rig = Rig.load(data_set.rig_file)
    labels, camera = read_labels(data_set.test_images / "truth.json")
    labels = {name: row for name, row in labels.items() if (data_set.test_images / name).exists()}
    finder = LaneFinder(rig, track=False)
    found = {name: finder.process(read_image(data_set.test_images / name)) for name in labels}
    frames = score(labels, {n: r.to_row(n) for n, r in found.items()}, camera).frames
    head = ["rendered still", "lane", "5-10 m", "30 m", "offset", "curvature"]
    rows = [head] + [[Path(f.name).stem, verdict(f), *errors(f)] for f in frames]
    good = [f for f in frames if f.has_lane]
    m = metric_score(frames)
    median = np.nanmedian([np.nanmedian(np.abs(f.lateral_m[:, :2])) for f in good])
    rows.append(["**median**", f"{m.found:.0%} found", f"{100 * median:.1f} cm", f"{100 * m.lateral_m[3]:.1f} cm",
                 f"{100 * m.offset_m:.1f} cm", f"{m.curvature:.0%}"])
    text = [ABOUT_STILLS, "", table(rows, left=(0, 1)), ""]
    clips = [row for path in sorted(data_set.test_videos.glob("*.mp4")) if (row := clip_row(path, rig, data_set))]
    if clips:
        head = ["rendered clip", "frames", "measured", "held", "none", "TuSimple", "strict", "10 m", "30 m", "offset",
                "curvature", "jitter"]
        text += [ABOUT_CLIPS, "", table([head, *clips]), ""]
    return "\n".join(text)


def verdict(frame: FrameScore) -> str:
    """What became of one still, in a word or two."""
    if not frame.has_lane:
        return "**claimed where none is**" if frame.claimed else "none, rightly"
    if not frame.claimed:
        return "**missed**"
    near = np.abs(frame.lateral_m[:, :2])
    worst = 100 * np.max(near[np.isfinite(near)], initial=0)
    return "found" if worst < FAR_OFF_CM else "**off**"


def errors(frame: FrameScore) -> list[str]:
    """Largest lateral error at 5 and 10 m and at 30 m, of the offset, of the curvature where there is a bend."""
    if not (frame.has_lane and frame.claimed):
        return ["-"] * 4
    lateral = 100 * np.abs(frame.lateral_m)
    bend = abs(frame.curvature_1pm / frame.bend_1pm) if abs(frame.bend_1pm) > 1e-3 else math.nan
    near, far = (np.max(part[np.isfinite(part)], initial=-1) for part in (lateral[:, :2], lateral[:, 3]))
    numbers = (near if near >= 0 else math.nan, far if far >= 0 else math.nan, 100 * abs(frame.offset_m))
    return [f"{n:.1f} cm" if np.isfinite(n) else "-" for n in numbers] + [f"{bend:.0%}" if np.isfinite(bend) else "-"]


def clip_row(path: Path, rig: Rig, data_set: datasets.DataSet) -> list[str] | None:
    """One row of the clips' table; None for a clip without truth."""
    labels, camera = read_labels(data_set.test_videos / "truth.json")
    labels = {name: row for name, row in labels.items() if name.startswith(f"{path.name}:")}
    if not labels:
        return None
    rows: dict[str, dict] = {}
    _, tally = run_video(path, None, rig, write_row=lambda row: rows.update({row["raw_file"]: row}))
    evaluation = score({n: r for n, r in labels.items() if n in rows}, rows, camera)
    p, m = pixel_score(evaluation.frames), metric_score(evaluation.frames)
    clip = evaluation.clips()[0]
    near = m.lateral_m[1]
    return [path.stem, *tally.row()[1:5], f"{p.tusimple:.3f}", f"{p.strict:.3f}", f"{100 * near:.1f} cm",
            f"{100 * m.lateral_m[3]:.1f} cm", f"{100 * m.offset_m:.1f} cm", f"{m.curvature:.0%}",
            f"{100 * clip.jitter_m:.1f} cm"]


if __name__ == "__main__":
    cv2.setNumThreads(1)
    sys.exit(main())
