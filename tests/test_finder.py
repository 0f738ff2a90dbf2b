"""finder.py: roads of known geometry come out as they are, and whatever is no road comes out as a reason."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from roads import SIZE_WH, Lane7, paint_frame, project, rig, rig_of_scene

from lanelib import datasets, jointfit
from lanelib.datasets import project_root
from lanelib.errors import LanelibError
from lanelib.evaluate import metric_score, pixel_score, score
from lanelib.finder import LaneFinder, Rig, confidence_of, implausible
from lanelib.labels import read_labels
from lanelib.lane import Check
from lanelib.rig import View
from lanelib.road import CarPose, Marking, Mounting, Road
from lanelib.simulator import Scene, render_road
from lanelib.threshold import RECIPES

SMALL = (640, 360)
RIG = rig(SMALL)
LANE = Lane7(centre=-0.3, heading=0.02, bend=-1 / 900, width=3.6)  # the car 0.30 m right of centre, a bend to the left
FRAME = paint_frame(LANE, size_wh=SMALL, dashed=(1,))
STILLS = project_root() / "test_images" / "rendered"


def check_lines(result, lane, *, at=(5.0, 10, 20, 30), tolerance_m=0.05):
    """Both lines of a result against a lane of known geometry."""
    at = np.array(at)
    for line, side in ((result.lane.left, -1), (result.lane.right, 1)):
        assert np.abs(line.x(at) - lane.x(at, side)).max() < tolerance_m


def all_finite(result):
    """No NaN anywhere that a user could meet, and a row that JSON takes."""
    row = result.to_row("x")
    assert result.status in ("measured", "held", "none")
    assert bool(result.reason) == (result.status != "measured")
    assert (result.lane is None) == (result.status == "none")
    assert 0 <= result.confidence <= 1 and np.isfinite(row["run_time"])
    for value in (row["radius_m"], row["curvature_1pm"], row["offset_m"], row["lane_width_m"]):
        assert value is None or np.isfinite(value)
    assert all(np.isfinite(line).all() for line in (result.left_px, result.right_px, *row["lanes"]))
    for check in result.checks:
        assert np.isfinite(check.value)
    if result.lane is not None:
        for line in (result.lane.left, result.lane.right):
            assert np.isfinite(line.coefficients).all() and np.isfinite(line.covariance).all()


# ---------------------------------------------------------------------------------------------- any frame
SHAPES = st.one_of(
    arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=9),
    st.sampled_from(
        [
            (1, 1),
            (1, 1, 3),
            (2, 2, 3),
            (9, 16),
            (36, 64, 3),
            (18, 32, 4),
            (37, 65, 1),
            (45, 80, 3),
            (0, 16, 3),
            (90, 160, 3),
            (16, 9, 3),
            (90, 160, 2),
            (90, 160, 5),
        ]
    ),
)


@settings(max_examples=60, deadline=None)
@given(SHAPES.flatmap(lambda shape: arrays.arrays(np.uint8, shape, fill=st.integers(0, 255))))
def test_any_array_of_bytes_gives_a_result(frame):
    all_finite(LaneFinder(RIG).process(frame))


NOISE = np.random.default_rng(0).integers(0, 256, (360, 640, 3), dtype=np.uint8)
NO_ROADS = {
    "black": np.zeros_like(FRAME),
    "white": np.full_like(FRAME, 255),
    "grey": np.full_like(FRAME, 120),
    "noise": NOISE,
    "faint noise": np.uint8(110 + NOISE // 16),
    "checkerboard": np.uint8(np.indices((360, 640)).sum(0) // 8 % 2 * 255)[..., None].repeat(3, 2),
    "stripes": np.random.default_rng(2).integers(0, 256, (90, 1, 3), dtype=np.uint8).repeat(4, 0).repeat(640, 1),
    "grey rows": np.random.default_rng(2).integers(0, 256, (360, 1, 1), dtype=np.uint8).repeat(640, 1).repeat(3, 2),
    "asphalt": paint_frame(LANE, size_wh=SMALL, colours=((98, 100, 99),) * 2, noise=4),
}


@pytest.mark.parametrize("name", NO_ROADS)
def test_where_there_is_no_road_there_is_no_lane_but_a_reason(name):
    result = LaneFinder(RIG).process(NO_ROADS[name])
    all_finite(result)
    assert result.status == "none" and result.reason, result
    row = result.to_row("x")
    assert (row["lanes"], row["radius_m"], row["offset_m"]) == ([], None, None)


STRANGE = {
    "upside down": np.ascontiguousarray(FRAME[::-1]),
    "mirrored": np.ascontiguousarray(FRAME[:, ::-1]),
    "negative": 255 - FRAME,
    "random stripes": np.random.default_rng(1).integers(0, 256, (1, 640, 3), dtype=np.uint8).repeat(360, 0),
    "blobs": cv2.resize(NOISE[::8, ::8], SMALL, interpolation=cv2.INTER_CUBIC),
    "half a frame": np.vstack([FRAME[:290], np.full((70, 640, 3), 128, np.uint8)]),
}


@pytest.mark.parametrize("name", STRANGE)
def test_strange_frames_give_finite_numbers(name):
    """What has structure may look like a lane; it must not break anything, nor the frames after it."""
    finder = LaneFinder(RIG)
    for _ in range(5):
        all_finite(finder.process(STRANGE[name]))
    for _ in range(20):
        result = finder.process(FRAME)
    check_lines(result, LANE)


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize(
    "kind", [np.zeros((360, 640, 3), np.uint8), np.full((360, 640, 3), 255, np.uint8), NOISE, FRAME]
)
def test_no_recipe_raises(recipe, kind):
    for order in ("textbook", None):
        all_finite(LaneFinder(RIG, recipe=recipe, order=order).process(kind))


@pytest.mark.parametrize("seed", range(10))
def test_noise_is_never_a_lane(seed):
    """Noise of the full range, and a camera's in the dark (12 grey levels): at two sizes."""
    rng = np.random.default_rng(seed)
    full = rng.integers(0, 256, (360, 640, 3), dtype=np.uint8)
    assert LaneFinder(RIG).process(full).status == "none"
    for size in (SMALL, (320, 180)):
        grainy = np.uint8(np.clip(rng.normal(110, 12, (size[1], size[0], 3)), 0, 255))
        assert LaneFinder(RIG).process(grainy).status == "none"


