"""Notebook 02; see README.md here for the format."""
# %% [markdown]
# # 02 Threshold
#
# Before anything can be fitted, someone has to say which pixels are paint. A number that separates paint from road in
# the morning finds nothing under a bridge and half the road on concrete. This notebook asks what makes paint *paint*,
# and measures every answer against the true paint, pixel by pixel.
#
# **What you will do:** compare colour channels and gradients; build the three classic recipes and the project's own;
# score each on easy and hard frames with precision and recall.
#
# **What you will learn:** which properties of paint survive a change of light; why one threshold fails; what local
# normalisation is and does.
#
# **What you need:** notebook 00; the shipped road pictures; Python.
#
# **Minutes:** 30 to read and run, 60 with the exercises.

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

from lanelib import Rig, datasets, draw, exercises, explore, figures
from lanelib.channels import CHANNELS, equalise_lightness, in_range
from lanelib.figures import n02
from lanelib.paint import STRONG_Z, paint_evidence
from lanelib.pictures import read_image
from lanelib.rig import View
from lanelib.threshold import RECIPES, paint_ridges, paint_steps, scale_to_255, sobel, stripe_widths

shipped = datasets.get("rendered")
truth = shipped.image_truth()

# %%
def load(name):
    """A frame and its true paint."""
    frame = read_image(shipped.test_images / name)
    return frame, explore.paint_truth(truth[name], (frame.shape[1], frame.shape[0]))


# %% [markdown]
# ## A visible failure first
#
# White and yellow paint are both bright in red. On dark asphalt in the sun, "red of 180 and more" looks like the
# answer. **Before you run the next cell:** what will the same number do on pale concrete? And when a cloud passes?

# %% alt="Right: the mask of red above 180 on concrete; a good part of the road is vermillion, false alarms, and the paint can hardly be told from it."
sunny, sunny_paint = load("test3.jpg")
concrete, concrete_paint = load("test5.jpg")
red = in_range(CHANNELS["rgb_r"](concrete), 180, 255)
n02.masks(concrete, {"red of 180 and more": red}, concrete_paint)

# %%
cloudy = cv2.convertScaleAbs(sunny, alpha=0.6)
for name, frame, paint in (("asphalt", sunny, sunny_paint), ("concrete", concrete, concrete_paint),
                           ("asphalt, 0.6 times the light", cloudy, sunny_paint)):
    found = in_range(CHANNELS["rgb_r"](frame), 180, 255)
    print(f"{name:29} paint found {(found[paint.paint] > 0).mean():.2f}, road taken for paint "
          f"{(found[paint.road & ~paint.paint] > 0).mean():.3f}")

# %% [markdown]
# Green is paint that was found, blue is paint that was missed, vermillion is road taken for paint. The number was right
# for one road and one light. On concrete it floods; with a cloud before the sun it is blind; and nothing in the picture
# says so.

# %% [markdown]
# ## How good is a mask?
#
# Let $M$ be the pixels of the mask and $P$ the pixels that are painted. Two numbers, because there are two ways to
# fail:
#
# $$\text{precision} = \frac{|M \cap P|}{|M|}, \qquad \text{recall} = \frac{|M \cap P|}{|P|}, \qquad
# F_1 = \frac{2}{1/\text{precision} + 1/\text{recall}}$$
#
# Precision asks how much of what was found is paint; recall, how much of the paint was found. A mask that is all white
# has recall 1; a single right pixel has precision 1. $F_1$, their harmonic mean, is high only when both are.
#
# Where $P$ comes from: these frames are rendered, so the place of both lines of the ego lane (the one the car is in) is
# known exactly. A mask is judged on the road between the lines and a metre beyond; other lanes' paint is neither right
# nor wrong. (Chipped paint counts as painted, and of a double line only the inner stripe is the lane's: on such frames
# no mask reaches 1.)
#
# ### Exercise 1: precision and recall
#
# Write both. A mask may be bool, 0/1 or 0/255.

