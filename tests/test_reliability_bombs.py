"""Decompression bombs: a small file that says it is a huge picture or film is refused by its header, size named.

Each is tried in a process that may take 1.5 GB of address space: what it says must fit into memory that no bomb does.
"""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import clips
import cv2
import numpy as np
import pytest
import test_fuzz as fuzz

from lanelib import cli, rigs
from lanelib.errors import LanelibError
from lanelib.pictures import read_image

ROOT = Path(__file__).resolve().parents[1]
HUGE_WH = (60000, 50000)  # 3 gigapixels: 9 GB once decoded
LIMIT_BYTES = 1_500_000_000


def png(size_wh, *, bits=1) -> bytes:
    """A flawless grey PNG of zeros: at one bit a pixel 3 gigapixels are 375 MB, which pack into 400 kB."""
    width, height = size_wh
    packer = zlib.compressobj(9)
    row = bytes(1 + (width * bits + 7) // 8)
    body = b"".join(packer.compress(row * min(500, height - y)) for y in range(0, height, 500))
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)), (b"IDAT", body + packer.flush()),
              (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def jpeg(size_wh) -> bytes:
    """A small JPEG whose frame header (SOF0: length, precision, height, width) states another size."""
    data = cv2.imencode(".jpg", np.zeros((90, 160, 3), np.uint8))[1].tobytes()
    return data.replace(struct.pack(">BHH", 8, 90, 160), struct.pack(">BHH", 8, size_wh[1], size_wh[0]))


def bmp(size_wh) -> bytes:
    data = cv2.imencode(".bmp", np.zeros((9, 16, 3), np.uint8))[1].tobytes()
    return data[:18] + struct.pack("<ii", *size_wh) + data[26:]


PICTURES = {"bomb.png": lambda: png(HUGE_WH), "bomb.jpg": lambda: jpeg(HUGE_WH), "bomb.bmp": lambda: bmp(HUGE_WH)}


@pytest.mark.parametrize("name", PICTURES)
def test_a_huge_picture_is_refused_with_its_size(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rigs.datasets, "roots", lambda: ())
    Path(name).write_bytes(PICTURES[name]())
    assert Path(name).stat().st_size < 1_000_000
    fuzz.RIG.save("rig.json")

    def never(*_):
        raise AssertionError("it was decoded")

    monkeypatch.setattr(cv2, "imdecode", never)
    with pytest.raises(LanelibError, match="at most 120 megapixels, found 60000x50000"):
        read_image(name)
    for line in (f"image {name} --rig rig.json -o out.png", f"calibrate {name} -o out.json"):
        assert cli.main(line.split()) == 2
        said = capsys.readouterr()
        assert "60000x50000" in said.err + said.out and not list(tmp_path.glob("*out*"))


def film(path: Path, codec: str, size_wh) -> Path:
    """A small film whose container, and whose pictures where they say it, state another size."""
    clips.clip(path, n_frames=3, codec=codec, pix_fmt={"png": "rgb24", "mjpeg": "yuvj420p"}.get(codec, "yuv420p"))
    data = path.read_bytes()
    for was, now in ((struct.pack(">HH", 96, 160), struct.pack(">HH", size_wh[1], size_wh[0])),
                     (struct.pack(">HH", 160, 96), struct.pack(">HH", *size_wh)),
                     (struct.pack("<ii", 160, 96), struct.pack("<ii", *size_wh)),
                     (struct.pack(">II", 160, 96), struct.pack(">II", *size_wh))):
        data = data.replace(was, now)
    path.write_bytes(data)
    return path


PROGRAM = """
import resource, sys
from lanelib.errors import LanelibError
from lanelib.video import read_frames
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)  # ffmpeg inherits it
try:
    with read_frames(sys.argv[1]) as frames:
        print("frames", sum(1 for _ in frames))
except LanelibError as error:
    print("refused", error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a limit on memory, as Unix has it")
@pytest.mark.parametrize("name, codec", [
    ("bomb.avi", "mjpeg"), ("bomb.mov", "mjpeg"), ("bomb.mov", "png"), ("bomb.avi", "rawvideo"), ("bomb.avi", "ffv1"),
    ("bomb.mkv", "mjpeg"),
])
def test_a_film_that_says_it_is_huge(tmp_path, name, codec):
    """Refused with the size, in little memory and one line."""
    path = film(tmp_path / name, codec, HUGE_WH)
    done = subprocess.run([sys.executable, "-c", PROGRAM, path, str(LIMIT_BYTES)], capture_output=True, text=True,
                          timeout=120, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0 and done.stdout.count("\n") == 1 and not done.stderr, done.stderr[-500:]
    assert done.stdout.startswith("refused") and "60000x50000" in done.stdout
