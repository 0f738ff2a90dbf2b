"""paint.py: a ridge answers, a step and a dark stripe do not; crests lie on the paint, whatever the light."""

import cv2
import numpy as np
import pytest
from roads import ASPHALT, WHITE, paint_scan

from lanelib.birdseye import Grid
from lanelib.paint import (
    FLOOR_GREY_LEVELS,
    PAINT_WIDTH_M,
    STRONG_Z,
    TEXTURE_SIZE_M,
    WEAK_Z,
    brightness_of_luma,
    paint_channels,
    paint_evidence,
    paint_points,
    ridge_response,
    weight_of,
    yellow_of_uv,
)

GRID = Grid(np.arange(-192, 193) * 0.05, np.linspace(45, 4, 60))
STEP = Grid(np.arange(-120, 121) * 0.07, np.linspace(30, 4, 40))  # another column width than the finder's


def evidence_of(picture, column_m=0.05):
    return paint_evidence(picture, column_m=column_m)


def crests_of(picture):
    """Paint points of a scan with columns of 5 cm, as the finder takes them."""
    return paint_points(evidence_of(picture))


def column_profile(values, width=301):
    """One row of a channel with ``values`` (column from, to, grey) on a road of 100, repeated over nine rows."""
    row = np.full(width, 100, np.uint8)
    for start, end, grey in values:
        row[start:end] = grey
    return np.tile(row, (9, 1))


# ---------------------------------------------------------------------------------------------- ridges and others
@pytest.mark.parametrize("grey", [10, 60, 97, 104, 160, 250])
@pytest.mark.parametrize("edge", [90, 150])
def test_a_step_answers_nothing(grey, edge):
    """A shadow's edge, a seam between two surfaces, a kerb: brighter on one side only."""
    for step in (column_profile([(edge, 301, grey)]), column_profile([(0, edge, grey)])):
        assert ridge_response(step).max() == 0


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_a_dark_stripe_answers_nothing_in_its_middle(width):
    """A seam filled with tar, 5-25 cm wide. Nothing on it, and nowhere more than noise does beside it."""
    dark = ridge_response(column_profile([(150, 150 + width, 40)]))
    assert dark.max() < WEAK_Z
    assert ridge_response(column_profile([(150, 150 + width, 160)])).max() > STRONG_Z


@pytest.mark.parametrize("contrast", [8, 20, 60, 150])
@pytest.mark.parametrize("width", [2, 3])
def test_a_stripe_of_paint_answers_at_any_contrast(contrast, width):
    z = ridge_response(column_profile([(150, 150 + width, 100 + contrast)]))
    assert z[4].argmax() in range(149, 151 + width)
    assert z[4].max() > (STRONG_Z if contrast > 50 else WEAK_Z)
    assert z[4, :140].max() == z[4, 163:].max() == 0  # and nowhere else


def test_a_broad_bright_surface_is_no_paint():
    """A strip of concrete 2 m wide, brighter than the asphalt on both sides, has two steps and no ridge."""
    z = ridge_response(column_profile([(130, 170, 180)]))
    assert z[:, 140:160].max() == 0 and z.max() < WEAK_Z
    assert ridge_response(column_profile([(147, 153, 180)])).max() > STRONG_Z  # a double line of 0.3 m has one


def test_the_response_follows_the_columns_width_in_metres():
    """The same stripe of 0.14 m in columns of 2 and of 7 cm."""
    for column_m in (0.02, 0.07):
        half = int(round(0.07 / column_m))
        paint = column_profile([(150 - half, 150 + max(half, 1), 180)])
        kerb = column_profile([(150 - 9 * half, 150 + 9 * half, 180)])  # 1.3 m
        assert ridge_response(paint, column_m=column_m).max() > STRONG_Z
        assert ridge_response(kerb, column_m=column_m)[:, 148:152].max() == 0


def response_by_hand(row, width):
    """The formula in floating point, of a row of a picture whose rows are alike."""
    border = 3 * width
    padded = np.pad(row.astype(float), border, mode="edge")
    box = np.convolve(padded, np.ones(width) / width, "same")
    at = lambda k: np.roll(box, -k)[border:-border]  # noqa: E731
    near, far, step = width + 1, 2 * width + 1, width // 2 + 1
    ridge = at(0) - np.maximum(at(-near), at(near))
    wide = (at(-step) + at(0) + at(step)) / 3 - np.maximum(at(-far), at(far))
    return np.maximum(np.maximum(ridge, wide), 0), np.abs(at(0) - (at(-near) + at(near)) / 2)