# %%
def precision_recall(mask, paint):
    """(precision, recall) of a mask against the paint, two arrays of one shape; not 0 means yes."""
    # BEGIN SOLUTION
    found, painted = mask != 0, paint != 0
    hits = (found & painted).sum()
    return hits / found.sum(), hits / painted.sum()
    # END SOLUTION


exercises.check_precision_recall(precision_recall)

# %% [markdown]
# ## What makes paint paint
#
# Look at one row of three frames. Where the truth is shaded, what do the curves have in common in all three?

# %% alt="Brightness and yellowness along a row of three frames. At the left line both have a narrow peak, at the right line only the brightness has; its height and the level beside it differ from frame to frame."
bridge, bridge_paint = load("shadow_overpass.jpg")
n02.profiles({"asphalt in the sun": sunny, "concrete": concrete, "concrete, stained": bridge},
             (sunny_paint, concrete_paint, bridge_paint), row=620)

# %% [markdown]
# The *height* of the peaks is not the same, nor is the level of the road. What stays is this:
#
# 1. **Brighter or yellower than the road beside it.** White paint reflects about 0.7 of the light, asphalt 0.1,
#    concrete 0.3. Light falls on both alike, so their *ratio* stays when the sun goes.
# 2. **On both sides.** The edge of a shadow or of the concrete is a step, not a peak.
# 3. **Narrow, and of a known width.** Lines are 10 to 15 cm wide by regulation (4 to 6 inches in the USA); a car is
#    not.
# 4. **Long.** A line goes on; a stone does not.
#
# Classic thresholds use only the first, and without "beside".

# %% [markdown]
# ## Colour spaces side by side
#
# A colour space is another set of axes for the same colours. Three that people use, with $M = \max(R,G,B)$ and
# $m = \min(R,G,B)$:
#
# $$\text{HLS:}\quad L = \frac{M+m}{2}, \quad S = \frac{M-m}{\min(M+m,\ 510-M-m)}, \qquad
# \text{HSV:}\quad V = M, \quad S = \frac{M-m}{M}, \qquad \text{LAB: } L,\ a,\ b \text{ as the eye judges them}$$
#
# (HSV's H is the hue as an angle. YUV is television's: Y the brightness, U how much bluer than that, V how much redder.)
#
# **Predict:** in which channel is yellow paint on concrete easiest to see? And which one does not show white at all?

# %% alt="Five channels of the concrete frame with their histograms: in red and L the road is nearly as bright as the paint; S and b show the yellow line brightly and the white one not at all."
figures.channels(concrete, ["rgb_r", "rgb_b", "hls_l", "hls_s", "lab_b"])

# %% alt="Five more channels: hue is noise on the grey road, S of HSV shows yellow, V is like red, U of YUV shows yellow dark, lightness of LAB is like L of HLS."
figures.channels(concrete, ["hsv_h", "hsv_s", "hsv_v", "lab_l", "yuv_u"])

# %% [markdown]
# Yellow stands out in S and in b, and is *dark* in blue. White is bright in all of R, G, B and in L, and has hardly any
# colour of its own, so b does not show it. (S may, for a bad reason: near white the denominator of HLS is small, and
# the slightest tint is a large S.) No single channel does both well.
#
# Which channel separates best? Take a pixel of paint and a pixel of road at random: how often is the paint the
# higher one (where paint is the darker: the lower one)? 1.00 means that *some* threshold separates them perfectly; 0.50
# is a coin. (This share is known as the area under the ROC curve.)

# %% alt="A table of shades, channels against paints, how often paint and road are told apart: on asphalt everything is near 1; on concrete L of HLS falls to about 0.65 for yellow and b to about 0.5 for white."
def side_of(paint, frame, side):
    """The paint of one line only, and the road judged."""
    columns = np.arange(frame.shape[1])[None, :]
    near = columns < 640 if side == "left" else columns >= 640
    return paint.paint & near, paint.road & near


