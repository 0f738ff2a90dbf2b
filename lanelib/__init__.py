"""lanelib: classical lane finding, measured against truth."""

from lanelib.birdseye import BirdsEye, Grid
from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder
from lanelib.lane import Lane, Line
from lanelib.result import LaneResult
from lanelib.rig import Rig
from lanelib.tracking import LaneTracker

__version__ = "0.1.0"
__all__ = [
    "BirdsEye",
    "Camera",
    "Grid",
    "Lane",
    "LaneFinder",
    "LaneResult",
    "LaneTracker",
    "LanelibError",
    "Line",
    "Rig",
]
