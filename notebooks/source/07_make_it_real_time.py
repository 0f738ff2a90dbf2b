"""Notebook 07: the textbook's order measured, then each step that makes it fast. The format: README.md here."""
# %% [markdown]
# # 07 Make it real-time
#
# A camera gives 25 frames a second or more, so a lane finder has 40 ms for each, on a computer that has other things to
# do. The textbook's pipeline takes half of that in one thread, before a video is decoded or written, and the reflex is to ask
# for a faster computer, another language, a graphics card. Before that, one question: which of all these pixels does anyone ever look at?
#
# **What you will do:** find out where the time goes; change the order of the steps; choose the size of the bird's-eye
# view by accuracy; let decoding, computing and encoding overlap; and prove after each step that the lane stays the same.
#
# **What you will learn:** to measure before you change anything; fused look-up tables; why a small picture can be as
# exact as a large one; Amdahl's law; pipelining.
#
# **What you need:** notebooks 03 and 04, or a rough idea of undistorting, warping and fitting.
#
# **Minutes:** 20 to read and run, 40 with the exercises.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start("images", "rig")

# %%
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from lanelib import LaneFinder, Rig, ablation, datasets, draw, evaluate, exercises, explore, figures
from lanelib.figures import n07
from lanelib.paint import paint_channels
from lanelib.pipeline import process_video
from lanelib.threshold import recipe_by_name
from lanelib.video import VideoWriter, read_frames
from lanelib.windows import find_pixels, fit_lines

# %%
rig = Rig.load(datasets.get("rendered").rig_file)
frame, truth = notebook.road("test2.jpg")
camera = rig.camera

# %% [markdown]
# ## Forty milliseconds
#
# The textbook's order, at full resolution throughout: undistort the frame, threshold it, warp the mask, slide windows,
# fit, fill the lane in the bird's-eye view, warp that back, blend. Each step is one call; the stopwatch takes the best
# of several, as CPU time in one thread, as in a program that has run for a while. **Before you run it:** rank the steps. Which one takes longest?

# %%
view = LaneFinder(rig).view((1280, 720))
recipe = recipe_by_name(ablation.CLASSIC)
undistorted = cv2.undistort(frame, camera.camera_matrix, camera.distortion)
mask = recipe.function(undistorted)
from_above = view.metric.warp(mask)
pixels = find_pixels(from_above, view.metric.grid)
lane = LaneFinder(rig, recipe=ablation.CLASSIC, track=False).process(frame).lane
steps = {
    "undistort": lambda: cv2.undistort(frame, camera.camera_matrix, camera.distortion),
    "threshold": lambda: recipe.function(undistorted),
    "warp": lambda: view.metric.warp(mask),
    "windows": lambda: find_pixels(from_above, view.metric.grid),
    "fit": lambda: fit_lines(pixels, view.metric.grid),
    "draw": lambda: n07.warped_back_overlay(undistorted, view.metric, lane),
}

# %% tags=["nbval-ignore-output"] alt="A bar of the textbook's steps in milliseconds: thresholding, undistorting and the fit share most of it; warp, windows and drawing are short."
textbook = n07.milliseconds(steps)
n07.stacked({"textbook's order": textbook}, title="where the time goes")

# %% tags=["nbval-ignore-output"]
ranked, whole = sorted(textbook, key=textbook.get, reverse=True), sum(textbook.values())
shares = ", ".join(f"{step} {textbook[step] / whole:.2f}" for step in ranked)
notebook.say(f"{whole:.1f} ms, {whole / 40:.2f} of a frame's 40. Of the whole: {shares}.")

# %% [markdown]
# (Times differ from computer to computer and from run to run; ratios do, too, but less. The tests of this course compare
# what its cells print, but not times.)
#
# The windows, which are the search for the lane itself, take little. The fit takes about as much as undistorting or
# thresholding, for thousands of pixels have a say in it. All the rest is work on 921,600 pixels, of which sky, trees and the
# other lanes are the most.
#
# ## Which pixels does anyone look at?

