"""lanelib.pictures: every good file reads as OpenCV reads it; every bad one is one clear line."""

import os
import struct
import threading
import time
import zlib

import cv2
import numpy as np
import pytest

from lanelib import files
from lanelib.errors import LanelibError
from lanelib.files import write_bytes
from lanelib.pictures import PICTURE_SUFFIXES, pictures_in, read_image, write_image

RNG = np.random.default_rng(11)
PHOTO = cv2.GaussianBlur(RNG.integers(0, 256, (90, 130, 3), np.uint8), (0, 0), 1.5)  # neither flat nor symmetric


def jpeg(image=PHOTO, *options) -> bytes:
    return cv2.imencode(".jpg", image, list(options))[1].tobytes()


def png(image=PHOTO) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def refused(path, data: bytes | None = None, **options) -> str:
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(LanelibError) as caught:
        read_image(path, **options)
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message
    return message


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_lossless_formats_come_back_exactly(tmp_path, suffix):
    path = write_image(tmp_path / f"bild ä{suffix}", PHOTO)
    np.testing.assert_array_equal(read_image(path), PHOTO)


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 3)])
def test_jpegs_of_all_kinds_read_as_opencv_reads_them(tmp_path, options):
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg(PHOTO, *options))
    np.testing.assert_array_equal(read_image(path), cv2.imread(str(path)))


def test_jpeg_with_a_thumbnail_and_bytes_after_its_end(tmp_path):
    """An end marker inside a segment (a thumbnail has one) is not the end, and what follows the end does no harm."""
    thumbnail = jpeg(PHOTO[:20, :20])
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    data = jpeg()
    whole = data[:2] + segment + data[2:]
    path = tmp_path / "a.jpg"
    path.write_bytes(whole + bytes(100))
    np.testing.assert_array_equal(read_image(path), cv2.imdecode(np.frombuffer(data, np.uint8), 1))
    assert "truncated" in refused(path, whole[:-200])


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_grey_becomes_three_equal_channels(tmp_path, depth):
    image = PHOTO[..., 0] if depth == np.uint8 else PHOTO[..., 0].astype(depth) * 256 + 200
    path = tmp_path / "a.png"
    path.write_bytes(png(image))
    read = read_image(path)
    assert read.dtype == np.uint8 and read.shape == (90, 130, 3)
    assert all((read[..., c] == PHOTO[..., 0]).all() for c in range(3))


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_alpha_and_sixteen_bits_become_bgr_uint8(tmp_path, depth):
    image = np.dstack([PHOTO, RNG.integers(0, 256, (90, 130), np.uint8)]).astype(depth)
    if depth == np.uint16:
        image = image * 256 + 255  # a lower byte that must not round up
    path = tmp_path / "a.png"
    path.write_bytes(png(image))
    np.testing.assert_array_equal(read_image(path), PHOTO)


def test_every_truncation_of_a_picture_is_refused(tmp_path, capfd):
    path = tmp_path / "a.jpg"
    for data in (jpeg(), jpeg(PHOTO, cv2.IMWRITE_JPEG_PROGRESSIVE, 1), png(), cv2.imencode(".bmp", PHOTO)[1].tobytes()):
        for n_bytes in [*range(1, len(data) - 2, 97), len(data) - 2, len(data) - 1]:
            refused(path, data[:n_bytes])
    assert capfd.readouterr() == ("", "")


