"""Channels, gradients, masks and recipes against pictures with a known answer, and against hand-labelled frames."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paint_score import PaintScore, read_labels, score_mask, score_recipe

from lanelib.channels import (
    CHANNELS,
    as_bgr,
    channel_by_name,
    equalise_lightness,
    hsv_white,
    hsv_yellow,
    in_range,
)
from lanelib.errors import LanelibError
from lanelib.paint import STRONG_Z, WEAK_Z
from lanelib.threshold import (
    DEFAULT_RECIPE,
    RECIPES,
    Gradients,
    abs_sobel_mask,
    all_of,
    any_of,
    close_gaps,
    direction,
    direction_mask,
    keep_long,
    magnitude,
    magnitude_mask,
    paint_response,
    paint_ridges,
    paint_steps,
    recipe_by_name,
    ridge,
    scale_to_255,
    sobel,
    stripe_widths,
)

WHITE, YELLOW, ASPHALT, CONCRETE = (230, 230, 230), (60, 190, 235), (70, 70, 70), (150, 160, 165)  # BGR


def pixel(colour):
    return np.full((1, 1, 3), colour, np.uint8)


# -------------------------------------------------------------------------------------------------- colour


@pytest.mark.parametrize(
    ("name", "expected"),
    [  # by hand from the definitions, for B, G, R = 40, 120, 200
        ("grey", 0.299 * 200 + 0.587 * 120 + 0.114 * 40),
        ("rgb_r", 200),
        ("rgb_g", 120),
        ("rgb_b", 40),
        ("hls_h", 15),  # 60 degrees · (120 - 40) / 160 = 30 degrees, in steps of two
        ("hls_l", 120),
        ("hls_s", 255 * 160 / (200 + 40)),
        ("hsv_h", 15),
        ("hsv_s", 255 * 160 / 200),
        ("hsv_v", 200),
        ("yuv_y", 0.299 * 200 + 0.587 * 120 + 0.114 * 40),
        ("yuv_u", 128 + 0.492 * (40 - 134.8)),
        ("yuv_v", 128 + 0.877 * (200 - 134.8)),
    ],
)
def test_channels_agree_with_their_definitions(name, expected):
    assert float(CHANNELS[name](pixel((40, 120, 200)))[0, 0]) == pytest.approx(expected, abs=1.01)


def test_lab_of_grey_is_neutral_and_of_yellow_is_not():
    assert CHANNELS["lab_a"](pixel((90, 90, 90)))[0, 0] == 128
    assert CHANNELS["lab_b"](pixel((90, 90, 90)))[0, 0] == 128
    assert CHANNELS["lab_b"](pixel(YELLOW))[0, 0] > 170
    assert CHANNELS["lab_l"](pixel((255, 255, 255)))[0, 0] == 255


@pytest.mark.parametrize("name", CHANNELS)
@pytest.mark.parametrize("shape", [(1, 1), (4, 3), (4, 3, 1), (4, 3, 3), (4, 3, 4)])
def test_every_channel_takes_every_usual_picture(name, shape):
    frame = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    channel = channel_by_name(frame, name)
    assert channel.shape == shape[:2]
    assert channel.dtype == np.uint8
    assert channel.flags.c_contiguous


@pytest.mark.parametrize(
    "bad", [None, "picture.jpg", np.zeros((3, 3), float), np.zeros((0, 4, 3), np.uint8), np.zeros((2, 2, 2), np.uint8),
            np.zeros(5, np.uint8)]
)
def test_bad_pictures_are_one_clear_line(bad):
    for use in (as_bgr, CHANNELS["hls_s"], RECIPES["paint"].function, RECIPES["clahe-colour-sobel"].function):
        with pytest.raises(LanelibError, match="is needed, found") as error:
            use(bad)
        assert "\n" not in str(error.value)


def test_unknown_names_list_the_known_ones():
    with pytest.raises(LanelibError, match="lab_b"):
        channel_by_name(pixel(WHITE), "labb")
    with pytest.raises(LanelibError, match="gradient-and-colour"):
        recipe_by_name("best")
    assert recipe_by_name().name == DEFAULT_RECIPE


def test_colour_masks_tell_white_yellow_and_road_apart():
    frame = np.concatenate([pixel(colour) for colour in (WHITE, YELLOW, ASPHALT, CONCRETE)], axis=1)
    assert hsv_white(frame).tolist() == [[255, 0, 0, 0]]
    assert hsv_yellow(frame).tolist() == [[0, 255, 0, 0]]
    assert in_range(np.array([[1.0, np.nan, 3.0]]), 1, 2).tolist() == [[255, 0, 0]]


@pytest.mark.parametrize("options", [{"tiles": 0}, {"tiles": 100_000}, {"tiles": 2.5}, {"clip_limit": 0.0}])
def test_clahe_refuses_what_would_end_python(options):
    with pytest.raises(LanelibError, match="tiles a side and a clip limit"):
        equalise_lightness(np.full((40, 60, 3), 90, np.uint8), **options)


def test_clahe_stretches_lightness_keeps_colour_and_leaves_its_input_alone():
    ramp = np.tile(np.linspace(100, 120, 160).astype(np.uint8), (120, 1))
    frame = cv2.merge([ramp, ramp, ramp])
    before = frame.copy()
    result = equalise_lightness(frame, clip_limit=8, tiles=2)
    assert np.ptp(CHANNELS["lab_l"](result)) > 2 * np.ptp(CHANNELS["lab_l"](frame))
    assert np.abs(CHANNELS["lab_b"](result).astype(int) - 128).max() <= 2
    assert (frame == before).all()


# ----------------------------------------------------------------------------------------------- gradients


@pytest.mark.parametrize("ksize", [1, 3, 5, 9, 15, 31])
def test_sobel_of_a_ramp_is_its_slope_for_every_kernel(ksize):
    y, x = np.mgrid[:70, :90]
    gradients = sobel((2.5 * x - 1.25 * y).astype(np.float32), ksize=ksize)
    inside = np.s_[20:-20, 20:-20]
    assert gradients.x[inside] == pytest.approx(2.5, abs=1e-3)
    assert gradients.y[inside] == pytest.approx(-1.25, abs=1e-3)
    assert magnitude(gradients)[inside] == pytest.approx(math.hypot(2.5, 1.25), abs=1e-3)
    assert direction(gradients)[inside] == pytest.approx(math.atan2(1.25, 2.5), abs=1e-3)


def test_sobel_agrees_with_opencv_and_does_not_wrap_around():
    channel = np.random.default_rng(2).integers(0, 256, (40, 50), dtype=np.uint8)
    gradients = sobel(channel, ksize=5)
    assert gradients.x == pytest.approx(cv2.Sobel(channel, cv2.CV_64F, 1, 0, ksize=5) / 128, abs=1e-4)
    edge = np.zeros((9, 10), np.uint8)
    edge[:, :5] = 255  # falling edge: negative, lost in 8 bits
    assert sobel(edge).x.min() == pytest.approx(-127.5)
    assert abs_sobel_mask(sobel(edge), 200)[4].tolist() == [0, 0, 0, 0, 255, 255, 0, 0, 0, 0]
    assert not abs_sobel_mask(sobel(edge), 200, axis="y").any()


@pytest.mark.parametrize("ksize", [0, 2, 33, -3])
def test_bad_kernel_sizes_are_refused(ksize):
    with pytest.raises(LanelibError, match="odd Sobel kernel"):
        sobel(np.zeros((5, 5), np.uint8), ksize=ksize)


def test_gradient_masks_select_what_they_say():
    gradients = Gradients(np.array([[3.0, 0.0, -3.0, 0.0]], np.float32), np.array([[4.0, 2.0, 3.0, 0.0]], np.float32))
    assert scale_to_255(gradients.x).tolist() == [[255, 0, 255, 0]]
    assert magnitude_mask(gradients, 0.5 * 255).tolist() == [[255, 0, 255, 0]]  # 5, 2, 4.24, 0
    assert direction_mask(gradients, 0.7, 0.8).tolist() == [[0, 0, 255, 0]]  # 53, 90, 45 degrees
    with pytest.raises(LanelibError, match="axis"):
        abs_sobel_mask(gradients, 1, axis="z")


def test_combining_and_closing():
    a, b = np.array([[0, 255, 0, 255]], np.uint8), np.array([[0, 0, 255, 255]], np.uint8)
    assert any_of(a, b).tolist() == [[0, 255, 255, 255]]
    assert all_of(a, b).tolist() == [[0, 0, 0, 255]]
    mask = np.full((20, 20), 255, np.uint8)
    mask[9:11, 9:11] = 0
    assert close_gaps(mask, size_px=3).all()
    assert not close_gaps(np.zeros((9, 9), np.uint8)).any()
    for size_px in (0, 4, -1):  # an even square would move the mask
        with pytest.raises(LanelibError, match="odd number of pixels"):
            close_gaps(mask, size_px=size_px)
    for masks in ((), (a, mask), (None,)):
        with pytest.raises(LanelibError):
            any_of(*masks)


@pytest.mark.parametrize("kind", [bool, np.int64, np.float64])
def test_masks_of_any_numbers_are_cleaned_alike(kind):
    mask = np.zeros((60, 40), np.uint8)
    mask[10:50, 10:14] = mask[30:32, 30:33] = 1
    for clean in (close_gaps, lambda m: keep_long(m, horizon_row=3.0), keep_long):
        assert np.array_equal(clean(mask.astype(kind)) != 0, clean(mask) != 0)


@pytest.mark.parametrize("bad", [np.zeros((0, 5), np.uint8), None, np.zeros((4, 4, 3), np.uint8)])
def test_what_is_no_mask_is_refused_before_opencv_sees_it(bad):
    """OpenCV ends the process on an empty picture."""
    for clean in (close_gaps, keep_long, lambda m: keep_long(m, horizon_row=3.0)):
        with pytest.raises(LanelibError, match="one channel"):
            clean(bad)


# --------------------------------------------------------------------------------------- the paint's ridge


def road(colour=ASPHALT, paint=WHITE, *, shape=(300, 500), horizon=120, slope=0.12, lines=(-0.9, 1.1), light=1.0):
    """A flat road with lines x = centre + line · (row - horizon), `slope` px wide per row below the horizon.

    Returns the frame and truth (H, W): 0 road, 1 paint, 2 the middle half of the paint's width.
    """
    frame = np.empty((*shape, 3), np.float64)
    frame[:] = colour
    y, x = np.mgrid[: shape[0], : shape[1]]
    truth = np.zeros(shape, int)
    for line in lines:
        for part in (1, 2):
            beside = np.abs(x - shape[1] / 2 - line * (y - horizon))
            truth[(y > horizon) & (beside <= slope * (y - horizon) / 2 / part)] = part
    frame[truth > 0] = paint
    return np.clip(cv2.GaussianBlur(frame, (0, 0), 0.7) * light, 0, 255).round().astype(np.uint8), truth


def agreement(mask, truth, horizon=120):
    """Share of the paint's middle found, share of the mask on paint or a pixel beside; 30 rows below the horizon on."""
    grown = cv2.dilate((truth > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mask, grown, middle = (part[horizon + 30 :] for part in (mask > 0, grown, truth == 2))
    return (mask & middle).sum() / middle.sum(), (mask & grown).sum() / max(mask.sum(), 1)


@pytest.mark.parametrize("light", [1.0, 0.35, 0.15])
@pytest.mark.parametrize("colour", [ASPHALT, CONCRETE])
@pytest.mark.parametrize("paint", [WHITE, YELLOW])
def test_paint_is_found_in_any_light_on_any_road(colour, paint, light):
    frame, truth = road(colour, paint, light=light)
    recall, precision = agreement(paint_steps(frame, horizon_row=120)["long enough"], truth)
    assert recall > 0.97
    assert precision > 0.8  # the stripe's ends reach a little into the road


def test_yellow_of_the_road_s_own_brightness_is_found_by_colour_alone():
    grey_of_yellow = (YELLOW[1] + YELLOW[2]) / 2
    frame, truth = road((grey_of_yellow,) * 3, YELLOW)
    steps = paint_steps(frame, horizon_row=120)
    assert not steps["brighter on both sides"].any()
    assert agreement(steps["yellower on both sides"], truth)[0] > 0.97


def test_red_stripes_are_not_yellow():
    frame, _ = road((100, 100, 100), (60, 60, 140))  # (R + G) / 2 is the road's
    assert not paint_steps(frame, horizon_row=120)["long enough"].any()


def test_five_grey_levels_under_a_bridge():
    frame, truth = road((30, 30, 30), (36, 35, 35))
    assert agreement(paint_steps(frame, horizon_row=120)["long enough"], truth)[0] > 0.9


def test_what_is_bright_on_one_side_only_is_not_paint():
    frame, _ = road(lines=())
    for shape in ("shadow edge", "wide patch", "dark seam"):
        picture = frame.copy()
        if shape == "shadow edge":
            picture[:, 250:] = (25, 25, 25)
        elif shape == "wide patch":
            picture[:, 200:320] = (190, 190, 190)
        else:
            picture[:, 245:252] = (30, 30, 30)
        near = paint_steps(picture, horizon_row=120)["long enough"][170:]
        assert not near.any(), shape


@pytest.mark.parametrize("light", [1.0, 0.5])
@pytest.mark.parametrize("paint", [WHITE, YELLOW])
def test_the_response_is_that_of_paint_and_of_nothing_else(paint, light):
    """Clearly above the weakest response on all of the paint's middle, below it on the road beside and at a shadow's
    edge."""
    frame, truth = road(ASPHALT, paint, light=light)
    z = paint_response(frame, horizon_row=120, camera_height_m=1.25)
    near = np.s_[160:]
    assert np.median(z[near][truth[near] == 2]) > STRONG_Z and (z[near][truth[near] == 2] > WEAK_Z).mean() > 0.97
    beside = cv2.dilate((truth > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    assert (z[near][beside[near]] > WEAK_Z).mean() < 0.02
    assert not z[:120].any() and z.dtype == np.float32 and z.shape == truth.shape
    with pytest.raises(LanelibError, match="height of 0 m"):
        paint_response(frame, horizon_row=120, camera_height_m=0)
    plain, _ = road(ASPHALT, lines=())
    plain[:, 250:] = (25, 25, 25)
    assert (paint_response(plain, horizon_row=120, camera_height_m=1.25)[160:, 235:265] > WEAK_Z).mean() < 0.02


def test_the_response_sees_yellow_no_brighter_than_the_road():
    grey = (150, 150, 150)
    frame, truth = road(grey, (80, 185, 185))  # the mean of blue, green and red is the road's
    z = paint_response(frame, horizon_row=120, camera_height_m=1.25)[160:]
    assert np.median(z[truth[160:] == 2]) > STRONG_Z


def test_the_horizon_and_slope_describe_the_camera():
    widths = stripe_widths(1000, horizon_row=400, paint_slope=0.05)
    assert (widths[:410] == 0).all()
    assert (widths[411:] % 2 == 1).all()
    assert np.abs(widths[500:] - 0.05 * np.arange(100, 600)).max() <= 1
    frame, truth = road(shape=(300, 500), horizon=60, slope=0.12, lines=(-0.8, 0.9))
    assert agreement(paint_steps(frame, horizon_row=60)["long enough"], truth, horizon=60)[0] > 0.97
    high_camera, _ = road(slope=0.5)  # stripes four times too wide for the default
    near = np.s_[200:]
    assert paint_steps(high_camera, horizon_row=120, paint_slope=0.4)["either"][near].sum() > 5 * (
        paint_steps(high_camera, horizon_row=120, paint_slope=0.04)["either"][near].sum()
    )


def test_ridge_agrees_with_its_formula_written_pixel_by_pixel():
    rng = np.random.default_rng(8)
    values, brightness = rng.random((3, 90)) * 50, rng.random((3, 90)) * 100 + 20
    width, side, around = 5, round(1.75 * 5), 16 * 5 + 1
    padded = np.pad(values, ((0, 0), (200, 200)), mode="edge")
    bright = np.pad(brightness, ((0, 0), (200, 200)), mode="edge")

    def clipped(row, x):  # borders repeat the box means of the outermost columns
        x = min(max(x, 0), 89) + 200
        return padded[row, x - width // 2 : x + width // 2 + 1].mean()

    def lone(row, x):
        x = min(max(x, 0), 89)
        return abs(clipped(row, x) - (clipped(row, x - side) + clipped(row, x + side)) / 2)

    result = ridge(values.astype(np.float32), brightness.astype(np.float32), width)
    for row, x in ((0, 0), (1, 44), (2, 89), (1, 7)):
        top = clipped(row, x) - max(clipped(row, x - side), clipped(row, x + side))
        texture = np.mean([lone(row, x + k) for k in range(-(around // 2), around // 2 + 1)])
        level = bright[row, x + 200 - around // 2 : x + 200 + around // 2 + 1].mean()
        assert result[row, x] == pytest.approx(top / max(2.0 * texture, 0.08 * (level + 4)), rel=1e-4)


def test_short_pieces_are_dropped_in_proportion_to_their_distance():
    mask = np.zeros((300, 100), np.uint8)
    mask[130:134, 10:13] = 255  # 4 rows, 13 below the horizon at 120: 3 are enough
    mask[280:290, 40:43] = 255  # 10 rows, 169 below: 17 are needed
    mask[260:290, 70:73] = 255
    kept = keep_long(mask, horizon_row=120)
    assert kept[131, 11]
    assert not kept[:, 40:43].any()
    assert (kept[:, 70:73] == mask[:, 70:73]).all()
    # 13 rows to row 254: by the lowest row 13.4 are needed, by the topmost 12.2
    mask = np.zeros((300, 100), np.uint8)
    mask[242:255, 10:13] = 255
    assert not keep_long(mask, horizon_row=120).any()
    mask[:] = 0
    mask[122:124, 10:13] = 255  # two rows: far away the lens blurs anything to three
    assert not keep_long(mask, horizon_row=120).any()


@settings(max_examples=40, deadline=None)
@given(light=st.floats(0.3, 1.0), seed=st.integers(0, 20))
def test_the_ridge_does_not_care_how_bright_the_light_is(light, seed):
    rng = np.random.default_rng(seed)
    values = (rng.random((4, 200)) * 200).astype(np.float32)
    bright = ridge(values, values + 1000, 7)  # far above LEVELS_MIN
    dim = ridge(values * np.float32(light), (values + 1000) * np.float32(light), 7)
    assert dim == pytest.approx(bright, rel=0.02, abs=1e-4)


# ------------------------------------------------------------------------------------------------- recipes


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=list(RECIPES))
@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 3), (2, 3, 4), (7, 5), (1, 640, 3), (360, 1, 3), (45, 60, 3)])
def test_recipes_take_any_frame_and_give_masks_at_every_step(recipe, shape):
    for frame in (np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8),
                  np.random.default_rng(4).integers(0, 256, shape, dtype=np.uint8)):
        before = frame.copy()
        steps = recipe.steps(frame)
        assert len(steps) >= 3
        for mask in steps.values():
            assert mask.shape == shape[:2]
            assert mask.dtype == np.uint8
            assert set(np.unique(mask)) <= {0, 255}
        assert (recipe.function(frame) == list(steps.values())[-1]).all()
        assert (frame == before).all()


@pytest.mark.parametrize("name", ["sobel-or-colour", "gradient-and-colour", "clahe-colour-sobel"])
def test_classic_recipes_combine_their_steps_as_their_name_says(name):
    frame, _ = road(light=0.9)
    frame = cv2.add(frame, np.random.default_rng(6).integers(0, 40, frame.shape, dtype=np.uint8))
    s = {key: mask > 0 for key, mask in RECIPES[name].steps(frame).items()}
    expected = {
        "sobel-or-colour": lambda: (s["sobel x"] & s["magnitude"] & s["direction"]) | s["S of HLS"] | s["R of RGB"],
        "gradient-and-colour": lambda: s["gradient"] & (s["HLS"] | s["HSV"] | s["LAB"]),
        "clahe-colour-sobel": lambda: close_gaps(
            (s["HLS white"] | s["HSV yellow"] | s["sobel x"]).astype(np.uint8), size_px=5
        ) > 0,
    }[name]()
    assert expected.any()
    assert (RECIPES[name].function(frame) > 0).tolist() == expected.tolist()


def test_black_and_flat_frames_hold_no_paint():
    for value in (0, 128, 255):
        assert not RECIPES["paint"].function(np.full((90, 160, 3), value, np.uint8)).any()
        assert not any(part.any() for part in paint_ridges(np.full((90, 160, 3), value, np.uint8)))


# --------------------------------------------------------------------------------- the score, and real frames


def test_the_score_itself():
    label = {"h_samples": [10, 20], "lanes": [[100, 100], [283, 283]], "paint": [[1, 1], [1, 0]]}  # 50 px per metre
    mask = np.zeros((30, 400), np.uint8)
    assert score_mask(mask, label) == PaintScore(0, 3, 0, 0)
    mask[10, 98:103] = 255  # on the left line
    mask[20, 283] = 255  # between dashes: not paint
    mask[20, 395:] = 255  # beyond the road that is looked at
    score = score_mask(mask, label)
    assert (score.hits, score.rows) == (1, 3)
    assert score.on_paint == pytest.approx(5 / 6)  # paint is 6 px wide
    assert score.precision == pytest.approx(5 / 6)
    everything = score_mask(np.full((30, 400), 255, np.uint8), label)
    assert everything.recall == 1
    assert everything.precision < 0.1


@pytest.fixture(scope="module")
def labelled_frames(real_dir):
    return read_labels(real_dir)


@pytest.mark.parametrize("light", [1.0, 0.7, 0.5, 0.35])
def test_the_default_beats_the_three_classic_recipes_on_labelled_frames(labelled_frames, light):
    scores = {name: score_recipe(recipe.function, labelled_frames, light=light) for name, recipe in RECIPES.items()}
    ours = scores.pop(DEFAULT_RECIPE)
    print(f"light {light}: {DEFAULT_RECIPE}: {ours}", *(f"{name}: {s}" for name, s in scores.items()), sep="\n  ")
    assert ours.f1 > max(score.f1 for score in scores.values()) + 0.05
    assert ours.recall > 0.94
    assert ours.precision > 0.9