# %%
grid = rig.scan_grid
columns, rows = grid.size_wh
share = columns * rows / (1280 * 720)
notebook.say(f"The finder's bird's-eye view has {columns} × {rows} pixels: **{share:.3f}** "
             f"of the frame's, for {grid.x_m[0]:.1f} to {grid.x_m[-1]:.1f} m sideways and "
             f"{grid.y_m[-1]:.1f} to {grid.y_m[0]:.1f} m ahead.")

# %% alt="Left the frame, right the same road in the small bird's-eye view, its rows closer together near the car."
small = view.scan(frame)
figures.show({"frame": frame, "all that the finder looks at": small})

# %% [markdown]
# Columns are 5 cm wide, so that a line has two to three of them. Rows are not equally far apart: steps of equal
# $1/\sqrt{y}$ lie between equal metres (too many rows far away, where the frame shows next to nothing) and equal pixels
# of the frame (too many near by, where nothing happens).
#
# ## Step 1: warp first, through one table
#
# The textbook makes an undistorted picture and warps it. Every pixel is interpolated twice, and most of them for
# nothing. Turn it round: for each pixel of the *small* view ask where it lies in the *raw* frame.
#
# $$ (x, y)\ \text{on the road} \;\xrightarrow{\ H^{-1}\ }\; \text{undistorted pixel}
#    \;\xrightarrow{\ \text{lens}\ }\; \text{pixel as given} $$
#
# That chain depends on the camera only. Compute it once for all pixels, and each frame costs one `cv2.remap`.

# %%
white = np.full(frame.shape[:2], 255, np.uint8)
seen_raw, seen_undistorted = view.scan(white) == 255, view.scan_undistorted(white) == 255
two_steps = view.scan_undistorted(camera.undistort(frame)).astype(float)
difference = np.abs(two_steps - small)[seen_raw & seen_undistorted]
gift = np.mean(seen_raw & ~seen_undistorted)
notebook.say(f"Where both see the road, they differ by {difference.mean():.2f} grey levels in the "
             f"mean: a second interpolation blurs a little. And {gift:.3f} of the small view is "
             "seen through the one table only.")

# %% [markdown]
# That last number is a gift: an undistorted picture of the same size cuts off the corners of the frame, and the road
# beside the car lies there.

# %% tags=["nbval-ignore-output"] alt="CPU time of undistorting and of the fused table: the table takes a small part."
step1 = n07.milliseconds({
    "undistort, tables made anew": steps["undistort"],
    "undistort, tables kept": lambda: camera.undistort(frame),
    "one table to the small view": lambda: view.scan(frame),
})
figures.bars(step1, unit="CPU time, ms", highlight="one table to the small view")

# %% [markdown]
# `cv2.undistort` works out its tables anew at every call; keeping them is the first gain, for nothing. The fused table is
# another matter altogether, because it touches only the pixels that are needed.
#
# ### Exercise 1: the chain of the table
#
# Write the chain for some points: metres on the road (N, 2) to pixels of the frame as given (N, 2).
# `rig.birdseye.points_from_road` is the inverse homography; `rig.camera` knows the lens, in both directions. Mind which
# one is needed.

# %%
def pixels_of_road(points_m, rig):
    """Where the frame as given shows these points of the road, (N, 2) px."""
    # BEGIN SOLUTION
    return rig.camera.distort_points(rig.birdseye.points_from_road(points_m))
    # END SOLUTION


exercises.check_pixels_of_road(pixels_of_road)

# %% [markdown]
# ## Step 2: as small as accuracy allows
#
# How small may the view be? Not a matter of taste: measure it. The same eight frames through views of different sizes,
# against the truth. **Before you run it:** at which column width will the error begin to grow, if a line is 10 to 15 cm
# wide?

