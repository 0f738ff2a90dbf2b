"""Drawing: what is drawn stands where it must, in the colour it must have, and nothing else changes."""

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanelib import draw
from lanelib.birdseye import Grid
from lanelib.channels import yuv420_planes
from lanelib.draw.canvas import Canvas, Layer
from lanelib.draw.lettering import _GLYPHS, put_text, shortened, stamp, text_mask, text_width, wrapped
from lanelib.draw.overlays import AREA_OPACITY, LINE_WIDTH, read_out, ribbon
from lanelib.draw.panels import pixels_of_road
from lanelib.errors import LanelibError
from lanelib.lane import Lane, Line, Surface
from lanelib.search import sliding_windows

BOUNDED = settings(max_examples=50, deadline=None)


@dataclass
class Result:
    """What drawing needs of a LaneResult."""

    lane: Lane | None
    status: str
    left_px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    right_px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    size_wh: tuple[int, int] = (0, 0)
    reason: str = ""
    confidence: float = 0.8
    milliseconds: float = 1.5
    radius_m: float | None = 1020.0
    curvature_1pm: float | None = 1 / 1020
    offset_m: float | None = -0.23
    width_m: float | None = 3.66


def straight_lane(size_wh, *, status="measured", left=0.2, right=0.85, far=0.55) -> Result:
    """A lane whose lines run from the lower edge at `left`, `right` (of the width) towards `far` (of the height)."""
    w, h = size_wh
    t = np.linspace(0, 0.95, 64)[:, None]
    point = np.array([0.5 * w, far * h])
    lines = [np.array([x * w, h - 1.0]) * (1 - t) + point * t for x in (left, right)]
    lane = Lane(Line([0, 0, -1.8], (5, 40)), Line([0, 0, 1.86], (5, 40)), Surface(1.2))
    return Result(lane, status, lines[0], lines[1], size_wh)


def no_lane(reason="too little paint: 3 rows of it on both lines together, 10 needed") -> Result:
    return Result(None, "none", reason=reason, radius_m=None, curvature_1pm=None, offset_m=None, width_m=None)


def noise_frame(size_wh, seed=0, low=40, high=160) -> np.ndarray:
    return np.random.default_rng(seed).integers(low, high, (size_wh[1], size_wh[0], 3), np.uint8)


# ---------------------------------------------------------------------------------------------- overlay
@pytest.mark.parametrize("size_wh", [(800, 450), (321, 181), (1920, 1080)])
def test_overlay_is_a_new_picture_of_the_same_size(size_wh):
    frame = noise_frame(size_wh)
    before = frame.copy()
    picture = draw.overlay(frame, straight_lane(size_wh))
    assert picture.shape == frame.shape and picture.dtype == np.uint8
    assert not np.shares_memory(picture, frame)
    np.testing.assert_array_equal(frame, before)
    assert (picture != frame).any()


def test_the_area_is_the_promised_mix_of_frame_and_green():
    size = (900, 500)
    frame, result = noise_frame(size), straight_lane(size)
    picture = draw.overlay(frame, result, text=False)
    inside = (slice(450, 495), slice(380, 520))  # near the car, between the lines
    a = AREA_OPACITY["measured"]
    expected = (1 - a) * frame[inside] + a * np.array(draw.bgr("lane area"))
    assert np.abs(picture[inside] - expected).max() <= 1.0


def test_only_the_lane_s_bounding_box_changes_without_text():
    size = (900, 500)
    frame, result = noise_frame(size), straight_lane(size)
    changed = (draw.overlay(frame, result, text=False) != frame).any(axis=2)
    rows, columns = np.nonzero(changed)
    both = np.concatenate([result.left_px, result.right_px])
    reach = 0.03 * 600  # half a line's width, and a little
    assert rows.min() >= both[:, 1].min() - 2 and columns.min() >= both[:, 0].min() - reach
    assert columns.max() <= both[:, 0].max() + reach


