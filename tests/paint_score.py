"""How good is a paint mask? Recall and precision against hand-labelled lane boundaries."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

LANE_WIDTH_M = 3.66  # 12 ft, where all labelled frames come from: metres per pixel of a row follow from its two labels
PAINT_WIDTH_M = 0.12  # 4 to 6 inch lines
LABEL_ERROR_PX = 1.5  # the labels' stated accuracy
OUTSIDE_M = 1.0  # how much beyond the boundaries counts as road that a lane search would look at


@dataclass(frozen=True)
class PaintScore:
    """hits of `rows` painted label rows were found; `on_paint` and `elsewhere` are mask areas in widths of paint."""

    hits: int = 0
    rows: int = 0
    on_paint: float = 0.0
    elsewhere: float = 0.0

    def __add__(self, other: "PaintScore") -> "PaintScore":
        return PaintScore(self.hits + other.hits, self.rows + other.rows,
                          self.on_paint + other.on_paint, self.elsewhere + other.elsewhere)

    @property
    def recall(self) -> float:
        """Share of the label rows with paint that have mask on the paint."""
        return self.hits / self.rows if self.rows else 0.0

    @property
    def precision(self) -> float:
        """Share of the mask in the ego lane (and a metre outside) that lies on its paint."""
        area = self.on_paint + self.elsewhere
        return self.on_paint / area if area else 0.0

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        both = self.precision + self.recall
        return 2 * self.precision * self.recall / both if both else 0.0

    def __str__(self) -> str:
        return f"recall {self.recall:.3f}  precision {self.precision:.3f}  F1 {self.f1:.3f}"


def score_mask(mask: np.ndarray, label: dict) -> PaintScore:
    """Compare a mask (H, W) of the frame as given with one line of a TuSimple label file that also has `paint`.

    Each row weighs the same near and far: areas are divided by the width that paint has in that row.
    """
    columns = np.arange(mask.shape[1])
    hits = rows = 0
    on_paint = elsewhere = 0.0
    samples = zip(label["h_samples"], *label["lanes"], *label["paint"], strict=True)
    for row, left, right, paint_left, paint_right in samples:
        if row >= mask.shape[0] or left < 0 or right < 0:
            continue  # without both lines there is no scale
        px_per_m = (right - left) / LANE_WIDTH_M
        width_px = max(PAINT_WIDTH_M * px_per_m, 1.0)
        reach = width_px / 2 + LABEL_ERROR_PX
        found = mask[row] > 0
        painted = np.zeros_like(found)
        for x, paint in ((left, paint_left), (right, paint_right)):
            if paint:
                here = np.abs(columns - x) <= reach
                painted |= here
                rows += 1
                hits += bool((found & here).any())
        road = (columns >= left - OUTSIDE_M * px_per_m) & (columns <= right + OUTSIDE_M * px_per_m)
        on_paint += (found & painted).sum() / width_px
        elsewhere += (found & road & ~painted).sum() / width_px
    return PaintScore(hits, rows, float(on_paint), float(elsewhere))


def read_labels(real_dir: Path) -> list[tuple[np.ndarray, dict]]:
    """All labelled frames as (frame_bgr, label)."""
    labels = [json.loads(line) for line in (real_dir / "labels.jsonl").read_text().splitlines() if line.strip()]
    return [(cv2.imread(str(next(real_dir.rglob(Path(label["raw_file"]).name)))), label) for label in labels]


def score_recipe(
    recipe: Callable[[np.ndarray], np.ndarray],
    frames: Iterable[tuple[np.ndarray, dict]],
    *,
    light: float = 1.0,
) -> PaintScore:
    """Score of frame_bgr -> mask over all frames, each multiplied by `light` first."""
    scores = [score_mask(recipe(cv2.convertScaleAbs(frame, alpha=light)), label) for frame, label in frames]
    return sum(scores, PaintScore())
