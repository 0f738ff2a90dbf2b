"""Notebook 00: the whole pipeline on one frame and one clip; the map of the course. The format: README.md here."""
# %% [markdown]
# # 00 Find a lane in ten minutes
#
# A car drives at 100 km/h in the middle of its lane, one degree off its direction. How long until a wheel is on the
# line? Guess before you read on; by the end of this notebook you will compute it. It is about the time of a glance
# at a phone, and it is why a car that looks after its lane has to know, many times a second and to a few centimetres,
# where the two lines are.
#
# In this notebook one camera picture becomes these numbers, and then a whole drive does.
#
# **What you will do:** find the lane in a frame, in eight frames, and in a clip; compare each number with the truth;
# move a threshold yourself and watch why the simplest idea is not enough.
#
# **What you will learn:** what a lane is in numbers (offset, curvature, width), in which axes and with which signs; the
# five steps from pixels to metres; what "truth" is here, and why a radius can be 10 % off while the lane is right to
# centimetres.
#
# **What you need:** Python and school mathematics. No lane finding, no machine learning, no camera of your own.
#
# **Minutes:** 10 to read and run, 20 with the exercises.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start()

# %%
import numpy as np

from lanelib import LaneFinder, Rig, datasets, draw, exercises, explore, figures
from lanelib.channels import CHANNELS
from lanelib.evaluate import table
from lanelib.threshold import recipe_by_name

# %% [markdown]
# ## One picture
#
# A frame is an array of numbers. A look at its shape, type and range first saves an evening later.

# %%
frame, truth = notebook.road("test5.jpg")
print(f"shape {frame.shape}, {frame.dtype}, values {frame.min()} to {frame.max()}")

# %% [markdown]
# 720 rows, 1280 columns, and for each pixel blue, green and red in 8 bits, in this order: OpenCV's. Rows count
# downward from the top, columns to the right.
#
# **Before you run the next cell,** write down four guesses about what it will show: how wide is the lane, in metres? How
# far is the car from its centre, and on which side? To which side does the road bend?

# %% alt="A motorway of pale concrete seen from a car: a worn yellow line to the left, white dashes to the right, two cars ahead."
figures.show(frame)

# %% [markdown]
# Keep your guesses. A picture is not a measurement yet.
#
# ## The first idea, and how it fails
#
# Paint is bright, so let us take the bright pixels. Two numbers judge such a mask: *precision* is the share of the
# found pixels that are paint, *recall* the share of the paint that was found. First on dark asphalt, then on this road,
# which is concrete.

# %%
for name in ("test2.jpg", "test5.jpg"):
    picture, known = notebook.road(name)
    bright = CHANNELS["grey"](picture) > 170
    precision, recall = explore.paint_truth(known, (1280, 720)).score(bright)
    print(f"{name}: precision {precision:.3f}, recall {recall:.3f}")

# %% [markdown]
# On asphalt, not bad for half a line of code. On concrete nearly everything that was found is not paint. Here is what went
# wrong, in and near our lane, and beside it what this course will arrive at.

# %% alt="Two masks beside the frame. Brightness: most of the concrete is a false alarm. The course's recipe: the two lines are hit, hardly anything else."
paint = explore.paint_truth(truth, (1280, 720))
ours = recipe_by_name("paint").function(frame) != 0
masks = {"grey above 170": bright & paint.road, "this course's recipe": ours & paint.road}
figures.thresholds(frame, masks, paint=paint.paint)

# %% [markdown]
# Green is paint that was found, blue is paint that was missed, vermillion is something else that was taken for paint.
#
# Is 170 just a bad number? Try others, and other channels: the explorer has all that this course uses. **Before you move
# the slider:** is there a brightness at which both precision and recall are above 0.8?

# %% tags=["nbval-ignore-output"]
explore.threshold(frame, truth)

# %% alt="Precision and recall over the brightness threshold: precision stays low until recall has fallen."
levels = np.arange(100, 251)
scores = [paint.score(CHANNELS["grey"](frame) > level) for level in levels]
precision, recall = np.array(scores).T
figures.curves(levels, {"precision": precision, "recall": recall}, markers=False,
               xlabel="grey above", ylabel="share")

# %%
both = np.nanmax(np.minimum(precision, recall))
notebook.say("The best that one brightness can do here: "
             f"precision and recall both at **{both:.2f}**.")

