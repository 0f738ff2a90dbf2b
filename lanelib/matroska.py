"""Just enough Matroska to hand raw frames with their times to ffmpeg through a pipe.

A Matroska file is a tree of elements: identifier, size, content (RFC 8794 for the encoding, RFC 9559 for the elements).
Here it is a header and then one cluster per frame, which holds the frame's time in microseconds and its bytes.
"""

from fractions import Fraction

# FOURCC by which ffmpeg knows the raw format in the element UncompressedFourCC.
FOURCC = {"bgr24": b"BGR\x18", "yuv420p": b"I420", "nv12": b"NV12"}


def file_header(size_wh: tuple[int, int], pixel_format: str, fps: Fraction) -> bytes:
    """All that stands before the first frame: one track of uncompressed video, times in microseconds."""
    width, height = size_wh
    video = _element(0xE0, _number(0xB0, width), _number(0xBA, height), _element(0x2EB524, FOURCC[pixel_format]))
    track = _element(0xAE, _number(0xD7, 1), _number(0x73C5, 1), _number(0x83, 1), _element(0x86, b"V_UNCOMPRESSED"),
                     _number(0x23E383, round(1_000_000_000 / fps)), video)
    return b"".join([
        _element(0x1A45DFA3, _element(0x4282, b"matroska"), _number(0x4287, 4), _number(0x4285, 2)),
        _bytes(0x18538067), b"\x01" + b"\xff" * 7,  # the segment, of unknown size
        _element(0x1549A966, _number(0x2AD7B1, 1000)),  # 1000 ns per unit of time
        _element(0x1654AE6B, track),
    ])


def frame_header(time_us: int, n_bytes: int) -> bytes:
    """What stands before a frame's bytes: a cluster with its time and one key frame of track 1 at offset 0."""
    time = _number(0xE7, time_us)
    block = _bytes(0xA3) + _size(n_bytes + 4) + b"\x81\x00\x00\x80"
    return _bytes(0x1F43B675) + _size(len(time) + len(block) + n_bytes) + time + block


def _element(identifier: int, *content: bytes) -> bytes:
    return _bytes(identifier) + _size(sum(map(len, content))) + b"".join(content)


def _number(identifier: int, value: int) -> bytes:
    return _element(identifier, value.to_bytes(max(1, (value.bit_length() + 7) // 8), "big"))


def _size(n: int) -> bytes:
    return (n | 1 << 56).to_bytes(8, "big")  # eight bytes, the first one a marker


def _bytes(identifier: int) -> bytes:
    return identifier.to_bytes((identifier.bit_length() + 7) // 8, "big")