@BOUNDED
@given(
    left=st.floats(-0.2, 0.4), right=st.floats(0.6, 1.2), far=st.floats(0.2, 0.7),
    size=st.sampled_from([(640, 360), (1000, 400), (500, 700)]),
)
def test_lines_lie_where_the_result_says(left, right, far, size):
    result = straight_lane(size, left=left, right=right, far=far)
    picture = draw.overlay(np.zeros((size[1], size[0], 3), np.uint8), result, text=False)
    rows = np.arange(12) + round(size[1] * (far + 0.75 * (1 - far)))  # where nothing fades
    columns = np.arange(size[0])
    for line, name, channel in ((result.left_px, "left line", 2), (result.right_px, "right line", 0)):
        x = np.interp(rows, line[::-1, 1], line[::-1, 0])
        slope = (x[-1] - x[0]) / (rows[-1] - rows[0])
        level = LINE_WIDTH * (right - left) * size[0] * np.hypot(1, slope)  # its width along a row
        if x.min() < level or x.max() > size[0] - level:
            continue
        # the line's main colour, less what the green area gives there
        strength = picture[rows, :, channel] - 0.36 * draw.bgr("lane area")[channel]
        strength = np.where(np.abs(columns - x[:, None]) < level, np.clip(strength, 0, None), 0)
        middle = strength @ columns / strength.sum(axis=1)
        # a line that narrows ahead is cut lopsided by a row: by a twentieth of its width
        assert abs((middle - x).mean()) < 0.2 + 0.05 * level
        assert picture[rows[0], round(x[0])].tolist() == list(draw.bgr(name))


@BOUNDED
@given(st.floats(-1.5, 1.5), st.floats(130, 170), st.floats(1.5, 9))
def test_a_ribbon_has_its_line_in_the_middle_and_its_width(slope, x0, width):
    rows = np.linspace(-20, 220, 60)
    line = np.column_stack([x0 + slope * (rows - 100), rows])
    picture = np.zeros((200, 300, 3), np.uint8)
    Canvas.of_bgr(picture).fill([ribbon(line, np.full(60, width))], (200, 200, 200))
    cover = picture[60:140, :, 0] / 200  # OpenCV's soft edges are unbiased over some rows, not in each
    middle = (cover @ np.arange(300)) / cover.sum(axis=1)
    assert abs((middle - (x0 + slope * (np.arange(60, 140) - 100))).mean()) < 0.12
    across = cover.sum(axis=1).mean() / np.hypot(1, slope)
    assert width + 0.9 < across < width + 1.5  # and add two thirds of a pixel on either side


def test_left_is_red_and_right_is_blue():
    blue, green, red = draw.bgr("left line")
    assert red > 200 and blue < 90 and green < 90
    blue, green, red = draw.bgr("right line")
    assert blue > 200 and red < 90


def line_pieces(picture, colour) -> int:
    like = (np.abs(picture.astype(int) - colour).max(axis=2) < 12).astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(like)
    return int((stats[1:, cv2.CC_STAT_AREA] > 30).sum())


