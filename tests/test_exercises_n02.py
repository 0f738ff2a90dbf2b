"""Checkers of notebook 02: right, right in another way, and typical mistakes with the hint each must get."""

import cv2
import numpy as np
import pytest

from lanelib import exercises
from lanelib.channels import CHANNELS, hsv_yellow, in_range


def precision_recall(mask, paint):
    found, painted = mask > 0, paint > 0
    hits = (found & painted).sum()
    return hits / found.sum(), hits / painted.sum()


def test_precision_recall():
    assert exercises.check_precision_recall(precision_recall)
    assert exercises.check_precision_recall(lambda m, p: np.array(precision_recall(m, p)))
    assert exercises.check_precision_recall(lambda m, p: list(precision_recall(m, p)))
    assert exercises.check_precision_recall(lambda m, p: [round(float(share), 2) for share in precision_recall(m, p)])


def of_the_mask_twice(mask, paint):
    hits = ((mask > 0) & (paint > 0)).sum()
    return hits / (mask > 0).sum(), hits / (mask > 0).sum()


def counted_255(mask, paint):
    """Blind to a mask of bool or 0/1."""
    with np.errstate(all="ignore"):
        return precision_recall(mask == 255, paint == 255)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda m, p: precision_recall(m, p)[::-1], "exchanged"),
        (of_the_mask_twice, "both are the same"),
        (lambda m, p: ((m & p).sum() / (m > 0).sum(), (m & p).sum() / (p > 0).sum()), "at most 1"),
        (lambda m, p: precision_recall(m, p)[0], "a pair"),
        (lambda m, p: [100 * share for share in precision_recall(m, p)], "per cent"),
        (lambda m, p: [1 / share for share in precision_recall(m, p)], "turned over"),
        (counted_255, "nothing was counted"),
        (lambda m, p: ((m & p).sum() / m.sum(), (m & p).sum() / p.sum()), "0/1 here"),
        (lambda m, p: None, "returns nothing"),
        (0.9, "a function is needed"),
    ],
)
def test_precision_recall_hints(wrong, hint):
    verdict = exercises.check_precision_recall(wrong)
    assert not verdict
    assert hint in verdict.hint


def ridge(row, distance, *, side=np.maximum):
    padded = np.pad(row.astype(int), distance, mode="edge")
    return row - side(padded[: -2 * distance], padded[2 * distance :])


def ridge_with_loop(row, distance):
    last = len(row) - 1
    values = [int(v) for v in row]
    return [c - max(values[max(i - distance, 0)], values[min(i + distance, last)]) for i, c in enumerate(values)]


def test_ridge():
    assert exercises.check_ridge(ridge)
    assert exercises.check_ridge(ridge_with_loop)
    assert exercises.check_ridge(lambda row, d: ridge(row, d).astype(np.float32))


def with_the_other_end(row, distance):
    wide = row.astype(int)
    return wide - np.maximum(np.roll(wide, distance), np.roll(wide, -distance))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda row, d: ridge(row, d).astype(np.uint8), "wraps around"),
        (lambda row, d: np.maximum(ridge(row, d), 0), "cut off"),
        (lambda row, d: np.abs(ridge(row, d)), "the sign is lost"),
        (with_the_other_end, "the first and the last 2 pixels"),
        (lambda row, d: ridge(row.astype(np.int8), d), "right"),
        (lambda row, d: ridge(row, d, side=np.minimum), "not with the darker one"),
        (lambda row, d: ridge(row, d, side=lambda a, b: (a + b) / 2), "not with the mean"),
        (lambda row, d: ridge(row, d, side=lambda a, b: a), "left one only"),
        (lambda row, d: ridge(row, d, side=lambda a, b: b), "right one only"),
        (lambda row, d: ridge(row, d)[d:-d], "the ends are missing"),
        (lambda row, d: -ridge(row, d), "reversed"),
        (lambda row, d: ridge(row, 2), "2 away from the centre, `distance` is 5"),
        (..., "nothing here"),
    ],
)
def test_ridge_hints(wrong, hint):
    verdict = exercises.check_ridge(wrong)
    assert not verdict
    assert hint in verdict.hint


def share_of_brightness(frame):
    b, g, r = (frame[:, :, i].astype(float) for i in range(3))
    return np.minimum(r, g) - b > 0.3 * (r + g) / 2


@pytest.mark.parametrize(
    "right",
    [
        share_of_brightness,
        lambda frame: in_range(CHANNELS["lab_b"](frame), 150, 255),
        hsv_yellow,
        lambda frame: (CHANNELS["yuv_u"](frame) < 115).astype(int),
    ],
)
def test_yellow(right):
    assert exercises.check_yellow(right)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        (lambda frame: CHANNELS["hls_s"](frame) > 170, "at half the light"),
        (lambda frame: (frame[..., 2] > 150) & (frame[..., 1] > 120) & (frame[..., 0] < 100), "with the brightness"),
        (lambda frame: np.minimum(frame[..., 2], frame[..., 1]) - frame[..., 0].astype(int) > 60, "at half the light"),
        (lambda frame: frame[:, :, 2] > 200, "white paint"),
        (lambda frame: ~share_of_brightness(frame), "inverted"),
        (lambda frame: share_of_brightness(frame[:, :, ::-1]), "BGR"),
        (lambda frame: frame[:, :, 0] > 254, "too little passes"),
        (lambda frame: frame, "shape"),
        (lambda frame: CHANNELS["lab_b"](frame), "two values"),
        (lambda frame: cv2.circle(frame, (9, 9), 5, 0, -1)[:, :, 0] > 9, "changes its argument"),
        (None, "None"),
    ],
)
def test_yellow_hints(wrong, hint):
    verdict = exercises.check_yellow(wrong)
    assert not verdict
    assert hint in verdict.hint
