"""Notebook 01; see README.md here for the format."""
# %% [markdown]
# # 01 Calibrate the camera
#
# A camera measures directions, but only if you know what its lens does to them. Ours bends straight lines by several
# pixels and sees the next lane a hand's breadth from where it is. Twenty pictures of a chessboard cure that; and
# because these boards are rendered by a camera whose every number is known, you can for once see how right a
# calibration is.
#
# **What you will do:** find chessboard corners, also on boards the frame cuts off; calibrate; hold the result against
# the *true* camera; undistort; turn calibration errors into centimetres on the road.
#
# **What you will learn:** the pinhole and the Brown-Conrady equations; what the RMS reprojection error tells and what
# it cannot tell; which pictures make a calibration good.
#
# **What you need:** notebook 00; the shipped chessboards; Python and a little linear algebra.
#
# **Minutes:** 30 to read and run, 60 with the exercises.

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; run `make lab` in the project's folder"
    ) from None
notebook.start("boards", "images", "rig")

# %%
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np

from lanelib import Camera, Rig, datasets, draw, exercises, explore, figures
from lanelib.birdseye import BirdsEye
from lanelib.calibration import board_points, calibrate
from lanelib.chessboard import find_board, straightness_px
from lanelib.distortion import distort
from lanelib.figures import n01
from lanelib.pictures import read_image

# %%
shipped = datasets.get("rendered")
rig = Rig.load(shipped.rig_file)
true = rig.camera

# %% [markdown]
# ## A visible failure first
#
# A printed board has straight rows. Here is one held close to the camera, and through the outer rows of corners straight
# lines from the first corner to the last. **Before you run the next cell:** will the corners between lie on it?

# %% alt="A chessboard that fills the frame; its upper and lower rows bulge away from the dashed straight lines drawn through their ends."
picture = read_image(shipped.boards()[0])
seen = find_board(picture, (9, 6))
grid = seen.corners_px.reshape(seen.corners_wh[1], seen.corners_wh[0], 2)
lines = [row[[0, -1]] for row in grid]
figures.before_after(picture[:300], picture[420:], ("upper part", "lower part"),
                     edges=(lines[:2], [line - (0, 420) for line in lines[-2:]]))

# %%
bow = [np.abs(row[:, 1] - np.interp(row[:, 0], *row[[0, -1]].T)).max() for row in grid]
notebook.say(f"The rows of corners bow by up to **{max(bow):.1f} px**. "
             "Nothing is wrong with the board: it is the lens.")

# %% [markdown]
# The squares near the edge are pulled towards the middle: *barrel* distortion, as nearly every wide lens has it. A lane
# line is a straight row, too. If the lens bends it, you will measure a curve on a straight road, and put the
# neighbouring lane where it is not.

# %% [markdown]
# ## The pinhole
#
# Without a lens a camera is a box with a hole. A point at $(X, Y, Z)$ metres, $X$ to the right, $Y$ down, $Z$ forward,
# sends a ray through the hole. The ray meets the plane one unit behind (we draw it in front, to save a minus sign) at
#
# $$x = \frac{X}{Z}, \qquad y = \frac{Y}{Z}$$
#
# by similar triangles: twice as far is half as large. These are *normalised* coordinates, tangents of angles, and they
# belong to the world alone. The sensor turns them into pixels with four numbers, the **camera matrix** $K$:
#
# $$\begin{pmatrix}u\\v\\1\end{pmatrix} = \begin{pmatrix}f_x&0&c_x\\0&f_y&c_y\\0&0&1\end{pmatrix}
# \begin{pmatrix}x\\y\\1\end{pmatrix}, \qquad u = f_x x + c_x,\quad v = f_y y + c_y$$
#
# $f_x, f_y$ are the focal length in units of a pixel's width and height (they differ where pixels are not square);
# $(c_x, c_y)$, the principal point, is the pixel that looks straight ahead. It is near the middle of the frame, but
# only near.
#
# **Predict:** our focal length is about 1150 px. How many pixels wide is a lane of 3.7 m at 20 m? And at 40 m?

