"""Every explorer in a real JupyterLab: a control is moved by keyboard or mouse, the picture must change, and the
value shown must be the one that lanelib gives here, in the test's own process."""

import re
from dataclasses import replace

import explorer_scenes as scenes
import lab_server
import numpy as np
import pytest

from lanelib import LaneFinder, search, windows
from lanelib.birdseye import BirdsEye
from lanelib.camera import Camera
from lanelib.channels import CHANNELS
from lanelib.explore import look_through, paint_truth, scene_of, simulated_rig
from lanelib.explore.corners import rig_corners
from lanelib.explore.smoothers import centre_at, smoothed, true_centre_at
from lanelib.lane import Lane
from lanelib.road import CarPose
from lanelib.simulator import render_road
from lanelib.threshold import RECIPES, scale_to_255, sobel

# The picture's own pixels: a picture has a blob's address, comparing addresses proves nothing.
# decode() fails when the picture is replaced while it is decoded: then the next one is waited for
PIXELS = """async e => { for (let tries = 0; ; tries++) { try { await e.decode(); break; } catch (fault) {
    if (tries > 50) throw fault; await new Promise(r => setTimeout(r, 20)); } }
    const c = document.createElement('canvas'); c.width = 192; c.height = 108;
  const g = c.getContext('2d'); g.drawImage(e, 0, 0, 192, 108);
  return Array.from(g.getImageData(0, 0, 192, 108).data).reduce((a, b) => (a * 31 + b) >>> 0, 7); }"""


class Panel:
    """One explorer on the page, found by its title."""

    def __init__(self, page, title: str):
        self.page, self.title = page, title
        self.box = page.locator(".lx").filter(has=page.locator(".lx-title", has_text=title))
        self.box.wait_for(timeout=30_000)
        self.box.scroll_into_view_if_needed()
        self.image = self.box.locator("img.widget-image")
        self.before = self.pixels()

    def pixels(self) -> int:
        return self.image.evaluate(PIXELS)

    def control(self, name: str):
        label = self.page.locator("label.widget-label", has_text=re.compile(f"^{re.escape(name)}$"))
        return self.box.locator(".widget-inline-hbox").filter(has=label)

    def slide(self, name: str, key: str, times: int = 1, *, handle: int = 0):
        """Focus a slider's handle and press a key."""
        self.control(name).locator(".noUi-handle").nth(handle).focus()
        for _ in range(times):
            self.page.keyboard.press(key)

    def choose(self, name: str, option: str):
        select = self.control(name).locator("select")
        texts = [text.replace("\N{NO-BREAK SPACE}", " ") for text in select.locator("option").all_text_contents()]
        select.select_option(index=texts.index(option))  # by label, older versions of Playwright want the same spaces

    def click(self, name: str):
        self.box.locator("button", has_text=re.compile(f"^{name}$")).click()

    def tick(self, name: str):
        self.box.locator("label.widget-label-basic", has_text=name).locator("input").click()

    def reads(self, name: str) -> str:
        return self.box.locator(f'[data-name="{name}"] .lx-value').inner_text()

    def shows(self, **values):
        """Wait until the readings (name: text) are shown, and see that the picture has changed since the last time."""
        for name, text in values.items():
            name = name.replace("_", " ")
            try:
                self.page.wait_for_function(
                    """([box, name, text]) =>
                        box.querySelector(`[data-name="${name}"] .lx-value`)?.textContent === text""",
                    arg=[self.box.element_handle(), name, text],
                    timeout=10_000,
                )
            except Exception as error:
                raise AssertionError(f"{name}: {text!r} is right, {self.reads(name)!r} is shown") from error
        self.changes()

    def changes(self):
        """See that the picture has changed since the last time, and that nothing is complained of."""
        for _ in range(50):
            now = self.pixels()
            if now != self.before:
                break
            self.page.wait_for_timeout(100)
        assert now != self.before, "the picture has not changed"
        self.before = now
        assert self.box.locator(".lx-alert").count() == 0, self.box.locator(".lx-alert").inner_text()

    def keep(self, name: str):
        """A screenshot for people to look at, in a wide window and in a narrow one."""
        lab_server.ARTEFACTS.mkdir(exist_ok=True)
        for width in (1200, 900):
            self.page.set_viewport_size({"width": width, "height": 1300})
            self.page.wait_for_timeout(150)
            self.box.screenshot(path=lab_server.ARTEFACTS / f"{name}_{width}.png")
            wider = self.box.evaluate("e => e.scrollWidth - e.clientWidth")
            assert wider <= 1, f"{name} is {wider} px wider than its cell in a window of {width} px"
        self.page.set_viewport_size({"width": 1200, "height": 1000})