def test_a_held_lane_is_dashed_and_paler():
    size = (1280, 720)
    black = np.zeros((720, 1280, 3), np.uint8)
    measured = draw.overlay(black, straight_lane(size), text=False)
    held = draw.overlay(black, straight_lane(size, status="held"), text=False)
    assert line_pieces(measured, draw.bgr("left line")) == 1
    assert line_pieces(held, draw.bgr("left line")) == 0
    codes, counts = np.unique(held[held[:, :, 2] > 200].astype(int) @ (1, 256, 65536), return_counts=True)
    code = codes[np.argmax(counts)]
    reddish = np.array([code % 256, code // 256 % 256, code // 65536])
    assert line_pieces(held, reddish) >= 5
    saturation = [np.ptp(c.astype(int)) for c in (np.array(draw.bgr("left line")), reddish)]
    assert saturation[1] < 0.75 * saturation[0]
    assert held[700, 640, 1] < measured[700, 640, 1]


def test_without_a_lane_only_the_status_is_shown():
    frame = noise_frame((1280, 720))
    np.testing.assert_array_equal(draw.overlay(frame, no_lane(), text=False), frame)
    changed = np.nonzero((draw.overlay(frame, no_lane()) != frame).any(axis=2))
    assert changed[0].max() < 250 and changed[1].max() < 420 and len(changed[0]) > 1000


@pytest.mark.parametrize("status", ["measured", "held", "none"])
@pytest.mark.parametrize(
    "size_wh", [(1, 1), (2, 3), (64, 36), (111, 61), (320, 180), (180, 320), (3840, 2160), (3000, 70)]
)
def test_any_size_and_the_card_stays_inside(size_wh, status):
    frame = np.full((size_wh[1], size_wh[0], 3), 128, np.uint8)
    result = no_lane() if status == "none" else straight_lane(size_wh, status=status)
    assert draw.overlay(frame, result).shape == frame.shape
    card = read_out(result, size_wh)
    if card is not None:
        assert card.size_wh[0] <= size_wh[0]
    if size_wh == (3840, 2160):  # three times as large as at 1280x720
        small = read_out(result, (1280, 720))
        assert abs(card.size_wh[0] / small.size_wh[0] - 3) < 0.05


def test_no_two_words_of_the_card_meet():
    """Words are stamped one after the other; where two meet, the card lost white against the sum of its words."""
    for size in ((320, 180), (640, 360), (1280, 720), (1920, 1080)):
        for status in ("measured", "held"):
            card = read_out(straight_lane(size, status=status), size).pixels
            head = card[: round(card.shape[0] * 0.27)]
            bright = (head[:, :, :3].min(axis=2) > 120).any(axis=0)  # columns with a word in the head line
            coloured = (np.ptp(head[:, :, :3].astype(int), axis=2) > 90).any(axis=0)
            coloured[: round(0.13 * card.shape[1])] = False  # the dot
            assert not (bright & coloured).any(), (size, status)  # confidence bar and words


def test_lines_far_outside_and_not_finite_do_no_harm():
    size = (640, 360)
    result = straight_lane(size)
    result.left_px = np.concatenate([[[-1e9, 1e9]], result.left_px, [[np.nan, 3.0], [5.0, np.inf]]])
    assert draw.overlay(noise_frame(size), result).shape == (360, 640, 3)
    result.left_px = result.left_px[:1]
    frame = noise_frame(size)
    np.testing.assert_array_equal(draw.overlay(frame, result, text=False), frame)


def test_grey_and_four_channels_are_taken():
    grey = np.full((360, 640), 90, np.uint8)
    result = straight_lane((640, 360))
    expected = draw.overlay(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), result)
    np.testing.assert_array_equal(draw.overlay(grey, result), expected)
    np.testing.assert_array_equal(draw.overlay(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA), result), expected)


def test_a_result_of_another_size_is_refused():
    with pytest.raises(LanelibError, match="640x360.*320x180"):
        draw.overlay(noise_frame((320, 180)), straight_lane((640, 360)))


@pytest.mark.parametrize(
    "frame",
    [np.zeros((9, 9, 3), np.float32), np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.uint8)[:, ::-1], None],
)
def test_drawing_in_place_needs_a_plain_bgr_frame(frame):
    with pytest.raises(LanelibError, match="BGR frame"):
        draw.overlay_bgr(frame, no_lane())


# ---------------------------------------------------------------------------------------------- YUV
@pytest.mark.parametrize("status", ["measured", "held", "none"])
@pytest.mark.parametrize("size_wh", [(1280, 720), (642, 362)])
def test_drawing_on_yuv_planes_gives_the_picture_drawn_in_bgr(size_wh, status):
    w, h = size_wh
    ramp = np.linspace(60, 170, w)[None, :, None] * np.ones((h, 1, 3)) * (0.9, 1.0, 1.1)
    yuv = cv2.cvtColor(ramp.astype(np.uint8), cv2.COLOR_BGR2YUV_I420)
    result = no_lane() if status == "none" else straight_lane(size_wh, status=status)
    expected = draw.overlay(cv2.cvtColor(yuv, cv2.COLOR_YUV2BGR_I420), result)
    drawn = yuv.copy()
    assert draw.overlay_yuv420(drawn, result) is drawn
    luma = cv2.cvtColor(expected, cv2.COLOR_BGR2YUV_I420)[:h].astype(int)
    assert np.abs(drawn[:h] - luma).max() <= 6  # rounding of colours, nothing of place
    difference = np.abs(cv2.cvtColor(drawn, cv2.COLOR_YUV2BGR_I420).astype(int) - expected)
    assert difference.mean() < 1.0 and np.percentile(difference, 99) < 12  # chroma has half the resolution


