"""Figures of notebooks 01 to 04: what their words and numbers say is what was given."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

from lanelib.birdseye import BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.explore import PaintTruth
from lanelib.figures import n01, n02, n03, n04
from lanelib.hough import BENDS
from lanelib.lane import Check
from lanelib.threshold import sobel

FRAME = np.random.default_rng(0).integers(0, 255, (90, 160, 3), np.uint8)
CAMERA = Camera(np.array([[140.0, 0, 80], [0, 140, 45], [0, 0, 1]]), np.zeros(5), (160, 90))


def words(figure) -> str:
    texts = [text for axes in figure.axes for text in [*axes.texts, axes.xaxis.label, axes.yaxis.label]]
    legends = [legend for where in (figure, *figure.axes) for legend in where.findobj(matplotlib.legend.Legend)]
    ticks = [label for axes in figure.axes for label in axes.get_xticklabels()]
    return "\n".join(t.get_text() for t in [*texts, *ticks, *(text for one in legends for text in one.get_texts())])


def test_the_worst_ray_is_where_the_cameras_differ_most():
    bent = Camera(CAMERA.camera_matrix, np.array([-0.05, 0, 0, 0, 0]), CAMERA.size_wh)
    worst, pixel = n01.worst_ray(bent, CAMERA)
    assert pixel.tolist() == [0, 0]  # as far from the centre (80, 45) as one of every 20 px can be
    exact = np.hypot(*(bent.undistort_points([[0.0, 0.0]])[0] - (0, 0)))
    np.testing.assert_allclose(worst, exact, rtol=1e-6)
    assert 0 < n01.ray_error_px(bent, CAMERA) < worst


def test_gradients_have_a_scale_each():
    figure = n02.gradients(FRAME, sobel(FRAME[:, :, 0]), top=30)
    scales = [axes for axes in figure.axes if axes.get_ylabel()]
    assert [(a.get_ylabel(), a.get_ylim()) for a in scales] == [
        ("grey levels a pixel", (0, 30)), ("grey levels a pixel", (0, 30)), ("degrees", (0, 90))]
    assert plt.get_fignums() == []


def test_a_profile_shades_the_paint_in_a_colour_that_no_series_has():
    paint = np.zeros((90, 160), bool)
    paint[:, 40:50] = True
    figure = n02.profiles({"a": FRAME}, [PaintTruth(paint, ~paint)], row=60)
    assert {"true paint", "brightness", "yellowness"} <= set(words(figure).split("\n"))
    shade = matplotlib.colors.to_hex(figure.axes[0].collections[0].get_facecolor()[0])
    lines = {matplotlib.colors.to_hex(line.get_color()) for line in figure.axes[0].lines}
    assert shade not in lines and np.ptp(np.array(matplotlib.colors.to_rgb(shade))) < 0.1  # a grey


def test_the_boxes_stand_above_every_brightness_and_in_the_legend():
    paint = np.zeros(1280, bool)
    paint[400:420] = True
    figure = n02.ridge_along_row(np.full(1280, 255.0), np.zeros(1280), paint, 20)
    letters = {t.get_text(): t.get_position() for t in figure.axes[0].texts}
    assert set(letters) == {"l", "c", "r"} and min(y for _, y in letters.values()) > 255
    assert "boxes compared" in words(figure)


@pytest.mark.parametrize("lines", [(), (-1.8, 1.8)])
def test_views_say_what_their_dashed_lines_are(lines):
    grid = Grid.uniform(x_range_m=(-5, 5), y_range_m=(3, 33), size_wh=(100, 150))
    view = BirdsEye.from_mounting(CAMERA, height_m=1.3, pitch_deg=3, grid=grid)
    figure = n03.views(FRAME, {"rig": view, "again": view}, lines_m=lines)
    assert ("where the lines truly are" in words(figure)) == bool(lines)


def test_checks_have_units_and_the_digits_that_go_with_them():
    row = (Check("order", 2, "", True), Check("same bend", 0.01281, "", False), Check("radius", 14.56, "", False))
    text = words(n04.checks({"a": row, "b": (Check("order", -0.991, "", False), Check("radius", 7250.4, "", True))}))
    for expected in ("order,\nm", "same bend,\n1/m", "✓ 2.00", "✗ 0.0128", "✗ 14.6", "✗ -0.99", "✓ 7250"):
        assert expected in text, expected


def test_dots_say_the_unit_of_their_median():
    figure = n04.dots({"a": np.array([3.0, -6.82, np.nan, 9.0])}, unit="error at 20 m, cm")
    assert "median |error| 6.8 cm\nno lane in 25%" in words(figure)
    assert "bar: ± the median" in figure.axes[0].get_xlabel()


def test_a_line_that_bends_to_the_left_is_voted_for_in_the_upper_half(monkeypatch):
    table = np.zeros((len(BENDS), 3, len(n04.X_BINS_M)), np.float32)
    table[3] = 1  # a < 0: to the left
    monkeypatch.setattr(n04, "votes", lambda points: table)
    monkeypatch.setattr(n04, "voters", lambda points: [])

    class Nothing:
        inverse, bearing, weight = np.ones(1), np.ones(1), np.ones(1)

        def some(self, which):
            return self

    axes = n04.hough(Nothing(), [(0.0, BENDS[3], 0.0, 1.0)]).axes[1]
    row = int(np.argmax(np.asarray(axes.collections[0].get_array()).reshape(len(BENDS), -1)[:, 0]))
    assert row > len(BENDS) // 2 and "left is up" in axes.get_ylabel()
    np.testing.assert_allclose(axes.lines[0].get_ydata(), row)  # the line's mark is on its votes