# %% [markdown]
# So no: where the number is low enough to keep the paint, it keeps the concrete. What tells paint from concrete is not
# how bright it is but that it is *brighter than the road right beside it, over the width of a line*. Notebook 02 builds
# this idea up, and measures it against three classic recipes.
#
# ## The lane, in three lines of code
#
# A *rig* is a camera and how it is mounted: its lens, its height above the road and the angles at which it looks.
# With it, a `LaneFinder` turns a frame into a lane. Its *confidence*, from 0 to 1, says how much paint was seen and how
# well the lane fits it.

# %%
rig = Rig.load(datasets.get("rendered").rig_file)
finder = LaneFinder(rig, track=False)
result = finder.process(frame)
print(f"{result.status}, confidence {result.confidence:.2f}")

# %% alt="The frame with the lane in green between a red left and a blue right line, and a card with radius, offset and width."
figures.show(draw.overlay(frame, result), width=8)

# %% [markdown]
# ### What these numbers are
#
# Everything is measured on the road, in metres, from the point of the road straight below the camera: $x$ to the right,
# $y$ ahead. Each line is a parabola,
#
# $$x(y) = A\,y^2 + B\,y + C .$$
#
# From the two of them follow, at the car ($y = 0$):
#
# $$\text{offset} = -\frac{x_\text{left} + x_\text{right}}{2}, \qquad
# \kappa = \frac{-x''}{\left(1 + x'^2\right)^{3/2}}, \qquad R = \frac{1}{|\kappa|} .$$
#
# The **offset** is positive when the car is to the right of the lane's centre. The **curvature** $\kappa$, in 1/m, is
# positive when the road bends to the left; $R$ is its radius. ($x' = dx/dy$ is the slope of the line, $x''$ says
# how fast the slope changes; notebook 04 derives the formula.) These signs hold in the whole course.

# %%
lane = result.lane
for name, line in (("left", lane.left), ("right", lane.right)):
    a, b, c = line.coefficients[-3:]
    print(f"{name:5}  A {1e3 * a:.2f} /km,  B {1e2 * b:.1f} m per 100 m,  C {c:.2f} m")

# %% [markdown]
# ### Exercise 1: where is the car?
#
# At the car the left line is at `left_x_m`, the right one at `right_x_m`, both in metres in the axes above. Where is the
# car in its lane?

# %%
def offset_of(left_x_m, right_x_m):
    """Metres from the lane's centre, positive when the car is right of it."""
    # BEGIN SOLUTION
    return -(left_x_m + right_x_m) / 2
    # END SOLUTION


exercises.check_offset_of(offset_of)

# %% [markdown]
# ## What is true?
#
# In public data sets people drew the lines by hand, to a few pixels, and nobody knows the metres. The pictures that come
# with this course are *rendered*: light was followed through a scene whose road is a known curve, so `truth.json`
# says where each line really is, in pixels and in metres. The finder never sees that file.

# %%
bend, true_bend = 1e3 * result.curvature_1pm, 1e3 * truth["curvature_1pm"]
rows = [
    ["", "found", "true"],
    ["offset, m", f"{result.offset_m:+.2f}", f"{truth['offset_m']:+.2f}"],
    ["lane width, m", f"{result.width_m:.2f}", f"{truth['lane_width_m']:.2f}"],
    ["curvature, 1/km", f"{bend:+.2f}", f"{true_bend:+.2f}"],
    ["radius, m", f"{result.radius_m:.1f}", f"{truth['radius_m']:.1f}"],
]
notebook.say(table(rows))

# %% [markdown]
# How did your guesses do? Offset and width agree to about a centimetre. The radius looks worse. Is it? Look at where the
# lines are.

# %% alt="The two fitted lines from above with their uncertainty, and the true lines dashed: they lie on one another."
figures.fit(lane, truth_m=truth["lanes_road_m"], y_max_m=50)

# %%
at = np.array([10.0, 20.0, 30.0])
true = np.array([np.interp(at, *np.array(line).T[::-1]) for line in truth["lanes_road_m"]])
miss = np.abs(np.array([lane.left.x(at), lane.right.x(at)]) - true).max(axis=0)
notebook.say(", ".join(f"at {y:.0f} m: {100 * m:.1f} cm" for y, m in zip(at, miss, strict=True)))

# %% [markdown]
# So far the worse of the two lines misses by about a centimetre. How can the lines be right and the radius be off?
# This road *tightens*: the truth is its curvature at the car, and a parabola has a single one for all it sees. Fit a
# parabola to the true lines, from 5 to 50 m:

