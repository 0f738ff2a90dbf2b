"""Notebook 04; see README.md here for the format."""
# %% [markdown]
# # 04 Detect the lane
#
# A car at 90 km/h enters a bend of 450 m and is told that the radius is 8,000 m. It steers almost straight on and is
# over the line after little more than a second. The mask was perfect; the number was wrong. This notebook goes from
# the pixels of a mask to numbers in metres that one may steer by: the classic way first, each step shown where it
# goes wrong, then the model that this project uses, in which the two lines are *one* lane.
#
# **What you will do:** find lane pixels with a histogram, windows and a search around the last lane; fit lines; compute
# curvature, offset and width with their uncertainty; break every sanity check on purpose; fit one lane instead of two
# lines.
#
# **What you will learn:** what least squares assumes; where the formula of the radius of curvature comes from, and
# which units make it ten or five hundred times too large; why two independent fits fail on ordinary roads, and what a
# joint model gains.
#
# **What you need:** notebooks 02 and 03, or the words "mask" and "bird's-eye view in metres"; a little calculus and
# linear algebra.
#
# **Minutes:** 40 to read and run, 80 with the exercises.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start()

# %%
from dataclasses import replace

import numpy as np

from lanelib import datasets, draw, exercises, explore, figures, search, threshold, windows
from lanelib.figures import n04
from lanelib.finder import LaneFinder, Rig
from lanelib.hough import single_lines
from lanelib.hypotheses import hypotheses
from lanelib.jointfit import CENTRE, PITCH, WIDTH
from lanelib.lane import Lane, check_lane, fit_line
from lanelib.pictures import read_image
from lanelib.road import CarPose, Marking, Mounting, Road
from lanelib.simulator import Scene, render_road
from lanelib.verge import verge_rows

# %% [markdown]
# The frame of this notebook: a bend to the left, a solid yellow line, and on the right only a few dashes. Everything
# happens in the bird's-eye view of notebook 03, in metres: **x to the right, y ahead, the origin on the road straight
# below the camera.** The view is 12 m wide and reaches to 40 m.

# %% alt="The frame with a bend to the left, and the same road from above with metre rulers: a long yellow curve on the left, short dashes on the right."
shipped, name = datasets.get("rendered"), "test2.jpg"
rig, truth = Rig.load(shipped.rig_file), shipped.image_truth()
views = LaneFinder(rig)
view = views.view(rig.size_wh)
grid = view.metric.grid
frame = read_image(shipped.test_images / name)
road = view.metric.warp(rig.camera.undistort(frame))
figures.show({"frame": frame, "from above": draw.birdseye(road, grid)})


# %% [markdown]
# And its mask, by one of the classic recipes of notebook 02, seen from above. Two small helpers will serve throughout:
# the mask of any frame from above, and where a line *really* is at some distance.

# %%
def mask_above(frame, recipe="sobel-or-colour"):
    """The mask of a frame (H, W, 3) by that recipe, from above (720, 480) uint8."""
    at = views.view((frame.shape[1], frame.shape[0]))
    return at.metric.warp(threshold.recipe_by_name(recipe).function(at.rig.camera.undistort(frame)))


def true_x(entry, y_m):
    """x of the left and the right line at distance y_m, by the truth."""
    return [float(np.interp(y_m, *np.array(line).T[::-1])) for line in entry["lanes_road_m"]]


mask, here = mask_above(frame), truth[name]
true_lines = [np.array(line) for line in here["lanes_road_m"]]
notebook.say(f"The truth: radius of curvature {here['radius_m'] / 1000:.3f} km to the left, "
             f"the car {here['offset_m']:.2f} m right of the lane's centre, "
             f"lane {here['lane_width_m']:.2f} m wide.")

# %% [markdown]
# ## A visible failure first
#
# A mask is a picture; a line is three numbers. The obvious way from one to the other: all white pixels left of the
# middle are the left line, all others the right one; `np.polyfit` does the rest. **Before you run it:** the mask looks
# good to you. Which of the two lines will be worse, and why?

# %% alt="The mask's pixels from above with two fitted parabolas: both bend far more than the dashed true lines, the right one is pulled towards the neighbouring lane's dashes."
v, u = np.nonzero(mask)
x, y = grid.x_of(u), grid.y_m[v]
plain = {side: fit_line(x[on], y[on], robust=False)
         for side, on in (("left", x < 0), ("right", x >= 0))}
figures.fit(Lane(plain["left"], plain["right"]), points_m={"other": np.column_stack([x, y])},
            truth_m=true_lines, y_max_m=40)

# %%
said = [f"The {side} line: radius {line.radius_m() / 1000:.3f} km." for side, line in plain.items()]
notebook.say(" ".join(said) + f" The truth is {here['radius_m'] / 1000:.3f} km for both.")

# %% [markdown]
# Both are useless. Least squares gives every white pixel a vote. How many of them have any business voting?

# %%
on_line = [np.abs(x - np.interp(y, *line.T[::-1])) < 0.25 for line in true_lines]
left, right = on_line[0][x < 0].mean(), on_line[1][x >= 0].mean()
notebook.say(f"Of the white pixels on the left {left:.2f} lie within 25 cm of the true line, "
             f"on the right {right:.2f}.")

# %% [markdown]
# The others are the road's edge, grain of the asphalt, the dashes of the *next* lane. On the right they win by number; on
# the left a minority is enough, because it lies far from the line. So two questions come before any fit: **which pixels
# belong to which line**, and **what to do with those that do not belong to any**.
#
# ## Which pixels? The histogram
#
# Close to the car a line is nearly upright from above. Add up each column of the lower half: paint makes a peak, grain
# makes a floor. The highest peak left and right of the car's own column says where to begin.