@pytest.mark.parametrize(
    "convert",
    [
        lambda f: f[..., 2],
        lambda f: f[..., 2:],
        lambda f: np.dstack([f, f[..., :1]]),
        lambda f: np.asfortranarray(f),
        lambda f: f[:, ::-1].copy()[:, ::-1],
    ],
)
def test_grey_bgra_and_any_memory_layout_are_taken(convert):
    check_lines(LaneFinder(RIG).process(convert(FRAME)), LANE, tolerance_m=0.1)


@pytest.mark.parametrize("shape", [(480, 640, 3), (640, 360, 3), (360, 600, 3)])
def test_a_frame_of_another_shape_is_refused_with_both_sizes(shape):
    finder = LaneFinder(RIG)
    result = finder.process(np.zeros(shape, np.uint8))
    assert result.status == "none"
    assert f"{shape[1]}x{shape[0]}" in result.reason and "640x360" in result.reason and "\n" not in result.reason
    check_lines(finder.process(FRAME), LANE)  # and does no harm to the next


@pytest.mark.parametrize("size_wh", [(1280, 720), (960, 540), (426, 240), (1920, 1080)])
def test_another_resolution_of_the_same_camera_gives_the_same_metres(size_wh):
    """Mid-clip: the finder is tracking, the size changes, the lane stays."""
    finder = LaneFinder(RIG)
    finder.process(FRAME)
    result = finder.process(paint_frame(LANE, size_wh=size_wh, dashed=(1,), seed=3))
    assert result.status == "measured" and result.size_wh == size_wh
    check_lines(result, LANE, tolerance_m=0.06)
    x = np.array([p[0] for p in result.left_px])
    assert x.max() < size_wh[0]


def test_unknown_names_are_refused():
    for wrong in (
        {"recipe": "magic"},
        {"model": "magic"},
        {"order": "magic"},
        {"smoothing": "magic"},
        {"recipe": next(r for r in RECIPES if r != "paint"), "order": "finder"},
    ):
        with pytest.raises(LanelibError):
            LaneFinder(RIG, **wrong)


