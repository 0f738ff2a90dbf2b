"""rig.py: a rig is a file, fits every resolution of its camera, and its tables agree with cv2.projectPoints."""

import json
import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from roads import ASPHALT, MOUNTING, SIZE_WH, Lane7, paint_frame, points_on_grid, project, rig, with_dots

from lanelib.errors import LanelibError
from lanelib.jointfit import TRACK_GATES, fit, outward
from lanelib.lane import Lane, Line, Surface
from lanelib.paint import evidence_of, paint_points
from lanelib.rig import FAR_ROW_M, MOST_AROUND, RIG_FORMAT, Rig, View

RIG = rig()


# ---------------------------------------------------------------------------------------------- files
def test_saved_and_loaded_it_is_the_same(tmp_path):
    file = RIG.save(tmp_path / "my rig.json")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["my rig.json"]
    loaded = Rig.load(file)
    assert loaded.to_dict() == RIG.to_dict()
    assert (loaded.name, loaded.size_wh) == ("test", SIZE_WH)
    np.testing.assert_array_equal(loaded.birdseye.road_from_image, RIG.birdseye.road_from_image)
    for name, value in MOUNTING.items():
        assert loaded.mounting[name] == pytest.approx(value, abs=1e-6)


def test_the_file_is_that_of_the_contract(tmp_path):
    numbers = json.loads(RIG.save(tmp_path / "r.json").read_text())
    assert list(numbers) == ["format", "name", "camera", "road_from_image", "notes"]
    assert numbers["format"] == RIG_FORMAT == "lanelib-rig/1"
    assert numbers["camera"]["format"] == "lanelib-camera/1"
    # undistorted pixel (u, v, 1) to the road (x, y, 1)
    uvw = np.linalg.inv(np.array(numbers["road_from_image"])) @ (1.8, 12.0, 1)
    undistorted = RIG.camera.distort_points([uvw[:2] / uvw[2]])
    np.testing.assert_allclose(undistorted, project([[1.8, 12.0, 0]]), atol=0.01)


FOREIGN = {
    "empty": "",
    "text": "not a rig",
    "binary": b"\x89PNG\r\n\x1a\n\x00\xff\xfe",
    "a list": "[1, 2]",
    "a number": "3",
    "null": "null",
    "a camera": json.dumps(RIG.camera.to_dict()),
    "another format": json.dumps(RIG.to_dict() | {"format": "lanelib-rig/9"}),
    "no camera": json.dumps({k: v for k, v in RIG.to_dict().items() if k != "camera"}),
    "no homography": json.dumps({k: v for k, v in RIG.to_dict().items() if k != "road_from_image"}),
    "a word for a matrix": json.dumps(RIG.to_dict() | {"road_from_image": "wide"}),
    "two rows": json.dumps(RIG.to_dict() | {"road_from_image": RIG.to_dict()["road_from_image"][:2]}),
    "singular": json.dumps(RIG.to_dict() | {"road_from_image": [[1, 2, 3]] * 3}),
    "not a number": json.dumps(RIG.to_dict() | {"road_from_image": [[float("nan")] * 3] * 3}),
    "a flat picture": json.dumps(RIG.to_dict() | {"camera": RIG.camera.to_dict() | {"size_wh": [1280, 0]}}),
    "nested": "[" * 100_000,
    "huge number": json.dumps(RIG.to_dict()).replace("1042.0", "1" + "0" * 400),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_foreign_file_is_one_clear_line(tmp_path, kind):
    file = tmp_path / "rig.json"
    file.write_bytes(FOREIGN[kind] if isinstance(FOREIGN[kind], bytes) else FOREIGN[kind].encode())
    with pytest.raises(LanelibError) as error:
        Rig.load(file)
    assert "\n" not in str(error.value) and str(file) in str(error.value)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 255))
def test_a_file_with_a_wrong_byte_is_a_rig_or_an_error(tmp_path_factory, position, value):
    data = bytearray(json.dumps(RIG.to_dict()).encode())
    data[position % len(data)] = value
    file = tmp_path_factory.getbasetemp() / "spoiled.json"
    file.write_bytes(data)
    try:
        assert isinstance(Rig.load(file), Rig)
    except LanelibError as error:
        assert "\n" not in str(error)


