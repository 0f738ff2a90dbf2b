"""Steps of a threshold recipe: a source, a range; and how several of them are combined and written down as code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lanelib import threshold
from lanelib.channels import CHANNELS, channel_by_name, equalise_lightness, in_range
from lanelib.errors import LanelibError

GRADIENTS = ("sobel x", "sobel y", "magnitude", "direction")
RIDGES = ("brightness ridge", "yellow ridge")
SOURCES = (*CHANNELS, *GRADIENTS, *RIDGES)
# Where each source starts: the value that the classic recipes (or, for ridges, the project's own) use.
STARTS = {
    "grey": (200, 255),
    "rgb_r": (220, 255),
    "hls_l": (215, 255),
    "hls_s": (170, 255),
    "hsv_v": (200, 255),
    "lab_b": (155, 255),
    "hls_h": (15, 35),
    "hsv_h": (15, 35),
    "yuv_u": (0, 105),
    "sobel x": (20, 200),
    "sobel y": (20, 200),
    "magnitude": (30, 200),
    "direction": (0.5, 1.3),
    "brightness ridge": (1, 4),
    "yellow ridge": (1, 4),
}
WAYS = ("OR", "AND", "AND NOT")


def domain(source: str) -> tuple[float, float, float]:
    """Lowest and highest value of a source, and the step of its slider."""
    if source == "direction":
        return 0.0, 1.58, 0.01  # radians
    if source in RIDGES:
        return 0.0, 4.0, 0.05  # from 1 on it is paint; above 4 nobody asks
    return 0.0, 255.0, 1.0


@dataclass(frozen=True)
class Step:
    """Where ``source`` is ``low``..``high``. Gradients are of ``channel`` with a Sobel kernel of ``ksize``;
    ``equalise``: after CLAHE on the lightness. ``way``: how the step joins the steps before it (`WAYS`)."""

    source: str = "hls_s"
    low: float = 170.0
    high: float = 255.0
    channel: str = "grey"
    ksize: int = 3
    equalise: bool = False
    way: str = "OR"

    def __post_init__(self):
        if self.source not in SOURCES or self.way not in WAYS:
            raise LanelibError(f"a source must be one of {', '.join(SOURCES)}, found {self.source!r} ({self.way})")

    @property
    def of(self) -> Step:
        """The step without its range and way: what its values depend on."""
        if self.source in GRADIENTS:
            return replace(self, low=0.0, high=0.0, way="OR")
        return Step(self.source, 0.0, 0.0, equalise=self.equalise)

    def values(self, frame_bgr: np.ndarray) -> np.ndarray:
        """What is compared with the range, (H, W): a channel uint8, a gradient scaled to 255, or a ridge response."""
        frame = equalise_lightness(frame_bgr) if self.equalise else frame_bgr
        if self.source in CHANNELS:
            return channel_by_name(frame, self.source)
        if self.source in RIDGES:
            return threshold.paint_ridges(frame)[RIDGES.index(self.source)]
        gradients = threshold.sobel(channel_by_name(frame, self.channel), ksize=self.ksize)
        if self.source == "direction":
            return threshold.direction(gradients)
        if self.source == "magnitude":
            return threshold.scale_to_255(threshold.magnitude(gradients))
        return threshold.scale_to_255(gradients.x if self.source == "sobel x" else gradients.y)

    def limits(self) -> tuple[float, float]:
        """The range; a slider at the upper end of an open scale means no limit."""
        return self.low, (np.inf if self.source in RIDGES and self.high >= domain(self.source)[1] else self.high)

    def mask(self, frame_bgr: np.ndarray) -> np.ndarray:
        """Mask (H, W) uint8 0/255."""
        return in_range(self.values(frame_bgr), *self.limits())

    def code(self) -> str:
        """The mask as an expression of lanelib, of ``frame_bgr`` (``equalised`` after CLAHE)."""
        frame = "equalised" if self.equalise else "frame_bgr"
        low, high = (f"{v:.4g}" if np.isfinite(v) else "np.inf" for v in self.limits())
        if self.source in CHANNELS:
            return f'in_range(CHANNELS["{self.source}"]({frame}), {low}, {high})'
        if self.source in RIDGES:
            return f"in_range(paint_ridges({frame})[{RIDGES.index(self.source)}], {low}, {high})"
        gradients = f'sobel(CHANNELS["{self.channel}"]({frame}), ksize={self.ksize})'
        if self.source == "direction":
            return f"direction_mask({gradients}, {low}, {high})"
        if self.source == "magnitude":
            return f"magnitude_mask({gradients}, {low}, {high})"
        return f'abs_sobel_mask({gradients}, {low}, {high}, axis="{self.source[-1]}")'

    def __str__(self) -> str:
        clahe = "CLAHE, " if self.equalise else ""
        of = f" of {self.channel}, {self.ksize} px" if self.source in GRADIENTS else ""
        return f"{clahe}{self.source}{of} in {self.low:.4g}..{self.high:.4g}"


def combined(masks: Sequence[np.ndarray], ways: Sequence[str]) -> np.ndarray:
    """Masks (H, W) joined from the first to the last, each by its way; the first one's way does not matter."""
    result = masks[0]
    for mask, way in zip(masks[1:], ways[1:], strict=True):
        if way == "OR":
            result = threshold.any_of(result, mask)
        else:
            result = threshold.all_of(result, ~mask if way == "AND NOT" else mask)
    return result


def recipe_code(steps: Sequence[Step], name: str = "my_recipe") -> str:
    """A function in lanelib's words that does what the steps do; runs as it stands."""
    lines = []
    if any(step.equalise for step in steps):
        lines.append("equalised = equalise_lightness(frame_bgr)")
    for i, step in enumerate(steps):
        code, way = step.code(), step.way
        if i == 0:
            lines.append(f"mask = {code}")
        elif way == "OR":
            lines.append(f"mask = any_of(mask, {code})")
        else:
            lines.append(f"mask = all_of(mask, {'~' if way == 'AND NOT' else ''}{code})")
    lines.append("return mask")
    used = "\n".join(lines)
    needs = {
        "lanelib.channels": ("CHANNELS", "equalise_lightness", "in_range"),
        "lanelib.threshold": (
            "abs_sobel_mask",
            "all_of",
            "any_of",
            "direction_mask",
            "magnitude_mask",
            "paint_ridges",
            "sobel",
        ),
    }
    head = ["import numpy as np"] if "np." in used else []
    for module, names in needs.items():
        needed = [n for n in names if f"{n}(" in used or f"{n}[" in used]
        head += [f"from {module} import {', '.join(needed)}"] if needed else []
    body = "\n".join(f"    {line}" for line in lines)
    doc = '    """(H, W, 3) uint8 BGR -> mask (H, W) uint8 0/255."""'
    return "\n".join(head) + f"\n\n\ndef {name}(frame_bgr):\n{doc}\n{body}\n"
