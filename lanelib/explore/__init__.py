"""Live explorers for notebooks: move a control, see picture and numbers change within a tenth of a second.

distortion, boards      what a lens does; the chessboards of a calibration and the error of each
threshold               a channel or gradient, its range, precision and recall; a recipe and its code
warp                    the four corners of the bird's-eye view, dragged on the picture
detect                  windows, margins, models: the stages of one frame
smoothing               a recorded clip smoothed in four ways, against truth
scrub                   any frame and stage of a clip; the worst frames
simulator               a road of your making, and what the pipeline says about it

Each returns a widget (`Explorer`) whose callback calls a plain function (`threshold_look`, …) that gives a `Look`:
the picture and the numbers, made by the same functions of lanelib as in the text.
"""

from lanelib.explore.chessboards import board_look, boards
from lanelib.explore.corners import warp, warp_look
from lanelib.explore.detection import Frame, detect, detect_look
from lanelib.explore.kit import Explorer
from lanelib.explore.lens import distortion, distortion_look
from lanelib.explore.look import Look, Reading
from lanelib.explore.masks import threshold, threshold_look
from lanelib.explore.painttruth import PaintTruth, paint_truth
from lanelib.explore.roads import scene_of, simulated_rig, simulator, simulator_look
from lanelib.explore.scrubber import Clip, look_through, scrub, scrub_clip, scrub_look
from lanelib.explore.smoothers import smoothed, smoothing, smoothing_look
from lanelib.explore.steps import Step, combined, recipe_code

__all__ = [
    "Clip",
    "Explorer",
    "Frame",
    "Look",
    "PaintTruth",
    "Reading",
    "Step",
    "board_look",
    "boards",
    "combined",
    "detect",
    "detect_look",
    "distortion",
    "distortion_look",
    "look_through",
    "paint_truth",
    "recipe_code",
    "scene_of",
    "scrub",
    "scrub_clip",
    "scrub_look",
    "simulated_rig",
    "simulator",
    "simulator_look",
    "smoothed",
    "smoothing",
    "smoothing_look",
    "threshold",
    "threshold_look",
    "warp",
    "warp_look",
]