@pytest.fixture(scope="module")
def frame_and_truth():
    return scenes.frame_and_truth()


@pytest.fixture
def panel(lab_page):
    """Open an explorer by its title; afterwards neither page nor kernel may have complained."""
    yield lambda title: Panel(lab_page, title)
    assert lab_page.faults == [] and lab_page.outside == []
    assert lab_page.evaluate("() => window._kernelErrors.splice(0)") == []


def test_distortion(panel):
    shown = panel("Distortion explorer")
    k1 = scenes.CAMERA.distortion[0]
    shown.slide("k1", "ArrowRight", 4)
    k1 += 4 * 0.005
    lens = Camera(scenes.CAMERA.camera_matrix, [k1, *scenes.CAMERA.distortion[1:]], scenes.SIZE_WH)
    w, h = scenes.SIZE_WH
    corners = np.array([[0, 0], [w - 1, 0], [w - 1, h - 1], [0, h - 1]], float)
    moved = np.hypot(*(lens.undistort_points(corners) - corners).T).mean()
    shown.shows(corners_move_by=f"{moved:.1f} px")
    shown.keep("distortion")
    shown.click("Calibrated")
    shown.shows(from_the_calibration="0.00 px rms")


def test_boards(panel):
    shown = panel("Chessboards")
    calibration, _ = scenes.calibration()
    shown.click("Worst")
    worst = max((board for board in calibration.boards if board.used), key=lambda board: board.rms_px)
    shown.shows(picture=worst.name, rms_of_this_board=f"{worst.rms_px:.3f} px")
    shown.keep("boards")
    shown.choose("picture", "board4.png")
    shown.shows(used="no", remark="no chessboard in view", rms_of_this_board="–")


def test_threshold(panel, frame_and_truth):
    shown = panel("Threshold explorer")
    frame, truth = frame_and_truth
    shown.slide("range", "ArrowLeft", 30)
    judged = paint_truth(truth, scenes.SIZE_WH)

    def score(mask):
        on = mask & judged.road
        hits = (on & judged.paint).sum()
        return {"precision_of_step": f"{hits / on.sum():.2f}", "recall_of_step": f"{hits / judged.paint.sum():.2f}"}

    saturated = CHANNELS["hls_s"](frame) >= 140
    shown.shows(**score(saturated))
    shown.click("Add step")
    shown.choose("source", "sobel x")
    gradient = scale_to_255(sobel(CHANNELS["grey"](frame)).x)
    steep = (gradient >= 20) & (gradient <= 200)
    shown.shows(**score(steep))
    shown.choose("join by", "AND")
    shown.click("Add step")
    both = saturated & steep
    recipe = {name.replace("step", "recipe"): text for name, text in score(both).items()}
    shown.shows(**recipe, steps_in_recipe="2")
    shown.keep("threshold")
    namespace: dict = {}
    exec(shown.box.locator(".lx-code").inner_text(), namespace)
    assert np.array_equal(namespace["my_recipe"](frame) != 0, both)


