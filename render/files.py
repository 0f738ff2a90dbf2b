"""Writing: temporary name in the same folder, then renamed; truth files updated entry by entry."""

import hashlib
import json
import os
import re
from pathlib import Path

import cv2
import numpy as np

from .lens import HERE, true_lens

KEYS = HERE / "rendered.json"  # what was rendered from which description: picture name -> hash


def write_bytes(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    temporary.write_bytes(data)
    os.replace(temporary, path)


def write_json(path: Path, content: dict, *, indent: int | None = 1) -> None:
    """JSON with lists of numbers on one line."""
    text = json.dumps(content, indent=indent)
    if indent:
        text = re.sub(r"\[\s+(?=[-\d])([^\[\]{}]*?)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m[1]) + "]", text)
    write_bytes(path, (text + "\n").encode())


def write_jpeg(path: Path, frame_bgr: np.ndarray, quality: int = 92) -> None:
    ok, data = cv2.imencode(".jpg", frame_bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert ok
    write_bytes(path, data.tobytes())


def update_truth(path: Path, kind: str, entry: dict, order: list[str]) -> None:
    """Put one entry of `frames` or `boards` into a truth file, in the order of the scene file."""
    truth = json.loads(path.read_text()) if path.exists() else {"format": "lanelib-truth/1"}
    entries = {e["raw_file"]: e for e in truth.get(kind, [])} | {entry["raw_file"]: entry}
    truth["camera"] = true_lens().to_dict()
    truth[kind] = [entries[name] for name in order if name in entries]
    write_json(path, truth)


def scene_key(*parts) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def is_current(name: str, key: str, path: Path) -> bool:
    return path.exists() and KEYS.exists() and json.loads(KEYS.read_text()).get(name) == key


def remember(name: str, key: str) -> None:
    keys = json.loads(KEYS.read_text()) if KEYS.exists() else {}
    write_json(KEYS, dict(sorted((keys | {name: key}).items())))
