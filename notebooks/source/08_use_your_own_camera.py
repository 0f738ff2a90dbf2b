"""Notebook 08: from a printed board to one's own annotated drive, and what goes wrong. The format: README.md here."""
# %% [markdown]
# # 08 Use your own camera
#
# Take a lane finder from the web, feed it your own dash cam, and it fails, or worse: it works, and every number is
# wrong. It believes in somebody else's lens, at somebody else's height, behind somebody else's windscreen. Four commands
# put that right, and this notebook is the way through them, wrong turns included.
#
# **What you will do:** print a chessboard, photograph it, calibrate, make a rig from straight road, run a clip, check the
# metres, watch a live camera. The shipped set stands in for your camera until you have your own pictures: change one
# path, and the same cells do it for yours.
#
# **What you will learn:** how pictures of a board should look; which error in a rig has which symptom, and how to see it
# without any truth; what zoom, cropping and stabilisers do to a calibration.
#
# **What you need:** notebook 00. For your own run: a printer, something flat to glue on, a camera with fixed focus and
# zoom, a few minutes of straight, marked road. **The passenger films, not the driver.**
#
# **Minutes:** 20 to read and run, 60 with the exercises, an afternoon with your own camera.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start("boards", "images", "rig")

# %%
import shutil
import tempfile
import textwrap
from pathlib import Path

import numpy as np

from lanelib import BirdsEye, LaneFinder, Rig, datasets, draw, evaluate, exercises, explore, figures
from lanelib.calibration import calibrate
from lanelib.dashes import dash_period
from lanelib.errors import LanelibError
from lanelib.figures import n01, n08
from lanelib.live import live
from lanelib.pictures import read_image, write_image
from lanelib.video import read_frames

# %%
shipped = datasets.get("rendered")

# %% [markdown]
# ## Somebody else's rig
#
# Here is a drive of ours, looked at with the rig of another car: a van, its camera 20 cm higher and turned to the
# side by 2°. **Before you run it:** will the finder notice?

# %%
own = Rig.load(shipped.rig_file)
frame, truth = notebook.road("straight_lines1.jpg")
borrowed = n08.mounted(own, height_m=own.mounting["height_m"] + 0.2, yaw_deg=2.0)
result = LaneFinder(borrowed, track=False).process(frame)

# %% alt="A straight motorway. The lane lies on its lines; the card says measured, and that the lane is 4.24 m wide."
figures.show(draw.overlay(frame, result), width=8)

# %%
said = f"{result.width_m:.2f} m" if result else f"no lane ({result.reason})"
notebook.say(f"The lane is {truth['lane_width_m']:.2f} m wide; with the borrowed rig: **{said}**.")

# %% [markdown]
# The picture gives nothing away: pixels are pixels. It is the metres that are wrong, all of them, in proportion. A
# rig belongs to a camera *and* to where it is mounted.
#
# ## Print a board
#
# A chessboard with 9 × 6 inner corners fits on A4 with squares of 25 mm. `lanelib` draws it to scale, with a ruler:
# printers like to scale a page "to fit", and the ruler tells.

# %%
page = n08.board_page((9, 6), square_mm=25, paper="A4", dpi=300)
workshop = tempfile.TemporaryDirectory()  # goes away with this notebook's kernel
folder = Path(workshop.name)
write_image(folder / "board.png", page)
print(f"board.png: {page.shape[1]} x {page.shape[0]} dots")

# %% alt="A page with a chessboard of 10 by 7 squares and a ruler of 100 mm below it."
figures.show(page[::4, ::4], width=6)

# %% [markdown]
# Print it at 100 %, measure the ruler, and glue the sheet onto something flat: glass, a drawing board. Corrugated
# cardboard bends, and a bent board bends the calibration (`--bent` estimates its shape, at a price). Matt paper: glossy
# ink mirrors the window. Copy `board.png` from `folder`, or write it to a place of your own.
#
# ### Exercise 1: to scale
#
# How many dots is the side of a square of `square_mm` when the printer makes `dpi` dots an inch?

# %%
def square_dots(square_mm, dpi):
    """Side of a square in dots."""
    # BEGIN SOLUTION
    return square_mm / 25.4 * dpi
    # END SOLUTION


exercises.check_square_px(square_dots)