def test_warp_by_mouse_and_keyboard(panel, lab_page):
    shown = panel("Warp explorer")
    corners = np.round(rig_corners(scenes.RIG), 1)
    svg = shown.box.locator("svg.lx-quad")
    box = svg.bounding_box()
    scale = box["width"] / scenes.SIZE_WH[0]

    def on_page(corner):
        return box["x"] + (corner[0] + 0.0) * scale, box["y"] + corner[1] * scale

    # Drag the near left corner, with the mouse, by 60 px to the left and 20 up.
    lab_page.mouse.move(*on_page(corners[3]))
    lab_page.mouse.down()
    lab_page.mouse.move(*on_page(corners[3] + (-60, -20)), steps=12)
    lab_page.mouse.up()
    where = svg.locator(".lx-quad-corner").nth(3)
    lab_page.wait_for_timeout(200)
    column, row = map(float, re.findall(r"[\d.]+", where.get_attribute("aria-valuetext")))
    assert abs(column - corners[3, 0] + 60) < 2 and abs(row - corners[3, 1] + 20) < 2
    corners[3] = column, row

    def expected():
        far_left, far_right, near_right, near_left = corners
        view = BirdsEye.from_straight_lines(
            scenes.CAMERA, [near_left, far_left], [near_right, far_right], lane_width_m=3.66
        )
        y = view.road_from_points(corners)[:, 1]
        mounting = view.mounting(scenes.CAMERA)
        return {
            "length,_derived": f"{(y[0] + y[1] - y[2] - y[3]) / 2:.1f} m",
            "pitch": f"{mounting['pitch_deg']:+.2f} °",
            "camera_height": f"{mounting['height_m']:.2f} m",
        }

    shown.shows(**expected())
    # And the far right one by keyboard.
    svg.locator(".lx-quad-corner").nth(1).focus()
    for key in ("Shift+ArrowRight", "Shift+ArrowRight", "ArrowRight", "ArrowDown"):
        lab_page.keyboard.press(key)
    corners[1] += (21, 1)
    shown.shows(**expected())
    shown.keep("warp")
    shown.click("Rig's corners")
    shown.shows(lane_at_near_edge="3.66 m", camera_height="1.31 m", pitch="+2.20 °")


def test_detect(panel, frame_and_truth):
    shown = panel("Detection explorer")
    frame, _ = frame_and_truth
    rig = scenes.RIG
    shown.choose("recipe", "sobel-or-colour")
    shown.slide("windows", "ArrowRight", 3)
    view = LaneFinder(rig).view(scenes.SIZE_WH)
    mask = view.metric.warp(RECIPES["sobel-or-colour"].function(rig.camera.undistort(frame)))
    grid = view.metric.grid
    found = search.sliding_windows(
        mask, n_windows=12, margin_px=0.6 / grid.column_m, minimum_pixels=12, centre=float(grid.column_of(0.0))
    )
    lane = Lane(*windows.fit_lines(found, grid))
    shown.shows(
        offset=f"{lane.offset_m:+.2f} m",
        lane_width=f"{lane.width_m():.2f} m",
        **{"pixels,_left": str(len(found.left_xy))},
    )
    shown.keep("detect")
    shown.choose("model", "joint fit")
    shown.choose("recipe", "paint")
    lane = LaneFinder(rig, track=False).process(frame).lane
    shown.shows(outcome="measured", offset=f"{lane.offset_m:+.2f} m", curvature=f"{1000 * lane.curvature_1pm:+.2f} /km")


def test_smoothing(panel):
    shown = panel("Smoothing explorer")
    frames, truths = scenes.drive()
    fits = [result.fit for result in scenes.results_of(frames)] * 3
    shown.choose("smoothing", "exponential")
    shown.changes()  # only now its slider is free
    shown.slide("alpha", "ArrowLeft", 5)
    means, _ = smoothed(fits, smoothing="exponential", alpha=0.2)
    off = np.array(
        [centre_at(mean, 20) - true_centre_at(truth, 20) for mean, truth in zip(means, truths * 3, strict=True)]
    )
    shown.shows(
        error=f"{100 * np.sqrt(np.nanmean(off**2)):.1f} cm",
        jitter=f"{100 * np.sqrt(np.nanmean(np.diff(off) ** 2)):.2f} cm a frame",
    )
    shown.keep("smoothing")


def test_scrub(panel, folder):
    shown = panel("Video scrubber")
    clip = look_through(folder / "clip.mp4", simulated_rig())
    shown.slide("frame", "ArrowRight", 5)
    result = clip.results[5]
    shown.shows(frame="5", offset=f"{result.offset_m:+.2f} m", confidence=f"{100 * result.confidence:.0f} %")
    shown.choose("stage", "birdseye")
    shown.shows(frame="5")
    shown.choose("stage", "lane")
    shown.shows(frame="5")
    shown.click("Next worst")
    assert clip.results[scenes.DARK_FRAME].status == "held"
    shown.shows(frame=str(scenes.DARK_FRAME))
    assert shown.reads("outcome") == "held" and shown.reads("reason")
    shown.keep("scrub")
    # The play button goes on from where it is, and stops when told to.
    shown.click("Play")
    shown.page.wait_for_function(
        """([box, from]) => Number(box.querySelector('[data-name="frame"] .lx-value').textContent) > from + 2""",
        arg=[shown.box.element_handle(), scenes.DARK_FRAME],
        timeout=15_000,
    )
    shown.click("Stop")
    shown.page.wait_for_timeout(700)  # the last frame may still be on its way
    stopped = shown.reads("frame")
    shown.page.wait_for_timeout(700)
    assert shown.reads("frame") == stopped


