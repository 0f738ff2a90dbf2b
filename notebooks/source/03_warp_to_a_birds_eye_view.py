"""Notebook 03; see README.md here for the format."""
# %% [markdown]
# # 03 Warp to a bird's-eye view
#
# In the picture the lane's lines meet; on the road they never do. One 3 × 3 matrix undoes the perspective, and with it
# every pixel has a place in metres. Nearly everybody copies that matrix from four magic points and assumes that they
# span 30 m. Here you derive it, find out how long those 30 m really are, and check the result with a ruler that lies
# on every motorway.
#
# **What you will do:** solve a homography by hand; derive pitch, height and metres per pixel from two lines; verify
# them on the dashes; let the program do it from one frame; see what bumps and hills do to it.
#
# **What you will learn:** homogeneous coordinates; vanishing point and horizon; why distances ahead are so delicate.
#
# **What you need:** notebook 01 (the camera matrix); the shipped road pictures; linear algebra.
#
# **Minutes:** 35 to read and run, 70 with the exercises.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start("images", "rig")

# %%
import cv2
import numpy as np

from lanelib import BirdsEye, Grid, Rig, datasets, draw, exercises, explore, figures
from lanelib.autorig import find_rig
from lanelib.birdseye import CLASSIC_SOURCE, angles_from_vanishing_point
from lanelib.dashes import dash_period
from lanelib.figures import n03
from lanelib.labels import line_points
from lanelib.pictures import read_image

# %%
shipped = datasets.get("rendered")
truth = shipped.image_truth()
rig = Rig.load(shipped.rig_file)
camera = rig.camera

frame = read_image(shipped.test_images / "straight_lines1.jpg")
straight = truth["straight_lines1.jpg"]
undistorted = camera.undistort(frame)
lines = [camera.undistort_points(np.column_stack(line_points(straight, i)[::-1])) for i in (0, 1)]

# %% [markdown]
# `lines` are the two lines of the lane in undistorted pixels; on this frame the road is straight. From here on
# everything is undistorted: a homography keeps straight lines straight, a lens does not.
#
# ## A visible failure first
#
# This is the recipe everyone copies: four points of the picture become a rectangle, 3.7 m wide and 30 m long.

# %% alt="Left: the classic trapezoid on the road. Right: its bird's-eye view, in which the lines look parallel."
grid = Grid.uniform(x_range_m=(-6, 6), y_range_m=(4, 36), size_wh=(360, 720))
classic = BirdsEye.classic(camera.size_wh, grid=grid)
corners_px = CLASSIC_SOURCE * camera.size_wh
figures.warp(undistorted, classic, corners_m=classic.road_from_points(corners_px))

# %% [markdown]
# It looks right: the lines are parallel. (They lean a little, for this camera does not look exactly where that other
# one did.) **Before you run the next cell:** the dashes of this road begin every 14.63 m
# (12 ft of paint, 36 ft of gap). How far apart are they in this view?

# %%
line = np.linspace(lines[1][0], lines[1][-1], 900)  # along the dashed line, from far to near
grey = cv2.cvtColor(undistorted, cv2.COLOR_BGR2GRAY)
brightness = cv2.remap(grey, *np.float32(line.T), cv2.INTER_LINEAR).ravel()
brightness = cv2.blur(brightness[None], (5, 1)).ravel()[::-1]
by_classic = classic.road_from_points(line)[::-1, 1]
step = np.diff(n03.dash_middles(by_classic, brightness)).mean()
notebook.say(f"From one dash to the next it is **{step:.1f} m** here, and 14.63 m on the road: "
             f"this view shrinks distances to {step / 14.63:.2f} of what they are.")

# %% [markdown]
# A view can look perfect and be wrong by a good part: parallel lines prove nothing about lengths. What does that
# do to a curve? For small $x$ a circle is $x = y^2 / 2R$. So if lengths along the road are wrong by a factor, $R$ is
# wrong by its *square*.
#
# ### Exercise 1: what the 30 m do to a radius
#
# Someone measured `radius_m` in a view that was assumed to be `assumed_m` long and is `true_m` long. Its width was
# right. What is the true radius?

# %%
def true_radius(radius_m, assumed_m, true_m):
    """The radius when lengths along the road are corrected, metres."""
    # BEGIN SOLUTION
    return radius_m * (true_m / assumed_m) ** 2
    # END SOLUTION