# ---------------------------------------------------------------------------------------------- drawn roads
@settings(max_examples=25, deadline=None)
@given(st.floats(-0.8, 0.8), st.floats(-0.04, 0.04), st.floats(-1 / 250, 1 / 250), st.floats(3.2, 4.1), st.booleans())
def test_a_drawn_lane_comes_out_as_drawn(centre, heading, curvature, width, dashed):
    """Polygons drawn by cv2.projectPoints through a lens: lines to 5 cm at 5-20 m, offset to 3 cm with its sign."""
    lane = Lane7(centre, heading, -curvature / 2, 0.0, width)
    result = LaneFinder(RIG).process(paint_frame(lane, size_wh=SMALL, dashed=(1,) if dashed else ()))
    assert result.status == "measured"
    check_lines(result, lane, at=(5.0, 10, 20))
    assert result.offset_m == pytest.approx(-centre, abs=0.03)
    assert result.width_m == pytest.approx(width, abs=0.05)
    all_finite(result)


def test_its_pixels_are_those_of_the_frame_as_given():
    """The result's pixels against cv2.projectPoints, row by row: within 1 px of a 640-wide frame."""
    result = LaneFinder(RIG).process(FRAME)
    y = np.geomspace(4, 30, 300)
    for pixels, side in ((result.left_px, -1), (result.right_px, 1)):
        expected = project(np.column_stack([LANE.x(y, side), y, 0 * y]), size_wh=SMALL)[::-1]
        inside = (pixels[:, 1] > expected[0, 1]) & (pixels[:, 1] < expected[-1, 1])
        x = np.interp(pixels[inside, 1], expected[:, 1], expected[:, 0])
        assert inside.sum() > 10 and np.abs(pixels[inside, 0] - x).max() < 1.0


@pytest.mark.parametrize("side", [-1, 1])
def test_one_line_alone_is_a_lane_but_says_so(side):
    colours = [(98, 100, 99), (205, 210, 208)][::side]
    result = LaneFinder(RIG).process(paint_frame(LANE, size_wh=SMALL, colours=colours, noise=1))
    assert result.status == "measured"
    line = result.lane.left if side < 0 else result.lane.right
    at = np.array([5.0, 10, 20])
    assert np.abs(line.x(at) - LANE.x(at, side)).max() < 0.12
    both = LaneFinder(RIG).process(FRAME)
    assert result.confidence < both.confidence - 0.2
    assert result.lane.std["width_m"] > 0.1 > 3 * both.lane.std["width_m"]


def test_a_seam_a_shadow_and_a_kerb_do_not_move_the_lane():
    """A dark seam 0.5 m inside the right line, all along it, and a bright shoulder 0.8 m outside the left."""
    extra = [(lambda y: LANE.x(y, 1) - 0.5, 0.08, (40, 40, 40)), (lambda y: LANE.x(y, -1) - 2.3, 3.0, (150, 150, 150))]
    check_lines(
        LaneFinder(RIG).process(paint_frame(LANE, size_wh=SMALL, dashed=(1,), extra=extra)), LANE, tolerance_m=0.08
    )


def test_a_double_line_is_taken_by_its_inner_one():
    """Double yellow on the left, middles 0.2 m apart, the inner one on the lane's line; seen at full size."""
    extra = [(lambda y: LANE.x(y, -1) - 0.21, 0.11, (60, 170, 205))]
    frame = paint_frame(LANE, size_wh=SIZE_WH, paint_m=0.11, extra=extra)
    result = LaneFinder(RIG).process(frame)
    assert abs(result.lane.left.x(8.0) - LANE.x(8.0, -1)) < 0.05
    assert abs(result.lane.right.x(8.0) - LANE.x(8.0, 1)) < 0.03


def test_two_orders_see_the_same_lane():
    """Warp first, or undistort and measure paint first: on the rendered stills, hard ones too, within 1 px (mean)."""
    data = datasets.get("rendered")
    if not data.images():
        pytest.skip(f"no rendered stills in {data.test_images}")
    rig_of_stills, rows, apart = Rig.load(data.rig_file), np.arange(440, 700, 5), []
    for path in data.images():
        frame = cv2.imread(str(path))
        a, b = (LaneFinder(rig_of_stills, order=order).process(frame) for order in ("finder", "textbook"))
        assert bool(a) == bool(b), path.name
        for one, other in zip((a.left_px, a.right_px), (b.left_px, b.right_px), strict=True) if a else ():
            x = [np.interp(rows, p[::-1, 1], p[::-1, 0], left=np.nan, right=np.nan) for p in (one, other)]
            apart.append(np.nanmean(np.abs(x[0] - x[1])))
    assert len(apart) == 2 * 22 and np.mean(apart) < 1 and np.median(apart) < 0.6


