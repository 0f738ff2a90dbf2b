"""Arrays that are handed in, and copies."""

import numpy as np
import pytest

from lanelib.arrays import as_picture, as_points, as_size_wh, in_short, owned
from lanelib.errors import LanelibError


def test_what_is_owned_is_a_copy_that_cannot_be_changed():
    given = np.array([1.0, 2.0])
    kept = owned(given)
    given[0] = 9
    assert kept.tolist() == [1, 2] and kept.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 9


def test_points_become_float64():
    assert as_points([[1, 2, 3]], 3).dtype == np.float64
    assert as_points(np.empty((0, 2)), 2).shape == (0, 2)


@pytest.mark.parametrize("points", [[1, 2], [[1, 2, 3]], [[1], [2, 3]], "ab", None, np.zeros((2, 2, 2))])
def test_what_is_no_points_is_one_line(points):
    with pytest.raises(LanelibError, match=r"^need points of shape \(N, 2\), found .*$"):
        as_points(points, 2)


@pytest.mark.parametrize("size_wh", [(0, 5), (5,), (5, 5, 5), (2.5, 5), "5x5", None, (float("inf"), 5)])
def test_what_is_no_size_is_one_line(size_wh):
    with pytest.raises(LanelibError, match=r"^grid: need size_wh as two whole numbers above 0, found .*$"):
        as_size_wh(size_wh, "grid")


def test_a_size_is_made_of_plain_numbers():
    assert as_size_wh(np.array([640.0, 360.0]), "grid") == (640, 360)


@pytest.mark.parametrize("picture", [None, np.zeros((360, 641, 3), np.uint8), np.zeros((360, 640), bool)])
def test_a_picture_of_another_size_or_kind_is_one_line(picture):
    with pytest.raises(LanelibError, match="^warp: need "):
        as_picture(picture, (640, 360), "warp", "use another")


def test_long_values_are_cut():
    assert len(in_short("x" * 500)) == 80 and in_short(np.eye(2)) == "array([[1., 0.], [0., 1.]])"