exercises.check_true_radius(true_radius)

# %% [markdown]
# ## Homography
#
# A point of the picture is written $(u, v, 1)$, and every multiple $(wu, wv, w)$ means the same point: *homogeneous*
# coordinates. With them perspective becomes linear. From the picture $(u, v)$ of a plane one comes back to the plane
# $(x, y)$ by
#
# $$w\begin{pmatrix}x\\y\\1\end{pmatrix} = \begin{pmatrix}h_{1}&h_{2}&h_{3}\\h_{4}&h_{5}&h_{6}\\h_{7}&h_{8}&1\end{pmatrix}
# \begin{pmatrix}u\\v\\1\end{pmatrix}, \qquad
# x = \frac{h_1u+h_2v+h_3}{h_7u+h_8v+1},\quad y = \frac{h_4u+h_5v+h_6}{h_7u+h_8v+1}$$
#
# and from the plane to its picture by the inverse matrix. Multiplying by the denominator gives two *linear* equations for the eight unknowns:
#
# $$h_1u+h_2v+h_3 - x\,u\,h_7 - x\,v\,h_8 = x, \qquad h_4u+h_5v+h_6 - y\,u\,h_7 - y\,v\,h_8 = y$$
#
# Four pairs of points, no three of a picture on one line, give eight equations. That is all `getPerspectiveTransform`
# does:

# %%
def homography(image_px, road_m):
    """(3, 3), from four pixels (4, 2) to four points on the road (4, 2)."""
    rows, right_side = [], []
    for (u, v), (x, y) in zip(image_px, road_m, strict=True):
        rows += [[u, v, 1, 0, 0, 0, -x * u, -x * v], [0, 0, 0, u, v, 1, -y * u, -y * v]]
        right_side += [x, y]
    return np.append(np.linalg.solve(rows, right_side), 1).reshape(3, 3)


corners_m = [(-1.85, 34), (1.85, 34), (1.85, 4), (-1.85, 4)]
by_hand = homography(corners_px, corners_m)
opencv = cv2.getPerspectiveTransform(np.float32(corners_px), np.float32(corners_m))
assert np.allclose(by_hand, opencv, rtol=1e-3)
for row in by_hand.round(5) + 0.0:  # + 0.0: no "-0"
    print("".join(f"{number:10.5f}" for number in row))

# %% [markdown]
# ### Exercise 2: through a homography
#
# Take points `(N, 2)` through a homography and give points `(N, 2)`. Mind the third coordinate.

# %%
def map_through(matrix, points):
    """Points (N, 2) mapped by a homography (3, 3), again (N, 2)."""
    # BEGIN SOLUTION
    xyw = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return xyw[:, :2] / xyw[:, 2:]
    # END SOLUTION


exercises.check_map_point(map_through)

# %% [markdown]
# ## Where the classic numbers come from
#
# The four points were found by eye on one straight frame of one car, so that the lines came out parallel. **3.7 m** is
# a lane of 12 ft, the usual width of a US motorway lane: sound, if the points lie on its lines. **30 m** was a guess,
# "about this far", printed in a lesson and copied since. With a calibrated camera of known mounting there is no need to
# guess. Where on the road are the four points really? For the drive they were made for, and for ours:

# %%
files = datasets.project_root() / "rigs"
rigs = {name: Rig.load(files / f"{name}.json") for name in ("udacity", "rendered")}
for name, one in rigs.items():
    corners = one.birdseye.road_from_points(CLASSIC_SOURCE * one.size_wh)
    far_left, far_right, near_right, near_left = corners
    length = (far_left + far_right - near_left - near_right)[1] / 2
    print(f"{name:9} from {near_left[1]:.1f} m to {far_left[1]:.1f} m: {length:.1f} m long, "
          f"{near_right[0] - near_left[0]:.2f} m wide at its lower edge")

# %% [markdown]
# Longer than 30 m in both, wider than 3.7 m, too, and nothing in the picture said so. What do the two errors do to a
# radius $R = y^2 / 2x$? The length counts with its square and makes it too small, the width makes it too large. Let us
# look at a true bend of 1 km through the four points.