# %% alt="The mask from above, and below it the number of white pixels per column of the lower half: a high peak for the left line, two lower ones for the right line, of which the one farther left is marked."
figures.column_histogram(mask, centre=float(grid.column_of(0)))

# %%
start = search.find_peaks(search.histogram(mask), centre=float(grid.column_of(0)))
near = true_x(here, 6)
begin = grid.x_of(np.array(start))
notebook.say(f"The histogram begins at x = {begin[0]:+.2f} m and {begin[1]:+.2f} m. At 6 m the "
             f"lines really are at {near[0]:+.2f} m and {near[1]:+.2f} m: the right one is missed "
             f"by **{abs(begin[1] - near[1]):.2f} m**. At 20 m it is at "
             f"{true_x(here, 20)[1]:+.2f} m.")

# %% [markdown]
# On the left the peak is sharp. On the right two dashes stand in different columns, because the road bends between them,
# and the far one, 20 m ahead, wins: the warp smears it. That is the histogram's weakness: it adds up over 20 m what only
# near the car is upright. Here it is near enough, because the windows that follow are wider.

# %% [markdown]
# ### Exercise 1: where to begin
#
# Write the search for the two peaks yourself: given a column histogram and the column `centre` between left and right,
# return the columns of the highest value on each side.

# %%
def start_columns(column_sums, centre):
    """(left, right): columns of the highest sum left of `centre` and from `centre` on."""
    # BEGIN SOLUTION
    return int(np.argmax(column_sums[:centre])), centre + int(np.argmax(column_sums[centre:]))
    # END SOLUTION


exercises.check_start_columns(start_columns)

# %% [markdown]
# ## Sliding windows
#
# From the peak upwards: a window as high as a ninth of the view and 0.6 m to both sides. If it holds enough pixels, the
# next window is centred on their mean; if not, it stays in the same column and waits for the next dash.

# %% alt="The mask from above with a stack of windows on each line: on the left they follow the solid line, on the right they wander between dashes and lose the line far ahead."
car_column = float(grid.column_of(0))
found = search.sliding_windows(mask, n_windows=9, margin_px=0.6 / grid.column_m, centre=car_column)
figures.show({"mask": mask, "windows": draw.draw_windows(mask, found)}, width=8)

# %% [markdown]
# On the left the windows follow the line. On the right look at the top: faint windows held too few pixels and stayed
# where they were while the road bent away, and the far dash is outside. Nothing in this method knows that the lines are
# parallel.
#
# Every number here has a reason, and one can measure it. The **margin**: too narrow, and a bend leaves the window
# between two dashes; too wide, and everything beside the line joins in. Let us fit the lines on all eight frames for
# several margins and look at the error 20 m ahead.

# %% alt="Curves of the lateral error at 20 m over the window margin, mean and worst line: high at 0.15 m, low from 0.3 to 0.8 m, growing again for wide windows."
masks = {n: mask_above(read_image(shipped.test_images / n)) for n in list(truth)[:8]}
margins_m = (0.15, 0.3, 0.45, 0.6, 0.8, 1.1, 1.5)
errors = np.full((len(margins_m), len(masks), 2), np.nan)
for i, margin_m in enumerate(margins_m):
    for j, (n, m) in enumerate(masks.items()):
        pixels = search.sliding_windows(m, margin_px=margin_m / grid.column_m, centre=car_column)
        for k, line in enumerate(windows.fit_lines(pixels, grid)):
            errors[i, j, k] = abs(line.x(20) - true_x(truth[n], 20)[k]) if line else np.nan
in_cm = {"mean": 100 * np.nanmean(errors, (1, 2)), "worst line": 100 * np.nanmax(errors, (1, 2))}
figures.curves(margins_m, in_cm, xlabel="margin, m", ylabel="error at 20 m, cm", logy=True)

# %%
notebook.say("Mean error at 20 m: " + ", ".join(f"{100 * e:.1f} cm with {m:g} m"
             for m, e in zip(margins_m, np.nanmean(errors, (1, 2)), strict=True)) + ".")

# %% [markdown]
# Any margin from 0.3 to 0.8 m does here; the package takes 0.6 m. Its lower limit is geometry: 30 m ahead on a bend of
# radius $R$ the line runs at a slope of $30 / R$, and from one window to the next (4 m) it moves by $120 / R$ metres:
# 0.27 m at 450 m, but 0.8 m at 150 m, and then a gap between dashes is the end of the chain.
#
# ### Try it
#
# Move the margin and the number of windows; ask for so many pixels that a dash no longer recentres a window; change
# the recipe. Then choose the joint fit as the model, which is where this notebook ends.

# %% tags=["nbval-ignore-output"]
explore.detect(frame, rig, here)

# %% alt="Four panels of windows on the mask: 3, 9 and 18 windows, and 9 windows with a margin of 1.5 m that take in pixels of other things."
settings = {"3 windows": (3, 0.6), "9 windows": (9, 0.6), "18 windows": (18, 0.6),
            "9, margin 1.5 m": (9, 1.5)}
seen = {title: search.sliding_windows(mask, n_windows=n, margin_px=margin_m / grid.column_m)
        for title, (n, margin_m) in settings.items()}
figures.show({title: draw.draw_windows(mask, pixels) for title, pixels in seen.items()},
             columns=4, width=8.5)

# %%
far = {title: grid.y_m[pixels.right_xy[:, 1].astype(int)].max() for title, pixels in seen.items()}
notebook.say("The right line is followed to "
             + ", ".join(f"{y:.1f} m ({title})" for title, y in far.items()) + ".")

