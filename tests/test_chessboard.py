"""lanelib.chessboard against rendered boards whose corners are known, and pictures that are no boards."""

import cv2
import numpy as np
import pytest
from chessboards import POSES, render, true_corners
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.chessboard import _chessboard_part, _square_px, find_board, straightness_px
from lanelib.errors import LanelibError


def farthest_px(board, truth) -> float:
    return np.hypot(*(board.corners_px - truth).T).max()


@pytest.mark.parametrize("number", range(len(POSES)))
def test_corners_are_where_they_were_drawn_and_in_the_same_order(number):
    rvec, centre = POSES[number]
    board = find_board(render(rvec, centre, seed=number), (7, 5))
    truth = true_corners(rvec, centre)
    assert board and board.corners_wh == (7, 5)
    if (board.corners_px[0] - truth[0]) @ (truth[-1] - truth[0]) > 0.5 * ((truth[-1] - truth[0]) ** 2).sum():
        truth = truth[::-1]  # w + h is even: which end is first cannot be told
    error = np.hypot(*(board.corners_px - truth).T)
    assert np.sqrt((error**2).mean()) < 0.15 and error.max() < 0.35


@pytest.mark.parametrize("turn", [0.0, 0.8, 1.6, 2.6, -0.8, -1.6, -2.6])
def test_the_first_square_is_black_however_the_board_is_turned(turn):
    pose = ((0.2, -0.3, turn), (0.3, 0.1, 18.0))
    board = find_board(render(*pose, board_wh=(6, 5)), (6, 5))
    assert board.corners_wh == (6, 5)
    assert farthest_px(board, true_corners(*pose, board_wh=(6, 5))) < 0.4


def test_colour_grey_and_transposed_board_sizes_give_the_same_corners():
    frame = render(*POSES[5])
    grey = find_board(frame, (7, 5))
    colour = find_board(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR), (7, 5))
    np.testing.assert_array_equal(grey.corners_px, colour.corners_px)
    other = find_board(frame, (5, 7))
    assert other.corners_wh == (5, 7)
    distance = np.hypot(*(other.corners_px[:, None] - grey.corners_px).transpose(2, 0, 1))
    assert distance.min(axis=1).max() < 0.05


