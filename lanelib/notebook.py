"""What every notebook of the course needs and no program: the set-up check, a clip, a video in the page, computed text.

    notebook.start()            first cell: checks what is needed, says what to run where it is missing
    notebook.road("test5.jpg")  a road picture of the shipped set, and its truth
    notebook.clip()             a short drive with its truth: the shipped one, else one made by the simulator
    notebook.play(frames)       frames as a video in the notebook
    notebook.say(f"… {x:.2f}")  a sentence with computed numbers, as text of the page
"""

from __future__ import annotations

import base64
import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from lanelib import datasets
from lanelib.errors import LanelibError
from lanelib.finder import Rig
from lanelib.pictures import read_image
from lanelib.road import CarPose, Mounting, Road
from lanelib.simulator import Scene, render_road
from lanelib.truth import FORMAT
from lanelib.video import VideoWriter, read_frames

SET = "rendered"  # the set that is shipped: rendered pictures whose truth is known exactly
JPEG_QUALITY = 80  # of stored figures: a road picture 10 in wide takes about 60 kB, and nobody sees the difference
# Change it when the simulated drive changes, or how videos are written: the old one is then made again
SIMULATED = "simulated_v4"
SPEED_MPS, FPS = 25.0, 25.0  # 90 km/h at 25 frames a second: 1 m a frame


def start(*needs: str):
    """Check that the shipped set is there, set up figures, and say so in one line.

    ``needs``: any of "boards", "images", "videos", "rig" (default: images and rig). Raises LanelibError that names
    what is missing and the command that brings it.
    """
    needs = needs or ("images", "rig")
    try:
        shipped = datasets.get(SET)
    except LanelibError:
        raise LanelibError(_missing("the pictures", f"{datasets.INPUTS[1]}/{SET}")) from None
    found = {
        "boards": (bool(shipped.boards() and shipped.board_truth()), "the chessboards", shipped.camera_cal),
        "images": (bool(shipped.images() and shipped.image_truth()), "the road pictures", shipped.test_images),
        "videos": (bool(shipped.videos() and shipped.video_truth()), "the clips", shipped.test_videos),
        "rig": (shipped.has_rig, "the rig", shipped.rig_file),
    }
    for need in needs:
        if need not in found:
            raise LanelibError(f"a need must be one of {', '.join(found)}, found {need!r}")
        there, what, path = found[need]
        if not there:
            raise LanelibError(_missing(what, path.relative_to(shipped.root).as_posix()))
    _figures_as_jpeg()
    return say("✓ All that this notebook needs is here.")


def _missing(what: str, path: str) -> str:
    return f"{what} of the shipped set are needed in {path}, not found; run `git checkout -- {path}` in the project"


def _figures_as_jpeg() -> None:
    """Figures are stored as JPEG: an eighth of the size of PNG."""
    from IPython import get_ipython

    if get_ipython() is not None:
        from matplotlib_inline.backend_inline import set_matplotlib_formats

        set_matplotlib_formats("jpeg", pil_kwargs={"quality": JPEG_QUALITY})


class Text(str):
    """Markdown that a notebook shows as text."""

    def _repr_markdown_(self) -> str:
        return str(self)

    def __repr__(self) -> str:
        return str(self)


def say(text: str) -> Text:
    """``text``, Markdown, as the value of a cell's last line; put computed numbers into it with an f-string."""
    return Text(text)


def road(name: str) -> tuple[np.ndarray, dict]:
    """A road picture of the shipped set by its name: (frame (H, W, 3) uint8 BGR, its frame of the truth file)."""
    shipped = datasets.get(SET)
    truth = shipped.image_truth()
    if name not in truth:
        there = ", ".join(truth)
        raise LanelibError(f"a picture of the set {shipped.name} is needed, found {name!r}; there: {there}")
    return read_image(shipped.test_images / name), truth[name]


@dataclass(frozen=True)
class Clip:
    """A drive: the video's file, the rig it was taken with, and the truth of each frame in order."""

    path: Path
    rig: Rig
    truth: list[dict]
    fps: float

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[np.ndarray]:
        """Frames ``start`` to ``stop`` (not included), each (H, W, 3) uint8 BGR."""
        with read_frames(self.path, start_s=max(0.0, (start - 0.5) / self.fps)) as reader:
            for frame in islice(reader, None if stop is None else max(0, stop - start)):
                yield frame.frame_bgr

    def frame(self, index: int) -> np.ndarray:
        """One frame, (H, W, 3) uint8 BGR."""
        return next(self.frames(index, index + 1))

    def __len__(self) -> int:
        return len(self.truth)

    def __repr__(self) -> str:
        return f"Clip({self.path.name}, {len(self)} frames, {len(self) / self.fps:.0f} s)"