# %%
y = np.linspace(6, 38, 50)
bend = np.column_stack([1000 - np.sqrt(1000**2 - y**2), y])
for name, one in rigs.items():
    x, ahead = BirdsEye.classic(one.size_wh).road_from_points(one.birdseye.points_from_road(bend)).T
    radius_m = 1 / abs(2 * np.polyfit(ahead, x, 2)[0])
    print(f"{name:9} a bend of 1 km comes out at {radius_m / 1000:.2f} km")

# %% [markdown]
# One error hides a part of the other, on one car more and on another less. Nobody planned that, and no one who only sees
# the picture can know it. Now the derivation, in four steps.

# %% [markdown]
# ## The road from the side
#
# A camera at height $h$ looks level along a flat road. A point of the road $y$ metres ahead is $h$ below the axis, so
# the pinhole of notebook 01 shows it $f h / y$ rows below the horizon's row $v_h$:

# %% alt="A camera above a road from the side: rays to points 6, 12 and 30 m ahead pass the picture plane at heights that come closer and closer to the horizon."
n03.from_the_side(rig.mounting["height_m"])

# %% [markdown]
# $$v - v_h = \frac{f h}{y}, \qquad u - u_h = \frac{f x}{y}$$
#
# Divide the second one by the first:
#
# $$\frac{u - u_h}{v - v_h} = \frac{x}{h}$$
#
# The focal length is gone. **In a row $d = v - v_h$ below the horizon one pixel is $h / d$ metres wide**, whatever the
# lens. So a lane of the width $W$ is
#
# $$W_{px} = \frac{W\,d}{h}$$
#
# pixels wide in that row. Both are of use when they are turned round, and that is your part.
#
# ### Exercise 3: how far is a row?
#
# For a level camera: how many metres ahead is the road that row `v` shows?

# %%
def distance_of_row(v, horizon_v, focal_px, height_m):
    """Metres ahead of the road seen in row v."""
    # BEGIN SOLUTION
    return focal_px * height_m / (v - horizon_v)
    # END SOLUTION


exercises.check_distance_of_row(distance_of_row)

# %% [markdown]
# ### Exercise 4: how high is the camera?
#
# A lane of `lane_width_m` is `lane_width_px` wide in a row that lies `below_px` below the horizon.

# %%
def camera_height(lane_width_px, below_px, lane_width_m):
    """Metres of the camera above the road."""
    # BEGIN SOLUTION
    return lane_width_m * below_px / lane_width_px
    # END SOLUTION


exercises.check_camera_height(camera_height)

# %% [markdown]
# Metres per pixel *along* the road are the derivative of the distance that you wrote in exercise 3, and grow with its
# square:
#
# $$\left|\frac{dy}{dv}\right| = \frac{f h}{d^2} = \frac{y^2}{f h}$$
#
# ## The vanishing point
#
# All that is missing is $v_h$. Lines that are parallel on the road have one direction, and points far out on them
# approach one pixel: the projection of the direction itself. For the road's direction $\mathbf d$ in camera axes it is
# $\mathbf v \sim K \mathbf d$. So **where the lane's lines meet tells where the camera looks**: $\mathbf d \sim
# K^{-1}\mathbf v$, and the angles follow from its components:
#
# $$\text{pitch} = \arctan\frac{-d_y}{d_z}, \qquad \text{yaw} = \arctan\frac{-d_x}{\sqrt{d_y^2+d_z^2}}$$
#
# (pitch is positive looking down, yaw looking right). Two lines in homogeneous coordinates meet at their cross product,
# and a line through two points is *their* cross product. Three lines of code:

# %%
left_line, right_line = (np.cross((*points[0], 1), (*points[-1], 1)) for points in lines)
vanishing = np.cross(left_line, right_line)
vanishing = vanishing[:2] / vanishing[2]
pitch_deg, yaw_deg = angles_from_vanishing_point(camera.camera_matrix, vanishing)
up_down, aside = "down" if pitch_deg > 0 else "up", "right" if yaw_deg > 0 else "left"
notebook.say(f"The lines meet at u = {vanishing[0]:.0f}, v = {vanishing[1]:.0f}. The camera looks "
             f"{abs(pitch_deg):.2f}° {up_down} and {abs(yaw_deg):.2f}° to the {aside}.")

# %% alt="The road with both lane lines drawn on until they meet at the vanishing point on the horizon."
ends = [np.vstack([points[-1], vanishing]) for points in lines]
picture = draw.draw_line(undistorted, ends[0], "left", width_px=3)
picture = draw.draw_line(picture, ends[1], "right", width_px=3)
figures.show(draw.draw_points(picture, [vanishing], "paint", radius_px=7)[330:690])

