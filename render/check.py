"""Are the shipped pictures what this code makes? Render a sample small and compare with the shipped picture shrunk.

Not bit by bit: another processor, LLVM or Mitsuba rounds differently, and a preview has other noise. What must agree is
what the eye and a detector see: the picture at a quarter of its size, and the truth to the last digit.
"""

import json
import tempfile
from pathlib import Path

import cv2
import numpy as np

SAMPLE = {"boards": ["calibration2"], "stills": ["test3", "no_markings"]}
SHRINK, SPP = 4, 16
MEAN_GREY_LEVELS, BLURRED_GREY_LEVELS = 6.0, 12.0  # measured between two previews of other seeds: 2 and 5


def check(names=()):
    """0 where everything agrees, else 1; prints a line a picture."""
    from .boards import FOLDER as BOARDS
    from .boards import render_boards
    from .stills import FOLDER as STILLS
    from .stills import render_stills

    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for kind, shipped, render in (("boards", BOARDS, render_boards), ("stills", STILLS, render_stills)):
            wanted = [n for n in SAMPLE[kind] if not names or n in names]
            if not wanted:
                continue
            render(wanted, spp=SPP, shrink=SHRINK, force=True, folder=folder / kind)
            for name in wanted:
                new, old = cv2.imread(str(folder / kind / f"{name}.jpg")), cv2.imread(str(shipped / f"{name}.jpg"))
                old = cv2.resize(old, new.shape[1::-1], interpolation=cv2.INTER_AREA)
                mean = float(np.abs(new.astype(float).mean((0, 1)) - old.mean((0, 1))).max())
                soft = [cv2.GaussianBlur(p.astype(np.float32), (0, 0), 4) for p in (new, old)]
                local = float(np.percentile(np.abs(soft[0] - soft[1]), 99))
                same = _truth_of(folder / kind, f"{name}.jpg") == _truth_of(shipped, f"{name}.jpg")
                ok = mean < MEAN_GREY_LEVELS and local < BLURRED_GREY_LEVELS and same
                bad += not ok
                print(
                    f"{name}: mean differs by {mean:.1f}, 99 % of the blurred picture by less than {local:.1f} "
                    f"grey levels, truth {'the same' if same else 'DIFFERS'}: {'ok' if ok else 'NOT what was shipped'}"
                )
    return int(bad > 0)


def _truth_of(folder: Path, raw_file: str) -> dict:
    """The picture's entry of truth.json, without `visible`: what is hidden is found by rays against the meshes, and
    rounding may turn a row at an edge."""
    truth = json.loads((folder / "truth.json").read_text())
    entry = next(e for kind in ("boards", "frames") for e in truth.get(kind, []) if e["raw_file"] == raw_file)
    return {k: v for k, v in entry.items() if k != "visible"}
