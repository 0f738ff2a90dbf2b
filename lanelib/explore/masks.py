"""Threshold explorer: one source and its range against the true paint, and a recipe made of several such steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import ipywidgets as W
import numpy as np
import traitlets

from lanelib.channels import CHANNELS, as_bgr, in_range
from lanelib.draw import side_by_side
from lanelib.explore.chart import histogram_chart
from lanelib.explore.kit import CONTROL, Explorer, button, choice, counter, tick
from lanelib.explore.look import PANEL_WIDTH, WIDTH_PX, Look, Reading
from lanelib.explore.painttruth import PaintTruth, coloured, paint_truth
from lanelib.explore.steps import GRADIENTS, SOURCES, STARTS, WAYS, Step, combined, domain, recipe_code

BINS = 256


def threshold_look(
    frame_bgr: np.ndarray,
    step: Step,
    recipe: Sequence[Step] = (),
    *,
    truth: PaintTruth | None = None,
    show_recipe: bool = False,
    values_of: Callable[[Step], np.ndarray] | None = None,
) -> Look:
    """One step: its source as a grey picture, its mask over the frame, its histogram with the range lit; the
    ``recipe`` collected so far, its score and its code. ``values_of``: a cache of ``step.values(frame_bgr)``."""
    values_of = values_of or (lambda of: of.values(frame_bgr))
    values = values_of(step.of)
    mask = in_range(values, *step.limits())
    steps = recipe or (step,)
    whole = combined([in_range(values_of(s.of), *s.limits()) for s in steps], [s.way for s in steps])
    shown = whole if show_recipe else mask
    low, high, _ = domain(step.source)
    panel_wh = (PANEL_WIDTH, round(PANEL_WIDTH * frame_bgr.shape[0] / frame_bgr.shape[1]))
    small = cv2.resize(frame_bgr, panel_wh, interpolation=cv2.INTER_AREA)
    grey = cv2.resize(values, panel_wh, interpolation=cv2.INTER_AREA).astype(np.float32)
    grey = np.clip((grey - low) * (255 / (high - low)), 0, 255).astype(np.uint8)
    what = "recipe so far" if show_recipe else "this step's mask"
    colours = ": hit green, missed blue, false red, not judged white" if truth is not None else ""
    top = side_by_side(
        [grey, coloured(shown, truth, small)], [step.source, what + colours], height=panel_wh[1], cap_px=10
    )
    top = cv2.copyMakeBorder(top, 0, 0, 0, WIDTH_PX - top.shape[1], cv2.BORDER_REPLICATE)
    chart = histogram_chart(
        _counts(values, low, high),
        (low, high),
        (step.low, step.high),
        (WIDTH_PX, 150),
        of_paint=_counts(values[truth.paint], low, high) if truth is not None and truth.paint.any() else None,
        title=str(step),
    )
    readings = [Reading("white pixels", 100 * float((shown != 0).mean()), "%", 2)]
    if truth is not None:
        for name, judged in (("of step", mask), ("of recipe", whole)):
            precision, recall = truth.score(judged)
            readings += [Reading(f"precision {name}", precision), Reading(f"recall {name}", recall)]
    readings.append(Reading("steps in recipe", len(recipe), digits=0))
    return Look(np.vstack([top, chart]), tuple(readings), recipe_code(steps))


def _counts(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Histogram (BINS,) of the values; what lies beyond the ends is in the end bins."""
    scaled = np.clip((values.astype(np.float32) - low) * ((BINS - 1) / (high - low)), 0, BINS - 1)
    return np.bincount(scaled.astype(np.uint8).ravel(), minlength=BINS)


def threshold(frame_bgr: np.ndarray, truth=None) -> Explorer:
    """Explore masks of one frame (H, W, 3) uint8 BGR.

    ``truth``: the frame's entry of `truth.load_truth`, or a mask (H, W) of its paint; then precision and recall are
    shown. Steps that are worth keeping are added to a recipe, whose code stands below.
    """
    frame = as_bgr(frame_bgr)
    judged = None if truth is None else paint_truth(truth, (frame.shape[1], frame.shape[0]))
    values_of = lru_cache(maxsize=12)(lambda of: of.values(frame))
    start = Step()
    source = choice("source", SOURCES, start.source, tip="a colour channel, a gradient, or the project's own ridge")
    chosen = W.FloatRangeSlider(
        value=(start.low, start.high),
        min=0,
        max=255,
        step=1,
        readout_format=".0f",
        description="range",
        tooltip="lowest and highest value that pass",
        style={"description_width": "118px"},
        layout=W.Layout(**CONTROL),
    )
    channel = choice("gradient of", tuple(CHANNELS), "grey", tip="the channel whose gradient is taken")
    ksize = counter("kernel", 3, 1, 15, step=2, tip="side of the Sobel kernel in pixels")
    equalise = tick("CLAHE first", tip="equalise the lightness before anything else")
    show_recipe = tick("show the recipe", tip="show the recipe's mask in place of this step's")
    way = choice("join by", WAYS, "OR", tip="how the next step joins the recipe")
    recipe = _Steps()
    remembered: dict[str, tuple[float, float]] = {}

    def current(s: dict) -> Step:
        low, high = s["range"]
        return Step(s["source"], low, high, s["channel"], s["ksize"], s["equalise"], s["way"])

    def make(**s) -> Look:
        channel.disabled = ksize.disabled = s["source"] not in GRADIENTS
        return threshold_look(
            frame, current(s), s["steps"], truth=judged, show_recipe=s["show_recipe"], values_of=values_of
        )

    controls = {
        "source": source,
        "range": chosen,
        "channel": channel,
        "ksize": ksize,
        "equalise": equalise,
        "show_recipe": show_recipe,
        "way": way,
        "steps": recipe,
    }

    def add():
        with explorer.together():
            recipe.value = (*recipe.value, current(explorer.state))
            show_recipe.value = True

    def drop():
        recipe.value = recipe.value[:-1]

    def clear():
        explorer.set(steps=(), show_recipe=False)

    def other_source(change):
        low, high, step = domain(change["new"])
        with explorer.together():
            remembered[change["old"]] = chosen.value
            begin, end = remembered.get(change["new"], STARTS.get(change["new"], (200, 255)))
            chosen.min, chosen.max = min(chosen.min, low), max(chosen.max, high)  # the range must fit while it moves
            chosen.value = (begin, end)
            chosen.min, chosen.max, chosen.step = low, high, step
            chosen.readout_format = ".0f" if step >= 1 else ".2f"
            chosen.value = (begin, end)

    buttons = [
        button("Add step", add, tip="add this step to the recipe"),
        button("Drop last", drop, tip="take the last step out of the recipe"),
        button("Clear", clear, tip="empty the recipe"),
    ]
    explorer = Explorer(
        "Threshold explorer",
        make,
        controls,
        hidden=("steps",),
        buttons=buttons,
        alt="source, mask and histogram of the frame",
    )
    explorer.recipe = recipe
    source.unobserve(explorer._changed, "value")
    source.observe(other_source, "value")
    return explorer


class _Steps(traitlets.HasTraits):
    """The steps of the recipe as a control without a face: a tuple of `Step`."""

    value = traitlets.Any(())