# %%
def width_px(width_m, distance_m, focal_px):
    """Width in pixels of something seen square on."""
    return focal_px * width_m / distance_m


for distance_m in (20, 40):
    lane_px, pixel_cm = width_px(3.7, distance_m, 1155), 100 * distance_m / 1155
    print(f"at {distance_m} m the lane is {lane_px:.0f} px wide, "
          f"and one pixel covers {pixel_cm:.1f} cm")

# %% [markdown]
# Remember that second number: an error of one pixel is a couple of centimetres on the road, and more the farther away.

# %% [markdown]
# ## The lens
#
# A lens lets more light in than a hole, and bends rays a little more the farther out they are. Brown (1971), after
# Conrady, describes it with $r^2 = x^2 + y^2$ as
#
# $$\begin{aligned}
# x_d &= x\,(1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + 2 p_1 x y + p_2 (r^2 + 2x^2)\\
# y_d &= y\,(1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + p_1 (r^2 + 2y^2) + 2 p_2 x y
# \end{aligned}$$
#
# The $k$ are *radial*. Why even powers only? A round lens cannot tell left from right: the factor must be the same for
# $r$ and $-r$, and its series has no odd terms. $k_1 < 0$ pulls inwards (barrel), $k_1 > 0$ pushes outwards
# (pincushion). The $p$ are *tangential*: lens and sensor are not quite parallel or centred. Five numbers; with the
# four of $K$, nine.

# %% alt="Left: arrows over the frame that point inwards and are longest in the corners. Right: the displacement grows with the third power of the distance, to about minus 150 pixels in the corner."
n01.lens(true)

# %%
corner = true.undistort_points([[0.0, 0.0]])[0]
notebook.say(f"In the upper left corner the true lens moves a point by **{np.hypot(*corner):.0f} "
             "px**; $k_1$ alone explains most of it.")

# %% [markdown]
# The equations go from the ideal to the seen point. The way back has no closed form; `lanelib.distortion.undistort`
# solves it with Newton's method in four to six steps. There and back again must be the identity:

# %%
xy = np.array([[0.5, 0.3], [-0.2, 0.1]])
there = distort(xy, true.distortion)
focal, centre = np.diag(true.camera_matrix)[:2], true.camera_matrix[:2, 2]
back = (true.undistort_points(there * focal + centre) - centre) / focal
assert np.abs(back - xy).max() < 1e-9
there.round(4).tolist()

# %% [markdown]
# ### Exercise 1: bend a ray
#
# Write the radial part for two coefficients, without the tangential one: where does the lens move the normalised point
# $(x, y)$?

# %%
def radial(x, y, k1, k2):
    """(x_d, y_d) for normalised x, y."""
    # BEGIN SOLUTION
    rr = x**2 + y**2
    bend = 1 + k1 * rr + k2 * rr**2
    return x * bend, y * bend
    # END SOLUTION


exercises.check_radial(radial)

# %% [markdown]
# ### Try it
#
# Move one coefficient at a time. Which of them moves the corners most, and which one do you hardly see? Turn $k_1$ to
# the other side: a pincushion. The figure above is the same lens standing still.

# %% tags=["nbval-ignore-output"]
explore.distortion(true, picture)

# %% [markdown]
# ## Corners
#
# To find nine numbers you need many points whose place in the world you know. A chessboard gives them for the price of
# a print: its inner corners are where four squares meet, so they can be located to a small fraction of a pixel, and all
# are on one plane at known distances. `find_board` looks for the whole board of 9 × 6 inner corners, and where the
# frame cuts it off, for the largest part that can be seen. **Predict:** how many of the twenty boards can be used?