def test_damage_inside_is_refused_and_nothing_is_printed(tmp_path, capfd):
    data = bytearray(jpeg(PHOTO, cv2.IMWRITE_JPEG_RST_INTERVAL, 2))
    data[-900:-700] = bytes(200)
    assert "damaged" in refused(tmp_path / "a.jpg", bytes(data))
    data = bytearray(png())
    data[len(data) // 2] ^= 0xFF
    assert "damaged" in refused(tmp_path / "a.png", bytes(data))
    assert capfd.readouterr() == ("", "")


def test_other_standard_error_output_still_arrives(tmp_path, capfd):
    path = write_image(tmp_path / "a.png", PHOTO)
    read_image(path)
    os.write(2, b"after")
    assert capfd.readouterr().err == "after"


def test_no_file_a_folder_an_empty_file_and_text(tmp_path):
    assert "no such file" in refused(tmp_path / "none.jpg")
    assert "folder" in refused(tmp_path)
    assert "empty" in refused(tmp_path / "a.jpg", b"")
    assert "JPEG, PNG or BMP" in refused(tmp_path / "a.jpg", b"this is text, not a picture\n" * 9)
    refused(tmp_path / "a.jpg", b"\xff\xd8\xff\xd9")
    refused(tmp_path / "b.png", b"\x89PNG\r\n\x1a\n")
    with pytest.raises(LanelibError):
        read_image("a\0b.jpg")


def test_a_device_is_not_read():
    with pytest.raises(LanelibError, match="not a file"):
        read_image("/dev/zero")


@pytest.mark.parametrize("size_wh", [(20000, 30000), (60000, 60000)])
def test_a_huge_picture_is_refused_by_its_header(tmp_path, size_wh):
    """The body is a lie, so decoding would fail in another way; the size must be named first."""
    header = struct.pack(">IIBBBBB", *size_wh, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    message = refused(tmp_path / "a.png", data)
    assert f"{size_wh[0]}x{size_wh[1]}" in message and "megapixels" in message


def test_the_limit_is_an_argument(tmp_path):
    path = tmp_path / "a.jpg"
    assert "130x90" in refused(path, jpeg(), max_megapixels=0.0116)
    assert read_image(path, max_megapixels=0.0118).shape == (90, 130, 3)


def test_the_size_in_the_header_is_the_size_of_the_picture(tmp_path):
    for name, data in (("a.jpg", jpeg()), ("a.png", png()), ("a.bmp", cv2.imencode(".bmp", PHOTO)[1].tobytes())):
        assert "found 130x90" in refused(tmp_path / name, data, max_megapixels=1e-3)


@pytest.mark.parametrize(
    "image", [PHOTO.astype(float), PHOTO[..., :2], PHOTO[:0], np.zeros(4, np.uint8), np.zeros((2, 2, 2, 3), np.uint8)]
)
def test_only_uint8_pictures_are_written(tmp_path, image):
    with pytest.raises(LanelibError, match="need a uint8 picture"):
        write_image(tmp_path / "a.png", image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a", "a.gif", "a.jp", ".png"])
def test_unknown_suffixes_are_refused(tmp_path, name):
    with pytest.raises(LanelibError, match="need a name ending in"):
        write_image(tmp_path / name, PHOTO)


@pytest.mark.parametrize("at", ["open", "replace"])
def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, at):
    """Ctrl-C at two moments: when the file has just been opened, and when it is whole but has no name yet."""
    place = tmp_path / "a.txt"
    place.write_text("old")
    opened = open

    def interrupted(*args, **kwargs):
        if at == "open":
            opened(*args, **kwargs).close()
        raise KeyboardInterrupt

    monkeypatch.setattr(*((files, "open") if at == "open" else (files.os, "replace")), interrupted, raising=False)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(place, b"new")
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"] and place.read_text() == "old"


def test_unwritable_places_are_one_line_and_leave_nothing(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder.png").mkdir()
    for name in ("none/a.png", "file/a.png", "folder.png", "a\0.png"):
        path = tmp_path / name
        with pytest.raises(LanelibError, match="need a place that can be written") as caught:
            write_image(path, PHOTO)
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.png"]


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = write_bytes(tmp_path / "a.json", b"old")

    def fails(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(LanelibError, match="No space left"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_written_files_have_ordinary_rights(tmp_path):
    mask = os.umask(0o022)
    try:
        assert write_bytes(tmp_path / "a", b"x").stat().st_mode & 0o777 == 0o644
    finally:
        os.umask(mask)


@pytest.mark.parametrize("suffix", PICTURE_SUFFIXES)
def test_what_a_folder_offers_can_be_read_and_written(tmp_path, suffix):
    path = write_image(tmp_path / f"a{suffix.upper()}", PHOTO)
    write_bytes(tmp_path / f"._a{suffix}", b"of macOS")
    write_bytes(tmp_path / "a.webp", b"which is not read")
    assert pictures_in(tmp_path) == [path] and read_image(path).shape == PHOTO.shape


def test_what_other_threads_print_meanwhile_arrives(tmp_path, capfd):
    """What a library prints is caught on a descriptor that all threads share."""
    path, data = tmp_path / "a.jpg", bytearray(jpeg(PHOTO, cv2.IMWRITE_JPEG_RST_INTERVAL, 2))
    data[-900:-700] = bytes(200)  # libjpeg has something to say
    path.write_bytes(data)
    read, said = threading.Event(), 0

    def talk():
        nonlocal said
        while not read.is_set():
            os.write(2, b"another thread %d\n" % said)
            said += 1
            time.sleep(0.0005)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        for _ in range(100):
            assert "damaged JPEG data" in refused(path)
    finally:
        read.set()
        thread.join()
    arrived = capfd.readouterr().err.splitlines()
    assert sorted(arrived) == sorted(f"another thread {i}" for i in range(said))


def test_whatever_a_damaged_png_calls_its_parts_the_error_is_one_line(tmp_path):
    def part(name, content, wrong=0):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content) ^ wrong)

    head = b"\x89PNG\r\n\x1a\n" + part(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 0, 0, 0, 0))
    for name, said in ((b"ID\nT", "unnamed"), (b"\x85\x0b\r\x1c", "unnamed"), (b"IDAT", "IDAT")):
        path = tmp_path / "a.png"
        path.write_bytes(head + part(name, b"abc", wrong=1) + part(b"IEND", b""))
        with pytest.raises(LanelibError, match=f"checksum of its {said} part") as caught:
            read_image(path)
        assert len(str(caught.value).splitlines()) == 1