# %% [markdown]
# With three windows even the solid line leaves its window. With eighteen the far dash of the right line is missed as with
# nine: lower windows do not make the gap before it shorter. A margin of 1.5 m finds it, and on another frame a barrier
# with it. No setting is right for all roads; about one dash a window is the usual choice.
#
# ## Search around the last lane
#
# In a video the lane is known from the last frame. Then all pixels within 0.6 m of the old line belong to the new one:
# quicker, and it follows a bend at once instead of step by step.

# %% alt="Left: pixels found in bands around the true lines. Right: the same search with a last lane that was one lane too far to the right: its left band holds the dashes of the right line, its right band those of the next lane."
last = [fit_line(*line.T) for line in true_lines]
wrong = [replace(line, coefficients=line.coefficients + (0, 0, 3.66)) for line in last]
around = {}
for title, lines in (("last lane correct", last), ("last lane one too far to the right", wrong)):
    in_pixels = [windows.pixel_coefficients(line, grid) for line in lines]
    around[title] = search.search_around(mask, *in_pixels, margin_px=0.6 / grid.column_m)
figures.show({title: draw.draw_windows(mask, pixels) for title, pixels in around.items()}, width=8)

# %% [markdown]
# On the left it even has the far dash that the windows missed. The price is on the right: with a last lane that was wrong
# (here: the next one), the search finds what lies there and *confirms* it, frame after frame. Such a search needs
# somebody who doubts it: the sanity checks below, and the tracker of notebook 05.
#
# ## Least squares, and why it is not enough
#
# A line is $x = A y^2 + B y + C$. For points $(x_i, y_i)$ the residuals are $r_i = x_i - (A y_i^2 + B y_i + C)$.
# Least squares makes $\sum r_i^2$ smallest. With the matrix $J$ of rows $(y_i^2, y_i, 1)$ and $p = (A, B, C)^T$:
#
# $$\frac{\partial}{\partial p} \lVert x - Jp \rVert^2 = -2 J^T (x - Jp) = 0 \quad\Rightarrow\quad J^T J\, p = J^T x .$$
#
# The solution of these *normal equations* is the best one when errors are independent and Gaussian. A reflector two
# metres beside the line is neither, and it counts with its square: one pixel 2 m off costs as much as 400 pixels 10 cm
# off. A **robust** fit gives a point with a large residual a small weight and repeats. Tukey's biweight gives it none
# at all:
#
# $$w(r) = \left(1 - (r / c)^2\right)^2 \text{ for } |r| < c, \text{ else } 0; \qquad c = 4.685\, s .$$
#
# $s$ is the spread of the residuals, from their median, which a third of outliers hardly moves; $c = 4.685\,s$ keeps 95 %
# of the efficiency of least squares where there are no outliers. Let us try both on the left line, with a third of
# false points: a barrier beside it. **What do you expect of each?**

