"""Which rig belongs to which pictures, where nobody says it.

A rig describes a camera and its mounting. Pictures of a data set have the rig of their set; for others every known rig
whose proportions fit is tried on a few frames. The finder forgives a rig that is a degree off: it tilts the road and
stretches the lane until they fit, with nearly the same confidence. So the rig is taken that needs the least of that.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanelib import datasets
from lanelib.camera import ASPECT_TOLERANCE
from lanelib.errors import LanelibError
from lanelib.finder import LaneFinder, Rig
from lanelib.jointfit import HEADING, PITCH, UNKNOWN_ROAD, WIDTH
from lanelib.pictures import read_image
from lanelib.video import probe, read_frames

TRIAL_FRAMES = 8  # a median of eight bears three frames without a lane
LEAST_CONFIDENCE = 0.3  # one clear line alone gives 0.67 (jointfit.confidence_of); half of that is no lane but a guess
# Standard deviations of a median over frames under the right rig. Pitch (rad): load and speed tilt a car by 0.3
# degrees. Heading (rad): a car follows its lane, but not in bends. Width (m): as the finder believes.
STRAIN_STD = {PITCH: 0.005, HEADING: 0.03, WIDTH: math.sqrt(UNKNOWN_ROAD.covariance[WIDTH, WIDTH])}


@dataclass(frozen=True, eq=False)
class RigChoice:
    """A rig and why it was taken."""

    rig: Rig
    reason: str

    def __str__(self) -> str:
        """One line."""
        return f"rig {self.rig.name}: {self.reason}"


def known_rigs() -> tuple[Path, ...]:
    """Files of the rigs in `rigs/` of one's own data and of the project; of two with one name the first.

    Raises LanelibError where LANELIB_DATA names no folder.
    """
    if datasets.stands_alone():
        return ()
    folders = [root / "rigs" for root in datasets.roots()]
    files = [path for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.json"))]
    return tuple({path.name: path for path in reversed(files)}.values())[::-1]


def all_known() -> list[Rig]:
    """The known rigs themselves."""
    return [Rig.load(path) for path in known_rigs()]


def load_rig(name: str | Path) -> Rig:
    """A rig by its file or, where there is no such file, by the name of a known one ("udacity")."""
    known = {path.stem: path for path in known_rigs()}
    if not Path(name).exists() and str(name) in known:
        return Rig.load(known[str(name)])
    try:
        return Rig.load(name)
    except LanelibError as error:
        more = f" (known by name: {', '.join(sorted(known))})" if known and not Path(name).exists() else ""
        raise LanelibError(f"{error}{more}") from None


def set_of(path: str | Path) -> datasets.DataSet | None:
    """The data set in one of whose folders the file lies, or None; LanelibError where LANELIB_DATA names no folder."""
    if datasets.stands_alone():
        return None
    path = Path(path).resolve()
    for name in datasets.available():
        found = datasets.get(name)
        if path.parent in [folder.resolve() for folder in (found.camera_cal, found.test_images, found.test_videos)]:
            return found
    return None


def rig_of_set(path: str | Path) -> RigChoice | None:
    """The rig of the data set that the file lies in, or None."""
    found = set_of(path)
    if found is None or not found.has_rig:
        return None
    return RigChoice(Rig.load(found.rig_file), f"the file is of the set {found.name}")


def fits(rig: Rig, size_wh: Sequence[int]) -> bool:
    """Whether pictures of this size have the proportions of the rig's camera."""
    (w, h), (rig_w, rig_h) = size_wh, rig.size_wh
    return abs(w * rig_h / (h * rig_w) - 1) <= ASPECT_TOLERANCE


def check_fits(rig: Rig, size_wh: Sequence[int], name: str | Path) -> None:
    """LanelibError where a picture or video `name` of this size cannot be of the rig's camera, or shows it no road."""
    if not fits(rig, size_wh):
        raise LanelibError(
            f"{name}: needed pictures in the proportions of the rig {rig.name!r} ({rig.size_wh[0]}x{rig.size_wh[1]}), "
            f"found {size_wh[0]}x{size_wh[1]}; make one of this camera with `lanelib rig` and give it (--rig; "
            "rigs/SET.json for a data set)"
        )
    _ = rig.scaled(size_wh).scan_grid  # raises where there is no road in view


@dataclass(frozen=True, eq=False)
class Trial:
    """How a rig did on some frames: the median `confidence` 0..1, and the `strain`: how many standard deviations the
    finder had to tilt the road, turn the car and stretch the lane, in the median, to make it fit."""

    rig: Rig
    confidence: float
    strain: float

    @property
    def score(self) -> float:
        """Confidence times exp(-strain^2 / 2): the higher, the better the rig."""
        return self.confidence * math.exp(-(self.strain**2) / 2)

    def __str__(self) -> str:
        """One line."""
        return f"{self.rig.name} {self.confidence:.2f}/{self.strain:.1f}"


def try_rig(rig: Rig, frames: Sequence[np.ndarray]) -> Trial:
    """Run the finder with this rig on frames (H, W, 3) BGR, each on its own."""
    finder = LaneFinder(rig, track=False)
    results = [finder.process(frame) for frame in frames]
    states = np.array([result.fit.mean for result in results if result.fit is not None])
    if not len(states):
        return Trial(rig, 0.0, 0.0)
    off = (np.median(states, axis=0) - UNKNOWN_ROAD.mean)[list(STRAIN_STD)] / list(STRAIN_STD.values())
    return Trial(rig, float(np.median([result.confidence for result in results])), float(np.linalg.norm(off)))