# %% [markdown]
# ## Photograph it
#
# - **Lock** focus, zoom and, if you can, exposure; switch every stabiliser and "wide-angle correction" off. Use the mode
#   in which you will film: the video mode of a phone crops the sensor.
# - **15 to 20 pictures**, the board 20 to 60 % of the frame's width, each from another angle, tilted by 20° to 45°.
# - **Fill the corners.** The lens is known only where corners were seen; let the board leave the frame a little, cut-off
#   boards count, too.
# - Hold still, have light.
#
# For now the shipped boards are ours. The whole rest of this notebook works in `folder`, with the commands that you would
# type in a terminal.

# %%
(folder / "boards").mkdir(exist_ok=True)
for path in shipped.boards():
    shutil.copy(path, folder / "boards")
n08.command("lanelib calibrate boards -o calibration.json", folder,
            without=("k2", "k3", "p1", "p2"))

# %% [markdown]
# Read it from the bottom up. The **RMS** should be below half a pixel for a good board on glass, below one for a sheet
# of paper. The standard deviations of `fx` and `cx` should be well below 1 % of `fx`. Then the table: each picture was
# used or has a reason. (The higher distortion coefficients are left out here; notebook 01 has them.)
#
# Are the corners everywhere?

# %% alt="All corners of the boards in one frame: dense in the middle, nearly out to all four edges; the four corners of the frame stay empty."
calibrated = calibrate(folder / "boards")
n01.coverage(calibrated.boards, calibrated.camera.size_wh)

# %% [markdown]
# Not quite: the outermost corners are empty; one more board in each would help. There the model of the lens is prolonged from
# where corners were seen.
#
# ### What goes wrong, and how it shows
#
# Five ways to fail, all popular. `calibrate` refuses what it can notice:

# %%
good = [(p.name, read_image(p)) for p in shipped.boards()[1:4]]
corners = [(250, 120), (600, 200), (150, 260), (420, 90), (500, 300)]
flat = [n08.held_up(page, (1280, 720), [(x, y), (x + 560, y), (x + 560, y + 396), (x, y + 396)])
        for x, y in corners]
tries = {
    "two pictures": (good[:2], {}),
    "the same picture again and again": ([(f"copy{i}", good[0][1]) for i in range(4)], {}),
    "squares counted instead of corners": (good, {"board_wh": (10, 7)}),
    "rows and columns of another board": (good, {"board_wh": (8, 6)}),
    "the board always parallel to the sensor": ([(f"flat{i}", p) for i, p in enumerate(flat)], {}),
}

# %%
for what, (seen, options) in tries.items():
    try:
        calibrate(seen, **options)
        print(f"{what}: accepted")
    except LanelibError as error:
        print(f"{what}:\n{textwrap.indent(textwrap.fill(str(error), 100), '    ')}")

# %% [markdown]
# What it cannot notice is a camera that changed between calibration and drive: another zoom, another video mode. For that
# there is the check of the metres, below.
#
# ## Make a rig
#
# A rig needs one more thing: where the camera sits. No tape measure: a frame of straight road with two clear
# lines has it all (notebook 03 derives how). The vanishing point gives pitch and yaw, the width of the lane the height.
# A clip is better than a frame, since the car weaves and nods, and the median does not.

# %%
for name in ("straight_lines1.jpg", "straight_lines2.jpg"):
    shutil.copy(shipped.test_images / name, folder)
said = n08.command("lanelib rig straight_lines1.jpg straight_lines2.jpg --camera calibration.json "
                   "--lane-width 3.66 -o my_rig.json", folder)
print(said.clauses)

# %% [markdown]
# `--lane-width` is the scale of everything: 3.66 m (12 ft) on a US motorway, 3.75 m or 3.5 m on many European ones; look
# it up or measure it. Wrong by 5 % here is wrong by 5 % everywhere.
#
# For once we know the truth, so let us see what this took and gave:

# %%
mine = Rig.load(folder / "my_rig.json")
rows = [["", "found", "true"]]
for key, unit in (("height_m", "m"), ("pitch_deg", "°"), ("yaw_deg", "°")):
    found, true = (f"{rig.mounting[key]:+.2f} {unit}" for rig in (mine, own))
    rows.append([key.split("_")[0], found, true])
rows.append(["focal length", f"{mine.camera.camera_matrix[0, 0]:.1f} px",
             f"{own.camera.camera_matrix[0, 0]:.1f} px"])
notebook.say(evaluate.table(rows))

# %% [markdown]
# No chessboard at hand? `--camera none` assumes a lens without distortion and a field of view of 60°, and says so:

# %%
said = n08.command("lanelib rig straight_lines1.jpg straight_lines2.jpg --camera none "
                   "--lane-width 3.66 -o guess.json", folder)
