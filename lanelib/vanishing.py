"""Where a road leads in the picture: the vanishing point and the lane's two lines, from paint alone.

Paint is a ridge in the picture too. Every paint point (u, v) and every possible vanishing point (u0, v0) make one
slope

    s = (u - u0) / (v - v0) = x / height

the lateral position on the road in camera heights, whatever the focal length. Where (u0, v0) is right, the points of
a straight line fall on one s: a Hough transform over (u0, v0, s). Peaks left and right of the car, a lane width
apart, are a lane.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from lanelib.jointfit import UNKNOWN_ROAD, WIDTH
from lanelib.paint import PAINT_WIDTH_M, paint_channels, ridge_response, weight_of

VOTE_WIDTH_PX = 640  # the vote's picture: paint is still 2 px wide where the vote needs it
PAINT_WIDTHS_PX = (3, 7)  # each also tries a stripe over twice as wide (see ``paint``): 3-15 px of 640, far to near
VOTE_POINTS = 2500  # the strongest paint points of a frame that vote
HORIZON_ROWS = (0.10, 0.65)  # of the height, from a camera that looks steeply down to one that looks up
VANISHING_COLUMNS = (0.15, 0.85)  # of the width: a yaw of 20 degrees
VOTE_STEP = 0.0125  # of height and width: half a step moves slopes half way down the road by less than a bin
SLOPE_BIN, SLOPE_REACH = 0.06, 4.5  # 7 cm of road for a camera at 1.2 m; lines leave most pictures at 4
# cars 1.1-1.7 m, lorries to 2.8 m: log-normal, so that half the lane or two lanes lose
USUAL_HEIGHT_M, HEIGHT_SPREAD = 1.4, 0.35
HEIGHTS_M = (0.8, 3.2)
MEETING_POINTS, USUAL_HEIGHTS_M = 3, (1.15, 1.45, 1.8)  # a quarter apart: what a fit's own width makes up for


def picture_points(undistorted_bgr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Paint crests, of all widths from far to near, of a picture (H, W, 3) BGR: pixels (N, 2) and weights (N,)."""
    h, w = undistorted_bgr.shape[:2]
    scale = min(1.0, VOTE_WIDTH_PX / w)
    small = cv2.resize(undistorted_bgr, (round(w * scale), round(h * scale)), interpolation=cv2.INTER_AREA)
    z = np.zeros(small.shape[:2], np.float32)
    for channel in paint_channels(small):
        for width in PAINT_WIDTHS_PX:
            z = cv2.max(z, ridge_response(channel, column_m=PAINT_WIDTH_M / width))
    z = cv2.blur(z, (3, 3))
    z[: int(HORIZON_ROWS[0] * len(z))] = 0
    row, column = np.nonzero((z[:, 1:-1] >= z[:, :-2]) & (z[:, 1:-1] > z[:, 2:]))
    weight = weight_of(z[row, column + 1])
    best = np.argsort(-weight, kind="stable")[:VOTE_POINTS]
    best = best[weight[best] > 0]
    u, v = (column[best] + 1.5) * w / small.shape[1] - 0.5, (row[best] + 0.5) * h / small.shape[0] - 0.5
    return np.column_stack([u, v]), weight[best]