# %%
y = np.linspace(5, 50, 46)
centre = np.mean([np.interp(y, *np.array(line).T[::-1]) for line in truth["lanes_road_m"]], axis=0)
parabola = -2e3 * np.polyfit(y, centre, 2)[0]
notebook.say(f"True curvature at the car {true_bend:+.2f} /km, of a parabola through the true "
             f"lines **{parabola:+.2f} /km**, found **{bend:+.2f} /km**.")

# %% [markdown]
# The finder says how the road bends *over what it sees*. For steering that is the better number; against the truth at the
# car it looks 10 or 20 % off. A *factor* of 3 or 10 is another matter: that is a bug, look at the units.
#
# ### Exercise 2: how far does a bend lead aside?
#
# A road begins to bend with radius $R$ at the car. How far has it left the straight line after $y$ metres? The parabola
# with this curvature has $A = 1/(2R)$; the circle gives nearly the same.

# %%
def sideways_m(radius_m, distance_m):
    """Metres to the side after distance_m."""
    # BEGIN SOLUTION
    return distance_m**2 / (2 * radius_m)
    # END SOLUTION


exercises.check_sideways_m(sideways_m)

# %% [markdown]
# ## What happens in between
#
# Five steps lead from pixels to metres, and each has its notebook.

# %% alt="Six pictures: the frame, the undistorted frame, the mask of paint, the view from above, the fitted lines with distances in metres, and the lane on the frame."
stages = finder.stages(frame)
names = {"frame": "frame", "undistorted": "01 undistorted", "mask": "02 paint",
         "birdseye": "03 from above", "fit": "04 two lines", "lane": "the lane"}
figures.show({title: stages[name] for name, title in names.items()}, columns=3)

# %% [markdown]
# - **Undistort** (01). A lens bends straight edges; a calibration with chessboards says how, and takes it back.
# - **Threshold** (02). Paint is found by what makes it paint.
# - **Warp** (03). With the camera's height and pitch each pixel of the road has a place in metres.
# - **Detect** (04). Two lines, one lane apart, are fitted to what paint was found.
# - **Track** (05). The next frame begins where this one ended.
#
# `LaneFinder` takes a short cut through these steps which notebook 07 explains; the result is the same lane.
#
# ## Eight frames
#
# One frame proves little. Here are the eight that everyone in this field knows, by name at least: two straight ones, and
# bends over asphalt, concrete and shadows. **Before you run it:** on which one would you bet against the finder?
# The bar below a picture is green where a lane was measured, vermillion where there was none.

# %%
shown = ["straight_lines1.jpg", "straight_lines2.jpg", *(f"test{i}.jpg" for i in range(1, 7))]
roads = {name: notebook.road(name) for name in shown}
found = {name: finder.process(picture) for name, (picture, _) in roads.items()}

# %% alt="Eight road pictures with the lane in green between its lines; all lanes are found."
overlays = [draw.overlay(picture, found[name], text=False) for name, (picture, _) in roads.items()]
figures.contact_sheet(overlays, shown, columns=4, marks=[found[name].status for name in shown])

# %%
rows = [["frame", "offset, m", "true", "curvature, 1/km", "true"]]
for name, (_, known) in roads.items():
    one = found[name]
    numbers = one.offset_m, known["offset_m"], 1e3 * one.curvature_1pm, 1e3 * known["curvature_1pm"]
    rows.append([name, *(f"{value:+.2f}" for value in numbers)])
notebook.say(table(rows))

# %%
off = [found[name].offset_m - known["offset_m"] for name, (_, known) in roads.items()]
bend = [found[name].curvature_1pm - known["curvature_1pm"] for name, (_, known) in roads.items()]
notebook.say(f"Largest error of the offset: **{100 * np.abs(off).max():.2f} cm**; "
             f"of the curvature: **{1e3 * np.abs(bend).max():.3f} /km**.")

# %% [markdown]
# That is the easy set. Rain, night, worn paint and glare come in notebook 06, each with its error beside it.
#
# ## A drive
#
# In a video the finder may remember. `track=True`, the default, keeps one lane over time, smooths it, bridges frames in
# which nothing is to be seen, and says so.

# %%
clip = notebook.clip()
drive = LaneFinder(clip.rig)
frames = list(clip.frames(0, 100))
results = [drive.process(picture) for picture in frames]