@pytest.mark.parametrize("width", [3, 41, 43, 57, 75, 113, 135])
@pytest.mark.parametrize("lines", [1, 3])
def test_paint_of_any_width_in_columns_answers_alike(width, lines):
    """Sums of bright paint leave what 16 bits hold from 43 columns on: a frame of 4K has 109."""
    size = round(TEXTURE_SIZE_M / (PAINT_WIDTH_M / width)) | 1
    columns = 3 * size
    row = np.full(columns, 150, np.uint8)
    row[columns // 2 - lines * width // 2 : columns // 2 + lines * width // 2 + 1] = 250
    found = ridge_response(np.tile(row, (9, 1)), column_m=PAINT_WIDTH_M / width)[4]
    ridge, texture = response_by_hand(row, width)
    mean = np.convolve(texture, np.ones(size) / size, "same")
    inside = slice(size, -size)  # the picture's border aside
    np.testing.assert_allclose(found[inside], (ridge / (mean + FLOOR_GREY_LEVELS))[inside], atol=0.15)
    assert found.max() > STRONG_Z


def test_video_planes_give_the_same_brightness_and_yellow():
    bgr = np.random.default_rng(2).integers(30, 220, (40, 60, 3), dtype=np.uint8)
    bgr = cv2.resize(bgr, (240, 160), interpolation=cv2.INTER_NEAREST)  # patches larger than a chroma pixel
    yuv = cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420)
    luma, u, v = yuv[:160], yuv[160:200].reshape(80, 120), yuv[200:].reshape(80, 120)
    yellow = paint_channels(bgr)[1][::2, ::2].astype(float)
    assert np.abs(yellow_of_uv(u, v) - yellow).max() < 6 and np.abs((yellow_of_uv(u, v) - yellow).mean()) < 0.5
    grey = np.repeat(bgr[..., :1], 3, axis=2)
    luma = cv2.cvtColor(grey, cv2.COLOR_BGR2YUV_I420)[:160]
    assert np.abs(brightness_of_luma(luma).astype(float) - paint_channels(grey)[0]).max() <= 2


def test_pictures_below_each_other_do_not_see_each_other():
    pictures = np.random.default_rng(1).integers(0, 256, (3, 20, 301), dtype=np.uint8)
    together = ridge_response(np.concatenate(pictures), rows=20)
    assert np.array_equal(together, np.concatenate([ridge_response(picture) for picture in pictures]))
    assert not np.array_equal(together, ridge_response(np.concatenate(pictures)))


def test_noise_gives_few_and_weak_points():
    """Sensor noise of 2 to 30 grey levels: a point a row at most weighs anything much, wherever it is."""
    for sigma in (2, 12, 30):
        noise = np.random.default_rng(sigma).normal(110, sigma, (136, 385, 3))
        points = crests_of(np.uint8(np.clip(noise, 0, 255)))
        assert (points.weight > 0.5).sum() <= 4
        assert points.weight.sum() / 136 < 0.5
    assert len(crests_of(np.full((136, 385, 3), 90, np.uint8))) == 0


# ---------------------------------------------------------------------------------------------- location
@pytest.mark.parametrize("width_m", [0.08, 0.12, 0.15, 0.2])
def test_crests_lie_in_the_middle_of_the_paint(width_m):
    """A slanted line passes every part of a pixel: bias below a tenth of a column, scatter below a fifth."""
    x_of_y = lambda y: 0.3 + 0.0437 * y  # noqa: E731
    scan = paint_scan(GRID, [(x_of_y, width_m, WHITE)])
    points = crests_of(scan)
    strong = points.weight > 0.5
    error = points.column[strong] - GRID.column_of(x_of_y(GRID.y_m[points.row[strong]]))
    error = error[np.abs(error) < 4]
    assert len(error) >= 55
    assert abs(error.mean()) < 0.1 and error.std() < 0.2


def test_crests_of_a_double_line_lie_within_it():
    """Two 0.1 m lines with 0.1 m between them, seen as one stripe: its points lie between the outer edges."""
    both = [(lambda y, s=s: 1.8 + s * 0.1 + 0 * y, 0.1, WHITE) for s in (-1, 1)]
    points = crests_of(cv2.blur(paint_scan(GRID, both), (5, 1)))
    strong = points.weight > 0.8
    assert strong.sum() >= 55
    assert np.abs(GRID.x_of(points.column[strong]) - 1.8).max() < 0.15


def test_the_parabola_through_three_pixels_finds_its_top():
    top = 20.3
    z = np.tile(6 - 0.5 * (np.arange(41.0) - top) ** 2, (3, 1)).astype(np.float32)
    points = paint_points(z)
    np.testing.assert_allclose(points.column, top, atol=1e-3)
    assert points.row.tolist() == [0, 1, 2]
    flat = paint_points(np.array([[0, 2, 5, 5, 2, 0]], np.float32))  # one crest, half way between the two
    assert flat.column.tolist() == [2.5]


def test_weights_run_from_weak_to_strong():
    np.testing.assert_allclose(
        weight_of(np.array([0, WEAK_Z, (WEAK_Z + STRONG_Z) / 2, STRONG_Z, 99])), [0, 0, 0.5, 1, 1]
    )