# %%
known = datasets.get("rendered").image_truth()
easy = {n: notebook.road(n)[0] for n, t in known.items() if "hard" not in t["tags"]}
sizes = [(grid.column_m * f, round(rows / f)) for f in (8, 4, 2, 1, 0.5, 0.25)]
views = [ablation.view_of_size(rig, column_m=column, rows=rows) for column, rows in sizes]
errors = []
for sized in views:
    lanes = {n: ablation.lane_in_view(sized, f) for n, f in easy.items()}
    errors.append([np.abs(ablation.believed_error_m(lanes[n], known[n])) for n in easy])
errors_cm = [100 * np.concatenate(e) for e in errors]

# %% alt="Error over the width of a column, both logarithmic: the median stays below half a centimetre up to 5 cm, is about a centimetre at 10 cm, and several beyond."
at_20, worst = [[f(e[:, 2]) for e in errors_cm] for f in (np.nanmedian, np.nanmax)]
widths_cm = [100 * column for column, _ in sizes]
n07.over_size(widths_cm, {"median": at_20, "worst": worst})

# %%
lines = [["column, cm", "view", "pixels of the frame's", "median at 20 m, cm", "worst, cm"]]
for (column, _), sized, a, b in zip(sizes, views, at_20, worst, strict=True):
    w, h = sized.grid.size_wh
    size = [f"{100 * column:.2f}", f"{w} × {h}", f"{w * h / 921600:.4f}"]
    lines.append([*size, f"{a:.2f}", f"{b:.1f}"])
notebook.say(evaluate.table(lines))

# %% tags=["nbval-ignore-output"] alt="CPU time of a search in views of six sizes: below 5 cm columns it rises steeply."
cost = n07.milliseconds({f"{100 * c:.2f} cm": (lambda v=v: ablation.lane_in_view(v, frame))
                         for (c, _), v in zip(sizes, views, strict=True)}, repeat=4)
figures.bars(cost, unit="CPU time of a fresh search, ms", highlight="5.00 cm")

# %% [markdown]
# From 5 cm columns on, more pixels gain millimetres at most: the middle of a stripe is located to a fraction of a column by
# the parabola through three of them, and dozens of rows share in each line. With 10 cm columns a line is one pixel wide,
# the ridge filter has nothing to stand on, and the error grows. So it is 5 cm: finer ones cost
# up to four times as much for millimetres, coarser ones double the error and soon lose centimetres.
#
# That is true for lines. On many motorways lanes are marked by *Botts' dots*, ceramic domes of 4 inches, and rows have a trap
# for them:

# %%
steps_m = -np.gradient(grid.y_m)[::-1]
apart = ", ".join(f"{np.interp(y, grid.y_m[::-1], steps_m):.2f} m apart at {y} m"
                  for y in (5, 10, 20))
notebook.say(f"The rows of the small view are {apart}; a dot is 0.10 m long.")

# %% [markdown]
# A dot may lie between two rows, and then no filter ever sees it. More rows would cost time in every step that follows.
# Instead the view looks up one more pixel half way between each row and the next, without interpolation, and adds what is clearly
# brighter there (`View.paint_channels`). Without it more than a fifth of dirty dots are missed, with it fewer than a tenth:
# `tests/test_rig.py` counts them. What does it cost?

# %% tags=["nbval-ignore-output"]
finder = LaneFinder(rig)
more = n07.more_ms(lambda: view.paint_channels(frame),
                   than=lambda: paint_channels(view.scan(frame)))
tracked = n07.milliseconds({"frame": lambda: finder.process(frame)}, repeat=30)["frame"]
notebook.say("Less than 0.05 ms: about what this stopwatch can tell." if more < 0.05 else
             f"{more:.2f} ms more, {more / tracked:.2f} of what a tracked frame takes.")

# %% [markdown]
# ## Step 3: look where the lane was
#
# A lane does not jump. A fresh search tries bends, bearings and widths by the thousand; while tracking, the last
# frame's lane is the start and only the points beside it matter.

