"""Small synthetic clips with every property that breaks video readers.

Each function writes one file with the ffmpeg binary of imageio-ffmpeg and returns its path. The picture carries its
frame number as 8 bits of black and white blocks along the top (`frame_number` reads it back), so that a test knows
which frame it got, whatever the codec did to it.
"""

import subprocess
from collections.abc import Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np

BITS = 8


def ffmpeg(*arguments: object, data: bytes | None = None) -> str:
    """Run ffmpeg to the end and return what it said; fail with its words when it fails."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-y", *map(str, arguments)]
    done = subprocess.run(command, input=data, stdin=None if data is not None else subprocess.DEVNULL,
                          capture_output=True, check=False, timeout=120)
    said = done.stderr.decode("utf-8", "replace")
    assert done.returncode == 0, said[-2000:]
    return said


def picture(index: int, size_wh: tuple[int, int]) -> np.ndarray:
    """A BGR frame: 8 blocks in the top quarter hold the number, a ramp and a moving bar below."""
    width, height = size_wh
    frame = np.empty((height, width, 3), np.uint8)
    frame[:] = np.linspace(40, 200, width).astype(np.uint8)[None, :, None]
    edges = np.linspace(0, width, BITS + 1).round().astype(int)
    for bit in range(BITS):
        frame[: max(height // 4, 1), edges[bit] : edges[bit + 1]] = 235 if index >> bit & 1 else 16
    x = (index * 7) % max(width - 8, 1)
    frame[height // 2 :, x : x + 8] = (30, 60, 220)
    return frame


def frame_number(frame: np.ndarray) -> int:
    """The number that `picture` drew, from a BGR frame or the Y rows of YUV planes."""
    height, width = frame.shape[:2]
    edges = np.linspace(0, width, BITS + 1).round().astype(int)
    band = frame[height // 16 : max(height // 8, height // 16 + 1)]
    return sum(int(band[:, edges[b] : edges[b + 1]].mean() > 127) << b for b in range(BITS))


def clip(
    path: Path, *, n_frames: int = 20, size_wh: tuple[int, int] = (160, 96), fps: float = 25,
    pix_fmt: str = "yuv420p", audio_s: float = 0.0, codec: str = "libx264", options: Sequence[object] = (),
    audio_codec: str = "aac",
) -> Path:
    """A clip of numbered frames; `audio_s` seconds of a tone beside them."""
    raw = b"".join(picture(i, size_wh).tobytes() for i in range(n_frames))
    arguments: list[object] = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{size_wh[0]}x{size_wh[1]}",
                               "-r", fps, "-i", "pipe:0"]
    if audio_s:
        arguments += ["-f", "lavfi", "-t", audio_s, "-i", "sine=frequency=440", "-c:a", audio_codec]
    if codec == "libx264":
        arguments += ["-preset", "ultrafast", "-g", 5]
    ffmpeg(*arguments, "-c:v", codec, "-pix_fmt", pix_fmt, *options, path, data=raw)
    return path


def odd(path: Path) -> Path:
    """161x97, which yuv420p cannot hold: stored as yuv444p."""
    return clip(path, size_wh=(161, 97), pix_fmt="yuv444p")


def rotated(path: Path) -> Path:
    """A phone held upright: stored 160x96 with a flag, shown 96x160."""
    stored = clip(path.with_name("stored_" + path.name))
    ffmpeg("-display_rotation", 90, "-i", stored, "-c", "copy", path)
    return path


def variable_rate(path: Path, times_ms: Sequence[int]) -> Path:
    """Frames at the given times (Matroska keeps milliseconds)."""
    steps = "+".join(f"eq(N,{i})*{t}" for i, t in enumerate(times_ms))
    return clip(path, n_frames=len(times_ms), fps=1000,
                options=["-vf", f"settb=1/1000,setpts='{steps}'", "-fps_mode", "passthrough",
                         "-enc_time_base", "1/1000"])


def audio_only(path: Path) -> Path:
    """A second of a tone in an MP4."""
    ffmpeg("-f", "lavfi", "-t", 1, "-i", "sine=frequency=440", "-c:a", "aac", path)
    return path


def no_frames(path: Path) -> Path:
    """A video stream that is declared and holds nothing."""
    ffmpeg("-f", "lavfi", "-i", "color=size=160x96:rate=25:duration=1", "-frames:v", 0, "-c:v", "libx264", path)
    return path


def truncated(path: Path, *, keep: float = 0.5, n_frames: int = 38, audio_s: float = 0.0) -> Path:
    """Index at the front (faststart), the last part of the file missing: a broken download."""
    whole = clip(path.with_name("whole_" + path.name), n_frames=n_frames, audio_s=audio_s,
                 options=["-movflags", "+faststart"])
    data = whole.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    return path


def corrupt(path: Path, *, n_frames: int = 40, seed: int = 1, n_holes: int = 6, hole: int = 200) -> Path:
    """Random bytes written over places in the middle half of the file; the index at the end is whole."""
    whole = clip(path.with_name("whole_" + path.name), n_frames=n_frames)
    data = bytearray(whole.read_bytes())
    start, end = len(data) // 4, data.rfind(b"moov") - 4 if path.suffix == ".mp4" else len(data) * 3 // 4
    rng = np.random.default_rng(seed)
    for at in rng.integers(start, min(end, len(data) * 3 // 4) - hole, n_holes):
        data[at : at + hole] = rng.bytes(hole)
    path.write_bytes(bytes(data))
    return path


def changing_size(path: Path) -> Path:
    """Ten frames at 160x96, then ten at 128x64, in one H.264 stream."""
    parts = [clip(path.with_name(f"part{i}.h264"), n_frames=10, size_wh=size, options=["-bsf:v", "dump_extra"])
             for i, size in enumerate([(160, 96), (128, 64)])]
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    return path