print(said.clauses)

# %% [markdown]
# Width and offset are then as good as before, because the lane's width scales them. Distances *along* the road hang
# on the assumed focal length; the dashes on the road can check it, if you know their period.
#
# ## Check it, without any truth
#
# On your own road nobody hands you the truth. But you know five things about a drive on straight road: its lines are
# straight, they are parallel, they are a lane apart, its dashes have a period, and the car drives along it. Each error of a
# rig breaks its own choice of them.

# %%
m = own.mounting
wrong = {
    "true rig": own,
    "height + 20 %": n08.mounted(own, height_m=1.2 * m["height_m"]),
    "pitch + 1°": n08.mounted(own, pitch_deg=m["pitch_deg"] + 1),
    "yaw + 2°": n08.mounted(own, yaw_deg=m["yaw_deg"] + 2),
    "focal + 20 %": n08.with_focal_length(own, 1.2),
}

# %% alt="The same straight road from above with five rigs: the true one, upright and as wide as it is; wider; closing; leaning to the right; stretched."
n08.rigs_from_above(wrong, frame)

# %%
straight = [read_image(path) for path in sorted(folder.glob("straight*.jpg"))]
rows = [["rig", "width, m", "nod found, °", "heading found, °", "dashes, m"]]
for name, rig in wrong.items():
    seen = LaneFinder(rig, track=False).process(frame)
    pitch, heading = np.rad2deg(seen.fit.mean[[5, 1]]) if seen else (np.nan, np.nan)
    numbers = [f"{seen.width_m:.2f}", f"{pitch:+.1f}", f"{heading:+.1f}"] if seen else ["-"] * 3
    period = dash_period(rig, straight)
    found = f"{period.period_m:.1f} ± {period.std_m:.1f}" if period else "-"
    rows.append([name, *numbers, found])
notebook.say(evaluate.table(rows))

# %% [markdown]
# (True: a width of 3.66 m and dashes every 14.63 m. Two frames give the dashes with the uncertainty shown, a clip does
# better; a fifth more is 17.6 m.) The finder forgives a good deal, because it estimates nod and heading anew in every
# frame: it reports a "nod" of a whole degree that is none, and a lane that leads two degrees to the right. So these two
# numbers, averaged over a straight drive, are the best check there is: **both should be near zero.** What it cannot
# forgive is the scale.
#
# ### Exercise 2: diagnose
#
# Four drivers send you their symptoms. What is wrong with each rig: `"height"`, `"pitch"`, `"yaw"` or `"focal length"`?
#
# - **a** Lines parallel, the lane 10 % too wide, the dashes 10 % too long.
# - **b** From above the lane of a straight road becomes narrower with the distance.
# - **c** Lines parallel, the width right, the dashes 15 % too long.
# - **d** Lines parallel, but on straight road both lead to the right, and the lane seems to leave the car's path.

# %%
# BEGIN SOLUTION
# STUB: diagnosis = {"a": ..., "b": ..., "c": ..., "d": ...}
diagnosis = {"a": "height", "b": "pitch", "c": "focal length", "d": "yaw"}
# END SOLUTION
exercises.check_diagnosis(diagnosis)

# %% [markdown]
# ## Put the rig right by hand
#
# A straight road whose lines `lanelib rig` does not find? Then you be the finder: drag the four corners onto the lane's
# lines, two far and two near, until the lines from above are upright. (Corners also move with the arrow keys.)

# %% tags=["nbval-ignore-output"]
by_hand = explore.warp(frame, mine, truth)
by_hand

# %% [markdown]
# The explorer keeps nothing. By notebook 03 two lines and the lane's width are all that a rig needs. Here it goes beside
# `my_rig.json`; save yours under that name, and the commands below take it.

# %%
far_left, far_right, near_right, near_left = by_hand.state["corners"]
seen = BirdsEye.from_straight_lines(mine.camera, [near_left, far_left], [near_right, far_right],
                                    lane_width_m=3.66)
dragged = Rig(mine.camera, seen, "by_hand", "corners on the lines of straight_lines1.jpg")
print("wrote", dragged.save(folder / "by_hand.json").name)
keys = ("height_m", "pitch_deg", "yaw_deg")
print(", ".join(f"{key} {dragged.mounting[key]:.2f}" for key in keys))

# %% alt="The road from above with three rigs, lines straight and parallel in each."
files = [folder / f"{name}.json" for name in ("my_rig", "by_hand", "guess")]
n08.rigs_from_above({file.name: Rig.load(file) for file in files}, frame)

