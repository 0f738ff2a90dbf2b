"""lanelib: classical lane finding, measured against truth."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
_MODULES = {"BirdsEye": "birdseye", "Grid": "birdseye", "Camera": "camera", "LanelibError": "errors",
            "LaneFinder": "finder", "Lane": "lane", "Line": "lane", "LaneResult": "result", "Rig": "rig",
            "LaneTracker": "tracking"}


def __getattr__(name: str) -> object:
    """A name is looked up when it is first used: the command line answers --help, and Ctrl-C, without OpenCV."""
    if name not in _MODULES:
        raise AttributeError(f"module 'lanelib' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"lanelib.{_MODULES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