# %% [markdown]
# The vanishing point is *not* at the principal point; the camera is tilted a little. And it is seldom at half the
# height of the frame, where many programs put it.
#
# ## Metres
#
# Pitch and yaw turn the camera level; the lane's width then gives the height. `BirdsEye.from_straight_lines` does both:
# with rotation $R$ and height $h$ the whole homography is $K\,[\mathbf r_1\ \mathbf r_2\ \mathbf t]$ (Hartley and
# Zisserman, section 8.1.1). Nothing was typed in but the width of the lane.

# %% alt="The straight road and its bird's-eye view from derived geometry: lines upright, a rectangle on the road in both."
left, right = (points[[0, -1]] for points in lines)
ours = BirdsEye.from_straight_lines(camera, left, right, lane_width_m=3.66, grid=grid)
figures.warp(undistorted, ours)

# %%
found = ours.mounting(camera)
for name, unit in (("height_m", "m"), ("pitch_deg", "deg"), ("yaw_deg", "deg")):
    true = straight["mounting"][name]
    print(f"{name:10} found {found[name]:+.2f} {unit}, true {true:+.2f} {unit}")

# %% [markdown]
# These frames are rendered, so the true mounting is known; two lines on one frame give it to a hundredth. (The
# car drives exactly parallel to the lane here. On a real frame it is a degree or so off, which would go into the yaw;
# over many frames it averages out.)
#
# **Metres per pixel**, derived: across $h/d$, along $f h/d^2$. **Predict:** how many metres of road lie in one row of
# pixels at 40 m?

# %% alt="Metres per pixel over distance, logarithmic: across grows in proportion to distance from 0.5 cm to 5 cm, along with its square from 2 cm to more than 2 m."
y = np.linspace(5, 60, 56)
focal, height = camera.camera_matrix[1, 1], found["height_m"]
scales = {"across the road": y / focal, "along the road": y**2 / (focal * height)}
figures.curves(y, scales, xlabel="distance ahead, m", ylabel="metres per pixel", logy=True,
               markers=False)

# %%
at_40 = ours.points_from_road([[0, 40], [0, 40.5], [0.5, 40]])
row_m, column_m = 0.5 / (at_40[0, 1] - at_40[1, 1]), 0.5 / (at_40[2, 0] - at_40[0, 0])
notebook.say(f"At 40 m one row is {row_m:.2f} m of road by the homography itself, and "
             f"{40**2 / (focal * height):.2f} m by the formula; "
             f"one column is {100 * column_m:.1f} cm.")

# %% [markdown]
# That is why far dashes shrink to specks while their distance *sideways* stays sharp, and why lane finders look no
# farther than 40 or 50 m.

# %% [markdown]
# ## A ruler on the road
#
# The width of the lane fixed the scale *across*. Is the scale *along* right, too? It came out of the geometry, so it
# can be checked by something that was not put in: the period of the dashes. In California dashes of 12 ft begin every
# 48 ft, 14.63 m; in most other states every 40 ft, 12.19 m. The same pixels along the dashed line, on both rulers:

# %% alt="Brightness along the dashed line on two rulers: with the classic view the next dash comes before the dashed mark at 14.63 m, with the derived one it comes at the mark."
rulers = {"classic, 30 m assumed": by_classic, "derived": ours.road_from_points(line)[::-1, 1]}
n03.along_line(rulers, brightness, period_m=14.63)

# %%
for name, ruler in rulers.items():
    steps = np.diff(n03.dash_middles(ruler, brightness))
    print(f"{name:22} from dash to dash {steps.mean():.1f} m, "
          f"{steps.mean() / 14.63:.2f} of the truth")

# %% [markdown]
# The narrow spike between the first two dashes is no paint: it is a reflector in the middle of the gap, and too short to
# be taken for a dash. A single frame shows two or three dashes, the far ones blurred over a metre or more. `dash_period` uses all dashes of
# several frames and says how sure it is:

# %%
hard = datasets.tagged(truth, "hard")
clear = [path for path in shipped.images() if path.name in truth and path.name not in hard]
frames = [read_image(path) for path in clear]
print(dash_period(rig, frames))

# %% [markdown]
# If this road's number came out as 12 or 18 m, something would be wrong with the focal length or the pitch: two
# quantities that do not show in a straight lane at all. A ruler that comes free with the road.

