"""lanelib.distortion on its own, in normalised coordinates."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib.distortion import distort, fold_radius, undistort

LENSES = [(-0.33, 0.12, 0.004, -0.003, -0.02), (0.25, -0.05, -0.002, 0.001, 0.04), (0.0, 0.0, 0.01, 0.02, 0.0)]


def disc(r_max: float, n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(8)
    r, phi = r_max * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


@pytest.mark.parametrize("lens", LENSES)
def test_distort_agrees_with_opencv(lens):
    xy = disc(0.8)
    rays = np.column_stack([xy, np.ones(len(xy))])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(lens))
    np.testing.assert_allclose(distort(xy, np.array(lens)), expected.reshape(-1, 2), atol=1e-12)


@pytest.mark.parametrize("lens", LENSES)
def test_undistort_is_the_inverse(lens):
    xy = disc(0.8)
    np.testing.assert_allclose(undistort(distort(xy, np.array(lens)), np.array(lens)), xy, atol=1e-9)


def test_no_lens_changes_nothing():
    xy = disc(3.0)
    assert (distort(xy, np.zeros(5)) == xy).all() and (undistort(xy, np.zeros(5)) == xy).all()
    assert math.isinf(fold_radius(np.zeros(5)))


@settings(max_examples=50, deadline=None)
@given(k1=st.floats(-0.5, 0.5), k2=st.floats(-0.3, 0.3), k3=st.floats(-0.1, 0.1))
def test_the_distorted_radius_grows_up_to_the_fold_and_no_further(k1, k2, k3):
    lens = np.array([k1, k2, 0, 0, k3])
    r = np.linspace(0, min(fold_radius(lens), 5), 2001)[:-1]
    shown = distort(np.stack([r, 0 * r], axis=1), lens)[:, 0]
    assert (np.diff(shown) > 0).all()
    if math.isfinite(fold_radius(lens)):
        beyond = fold_radius(lens) * np.array([1.0, 1 + 1e-3])
        after = distort(np.stack([beyond, 0 * beyond], axis=1), lens)[:, 0]
        assert after[1] <= after[0] + 1e-5 * (1 + abs(after[0]))
        seen = distort(np.array([[fold_radius(lens) * 1.001, 0]]), lens, r_max=fold_radius(lens))
        assert np.isnan(seen).all()


def test_what_the_lens_cannot_show_is_nan():
    lens = np.array([-0.3, 0, 0, 0, 0])
    r_max = fold_radius(lens)
    assert r_max == pytest.approx(math.sqrt(1 / 0.9))
    farthest = r_max * (1 - 0.3 * r_max**2)
    back = undistort(np.array([[0.999 * farthest, 0], [1.001 * farthest, 0], [0, np.nan]]), lens, r_max=r_max)
    assert np.isfinite(back).all(axis=1).tolist() == [True, False, False] and back[0, 0] < r_max


def test_a_ray_found_beyond_the_fold_is_none():
    """With these terms the polynomial folds, comes back and grows again: Newton's method finds rays out there that the
    lens does not show."""
    lens = np.array([-0.4, 0.15, 0, 0, -0.03])
    r_max = fold_radius(lens)
    at = disc(1.5, 2000)
    every, shown = undistort(at, lens), undistort(at, lens, r_max=r_max)
    radius = np.hypot(*every.T)
    beyond = np.isfinite(radius) & (radius >= r_max)
    assert beyond.sum() > 100 and np.isnan(shown[beyond]).all()
    assert (np.isfinite(shown).all(axis=1) == (radius < r_max)).all()