# %% tags=["nbval-ignore-output"] alt="CPU time of a fresh search and of tracking: tracking takes about a quarter."
fresh, tracking = LaneFinder(rig, track=False), LaneFinder(rig)
tracking.process(frame)
step3 = n07.milliseconds({"fresh search": lambda: fresh.process(frame),
                          "while tracking": lambda: tracking.process(frame)}, repeat=15)
figures.bars(step3, unit="CPU time, frame to lane, ms", highlight="while tracking")

# %% [markdown]
# ## Proof: the lines stay the same
#
# A speed-up without this section is a bug with good marketing. The same measure of paint and the same fit in both orders:
# undistort, measure and warp at full size (`threshold.paint_response`), against warp first and small. The difference between
# the lines, in pixels of the frame, over all pictures with a lane, the hard ones too:

# %%
marked = {name: notebook.road(name)[0] for name, t in known.items() if t["lanes"]}
first, full = (ablation.run(LaneFinder(rig, track=False, order=order), marked.items(), known,
                            camera) for order in ("finder", "textbook"))
apart = evaluate.score(full.rows, first.rows).pixels
notebook.say(f"Between the two orders: **{apart.mean_px:.2f} px** on average, 95 % below "
             f"{apart.p95_px:.1f} px. Against the truth: warp first "
             f"{first.evaluation.pixels.mean_px:.2f} px, textbook's order "
             f"{full.evaluation.pixels.mean_px:.2f} px.")

# %% [markdown]
# And tracking against searching each frame of a clip afresh:

# %%
clip = notebook.clip()
drive = {t["raw_file"]: t for t in clip.truth[:100]}
moving = dict(zip(drive, clip.frames(0, len(drive)), strict=True))
tracked, afresh = (ablation.run(LaneFinder(clip.rig, track=track), moving.items(), drive,
                                clip.rig.camera) for track in (True, False))
apart = evaluate.score(afresh.rows, tracked.rows).pixels
notebook.say(f"Tracked and fresh lines are {apart.mean_px:.2f} px apart. Against the truth: "
             f"tracked {tracked.evaluation.pixels.mean_px:.2f} px, fresh "
             f"{afresh.evaluation.pixels.mean_px:.2f} px.")

# %% [markdown]
# Below a pixel, and no worse against the truth. This is what "the same" means here: not bit by bit, but within
# a fraction of a pixel, and no farther from the road.
#
# ## Step 4: draw only the lane
#
# The textbook fills the lane in the bird's-eye view, warps this picture back and blends two full frames. But a lane is a
# polygon: 48 points on each line, taken through homography and lens, filled and blended in place.

# %%
result = LaneFinder(rig, track=False).process(frame)
plain = draw.overlay(frame, result, text=False)
classic = n07.warped_back_overlay(undistorted, view.metric, result.lane)

# %% alt="The two overlays: the textbook's is on the undistorted frame and ends at 40 m; the polygon is on the frame as given and fades out."
figures.show({"textbook: warped back": classic, "polygon": plain})

# %%
y = np.linspace(8, 30, 12)
off = []
for line, drawn in ((result.lane.left, result.left_px), (result.lane.right, result.right_px)):
    flat = result.lane.surface.flat_from_road(np.column_stack([line.x(y), y]))
    here = camera.distort_points(rig.birdseye.points_from_road(flat))
    off.append(np.interp(here[:, 1], drawn[::-1, 1], drawn[::-1, 0]) - here[:, 0])
notebook.say(f"The polygon's edges lie within {np.abs(off).max():.2f} px of the fitted lines, each "
             "point of which was taken through nod, homography and lens on its own.")

# %% tags=["nbval-ignore-output"] alt="CPU time of two ways to draw: the polygon takes about a quarter."
canvas = frame.copy()
step4 = n07.milliseconds({"draw, warp back, blend": steps["draw"],
                          "polygon in place": lambda: draw.overlay_bgr(canvas, result)})
figures.bars(step4, unit="CPU time, ms", highlight="polygon in place")

# %% [markdown]
# ## Everything together

