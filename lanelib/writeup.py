"""The write-up of a run: a page of text and pictures about one data set, every number filled in from the run."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from lanelib.calibration import Calibration
from lanelib.datasets import DataSet
from lanelib.evaluate import Evaluation, table
from lanelib.outputs import free_name
from lanelib.rig import Rig
from lanelib.writeup_figures import BEFORE_AFTER, BOARDS, ERRORS, FOLDERS, HARDEST, OVER_TIME, OVERLAY

PICTURE_OF_STAGES = "test2"  # shown step by step; the first picture where the set has none of this name
DOUBTFUL = 0.5  # results of less confidence are shown in the discussion
STEPS = (
    ("undistorted", "Undistorted: straight lines of the road are straight lines of the picture."),
    ("mask", "The mask: what is brighter or yellower than the road on both sides, at the width of paint."),
    ("birdseye", "The bird's-eye view: the road in metres, through the homography of the rig."),
    ("windows", "Sliding windows on the mask, as in every textbook; kept for comparison."),
    ("fit", "Paint points and the fitted lane: one model of both lines, with the car's nod and the road's slope."),
    ("", "The lane back on the frame, with radius of curvature, lateral offset and confidence."),
)


def write_up(
    data_set: DataSet, rig: Rig | None, calibration: Calibration | None, scores: Mapping[str, Evaluation] | None = None
) -> str:
    """The page as Markdown; its pictures are those that the run wrote beside it.

    ``scores``: what the run's pictures and clips got against the set's truth, where it has one.
    """
    folder = data_set.output_images
    parts = [f"# Lane finding on the set “{data_set.name}”", _about_camera(folder, calibration), _about_rig(rig)]
    rows = _with_stems(_rows(folder / "lanes.jsonl"))
    if rows:
        parts += [_steps(folder, rows), _pictures(rows)]
    overlays = data_set.output_videos / OVERLAY
    clips = {path.stem: _rows(path) for path in sorted(overlays.glob("*.jsonl"))}
    if clips:
        parts.append(_videos(clips, Path(os.path.relpath(overlays, folder)).as_posix(), folder))
    parts += [_against_truth(what, score, folder) for what, score in (scores or {}).items()]
    return "\n\n".join([*(part for part in parts if part), _discussion(rows)]) + "\n"


def _rows(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []


def _with_stems(rows: Sequence[dict]) -> list[dict]:
    """The rows of pictures, each with the name under which the run wrote it: of a.jpg and a.png the second is a-2."""
    taken: set[str] = set()
    return [row | {"stem": free_name(Path(row["raw_file"]).with_suffix(".jpg"), taken).stem} for row in rows]


def _about_camera(folder: Path, calibration: Calibration | None) -> str:
    if calibration is None:
        return "## Camera\n\nThe set has no chessboards; its rig says what is known of the camera."
    used = sum(board.used for board in calibration.boards)
    fx, fy = calibration.camera.camera_matrix[0, 0], calibration.camera.camera_matrix[1, 1]
    text = (
        f"## Camera\n\n{used} of {len(calibration.boards)} chessboards give focal lengths of {fx:.1f} and {fy:.1f} px "
        f"and a root-mean-square reprojection error of {calibration.rms_px:.3f} px over all corners and both axes."
    )
    shown = {
        f"{BOARDS}/corners.jpg": "all chessboards with their corners",
        f"{BOARDS}/errors.png": "the error of each board",
    }
    for path in sorted((folder / BEFORE_AFTER).glob("calib*"))[:1]:
        shown[f"{BEFORE_AFTER}/{path.name}"] = "a chessboard before and after undistortion"
    return "\n\n".join([text, *(f"![{alt}]({name})" for name, alt in shown.items() if (folder / name).is_file())])


def _about_rig(rig: Rig | None) -> str:
    if rig is None:
        return ""
    m = rig.mounting
    return (
        f"## From pixels to metres\n\nThe camera sits {m['height_m']:.2f} m above the road, pitched "
        f"{m['pitch_deg']:+.2f} and turned {m['yaw_deg']:+.2f} degrees; the lowest row of the picture shows the road "
        f"{rig.near_m:.1f} m ahead. Metres per pixel follow from this homography; none is typed."
    )


def _steps(folder: Path, rows: Sequence[dict]) -> str:
    names = [row["stem"] for row in rows]
    stem = PICTURE_OF_STAGES if PICTURE_OF_STAGES in names else names[0]
    parts = [f"## Step by step: {stem}"]
    for stage, text in STEPS:
        name = f"{FOLDERS[stage]}/{stem}.jpg" if stage else f"{stem}.jpg"
        if (folder / name).is_file():
            parts.append(f"{text}\n\n![{stage or 'lane'}]({name})")
    row = rows[names.index(stem)]
    if row["lane_width_m"] is not None:
        parts.append(
            "The curvature at the car is κ = -x'' / (1 + x'²)^(3/2), positive to the left, averaged over both lines "
            f"(curvatures, not radii): here {_radius(row)}. The car is {_offset(row)}; the lane is "
            f"{row['lane_width_m']:.2f} m wide."
        )
    return "\n\n".join(parts)


def _pictures(rows: Sequence[dict]) -> str:
    head = ["picture", "status", "confidence", "radius of curvature", "offset"]
    body = [
        [f"[{r['stem']}]({r['stem']}.jpg)", r["status"], f"{r['confidence']:.2f}", _radius(r), _offset(r)] for r in rows
    ]
    return "## All pictures, each on its own\n\n" + table([head, *body], left=(0, 1, 3, 4))


def _videos(clips: dict[str, list[dict]], overlays: str, folder: Path) -> str:
    head = ["video", "frames", "measured", "held", "none", "least confidence"]
    body = []
    for name, rows in clips.items():
        counts = [str(sum(r["status"] == s for r in rows)) for s in ("measured", "held", "none")]
        least = min((r["confidence"] for r in rows), default=0.0)
        body.append([f"[{name}]({overlays}/{name}.mp4)", str(len(rows)), *counts, f"{least:.2f}"])
    parts = ["## Videos, with the tracker", table([head, *body])]
    for name in clips:
        for file, text in (
            (f"{OVER_TIME}/{name}.png", f"{name} over time; the truth is dashed where it is known."),
            (f"{HARDEST}/{name}.jpg", f"The moments of {name} with the least confidence."),
        ):
            if (folder / file).is_file():
                parts.append(f"{text}\n\n![{name}]({file})")
    return "\n\n".join(parts)


def _against_truth(what: str, score: Evaluation, folder: Path) -> str:
    parts = [f"## Against the truth: {what}", str(score)]
    if what == "pictures" and (folder / ERRORS / "pictures.png").is_file():
        parts.append(f"![error of each picture]({ERRORS}/pictures.png)")
    return "\n\n".join(parts)


def _discussion(rows: Sequence[dict]) -> str:
    doubtful = [r for r in rows if r["status"] != "measured" or r["confidence"] < DOUBTFUL]
    if not doubtful:
        return f"## What is doubtful\n\nNo picture has a confidence below {DOUBTFUL}."
    lines = [f"- {r['stem']}: {r['reason'] or 'little paint'} (confidence {r['confidence']:.2f})" for r in doubtful]
    return "## What is doubtful\n\n" + "\n".join(lines)


def _radius(row: dict) -> str:
    if row["lane_width_m"] is None:
        return "-"
    if row["radius_m"] is None:
        return "straight"
    return f"{row['radius_m']:.0f} m to the {'left' if row['curvature_1pm'] > 0 else 'right'}"


def _offset(row: dict) -> str:
    if row["offset_m"] is None:
        return "-"
    return f"{abs(row['offset_m']):.2f} m {'right' if row['offset_m'] > 0 else 'left'} of the lane's centre"