def test_a_large_picture_is_searched_small_and_measured_at_full_size():
    rvec, centre = POSES[5]
    frame = cv2.resize(render(rvec, centre), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    board = find_board(frame, (7, 5))
    assert farthest_px(board, (true_corners(rvec, centre) + 0.5) * 4 - 0.5) < 1.2


@pytest.mark.parametrize("shift", [(-7.3, 0.0), (7.3, 0.0), (0.0, -3.0), (0.0, 3.2), (-5.8, -2.3)])
def test_a_board_cut_off_by_the_frame_gives_the_part_that_is_seen(shift):
    board_wh = (9, 6)
    pose = ((0.15, 0.2, 0.05), (*shift, 13.0))
    board = find_board(render(*pose, board_wh=board_wh), board_wh)
    w, h = board.corners_wh
    assert 16 <= w * h < 54
    truth = true_corners(*pose, board_wh=board_wh).reshape(6, 9, 2)
    seen = board.corners_px.reshape(h, w, 2)
    parts = [g[j : j + h, i : i + w] for g in (truth, truth[::-1, ::-1]) for j in range(7 - h) for i in range(10 - w)]
    turned = np.rot90(truth)
    parts += [
        g[j : j + h, i : i + w] for g in (turned, turned[::-1, ::-1]) for j in range(10 - h) for i in range(7 - w)
    ]
    parts = [part for part in parts if part.shape == seen.shape]
    assert min(np.hypot(*(seen - part).reshape(-1, 2).T).max() for part in parts) < 0.3


def test_a_grid_that_skips_rows_is_not_a_chessboard():
    frame = render(*POSES[0], board_wh=(10, 7))
    grid = true_corners(*POSES[0], board_wh=(10, 7)).reshape(7, 10, 2)
    for right in (grid, grid[::-1], np.rot90(grid), grid[1:5, 2:7]):
        assert _chessboard_part(frame, right).shape == right.shape
    columns = [[0, 1, 2, 4, 5, 6], [0, 2, 4, 6, 8], [0, 3, 6, 9], [0, 1, 4, 5, 6, 7]]
    for wrong in [grid[:, c] for c in columns] + [grid[::3, ::3], grid[::2, ::2], grid[[0, 1, 2, 4, 5]], grid + 15]:
        part = _chessboard_part(frame, wrong)  # nothing, or what is left without the skip
        assert part is None or part.size < wrong.size and 36 < _square_px(part).min() < _square_px(part).max() < 54


def test_the_rim_of_the_board_and_corners_outside_the_frame_are_taken_off():
    pose = ((0.2, -0.3, -0.6), (0.3, 0.1, 18.0))
    frame = render(*pose, board_wh=(6, 5))
    grid = true_corners(*pose, board_wh=(6, 5)).reshape(5, 6, 2)
    rim = np.concatenate([grid, 2 * grid[:, -1:] - grid[:, -2:-1]], axis=1)
    rim = np.concatenate([2 * rim[:1] - rim[1:2], rim])
    np.testing.assert_array_equal(_chessboard_part(frame, rim), grid)
    left = int(grid[:, 0, 0].max()) + 1  # cuts off the first column of corners
    cut = np.ascontiguousarray(frame[:, left:])
    part = _chessboard_part(cut, grid - (left, 0))
    assert part.shape[1] <= 5 and part.min() >= 0


def stripes() -> np.ndarray:
    return np.repeat(np.where(np.arange(300) // 20 % 2, 220, 30).astype(np.uint8)[None], 200, axis=0)


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((200, 300), np.uint8),
        np.full((200, 300, 3), 255, np.uint8),
        np.zeros((1, 1, 3), np.uint8),
        np.zeros((1, 900), np.uint8),
        np.random.default_rng(1).integers(0, 256, (240, 360, 3), np.uint8),
        stripes(),
    ],
    ids=["black", "white", "1x1", "one row", "noise", "stripes"],
)
def test_no_board_is_falsy_with_a_reason(frame):
    board = find_board(frame, (7, 5))
    assert not board and board.corners_px is None and "no 7x5 board" in board.reason


def test_a_board_of_another_size_is_named():
    board = find_board(render(*POSES[0]), (6, 5))
    assert not board and board.reason == "shows 7x5 inner corners, more than 6x5"


def test_a_hopeless_blur_is_no_board():
    frame = cv2.GaussianBlur(render(*POSES[9]), (0, 0), 20)
    assert not find_board(frame, (7, 5))


@pytest.mark.parametrize(
    "image", [np.zeros((9, 9)), np.zeros((9, 9, 4), np.uint8), np.zeros((0, 9), np.uint8), None, 3]
)
def test_what_is_no_picture_is_refused(image):
    with pytest.raises(LanelibError, match="need a uint8"):
        find_board(image)


@pytest.mark.parametrize("board_wh", [(2, 6), (9, 0), (9,), "9x6", None, (1000, 6), (-9, 6)])
def test_what_is_no_board_size_is_refused(board_wh):
    with pytest.raises(LanelibError, match="inner corners"):
        find_board(np.zeros((9, 9), np.uint8), board_wh)


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(0, 6.3), size=st.floats(3, 90), w=st.integers(3, 12), h=st.integers(3, 9), k=st.floats(0, 0.3))
def test_straightness_of_a_sheared_turned_grid_is_zero_and_of_a_bent_one_known(angle, size, w, h, k):
    x, y = np.mgrid[0:w, 0:h].T.reshape(-1, 2).T * size
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    straight = np.stack([x + 0.4 * y, y], axis=1) @ turn.T
    assert straightness_px(straight, (w, h)) < 1e-6
    # Every other column is moved along its own direction: columns stay straight, rows become zigzags of amplitude k.
    zigzag = np.stack([x, y + k * size * np.where(np.arange(w * h) % w % 2, 1, -1)], axis=1) @ turn.T
    row = np.stack([x[:w], zigzag[:w] @ turn[:, 1]], axis=1)
    centred = row - row.mean(axis=0)
    least = np.linalg.eigvalsh(centred.T @ centred)[0]  # sum of squared distances from the best line
    assert straightness_px(zigzag, (w, h)) == pytest.approx(np.sqrt(max(least, 0) * h / (2 * w * h)), abs=1e-5 * size)


def test_one_row_of_corners_is_straight_or_not():
    """Each of its columns is a single corner, which lies on its line."""
    row = np.column_stack([np.arange(6.0), np.zeros(6)])
    assert straightness_px(row, (6, 1)) == straightness_px(row, (1, 6)) == pytest.approx(0, abs=1e-12)
    row[:, 1] = [1, -1, 0, 0, -1, 1]  # no slope, mean 0; the columns count as lines without error
    assert straightness_px(row, (6, 1)) == pytest.approx(np.sqrt(4 / 12))