# %% tags=["nbval-ignore-output"] alt="The textbook's order as a long bar, in the shares of the first one; the finder's order, frame to lane and the polygon, as a short stub below it."
short = {"frame to lane": lambda: tracking.process(frame),
         "draw the polygon": lambda: draw.overlay_bgr(canvas, result)}
both = n07.milliseconds(steps | short, repeat=9)  # all measured again: then a ratio means something
textbook, ours = ({name: both[name] for name in order} for order in (steps, short))
n07.stacked({"textbook's order": textbook, "finder's order": ours},
            title="the same frame, the same lane")

# %% tags=["nbval-ignore-output"]
whole_ms, ours_ms = sum(textbook.values()), sum(ours.values())
notebook.say(f"Here and now: {whole_ms:.1f} ms against {ours_ms:.1f} ms, "
             f"**{whole_ms / ours_ms:.0f} times** faster; "
             f"room for {1000 / ours_ms:.0f} frames a second.")

# %% [markdown]
# In Python, in one thread, with the same accuracy. Nothing was written in another language; work was left out.
#
# ### Exercise 2: what is still worth it?
#
# Amdahl's law: if a share $s$ of the time gets $f$ times faster, the rest takes as long as before. How many times faster
# is the whole? Use it on the bar above before you optimise anything else.

# %%
def speedup(share, factor):
    """How many times faster everything gets."""
    # BEGIN SOLUTION
    return 1 / ((1 - share) + share / factor)
    # END SOLUTION


exercises.check_speedup(speedup)

# %% [markdown]
# ## Step 5: let the stages overlap
#
# A video has two more stages: decoding before, encoding behind. One after the other, their times add up. But they are
# different programs (ffmpeg, twice, and Python), and while one of them works on frame 7, the next can work on frame 6.

# %% alt="Two time lines of five frames: one after the other they take 100 ms, overlapped the encoder is always busy and sets the pace."
n07.timelines({"decode": 5, "find and draw": 2, "encode": 13})

# %% [markdown]
# ### Exercise 3: frames a second
#
# Given the stages' times in ms, how many frames a second come out one after the other, and how many overlapped (once the
# pipeline is full)? Return both.

# %%
def frames_a_second(stage_ms):
    """(one after the other, overlapped); stage_ms is a list."""
    # BEGIN SOLUTION
    return 1000 / sum(stage_ms), 1000 / max(stage_ms)
    # END SOLUTION


exercises.check_frame_rates(frames_a_second)

# %% [markdown]
# Now for real: the same three seconds of the clip, first in the simplest loop, then through `process_video`, which
# decodes and encodes in processes of their own and hands on frames as YUV planes, the way the file stores them: no
# conversion to BGR and back, half the bytes.

# %%
def simple_loop(source, target, end_s=3.0):
    """Decode, find, draw, encode, one after the other, in BGR; returns the rows."""
    finder, rows = LaneFinder(clip.rig), []
    with (read_frames(source, end_s=end_s) as frames,
          VideoWriter(target, fps=clip.fps) as writer):
        for picture in frames:
            found = finder.process(picture.frame_bgr)
            rows.append(found.to_row(f"{picture.index:06}"))
            writer.write(draw.overlay_bgr(picture.frame_bgr, found), time_s=picture.time_s)
    return rows

# %%
def pipelined(source, target, end_s=3.0):
    """The same, overlapped, on YUV planes."""
    finder, rows = LaneFinder(clip.rig), []

    def work(planes, index, _):
        found = finder.process_yuv420(planes)
        rows.append(found.to_row(f"{index:06}"))
        return draw.overlay_yuv420(planes, found)

    process_video(source, work, output=target, end_s=end_s, pixel_format="yuv420p")
    return rows

# %%
made, seconds = {}, {}
with tempfile.TemporaryDirectory() as folder:
    for name, way in (("simple loop", simple_loop), ("pipelined", pipelined)):
        began = time.perf_counter()
        made[name] = way(clip.path, Path(folder) / f"{len(made)}.mp4")
        seconds[name] = time.perf_counter() - began

