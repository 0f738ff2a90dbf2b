"""Which pictures there are: the only module that knows the folders.

A data set is a sub-folder of the same name in the three input folders of a project::

    camera_cal/<set>/   test_images/<set>/   test_videos/<set>/      in (any of the three may be absent)
    output_images/<set>/   output_videos/<set>/                      out
    rigs/<set>.json                                                  the camera and how it is mounted

`rendered` comes with the repository, `udacity` and `finding_lanes` are brought by `lanelib fetch udacity`.
A folder of one's own with the same layout is named by the environment variable LANELIB_DATA; its sets are found
first, and their results are written beside them.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lanelib.errors import LanelibError
from lanelib.files import files_in
from lanelib.pictures import PICTURE_SUFFIXES, pictures_in
from lanelib.truth import load_truth

INPUTS = ("camera_cal", "test_images", "test_videos")
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm")


@dataclass(frozen=True)
class DataSet:
    """One named set of chessboards, pictures and videos; its folders need not all exist."""

    name: str
    root: Path
    """The project's folder or LANELIB_DATA: where the folders of the set are."""
    rig_file: Path
    """`rigs/<name>.json` in `root`, else the project's own; it may not exist (see `has_rig`)."""

    @property
    def camera_cal(self) -> Path:
        """The folder of chessboard pictures."""
        return self.root / "camera_cal" / self.name

    @property
    def test_images(self) -> Path:
        """The folder of road pictures."""
        return self.root / "test_images" / self.name

    @property
    def test_videos(self) -> Path:
        """The folder of clips."""
        return self.root / "test_videos" / self.name

    @property
    def output_images(self) -> Path:
        """The folder for annotated pictures (made by whoever writes there)."""
        return self.root / "output_images" / self.name

    @property
    def output_videos(self) -> Path:
        """The folder for annotated clips (made by whoever writes there)."""
        return self.root / "output_videos" / self.name

    @property
    def has_rig(self) -> bool:
        """Whether the rig's file is there."""
        return self.rig_file.is_file()

    def boards(self) -> list[Path]:
        """The chessboard pictures, `calibration2` before `calibration10`."""
        return pictures_in(self.camera_cal)

    def images(self) -> list[Path]:
        """The road pictures in natural order."""
        return pictures_in(self.test_images)

    def videos(self) -> list[Path]:
        """The clips in natural order."""
        return files_in(self.test_videos, VIDEO_SUFFIXES)

    def board_truth(self) -> dict[str, dict]:
        """Truth of the chessboards by file name; empty where the set has none."""
        return _truth_or_nothing(self.camera_cal)

    def image_truth(self) -> dict[str, dict]:
        """Truth of the road pictures by file name; empty where the set has none."""
        return _truth_or_nothing(self.test_images)

    def video_truth(self) -> dict[str, dict]:
        """Truth of the clips by `NAME.mp4:FRAME` (six digits); empty where the set has none."""
        return _truth_or_nothing(self.test_videos)

    def __str__(self) -> str:
        """One line: how much of what."""
        counts = f"{len(self.boards())} chessboards, {len(self.images())} pictures, {len(self.videos())} videos"
        return f"{self.name}: {counts}, {'a rig' if self.has_rig else 'no rig'}"


def available() -> tuple[str, ...]:
    """Names of the sets that hold at least one picture or clip, in alphabetical order.

    >>> all(get(name).name == name for name in available())
    True
    """
    return tuple(sorted({name for root in roots() for name in _sets_in(root)}))


def get(name: str) -> DataSet:
    """The set of that name; one's own (LANELIB_DATA) before the project's.

    Raises LanelibError where no folder holds such a set, and where neither a checkout nor LANELIB_DATA is there.
    """
    for root in roots():
        if name in _sets_in(root):
            rigs = [folder / "rigs" / f"{name}.json" for folder in (root, *roots())]
            return DataSet(name=name, root=root, rig_file=next((rig for rig in rigs if rig.is_file()), rigs[0]))
    have = ", ".join(available()) or "none"
    hint = "`lanelib fetch udacity` brings it" if name in ("udacity", "finding_lanes") else "see LANELIB_DATA"
    raise LanelibError(f"a data set of pictures or videos is needed, {name!r} is not there (there: {have}); {hint}")


def roots() -> tuple[Path, ...]:
    """The folders in which sets are looked for: LANELIB_DATA if set, then the project's own.

    Raises LanelibError where LANELIB_DATA names no folder, or where there is neither.
    """
    if stands_alone():
        project_root()
    found = []
    if own := os.environ.get("LANELIB_DATA"):
        folder = Path(own).expanduser().resolve()
        if not folder.is_dir():
            raise LanelibError(f"LANELIB_DATA must name a folder with test_images/ and the like, {own!r} is none")
        found.append(folder)
    if is_checkout(_project()):
        found.append(_project())
    return tuple(dict.fromkeys(found))


def stands_alone() -> bool:
    """Whether there is nowhere to look: the package is in no checkout, and LANELIB_DATA is not set."""
    return not os.environ.get("LANELIB_DATA") and not is_checkout(_project())


def project_root() -> Path:
    """The checkout this package was installed from (`pip install -e .`, which is what `make` does).

    Raises LanelibError where the package stands alone, without the project's folders.
    """
    if not is_checkout(_project()):
        raise LanelibError(
            f"the project's folders are needed beside the package, {_project()} has none: clone the repository and"
            " run `make`, or set LANELIB_DATA to a folder with camera_cal/, test_images/, test_videos/"
        )
    return _project()


def is_checkout(folder: Path) -> bool:
    """Whether a folder is a checkout of this project rather than, say, site-packages."""
    return (folder / "pyproject.toml").is_file() and (folder / "lanelib" / "datasets.py").is_file()


def tagged(truth: Mapping[str, dict], *tags: str) -> list[str]:
    """Names of the pictures or frames of `truth` that carry all these tags.

    >>> tagged({"a.jpg": {"tags": ["rain", "night"]}, "b.jpg": {"tags": ["rain"]}, "c.jpg": {}}, "rain")
    ['a.jpg', 'b.jpg']
    """
    return [name for name, frame in truth.items() if set(tags) <= set(frame.get("tags", ()))]


def _project() -> Path:
    return Path(__file__).resolve().parents[1]


def _sets_in(root: Path) -> set[str]:
    names = set()
    for kind in INPUTS:
        folder = root / kind
        for sub in folder.iterdir() if folder.is_dir() else ():
            if sub.is_dir() and sub.name[0] != "." and files_in(sub, PICTURE_SUFFIXES + VIDEO_SUFFIXES):
                names.add(sub.name)
    return names


def _truth_or_nothing(folder: Path) -> dict[str, dict]:
    return load_truth(folder) if (folder / "truth.json").exists() else {}