roads = {"asphalt": (sunny, sunny_paint), "concrete": (concrete, concrete_paint),
         "bridge": (bridge, bridge_paint)}
samples = [("yellow", "asphalt", "left"), ("yellow", "concrete", "left"),
           ("yellow", "bridge", "left"), ("white", "asphalt", "right"),
           ("white", "concrete", "right")]
sides = [side_of(*roads[road][::-1], side) for _, road, side in samples]
names = ["grey", "rgb_r", "rgb_b", "hls_l", "hls_s", "hsv_v", "lab_l", "lab_b", "yuv_u"]
n02.separations({f"{paint},\n{road}": roads[road][0] for paint, road, _ in samples},
                *zip(*sides, strict=True), names=names)

# %% [markdown]
# On dark asphalt everything separates. On concrete the columns part: $L$ of HLS hardly sees yellow any more, and $b$
# does not see white. Recipes therefore join one channel for each colour. Now the catch: separable by *some* threshold
# does not mean by *the same* threshold:

# %% alt="F1 over the threshold on the red channel for four frames: the curves peak at different thresholds, and the threshold that is best for one frame is poor for another."
roads["asphalt at half the light"] = cv2.convertScaleAbs(sunny, alpha=0.5), sunny_paint
n02.best_thresholds({name: CHANNELS["rgb_r"](frame) for name, (frame, _) in roads.items()},
                    [paint for _, paint in roads.values()])

# %% [markdown]
# At half the light the best threshold is half as high, and one fixed at 200 finds nothing at all. On concrete the hill
# is narrow: 20 grey levels lower and the road floods in. There is no number under all four hills.
#
# **S has a fault of its own.** It divides by the brightness, so in dark pixels a difference of three grey levels is a
# large saturation. Here are the road pixels of all frames, no paint among them, sorted by lightness:

# %%
frames = [load(path.name) for path in shipped.images() if truth.get(path.name, {}).get("lanes")]
light, saturation = (
    np.concatenate([CHANNELS[name](frame)[paint.road & ~paint.paint] for frame, paint in frames])
    for name in ("hls_l", "hls_s"))
for low, high in ((0, 50), (50, 80), (80, 140)):
    here = saturation[(light >= low) & (light < high)]
    print(f"L from {low:3} to {high:3}: mean S of the road {here.mean():3.0f}, "
          f"spread {here.std():3.0f}")

# %% [markdown]
# The same grey road is "colourful" in the shade. A threshold on S must be high enough for that, and then misses faded
# yellow in the sun.

# %% [markdown]
# ## Gradients
#
# An edge is where grey levels change. Sobel's kernels differentiate in one direction and smooth in the other:
#
# $$G_x = \frac18\begin{pmatrix}-1&0&1\\-2&0&2\\-1&0&1\end{pmatrix} * I, \qquad
# G_y = \frac18\begin{pmatrix}-1&-2&-1\\0&0&0\\1&2&1\end{pmatrix} * I, \qquad
# |G| = \sqrt{G_x^2+G_y^2}, \quad \theta = \arctan\frac{|G_y|}{|G_x|}$$
#
# The $\frac18$ makes a ramp of one grey level per pixel give exactly 1. Compute in float: in `uint8`, 3 - 5 is 254, and
# dark-to-bright edges look different from bright-to-dark ones.

# %% alt="A part of the frame and its gradients: Sobel x shows both edges of each line, the magnitude also the edge of the shadow across the road, the direction is noise on all of the road."
shade, shade_paint = load("test4.jpg")
part = shade[410:680, 220:1020]
n02.gradients(part, sobel(CHANNELS["grey"](part)))

# %% [markdown]
# Gradients do not care how bright the road is, which is why they survive shade better than colours. But they answer to
# *every* edge: shadows, seams, cars, the far horizon. Each line gives two edges and a hole between. And the direction
# of nearly nothing is noise: on flat asphalt, $\theta$ is random, so a direction mask alone is salt and pepper.
#
# Scaling by the largest gradient in the frame, as most pipelines do, has a trap of its own: **predict** what happens to
# the mask of the lines when a black and white sign comes into view.