# %% [markdown]
# ## Parallel, a check that needs nothing
#
# Lines of a lane are as far apart at 40 m as at 5 m. If they open or close in the view, the pitch is wrong. By how
# much? Let the camera be taken to look further down than it does, by a small angle $\delta > 0$: the horizon is then
# taken to be $f\delta$ rows higher, so a point in a row $d$ below it is put at $fh/(d + f\delta)$ instead of $fh/d$:
#
# $$\frac{\Delta y}{y} \approx -\frac{f\,\delta}{d} = -\frac{y}{h}\,\delta \qquad\text{and the same for } \frac{\Delta x}{x}.$$
#
# The relative error *grows with the distance*: far things are squeezed or stretched more than near ones, so the lane
# becomes a wedge. **Predict:** half a degree, at 30 m, camera at 1.25 m: how many metres, nearer or farther?

# %%
delta = np.radians(0.5)
wrong = ours.pitched(camera, delta)
seen = wrong.road_from_points(ours.points_from_road([[0.0, 30.0]]))[0, 1]
notebook.say(f"The formula says {-(30**2) / height * delta:+.1f} m for a small angle. Exactly it "
             f"is {seen - 30:+.1f} m: the point is put at {seen:.1f} m.")

# %% alt="Three bird's-eye views of the same frame, the camera taken to look half a degree more upwards, as it does, and half a degree more downwards. In the outer ones the lane widens or narrows with the distance, away from the dashed lines."
pitched = {"camera taken to look\n0.5° more upwards": ours.pitched(camera, -delta),
           "true pitch": ours, "0.5° more downwards": ours.pitched(camera, delta)}
n03.views(undistorted, pitched, lines_m=[line[0][0] for line in straight["lanes_road_m"]])

# %%
names = "taken 0.5° up", "true pitch", "taken 0.5° down"
for name, view in zip(names, pitched.values(), strict=True):
    opens = view.parallelism(*lines)
    how = f"gets {'wider' if opens > 0 else 'narrower'} by {abs(opens):.2f} m over 30 m"
    print(f"{name:15} the lane {how if abs(opens) > 0.005 else 'is parallel'}")

# %% [markdown]
# Half a degree is what a car does when it brakes or takes a bump. A wedge is easy to see and easy to measure: that is
# how the finder knows the pitch of *each frame*, from the lane itself (notebook 04), and does not fall for a bump.
#
# ### Hills
#
# Not every road is flat. From 15 m on let it rise or fall by 2 %, a change that you hardly feel. A point that lies $z$
# higher than the flat road is seen at $y\,h/(h - z)$:

# %% alt="Left: road profiles that rise or fall by 2 percent from 15 m on. Right: measured against true distance; the rising road is seen far too long, 45 m as about 87 m, the falling one too short, as about 30 m."
n03.hill(height)

# %%
z = 0.02 * (30 - 15)
rising, falling = (30 * height / (height - up) for up in (z, -z))
print(f"rising 2 %: 30 m look like {rising:.0f} m; falling 2 %: like {falling:.0f} m")

# %% [markdown]
# From one picture a rising road and a camera that looks further down are hard to tell apart: both open the lane, as a
# falling road and a camera that looks up close it. A single line would show neither, and that is why two lines are worth
# more than one. Beyond the point where the grade changes, distances, and
# with them curvature, are guesses. Take what is near, and say how sure you are.

# %% [markdown]
# ## A rig from one straight frame
#
# All of this can be done without anyone clicking points: find paint, let its lines vote for a vanishing point, fit
# a lane, correct pitch, yaw and height until it is straight, parallel and 3.7 m wide. A `Rig` is the camera and this
# view in one file.

# %%
estimate = find_rig(frame, camera)
for name, unit in (("height_m", "m"), ("pitch_deg", "deg"), ("yaw_deg", "deg")):
    print(f"{name:10} {getattr(estimate, name):+.2f} ± {estimate.std[name]:.2f} {unit}, true "
          f"{straight['mounting'][name]:+.2f} {unit}")

# %% [markdown]
# The height is a little high because it took the lane to be 3.7 m wide and this one is 3.66 m: a height can be no
# better than the width that was assumed. The yaw is as uncertain as the driver: how parallel to its lane does a car
# drive on one frame? Of a clip the rig takes the median.
#
# **Predict:** what does it make of a curve?

