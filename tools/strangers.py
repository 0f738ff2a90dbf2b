"""How the finder does on roads and cameras that nobody chose: `python tools/strangers.py`, into docs/STRANGERS.md.

The pictures come from `python -m render strangers` (render/README.md); they are in no repository. Each is looked at on
its own, with the true rig and with the one that `lanelib.autorig` finds from the five pictures of its camera.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from lanelib import LaneFinder, Rig
from lanelib.autorig import find_rig
from lanelib.birdseye import map_points
from lanelib.errors import LanelibError
from lanelib.evaluate import table
from lanelib.files import write_bytes
from lanelib.labels import read_labels
from lanelib.pictures import read_image
from lanelib.scores import FrameScore, frame_score, pixel_score

ROOT = Path(__file__).resolve().parents[1]
FOLDER, REPORT = ROOT / "build" / "strangers", ROOT / "docs" / "STRANGERS.md"
FAR_M = 50.0  # lines are compared to here: the labels of real sets end where a person cannot see the line any more
ABOUT = """# Strangers

Written by `python tools/strangers.py`. The pictures are rendered by `python -m render strangers` (see render/README.md)
and not shipped: motorways drawn by lot, three to five lanes with the car in any of them, dashes, Botts' dots or both,
fresh to nearly gone, asphalt or concrete, sun or overcast and wet, traffic; each seen by a camera with a focal length,
a lens, a height and angles of its own. Cameras 00 to 11 were looked at while the finder was made; no setting was ever
chosen on the pictures below. Failures are left in.

Each picture on its own, both lines from the lower edge to {far:.0f} m ahead. *TuSimple*: the share of rows within 20 px
across the line; *strict*: within 5 px; a picture without a lane has 0 in all rows.
"""


def near_rows(label: dict, rig: Rig) -> dict:
    """The label without the rows that are beyond ``FAR_M``."""
    v = np.array(label["h_samples"], float)
    middle = np.column_stack([np.full(len(v), rig.size_wh[0] / 2), v])
    y = map_points(rig.birdseye.road_from_image, middle)[:, 1]
    keep = np.flatnonzero(np.isfinite(y) & (y < FAR_M)).tolist()
    lanes = [[lane[i] for i in keep] for lane in label["lanes"]]
    return label | {"lanes": lanes, "h_samples": [label["h_samples"][i] for i in keep]}


def look(rig: Rig | None, picture: np.ndarray, label: dict) -> FrameScore:
    """What the finder sees in a picture with this rig, held against its label; without a rig, nothing."""
    result = LaneFinder(rig, track=False).process(picture) if rig else None
    return frame_score(label, result.to_row(label["raw_file"]) if result else None)


def own_rig(pictures: list[np.ndarray]) -> Rig | None:
    """The rig found from the pictures of one camera, of which nothing is known; None where it is refused."""
    try:
        return find_rig(pictures).rig
    except LanelibError:
        return None


def row_of(what: str, frames: list[FrameScore]) -> list[str]:
    """One line of the table."""
    s = pixel_score(frames)
    claimed = np.mean([frame.claimed for frame in frames])
    return [what, str(len(frames)), f"{claimed:.2f}", f"{s.tusimple:.3f}", f"{s.strict:.3f}"]


def measure(folders: list[Path]) -> tuple[dict[str, list[FrameScore]], int]:
    """Scores by the kind of rig, and how many cameras got one."""
    scores: dict[str, list[FrameScore]] = {"true rig": [], "rig found from the five pictures": []}
    rigs = 0
    for folder in folders:
        rig = Rig.load(folder / "rig.json")
        labels, _ = read_labels(folder / "truth.json")
        labels = {name: near_rows(label, rig) for name, label in labels.items()}
        pictures = {name: read_image(folder / name) for name in labels}
        found = own_rig(list(pictures.values()))
        rigs += found is not None
        for kind, chosen in zip(scores, (rig, found), strict=True):
            scores[kind] += [look(chosen, pictures[name], label) for name, label in labels.items()]
        print(folder.name, "rig found" if found else "no rig", flush=True)
    return scores, rigs


def main(argv: list[str] | None = None) -> int:
    """Look at every picture that is there and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER)
    parser.add_argument("-o", "--output", type=Path, default=REPORT, help="where the report goes")
    args = parser.parse_args(argv)
    folders = sorted(path.parent for path in args.folder.glob("*/truth.json"))
    if not folders:
        print("needed pictures in build/strangers, found none; make them: python -m render strangers", file=sys.stderr)
        return 2
    scores, rigs = measure(folders)
    head = ["", "pictures", "with a lane", "TuSimple", "strict"]
    rows = [row_of(kind, frames) for kind, frames in scores.items()]
    for tag in sorted({tag for frame in scores["true rig"] for tag in frame.tags}):
        rows.append(row_of(f"true rig, {tag}", [frame for frame in scores["true rig"] if tag in frame.tags]))
    about = f"{len(folders)} cameras, {folders[0].name} to {folders[-1].name}; a rig was found for {rigs}."
    text = "\n".join([ABOUT.format(far=FAR_M), about, "", table([head, *rows]), ""])
    print(text)
    print(f"wrote {write_bytes(args.output, text.encode())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