def test_what_cannot_be_read_or_written_says_so(tmp_path):
    with pytest.raises(LanelibError, match="cannot read"):
        Rig.load(tmp_path / "absent.json")
    with pytest.raises(LanelibError, match="cannot read"):
        Rig.load(tmp_path)
    with pytest.raises(LanelibError, match="a place that can be written"):
        RIG.save(tmp_path / "absent" / "rig.json")
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(LanelibError, match="a place that can be written"):
        RIG.save(tmp_path / "folder.json")


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    file = RIG.save(tmp_path / "rig.json")
    before = file.read_bytes()

    def disk_full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", disk_full)
    with pytest.raises(LanelibError, match="No space"):
        rig(height_m=2.0).save(file)
    assert file.read_bytes() == before


# ---------------------------------------------------------------------------------------------- resolutions
@pytest.mark.parametrize("size_wh", [(960, 540), (640, 360), (1920, 1080), (427, 240)])
def test_another_resolution_sees_the_same_metres(size_wh):
    scaled = RIG.scaled(size_wh)
    road = np.array([[-1.8, 6, 0], [1.9, 15, 0], [0.4, 40, 0]])
    pixels = project(road, size_wh=SIZE_WH)
    here = (pixels + 0.5) * np.array(size_wh) / SIZE_WH - 0.5
    back = scaled.birdseye.road_from_points(scaled.camera.undistort_points(here))
    np.testing.assert_allclose(back, road[:, :2], atol=2e-3)
    # 427 x 240 is not quite 16:9: its mounting is a little off, its metres are not
    for name, value in MOUNTING.items():
        assert scaled.mounting[name] == pytest.approx(value, abs=0.02)
    assert RIG.scaled(SIZE_WH) is RIG


def test_a_rig_is_itself_alone_and_its_mounting_stays():
    """Arrays have no one truth value: rigs are compared by identity, as cameras are."""
    one, other = rig(), rig()
    assert one == one and one != other and len({one, other}) == 2
    one.mounting["height_m"] = 99.0
    assert one.mounting == other.mounting
    assert pickle.loads(pickle.dumps(one)).mounting == other.mounting


@pytest.mark.parametrize("size_wh", [(1280, 960), (720, 1280), (1, 1), (1280, 700)])
def test_another_shape_is_refused(size_wh):
    with pytest.raises(LanelibError, match="1280x720.*found"):
        RIG.scaled(size_wh)


def test_a_camera_that_looks_at_the_sky_is_refused():
    with pytest.raises(LanelibError, match="sees no road"):
        _ = rig(pitch_deg=-40).scan_grid


# ---------------------------------------------------------------------------------------------- view
def test_the_scan_shows_the_road_in_metres():
    """Stripes drawn by cv2.projectPoints stand in the scan at their metres: to half a column, 2.5 cm."""
    lane, view = Lane7(centre=0.2, heading=0.02, bend=-1 / 400, width=3.5), View(RIG)
    scan = view.scan(paint_frame(lane, noise=0))[..., 1].astype(float)
    for row in range(40, len(view.grid.y_m) - 6):
        y = view.grid.y_m[row]
        for side in (-1, 1):
            near = np.abs(view.grid.x_m - lane.x(y, side)) < 0.4
            share = np.clip(scan[row, near] - 110, 0, None)
            if y < 30 and share.sum() > 0:
                assert share @ view.grid.x_m[near] / share.sum() == pytest.approx(lane.x(y, side), abs=0.04)
    # in the textbook order, from the undistorted picture, the same
    frame = paint_frame(lane, noise=0)
    again = view.scan_undistorted(RIG.camera.undistort(frame))[..., 1].astype(float)
    ours = np.ix_((view.grid.y_m > 8) & (view.grid.y_m < 60), np.abs(view.grid.x_m) < 3)
    assert scan[ours].std() > 15 and np.abs(again - scan)[ours].mean() < 1