# %%
calibration = calibrate(shipped.boards(), board_wh=(9, 6), square_m=0.024)
calibration

# %% alt="Twenty chessboard pictures with their corners and the error of each; board 12 is pale and marked as not used."
pictures = [read_image(path) for path in shipped.boards()]
figures.boards(pictures, calibration.boards)

# %% [markdown]
# No board vanishes silently: each has a line that says what became of it. These are the ones with something to say:

# %%
for board in calibration.boards:
    if board.reason:
        print(f"{board.name}: {'used' if board.used else 'NOT used'}, {board.reason}")

# %% [markdown]
# Boards cut off by the frame are worth the trouble, and not for their number: they are the ones that fill the lower and
# the right edge, where the lens bends more than in the middle. OpenCV's classic finder knows only whole boards and throws
# exactly these away. Here are all corners in one frame:

# %% alt="Corners of all boards in one frame: circles of whole boards fill most of it, triangles of the cut-off boards fill the lower and right edge; the four corners of the frame are empty."
n01.coverage(calibration.boards, true.size_wh)

# %% [markdown]
# Look for empty regions before you trust a calibration. There the five coefficients are not measured but extrapolated.
# Here it is the corners of the frame, the upper left one most of all: look for it in the error map below.

# %% [markdown]
# ## From corners to a camera
#
# Zhang (2000): each view of a plane is a homography between board and picture (a 3 × 3 matrix that takes one plane to
# another; notebook 03 derives it), and each homography gives two equations for $K$; three views are enough for a start.
# From there all nine numbers of the camera and six for the pose of each board are improved together until the squared
# distances between seen and projected corners,
#
# $$E = \sum_{\text{boards } i}\ \sum_{\text{corners } j} \left\lVert\, \mathbf u_{ij} - \mathrm{project}(K, k, p, R_i, \mathbf t_i, \mathbf X_j) \right\rVert^2,$$
#
# are as small as they can be. OpenCV does it in one call; this is all there is in it:

# %%
def camera_from(views):
    """A camera from some of the boards, by OpenCV: corners on the board and in the picture."""
    on_board = [board_points(view.corners_wh, square_m=0.024) for view in views]
    in_picture = [view.corners_px.astype(np.float32).reshape(-1, 1, 2) for view in views]
    rms_px, matrix, distortion, _, _ = cv2.calibrateCamera(
        on_board, in_picture, true.size_wh, None, None)
    return Camera(matrix, distortion.ravel()[:5], true.size_wh, rms_px)


used = [board for board in calibration.boards if board.used]
camera_from(used)

# %% [markdown]
# Sizes are `(width, height)` there. Two public pipelines hand over `(height, width)`, and nothing complains: the search
# then starts with the centre in the wrong place. On clean corners it finds its way back; on photographs the RMS can
# triple.
#
# Now the luxury of a rendered set: the truth. **Predict:** is a focal length found from photographs right to 10 %, to
# 1 %, or to 1 in 1000?

# %% alt="Left: the errors of fx, fy, cx and cy are below half a pixel and within their error bars. Right: the error of the rays over the frame, below a tenth of a pixel where most boards were, largest in the upper left corner."
camera = calibration.camera
n01.against_truth(camera, true)

# %%
off = abs(camera.camera_matrix[0, 0] / true.camera_matrix[0, 0] - 1)
worst_px, (u, v) = n01.worst_ray(camera, true)
notebook.say(f"The focal length is off by {1e4 * off:.0f} in 10,000. Over the frame a pixel's ray "
             f"is off by {n01.ray_error_px(camera, true):.2f} px (RMS), much of it a common shift "
             f"that a mounting angle absorbs; the worst, at u = {u:.0f}, v = {v:.0f}, "
             f"by {worst_px:.1f} px.")

# %% [markdown]
# The error bars come out of the fit itself: how far could each number move before $E$ grows noticeably? With the truth
# at hand you see that they are honest. They stay honest only while the model is: a board that is bent, or a second lens
# setting among the pictures, is in no error bar.

