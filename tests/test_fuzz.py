"""Whatever comes in: a result, or one LanelibError of one line; from the command line exit code 0 or 2 and no more.

Arrays of any shape into the image functions, random geometry, and files with damaged bytes. What one module promises
about its own bad input stands in that module's tests; here are the promises that hold for all.
"""

import contextlib
import itertools
import json
import math
from dataclasses import replace

import clips
import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lanelib import channels, chessboard, cli, draw, paint, rigs, road, search, stages, threshold
from lanelib.birdseye import BirdsEye, Grid, map_points
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, LaneResult
from lanelib.lane import Lane, Line, fit_line
from lanelib.pictures import read_image
from lanelib.rig import Rig, View
from lanelib.simulator import Scene, render_road
from lanelib.video import read_frames

SIZE_WH = (160, 90)
SCENE_CAMERA = Camera(np.array(Scene().camera_matrix), np.array(Scene().distortion), Scene().size_wh)
CAMERA = SCENE_CAMERA.scaled(SIZE_WH)
RIG = Rig(CAMERA, BirdsEye.from_mounting(CAMERA, height_m=1.22, pitch_deg=1.4), "fuzz")
ROAD_BGR = render_road(Scene(size_wh=SIZE_WH, camera_matrix=CAMERA.camera_matrix.tolist()))[0]
RESULT = LaneFinder(RIG).process(ROAD_BGR)


def fuzz(n: int):
    """So many examples; the same on every run unless a new failure was stored."""
    return settings(
        max_examples=n, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
    )


def one_line(error: BaseException) -> None:
    assert str(error).strip() and len(str(error).splitlines()) == 1 and "OpenCV(" not in str(error)


def answer(function, *arguments):
    """The function's result, or None where it said in one line why not; anything else it raises fails the test."""
    try:
        return function(*arguments)
    except LanelibError as error:
        one_line(error)
        return None