def test_rows_are_nearer_together_where_a_pixel_covers_less():
    grid = RIG.scan_grid
    assert grid.y_m[-1] == pytest.approx(RIG.near_m)
    steps = -np.diff(grid.y_m)
    assert (np.diff(steps) < 0).all()  # from far to near
    # the farthest row is where one row of a 1280-wide frame covers FAR_ROW_M: dy/dv = y^2 / (f h)
    far = grid.y_m[0]
    assert far**2 / (1037 * MOUNTING["height_m"]) == pytest.approx(FAR_ROW_M, rel=0.01)
    below = project([[0, far, 0], [0, far - FAR_ROW_M, 0]], yaw_deg=0, roll_deg=0)
    assert below[1, 1] - below[0, 1] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("bend", [-1 / 300, 0.0, 1 / 900])
def test_around_a_lane_there_is_the_same_to_see(bend):
    """The columns that tracking looks at give the same paint on both lines as the whole view, from BGR and YUV."""
    lane, view = Lane7(centre=0.3, heading=0.01, bend=bend, width=3.5), View(RIG)
    around = view.around(lane.mean)
    assert 150 < len(around.grid.x_m) < len(view.grid.x_m)
    assert view.around(lane.mean) is around  # its tables are kept, if not all of a long drive
    seen = {len(view._around)}
    for centre in np.arange(-3.0, 3.0, 0.2):
        for heading in (-0.08, -0.04, 0.0, 0.04, 0.08):
            view.around(Lane7(centre=centre, heading=heading, bend=bend).mean)
            seen.add(len(view._around))
    assert max(seen) <= MOST_AROUND and min(seen) == 1
    around = view.around(lane.mean)
    frame = paint_frame(lane, noise=4)
    for picture in (frame, cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)):
        whole, part = (v.points(paint_points(evidence_of(*v.paint_channels(picture)))) for v in (view, around))
        near, near_part = (np.abs(outward(p, lane.mean)[1]) < TRACK_GATES[0] * p.std for p in (whole, part))
        assert near.sum() > 100
        for name in ("bearing", "inverse", "row", "weight"):
            np.testing.assert_allclose(getattr(part, name)[near_part], getattr(whole, name)[near], atol=1e-3)


def test_far_from_the_road_the_whole_view_is_looked_at():
    view = View(RIG)
    assert len(view.around(Lane7(bend=1 / 40).mean).grid.x_m) > 0.6 * len(view.grid.x_m)  # it leaves the view
    assert view.around(Lane7(centre=30.0).mean) is view


def test_yuv_planes_show_the_same_paint_as_bgr():
    """Also outside of the frame, which is black and neither bright nor yellow."""
    view = View(RIG)
    frame = paint_frame(Lane7(centre=0.3, width=3.5), noise=0)
    bgr, yuv = (view.paint_channels(p) for p in (frame, cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)))
    white = view.scan(np.full_like(frame, 255))[..., 0]
    for a, b in zip(bgr, yuv, strict=True):
        assert np.abs(a.astype(int) - b)[white == 255].mean() < 1.5
        assert b[white == 0].max() <= 2 and (white == 0).sum() > 1000


@pytest.mark.parametrize("planes", [False, True])
def test_dots_are_seen_wherever_they_lie_between_the_rows(planes, monkeypatch):
    """Of dirty Botts' dots between 8 and 25 m, where rows are up to 1 m apart, nearly all have a row's worth of paint;
    without a look between the rows a quarter has not."""

    def share_seen():
        rng, view, rows = np.random.default_rng(5), View(RIG), []
        for _ in range(12):
            places = np.column_stack([np.arange(-4, 4.5, 1.0) + rng.uniform(-0.3, 0.3, 9), rng.uniform(8, 25, 9)])
            frame = with_dots(paint_frame(Lane7(), colours=(ASPHALT, ASPHALT)), places)
            frame = cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420) if planes else frame
            p = view.points(paint_points(evidence_of(*view.paint_channels(frame))))
            for x, y in places:
                near = (np.abs(p.bearing / p.inverse - x) < 0.1) & (np.abs(1 / p.inverse - y) < 1.5)
                rows.append(sum(p.weight[near & (p.row == row)].max() for row in set(p.row[near])))
        return np.mean(np.array(rows) >= 1)

    assert share_seen() > 0.9
    monkeypatch.setattr("lanelib.rig.SHINING_LEVELS", 255)
    assert share_seen() < 0.78