# %%
a, b = ({row["raw_file"]: row for row in made[name]} for name in made)
apart = evaluate.score(a, b).pixels
notebook.say(f"{len(a)} and {len(b)} frames, in the same order: {list(a) == list(b)}. The lines "
             f"are {apart.mean_px:.2f} px apart, because the colour planes have half the size.")

# %% tags=["nbval-ignore-output"] alt="Frames a second from file to file: the pipelined way is faster."
rates = {name: len(a) / s for name, s in seconds.items()}
figures.bars(rates, unit="frames a second, file to file", highlight="pipelined", digits=0)

# %% [markdown]
# On a busy machine, or with small frames, the two come close to each other: ffmpeg already runs beside Python in both, and
# the encoder sets the pace in both. That is the point of the exercise above: what you make faster must be
# the slowest stage. After this notebook that is no longer the lane finder, it is H.264.
#
# ## The lane does not mind
#
# The explorer shows all stages of the full-size order for one frame. Compare *joint fit* with *sliding windows*, change
# windows and margins, and watch how little of the picture decides.

# %% tags=["nbval-ignore-output"]
explore.detect(frame, rig, truth)

# %% alt="The frame with its lane, the paint points from above and the fitted lane: a few hundred points carry it all."
explore.detect_look(explore.Frame(frame, rig), model="joint", truth=truth)

# %% [markdown]
# ## What you have learned
#
# - Measure first: the time was not where the lane is searched for.
# - The cheapest pixel is the one that nobody touches: warp first, through one table, into a small view.
# - The size of that view is a measured number, at the knee of accuracy over cost.
# - Each step comes with its proof that the result stayed.
# - Overlapped stages run at the pace of the slowest.
#
# ## When it fails
#
# - **A first frame is not a thousandth frame.** Tables, caches and the processor's clock warm up, and the C library learns
#   not to give large arrays back to the system, where fetching them anew can cost more than the work itself; measure after that.
# - **A fresh search takes several times as long** as tracking, and it comes just when the road is difficult. The worst
#   case has to fit into the 40 ms, not the mean.
# - **The rig changes** (another zoom, another size): the table has to be made anew. `LaneFinder` keeps one per size.
# - **Shrinking the raw frame first** looks like the same trick and is not: it blurs the far road, where every pixel
#   counts, as much as the near one.
#
# ## How production systems do it
#
# The warp is a fixed function of the image processor; the picture arrives rectified. The neural network that finds
# the lines works on a crop of the road and at several scales, for the same reason as here. Frames never leave the video
# memory as RGB. And the schedule is fixed: every stage has its milliseconds, and what misses its slot is dropped,
# because a lane that is 100 ms old is 3 m old.
#
# ## Further reading
#
# - G. Amdahl, *Validity of the single processor approach to achieving large scale computing capabilities* (1967): few pages,
#   and the law.
# - D. Knuth, *Structured programming with go to statements* (1974): where the sentence about premature optimisation
#   stands, with its other half.
# - OpenCV's documentation of `remap` and `convertMaps`: fixed-point tables, and why they are faster.
# - M. Bertozzi and A. Broggi, *GOLD* (1998): bird's-eye view lane detection in real time, on the hardware of 1998.
#
# ## Three questions
#
# 1. A colleague makes the fit ten times faster. What does the driver of the encoder-bound program notice?
# 2. Why may the bird's-eye view be so much smaller than the frame without loss, but not the frame itself?
# 3. Two orders differ by 0.3 px. How would you decide whether that is a bug?

# %% [markdown] tags=["answer"]
# 1. Nothing: the slowest stage sets the pace. The processor has a bit more time for others, that is all.
# 2. The view spends its pixels where the lane is: near the car the frame has far more pixels per metre than are needed,
#    far away fewer. A smaller frame loses the far ones.
# 3. Compare both with the truth. If neither is worse, the difference is noise of interpolation; if one is, it
#    has a bug, however small the difference.