# %%
guess = Rig.load(folder / "guess.json")
off = guess.camera.camera_matrix[0, 0] / own.camera.camera_matrix[0, 0] - 1
notebook.say("Upright, parallel and a lane apart in all three. That the focal length of the "
             f"guessed lens is off by {100 * off:+.1f} % does not show here: only the dashes "
             "can tell, and to show so little they need a clip.")

# %% [markdown]
# ## Run your drive

# %%
clip = notebook.clip()
shutil.copy(clip.path, folder)
words = (f"lanelib video {clip.path.name} --rig my_rig.json -o annotated.mp4 --end 4 "
         "--json lanes.jsonl")

# %% tags=["nbval-ignore-output"]
n08.command(words, folder)

# %% tags=["nbval-ignore-output"]
if not (folder / "annotated.mp4").exists():
    raise SystemExit(f"the command above failed: {words}")
annotated = (f.frame_bgr for f in read_frames(folder / "annotated.mp4"))
notebook.play(annotated, alt="The drive with its lane, found with my_rig.json.", fps=clip.fps)

# %% alt="Eight moments of the drive, each with the lane between its lines."
lanes = evaluate.read_rows(folder / "lanes.jsonl")
finder = LaneFinder(mine)
moments = [draw.overlay(f, finder.process(f), text=False) for f in clip.frames(0, 96)][::12]
figures.contact_sheet(moments, [f"{12 * i / clip.fps:.1f} s" for i in range(len(moments))])

# %% [markdown]
# And the numbers of `lanes.jsonl`, one line a frame, against the truth, with the rig that we made ourselves:

# %%
drive = {t["raw_file"]: t for t in clip.truth[: len(lanes)]}
scored = evaluate.score(drive, lanes, clip.rig.camera)
pixels, metres = scored.pixels, evaluate.metric_score(scored.frames)
notebook.say(f"{len(lanes)} frames, TuSimple **{pixels.tusimple:.3f}**, strict "
             f"{pixels.strict:.3f}, mean {pixels.mean_px:.2f} px; at 20 m "
             f"{100 * metres.lateral_m[2]:.1f} cm, offset "
             f"{100 * metres.offset_m:.1f} cm, width {100 * metres.width_m:.1f} cm.")

# %% [markdown]
# From paper to centimetres, with a camera of which we knew nothing. Your own drive has no truth; watch the overlay at
# half speed, the far end of the lines above all, and the read-out: on straight road offset and radius should be calm.
# `--view diagnostic` shows every stage when they are not.
#
# ## Zoom, crop, stabiliser
#
# A digital zoom takes the middle of the frame and enlarges it. Nothing in the picture says so. **Before you run it:**
# which of width, offset and dashes will be wrong with the old rig, after a zoom that keeps the middle 80 %?

# %%
rows = [["frame", "width, m", "offset, m", "nod found, °", "dashes, m"]]
for name, picture in (("as filmed", frame), ("zoomed", n08.zoomed(frame, 0.8))):
    seen = LaneFinder(mine, track=False).process(picture)
    period = dash_period(mine, [picture])
    nod = f"{np.rad2deg(seen.fit.mean[5]):+.2f}" if seen else "-"
    numbers = [f"{seen.width_m:.2f}", f"{seen.offset_m:+.2f}", nod] if seen else ["-"] * 3
    rows.append([name, *numbers, f"{period.period_m:.1f}" if period else "-"])
notebook.say(evaluate.table(rows))

# %% [markdown]
# The width hardly moves. A point of the road lies at $x = h\,(u - u_h)/(v - v_h)$, with the vanishing point $(u_h, v_h)$
# of notebook 03, and a zoom enlarges both differences alike. But $y = h\,f/(v - v_h)$: all lengths *along* the road
# shrink to 80 %, and with them curvature and look-ahead go wrong. The dashes give it away, if you know your road's:
# shrunk, these come close to another norm, 12.19 m. So does a "nod", because the horizon is not in the middle of the
# frame and moves, too.
# A stabiliser does the same, differently in every frame: switch it off.
#
# ### Exercise 3: the focal length after a zoom
#
# The middle `share` (0.8, say) of the frame is enlarged to the old size. What is the focal length in pixels then, if it
# was `focal_px`?

# %%
def zoomed_focal(focal_px, share):
    """Focal length of the zoomed frames, px."""
    # BEGIN SOLUTION
    return focal_px / share
    # END SOLUTION


