"""Figures: every call gives one closed Figure in the project's style, and shows the numbers it was given."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lanelib import draw, figures
from lanelib.birdseye import BirdsEye, Grid
from lanelib.calibration import BoardView
from lanelib.camera import Camera
from lanelib.draw import PALETTE
from lanelib.errors import LanelibError
from lanelib.figures import n07
from lanelib.lane import Lane, Line

FRAME = np.random.default_rng(0).integers(0, 255, (90, 160, 3), np.uint8)
MASK = np.zeros((90, 160), np.uint8)
MASK[40:, 50:54], MASK[40:, 110:113] = 1, 1
LANE = Lane(Line([0.001, 0.01, -1.8], (4, 40), np.diag([1e-8, 1e-5, 1e-3])), Line([0.001, 0.01, 1.9], (4, 40)))
ROWS = [
    {"curvature_1pm": None if i == 5 else 0.001 * i, "offset_m": 0.1 * i, "time_s": i / 10,
     "status": "none" if i == 5 else "held" if i in (2, 3) else "measured"}
    for i in range(9)
]
VIEWS = [
    BoardView("calibration10.jpg", True, "", 0.8, (9, 6), np.random.default_rng(1).random((54, 2)) * 80),
    BoardView("calibration2.jpg", True, "", 0.5, (9, 6), np.random.default_rng(2).random((54, 2)) * 80),
    BoardView("calibration3.jpg", False, "no board"),
]


def birdseye() -> BirdsEye:
    camera = Camera(np.array([[140.0, 0, 80], [0, 140, 45], [0, 0, 1]]), np.zeros(5), (160, 90))
    grid = Grid.uniform(x_range_m=(-5, 5), y_range_m=(3, 33), size_wh=(100, 150))
    return BirdsEye.from_mounting(camera, height_m=1.3, pitch_deg=3, grid=grid)


CALLS = {
    "show": lambda: figures.show({"frame": FRAME, "mask": MASK, "tall": FRAME.transpose(1, 0, 2)}),
    "show one": lambda: figures.show(FRAME, "frame"),
    "before_after": lambda: figures.before_after(FRAME, FRAME, edges=([[(0, 0), (9, 9)]], [[(1, 2), (3, 4)]])),
    "boards": lambda: figures.boards([FRAME] * 3, VIEWS),
    "board_errors": lambda: figures.board_errors(VIEWS, rms_px=0.66),
    "thresholds": lambda: figures.thresholds(FRAME, {"a": MASK, "b": MASK > 0}, paint=MASK),
    "channels": lambda: figures.channels(FRAME, ["rgb_r", "hls_s"], ranges={"hls_s": (100, 200)}),
    "warp": lambda: figures.warp(FRAME, birdseye()),
    "column_histogram": lambda: figures.column_histogram(MASK),
    "fit": lambda: figures.fit(LANE, points_m={"left": np.ones((5, 2))}, truth_m=[[(-1.8, 0), (0, 40)]]),
    "over_time": lambda: figures.over_time(ROWS, ROWS, title="clip"),
    "bars": lambda: figures.bars({"a": 1.0, "b": 2.0}, errors={"a": 0.1}, unit="cm", highlight="b"),
    "curves": lambda: figures.curves([1, 2], {"a": [1, 2], "truth": [1, 1]}, truth="truth"),
    "contact_sheet": lambda: figures.contact_sheet([FRAME] * 5, range(5), marks=["measured", "held", "none"] * 2),
}


@pytest.mark.parametrize("name", CALLS)
def test_every_figure_is_one_closed_figure_of_sensible_size(name):
    before = dict(matplotlib.rcParams)
    figure = CALLS[name]()
    assert isinstance(figure, Figure)
    assert plt.get_fignums() == []  # or a notebook would show it twice
    assert dict(matplotlib.rcParams) == before
    width, height = figure.get_size_inches()
    assert 4 <= width <= 10 and 1 <= height <= 12
    box = figure.get_tightbbox()
    assert (
        box.x1 <= width + 0.15 and box.y1 <= height + 0.15 and box.x0 > -0.15 and box.y0 > -0.15
    )  # nothing is cut off


def pixels(figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3]


def test_bgr_becomes_rgb_once():
    red = np.zeros((50, 50, 3), np.uint8)
    red[:, :, 2] = 255
    shown = pixels(figures.show(red))
    assert shown[shown.shape[0] // 2, shown.shape[1] // 2].tolist() == [255, 0, 0]


@pytest.mark.parametrize("mask", [np.ones((9, 9), np.uint8), np.full((9, 9), 255, np.uint8), np.ones((9, 9), bool)])
def test_no_mask_is_shown_black(mask):
    assert (figures.rgb(mask) == 255).all() and figures.rgb(mask).shape == (9, 9, 3)


def test_pictures_keep_their_proportions_and_a_row_its_height():
    figure = figures.show({"wide": FRAME, "tall": FRAME.transpose(1, 0, 2)}, columns=2)
    boxes = [a.get_window_extent() for a in figure.axes]
    for box, ratio in zip(boxes, (90 / 160, 160 / 90), strict=True):
        assert abs(box.height / box.width - ratio) < 0.01
    assert abs(boxes[0].height - boxes[1].height) < 1


def test_titles_and_pictures_must_match():
    with pytest.raises(LanelibError, match="title"):
        figures.show([FRAME, FRAME], ["one"])


def test_precision_and_recall_are_those_of_the_mask():
    paint = np.zeros((90, 160), np.uint8)
    paint[10:20, :] = 255  # 1600 pixels of paint
    mask = np.zeros_like(paint)
    mask[15:35, :80] = 1  # 1600 pixels, 400 of them on paint
    figure = figures.thresholds(FRAME, {"m": mask}, paint=paint)
    texts = " ".join(t.get_text() for a in figure.axes for t in a.texts)
    assert "precision 0.25" in texts and "recall 0.25" in texts


def test_over_time_draws_the_numbers_and_marks_what_was_missed():
    truth = [{"offset_m": 0.5, "time_s": i / 10} for i in range(9)]
    figure = figures.over_time(ROWS, truth, quantities=("curvature_1pm", "offset_m"))
    curvature, offset = figure.axes
    np.testing.assert_allclose(curvature.lines[0].get_ydata(), [0, 1, 2, 3, 4, np.nan, 6, 7, 8])  # 1/km
    np.testing.assert_allclose(curvature.lines[0].get_xdata(), np.arange(9) / 10)
    np.testing.assert_allclose(offset.lines[1].get_ydata(), 0.5)
    assert offset.lines[1].get_color() == PALETTE["truth"] and offset.lines[1].is_dashed()
    spans = [(p.get_x(), p.get_x() + p.get_width()) for p in offset.patches]
    np.testing.assert_allclose(spans, [(0.2, 0.34), (0.5, 0.54)])


def test_methods_are_told_apart():
    figure = figures.over_time({"kalman": ROWS, "none": ROWS}, quantities=("offset_m",))
    assert [line.get_label() for line in figure.axes[0].lines] == ["kalman", "none"]
    assert len({line.get_color() for line in figure.axes[0].lines}) == 2


def test_left_is_vermillion_and_right_is_blue_and_the_band_is_two_sigma():
    figure = figures.fit(LANE, y_max_m=30)
    left, right = figure.axes[0].lines[:2]
    assert left.get_color() == PALETTE["left"] and right.get_color() == PALETTE["right"]
    y = left.get_ydata()
    np.testing.assert_allclose(left.get_xdata(), LANE.left.x(y))
    band = figure.axes[0].collections[0].get_paths()[0].vertices
    at_start = band[np.abs(band[:, 1]) < 1e-9, 0]
    np.testing.assert_allclose(np.ptp(at_start), 4 * np.sqrt(1e-3), rtol=1e-6)


def test_the_fit_names_its_lines_and_shows_no_truth_beyond_its_upper_edge():
    truth = [[(-1.8, 0), (0.0, 38), (50.0, 138)], [(1.8, 0), (3.6, 30)]]
    axes = figures.fit(LANE, truth_m=truth, y_max_m=40).axes[0]
    cut, short = axes.lines[2].get_xydata(), axes.lines[3].get_xydata()
    np.testing.assert_allclose(cut, [(-1.8, 0), (0.0, 38), (1.0, 40)])  # up to the edge of the figure
    np.testing.assert_allclose(short, truth[1])
    assert axes.get_xlim()[1] < 10  # not the 60 m of what is not shown
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["left line: R 500 m, bends right", "right line: R 500 m, bends right", "truth"]
    box, width = axes.get_window_extent(), axes.figure.bbox.width
    assert box.width > 0.75 * width  # long names beside one another would squeeze the axes


def test_the_warp_shows_the_same_rectangle_twice():
    view = birdseye()
    corners = [(-2, 20), (2, 20), (2, 8), (-2, 8)]
    before, after = figures.warp(FRAME, view, corners_m=corners).axes
    np.testing.assert_allclose(np.column_stack(after.lines[1].get_data()), corners)
    seen = np.column_stack(before.lines[1].get_data())
    np.testing.assert_allclose(view.road_from_points(seen), corners, atol=1e-6)


def test_boards_stand_in_their_numbers_order_with_their_errors():
    titles = [a.get_title(loc="left") for a in figures.boards([FRAME] * 3, VIEWS).axes]
    assert titles == ["2:  0.50 px", "3:  not used", "10:  0.80 px"]
    bars = figures.board_errors(VIEWS, rms_px=0.66).axes[0]
    assert [patch.get_height() for patch in bars.patches] == [0.5, 0.8]
    assert "calibration3" in bars.get_xlabel()


def test_bars_tell_their_numbers():
    axes = figures.bars({"ours": 0.5312, "theirs": 8.7}, digits=1, highlight="ours").axes[0]
    assert [t.get_text() for t in axes.texts] == ["0.5", "8.7"]
    assert [p.get_width() for p in axes.patches] == [0.5312, 8.7]


def test_a_contact_sheet_marks_the_status():
    shown = pixels(figures.contact_sheet([np.full((90, 160, 3), 128, np.uint8)] * 2, marks=["held", "none"]))
    for name in ("held", "none"):
        colour = np.array(draw.bgr(name))[::-1]
        assert (np.abs(shown.astype(int) - colour).max(axis=2) < 6).sum() > 200


@pytest.mark.parametrize(("name", "start"), [("a.jpg", b"\xff\xd8\xff"), ("a.png", b"\x89PNG"), ("a.svg", b"<?xml")])
def test_saved_by_the_name_s_ending_and_nothing_left_behind(tmp_path, name, start):
    path = figures.save(figures.bars({"a": 1.0}), tmp_path / name)
    assert path.read_bytes().startswith(start)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_an_unknown_ending_is_refused(tmp_path):
    with pytest.raises(LanelibError, match=r"\.jpg, \.png or \.svg"):
        figures.save(figures.bars({"a": 1.0}), tmp_path / "a.xyz")
    assert not list(tmp_path.iterdir())


def test_the_textbooks_overlay_tints_the_lane_of_the_picture_as_given():
    view = birdseye()
    drawn = n07.warped_back_overlay(FRAME, view, LANE).astype(int) - FRAME
    rows, columns = np.indices(FRAME.shape[:2])
    road = view.road_from_points(np.column_stack([columns.ravel(), rows.ravel()]))
    inside = (LANE.left.x(road[:, 1]) < road[:, 0]) & (road[:, 0] < LANE.right.x(road[:, 1])) & (road[:, 1] < 33)
    beside = ~((np.abs(road[:, 0]) < 4) & (road[:, 1] < 34))
    green = drawn[..., 1].ravel()
    assert np.median(green[inside & (road[:, 1] > 4)]) > 0 and (green[beside] == 0).all()