def clip(name: str = "project_video.mp4") -> Clip:
    """The shipped clip of that name; where there is none, 6 s of road by the simulator (made once, then kept)."""
    shipped = datasets.get(SET)
    rig = Rig.load(shipped.rig_file)
    paths = {path.name: path for path in shipped.videos()}
    truth = [frame for key, frame in shipped.video_truth().items() if key.startswith(f"{name}:")]
    if name in paths and truth:
        return Clip(paths[name], rig, truth, _fps(truth))
    return _simulated(rig)


def _fps(truth: list[dict]) -> float:
    """Frames a second, from the times of the first and the last one."""
    times = [float(frame["time_s"]) for frame in truth if "time_s" in frame]
    if len(times) < 2:
        return FPS
    return (len(times) - 1) / (times[-1] - times[0])


def _simulated(rig: Rig) -> Clip:
    folder, rig = _cache() / SIMULATED, rig.scaled((640, 360))
    if not (folder / "truth.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as own:  # several notebooks may do this at a time
            _make_simulated(rig, Path(own))
            for name in ("simulated.mp4", "truth.json"):
                with suppress(PermissionError):  # Windows, where another one has made it and shows it just now
                    os.replace(Path(own) / name, folder / name)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["frames"]
    return Clip(folder / "simulated.mp4", rig, truth, FPS)


def _make_simulated(rig: Rig, folder: Path) -> None:
    truth = []
    with VideoWriter(folder / "simulated.mp4", fps=FPS, preset="medium", crf=18) as writer:
        for index, (frame, entry) in enumerate(simulate(rig, seconds=6)):
            writer.write(frame)
            truth.append(entry | {"raw_file": f"simulated.mp4:{index:06}", "time_s": index / FPS})
    text = json.dumps({"format": FORMAT, "camera": rig.camera.to_dict(), "frames": truth})
    (folder / "truth.json").write_text(text, encoding="utf-8")


def simulate(rig: Rig, *, seconds: float, seed: int = 0) -> Iterator[tuple[np.ndarray, dict]]:
    """A drive with this rig, frame by frame with its truth: straight, a bend to the left of 600 m, shade, straight."""
    bend = Road([0, 30, 70, 130, 170, 400], [0, 0, 1 / 600, 1 / 600, 0, 0])
    camera, mounting = rig.camera, rig.mounting
    for index in range(round(seconds * FPS)):
        s = index * SPEED_MPS / FPS
        bounce = 0.12 * np.sin(2 * np.pi * 1.4 * index / FPS)  # a car's body on its springs: 1 to 2 Hz
        yield render_road(
            Scene(
                road=bend,
                pose=CarPose(s, 0.25 * np.sin(s / 31), 0.25 / 31 * np.cos(s / 31)),
                mounting=Mounting(**{**mounting, "pitch_deg": mounting["pitch_deg"] + bounce}),
                size_wh=camera.size_wh,
                camera_matrix=tuple(map(tuple, camera.camera_matrix)),
                distortion=tuple(camera.distortion),
                shade_m=((120.0, 150.0),),
                concrete_m=((65.0, 95.0),),
                seed=seed + index,
            )
        )


def _cache() -> Path:
    """A folder for what can be made again."""
    folder = datasets.project_root() / ".cache"
    try:
        folder.mkdir(exist_ok=True)
    except OSError:
        return Path(tempfile.gettempdir()) / "lanelib"
    return folder


class Player:
    """A video that a notebook shows as a player."""

    def __init__(self, mp4: bytes, alt: str, width: int):
        self.mp4, self.alt, self.width = mp4, alt, width

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.mp4).decode()
        return (
            f'<video controls loop muted playsinline width="{self.width}" aria-label="{escape(self.alt)}">'
            f'<source src="data:video/mp4;base64,{data}" type="video/mp4">{escape(self.alt)}</video>'
        )

    def __repr__(self) -> str:
        return f"a video: {self.alt}"


def play(frames: Iterable[np.ndarray], *, alt: str, fps: float = FPS, width: int = 480, crf: float = 31) -> Player:
    """Frames (H, W, 3) uint8 BGR as a video that plays in the page (H.264, yuv420p, no file left behind).

    ``width``, ``crf``: 4 s of a drive at 480 px and 31 take 100-300 kB, so the notebook stays small. ``alt`` says in a
    sentence what is to be seen. Raises LanelibError where there is no frame.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "play.mp4"
        with VideoWriter(path, fps=fps, preset="medium", crf=crf) as writer:
            for frame in frames:
                height = round(frame.shape[0] * width / frame.shape[1] / 2) * 2
                writer.write(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA))
        return Player(path.read_bytes(), alt, width)