def test_simulator(panel):
    shown = panel("Road simulator")
    shown.slide("bend, 1/km", "ArrowRight", 20)
    shown.slide("offset, m", "ArrowLeft", 6)
    frame, truth = render_road(scene_of(bend_1pkm=2.0, offset_m=-0.3))
    result = LaneFinder(simulated_rig(), track=False).process(frame)
    shown.shows(curvature=f"{1000 * result.curvature_1pm:+.2f} /km", offset=f"{result.offset_m:+.2f} m")
    assert shown.box.locator('[data-name="curvature"] .lx-truth').inner_text() == "truth +2.00 /km"
    assert shown.box.locator('[data-name="offset"] .lx-truth').inner_text() == "truth -0.30 m"
    assert abs(truth["offset_m"] + 0.3) < 1e-6 and isinstance(scene_of().pose, CarPose)
    shown.keep("simulator")
    shown.tick("shade of trees")
    dark, _ = render_road(replace(scene_of(bend_1pkm=2.0, offset_m=-0.3, shade=True)))
    result = LaneFinder(simulated_rig(), track=False).process(dark)
    shown.shows(confidence=f"{100 * result.confidence:.0f} %", offset=f"{result.offset_m:+.2f} m")


def test_a_fault_in_a_callback_is_seen(lab_page):
    shown = Panel(lab_page, "Broken explorer")
    assert shown.box.locator(".lx-alert").count() == 0
    shown.slide("x", "ArrowRight")
    shown.box.locator(".lx-fault").wait_for(timeout=10_000)
    assert "KeyError: 'on purpose'" in shown.box.locator(".lx-fault").inner_text()
    lab_page.wait_for_function("() => window._kernelErrors.some(e => e.includes('on purpose'))", timeout=10_000)
    lab_page.evaluate("() => window._kernelErrors.splice(0)")
    shown.slide("x", "ArrowLeft")
    shown.box.locator('[data-name="offset"]').wait_for(timeout=10_000)
    assert shown.box.locator(".lx-alert").count() == 0
    assert lab_page.evaluate("() => window._kernelErrors.splice(0)") == []


def test_every_control_has_a_name_and_can_be_reached_by_keyboard(lab_page):
    nameless = lab_page.evaluate("""() => {
        const bad = [];
        const kinds = ['button', 'select', 'input', '.noUi-handle', '.lx-quad-corner', 'img'];
        for (const e of document.querySelectorAll(kinds.map(kind => '.lx ' + kind).join())) {
            if (e.matches('input[type=number]')) continue;
            const text = e.textContent.trim() || e.closest('label')?.textContent;
            const name = e.getAttribute('aria-label') || e.alt || text;
            if (!name) bad.push('no name: ' + e.outerHTML.slice(0, 120));
            const off = e.tagName === 'IMG' || e.disabled || e.closest('[disabled]');
            if (e.tabIndex < 0 && !off) bad.push('not reachable: ' + e.outerHTML.slice(0, 120));
        }
        return bad;
    }""")
    assert nameless == []


def test_notebook_7(browser, folder):
    """The same notebook in Notebook 7; two explorers moved are enough, the widgets are the same."""
    pytest.importorskip("notebook", reason="Notebook 7 is not installed: pip install 'notebook>=7'")
    url, process = lab_server.serve(folder, "notebook", "--JupyterNotebookApp.expose_app_in_browser=True")
    try:
        page = lab_server.open_and_run(browser, url, "notebooks/explorers.ipynb")
        page.faults.clear()  # of its own plug-ins while it loads
        shown = Panel(page, "Road simulator")
        shown.slide("offset, m", "ArrowRight", 4)
        frame, _ = render_road(scene_of(offset_m=0.2))
        result = LaneFinder(simulated_rig(), track=False).process(frame)
        shown.shows(offset=f"{result.offset_m:+.2f} m")
        shown.keep("notebook7")
        warp = Panel(page, "Warp explorer")
        warp.box.locator(".lx-quad-corner").nth(1).focus()
        page.keyboard.press("Shift+ArrowRight")
        warp.changes()
        assert page.faults == [] and page.outside == [] and page.evaluate("() => window._kernelErrors") == []
        page.close()
    finally:
        lab_server.end(process)