# %%
signed = sunny.copy()
signed[300:340, 900:960], signed[305:335, 920:940] = 255, 0
for name, frame in (("as it is", sunny), ("with a sign", signed)):
    values = scale_to_255(sobel(CHANNELS["grey"](frame)).x)
    print(f"{name:12} paint above 30 of 255: {(values[sunny_paint.paint] > 30).mean():.2f}")

# %% [markdown]
# One sign beside the road takes half of the line's pixels away, with nothing changed on the road. (The share is small
# even without it: a gradient finds the two edges of a stripe, not its inside.)
#
# ### Exercise 2: a ridge
#
# A step has one bright side, paint has two dark ones. For a row of grey levels (`uint8`), return at each pixel the
# centre minus the *brighter* of the two pixels `distance` to its left and right. Beyond the ends, repeat the last
# pixel. Take care of what `uint8` does below zero.

# %%
def ridge_of_row(row, distance):
    """Centre minus the brighter side, an array of the row's length; negative in a valley."""
    # BEGIN SOLUTION
    padded = np.pad(row.astype(float), distance, mode="edge")
    left_side, right_side = padded[: -2 * distance], padded[2 * distance :]
    return row - np.maximum(left_side, right_side)
    # END SOLUTION


exercises.check_ridge(ridge_of_row)

# %% [markdown]
# ## CLAHE
#
# *Contrast limited adaptive histogram equalisation* spreads the grey levels of each of 8 × 8 tiles over the whole
# scale, by at most `clip_limit` times, so that shade and sun become similar. **Predict:** what else becomes stronger?

# %% alt="The bridge frame before and after CLAHE: the road in the shadow becomes lighter, and stains and texture of the concrete become visible as well."
lifted = equalise_lightness(bridge)
figures.before_after(bridge[330:690], lifted[330:690], ("as it is", "after CLAHE"))

# %%
near = slice(540, 660)
for name, frame in (("as it is", bridge), ("after CLAHE", lifted)):
    lightness = CHANNELS["lab_l"](frame).astype(float)[near]
    on, road = bridge_paint.paint[near], bridge_paint.road[near]
    of_paint, of_road = lightness[on], lightness[road & ~on]
    print(f"{name:12} paint minus road {of_paint.mean() - of_road.mean():3.0f} grey levels, "
          f"spread of the road {of_road.std():3.0f}")

# %% [markdown]
# The paint gains contrast, and the road gains more: its stains spread over twice the range. CLAHE does not know what
# paint is. It is a tool to *look* into shade, and a doubtful one to decide in it.

# %% [markdown]
# ## The three classic recipes
#
# Most pipelines you will find are one of these, with other numbers:
#
# - **gradient or colour**: (Sobel x AND magnitude AND direction) OR (S OR R);
# - **gradient and colour**: a gradient AND (HLS OR HSV OR LAB): both must agree;
# - **CLAHE, colour, Sobel**: after CLAHE, white OR yellow OR Sobel x, gaps closed.
#
# OR collects everyone's false alarms, AND everyone's misses. The steps of the first, on an easy frame:

# %% alt="Masks of an easy frame: the gradient finds the rims of the lines and misses their inside, colour finds nearly all of both lines, their union has a little more recall and many more false alarms beside the lines."
steps = RECIPES["sobel-or-colour"].steps(sunny)
shown = {name: steps[name] for name in ("gradient", "colour", "gradient OR colour")}
n02.masks(sunny, shown, sunny_paint)

# %% [markdown]
# The gradient finds the rims of the lines, most of them just outside the paint, and a false strip along the left
# shoulder. On this easy frame colour alone beats the whole recipe; the gradient is in it for the frames on which colour
# fails.
#
# And all three, with the project's own, on a hard frame: joints, cracks and stains on sunlit concrete.