def test_the_classic_windows_find_the_drawn_lane_too():
    for track in (False, True):
        finder = LaneFinder(RIG, model="windows", track=track)
        for _ in range(2):
            check_lines(finder.process(paint_frame(LANE, size_wh=SMALL)), LANE, at=(6.0, 12, 20), tolerance_m=0.2)


def test_without_tracking_frames_do_not_know_of_each_other():
    other = paint_frame(Lane7(0.6, -0.02, 1 / 500, 0, 3.9), size_wh=SMALL)
    finder = LaneFinder(RIG, track=False)
    first = finder.process(FRAME).to_row("x")
    finder.process(other)
    again = finder.process(FRAME).to_row("x")
    first.pop("run_time"), again.pop("run_time")
    assert first == again
    assert LaneFinder(RIG, track=False).process(NO_ROADS["black"]).status == "none"


@pytest.mark.parametrize(
    ("lane", "why"),
    [
        (Lane7(width=4.9), r"it is 4\.[89]\d* m wide, allowed 2\.6-4\.6 m"),
        (Lane7(width=2.4), r"it is 2\.[34]\d* m wide, allowed 2\.6-4\.6 m"),
        (Lane7(0.2, 0.05, -1 / (2 * 12), width=3.5), r"its radius is 1[1-4]\.\d+ m, allowed at least 15 m"),
    ],
)
def test_what_no_road_can_be_is_refused_with_its_number(lane, why):
    result = LaneFinder(RIG, track=False).process(paint_frame(lane, size_wh=SMALL))
    assert result.status == "none" and re.fullmatch(f"implausible lane: {why}", result.reason)
    assert [check.ok for check in result.checks].count(False) == 1


def test_the_first_check_that_fails_is_the_reason():
    good, wide = Check("order", 3.6, "", True), Check("width", 4.93, "2.6-4.6 m", False, "it is {:.4g} m wide")
    assert implausible((good, wide)) == "implausible lane: it is 4.93 m wide, allowed 2.6-4.6 m"


def test_what_no_road_can_be_does_not_hide_what_one_can_be(monkeypatch):
    fits, narrow = jointfit.fits, LANE.mean + (2.4 - LANE.width) * (np.arange(7) == jointfit.WIDTH)

    def with_a_better_one(*args, **options):
        found = fits(*args, **options)
        return [*found, replace(found[0], mean=narrow, energy=max(fit.energy for fit in found) + 5)]

    monkeypatch.setattr(jointfit, "fits", with_a_better_one)
    check_lines(LaneFinder(RIG, track=False).process(FRAME), LANE)
    monkeypatch.setattr(jointfit, "fits", lambda *args, **options: with_a_better_one(*args, **options)[-1:])
    assert LaneFinder(RIG, track=False).process(FRAME).reason.startswith("implausible lane: it is 2.4")