exercises.check_zoomed_focal(zoomed_focal)

# %% [markdown]
# Another *resolution* of the same picture is no problem: rigs scale. Another *aspect ratio* means that the camera cut
# something off, and nobody knows where; that is refused:

# %%
print(LaneFinder(mine).process(np.zeros((480, 640, 3), np.uint8)).reason)

# %% [markdown]
# ## Live
#
# The same finder on a camera as it runs. `lanelib live 0 --rig my_rig.json --page` (0 is the first camera; an `rtsp://`
# address works, too) shows the result as a page for the browser, on this machine only. It always takes the newest frame
# and drops what it cannot keep up with: a late lane is a wrong one. Without a camera here, a clip plays its part:

# %% tags=["nbval-ignore-output"]
finder = LaneFinder(mine)
summary = live(folder / clip.path.name, lambda f, *_: draw.overlay(f, finder.process(f)),
               window=False, max_frames=25, on_status=print)
print(summary)

# %% [markdown]
# ## A set of your own
#
# Give your pictures the layout of the course and name the folder, and everything in this course takes them, `make`
# with its write-up and the notebooks' data sets included:
#
#     my_data/camera_cal/mycar/*.jpg        boards
#     my_data/test_images/mycar/*.jpg       road pictures
#     my_data/test_videos/mycar/*.mp4       drives
#     my_data/rigs/mycar.json               from `lanelib rig`
#
#     export LANELIB_DATA=my_data
#     lanelib course --sets mycar
#
# ## What you have learned
#
# - Four commands: `calibrate`, `rig`, `video`, `live`; each says what it could not use, and why.
# - Boards: many, tilted, all over the frame, on something flat.
# - The lane's width sets the scale, the dashes check the length, nod and heading near zero check the angles.
# - A calibration belongs to one zoom, one video mode, one place behind the windscreen.
#
# ## When it fails
#
# | what you see | what it often is | what to do |
# |---|---|---|
# | RMS above 1 px | a bent board, motion blur, autofocus | glue it on glass; more light; lock the focus |
# | standard deviations large | boards all alike, only in the middle | tilt more, fill the corners |
# | `rig` refuses | curves, one line only, worn paint | give a longer clip of a motorway |
# | lane found, width wrong | `--lane-width`, or a rig of another mounting | measure; make the rig anew |
# | steady "nod" or heading | the camera was moved | make the rig anew, it takes a minute |
# | good by day, nothing at night | exposure: paint and lamps burn out | lower exposure; no finder can bring back 255 |
# | lines doubled or soft at the top | dirt, the bonnet, reflections of the dashboard | clean; a black cloth on the dashboard |
# | portrait video, black borders | rotation or editing | film in landscape; give the original file |
# | very wide lens (fisheye) | five coefficients do not reach that far | choose a narrower mode |
#
# ## How production systems do it
#
# Cameras are calibrated one by one at the end of the line, in front of targets, in seconds. The mounting is then
# estimated on the road, as long as the car lives: vanishing point, lane width, the motion of the ground, as here in `lanelib rig`,
# but continuously, because a car is loaded, its tyres age, and windscreens are replaced. When the estimate wanders too
# far, the function switches itself off and says so.
#
# ## Further reading
#
# - Z. Zhang, *A flexible new technique for camera calibration* (2000): why a flat board in some poses is enough.
# - K. Strobl and G. Hirzinger, *More accurate pinhole camera calibration with imperfect planar target* (2011): boards
#   that are not flat; behind `--bent`.
# - R. Hartley and A. Zisserman, *Multiple View Geometry*, chapter 8: what vanishing points know.
# - J. Kannala and S. Brandt, *A generic camera model* (2006): where to go with a fisheye.
#
# ## Three questions
#
# 1. Why may the size of the squares (`--square`) be wrong without any harm to the lane finder?
# 2. After new tyres the reported lane width is 1 % too small. Which number of the rig has changed, and which way?
# 3. Your rig was made from one frame, in which the car drove 1° to the left. What will be wrong?

# %% [markdown] tags=["answer"]
# 1. It scales only the distance of the boards from the camera. Focal length, centre and distortion are ratios and
#    pixels, and the scale of the road comes from the lane's width.
# 2. The height: the camera sits 1 % higher than the rig believes, so the car sees the lane smaller than it is.
# 3. The yaw, by 1°: on straight road the lane will seem to lead 1° to one side, 35 cm over 20 m. A clip
#    would have averaged it out.
