"""Labels and predictions of lanes: JSON lines in the TuSimple layout, or a `truth.json`.

One object per frame: {"raw_file": NAME, "h_samples": [y, ...], "lanes": [[x, ...], [x, ...]]}: left and right boundary
of the ego lane in pixels of the frame as given, -2 where a line is not seen; more keys may follow. A frame stands once.
"""

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lanelib.camera import Camera
from lanelib.errors import LanelibError
from lanelib.files import read_text
from lanelib.truth import LARGEST, check_tags, load_truth, load_truth_camera, no_constant

MAX_FILE_BYTES = 500_000_000  # half a million frames; more is not a file of predictions


def read_rows(path: str | Path) -> dict[str, dict]:
    """JSON lines in the TuSimple layout, by `raw_file` ("-": of standard input).

    Raises LanelibError that names the file, the line and what is wrong.
    """
    path = Path(path)
    try:
        if str(path) != "-" and path.stat().st_size > MAX_FILE_BYTES:
            raise LanelibError(f"{path}: needed at most {MAX_FILE_BYTES >> 20} MB of JSON lines, found more; split it")
        text = _standard_input() if str(path) == "-" else read_text(path, max_bytes=MAX_FILE_BYTES)
        lines = text.splitlines()
    except OSError as error:
        raise LanelibError(f"{path}: needed a file of JSON lines, found: {error.strerror}; check the name") from None
    except UnicodeDecodeError:
        raise LanelibError(
            f"{path}: needed JSON lines in UTF-8, found something that is no text of this kind; check the name (what "
            "PowerShell writes with > is UTF-16: let --json write the file)"
        ) from None
    rows: dict[str, dict] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            row = json.loads(line, parse_constant=no_constant)
            _check_row(row)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
            raise LanelibError(f"{path}:{number}: needed an object with raw_file, h_samples, lanes: {what}") from None
        if rows.setdefault(row["raw_file"], row) is not row:
            again = f"needed one line for each frame, found {row['raw_file']!r} again; leave one out"
            raise LanelibError(f"{path}:{number}: {again}")
    if not rows:
        raise LanelibError(f"{path}: needed at least one line of JSON, found an empty file; check the name")
    return rows


def _standard_input() -> str:
    """All of it, as `read_text` reads a file: on Windows a pipe would be read in the letters of a code page."""
    return sys.stdin.buffer.read().decode("utf-8-sig")


def read_labels(path: str | Path) -> tuple[dict[str, dict], Camera | None]:
    """Labels by `raw_file`: JSON lines, or a `truth.json` (or its folder), which brings its camera."""
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    if path.is_dir() or path.name == "truth.json":
        return load_truth(folder), Camera.from_dict(load_truth_camera(folder))
    return read_rows(path), None


def _check_row(row: dict) -> None:
    if not isinstance(row, dict):
        raise ValueError("found no object")
    kinds = {"raw_file": str, "h_samples": list, "lanes": list}
    if not all(isinstance(row[key], kind) for key, kind in kinds.items()):
        raise ValueError("found raw_file that is no text, or h_samples or lanes that are no lists")
    length = len(_finite(row["h_samples"]))
    extra = row.get("extrap", [])
    if any(len(_finite(line)) != length for line in [*row["lanes"], *extra]):
        raise ValueError("found a line of another length than h_samples")
    if "extrap" in row and len(extra) < min(len(row["lanes"]), 2):
        raise ValueError("found an extrap of fewer lines than lanes")
    size = _finite(row.get("size", [1280, 720]))
    if len(size) != 2 or not size.min() > 0:
        raise ValueError("found a size that is not [width, height]")
    for key in ("offset_m", "curvature_1pm", "lane_width_m", "time_s"):
        if row.get(key) is not None and not (isinstance(row[key], int | float) and abs(row[key]) < LARGEST):
            raise ValueError(f"found {key} that is no number below {LARGEST:.0e}")
    check_tags(row)


def _finite(values: list) -> np.ndarray:
    array = np.asarray(values)
    if array.ndim != 1 or array.dtype.kind not in "iuf" or not (np.abs(array.astype(float)) < LARGEST).all():
        raise ValueError(f"found something else than a list of finite numbers, below {LARGEST:.0e}")
    return array


def line_points(row: Mapping, lane: int) -> tuple[np.ndarray, np.ndarray]:
    """(y, x) of the seen points of a line, ascending in y."""
    if lane >= len(row["lanes"]):
        return np.empty(0), np.empty(0)
    y, x = np.asarray(row["h_samples"], float), np.asarray(row["lanes"][lane], float)
    seen = x >= 0
    if "extrap" in row:  # rows in which the labeller only prolonged the line
        seen &= np.asarray(row["extrap"][lane]) == 0
    order = np.argsort(y[seen], kind="stable")
    return y[seen][order], x[seen][order]


def x_at(row: Mapping, lane: int, rows_px) -> np.ndarray:
    """x of a line at rows, between its points only; NaN elsewhere."""
    y, x = line_points(row, lane)
    if len(y) < 2:
        return np.full(np.shape(rows_px), math.nan)
    return np.interp(rows_px, y, x, left=math.nan, right=math.nan)