def test_a_road_without_paint_has_no_lane():
    """Asphalt, cracks and grass of forty roads at random: none begins with what little lies on a line."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        road, pose = Road([0], [rng.uniform(-1, 1) / 300]), CarPose(10, *rng.uniform(-1, 1, 2) * (0.5, 0.02))
        scene = Scene(seed=seed, left=None, right=None, others=(), road=road, pose=pose)
        assert not LaneFinder(rig_of_scene(scene), track=False).process(render_road(scene)[0]), seed


def test_one_line_alone_needs_more_paint_to_begin_with_than_to_go_on():
    """12 rows of one line, nothing on the other: a tracked lane goes on, but none begins."""
    view = View(RIG)
    finder = LaneFinder(RIG)
    fit = finder.process(FRAME).fit
    support = np.zeros_like(fit.support)
    support[0, 20:32] = 1
    little = replace(fit, support=support, energy=20.0)
    assert finder._judge(little)[0] is not None
    assert "on one line alone, 13 needed" in finder._judge(little, begins=True)[1]
    support[0, 32:34] = 1
    assert finder._judge(replace(little, support=support), begins=True)[0] is not None
    both = np.zeros_like(fit.support)
    both[0, 20:27] = both[1, 20:22] = 1
    assert finder._judge(replace(little, support=both), begins=True)[0] is not None
    points, channels = finder.points(FRAME, view)
    few = points.some(np.flatnonzero((points.bearing < 0) & (points.row > points.n_rows - 13)))
    assert "on one line alone" in LaneFinder(RIG)._best(few, channels, view)[1]


@pytest.mark.parametrize("beyond_m", [0.1, 0.4])
def test_a_lane_that_does_not_hold_the_car_is_not_begun(beyond_m):
    """The car is beyond the right line of a painted lane; to its right there is nothing."""
    beside = Lane7(centre=-1.8 - beyond_m, width=3.6)
    result = LaneFinder(RIG).process(paint_frame(beside, size_wh=SMALL))
    assert result.lane is None or result.lane.left.x(5.0) < 0 < result.lane.right.x(5.0)


def test_a_tracked_lane_gives_way_to_a_better_one(monkeypatch):
    """The left line is painted anew 0.7 m further out, its ghost stays. Tracking alone would follow the ghost; a fresh
    search among the points that were seen finds the new line, and one frame later it is taken."""
    old = Lane7(centre=0.3, width=3.0)
    new = Lane7(centre=0.3 - 0.35, width=3.7)
    frame = paint_frame(new, size_wh=SMALL, extra=[(lambda y: old.x(y, -1), 0.13, (108, 108, 108))])
    looks = []
    seen = View.paint_channels
    monkeypatch.setattr(View, "paint_channels", lambda view, f: looks.append(1) or seen(view, f))
    finder = LaneFinder(RIG)
    for _ in range(3):
        check_lines(finder.process(paint_frame(old, size_wh=SMALL)), old)
    looks.clear()
    widths = [finder.process(frame).width_m for _ in range(12)]
    assert len(looks) == len(widths)
    assert widths[0] == pytest.approx(old.width, abs=0.1)
    check_lines(finder.process(frame), new)


def test_a_lost_lane_is_held_and_then_none():
    finder = LaneFinder(RIG)
    seen = finder.process(FRAME)
    held = [finder.process(NO_ROADS["black"]) for _ in range(14)]
    assert [r.status for r in held] == ["held"] * 12 + ["none"] * 2
    assert (np.diff([r.confidence for r in (seen, *held)]) <= 0).all() and held[-1].confidence == 0
    assert all(r.reason for r in held)
    check_lines(held[5], LANE)


def test_stages_leave_the_tracker_alone():
    finder = LaneFinder(RIG)
    finder.process(FRAME)
    before = finder.tracker.fit
    pictures = finder.stages(NO_ROADS["noise"])
    assert pictures and finder.tracker.fit is before and finder.tracker.missed == 0


def test_confidence_grows_with_paint():
    fits = [
        LaneFinder(RIG, track=False).process(paint_frame(LANE, size_wh=SMALL, far_m=far)).fit for far in (7, 12, 60)
    ]
    values = [confidence_of(f) for f in fits]
    assert 0 < values[0] < values[1] < values[2] <= 1


# ---------------------------------------------------------------------------------------------- the simulator's roads
def clip(radius_m, n=8, **scene):
    """Truth and results of a clip at 28 m/s on a road of constant radius (positive: to the left)."""
    scene = Scene(road=Road([0], [1 / radius_m]), **scene)
    finder, pairs = LaneFinder(rig_of_scene(scene)), []
    for i in range(n):
        here = replace(scene, pose=CarPose(20 + 28 * i / 25, 0.25, -0.01), seed=i)
        frame, truth = render_road(here)
        pairs.append((finder.process(frame), truth))
    return pairs


@pytest.mark.parametrize("radius_m", [-250, 500, -900])
def test_a_simulated_bend_has_its_radius_offset_and_lines(radius_m):
    """Over a clip: curvature within 10 % (median) and signed, offset within 3 cm, lines within 3 cm to 20 m and
    10 cm at 30 m."""
    pairs = clip(radius_m)
    assert all(result.status == "measured" for result, _ in pairs)
    assert np.median([result.curvature_1pm * radius_m for result, _ in pairs]) == pytest.approx(1, abs=0.1)
    assert np.median([abs(result.offset_m - truth["offset_m"]) for result, truth in pairs]) < 0.03
    assert np.sign(pairs[0][1]["offset_m"]) == 1  # the car is right of the lane's centre, and the finder says so
    errors = []
    for result, truth in pairs:
        for line, true in zip((result.lane.left, result.lane.right), truth["lanes_road_m"], strict=True):
            x, y = np.array(true).T
            errors.append([abs(line.x(at) - np.interp(at, y, x)) for at in (5.0, 10, 20, 30)])
    assert (np.median(errors, axis=0) < [0.03, 0.03, 0.03, 0.10]).all()


def test_a_simulated_straight_road_is_straight():
    result, truth = clip(1e9, n=3)[-1]
    assert truth["radius_m"] is None and np.isinf(result.radius_m)
    assert abs(result.curvature_1pm) < 1e-4
    assert result.to_row("x")["radius_m"] is None


HARD = {
    "dim": {"light": 0.25},
    "concrete and shade": {"concrete_m": ((25, 60),), "shade_m": ((30, 50),)},
    "worn dashes": {
        "left": Marking(-1.83, "yellow", wear=0.5),
        "right": Marking(1.83, gap_m=10.97, phase_m=7.0, wear=0.5),
    },
    "another mounting": {"mounting": Mounting(1.6, 4.0, 1.5, -2.0)},
    "noisy": {"noise": 12.0},
}


@pytest.mark.parametrize("name", HARD)
def test_hard_simulated_roads(name):
    for result, truth in clip(-700, n=2, **HARD[name]):
        assert result.status == "measured"
        assert result.offset_m == pytest.approx(truth["offset_m"], abs=0.06)
        assert result.width_m == pytest.approx(truth["lane_width_m"], abs=0.12)
        for line, true in zip((result.lane.left, result.lane.right), truth["lanes_road_m"], strict=True):
            x, y = np.array(true).T
            assert max(abs(line.x(at) - np.interp(at, y, x)) for at in (5.0, 10, 20)) < 0.15


def test_a_simulated_road_without_lines_is_no_lane():
    scene = Scene(left=None, right=None, others=())
    finder = LaneFinder(rig_of_scene(scene))
    for seed in range(3):
        result = finder.process(render_road(replace(scene, seed=seed))[0])
        assert not result or result.confidence < 0.1  # the kerb alone may be taken for a line, hardly believed


def test_a_rig_that_is_a_degree_off_is_forgiven():
    """The car is loaded: the camera looks 0.8 degrees higher than the rig says. Lines in the frame within 2 px."""
    tilted = RIG.mounting["pitch_deg"] - 0.8
    frame = paint_frame(LANE, size_wh=SMALL, pitch_deg=tilted)
    result = LaneFinder(RIG).process(frame)
    y = np.geomspace(5, 30, 200)
    for pixels, side in ((result.left_px, -1), (result.right_px, 1)):
        expected = project(np.column_stack([LANE.x(y, side), y, 0 * y]), size_wh=SMALL, pitch_deg=tilted)[::-1]
        rows = np.arange(np.ceil(expected[0, 1]) + 2, expected[-1, 1])
        x = [np.interp(rows, p[:, 1], p[:, 0]) for p in (pixels[::-1], expected)]
        assert np.abs(x[0] - x[1]).max() < 2
    assert np.degrees(result.lane.surface.pitch_rad) == pytest.approx(-0.8, abs=0.15)
    assert result.offset_m == pytest.approx(0.3, abs=0.05)


# ---------------------------------------------------------------------------------------------- rendered stills
def test_the_shipped_stills_are_measured_as_they_are():
    """Path-traced pictures with truth, each on its own, with the shipped rig: every lane found, no false one, and the
    figures that the issue asks for (median): 3 cm at 10 m, 10 cm at 30 m, offset 3 cm."""
    labels, camera = read_labels(STILLS)
    labels = {name: row for name, row in labels.items() if (STILLS / name).is_file()}
    if len(labels) < 3:
        pytest.skip(f"fewer than three rendered stills in {STILLS}")
    finder = LaneFinder(Rig.load(project_root() / "rigs" / "rendered.json"), track=False)
    rows = {name: finder.process(cv2.imread(str(STILLS / name))).to_row(name) for name in labels}
    frames = score(labels, rows, camera).frames
    pixels, metric = pixel_score(frames), metric_score(frames)
    assert metric.found == 1 and metric.false_lanes == 0
    assert pixels.tusimple > 0.99 and pixels.strict > 0.93 and pixels.lanes == 1
    assert metric.lateral_m[1] < 0.03 and metric.lateral_m[2] < 0.03 and metric.lateral_m[3] < 0.10
    assert metric.offset_m < 0.03 and metric.width_m < 0.03