# ---------------------------------------------------------------------------------------------- light and colour
@pytest.mark.parametrize("light", [0.35, 0.6])
def test_the_response_hardly_depends_on_the_light(light):
    """A road with texture at 0.35 times the light: the stripe's z stays within a third."""
    x_of_y = lambda y: -1.7 + 0.01 * y  # noqa: E731
    bright = paint_scan(GRID, [(x_of_y, 0.12, WHITE)]).astype(float)
    bright += np.random.default_rng(3).normal(0, 6, bright.shape)
    dark = np.uint8(np.clip(bright * light, 0, 255))
    z_bright, z_dark = evidence_of(np.uint8(np.clip(bright, 0, 255))), evidence_of(dark)
    at = np.rint(GRID.column_of(x_of_y(GRID.y_m))).astype(int)
    rows = np.arange(len(at))
    ratio = z_dark[rows, at] / z_bright[rows, at]
    assert 0.67 < np.median(ratio) < 1.05  # what is missing is the floor of 2 grey levels: it counts more in the dark
    # while the plain contrast falls with the light
    contrast = [p[rows, at].mean() - p[rows, at + 20].mean() for p in (bright, dark.astype(float))]
    assert contrast[1] / contrast[0] == pytest.approx(light, rel=0.1)


@pytest.mark.parametrize(("light", "least"), [(0.07, 0.05), (0.15, 0.35), (0.3, 0.7)])
def test_paint_in_deep_shade_still_weighs(light, least):
    """The far half of the picture lies under a bridge: at 0.15 times the light a stripe keeps far more than 0.15 of its
    weight, and 7 grey levels of contrast still make points."""
    x_of_y = lambda y: 1.75 + 0 * y  # noqa: E731
    scan = paint_scan(GRID, [(x_of_y, 0.12, WHITE)]).astype(float)
    scan[:30] *= light
    points = crests_of(np.uint8(np.rint(scan)))
    on = np.abs(GRID.x_of(points.column) - 1.75) < 0.05
    assert set(points.row[on]) >= set(range(24)) | set(range(36, 60))  # between lies the shade's edge
    assert points.weight[on & (points.row < 27)].min() > least
    assert points.weight[on & (points.row > 33)].min() > 0.9


def test_yellow_paint_no_brighter_than_the_concrete_is_found():
    """Concrete (165, 172, 178) BGR and paint of the same mean of the three channels."""
    concrete, paint = (165, 172, 178), (97, 198, 220)
    assert abs(np.mean(concrete) - np.mean(paint)) < 1
    scan = paint_scan(GRID, [(lambda y: -1.8 + 0 * y, 0.12, paint)], road=concrete, noise=3)
    brightness, yellow = paint_channels(scan)
    assert ridge_response(brightness)[:, 150:162].max() < STRONG_Z
    points = crests_of(scan)
    on = (np.abs(GRID.x_of(points.column) + 1.8) < 0.1) & (points.weight > 0.9)
    assert len(set(points.row[on])) == len(GRID.y_m)
    assert ridge_response(yellow)[:, 150:162].max() > STRONG_Z


def test_channels_are_what_they_say():
    rng = np.random.default_rng(0)
    bgr = rng.integers(0, 256, (6, 9, 3), dtype=np.uint8)
    b, g, r = np.moveaxis(bgr.astype(float), 2, 0)
    brightness, yellow = paint_channels(bgr)
    assert brightness.dtype == yellow.dtype == np.uint8
    np.testing.assert_allclose(brightness, bgr.mean(axis=2), atol=1)
    np.testing.assert_allclose(yellow, np.clip((r + g) / 2 - b, 0, 255), atol=1)


def test_nothing_of_it_changes_the_picture():
    scan = paint_scan(STEP, [(lambda y: 1 + 0 * y, 0.14, WHITE)], road=ASPHALT, noise=4)
    before = scan.copy()
    z = paint_evidence(scan, column_m=0.07)
    assert (scan == before).all()
    assert z.shape == scan.shape[:2] and z.dtype == np.float32
    assert np.isfinite(z).all() and z.min() >= 0


@pytest.mark.parametrize("kind", [np.uint8, np.int64, np.float32, np.float64])
def test_crests_lie_within_half_a_pixel_of_a_local_maximum_whatever_the_numbers_are(kind):
    z = np.random.default_rng(4).integers(0, 256, (60, 90)).astype(kind)
    found = paint_points(z)
    assert len(found) > 500
    at = z[found.row, np.rint(found.column).astype(int)].astype(float)
    assert np.abs(found.column - np.rint(found.column)).max() <= 0.5
    exact = paint_points(z.astype(float))
    np.testing.assert_allclose(found.column, exact.column, atol=1e-5)
    assert (at > 1).all()