# %%
for name in ("test3.jpg", "test2.jpg"):
    bent = find_rig(read_image(shipped.test_images / name), camera)
    print(f"{name}, radius {truth[name]['radius_m']:.0f} m: "
          f"pitch {bent.pitch_deg:+.2f} deg, yaw {bent.yaw_deg:+.2f} deg")

# %% [markdown]
# The pitch hardly suffers, for the lane's width is the same in a curve. The yaw does: where the lines bend away,
# "straight ahead" is drawn to the side. Gentle curves do little harm; use straight road where you have it.

# %% [markdown]
# ## Try it
#
# Drag the four corners (or move them with the arrow keys). Make the lines parallel first; then watch pitch, height and
# the length that follows from them. Untick "derive" and assume 30 m. Which readings change, and which picture does?

# %% tags=["nbval-ignore-output"]
explore.warp(frame, rig, straight)

# %% alt="The view of the rig as the explorer shows it at its start, beside the view through the classic trapezoid."
rigs_view = BirdsEye(rig.birdseye.road_from_image, rig.size_wh, grid)
n03.views(undistorted, {"rig": rigs_view, "classic, 30 m": classic})

# %% [markdown]
# ## What you have learned
#
# - A homography has eight unknowns and needs four points; after it, divide by $w$.
# - The lines' meeting point gives pitch and yaw, the lane's width the height: metres per pixel are *derived*, $h/d$
#   across and $fh/d^2$ along.
# - The classic 30 m are 33 to 37 m, which a radius feels squared; its 3.7 m are more, too, and hide a part of that.
# - Parallel lines check the pitch, dashes check the length. Neither needs any truth.
# - $\Delta y / y \approx -(y/h)\,\delta$ where the camera is taken to look further down by $\delta$: half a degree is
#   metres at 30 m.
#
# ## When it fails
#
# - **Bumps, braking, load**: the pitch changes by some tenths of a degree all the time; seen through a fixed matrix, the
#   road seems to breathe.
# - **Hills and crests**: no plane fits; beyond the change of grade distances are fiction.
# - **Curves**: their lines have no common vanishing point; a rig made from them is tilted aside.
# - **A lane of another width** (3.0 m in roadworks, 3.5 m in much of Europe) scales everything by its ratio.
# - **Roll**: a camera turned by a degree lifts one side of the road; two lines do not show it, the horizon does.
#
# ## How production systems do it
#
# Cameras are calibrated to the car at the factory and the angles tracked while driving, from lines, from the flow of
# the road's texture, from inertial sensors. Many systems no longer warp the picture: they detect in the picture and
# project only the points, with a pitch estimated for each frame and sometimes a road model with a vertical curve.
# Networks that "lift" to a bird's-eye view learn the same geometry, and are trained with exactly these matrices.
#
# ## Further reading
#
# - R. Hartley and A. Zisserman, *Multiple View Geometry*, chapters 2, 4 and 8: homographies, vanishing points, planes.
# - E. Dickmanns, *Dynamic Vision for Perception and Control of Motion* (2007): hills and bumps, estimated while
#   driving.
# - J. Coughlan and A. Yuille, "Manhattan World" (1999): the camera's direction from lines alone.
# - FHWA, *Manual on Uniform Traffic Control Devices*, part 3: how long dashes and how wide lines are.
#
# ## Three questions
#
# 1. Your bird's-eye view shows parallel, upright lines. What do you know about its scale?
# 2. Why does the focal length not matter for $x$, but for $y$?
# 3. The car brakes and its nose dips by 0.3°. What happens to the lane in a fixed view, and to the measured width?

# %% [markdown] tags=["answer"]
# 1. Nothing along the road: any stretch of $y$ keeps the lines upright and parallel. Across, as much as you know of the
#    lane's width.
# 2. $x = h(u-u_h)/(v-v_h)$ is a ratio of two pixel distances, so the lens cancels. $y = fh/(v-v_h)$ compares a pixel
#    distance with the height, and $f$ is what turns pixels into angles.
# 3. The camera looks further down than the view takes it to ($\delta = -0.3°$), so the road moves up in the picture:
#    every point seems farther away, by the share $(y/h)\,|\delta|$, at 30 m about an eighth. The lines open with the distance in the view, and the lane seems wider
#    far out.