# %% tags=["nbval-ignore-output"]
overlays = (draw.overlay(p, r) for p, r in zip(frames, results, strict=True))
notebook.play(overlays, alt="The drive with its lane.")

# %% alt="Eight moments of the drive, each with the lane in green between its lines."
moments = range(0, len(frames), 13)
pictures = [draw.overlay(frames[i], results[i], text=False) for i in moments]
labels = [f"{i / clip.fps:.1f} s" for i in moments]
figures.contact_sheet(pictures, labels, marks=[results[i].status for i in moments])

# %% [markdown]
# A number over time tells more than a video. Truth is dashed.

# %% alt="Curvature and offset over four seconds, each close to the dashed truth."
rows = [result.to_row(str(i)) | {"time_s": i / clip.fps} for i, result in enumerate(results)]
known = [frame | {"time_s": i / clip.fps} for i, frame in enumerate(clip.truth[: len(rows)])]
figures.over_time(rows, known)

# %%
pairs = [(r["offset_m"], t["offset_m"]) for r, t in zip(rows, known, strict=True) if r["lanes"]]
error_cm = 100 * np.abs(np.subtract(*np.array(pairs).T))
notebook.say(f"A lane in {len(pairs)} of {len(rows)} frames; the offset is off by "
             f"**{np.median(error_cm):.2f} cm** in the median, "
             f"by {error_cm.max():.2f} cm at worst.")

# %% [markdown]
# Two things to see. The offset follows the truth to a few centimetres, and smoothly: nothing in a car moves sideways in a
# jump. And the curvature: a frame tells that of the road *ahead*, you know why by now; yet here it is nearly the one at the car,
# because the finder remembers what it saw of this place a second ago (notebook 05).
#
# ## Bend a road yourself
#
# A small simulator makes a road to order and hands it to the finder. **Before you move "nod":** braking presses the
# car's nose down by half a degree, and the rig does not know. What happens to the width of the lane seen from above? And
# to the lane that the finder reports?

# %% tags=["nbval-ignore-output"]
explore.simulator(bend_1pkm=4, offset_m=0.4)

# %% alt="Left: a simulated road that bends to the left, its lane in green. Right: the road from above; the true lines lie on the ones that were found."
explore.simulator_look(bend_1pkm=4, offset_m=0.4)

# %% [markdown]
# Did you write your prediction down? On a straight road, where it is easiest to see, with the nose down by half a degree:

# %% alt="Left: a simulated straight road, its lane in green. Right: the road from above; its two lines are farther apart the farther away they are."
explore.simulator_look(bend_1pkm=0, offset_m=0, pitch_deg=0.5)

# %%
rows = [["nod (nose down is +), °", "nod found, °", "error at 20 m, cm"]]
for nod in (-0.5, 0.0, 0.5):
    seen = explore.simulator_look(bend_1pkm=4, offset_m=0.4, pitch_deg=nod).values
    rows.append([f"{nod:+.1f}", f"{seen['nod of the car']:+.2f}", f"{seen['error at 20 m']:.1f}"])
notebook.say(table(rows))

# %% [markdown]
# From above the lines open when the nose is down and close when it is up, because the metres are made for a car that
# does not nod. The finder notices: two lines that open are more likely a nod than a lane that widens. Notebook 03 shows
# what a nod does to the metres, notebook 04 how the fit finds it.
#
# ### Exercise 3: how long until a wheel is on the line?
#
# The question from the beginning. The wheel is `gap_m` from the line, the car points `angle_deg` away from the lane's
# direction and drives at `speed_kmh`. Mind the units: Python's sine wants radians, and a speed in km/h is 3.6 times
# the one in m/s.

# %%
def seconds_to_line(gap_m, angle_deg, speed_kmh):
    """Seconds until the gap is closed."""
    # BEGIN SOLUTION
    across_mps = np.sin(np.radians(angle_deg)) * speed_kmh / 3.6
    return gap_m / across_mps
    # END SOLUTION


exercises.check_seconds_to_line(seconds_to_line)

# %% [markdown] tags=["answer"]
# A lane of 3.7 m and a car of 1.9 m leave 0.9 m on each side. At one degree and 100 km/h the car moves 0.48 m a second
# to the side: a bit less than two seconds. At 25 frames a second that is 46 frames, and an offset that is wrong by
# 10 cm is a tenth of the whole room there is.