# %% alt="Four masks of a frame with seams in concrete: two of the three classic recipes show cracks and joints in vermillion, the project's own nearly only paint."
seams, seams_paint = load("concrete_seams.jpg")
n02.masks(seams, {recipe.title: recipe.function(seams) for recipe in RECIPES.values()}, seams_paint)

# %% [markdown]
# Every crack has two edges, so it is a line to the recipes that trust gradients alone. Ours finds both lines and no
# crack; of each stripe it takes only the middle, hence the modest recall.

# %% [markdown]
# ## Local normalisation
#
# Our recipe writes the first three properties of paint down as one number. At each pixel take three boxes as wide as
# paint is in that row: $c$ on the pixel, $l$ and $r$ at its sides. Then
#
# $$\text{ridge} = \frac{c - \max(l, r)}{\max\left(2\,\overline{t},\ 0.08\,\overline{b}\right)}, \qquad
# t = \left|c - \tfrac{l + r}{2}\right|$$
#
# The numerator: **brighter than both sides**. A step gives 0, because one side is as bright as the centre; a dark
# crack gives less than 0. In the denominator, averages over 16 widths around: $\overline b$ the brightness of the road,
# so that half the light changes numerator and denominator alike; $\overline t$ its texture, so that among leaves and
# gravel, where everything is a small ridge, only a large one counts. Paint is where the ridge is 1 or more, and, for the
# fourth property, where such pixels hang together over a tenth of their distance at least.
#
# - **0.08**: worn paint on concrete differs by 10 %, seams and patches by up to 5 %; the limit is between. (The program
#   adds 4 grey levels to $\overline b$, so that noise in the dark is no contrast.)
# - **2**: a stripe must be twice what is usual around it.
# - **Width**: on a flat road the scale of a row grows with its distance $d$ from the horizon, as scale $= d / h$ pixels
#   per metre for a camera at height $h$ (derived in notebook 03). 10 cm of paint seen from 1.2 m are $0.08\,d$ pixels.
#
# The same is computed with yellowness $\min(R, G) - B$ in place of brightness; either may say "paint".

# %% alt="One row of the concrete frame: brightness wanders up and down with stains; the ridge is above 1 at the true paint and nearly nowhere else."
row = 600
bright, yellow = paint_ridges(seams)
blue, green, red = cv2.split(seams.astype(np.float32))
n02.ridge_along_row(((red + green) / 2)[row], np.maximum(bright, yellow)[row],
                    seams_paint.paint[row], int(stripe_widths(720)[row]))

# %% [markdown]
# Stains and cracks move the brightness as much as paint does. The ridge passes 1 at the two lines only: a crack is
# darker than its sides, a stain is wider than the boxes. And it passes 1 only in the *middle* of a line, where the box
# is full of paint. The steps, in order, on the frame with which we began:

# %% alt="Masks of the steps: brighter on both sides, yellower on both sides, either, and only long pieces; the last has hardly any false alarm left."
n02.masks(concrete, paint_steps(concrete), concrete_paint)

# %% [markdown]
# ## All recipes on all frames
#
# Each point is one recipe on one frame; upper right is good, hollow marks are the hard frames. **Predict:** which
# recipe has the best recall on easy frames? Which loses most on the hard ones?

# %% alt="Precision against recall: the project's own recipe lies in the upper right on easy frames; the classic ones lie at lower precision or lower recall; on hard frames all points move towards the lower left."
names = [path.name for path in shipped.images() if truth.get(path.name, {}).get("lanes")]
hard = datasets.tagged(truth, "hard")
loaded = {name: load(name) for name in names}
scores = {recipe.title: {name: paint.score(recipe.function(frame))
                         for name, (frame, paint) in loaded.items()}
          for recipe in RECIPES.values()}
n02.precision_and_recall(scores, hard)

# %%
def mean_scores(by_frame, names):
    """Means of precision and of recall over these frames; a mask without a pixel counts as 0."""
    return np.nan_to_num([by_frame[name] for name in names]).mean(axis=0)