def vote_grid(size_wh) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (px) of the possible vanishing points."""
    w, h = size_wh
    return np.arange(*VANISHING_COLUMNS, VOTE_STEP) * w, np.arange(*HORIZON_ROWS, VOTE_STEP) * h


def slope_peaks(points_px, weights, columns, row, height_px) -> np.ndarray:
    """How far the paint at each slope stands out, (columns, slopes), for vanishing points at these columns of a row.

    Paint (N, 2) px with its weights (N,); ``height_px``: of the picture.
    """
    n = int(round(2 * SLOPE_REACH / SLOPE_BIN))
    below = points_px[:, 1] > row + 0.04 * height_px  # nearer to the horizon one pixel is a lane wide
    u, v, weight = points_px[below, 0], points_px[below, 1], weights[below]
    bins = ((u - np.asarray(columns)[:, None]) / (v - row) + SLOPE_REACH) / SLOPE_BIN
    index = bins.astype(np.int32)
    inside = (bins >= 0) & (index < n)
    index += np.arange(len(columns), dtype=np.int32)[:, None] * n
    table = np.bincount(index[inside], np.broadcast_to(weight, index.shape)[inside], len(columns) * n)
    table = table.reshape(-1, n).astype(np.float32)
    sharp = cv2.sepFilter2D(table, -1, np.array([0.5, 1, 0.5]), np.ones(1), borderType=cv2.BORDER_CONSTANT)
    around = cv2.blur(table, (25, 1), borderType=cv2.BORDER_CONSTANT)  # 1.5 slopes: about a lane's half
    return np.maximum(sharp - 4 * around, 0)  # twice what an even spread would give


def best_pairs(peaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The best pair of lines left and right of the car, of each row of peaks (M, slopes): score and difference, (M,).

    Both lines must be there (geometric mean), at a distance that a usual camera height explains.
    """
    slopes = (np.arange(peaks.shape[1]) + 0.5) * SLOPE_BIN - SLOPE_REACH
    root = np.sqrt(peaks)
    left, right = root * (slopes < -0.2), root * (slopes > 0.2)  # a car does not straddle its line: 0.25 m
    best, difference = np.zeros(len(peaks)), np.full(len(peaks), np.nan)
    usual = UNKNOWN_ROAD.mean[WIDTH]
    for k in range(int(usual / HEIGHTS_M[1] / SLOPE_BIN), int(usual / HEIGHTS_M[0] / SLOPE_BIN) + 1):
        score = (left[:, :-k] * right[:, k:]).max(axis=1) * height_prior(usual / (k * SLOPE_BIN))
        better = score > best
        best[better], difference[better] = score[better], k * SLOPE_BIN
    return best, difference


def height_prior(height_m: float) -> float:
    """How usual a camera height is, 0..1."""
    return math.exp(-0.5 * (math.log(height_m / USUAL_HEIGHT_M) / HEIGHT_SPREAD) ** 2)


def meeting_points(score: np.ndarray, count: int) -> list[tuple[int, int]]:
    """(row, column) of the ``count`` highest of all local maxima of a table, highest first."""
    peak = (score >= cv2.dilate(score, np.ones((5, 5)))) & (score > 0)
    return sorted(map(tuple, np.argwhere(peak)), key=lambda ij: -score[ij])[:count]


def candidates(pictures: list[np.ndarray], *, count: int = 8) -> list[tuple[tuple[float, float], float]]:
    """The most promising (vanishing point in px, height in m for a lane of the usual width), best first, of
    undistorted pictures: ``count`` where a pair of lines meets, with the height that the pair shows, and those where
    most lines of the road meet, with usual heights (dots are a weak pair between the strong lines of other lanes)."""
    h, w = pictures[0].shape[:2]
    columns, rows = vote_grid((w, h))
    pairs, lines = np.zeros((2, len(rows), len(columns)), np.float32)
    votes = []  # of each picture: what the best pair of every possible vanishing point scores, and its difference
    for picture in pictures:
        points, weights = picture_points(picture)
        peaks = [slope_peaks(points, weights, columns, row, h) for row in rows]
        score, difference = (np.array(of_all) for of_all in zip(*map(best_pairs, peaks), strict=True))
        votes.append((score, difference))
        pairs += cv2.GaussianBlur(score.astype(np.float32), (5, 5), 1.0)  # the car nods and weaves: neighbours agree
        lines += cv2.GaussianBlur(np.sqrt(peaks).sum(axis=2), (5, 5), 1.0)
    found = []
    for i, j in meeting_points(pairs, count):
        near = slice(max(i - 1, 0), i + 2), slice(max(j - 1, 0), j + 2)
        score, difference = np.concatenate([np.reshape([s[near], d[near]], (2, -1)) for s, d in votes], axis=1)
        voted = np.flatnonzero(score > 0)
        voted = voted[np.argsort(difference[voted])]
        median = voted[np.searchsorted(np.cumsum(score[voted]), score.sum() / 2)]  # of the votes
        height_m = UNKNOWN_ROAD.mean[WIDTH] / difference[median]
        found.append(((float(columns[j]), float(rows[i])), float(height_m)))
    meeting = meeting_points(lines, MEETING_POINTS)
    return found + [((float(columns[j]), float(rows[i])), usual_m) for i, j in meeting for usual_m in USUAL_HEIGHTS_M]