# %% alt="Points of the left line and a cloud of false points beside it; the plain fit runs between them, the robust fit lies on the line and on the dashed truth."
line_x, line_y = grid.x_of(found.left_xy[::12, 0]), grid.y_m[found.left_xy[::12, 1].astype(int)]
rng = np.random.default_rng(4)
far = rng.uniform(20, 40, len(line_x) // 2)
false_x = np.interp(far, *true_lines[0].T[::-1]) + rng.normal(1.3, 0.15, len(far))
all_x, all_y = np.concatenate([line_x, false_x]), np.concatenate([line_y, far])
fits = {"plain": fit_line(all_x, all_y, robust=False), "robust": fit_line(all_x, all_y)}
figures.fit(points_m={"other": np.column_stack([all_x, all_y])}, lines=fits,
            truth_m=true_lines[:1], y_max_m=40)

# %%
notebook.say("Error 30 m ahead: " + ", ".join(
    f"{title} {line.x(30) - true_x(here, 30)[0]:+.2f} m" for title, line in fits.items()) + ".")

# %% [markdown]
# The robust fit has a limit, too: beyond half of false points the barrier *is* the line, as far as the numbers can
# tell. And it needs a good start; `fit_line` tries forty parabolas through three random points each and begins with the
# one that most points agree with.

# %% [markdown]
# ### Exercise 2: from pixels to metres
#
# Many programs fit in pixels, $u = a v^2 + b v + c$ with $u$ the column and $v$ the row. With $x = x_0 + s_x u$ and
# $y = y_0 - s_y v$ ($s_x$, $s_y$ metres a column and a row), insert one into the other and compare the terms with $y^2$:
# what is $A$, the bend in metres, in terms of $a$?

# %%
def bend_in_metres(a, sx, sy):
    """A in 1/m, from a of u = a v² + b v + c in pixels; sx, sy: metres a column, a row."""
    # BEGIN SOLUTION
    return a * sx / sy**2
    # END SOLUTION


exercises.check_bend_in_metres(bend_in_metres)

# %% [markdown]
# ## Curvature, in metres, at the car
#
# **Curvature is how fast the direction turns per metre of way.** The line's direction has the angle
# $\theta = \arctan x'$ to the y axis, where $x' = dx/dy = 2 A y + B$, and the way along it is
# $ds = \sqrt{1 + x'^2}\,dy$. So
#
# $$\frac{d\theta}{ds} = \frac{d\theta / dy}{ds / dy} = \frac{x'' / (1 + x'^2)}{\sqrt{1 + x'^2}}
#   = \frac{x''}{(1 + x'^2)^{3/2}}, \qquad x'' = 2A .$$
#
# $x'' > 0$ turns to the right. This project counts **curvature positive to the left** (as navigation and control do
# with $y$ to the left), so $\kappa = -x'' / (1 + x'^2)^{3/2}$, and the radius of curvature is $1 / |\kappa|$. At the car
# means at $y = 0$: the place of the camera, some metres *nearer* than the lowest row of the picture shows.
#
# Now the promise of the first paragraph. Here are the two lines of this frame, fitted robustly to the windows' pixels,
# and five ways to make one radius of them. All five are found in published programs. **Which is right?**

# %%
left, right = windows.fit_lines(found, grid)
bends = np.array([windows.pixel_coefficients(line, grid)[0] for line in (left, right)])
radii_m = {
    "everything in pixels": np.mean(1 / abs(2 * bends)),
    "x in metres, y left in pixels": np.mean(1 / abs(2 * bends * grid.column_m)),
    "metres, at the far end": np.mean([1 / abs(line.curvature_1pm(40)) for line in (left, right)]),
    "metres, mean of two radii": (left.radius_m() + right.radius_m()) / 2,
    "metres, mean of two curvatures": Lane(left, right).radius_m,
}

# %% alt="Bars of the radius by five ways: in pixels several kilometres or more, x in metres and y in pixels over a hundred kilometres, and 0.5 to 0.7 km for the ways in metres; the truth is 0.45 km."
radii_m["truth"] = here["radius_m"]
figures.bars({way: radius / 1000 for way, radius in radii_m.items()},
             unit="radius of curvature, km", highlight="truth", log=True)

# %% [markdown]
# Expected: about 0.45 km. Values of several km, or of a hundred, mean mixed units: 8,000 m on such a bend is a bug, not
# an inaccuracy. The ways in metres are of the right size; what they lack is a better right line, not other units (the legend
# of the next figure gives the radius of each line). Yet averaging radii is a trap, as soon as one line is nearly
# straight: curvatures of 1 and 0.06 per km (a bend of 1 km, one line badly seen) have the mean 0.53 per km, which is a
# radius of 1.9 km, and bad enough. Their radii are 1 km and 16.7 km, with the mean **8.8 km**. A straight road has no
# radius at all, but it has a curvature: 0. So: average curvatures, never radii.
#
# What does that cost? A car that steers for curvature $\kappa_1$ where the road has $\kappa$ leaves its line by
# $\Delta x = \frac{1}{2} (\kappa - \kappa_1) v^2 t^2$.

# %%
speed_mps, room_m, true_m = 25.0, 0.9, here["radius_m"]  # room: half a lane less half a car
for told_m in (8000.0, 600.0, 480.0):
    seconds = np.sqrt(2 * room_m / abs(1 / true_m - 1 / told_m)) / speed_mps
    print(f"told {told_m / 1000:.2f} km, is {true_m / 1000:.2f} km: "
          f"on the line after {seconds:.2f} s")

# %% [markdown]
# ### Exercise 3: the lane's curvature
#
# From the coefficients (A, B, C) of both lines in metres: the lane's signed curvature at the car, in 1/m, positive to
# the left. The third case of the checker has a car that stands across the lane, so keep the slope.

# %%
def curvature_of_lane(left_abc, right_abc):
    """Signed curvature at y = 0, 1/m, positive to the left; the mean of both lines."""
    # BEGIN SOLUTION
    bends = [-2 * a / (1 + b**2) ** 1.5 for a, b, _ in (left_abc, right_abc)]
    return sum(bends) / 2
    # END SOLUTION


exercises.check_curvature_of_lane(curvature_of_lane)

# %% [markdown]
# ## Offset and width
#
# At $y = 0$ the lines are at $x_l = C_l$ and $x_r = C_r$; the car is at $x = 0$. The lane's centre is at their mean, so
# the car is **$-(x_l + x_r)/2$ to the right of the centre**. The sign is a convention, so it is written down once (here:
# right is positive) and tested. The width is measured *across* the lane: along x it would be too large by
# $\sqrt{1 + x'^2}$ where the lane leads away obliquely.

# %%
lane = Lane(left, right)
notebook.say(f"Offset {lane.offset_m:+.2f} m (truth {here['offset_m']:+.2f} m), "
             f"width {lane.width_m():.2f} m (truth {here['lane_width_m']:.2f} m), "
             f"curvature {1000 * lane.curvature_1pm:+.2f} per km "
             f"(truth {1000 * here['curvature_1pm']:+.2f} per km).")

# %% [markdown]
# ### Exercise 4: offset and width
#
# From (A, B, C) of both lines: the offset of the car and the width across the lane, both at the car.

# %%
def offset_and_width(left_abc, right_abc):
    """(offset, width) in metres; the offset is positive right of the lane's centre."""
    # BEGIN SOLUTION
    slope = (left_abc[1] + right_abc[1]) / 2
    return -(left_abc[2] + right_abc[2]) / 2, (right_abc[2] - left_abc[2]) / (1 + slope**2) ** 0.5
    # END SOLUTION


exercises.check_offset_and_width(offset_and_width)

# %% [markdown]
# ## How sure? The uncertainty
#
# If the points scatter by $\sigma$, the numbers $p$ scatter with the covariance $\Sigma = \sigma^2 (J^T J)^{-1}$: it
# follows from $p = (J^T J)^{-1} J^T x$, which is linear in $x$. At a distance $y$ the line has the standard deviation
# $\sqrt{q^T \Sigma\, q}$ with $q = (y^2, y, 1)$: small where there are points, growing fast where there are none.

# %% alt="Both fitted lines with bands of two standard deviations: the left line's band is invisible, the right line's band opens like a trumpet beyond the last dash, and the dashed truth leaves it."
points = {side: np.column_stack([grid.x_of(xy[:, 0]), grid.y_m[xy[:, 1].astype(int)]])
          for side, xy in (("left", found.left_xy), ("right", found.right_xy))}
figures.fit(lane, points_m=points, truth_m=true_lines, y_max_m=40)

# %% [markdown]
# The left band is thinner than the line drawn, although its radius is not quite right; more of that below. The right one
# opens beyond the last dash that was found: a bend known from two dashes is hardly known. For $N$ points spread evenly over a length $L$ one can work it out:
#
# $$\sigma_\kappa = 2\,\sigma_A \approx \frac{2\sqrt{180}\;\sigma}{L^2 \sqrt{N}} \approx \frac{27\,\sigma}{L^2\sqrt{N}} .$$
#
# **Length beats everything**: half the length is a quarter of the accuracy; to make up for it takes sixteen times the
# points. With $\sigma$ = 5 cm, $N$ = 10 independent points and $L$ = 30 m it is 0.5 per km: a bend of 1 km cannot be told
# from 0.7 km or from 2 km in one frame, and "8 km" and "straight" are the same thing. That is why a radius comes with a
# standard deviation, and why this project says *straight* when the curvature is less than its own.
#
# But what is $N$? A line has thousands of pixels. The formula wants *independent* errors, and the pixels of one dash
# share theirs: the same smear, the same worn edge. Let us test it: the same road, twelve times, with other noise.
# First a simulated road for the camera of this course.

# %%
small = rig.scaled((640, 360))
lens = {"camera_matrix": tuple(map(tuple, small.camera.camera_matrix)),
        "distortion": tuple(small.camera.distortion)}
base = Scene(**lens, mounting=Mounting(**small.mounting), others=())


def drive(radius_m=np.inf, **changes):
    """A simulated frame (360, 640, 3) on a road of that radius (positive: left), and its truth."""
    return render_road(replace(base, road=Road([0, 400], [1 / radius_m] * 2), **changes))


# %%
def two_lines(frame, recipe="paint"):
    """The classic measurement: the left and the right line, each on its own."""
    return windows.fit_lines(windows.find_pixels(mask_above(frame, recipe), grid), grid)


runs = [two_lines(drive(500.0, pose=CarPose(50.0, 0.1), seed=7 * i)[0]) for i in range(12)]
for side, lines in zip(("left, solid", "right, dashed"), zip(*runs, strict=True), strict=True):
    bends = [1000 * line.curvature_1pm() for line in lines]
    said = [2000 * line.covariance[0, 0] ** 0.5 for line in lines]
    print(f"{side}: curvature {np.mean(bends):.2f} per km (truth 2.00), "
          f"scatter {np.std(bends):.2f}, said {np.mean(said):.2f}")

# %% [markdown]
# The solid line keeps its word. The dashed one does not: it scatters several times more than it says, and it is not even
# right on average. Two dashes are two measurements, however many pixels they have, and a parabola needs three. Remember
# this line; it is the reason for the second half of this notebook.

# %% [markdown]
# ## The estimate against truth
#
# Eight shipped frames, the same way, with the "paint" recipe of notebook 02.

# %%
print("frame              curvature (truth), 1/km   offset (truth), m   worse line at 30 m")
for n in masks:
    pair, entry = two_lines(read_image(shipped.test_images / n)), truth[n]
    this, true_30 = Lane(*pair), true_x(entry, 30)
    off = max(abs(line.x(30) - x) for line, x in zip(pair, true_30, strict=True))
    print(f"{n:19}{1000 * this.curvature_1pm:+9.2f}  ({1000 * entry['curvature_1pm']:+.2f})"
          f"{this.offset_m:+14.2f}  ({entry['offset_m']:+.2f}){100 * off:13.1f} cm")

# %% [markdown]
# Offsets are right to a centimetre or two, and lines 30 m ahead mostly to one: on clean frames the classic way is good.
# But on most bends the curvature is too large, by up to a fifth. Noise would err in both directions. Let us fit a
# parabola to the *truth* itself, over the same 40 m.

# %%
for n in ("test1.jpg", "test2.jpg", "test6.jpg"):
    exact = np.array(truth[n]["lanes_road_m"][0])
    seen = (exact[:, 1] > 4) & (exact[:, 1] < 40)
    bend = fit_line(exact[seen, 0], exact[seen, 1], robust=False).curvature_1pm()
    print(f"{n}: parabola through the true line {1000 * bend:+.2f} per km, truth at the car "
          f"{1000 * truth[n]['curvature_1pm']:+.2f} per km")

# %% [markdown]
# The parabola is wrong, not the pixels. Roads are *clothoids*: their curvature changes evenly along the way, here it
# grows, and a parabola of 40 m gives the mean of what comes, not what is at the car. No amount of better paint cures
# that; a third-order term can (`rate` in the joint model below), where there are frames enough to know it. This is how
# one finds out what an error is made of: replace one step by the truth and look at what stays. Notebook 06 does it with
# every step.

# %% [markdown]
# ## Sanity checks
#
# Some answers cannot be a lane, whatever the pixels say. Six checks, each with a frame that is built to break it.
# Building frames is easy with a simulator: paint only the far line of the next lane, paint a bicycle path, tilt the
# camera by 1.5 degrees, stitch halves of two roads together. **Predict for each frame which check it fails.**

# %%
solid = {"right": Marking(1.83, "white"), "others": ()}


def stitched(one, other):
    """The left half of one frame and the right half of another."""
    return np.hstack([one[:, :320], other[:, 320:]])


straight = drive(**solid)[0]
nodding = replace(base.mounting, pitch_deg=base.mounting.pitch_deg + 1.5)
broken = {
    "a good lane": drive(400.0, **solid)[0],
    "the next lane's line": drive(right=None, others=(Marking(5.49),))[0],
    "a bicycle path": drive(left=Marking(-1.0, "yellow"), right=Marking(1.0))[0],
}

# %%
broken |= {
    "the nose 1.5° down": drive(**solid, mounting=nodding)[0],
    "R 110 m + straight": stitched(drive(-110.0, **solid)[0], straight),
    "straight + R 40 m": stitched(straight, drive(40.0, **solid)[0]),
    "a hairpin, R 13 m": drive(13.0, **solid)[0],
    "0.7 m off the last lane": drive(**solid, pose=CarPose(0.0, 0.7))[0],
}
before = Lane(*two_lines(straight))
outcome = {what: check_lane(Lane(*two_lines(picture)), before if "last" in what else None)
           for what, picture in broken.items()}

# %% alt="Eight simulated frames: a good lane, one with the right line missing, a narrow path, a frame with the nose down, two stitched from different bends, a hairpin and a shifted one."
figures.show(broken, columns=4, width=8.5)

# %% alt="A table of eight frames by six checks with the value found; failures are marked: width for the next lane's line and the path, parallel for the nose down, several for the stitched frames and the hairpin, no jump for the last."
n04.checks(outcome)

# %% [markdown]
# - **order**: the left line stays left of the right one. Crossing lines are the surest sign of a wrong fit.
# - **width**: 2.6 to 4.6 m, from narrow town lanes to wide ramps. Two lanes taken for one fail here, a path, too.
# - **parallel**: the width changes by less than 0.6 m in 20 m, or as far as the lines are seen. Look at the row "nose down": *both lines are right*, and
#   only the tilt of the camera makes them diverge. A check that throws a good frame away is half a cure; remember it.
# - **same bend**: both lines say of the lane's *centre* the same curvature, to 0.004 1/m. (Parallel lines bend differently:
#   in a hairpin of R 27 m the inner one has R 25 m, the outer one 29 m.) That is much: R 250 m and straight still pass.
#   Two dashes cannot do better.
# - **radius**: no car drives a bend below 15 m at speed.
# - **no jump**: within one frame of 40 ms no line moves by half a metre; 1.5 m/s sideways is 6 cm a frame.
#
# A failed check says *no lane in this frame*, with the reason; what a video does then is notebook 05.
#
# ## Why two independent fits fail
#
# Back to the dashed line that could not keep its word. A bend of 400 m to the left, the left line solid, the right one
# dashed: an ordinary road.

# %% alt="A simulated bend to the left from above, two panels: fitted separately the right line starts half a metre too far right at the car; fitted as one lane both lines lie on the dashed truth."
ordinary = {"pose": CarPose(50.0, 0.1), "right": Marking(1.83, "white", gap_m=10.97, phase_m=3.0)}
picture, exact = drive(400.0, **ordinary)
separate = Lane(*two_lines(picture))
finder = LaneFinder(small, track=False)
joint = finder.process(picture).lane
above = finder.view((640, 360)).metric.warp(small.camera.undistort(picture))
n04.above(above, grid, {"two lines": separate, "one lane": joint}, truth_m=exact["lanes_road_m"])

# %%
for what, this in (("two lines", separate), ("one lane", joint)):
    print(f"{what}: radius {this.radius_m / 1000:.2f} km, offset {this.offset_m:+.2f} m, "
          f"{this.width_m():.2f} m wide")
print(f"truth: radius {exact['radius_m'] / 1000:.2f} km, offset {exact['offset_m']:+.2f} m, "
      f"{exact['lane_width_m']:.2f} m wide")
failed = [check.name for check in check_lane(separate) if not check.ok]
print("checks that the two lines fail:", failed or "none")

# %% [markdown]
# On the right two dashes were found, the nearer one more than 10 m ahead. The parabola passes both within centimetres; but
# those centimetres, the smear of two dashes, decide on three numbers, and where there is no paint the line goes where it
# likes: half a metre too far right at the car, and nearly straight. And every check passes: width, bend
# and parallelism are within their limits.
#
# But we know more than the fit does. **The two lines of a lane have the same heading and the same bend, and are a width
# apart.** Written down, with the lane's centre $c$, its width $w$, heading $h$ and bend $A$:
#
# $$x_{l} = c - \tfrac{w}{2} + h\,y + A\,y^2, \qquad x_{r} = c + \tfrac{w}{2} + h\,y + A\,y^2 .$$
#
# Four numbers instead of six, and all points of both lines speak for $h$ and $A$: the solid line tells the bend, and
# one dash on the other side is enough to tell the width. It is still one linear least-squares problem: for the unknowns
# $(c, h, A, w)$ a row $(1, y, y^2, -\tfrac12)$ for each left point and $(1, y, y^2, +\tfrac12)$ for each right one.

# %% [markdown]
# ### Exercise 5: one lane by least squares
#
# Stack the rows of both lines into one matrix and solve it with `np.linalg.lstsq`. In the checker's second case the right
# line has three points, a single dash.

# %%
def fit_shared(left_xy, right_xy):
    """(centre, heading, bend, width) from points (N, 2) and (M, 2), columns x and y in metres."""
    # BEGIN SOLUTION
    rows = [np.column_stack([np.ones(len(xy)), xy[:, 1], xy[:, 1] ** 2, np.full(len(xy), side / 2)])
            for side, xy in ((-1, left_xy), (1, right_xy))]
    x = np.concatenate([left_xy[:, 0], right_xy[:, 0]])
    return np.linalg.lstsq(np.vstack(rows), x, rcond=None)[0]
    # END SOLUTION


exercises.check_fit_shared(fit_shared)

# %% [markdown]
# ## What the joint model of lanelib adds
#
# `lanelib.jointfit` is this idea, and four more. Each answers a failure that you have seen above.
#
# **1. Parallel curves.** The width is measured across the lane, so a line is $x = x_c \mp \frac{w}{2}\sqrt{1 + x_c'^2}$.
#
# **2. Clothoids.** A third-order term $D y^3$, the `rate` at which the bend changes. Free, it would be a wild thing, so it
# is held by what road builders allow: a bend does not tighten faster than a driver can turn the wheel. One frame hardly
# determines it, so the curvature *at the car* stays as uncertain as it was, but now it says so (below).
#
# **3. Lines that come out not parallel are pitch, not a wider lane.** When the nose dips by $\delta$ a point seen at
# $y_0$ on the rig's plane is really at $y$ with $1/y = 1/y_0 + \delta / h$, at the same bearing $x / y$. Pitch enters
# as one more number; the frame "nose 1.5° down" is no failure any more. (A seventh, `hill`, is the road's own bend up or
# down.)
#
# **4. Errors where they arise.** The middle of a stripe is located to a pixel of the *frame*, near or far; 30 m ahead that is
# many times as many centimetres as at 5 m. So residuals are bearings $x/y$, in pixels, robustly weighted as before.
#
# Seven numbers, nonlinear: Gauss-Newton solves the linear problem around the present guess, again and again. What the
# data cannot tell is held by a **prior**, a row for each number saying "roads are usually so": $w = 3.65 \pm 0.35$ m,
# pitch $0 \pm 0.7°$, and so on. On the nodding frame:

# %%
nod = finder.process(broken["the nose 1.5° down"])
two = two_lines(broken["the nose 1.5° down"])
near, far = (two[1].x(y) - two[0].x(y) for y in (0.0, 20.0))
nose_deg = np.degrees(nod.fit.mean[PITCH])
notebook.say(f"Two lines: {near:.2f} m apart at the car, {far:.2f} m at 20 m. "
             f"One lane: {nod.width_m:.2f} m wide, and the nose {nose_deg:.2f}° down.")

# %% [markdown]
# ## Where to begin: votes instead of windows
#
# Gauss-Newton needs a start near the lane. Windows followed one line upwards and got lost; instead, every paint point
# *votes* for all single lines that pass through it, over bend, bearing and x at the car (a Hough transform). A true line
# gets votes along its whole length, dashes included; grain scatters its votes.

# %% alt="Left: paint points of the frame from above with the strongest lines through them. Right: the table of votes over x at the car and bend, with bright spots at the marked lines."
whole = LaneFinder(rig, track=False)
paint, _ = whole.points(frame, view)
n04.hough(paint, single_lines(paint))

# %% [markdown]
# The brightest spots are the yellow line, at a bend to the left. They lie on a slanting ridge: a little more bend and a little
# less heading is nearly the same line, so its votes spread, and the strongest lines of all would be readings of one stripe of
# paint. On a motorway that stripe may be the far edge of the *next* lane. So the prior has its say before anything is chosen
# (a line must be a likely boundary of a lane with the car in it), and lines are chosen one after the other, a few on either
# side of the car; the points of a chosen line count half from then on, so that all get their turn. What is chosen is drawn
# onto its points, and readings that end in the same place are one line.
#
# For each line a **partner** is sought, parallel to it, over all widths from 2.6 to 4.6 m and all pitches; the most promising
# lanes with the car between them are fitted, and the one with the most paint and the fewest objections of the prior wins. The
# windows' habit of taking the next lane's dashes, or of losing the far ones, has no place here: a partner is wanted at a width.

# %%
for mean in hypotheses(paint):
    centre, _, bend, _, width, pitch, _ = mean
    print(f"candidate: offset {-centre:+.2f} m, curvature {-2000 * bend:+.1f} per km, "
          f"width {width:.2f} m, pitch {np.degrees(pitch):+.1f}°")
result = whole.process(frame)
bend, sigma = 1000 * result.curvature_1pm, 1000 * result.lane.std["curvature_1pm"]
notebook.say(f"Fitted: offset {result.offset_m:+.2f} m, width {result.width_m:.2f} m, "
             f"curvature {bend:.2f} ± {sigma:.2f} per km (truth {here['offset_m']:+.2f}, "
             f"{here['lane_width_m']:.2f}, {1000 * here['curvature_1pm']:.2f}).")

# %% [markdown]
# Sometimes paint does not decide. Leaves lie on a line, and a lane half a metre wider explains what is left of it just as
# well. Nobody would drive there, because **the ground beside a road is warmer**: asphalt and concrete are grey; soil, dry
# grass and leaves are not. So where different lanes are nearly equal, each loses up to three units for the rows in which
# such ground, on a strip wider than any paint, reaches over its lines. It only ever says where a lane is *not*: many roads
# have no verge like that. A road with worn paint, and its right line moved outwards on purpose:

# %%
meadow = read_image(shipped.test_images / "worn_paint.jpg")
found = whole.process(meadow).fit
for moved_m in (0.0, 0.4, 0.8, 1.2):
    mean = found.mean.copy()
    mean[[CENTRE, WIDTH]] += moved_m / 2, moved_m
    _, rows = verge_rows(*view.paint_channels(meadow), view.grid, replace(found, mean=mean))
    print(f"right line {moved_m:.1f} m further out: warm ground in {rows} rows")

# %% [markdown]
# Silence while the line is on asphalt, paved shoulder included; then, within a few decimetres, nearly every row objects.
#
# ## What it gains
#
# One frame proves nothing. Twenty roads at random: bends of 150 to 900 m to either side, worn paint, dashes on the right,
# a car that nods by 0.3° (as cars do). The same frames, the same recipe for paint; two lines against one lane.

# %%
rng, lateral, lost = np.random.default_rng(4), {"two lines": [], "one lane": []}, {}
apart = LaneFinder(small, model="windows", track=False)
for i in range(20):
    wear, nod_deg = rng.uniform(0.2, 0.8, 2), rng.normal(0, 0.3)
    dashes = {"gap_m": 10.97, "phase_m": rng.uniform(0, 14.6), "wear": wear[1]}
    scene = {"left": Marking(-1.83, "yellow", wear=wear[0]), "right": Marking(1.83, **dashes),
             "seed": i, "pose": CarPose(50.0, rng.uniform(-0.4, 0.4)),
             "mounting": replace(base.mounting, pitch_deg=base.mounting.pitch_deg + nod_deg)}
    picture, entry = drive(rng.choice([-1, 1]) * rng.uniform(150, 900), **scene)
    for what, way in (("two lines", apart), ("one lane", finder)):
        this = way.process(picture)
        x = [this.lane.left.x(20), this.lane.right.x(20)] if this else [np.nan, np.nan]
        lateral[what].append(100 * (np.array(x) - true_x(entry, 20)))
        if not this:
            lost[what, nod_deg] = this.reason

# %% alt="Errors at 20 m as dots in two rows: two separate lines scatter by up to tens of centimetres, one joint lane lies within about two centimetres but for two dots."
n04.dots(lateral, unit="error of each line at 20 m, cm", limit=40,
         title="twenty roads, two lines each")

# %%
for what, values in lateral.items():
    values = np.abs(np.array(values))
    none = np.isnan(values[:, 0]).mean()
    print(f"{what}: median {np.nanmedian(values):.1f} cm, one in ten worse than "
          f"{np.nanpercentile(values, 90):.1f} cm, no lane in {none:.2f} of the frames")

# %% [markdown]
# And the frames that were lost? By notebook 03 a nod of $\delta$ widens the lane over $y$ by about $w\,y\,\delta / h$.

# %%
for (what, nod_deg), reason in lost.items():
    widens_m = 3.66 * 20 * np.radians(nod_deg) / base.mounting.height_m
    print(f"{what}, nod {nod_deg:+.2f}°, {widens_m:+.2f} m in 20 m: {reason}")

# %% [markdown]
# About a tenth of the error, and no frame lost: the solid line carries the dashed one. A nod alone would explain the second
# of these three, and one lane keeps it, because it knows of nods. The other two are dashed lines gone astray, and one lane
# keeps them, because its dashed line cannot. Notebook 06 takes the ideas away one by one and measures what each
# is worth.
#
# ## What you have learned
#
# - Which pixels: histogram and windows know nothing of a lane; a search around the last lane believes everything.
# - Least squares gives outliers their square; a robust fit gives them nothing, up to about half of the points.
# - $\kappa = -x''/(1+x'^2)^{3/2}$ at $y = 0$, all in metres. Curvatures are averaged, never radii.
# - Uncertainty grows with $1/L^2$, and pixels of one dash are one measurement.
# - Check what cannot be a lane; but a check that fails because the car nods throws away good data.
# - One lane has fewer unknowns than two lines. What the data cannot tell, a prior must hold, openly.
#
# ## When it fails
#
# - A streak as bright, as narrow and as long as paint *is* paint to every method here: fresh seams sealed in white, a
#   half-removed line of last year's road works.
# - A lane that really gets wider (an exit, a toll plaza): the joint model calls it pitch, or objects.
# - Beyond a crest nothing is seen; the model continues the bend, which is an assumption. The result therefore says how far
#   paint was seen.
# - A hairpin leaves the view after a few metres: curvature from so short a piece is a guess (the $L^2$ above).
#
# ## How production systems do it
#
# Networks find the pixels, or regress the lines directly, and are far better at saying what is a line. What follows them
# is this notebook: lines in metres, a road model with shared heading and curvature (clothoids, or splines on a map),
# pitch estimated along with it, covariances that a filter can use, and plausibility checks that a safety case can name.
#
# ## Further reading
#
# - E. D. Dickmanns and B. D. Mysliwetz, *Recursive 3-D road and relative ego-state recognition* (1992): one road model,
#   clothoids, pitch, on the computers of its day. The idea of this notebook's second half.
# - R. Hartley and A. Zisserman, *Multiple View Geometry*, appendix 6: Gauss-Newton and its relatives.
# - P. J. Huber and E. M. Ronchetti, *Robust Statistics*: what a median and a biweight promise.
# - R. Duda and P. Hart, *Use of the Hough transformation to detect lines and curves in pictures* (1972): the transform as it
#   is used today.
# - AASHTO, *A Policy on Geometric Design of Highways and Streets*, chapter 3: how roads may bend.
#
# ## Three questions
#
# 1. A frame shows the left line from 5 to 40 m and no paint at all on the right. What does the joint model know about the
#    right line, and from where?
# 2. You may have twice as many pixels on the same 15 m of line, or the same number on 30 m. Which do you take for the
#    curvature, and what does each gain?
# 3. Both lines diverge: 3.6 m apart at the car, 4.4 m at 20 m. Name two explanations and how one could tell them apart.

# %% [markdown] tags=["answer"]
# 1. Heading and bend, from the left line; the width only from the prior (3.65 ± 0.35 m), so the right line is known to
#    about 35 cm, and its standard deviation says so.
# 2. The length. Twice the pixels gain a factor √2 at best (less: they are not independent), twice the length a factor 4.
# 3. A lane that widens, or a nose that points down. One frame on a straight road hardly tells; over time it does: a car
#    nods back within a second, and the dashes, too, change their apparent period with pitch but not with width.