kinds = [[n for n in names if (n in hard) == is_hard] for is_hard in (False, True)]
means = {title: [mean_scores(by_frame, kind) for kind in kinds]
         for title, by_frame in scores.items()}
for title, ((p, r), (hard_p, hard_r)) in means.items():
    print(f"{title:22} easy: precision {p:.2f}, recall {r:.2f}   hard: {hard_p:.2f}, {hard_r:.2f}")

# %%
lost = {title: easy.round(2) - hard.round(2) for title, (easy, hard) in means.items()}
most = [max(lost, key=lambda title, i=i: lost[title][i]) for i in (0, 1)]
ours = lost[RECIPES["paint"].title]
notebook.say(f"On the hard frames *{most[0]}* loses most precision, {lost[most[0]][0]:.2f}, and "
             f"*{most[1]}* most recall, {lost[most[1]][1]:.2f}. The project's own loses "
             f"{ours[0]:.2f} and {ours[1]:.2f}.")

# %% [markdown]
# What the numbers say: OR finds much and believes too much. AND finds a quarter of the paint, for colour and edge meet
# only at the rim of a line. CLAHE has the best recall of the classic ones and poor precision on hard frames.
# Asking for the *shape* of paint keeps precision high everywhere; what it loses on the hard frames is recall, mostly
# where the paint itself is chipped away. That is the better way to fail: a fit can bridge a gap, but not a false line.
#
# ### Less light
#
# Multiply all frames by a factor, as clouds and dusk do (and noise aside). **Predict:** which recipe does not care?

# %% alt="Recall over the light on the easy frames: the classic recipes lose half of their recall at 0.8 times the light, the project's own stays level down to a quarter."
lights = (1.0, 0.8, 0.6, 0.45, 0.35, 0.25)
easy = [loaded[name] for name in names if name not in hard][:4]
recall = {recipe.title: [] for recipe in RECIPES.values()}
for recipe in RECIPES.values():
    for light in lights:
        darker = [(cv2.convertScaleAbs(frame, alpha=light), paint) for frame, paint in easy]
        scored = [paint.score(recipe.function(frame)) for frame, paint in darker]
        recall[recipe.title].append(np.mean(scored, axis=0)[1])
figures.curves(lights, recall, xlabel="light, times the original", ylabel="mean recall",
               title="when the light fades")

# %% [markdown]
# Dividing by the local brightness pays off: half the light halves numerator and denominator, and nothing changes.
# The colour thresholds of the classic recipes give up at the first cloud; what remains of them is their gradients,
# which are scaled by the frame's largest one.

# %% [markdown]
# ## The same idea, where the width is constant
#
# In the picture the width of paint changes with the row. In a bird's-eye view (notebook 03) it does not: 15 cm are as
# many pixels near and far. The finder therefore measures its evidence there, with nearly the same formula
# (`lanelib.paint`): $z$ = ridge / (local texture + 2 grey levels). And it does not even threshold: $z$ becomes a
# *weight* between 0 and 1, so that faint paint has a small say instead of none. (Far away the rows of this view are
# squeezed, so a gentle bend looks like a hook; notebook 07 says why.)

# %% alt="The hard concrete frame from above and its evidence: a bright stripe where the solid line is, bright pieces where the dashes are, fainter streaks from seams and cracks."
view = View(Rig.load(shipped.rig_file))
scan = view.scan(seams)
z = paint_evidence(scan, column_m=view.grid.column_m)
wide = f"columns of {100 * view.grid.column_m:.0f} cm"
figures.show({f"from above, {wide}": scan, "z": draw.heat(z, top=STRONG_Z)}, columns=2)

# %% [markdown]
# ## Try it
#
# Choose a source, drag the range over its histogram (the paint's own is drawn in it), watch precision and recall. Add
# steps to a recipe; its code stands below, ready to be copied. Can you beat the classic ones on this frame? Then try
# your recipe on another frame, without touching it.

# %% tags=["nbval-ignore-output"]
explore.threshold(shade, truth["test4.jpg"])

