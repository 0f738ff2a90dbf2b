"""The true camera, read from scenes/camera.toml."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent


@dataclass(frozen=True)
class Lens:
    camera_matrix: np.ndarray
    distortion: np.ndarray
    size_wh: tuple[int, int]

    def to_dict(self) -> dict:
        """As it stands in calibration, rig and truth files."""
        return {
            "format": "lanelib-camera/1",
            "size_wh": list(self.size_wh),
            "camera_matrix": self.camera_matrix.tolist(),
            "distortion": self.distortion.tolist(),
        }


def true_lens() -> Lens:
    c = tomllib.loads((HERE / "scenes" / "camera.toml").read_text())
    return Lens(
        np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1]]),
        np.array(c["distortion"]),
        tuple(c["size_wh"]),
    )