def test_the_planes_of_a_frame_are_views_into_it():
    frame = np.zeros((90, 64), np.uint8)
    for i, plane in enumerate(yuv420_planes(frame), 1):
        plane[:] = i
    assert (frame[:60] == 1).all() and (frame[60:75] == 2).all() and (frame[75:] == 3).all()


@pytest.mark.parametrize("shape", [(100, 64), (90, 63), (0, 0), (90, 64, 3)])
def test_what_is_no_yuv_frame_is_refused(shape):
    with pytest.raises(LanelibError, match="YUV420p"):
        draw.overlay_yuv420(np.zeros(shape, np.uint8), no_lane())


@pytest.mark.parametrize("bgr", [(0, 0, 255), (40, 200, 90), (255, 255, 255)])
def test_colours_on_yuv_are_opencv_s(bgr):
    canvas = Canvas.of_yuv420(np.zeros((24, 16), np.uint8))
    plain = cv2.cvtColor(np.full((16, 16, 3), bgr, np.uint8), cv2.COLOR_BGR2YUV_I420)
    expected = plain[0, 0], plain[16, 0], plain[20, 0]
    np.testing.assert_allclose(canvas.colour(bgr), expected, atol=1)


@BOUNDED
@given(
    points=st.lists(st.tuples(st.floats(-30, 90), st.floats(-30, 70)), min_size=3, max_size=3),
    opacity=st.floats(0.1, 1),
)
def test_fill_covers_as_much_as_the_triangle_does(points, opacity):
    """The light that was added equals the triangle's area in the picture, found by oversampling."""
    triangle = np.array(points)
    picture = np.zeros((40, 60, 3), np.uint8)
    Canvas.of_bgr(picture).fill([triangle], (200, 200, 200), opacity=opacity)
    k = 8
    fine = np.zeros((40 * k, 60 * k), np.uint8)
    cv2.fillPoly(fine, [np.round(((triangle + 0.5) * k - 0.5) * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
    area = fine.sum() / k**2
    edge = sum(np.hypot(*(a - b)) for a, b in zip(triangle, np.roll(triangle, 1, axis=0), strict=True))
    # an anti-aliased edge of OpenCV spreads up to a pixel outward
    assert -0.35 * edge - 2 <= picture[:, :, 0].sum() / (200 * opacity) - area <= 1.1 * edge + 4


def test_fading_grows_with_the_rows_and_leaves_no_seam():
    picture = np.zeros((200, 50, 3), np.uint8)
    box = np.array([(5.0, 10), (45, 10), (45, 190), (5, 190)])
    Canvas.of_bgr(picture).fill([box], (200, 200, 200), opacity=0.5, fade_rows=(10, 110))
    column = picture[12:188, 25, 0].astype(int)
    assert (np.diff(column) >= 0).all() and np.diff(column).max() <= 12
    assert column[0] < 12 and set(column[100:]) == {100}


def test_the_half_size_planes_are_drawn_on_where_the_frame_is():
    """A plane's pixel 0 has its centre between the frame's pixels 0 and 1."""
    frame = np.full((150, 120), 128, np.uint8)
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.column_stack([61.3 + 20 * np.cos(angle), 44.7 + 20 * np.sin(angle)])
    canvas = Canvas.of_yuv420(frame)
    canvas.fill([circle], (255, 0, 0))
    for plane in canvas.planes[1:]:
        cover = np.abs(plane.pixels.astype(float) - 128)
        rows, columns = np.indices(cover.shape)
        place = [(n * cover).sum() / cover.sum() * 2 + 0.5 for n in (columns, rows)]
        assert place == pytest.approx([61.3, 44.7], abs=0.2)


def test_a_layer_is_cut_at_the_frame_s_edge():
    layer = Layer(np.full((20, 30, 4), 255, np.uint8))
    picture = np.zeros((16, 24, 3), np.uint8)
    Canvas.of_bgr(picture).lay(layer, (4, 6))
    assert (picture[6:, 4:] == 255).all() and picture[:6].sum() == 0 and picture[:, :4].sum() == 0


# ---------------------------------------------------------------------------------------------- words
@pytest.mark.parametrize(
    ("radius_m", "curvature", "words"),
    [
        (1020.4, 1 / 1020.4, "R 1.02 km left"), (480.2, -1 / 480.2, "R 480 m right"), (np.inf, 1e-6, "straight"),
        (999.7, -1e-3, "R 1.00 km right"), (None, None, ""),
        (9997.0, 1.1e-4, "R 10.0 km left"), (31.4, 1 / 31.4, "R 31 m left"),
    ],
)
def test_radius_in_words(radius_m, curvature, words):
    assert draw.radius_text(radius_m, curvature) == words


@pytest.mark.parametrize(
    ("offset_m", "words"),
    [
        (-0.231, "0.23 m left of centre"),
        (1.5, "1.50 m right of centre"),
        (0.004, "on the centre"),
        (None, ""),
        (np.nan, ""),
    ],
)
def test_offset_in_words(offset_m, words):
    assert draw.offset_text(offset_m) == words


def test_the_card_changes_with_what_it_tells():
    size = (1280, 720)
    base = straight_lane(size)
    pictures = {"base": read_out(base, size).pixels.tobytes()}
    for name, value in (
        ("offset_m", 0.23),
        ("radius_m", 90.0),
        ("width_m", 3.2),
        ("confidence", 0.2),
        ("status", "held"),
    ):
        other = straight_lane(size)
        setattr(other, name, value)
        pictures[name] = read_out(other, size).pixels.tobytes()
    assert len(set(pictures.values())) == len(pictures)


@pytest.mark.parametrize(("offset_m", "side"), [(0.6, 1), (-0.6, -1)])
def test_the_gauge_shows_the_car_on_its_side_of_the_lane(offset_m, side):
    result = straight_lane((1280, 720))
    result.offset_m = offset_m
    card = read_out(result, (1280, 720)).pixels[:, :, :3].astype(int)
    left, right = (np.abs(card - draw.bgr(name)).max(axis=2) < 20 for name in ("left line", "right line"))
    row = np.flatnonzero(left.any(axis=1) & right.any(axis=1))
    row = row[len(row) // 2]
    lines = np.flatnonzero(left[row]).mean(), np.flatnonzero(right[row]).mean()
    between = np.arange(card.shape[1])[round(lines[0]) : round(lines[1])]
    car = between[card[row, between].min(axis=1) > 220].mean()
    place = (car - np.mean(lines)) / (lines[1] - lines[0])  # in lane widths
    assert lines[0] < lines[1] and place == pytest.approx(side * 0.6 / 3.66, abs=0.03)


# ---------------------------------------------------------------------------------------------- lettering
@pytest.mark.parametrize("cap_px", [7, 10.5, 17, 60])
def test_letters_have_the_height_asked_for(cap_px):
    mask, base = text_mask("H", cap_px)
    rows = np.flatnonzero((mask > 127).any(axis=1))
    assert abs(rows[-1] + 1 - base) <= 1 and abs(len(rows) - cap_px) <= 1.5
    deep = np.flatnonzero((text_mask("p", cap_px)[0] > 127).any(axis=1))
    assert deep[-1] > rows[-1]


def test_numbers_that_change_do_not_jump():
    assert len({text_width(f"0.{i}{i} m", 13) for i in range(10)}) == 1


def test_every_letter_differs_from_every_other():
    drawn = {glyph: text_mask(glyph, 24)[0].tobytes() for glyph in _GLYPHS}
    assert len(set(drawn.values())) == len(drawn)


def test_an_unknown_character_is_a_question_mark():
    np.testing.assert_array_equal(text_mask("a漢b", 12)[0], text_mask("a?b", 12)[0])


def test_text_ends_where_it_is_aligned_to():
    for align, side in (("left", 0), ("right", -1)):
        picture = np.zeros((40, 200, 3), np.uint8)
        put_text(picture, "Hill", (100, 30), (255, 255, 255), cap_px=14, align=align)
        columns = np.flatnonzero(picture.any(axis=(0, 2)))
        assert abs(columns[side] - 100) <= 4
        assert (columns > 96).all() if align == "left" else (columns < 104).all()


@BOUNDED
@given(x=st.integers(-30, 60), y=st.integers(-30, 50), channels=st.sampled_from([1, 3, 4]))
def test_a_stamp_anywhere_equals_the_plain_formula(x, y, channels):
    rng = np.random.default_rng(abs(x) + 100 * abs(y))
    mask = rng.integers(0, 256, (12, 17), np.uint8)
    picture = rng.integers(0, 256, (30, 40, channels), np.uint8)
    picture = picture[:, :, 0] if channels == 1 else picture
    colour = (10, 250, 77, 255)[:channels] if channels > 1 else 99
    large = np.zeros((160, 200)) * 1.0
    large[60 + y : 72 + y, 60 + x : 77 + x] = mask / 255
    cover = large[60:90, 60:100]
    cover = cover if picture.ndim == 2 else cover[:, :, None]
    expected = picture * (1 - cover) + np.array(colour) * cover
    stamp(picture, mask, (x, y), colour)
    assert np.abs(picture - expected).max() <= 0.51


@BOUNDED
@given(st.lists(st.text("abcXYZ019.,", min_size=1, max_size=12), min_size=1, max_size=12), st.integers(40, 400))
def test_wrapped_lines_fit_and_keep_the_words(words, width):
    text = " ".join(words)
    lines = wrapped(text, 10, width, max_lines=3)
    assert len(lines) <= 3 and all(text_width(line, 10) <= width for line in lines)
    if not any(line.endswith("…") for line in lines):
        assert " ".join(lines) == text
    assert text_width(shortened(text, 10, width), 10) <= width


# ---------------------------------------------------------------------------------------------- marks
def test_heat_grows_brighter():
    values = np.linspace(0, 3, 64)[None].repeat(4, 0)
    grey = cv2.cvtColor(draw.heat(values), cv2.COLOR_BGR2GRAY)[0].astype(int)
    assert grey[0] < 10 and grey[-1] > 220 and (np.diff(grey) >= -2).all()
    assert (draw.heat(np.array([[np.nan, 1.0]]))[0, 0] == draw.heat(np.array([[0.0, 1.0]]))[0, 0]).all()
    assert draw.heat(np.zeros((3, 3))).max() < 10


def test_windows_and_their_pixels_are_drawn_where_they_were():
    mask = np.zeros((360, 240), np.uint8)
    mask[:, 68:73], mask[:, 158:163], mask[100:110, 10:14] = 255, 255, 255
    found = sliding_windows(mask, n_windows=6)
    before = mask.copy()
    picture = draw.draw_windows(mask, found)
    np.testing.assert_array_equal(mask, before)
    assert picture[150, 70].tolist() == list(draw.bgr("left line"))
    assert picture[150, 160].tolist() == list(draw.bgr("right line"))
    stray = picture[105, 12].astype(int)
    assert np.ptp(stray) == 0 and 50 < stray[0] < 200  # paint of no line stays grey
    window = found.windows[2]
    border = picture[(window.row_top + window.row_bottom) // 2, window.left].astype(int)
    assert np.abs(border - draw.bgr("window")).max() < 40


def test_points_left_out_and_drawn():
    picture = draw.draw_points(np.zeros((50, 60, 3), np.uint8), [(20, 30), (np.nan, 3), (1e9, 5), (-40, 2)], "#ffffff")
    rows, columns = np.nonzero(picture[:, :, 0])
    assert abs(rows.mean() - 30) < 0.3 and abs(columns.mean() - 20) < 0.3


def test_corners_of_a_board_and_of_none():
    picture = np.full((300, 400, 3), 90, np.uint8)
    grid = np.stack(np.meshgrid(np.arange(5) * 50 + 60.0, np.arange(3) * 60 + 70.0), -1).reshape(-1, 1, 2)
    drawn = draw.draw_corners(picture, grid, (5, 3))
    assert (picture == 90).all()
    for i, row in enumerate((70, 130, 190)):
        assert np.abs(drawn[row, 110].astype(int) - draw.bgr(draw.SERIES[i])).max() < 30
    some = draw.draw_corners(picture, grid[:4], (5, 3))
    assert np.abs(some[70, 60].astype(int) - draw.bgr("none")).max() < 30


CANVAS = np.full((90, 160, 3), 100, np.uint8)


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (lambda: draw.bgr("red"), "'red'"),
        (lambda: draw.bgr("#12g456"), "'#12g456'"),
        (lambda: draw.draw_points(CANVAS, [(5, 5)], "green"), "'green'"),
        (lambda: put_text(CANVAS.copy(), "a", (5, 20), (0, 0, 0), align="center"), "'center'"),
        (lambda: draw.draw_line(CANVAS, [(0, 0), (50, 50)], width_px=0, dashed=True), "found 0"),
        (lambda: draw.draw_line(CANVAS, [(0, 0), (50, 50)], width_px=np.nan), "found nan"),
        (lambda: draw.difference(CANVAS, CANVAS, gain=0), "found 0"),
        (lambda: draw.side_by_side([CANVAS], columns=-1), "and -1"),
        (lambda: draw.side_by_side([CANVAS], height=-1), "found -1"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(function, says):
    with pytest.raises(LanelibError, match=says) as caught:
        function()
    assert "\n" not in str(caught.value)


def test_no_corners_and_corners_that_are_nowhere_are_not_drawn():
    np.testing.assert_array_equal(draw.draw_corners(CANVAS, [], (0, 0)), CANVAS)
    grid = np.stack(np.meshgrid(np.arange(3) * 40 + 20.0, np.arange(2) * 40 + 20.0), -1).reshape(-1, 2)
    grid[0] = np.nan
    np.testing.assert_array_equal(draw.draw_corners(CANVAS, grid, (3, 2)), draw.draw_corners(CANVAS, grid[1:], (3, 2)))


# ---------------------------------------------------------------------------------------------- panels
@BOUNDED
@given(st.floats(-5, 5), st.floats(5, 40))
def test_metres_to_pixels_is_the_grid_s_own_affine_map_backwards(x, y):
    grid = Grid.uniform(x_range_m=(-6, 6), y_range_m=(3, 43), size_wh=(300, 640))
    pixel = pixels_of_road(grid, [(x, y)])[0]
    np.testing.assert_allclose(grid.road_from_pixel @ (*pixel, 1), (x, y, 1), atol=1e-9)


def test_the_lane_lies_on_its_metres_in_the_birdseye_picture():
    grid = Grid.uniform(x_range_m=(-5, 7), y_range_m=(4, 44), size_wh=(360, 720))
    lane = Lane(Line([0.002, -0.03, -1.7], (4, 44)), Line([0.002, -0.03, 1.9], (4, 44)))
    picture = draw.birdseye(np.full((720, 360, 3), 110, np.uint8), grid, lane=lane, rulers=False)
    for y_m in (8.0, 21.0, 35.0):
        row = round(float(pixels_of_road(grid, [(0, y_m)])[0, 1]))
        y_row = grid.y_m[row]
        for line, name in ((lane.left, "left line"), (lane.right, "right line")):
            column = float(grid.column_of(line.x(y_row)))
            like = np.abs(picture[row].astype(int) - draw.bgr(name)).max(axis=1) < 60
            assert abs(np.flatnonzero(like).mean() - column) < 1.0


def test_a_nodding_camera_moves_the_lane_to_where_the_flat_plane_shows_it():
    grid = Grid.uniform(x_range_m=(-6, 6), y_range_m=(4, 44), size_wh=(360, 720))
    lane = Lane(Line([0, 0, -3.0], (4, 44)), Line([0, 0, 1.0], (4, 44)), Surface(1.2, np.deg2rad(0.5)))
    picture = draw.birdseye(np.full((720, 360, 3), 110, np.uint8), grid, lane=lane, rulers=False)
    y0 = 1 / (1 / 20.0 - np.deg2rad(0.5) / 1.2)  # where the road at 20 m appears
    u, v = pixels_of_road(grid, [(-3.0 / 20 * y0, y0)])[0]
    assert np.abs(picture[round(v), round(u)].astype(int) - draw.bgr("left line")).max() < 30


def test_rulers_and_points_change_the_view_and_a_wrong_size_is_refused():
    grid = Grid.uniform(size_wh=(360, 720))
    view = np.full((720, 360, 3), 80, np.uint8)
    plain = draw.birdseye(view, grid, rulers=False)
    np.testing.assert_array_equal(plain, view)
    assert (draw.birdseye(view, grid) != view).any()
    dotted = draw.birdseye(view, grid, rulers=False, points_m=[(0.0, 20.0), (99, 99)], weights=[1.0, 1.0])
    u, v = pixels_of_road(grid, [(0.0, 20.0)])[0]
    assert np.abs(dotted[round(v), round(u)].astype(int) - draw.bgr("paint")).max() < 60
    with pytest.raises(LanelibError, match="360x720"):
        draw.birdseye(view[:-1], grid)


@pytest.mark.parametrize("far_m", [8.0, 43.0, 1500.0, 2e3, 9e4])
def test_a_view_of_any_length_has_rulers(far_m):
    grid = Grid.uniform(x_range_m=(-6, 6), y_range_m=(3, far_m), size_wh=(180, 360))
    picture = draw.birdseye(np.full((360, 180, 3), 80, np.uint8), grid)
    lines = np.flatnonzero(picture[:300, 120, 0] > 90)  # beside the numbers
    assert 3 <= np.sum(np.diff(lines) > 1) + 1 <= 10


def test_side_by_side_shows_every_picture_at_one_height():
    pictures = [np.full((100, 200, 3), 200, np.uint8), np.eye(100, dtype=np.uint8), np.ones((50, 50), bool)]
    joined = draw.side_by_side(pictures, ["a", "b", "c"], height=100)
    assert joined.shape[1] == 200 + 100 + 100 + 4 * 12
    bottom = joined[-62]
    assert (bottom[20:200] == 200).all()  # the first
    assert bottom[236:320].max() == 255  # a mask of 0 and 1 is not black
    assert (bottom[340:430] == 255).all()
    two_rows = draw.side_by_side(pictures, ["a", "b", "c"], height=100, columns=2)
    assert two_rows.shape[0] > 1.8 * joined.shape[0] - 20 and two_rows.shape[1] < joined.shape[1]
    with pytest.raises(LanelibError, match="title"):
        draw.side_by_side(pictures, ["a"])


def test_the_histogram_s_peaks_are_marked_in_the_lines_colours():
    mask = np.zeros((200, 300), np.uint8)
    mask[100:, 60:65], mask[120:, 240:245] = 255, 255
    panel = draw.histogram_panel(mask, (300, 120))
    assert np.abs(panel[60, 62].astype(int) - draw.bgr("left line")).max() < 40
    assert np.abs(panel[60, 242].astype(int) - draw.bgr("right line")).max() < 40
    assert draw.histogram_panel(np.zeros((20, 30), np.uint8), (100, 50)).shape == (50, 100, 3)


@pytest.mark.parametrize("status", ["measured", "held", "none"])
def test_the_diagnostic_shows_what_is_there_and_says_what_is_not(status):
    size = (640, 360)
    frame = noise_frame(size)
    result = no_lane() if status == "none" else straight_lane(size, status=status)
    empty = draw.diagnostic(frame, {}, result)
    assert empty.shape == (720, 1280, 3)
    mask = np.zeros((360, 640), np.uint8)
    mask[200:, 300:310] = 1
    full = draw.diagnostic(frame, {"mask": mask, "birdseye_mask": mask}, result)
    assert full[470:665, 12:358].max() == 255 and empty[470:665, 12:358].max() < 200
    assert draw.diagnostic(frame, {}, result, size_wh=(640, 360)).shape == (360, 640, 3)
    beside = draw.birdseye_beside(np.full((720, 480, 3), 55, np.uint8), frame, result)
    assert beside.shape == (720, 1280, 3) and (beside[:, :480] == 55).all()
