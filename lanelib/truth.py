"""The exact truth beside rendered pictures: `truth.json`, read and checked (format: docs/ARCHITECTURE.md, Files)."""

import json
from pathlib import Path, PurePosixPath

from lanelib.errors import LanelibError
from lanelib.files import read_text

FORMAT = "lanelib-truth/1"
MAX_BYTES = 200_000_000  # sixty times the truth of the shipped clips (3 kB a frame, 1,000 frames)
LARGEST = 1e9  # no picture has so many pixels and no road so many metres
_NUMBERS = ("curvature_1pm", "offset_m", "lane_width_m")
_MOUNTING = ("height_m", "pitch_deg", "roll_deg", "yaw_deg")


def load_truth(folder: Path | str) -> dict[str, dict]:
    """Frames (or chessboards) of `folder/truth.json` by their `raw_file`, in the file's order.

    Each value is the JSON object as it stands there, after these checks: names are inside the folder and stand
    once; a frame's `lanes` are none or two, each as long as `h_samples`, of finite numbers; `visible`, where
    given, has their shape and holds 0 and 1; a frame with lanes has `radius_m` (positive, or null: straight),
    `curvature_1pm`, `offset_m` and `lane_width_m`, and with `lanes_road_m`, two lines of points, `heading_rad` and
    `mounting`; `time_s`, where given, is a number, `tags` are words; a board has `rvec`, `tvec`, `square_m` and
    `board_wh`.

    Raises LanelibError naming the file, the entry and what is wrong with it.
    """
    document, path = _read(Path(folder))
    kinds = [kind for kind in ("frames", "boards") if kind in document]
    if len(kinds) != 1 or not isinstance(document[kinds[0]], list):
        raise LanelibError(f"{path}: a list of 'frames' or of 'boards' is needed, found {sorted(document)}")
    check = _check_frame if kinds[0] == "frames" else _check_board
    truth: dict[str, dict] = {}
    for number, entry in enumerate(document[kinds[0]]):
        try:
            name = _name_of(entry)
            if name in truth:
                raise ValueError("a second entry of that raw_file")
            check(entry)
        except (ValueError, TypeError, KeyError) as error:
            what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
            label = entry.get("raw_file", "") if isinstance(entry, dict) else ""
            raise LanelibError(f"{path}: entry {number} of {kinds[0]} ({label!r}): {what}") from None
        truth[name] = entry
    return truth


def load_truth_camera(folder: Path | str) -> dict:
    """The camera of `folder/truth.json` as it stands there: `size_wh`, `camera_matrix`, `distortion`.

    Raises LanelibError where there is none.
    """
    document, path = _read(Path(folder))
    camera = document.get("camera")
    if not isinstance(camera, dict) or not {"size_wh", "camera_matrix", "distortion"} <= set(camera):
        found = "none" if camera is None else f"{camera!r:.60}"
        raise LanelibError(f"{path}: 'camera' with size_wh, camera_matrix, distortion is needed, found {found}")
    return camera


def _read(folder: Path) -> tuple[dict, Path]:
    path = folder / "truth.json"
    try:
        if path.stat().st_size > MAX_BYTES:
            raise LanelibError(f"{path}: at most {MAX_BYTES} bytes are read, it has {path.stat().st_size}")
        document = json.loads(read_text(path, max_bytes=MAX_BYTES), parse_constant=no_constant)
    except LanelibError:
        raise
    except OSError as error:
        raise LanelibError(f"{path}: the truth of a folder's pictures is needed: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise LanelibError(f"{path}: JSON is needed, found something else ({error})") from None
    found = document.get("format") if isinstance(document, dict) else type(document).__name__
    if found != FORMAT:
        raise LanelibError(f"{path}: format {FORMAT!r} is needed, found {found!r}")
    return document, path


def no_constant(text: str) -> float:
    """For `json.loads`: NaN and Infinity, which are not JSON, are refused."""
    raise ValueError(f"{text} is not a number")


def _name_of(entry: dict) -> str:
    if not isinstance(entry, dict):
        raise ValueError("an object is needed")
    name = entry["raw_file"]
    if not isinstance(name, str) or not name or "\\" in name:
        raise ValueError("raw_file must be a file's name")
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise ValueError("raw_file must lie inside the folder")
    return name


def _check_frame(frame: dict) -> None:
    rows = _numbers(frame["h_samples"], "h_samples")
    lanes = frame["lanes"]
    if not isinstance(lanes, list) or len(lanes) not in (0, 2):
        raise ValueError("lanes must be [] or [left, right]")
    for lane in lanes:
        _numbers(lane, "a line of lanes", length=len(rows))
    if "visible" in frame:
        if not isinstance(frame["visible"], list) or len(frame["visible"]) != len(lanes):
            raise ValueError("visible must have as many lines as lanes")
        for line in frame["visible"]:
            if not set(_numbers(line, "a line of visible", length=len(rows))) <= {0, 1}:
                raise ValueError("visible must be of 0 and 1")
    if lanes:
        _numbers([frame[key] for key in _NUMBERS], "/".join(_NUMBERS))
        if (radius_m := frame["radius_m"]) is not None and not _numbers([radius_m], "radius_m")[0] > 0:
            raise ValueError("radius_m must be positive, or null where the road is straight")
        if not frame["lane_width_m"] > 0:
            raise ValueError("lane_width_m must be positive")
        if "lanes_road_m" in frame:
            _check_road(frame)
    if "time_s" in frame:
        _numbers([frame["time_s"]], "time_s")
    check_tags(frame)


def _check_road(frame: dict) -> None:
    """What the metres of a frame are measured with."""
    lines = frame["lanes_road_m"]
    if not isinstance(lines, list) or len(lines) != 2 or not all(isinstance(line, list) for line in lines):
        raise ValueError("lanes_road_m must be [left, right]")
    for point in (*lines[0], *lines[1]):
        _numbers(point, "a point of lanes_road_m", length=2)
    _numbers([frame["heading_rad"]], "heading_rad")
    mounting = frame["mounting"]
    if not isinstance(mounting, dict) or not set(mounting) <= set(_MOUNTING):
        raise ValueError(f"mounting must be of {', '.join(_MOUNTING)}")
    _numbers(list(mounting.values()), "mounting")
    if not mounting["height_m"] > 0:
        raise ValueError("height_m must be positive")


def check_tags(frame: dict) -> None:
    """ValueError where the `tags` of a frame, if it has any, are no list of words."""
    tags = frame.get("tags", [])
    if not isinstance(tags, list) or not all(isinstance(tag, str) for tag in tags):
        raise ValueError("tags must be a list of words")


def _check_board(board: dict) -> None:
    _numbers(board["rvec"], "rvec", length=3)
    _numbers(board["tvec"], "tvec", length=3)
    if not min(_numbers([board["square_m"], *board["board_wh"]], "square_m and board_wh", length=3)) > 0:
        raise ValueError("square_m and board_wh must be positive")


def _numbers(values: list, what: str, length: int | None = None) -> list[float]:
    if not isinstance(values, list) or (length is not None and len(values) != length):
        raise ValueError(f"{what} must be a list" + ("" if length is None else f" of {length} numbers"))
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < LARGEST for v in values):
        raise ValueError(f"{what} must be finite numbers, below {LARGEST:.0e}")
    return values