def test_points_are_bearings():
    view, lane = View(RIG), Lane7(centre=0.2, heading=0.01, bend=1 / 900)
    p = points_on_grid(lane, view.grid, height_m=view.height_m, focal_px=view.focal_px)
    scan = np.zeros((len(view.grid.y_m), len(view.grid.x_m)), np.uint8)
    column = np.rint(view.grid.column_of(p.bearing / p.inverse)).astype(int)
    for shift in (-1, 0, 1):
        scan[p.row, np.clip(column + shift, 0, scan.shape[1] - 1)] = 255
    seen = view.points_of_mask(scan)
    assert (seen.n_rows, seen.height_m, seen.focal_px) == (len(view.grid.y_m), view.height_m, view.focal_px)
    assert view.focal_px == pytest.approx(1042)
    found = fit(seen, lane.mean)
    assert found.support.sum() > 0.8 * len(view.grid.y_m)
    assert abs(found.mean[0] - 0.2) < 0.02


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 7, 9])
def test_the_middle_of_a_mask_is_its_middle(width):
    """White stripes 5 to 45 cm wide: no bias to either side, whatever the width (a plateau has no crest)."""
    view = View(RIG)
    mask = np.zeros((len(view.grid.y_m), len(view.grid.x_m)), np.uint8)
    mask[:, 200 : 200 + width] = 255
    seen = view.points_of_mask(mask)
    column = view.grid.column_of(seen.bearing / seen.inverse)
    assert len(column) >= 0.95 * len(mask)
    np.testing.assert_allclose(column, 200 + (width - 1) / 2, atol=0.1)


@pytest.mark.parametrize("size_wh", [SIZE_WH, (640, 360)])
def test_lines_in_pixels_are_where_opencv_projects_them(size_wh):
    """A bend on a hill seen by a nodding camera. Small angles: 1 px of a 1280-wide frame from 6 m on."""
    view, lane = View(rig(size_wh)), Lane7(0.3, -0.02, 1 / 500, 0, 3.6, np.radians(0.5), -1 / 3000)
    lines = [Line([lane.bend, lane.heading, lane.x(0, s)], (4, 35)) for s in (-1, 1)]
    found = view.lines_px(Lane(*lines, Surface(view.height_m, lane.pitch, lane.hill)))
    y = np.linspace(6, 60, 400)
    tilt = {"pitch_deg": MOUNTING["pitch_deg"] + 0.5, "size_wh": size_wh}
    for line, pixels in zip(lines, found, strict=True):
        assert (np.diff(pixels[:, 1]) < 0).all()  # from near to far
        expected = project(np.column_stack([line.x(y), y, lane.hill * y**2 / 2]), **tilt)[::-1]
        inside = (pixels[:, 1] > expected[0, 1]) & (pixels[:, 1] < expected[-1, 1])
        x = np.interp(pixels[inside, 1], expected[:, 1], expected[:, 0])
        assert inside.sum() > 15
        assert np.abs(pixels[inside, 0] - x).max() < 1.0 * size_wh[0] / 1280


def test_nothing_above_the_first_row_is_looked_at_and_the_first_row_is():
    """Noise above the row changes nothing, for the whole view and around a lane; noise in it and the next does."""
    lane, view, rng = Lane7(centre=0.3, width=3.5), View(RIG), np.random.default_rng(3)
    frame = cv2.cvtColor(paint_frame(lane, noise=4), cv2.COLOR_BGR2YUV_I420)
    height = frame.shape[0] * 2 // 3
    first = view.first_row
    assert first % 2 == 0 and 0.3 * height < first < 0.7 * height

    def noisy(rows):
        other = frame.copy()
        other[rows] = rng.integers(0, 256, other[rows].shape)
        return other

    above = noisy(slice(0, first))
    halves = above[height:].reshape(2, height // 2, -1)
    halves[:, : first // 2] = rng.integers(0, 256, halves[:, : first // 2].shape)
    for v in (view, view.around(lane.mean)):
        for seen, expected in zip(v.paint_channels(above), v.paint_channels(frame), strict=True):
            assert np.array_equal(seen, expected)
    touched = noisy(slice(first, first + 4))
    assert not np.array_equal(view.paint_channels(touched)[0], view.paint_channels(frame)[0])