# %% alt="The frame of the explorer and a mask found with it: red of 200 and more, or b of 155 and more."
mine = cv2.bitwise_or(in_range(CHANNELS["rgb_r"](shade), 200, 255),
                      in_range(CHANNELS["lab_b"](shade), 155, 255))
n02.masks(shade, {"R of 200 and more OR b of 155 and more": mine}, shade_paint)

# %% [markdown]
# ### Exercise 3: yellow, by day and in the shade
#
# Write a mask for yellow paint that works in the sun *and* at half the light. The checker draws a road with a yellow and
# a white line, then halves all its values as above, and asks for precision and recall of 0.55 each time. Frames are BGR.

# %%
def yellow_mask(frame_bgr):
    """Mask (H, W) of yellow paint; bool, 0/1 or 0/255."""
    # BEGIN SOLUTION
    b, g, r = (frame_bgr[:, :, i].astype(float) for i in range(3))
    return np.minimum(r, g) - b > 0.3 * (r + g) / 2  # a share of the brightness, not grey levels
    # END SOLUTION


exercises.check_yellow(yellow_mask)

# %% [markdown]
# ## What you have learned
#
# - Precision and recall are two numbers because there are two ways to fail; measure both, on frames you did not tune
#   on.
# - Yellow is in $b$ (or S), white in R or L; no fixed threshold on any of them survives a change of road and light.
# - Gradients forget the brightness but find every edge; OR adds false alarms, AND adds misses; CLAHE lifts everything.
# - Paint is a *narrow ridge, brighter or yellower than both sides, compared with what is around it*.
#
# ## When it fails
#
# - **Paint that is gone** cannot be found, whatever the recipe; wet roads at night mirror the lamps and drown it.
# - **Other narrow bright things**: tar seams shining against the sun, tyre tracks in snow, light between the posts of a
#   guard rail. They are ridges. Only the geometry of the lane (notebook 04) tells them from lines.
# - **Wider markings** than 2.5 widths (gores, arrows, crossings) are no ridges for these boxes.
# - **Burnt-out pixels**: where the sensor is at 255, paint and concrete are the same, and no formula brings it back.
#
# ## How production systems do it
#
# For two decades, with filters like this one: "dark-light-dark" in a bird's-eye view, followed by a geometric model.
# Today a convolutional network marks the pixels or the lines directly. It has learned the same four properties, plus
# context: it knows that a line continues behind a car. It still needs the geometry after it, it needs labels by the
# hundred thousand, and it fails in ways that no formula explains; so many systems run a classic check beside it.
#
# ## Further reading
#
# - M. Bertozzi and A. Broggi, "GOLD: a parallel real-time stereo vision system" (1998): dark-light-dark from above.
# - T. Veit and others, "Evaluation of road marking feature extraction" (2008): compares such filters on real frames;
#   the symmetrical local threshold wins.
# - K. Zuiderveld, "Contrast limited adaptive histogram equalization", *Graphics Gems IV* (1994).
# - J. Davis and M. Goadrich, "The relationship between precision-recall and ROC curves" (2006): which curve to draw
#   when.
#
# ## Three questions
#
# 1. A colleague reports a mask with 99 % of all pixels right. Why does this say nothing?
# 2. Why does the recipe compare with the brighter side and not with the mean of both?
# 3. Your recall is 0.5 and your precision 0.95. Which would you try to raise before fitting lines, and why?

# %% [markdown] tags=["answer"]
# 1. Paint is about one pixel in a hundred: an empty mask is 99 % right, too. Precision and recall leave out the
#    pixels that are neither found nor paint.
# 2. At the edge of a shadow the mean lies halfway, so every such edge would be a ridge on its bright side. The brighter
#    side makes it zero.
# 3. Neither needs raising first. A fit can bridge missing paint (dashes are missing three quarters of the way), but false
#    pixels that lie on a line of their own pull it away. Below a few metres of paint per line, recall begins to matter.
