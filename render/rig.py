"""rigs/rendered.json: the true camera and where the road is, straight from the scene files."""

import numpy as np

from .files import write_json
from .lens import ROOT, true_lens
from .stills import describe
from .world import mounting_of


def write_rig(path=ROOT / "rigs" / "rendered.json"):
    """The rig of the rendered pictures: the mounting of the layouts, road_from_image exact."""
    lens, mounting = true_lens(), mounting_of(describe()[0])
    h = mounting.road_from_image(lens.camera_matrix)
    notes = (
        f"True camera and mounting of everything under */rendered/: {mounting.height_m} m above the road, pitch "
        f"{mounting.pitch_deg}, roll {mounting.roll_deg}, yaw {mounting.yaw_deg} degrees. Written by "
        f"`python -m render rig`; in the clips the car pitches by some tenths of a degree about it."
    )
    write_json(
        path,
        {
            "format": "lanelib-rig/1",
            "name": "rendered",
            "camera": lens.to_dict(),
            "road_from_image": np.round(h, 12).tolist(),
            "notes": notes,
        },
    )
    print(path.relative_to(ROOT))