# %% [markdown]
# ## The map of the course
#
# | notebook | what you make | minutes with exercises |
# |---|---|---|
# | **00 Find a lane in ten minutes** | this one | 20 |
# | [01 Calibrate the camera](01_calibrate_the_camera.ipynb) | a calibration, compared with the true camera | 60 |
# | [02 Threshold](02_threshold.ipynb) | a mask of paint, with its precision and recall | 60 |
# | [03 Warp to a bird's-eye view](03_warp_to_a_birds_eye_view.ipynb) | metres from pixels, derived rather than believed | 70 |
# | [04 Detect the lane](04_detect_the_lane.ipynb) | two lines, curvature and offset, and how sure they are | 80 |
# | [05 Process video](05_process_video.ipynb) | a lane over time that forgets at the right moment | 60 |
# | [06 Measure how good it is](06_measure_how_good_it_is.ipynb) | an error budget in centimetres, and the failures | 50 |
# | [07 Make it real-time](07_make_it_real_time.ipynb) | the same lane, many times faster | 40 |
# | [08 Use your own camera](08_use_your_own_camera.ipynb) | your lane | 60 |
#
# Each runs alone, and in any order; 01 to 05 follow the pipeline. The exercises are open in the folder `learner` and
# solved one folder up.
#
# ## Three sets of data
#
# - **rendered** comes with the course: chessboards, pictures and clips with exact truth. All notebooks use it.
# - **udacity** is the set that most public lane finders were written for. `make data` fetches it; `make` then
#   runs the whole pipeline on it, too.
# - **Yours.** A folder with `camera_cal/NAME`, `test_images/NAME` and `test_videos/NAME`, named by the environment variable
#   `LANELIB_DATA`. Notebook 08 shows the way.

# %% [markdown]
# ## What you have learned
#
# - A lane is two curves on the road, in metres; offset, width and curvature follow from them.
# - Right of the centre is a positive offset, a bend to the left a positive curvature.
# - A threshold on brightness alone cannot tell paint from concrete.
# - Compare curvatures. Radii mislead: on nearly straight road they may be anything.
# - A number without its truth beside it is a claim.
#
# ## When it fails
#
# - **No paint, no lane.** The finder then says `none` and why; it does not guess. On a road whose lines are worn away or
#   under snow there is nothing for it to measure.
# - **A wrong rig.** Change the height of the camera by 10 % and every metre is wrong by 10 %, with nothing in the picture
#   to show it. Notebook 08 measures this.
# - **Hills.** The metres assume a flat road. On a crest far lines seem to close or to open.
#
# ## How production systems do it
#
# Cars on the road today find lane lines with a neural network that was shown millions of labelled pictures; it
# knows what a lane looks like where paint is missing. What comes after is what you see here: a calibrated camera, a
# road in metres, a model of a lane, a filter over time, checks, and a number for how far to trust it. That part is
# geometry, and it fails in the same ways.
#
# ## Further reading
#
# - J. McCall and M. Trivedi, *Video-based lane estimation and tracking for driver assistance* (2006): the survey that
#   sorts out which parts every lane finder has.
# - A. Bar Hillel et al., *Recent progress in road and lane detection: a survey* (2014): what was hard then is hard now.
# - E. Dickmanns and B. Mysliwetz, *Recursive 3-D road and relative ego-state recognition* (1992): a clothoid and a
#   Kalman filter at motorway speed, on the computers of the day.
# - R. Hartley and A. Zisserman, *Multiple View Geometry* (2004), chapters 2 and 8: planes, homographies, horizons.
#
# ## Three questions
#
# 1. The car moves half a metre to the right. What happens to $x_\text{left}$, $x_\text{right}$ and the offset?
# 2. A program reports a radius of 8,000 m on a straight road, and 8,000 m in a bend of 450 m. Which is the worse sign?
# 3. Why does the finder need the camera's height, when the picture shows the lane anyway?

# %% [markdown] tags=["answer"]
# 1. Both lines move 0.5 m to the left, so both $x$ become smaller by 0.5 m; the offset grows by 0.5 m.
# 2. The second. Compare curvatures: on the straight road it is off by 1/8 per km, which is next to nothing. In the bend
#    it is 1/8 per km where it should be 1/0.45, more than 2 per km: a bend that is found straight.
# 3. A picture has no scale: a lane half as wide under a camera half as high looks the same. The height gives the metres.
