"""Rendered and real pictures in numbers: `python -m render stats FOLDER ...` prints a table for README.md.

Measured along the lane: road = a strip in the middle of the lane, paint = the brightest part across a line (yellow or
white, b + r), both on rows near the car; lane lines come from truth.json or from a labels.jsonl in the same layout.
"""

import json
from pathlib import Path

import cv2
import numpy as np

from .lens import ROOT


def _entries(folder: Path):
    """(picture path, rows, left x, right x) of the labelled pictures of a folder."""
    if (folder / "truth.json").exists():
        frames = json.loads((folder / "truth.json").read_text()).get("frames", [])
        return [(folder / f["raw_file"], f["h_samples"], *f["lanes"]) for f in frames if f["lanes"]]
    for parent in folder.parents:
        if (parent / "labels.jsonl").exists():
            lines = [json.loads(t) for t in (parent / "labels.jsonl").read_text().splitlines() if t.strip()]
            return [
                (folder / Path(e["raw_file"]).name, e["h_samples"], *e["lanes"])
                for e in lines
                if (folder / Path(e["raw_file"]).name).exists()
            ]
    return []


def measure(path, rows, left, right):
    """A dict of numbers for one picture."""
    bgr = cv2.imread(str(path))
    h, w = bgr.shape[:2]
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY).astype(np.float32)
    fine = grey - cv2.GaussianBlur(grey, (0, 0), 1.5)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(grey, cv2.CV_32F, 0, 1) / 8)
    road, noise, edges, contrast = [], [], [], []
    for row, x0, x1 in zip(rows, left, right, strict=True):
        if x0 == -2 or x1 == -2 or not h * 0.66 < row < h * 0.92:
            continue
        a, b = (int(np.clip(x0 + f * (x1 - x0), 0, w - 1)) for f in (0.3, 0.7))
        road.append(grey[row, a:b])
        noise.append(fine[row, a:b])
        edges.append(gradient[row, a:b])
        for x in (x0, x1):
            half = 0.06 * (x1 - x0)
            near = bgr[row, int(max(0, x - half)) : int(min(w, x + half)) + 1].max(-1).astype(float)
            if len(near):
                contrast.append(near.max() - np.median(bgr[row, a:b].max(-1)))
    road, noise, edges = (np.concatenate(v) if v else np.array([np.nan]) for v in (road, noise, edges))
    p = np.percentile(road, [5, 50, 95])
    return {
        "road 5 %": p[0],
        "road 50 %": p[1],
        "road 95 %": p[2],
        "paint - road (90 %)": np.percentile(contrast, 90) if contrast else np.nan,
        "fine sd on road": noise.std(),
        "gradient 50 %": np.percentile(edges, 50),
        "gradient 95 %": np.percentile(edges, 95),
        "sharpness (Laplacian var)": cv2.Laplacian(grey, cv2.CV_32F).var(),
        "sky grey": np.median(grey[: h // 6]),
    }


def table(folders):
    """Print median and range a folder, as Markdown."""
    folders = folders or [ROOT / "test_images" / "rendered"]
    columns = {}
    for folder in folders:
        rows = [measure(*e) for e in _entries(folder) if e[0].exists()]
        numbers = {k: np.array([r[k] for r in rows]) for k in rows[0]} if rows else {}
        columns[f"{folder.parent.name}/{folder.name} ({len(rows)})"] = numbers
    print("| | " + " | ".join(columns) + " |\n|---" + "|---" * len(columns) + "|")
    for k in next(iter(columns.values())):
        of_all = (c[k] for c in columns.values())
        cells = (f"{np.nanmedian(v):.1f} ({np.nanmin(v):.1f} .. {np.nanmax(v):.1f})" for v in of_all)
        print(f"| {k} | {' | '.join(cells)} |")