# %% [markdown]
# ### Exercise 2: the same camera at half the size
#
# Pictures are often made smaller before they are worked on. What is $K$ when both sides are multiplied by `factor`?
# The distortion coefficients belong to $x, y$ and stay. (Half a pixel more or less for where a pixel's centre is does
# not matter here.)

# %%
def scaled_matrix(camera_matrix, factor):
    """The 3x3 camera matrix of pictures that are `factor` times as wide and high."""
    # BEGIN SOLUTION
    scaled = camera_matrix.copy()
    scaled[:2] *= factor
    scaled[:2, 2] += 0.5 * factor - 0.5  # pixel centres are at integers, pixel edges at halves
    return scaled
    # END SOLUTION


exercises.check_scaled_matrix(scaled_matrix)

# %% [markdown]
# ## What the RMS tells
#
# The root mean square of those distances is the number everyone quotes:
#
# $$\mathrm{RMS} = \sqrt{\frac{1}{N}\sum_{j=1}^{N} \left(\Delta u_j^2 + \Delta v_j^2\right)}$$
#
# with $N$ corners. (Some programs print the norm divided by $N$: it is smaller by $\sqrt N$ and means nothing.)

# %% alt="Bars of the RMS error of each board, between about 0.05 and 0.10 pixels, and the overall RMS as a dashed line."
figures.board_errors(calibration.boards, rms_px=calibration.rms_px)

# %% [markdown]
# All boards are explained about equally well. A board that stood out by a factor of three, and by more than 0.3 px,
# would be left out by `calibrate`, with its name and the reason. Photographs of a paper board with a real camera give
# 0.3 to 1 px instead; most of that is paper that is not flat.
#
# RMS does tell how well corners were *located*. The same boards, three corner finders:

# %%
def classic_corners(picture):
    """Corners (54, 1, 2) by OpenCV's older finder, as found and refined; None without a board."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    ok, corners = cv2.findChessboardCorners(grey, (9, 6))
    if not ok:
        return None
    corners = corners.astype(np.float32).reshape(-1, 1, 2)
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    return corners, cv2.cornerSubPix(grey, corners.copy(), (11, 11), (-1, -1), end)


by_opencv = [classic_corners(picture) for picture in pictures]
found, refined = zip(*filter(None, by_opencv), strict=True)
same = [board for board, seen in zip(calibration.boards, by_opencv, strict=True) if seen]

# %%
def report(name, count, camera):
    """What one would print, and what only the truth tells."""
    off_px = n01.ray_error_px(camera, true)
    print(f"{name:24} {count} boards, RMS {camera.rms_px:.2f} px, rays off by {off_px:.2f} px")


for name, corners in {"findChessboardCorners": found, "the same + cornerSubPix": refined}.items():
    board = [board_points((9, 6), square_m=0.024)] * len(corners)
    rms_px, matrix, distortion, _, _ = cv2.calibrateCamera(board, corners, true.size_wh, None, None)
    report(name, len(corners), Camera(matrix, distortion.ravel(), true.size_wh, rms_px))
report("lanelib", len(same), camera_from(same))

# %% [markdown]
# The older finder leaves each corner a quarter of a pixel off; refining the corners cures most of that, and the error
# of the rays goes with it. A step as large as that shows in the RMS. The step from the second to the third does not: the
# RMS falls a little more, and the rays get worse.
#
# ### What it cannot tell
#
# Take three boards at random, calibrate, and look at the RMS. Do that thirty times. **Predict:** are the calibrations
# with the lowest RMS the best ones?

# %% alt="Thirty calibrations from three boards: their RMS lies between 0.05 and 0.08 pixels whatever the error of the focal length, which reaches several pixels; all boards together have an ordinary RMS and nearly no error."
rng = np.random.default_rng(1)
few = [camera_from([used[i] for i in rng.choice(len(used), 3, replace=False)]) for _ in range(30)]
rms_few = [one.rms_px for one in few]
error_few = [abs(one.camera_matrix[0, 0] - true.camera_matrix[0, 0]) for one in few]
all_error = abs(camera.camera_matrix[0, 0] - true.camera_matrix[0, 0])
n01.rms_and_error(rms_few, error_few, (calibration.rms_px, all_error))

# %%
lower = np.array(rms_few) < calibration.rms_px
worse = np.array(error_few) > all_error
notebook.say(f"{lower.mean():.0%} of the small calibrations have a *lower* RMS than the one from "
             f"all boards, and {(lower & worse).sum() / lower.sum():.0%} of those have a *larger* "
             "error.")

# %% [markdown]
# The RMS is what is left over. Three boards leave little over because few points contradict anything. So:
#
# - a **high** RMS says that something is wrong: corners, a bent board, a wrong board size;
# - a **low** RMS says nothing, unless the boards are many, tilted, and all over the frame;
# - the **standard deviations** tell more, and boards that were *not* used for the calibration tell most.

# %% [markdown]
# ### Exercise 3: write it yourself
#
# Corners seen and corners projected, both `(N, 2)`. What is the RMS over the corners?

# %%
def rms(seen_px, projected_px):
    """Root mean square over the corners of their distance, px."""
    # BEGIN SOLUTION
    squares = ((seen_px - projected_px) ** 2).sum(axis=1)
    return np.sqrt(squares.mean())
    # END SOLUTION


exercises.check_rms(rms)

# %% [markdown]
# ### Exercise 4: which one do you trust?
#
# (a) three boards in the middle of the frame, RMS 0.05 px; (b) nineteen boards, tilted, all over the frame, 0.07 px;
# (c) twenty boards, all held parallel to the sensor, 0.06 px.

# %%
# BEGIN SOLUTION
# STUB: trusted = ...  # "a", "b" or "c"
trusted = "b"
# END SOLUTION
exercises.check_trust(trusted)

# %% [markdown]
# ### Try it
#
# Step through the boards, or jump to the worst one. The white strokes are the misses of its corners, many times
# enlarged. Random directions are noise of the finder; strokes that turn together over the board are something the
# model does not know, a bent sheet for instance. Do you find such a board?

# %% tags=["nbval-ignore-output"]
explore.boards(calibration, shipped.boards())

# %% [markdown]
# ## Undistort
#
# With the camera known, every pixel of an ideal picture can be looked up in the real one: `Camera.undistort` computes
# the table of where to look once and then only looks up. Straight edges must become straight. This is the test that
# needs no truth at all, and you can do it with your own camera:

# %% alt="The chessboard that fills the frame before and after: the dashed straight lines through the ends of its outer rows leave the corners before, and meet all of them after."
straight = camera.undistort_points(seen.corners_px).reshape(grid.shape)
outer = [(0, slice(None)), (-1, slice(None)), (slice(None), 0), (slice(None), -1)]
edges = [[corners[at][[0, -1]] for at in outer] for corners in (grid, straight)]
figures.before_after(picture, camera.undistort(picture), edges=edges)

# %%
before = [straightness_px(board.corners_px, board.corners_wh) for board in used]
after = [straightness_px(camera.undistort_points(board.corners_px), board.corners_wh)
         for board in used]
notebook.say(f"Corners lie **{max(before):.1f} px** (RMS) off straight lines on the worst board, "
             f"{np.median(before):.1f} px on a typical one. Undistorted it is "
             f"**{max(after):.2f} px** and {np.median(after):.2f} px: what remains is the finder's "
             "noise.")

# %% alt="A straight road before and after undistortion; they look nearly the same, only near the edges things move."
frame = read_image(shipped.test_images / "straight_lines1.jpg")
figures.before_after(frame, camera.undistort(frame))

# %% [markdown]
# On the road you hardly see it. That is the reason people skip the calibration, and the reason to measure.

# %% alt="The difference of the two pictures: dark in the middle, bright along everything near the edges."
figures.show(draw.difference(frame, camera.undistort(frame)), width=5.5)

# %% [markdown]
# ## What a wrong calibration costs
#
# Let the true camera look at points on the lines of its lane and on the far line of the next lane, and let wrong
# cameras say where on the road these are. Everybody knows the mounting; only the camera is wrong:
#
# - **calibrated**: ours, from the boards;
# - **no lens**: the true $K$, distortion left out;
# - **centre assumed**: the principal point put into the middle of the frame, as one does without a calibration;
# - **focal length 5 % off**: taken from a data sheet.
#
# **Predict:** order them by centimetres at 20 m.

# %%
ahead = np.array([8.0, 10, 15, 20, 25, 30, 40])
middle = [(true.size_wh[0] - 1) / 2, (true.size_wh[1] - 1) / 2]
assumed = true.camera_matrix.copy()
assumed[:2, 2] = middle
longer = true.camera_matrix * [[1.05, 1, 1], [1, 1.05, 1], [1, 1, 1]]
wrong = {
    "calibrated": camera,
    "no lens": Camera(true.camera_matrix, np.zeros(5), true.size_wh),
    "centre assumed": Camera(assumed, true.distortion, true.size_wh),
    "focal length 5 % off": Camera(longer, true.distortion, true.size_wh),
}

# %%
def sideways_cm(camera, line_x_m):
    """How far (cm) a line at x = line_x_m appears from its place, for each distance ahead."""
    road = np.column_stack([np.full(len(ahead), line_x_m), ahead])
    pixels = true.distort_points(rig.birdseye.points_from_road(road))
    view = BirdsEye.from_mounting(camera, **rig.mounting)
    return 100 * np.abs(view.road_from_points(camera.undistort_points(pixels))[:, 0] - line_x_m)


# %% alt="Sideways error over distance for four cameras, logarithmic. The calibrated one stays below 1 cm. Without the lens it is about a centimetre in the own lane and ten in the next. The assumed centre costs up to more than a metre."
costs = {name: (np.maximum(sideways_cm(one, -1.85), sideways_cm(one, 1.85)), sideways_cm(one, 5.55))
         for name, one in wrong.items()}
n01.road_cost(ahead, costs)

# %%
for name, (own, other) in costs.items():
    print(f"{name:21} at 20 m: {own[3]:5.1f} cm in the own lane, {other[3]:5.1f} cm in the next")

# %%
off_px = np.abs(true.camera_matrix[:2, 2] - middle)
yaw, pitch = np.arctan(off_px / np.diag(true.camera_matrix)[:2])
notebook.say(f"The assumed centre is {off_px[0]:.0f} px beside the true one, a yaw of "
             f"{np.degrees(yaw):.1f}°, which alone is {2000 * np.tan(yaw):.0f} cm at 20 m; and "
             f"{off_px[1]:.0f} px above it, a pitch of {np.degrees(pitch):.1f}°.")

# %% [markdown]
# Three things to take away, and none of them is what one expects before measuring:
#
# - The lens costs little in the own lane and much beside it. The lane lies near the middle of the frame, where the lens
#   hardly bends; whoever looks at two lanes, or has a wide lens, needs the coefficients.
# - A **principal point** that was only assumed costs most. Beside the true one it turns the camera, above or below it
#   tilts it, and tilt (pitch) is what distances hang on (notebook 03). A rig that is fitted to the lane lines *with* the
#   wrong centre absorbs most of it; one that was measured with a spirit level does not.
# - A wrong focal length stretches the road along the way. Sideways it nearly cancels: for a level camera
#   $x = h\,(u - c_x)/(v - c_y)$, without $f$ (notebook 03); what is left comes from the pitch.

# %% [markdown]
# ## Keep it
#
# A calibration is kept as readable JSON with the standard deviations and what became of each board, so that nobody has
# to ask later. `Camera.load` reads it; a picture of another size of the same camera needs `camera.scaled(size_wh)`.

# %%
with tempfile.TemporaryDirectory() as folder:
    file = calibration.save(Path(folder) / "calibration.json")
    numbers, half = json.loads(file.read_text()), Camera.load(file).scaled((640, 360))
print("fields of the file:", ", ".join(numbers))
print("of each board:", ", ".join(numbers["boards"][0]))
print(f"focal length {half.camera_matrix[0, 0]:.1f} px at {half.size_wh}")

# %% [markdown]
# ## What you have learned
#
# - $u = f X/Z + c$: a camera measures directions; $K$ turns them into pixels, five coefficients say what the lens does.
# - Corners are found to a few hundredths of a pixel, also on boards that the frame cuts off; those pin down the edges.
# - A high RMS is a warning; a low one is no praise. Look at the coverage, the standard deviations and straight edges.
# - Turn errors into centimetres on the road before deciding which of them matter.
#
# ## When it fails
#
# - **Few, small or parallel boards**: low RMS, wrong focal length. `calibrate` refuses boards that are all parallel.
# - **A bent board** (paper on a wall): the lens is blamed for the paper. Glue it to glass or a table top, or calibrate
#   with `flat=False`, which estimates the shape of the board, too.
# - **Autofocus, zoom, video stabilisation, a crop for video**: another camera each time. Calibrate in the mode you
#   drive in.
# - **Blur and glare**: corners of a moving board are off along the motion; the set's board 12 is out of focus and is
#   left out by name.
# - **More coefficients** lower the RMS on any set of boards and bend the picture where no board was.
#
# ## How production systems do it
#
# Each camera is calibrated at the end of the line in front of fixed targets, and for a wide lens with a model made for
# it (Kannala and Brandt's, or a spline per pixel), because Brown's polynomial folds over beyond about 45 degrees. On
# the road the calibration is watched: temperature and a new windscreen move it, and lines, vanishing points and the
# car's own motion tell. Nobody undistorts whole pictures: the lens is folded into the one table that makes the
# bird's-eye view (notebook 07), or only the points that matter are undistorted.
#
# ## Further reading
#
# - Z. Zhang, "A flexible new technique for camera calibration" (2000): short, and exactly what OpenCV does.
# - D. C. Brown, "Close-range camera calibration" (1971): where the five coefficients come from.
# - R. Hartley and A. Zisserman, *Multiple View Geometry*, chapters 6 to 8: cameras, planes and the homographies
#   between them.
# - K. H. Strobl and G. Hirzinger, "More accurate pinhole camera calibration with imperfect planar target" (2011): what
#   to do about paper.
# - T. Schöps and others, "Why having 10,000 parameters in your camera model is better than twelve" (2020): how far
#   five coefficients are from the end of it.
#
# ## Three questions
#
# 1. Your calibration has an RMS of 0.2 px. What do you look at before you trust it?
# 2. Why must boards be tilted? What is free when all are parallel to the sensor?
# 3. You calibrated with 4:3 photographs and drive with 16:9 video of the same telephone. What may be wrong?

# %% [markdown] tags=["answer"]
# 1. Where the corners lie in the frame (also at the edges?), whether the boards are tilted in different ways, the
#    standard deviations, and whether straight edges of pictures that were *not* used become straight.
# 2. A board parallel to the sensor at twice the distance, seen with twice the focal length, gives the same picture:
#    only the ratio of the two shows. A tilted board shows perspective, which tells them apart.
# 3. Video is often a crop of the sensor, so the principal point moves, and stabilisation crops and shifts it further
#    from frame to frame. The aspect ratio differs, which `camera.scaled` refuses; calibrate from the video itself.