# ---------------------------------------------------------------------------------------------- arrays
@st.composite
def arrays(draw_):
    """uint8 of any shape: nothing, one pixel, rows, stacks, whole frames; any contents; any layout in memory."""
    side = st.integers(0, 9)
    frames = [(90, 160, 3), (90, 160), (90, 160, 4), (90, 160, 1), (135, 160), (180, 320, 3), (91, 163, 3)]
    shape = draw_(st.one_of(st.lists(side, max_size=4).map(tuple), st.sampled_from(frames)))
    rng = np.random.default_rng(draw_(st.integers(0, 2**32 - 1)))
    contents = draw_(st.sampled_from(["noise", "black", "white", "blocks", "road"]))
    if contents == "road" and shape[:2] == (90, 160):
        array = np.resize(ROAD_BGR, shape) if len(shape) == 3 and shape[2] == 3 else ROAD_BGR[:, :, 1].reshape(90, 160)
    elif contents == "blocks" and math.prod(shape):
        small = rng.integers(0, 256, [-(-n // 8) for n in shape], np.uint8)
        array = small
        for axis, n in enumerate(shape):
            array = np.repeat(array, 8, axis=axis).take(range(n), axis=axis)
    else:
        array = rng.integers(0, 256, shape, np.uint8)
        array[...] = array if contents in ("noise", "road", "blocks") else 255 * (contents == "white")
    layout = draw_(st.sampled_from(["plain", "mirrored", "strided", "read-only", "transposed"]))
    if layout == "mirrored":
        array = array[tuple(slice(None, None, -1) for _ in array.shape[:2])]
    elif layout == "strided" and array.ndim:
        array = np.repeat(array, 2, axis=0)[::2]
    elif layout == "transposed" and array.ndim >= 2:
        array = np.ascontiguousarray(array.swapaxes(0, 1)).swapaxes(0, 1)
    if layout == "read-only":
        array.setflags(write=False)
    return array


IMAGE_FUNCTIONS = {
    "undistort": CAMERA.undistort,
    "warp": RIG.birdseye.warp,
    "unwarp": replace(RIG.birdseye, grid=Grid.uniform(size_wh=(160, 90))).unwarp,
    "hsv_white": channels.hsv_white,
    "hsv_yellow": channels.hsv_yellow,
    "equalise_lightness": channels.equalise_lightness,
    "keep_long": threshold.keep_long,
    "close_gaps": threshold.close_gaps,
    "paint_ridges": threshold.paint_ridges,
    "paint_response": lambda image: threshold.paint_response(image, camera_height_m=1.3),
    "sobel": lambda a: threshold.magnitude_mask(threshold.sobel(a), 20),
    "paint_channels": paint.paint_channels,
    "paint_evidence": paint.paint_evidence,
    "ridge_response": paint.ridge_response,
    "paint_points": paint.paint_points,
    "histogram": search.histogram,
    "sliding_windows": search.sliding_windows,
    "search_around": lambda a: search.search_around(a, [0.0, 0.1, 20.0], None),
    "find_board": chessboard.find_board,
    "overlay": lambda a: draw.overlay(a, RESULT),
    "overlay of nothing": lambda a: draw.overlay(a, LaneResult(None, "none", "no paint")),
    "overlay_bgr": lambda a: draw.overlay_bgr(a, RESULT),
    "overlay_yuv420": lambda a: draw.overlay_yuv420(a, RESULT),
    "heat": draw.heat,
    "side_by_side": lambda a: draw.side_by_side([a, ROAD_BGR]),
    "fitted": lambda a: draw.fitted(a, (64, 36)),
    "stages": LaneFinder(RIG).stages,
    "diagnostic": lambda a: stages.diagnostic(a, LaneFinder(RIG)),
}
IMAGE_FUNCTIONS |= {f"recipe {name}": recipe.function for name, recipe in threshold.RECIPES.items()}
IMAGE_FUNCTIONS |= {f"channel {name}": channel for name, channel in channels.CHANNELS.items()}
SLOW = {"diagnostic": 8, "stages": 12, "find_board": 25}


@pytest.mark.parametrize("name", IMAGE_FUNCTIONS)
def test_any_array_into_an_image_function(name):
    function = IMAGE_FUNCTIONS[name]
    given_result = []

    @fuzz(SLOW.get(name, 30))
    @given(array=arrays())
    def check(array):
        before = array.copy()
        in_place = name in ("overlay_bgr", "overlay_yuv420")
        found = answer(function, array.copy() if in_place else array)
        assert in_place or np.array_equal(array, before)  # the picture given is never drawn upon
        given_result.append(found is not None)
        if name.startswith(("recipe", "channel", "hsv")) and found is not None:
            assert found.dtype == np.uint8 and found.shape == array.shape[:2]

    check()
    assert any(given_result) or name in ("undistort", "overlay_yuv420", "overlay", "overlay_bgr")


@pytest.mark.parametrize("name", IMAGE_FUNCTIONS)
def test_every_tiny_picture(name):
    """No pixel, one, two or three each way: where border rules and scalars of one pixel surprise."""
    for shape in itertools.product(range(4), range(4), (0, 1, 3, 4)):
        answer(IMAGE_FUNCTIONS[name], np.full(shape if shape[2] else shape[:2], 200, np.uint8))


@pytest.mark.parametrize("finder", [
    LaneFinder(RIG), LaneFinder(RIG, order="textbook"), LaneFinder(RIG, recipe="clahe-colour-sobel"),
    LaneFinder(RIG, smoothing="average"),
], ids=["finder's order", "textbook order", "classic", "average"])
def test_any_array_into_the_finder(finder):
    """Never an exception at all, and no NaN in what is reported: one after the other into one tracker."""

    @fuzz(60)
    @given(array=arrays(), planes=st.booleans())
    def check(array, planes):
        result = (finder.process_yuv420 if planes else finder.process)(array)
        assert result.status in ("measured", "held", "none") and 0 <= result.confidence <= 1
        assert bool(result) == (result.status != "none") and (result or result.reason)
        assert np.isfinite(result.left_px).all() and np.isfinite(result.right_px).all()
        row = json.loads(json.dumps(result.to_row("x"), allow_nan=False))
        assert all(len(line) == len(row["h_samples"]) for line in row["lanes"])
        if result:
            assert math.isfinite(result.offset_m) and math.isfinite(result.curvature_1pm) and result.radius_m > 0
            assert 2 <= result.width_m <= 6

    check()


def test_objects_that_are_no_arrays():
    for thing in (None, "frame.jpg", 7, [[1, 2], [3, 4]], b"bytes", np.zeros((90, 160, 3)), np.zeros(4, object)):
        result = LaneFinder(RIG).process(thing)
        assert result.status == "none" and result.reason
        assert LaneFinder(RIG).process_yuv420(thing).status == "none"
        with pytest.raises(LanelibError) as error:
            threshold.recipe_by_name().function(thing)
        one_line(error.value)


# ---------------------------------------------------------------------------------------------- numbers
ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
TAME = st.floats(-1e3, 1e3)


@fuzz(60)
@given(numbers=st.lists(st.one_of(TAME, ANY), min_size=9, max_size=9), points=st.lists(TAME, min_size=2, max_size=8))
def test_any_homography(numbers, points):
    """Refused, or a bird's-eye view and a rig that works or says why it cannot."""
    view = answer(lambda: BirdsEye(np.array(numbers).reshape(3, 3), SIZE_WH))
    if view is None:
        return
    xy = np.array(points[: len(points) // 2 * 2]).reshape(-1, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        assert view.road_from_points(xy).shape == xy.shape
        rig = Rig(CAMERA, view)
        if answer(lambda: View(rig)) is not None:
            result = LaneFinder(rig).process(ROAD_BGR)
            assert result.status in ("measured", "none")
            json.dumps(result.to_row("x"), allow_nan=False)


@fuzz(50)
@given(h=st.lists(st.floats(-2, 2), min_size=6, max_size=6), w=st.floats(-1, 1), seed=st.integers(0, 99))
def test_points_map_as_opencv_maps_them_below_the_horizon(h, w, seed):
    """The other way to the same number; beyond the horizon, where OpenCV mirrors, NaN."""
    homography = np.array([*h, 0.0, w / 100, 1.0]).reshape(3, 3)
    points = np.random.default_rng(seed).uniform(-300, 300, (20, 2))
    mapped = map_points(homography, points)
    depth = points @ homography[2, :2] + 1
    ahead = depth > 1e-6
    assert np.isnan(mapped[depth < 0]).all()
    expected = cv2.perspectiveTransform(points[None], homography)[0]
    np.testing.assert_allclose(mapped[ahead], expected[ahead], rtol=1e-6, atol=1e-6)


@fuzz(60)
@given(focal=st.one_of(st.floats(20, 2000), ANY), centre=st.tuples(ANY, ANY), lens=st.lists(ANY, max_size=6),
       size=st.tuples(st.integers(-5, 400), st.integers(-5, 300)))
def test_any_calibration(focal, centre, lens, size):
    made = answer(lambda: Camera([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]], lens, size))
    if made is None:
        return
    assert Camera.from_dict(json.loads(json.dumps(made.to_dict()))).size_wh == size
    with np.errstate(all="ignore"):
        assert made.distort_points(np.zeros((3, 2))).shape == made.undistort_points(np.zeros((3, 2))).shape == (3, 2)


@pytest.mark.parametrize("value", [1e305, -1e305, 1e7, 1e6, -1e6, 1e-320])
@pytest.mark.parametrize("at", range(5))
def test_a_coefficient_out_of_all_proportion(at, value):
    """Refused, or a rig that can be looked through: roots of a polynomial with such a term must not overflow."""
    camera = answer(Camera, CAMERA.camera_matrix, np.where(np.arange(5) == at, value, 0.01), SIZE_WH)
    assert (camera is None) == (abs(value) > 1e6)
    if camera is not None:
        with np.errstate(all="ignore"):
            answer(LaneFinder(Rig(camera, RIG.birdseye)).process, ROAD_BGR)


@fuzz(60)
@given(lens=st.lists(st.floats(-2, 2), min_size=5, max_size=5), focal=st.floats(40, 400))
def test_any_lens(lens, focal):
    """A lens as wild as these still gives a picture of the right size, and points that come back where they were."""
    camera = Camera([[focal, 0, 79.5], [0, focal, 44.5], [0, 0, 1]], np.array(lens) * (1, 1, 0.01, 0.01, 1), SIZE_WH)
    assert camera.undistort(ROAD_BGR).shape == ROAD_BGR.shape
    grid = np.stack(np.meshgrid(np.linspace(0, 159, 9), np.linspace(0, 89, 6)), -1).reshape(-1, 2)
    there = camera.undistort_points(grid)
    back = camera.distort_points(there)
    both = np.isfinite(there).all(axis=1) & np.isfinite(back).all(axis=1)
    assert np.abs(back[both] - grid[both]).max(initial=0) < 1e-3
    assert np.isfinite(camera.undistort_points([[79.5, 44.5]])).all()  # on the axis there is always a ray


@fuzz(60)
@given(a=st.lists(st.floats(-3, 3), min_size=3, max_size=4), b=st.lists(st.floats(-3, 3), min_size=3, max_size=4),
       reach=st.floats(3, 200))
def test_any_pair_of_polynomials_is_a_lane_with_numbers(a, b, reach):
    """Lines that cross, run away or coincide: every figure is a number, the radius positive, and it can be drawn."""
    lane = Lane(Line(a, (2.0, reach)), Line(b, (2.0, reach)))
    assert math.isfinite(lane.offset_m) and math.isfinite(lane.curvature_1pm) and lane.radius_m > 0
    pixels = View(RIG).lines_px(lane)
    result = LaneResult(lane, "measured", "", 1.0, (), *pixels, SIZE_WH)
    assert draw.overlay(ROAD_BGR, result).shape == ROAD_BGR.shape
    json.dumps(result.to_row("x"), allow_nan=False)


@fuzz(60)
@given(xy=st.lists(st.tuples(TAME, TAME), max_size=12))
def test_any_points_give_a_line_or_a_reason(xy):
    """Too few, all in one place, all in one row: a singular fit is an answer, not an exception."""
    x, y = np.array(xy, float).reshape(-1, 2).T
    line = fit_line(x, y, np.ones(len(x)))
    assert np.isfinite(line.coefficients).all() if line else line.reason


@fuzz(12)
@given(curvatures=st.lists(st.floats(-0.02, 0.02), min_size=1, max_size=4), light=st.floats(0, 30),
       noise=st.floats(0, 5), paint_=st.booleans())
def test_any_road_any_light(curvatures, light, noise, paint_):
    line = {} if paint_ else {"left": None, "right": None, "others": ()}
    scene = Scene(road=road.Road([20.0 * i for i in range(len(curvatures))], curvatures), light=light, noise=noise,
                  size_wh=SIZE_WH, camera_matrix=CAMERA.camera_matrix.tolist(), **line)
    drawn = answer(render_road, scene)
    if drawn is not None:
        result = LaneFinder(RIG).process(drawn[0])
        json.dumps(result.to_row("x"), allow_nan=False)
        assert light > 0 or not result


# ---------------------------------------------------------------------------------------------- files
@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """One good file of each kind, small."""
    place = tmp_path_factory.mktemp("originals")
    RIG.save(place / "rig.json")
    CAMERA.save(place / "camera.json")
    cv2.imwrite(str(place / "road.jpg"), ROAD_BGR)
    cv2.imwrite(str(place / "road.png"), ROAD_BGR)
    clips.clip(place / "clip.mp4", n_frames=4, size_wh=SIZE_WH)
    truth = {"raw_file": "road.png", "h_samples": [50, 60, 70], "lanes": [[60, 50, 40], [100, 110, 120]]}
    (place / "labels.json").write_text(json.dumps(truth) + "\n")
    return place


@st.composite
def damage(draw_):
    """A function from good bytes to bad ones: overwritten, cut, doubled, a piece left out, a number changed."""
    kind = draw_(st.sampled_from(["overwrite", "cut", "remove", "insert", "number", "swap"]))
    at, new = draw_(st.floats(0, 1)), draw_(st.binary(min_size=1, max_size=8))
    n, value = draw_(st.integers(1, 64)), draw_(st.sampled_from(
        [b"0", b"-1", b"1e999", b"NaN", b"null", b"[]", b"1e-300", b"9999999999", b'"x"', b"{}"]))

    def apply(data: bytes) -> bytes:
        i = int(at * (len(data) - 1))
        if kind == "number":  # the next number of a JSON file becomes something else
            begin = next((j for j in range(i, len(data)) if data[j : j + 1].isdigit()), i)
            end = next((j for j in range(begin, len(data)) if data[j : j + 1] not in b"0123456789.e-+"), begin)
            return data[:begin] + value + data[max(end, begin + 1) :]
        return {"overwrite": data[:i] + new + data[i + len(new) :], "cut": data[:i], "remove": data[:i] + data[i + n :],
                "insert": data[:i] + new * n + data[i:], "swap": data[i:] + data[:i]}[kind]

    return apply


def read_all(path):
    with read_frames(path) as frames:
        return sum(1 for _ in frames)


LOADERS = {
    "road.jpg": (read_image, 60), "road.png": (read_image, 60), "rig.json": (Rig.load, 120),
    "camera.json": (Camera.load, 120), "clip.mp4": (read_all, 20),
}


@pytest.mark.parametrize("name", LOADERS)
def test_damaged_bytes_into_a_loader(originals, tmp_path, name, capfd):
    load, n = LOADERS[name]
    good = (originals / name).read_bytes()
    refused = []

    @fuzz(n)
    @given(harm=damage())
    def check(harm):
        path = tmp_path / f"bad_{name}"
        path.write_bytes(harm(good))
        with np.errstate(all="ignore"):
            refused.append(answer(load, path) is None)

    check()
    assert any(refused)
    assert capfd.readouterr().err == ""  # nor does a library print behind our back


# Arguments with the damaged file as {}; the good ones beside it.
COMMANDS = {
    "image of a JPEG": ("road.jpg", "image {} --rig rig.json -o out.png", 25),
    "image with a rig": ("rig.json", "image road.png --rig {} -o out.png --json out.jsonl", 40),
    "image with all stages": ("road.png", "image {} --rig rig.json -o out.png --stages", 6),
    "rig from a picture": ("road.jpg", "rig {} --camera camera.json -o out.json", 10),
    "rig with a camera": ("camera.json", "rig road.jpg --camera {} -o out.json", 15),
    "calibrate": ("road.png", "calibrate {} road.jpg -o out.json", 6),
    "evaluate": ("labels.json", "evaluate {} --rig rig.json --json -", 25),
    "video": ("clip.mp4", "video {} --rig rig.json -o out.mp4 --json out.jsonl --quiet", 8),
    "video with a rig": ("rig.json", "video clip.mp4 --rig {} --no-video --json - --quiet", 8),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_damaged_bytes_into_a_command(originals, tmp_path, name, capfd, monkeypatch):
    """Exit code 0 or 2, each complaint one line by lanelib, and nothing but whole files left."""
    target, line, n = COMMANDS[name]
    good = (originals / target).read_bytes()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rigs.datasets, "roots", lambda: ())
    for path in originals.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    codes = []

    @fuzz(n)
    @given(harm=damage())
    def check(harm):
        bad = tmp_path / f"bad_{target}"
        bad.write_bytes(harm(good))
        with np.errstate(all="ignore"):
            code = cli.main(line.replace("{}", bad.name).split())
        err = capfd.readouterr().err
        assert code in (0, 2), err
        assert "Traceback" not in err and "OpenCV(" not in err
        assert all(said.startswith("lanelib: ") for said in err.splitlines() if code) and bool(err) >= (code == 2)
        left = [p.name for p in tmp_path.iterdir() if ".part" in p.name or p.name.startswith(".")]
        assert not left
        codes.append(code)
        with contextlib.suppress(OSError):
            (tmp_path / "out.json").unlink()

    check()
    assert 2 in codes