def choose_rig(frames: Sequence[np.ndarray], rigs: Iterable[Rig]) -> RigChoice:
    """The rig under which the finder, each frame on its own, is most confident with the least strain (see `Trial`).

    `frames`: (H, W, 3) uint8 BGR, of one camera; at most `TRIAL_FRAMES` of them, evenly spread, are looked at. Raises
    LanelibError where there are no frames, no rig has their proportions, or none makes the finder see a lane.
    """
    if not len(frames):
        raise LanelibError("choosing a rig: needed at least one picture, found none; name the rig (--rig)")
    rigs = list(rigs)
    height, width = frames[0].shape[:2]
    fitting = [rig for rig in rigs if fits(rig, (width, height))]
    if not fitting:
        found = ", ".join(f"{r.name} {r.size_wh[0]}x{r.size_wh[1]}" for r in rigs) or "none"
        raise LanelibError(
            f"needed a rig for pictures of {width}x{height}, found none in these proportions (there: {found}); "
            "make one with `lanelib rig FRAME --camera none -o RIG`"
        )
    some = [frames[i] for i in spread(len(frames), TRIAL_FRAMES)]
    trials = sorted((try_rig(rig, some) for rig in fitting), key=lambda trial: -trial.score)
    best = trials[0]
    if best.confidence < LEAST_CONFIDENCE:
        raise LanelibError(
            f"needed a rig that fits these pictures, found none (the best, {best.rig.name}, sees lanes with confidence "
            f"{best.confidence:.2f}); make one with `lanelib rig FRAME --camera none -o RIG`"
        )
    beside = f"; others: {', '.join(map(str, trials[1:]))}" if trials[1:] else ""
    frames_said = f"{len(some)} frame{'s' if len(some) > 1 else ''}"
    return RigChoice(
        best.rig,
        f"fits best, confidence {best.confidence:.2f} with a strain of {best.strain:.1f} over {frames_said}{beside}",
    )


def spread(n: int, count: int) -> list[int]:
    """At most `count` of the indices 0 .. n - 1, evenly spread.

    >>> spread(10, 4)
    [1, 3, 6, 8]
    """
    return list(range(n)) if n <= count else [int((i + 0.5) * n / count) for i in range(count)]


def frames_of_video(path: str | Path, count: int = TRIAL_FRAMES) -> list[np.ndarray]:
    """Up to `count` frames (BGR), evenly spread over a video as far as it can be read.

    Of its beginning where it does not say how long it is, or cannot be read in its middle. Raises LanelibError where it
    cannot be read at all.
    """
    info, frames = probe(path), []
    if info.n_frames > 4 * count and info.duration_s > 0:
        for i in range(count):
            start_s = (i + 0.5) / count * info.duration_s
            # what is cut off ends before; nobody asks for the frames' numbers
            with suppress(LanelibError), read_frames(path, start_s=start_s, numbered=False) as reader:
                frames += [frame.frame_bgr for frame in itertools.islice(reader, 1)]
    return frames or _first_frames(path, count)


def _first_frames(path: str | Path, count: int) -> list[np.ndarray]:
    """Every fourth frame from the beginning of a video; of a short one up to `count`, evenly spread."""
    with read_frames(path) as reader:
        frames = [frame.frame_bgr for frame in itertools.islice(reader, 4 * count)]
    return [frames[i] for i in spread(len(frames), count)]


class RigChooser:
    """The rig for each picture: the one given, that of its data set, or the known one that explains them best."""

    def __init__(self, given: str | None, pictures: list[Path], say: Callable[[object], None]):
        self._given = None if given is None else load_rig(given)
        self._pictures, self._say = pictures, say
        self._of_folder: dict[Path, Rig | None] = {}
        self._of_shape: dict[float, Rig] = {}

    def for_picture(self, path: Path, frame: np.ndarray) -> Rig:
        """LanelibError where no rig fits the picture."""
        size_wh = frame.shape[1::-1]
        chosen = self._given or self._from_set(path)
        if chosen is None:
            shape = round(size_wh[0] / size_wh[1], 2)
            if shape not in self._of_shape:
                choice = choose_rig(self._trial(path, frame, shape), all_known())
                self._of_shape[shape] = choice.rig
                self._say(choice)
            chosen = self._of_shape[shape]
        check_fits(chosen, size_wh, path)
        return chosen

    def _from_set(self, path: Path) -> Rig | None:
        folder = path.resolve().parent
        if folder not in self._of_folder:
            choice = rig_of_set(path)
            if choice:
                self._say(choice)
            self._of_folder[folder] = choice.rig if choice else None
        return self._of_folder[folder]

    def _trial(self, path: Path, frame: np.ndarray, shape: float) -> list[np.ndarray]:
        """The picture and others of the same proportions, as far as they can be read."""
        others = [p for p in self._pictures if p != path and self._of_folder.get(p.resolve().parent) is None]
        frames = [frame]
        for i in spread(len(others), TRIAL_FRAMES - 1):
            with suppress(LanelibError):  # said when its turn comes
                other = read_image(others[i])
                if round(other.shape[1] / other.shape[0], 2) == shape:
                    frames.append(other)
        return frames
