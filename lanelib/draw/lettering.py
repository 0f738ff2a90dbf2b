"""Lettering: a small stroke alphabet, so that text looks the same, and good, with every version of OpenCV.

OpenCV 4 and 5 draw the same `putText` call with different fonts. Here a letter is a few strokes on a grid, in the
manner of road signs and technical drawing (upright strokes, round bows, one width): capitals are 7 units high, small
letters 5, tails reach 2 below the line. A stroke is a list of points "x,y" and arcs "@x,y,rx:ry,from,to" (centre,
radii, degrees, counter-clockwise positive, y upwards); "/" lifts the pen. Letters are drawn 8 times too large and
averaged down, which is what makes them smooth.
"""

from functools import lru_cache

import cv2
import numpy as np

from lanelib.draw.canvas import ONE, SHIFT
from lanelib.errors import LanelibError

CAP, ABOVE, BELOW = 7.0, 8.0, 2.6  # grid units: height of a capital; of the box above and below the base line
GAP, SPACE = 1.75, 2.6  # units between the middles of strokes of two letters; width of a blank
REGULAR, BOLD = 0.85, 1.2  # stroke widths in units; a capital is 7 high, so 1:8 and 1:6
OVERSAMPLE = 8

_O = "@2,3,2,180,0 @2,2,2,0,-180 0,3"
_GLYPHS = {
    "0": "@2,5,2,180,0 @2,2,2,0,-180 0,5", "1": "0.7,5.5 2.4,7 2.4,0", "2": "@2,5,2,168,-38 0,0 4,0",
    "3": "@1.8,5.3,1.8:1.7,155,-90 1.3,3.6 / 1.8,3.6 @1.8,1.8,2:1.8,90,-155", "4": "3.1,0 3.1,7 0,1.8 4.2,1.8",
    "5": "3.7,7 0.5,7 0.25,3.5 @1.95,2.15,2.05:2.15,141,-150", "6": "2.9,7 @2,2.1,2:2.1,152,512",
    "7": "0,7 4,7 1.4,0", "8": "@2,5.35,1.7:1.65,-90,270 / @2,1.85,2:1.85,-90,270", "9": "1.1,0 @2,4.9,2:2.1,-28,332",
    "a": "@1.9,3.3,1.9:1.7,148,0 3.8,0 / 3.8,2.9 1.5,2.9 @1.5,1.45,1.45,90,270 2.2,0 @2.2,1.6,1.6,-90,0",
    "b": "0,7.4 0,0 / " + _O, "c": "@2,3,2,38,180 @2,2,2,180,322", "d": "4,7.4 4,0 / " + _O,
    "e": "0,2.6 4,2.6 4,3 @2,3,2,0,180 @2,2,2,180,315", "f": "2.8,7.4 2.5,7.4 @2.4,6,1.4,90,180 1,0 / 0,5 2.7,5",
    "g": _O + " / 4,5 4,-0.4 @2,-0.3,2:1.8,0,-142", "h": "0,7.4 0,0 / 0,3 @2,3,2,180,0 4,0",
    "i": "0.2,5 0.2,0 / 0.2,7.1",
    "j": "1.2,5 1.2,-0.9 @0,-0.9,1.2,0,-85 / 1.2,7.1", "k": "0,7.4 0,0 / 3.6,5 0,1.8 / 1.2,2.9 3.8,0",
    "l": "0,7.4 0,1.3 @1.3,1.3,1.3,180,270 1.5,0",
    "m": "0,5 0,0 / 0,3.3 @1.65,3.35,1.65,180,0 3.3,0 / 3.3,3.3 @4.95,3.35,1.65,180,0 6.6,0",
    "n": "0,5 0,0 / 0,3 @2,3,2,180,0 4,0", "o": _O, "p": "0,5 0,-2 / " + _O, "q": "4,5 4,-2 / " + _O,
    "r": "0,5 0,0 / 0,3 @2,3,2,180,62", "s": "@1.8,3.7,1.65:1.3,32,270 @1.8,1.2,1.8:1.2,90,-148",
    "t": "1,6.8 1,1.4 @2.4,1.4,1.4,180,270 2.9,0 / 0,5 2.8,5", "u": "0,5 0,2 @2,2,2,180,360 / 4,5 4,0",
    "v": "0,5 1.9,0 3.8,5", "w": "0,5 1.4,0 2.9,5 4.4,0 5.8,5", "x": "0,5 3.8,0 / 0,0 3.8,5",
    "y": "0,5 2,0.2 / 4,5 1.2,-2",
    "z": "0,5 3.5,5 0,0 3.6,0",
    "A": "0,0 2.4,7 4.8,0 / 0.8,2.2 4,2.2",
    "B": "0,0 0,7 2.2,7 @2.2,5.35,1.65,90,-90 0,3.7 / 2.2,3.7 @2.2,1.85,2:1.85,90,-90 0,0",
    "C": "@2.2,4.8,2.2,35,180 @2.2,2.2,2.2,180,325",
    "D": "0,0 0,7 1.8,7 @1.8,4.6,2.5:2.4,90,0 @1.8,2.4,2.5:2.4,0,-90 0,0",
    "E": "3.7,7 0,7 0,0 3.8,0 / 0,3.7 3.2,3.7", "F": "3.7,7 0,7 0,0 / 0,3.6 3.2,3.6",
    "G": "@2.2,4.8,2.2,35,180 @2.2,2.2,2.2,180,360 4.4,3.4 2.6,3.4", "H": "0,7 0,0 / 4.4,7 4.4,0 / 0,3.6 4.4,3.6",
    "I": "0.2,7 0.2,0", "J": "3,7 3,1.9 @1.1,1.9,1.9,0,-140", "K": "0,7 0,0 / 4.2,7 0,2.4 / 1.6,4.1 4.5,0",
    "L": "0,7 0,0 3.7,0", "M": "0,0 0,7 2.7,1.8 5.4,7 5.4,0", "N": "0,0 0,7 4.5,0 4.5,7",
    "O": "@2.3,4.7,2.3,180,0 @2.3,2.3,2.3,0,-180 0,4.7", "P": "0,0 0,7 2.2,7 @2.2,5.1,2:1.9,90,-90 0,3.2",
    "Q": "@2.3,4.7,2.3,180,0 @2.3,2.3,2.3,0,-180 0,4.7 / 2.8,1.6 4.6,-0.5",
    "R": "0,0 0,7 2.2,7 @2.2,5.15,2:1.85,90,-90 0,3.3 / 2.1,3.3 4.3,0",
    "S": "@2.1,5.2,2:1.8,30,270 @2.1,1.7,2.1:1.7,90,-150", "T": "0,7 4.6,7 / 2.3,7 2.3,0",
    "U": "0,7 0,2.2 @2.2,2.2,2.2,180,360 4.4,7", "V": "0,7 2.3,0 4.6,7", "W": "0,7 1.7,0 3.4,7 5.1,0 6.8,7",
    "X": "0,7 4.4,0 / 0,0 4.4,7", "Y": "0,7 2.3,3.2 4.6,7 / 2.3,3.2 2.3,0", "Z": "0,7 4.2,7 0,0 4.3,0",
    ".": "0.2,0.1", ",": "0.5,0.2 0,-1.3", ":": "0.2,0.3 / 0.2,4.4", ";": "0.5,0.2 0,-1.3 / 0.5,4.4",
    "'": "0.2,7.4 0.2,5.6",
    '"': "0.2,7.4 0.2,5.6 / 1.7,7.4 1.7,5.6",
    "!": "0.2,7 0.2,2.1 / 0.2,0.1", "?": "@1.8,5.2,1.8,165,-60 1.7,2.6 1.7,2 / 1.7,0.1",
    "-": "0,2.8 2.2,2.8", "–": "0,2.8 3.6,2.8", "_": "0,-1.2 4,-1.2", "+": "0,2.9 4,2.9 / 2,0.9 2,4.9",
    "=": "0,3.9 4,3.9 / 0,1.9 4,1.9",
    "±": "0,3.9 4,3.9 / 2,5.9 2,1.9 / 0,0.4 4,0.4", "×": "0,4.6 3.4,1.2 / 0,1.2 3.4,4.6",
    "*": "0,6.6 2.6,4.8 / 0,4.8 2.6,6.6",
    "/": "0,-0.8 2.8,7.6", "|": "0.2,-1.5 0.2,7.6", "(": "@4,3,4:5.2,117,243", ")": "@-2,3,4:5.2,63,-63",
    "[": "1.4,7.6 0,7.6 0,-1.4 1.4,-1.4", "]": "0,7.6 1.4,7.6 1.4,-1.4 0,-1.4", "<": "3.4,5 0,2.9 3.4,0.8",
    ">": "0,5 3.4,2.9 0,0.8",
    "%": "@1.1,5.8,1.1:1.2,0,360 / @4.5,1.2,1.1:1.2,0,360 / 4.7,7 0.9,0", "°": "@1,6.2,1,0,360", "·": "0.2,2.9",
    "#": "1.2,0.8 2,6.2 / 3,0.8 3.8,6.2 / 0.3,4.6 4.7,4.6 / 0.1,2.4 4.5,2.4", "…": "0.2,0.1 / 2,0.1 / 3.8,0.1",
    "&": "4.4,0 0.8,5 @1.8,5.6,1.3:1.4,210,-40 0.7,3.2 @1.7,1.6,1.7:1.6,135,330 4,3",
    "²": "@1.2,6.3,1.2,168,-38 0,3.6 2.5,3.6", "σ": "4.4,5 2,5 @2,2.5,2:2.5,90,450",
    "κ": "0,5 0,0 / 3.4,5 0,2.3 / 1.1,3.1 3.6,0",
    "→": "0,2.8 5,2.8 / 3.4,4.5 5,2.8 3.4,1.1", "←": "5,2.8 0,2.8 / 1.6,4.5 0,2.8 1.6,1.1",
}


def _strokes(glyph: str) -> list[np.ndarray]:
    """Strokes of a letter, each (N, 2) points x, y in grid units, y upwards."""
    strokes = []
    for part in _GLYPHS[glyph].split(" / "):
        points: list[tuple[float, float]] = []
        for word in part.split():
            numbers = word.lstrip("@").split(",")
            if word[0] != "@":
                points.append((float(numbers[0]), float(numbers[1])))
                continue
            rx, _, ry = numbers[2].partition(":")
            angle = np.radians(np.linspace(float(numbers[3]), float(numbers[4]), 33))
            x = float(numbers[0]) + float(rx) * np.cos(angle)
            y = float(numbers[1]) + float(ry or rx) * np.sin(angle)
            points += list(zip(x.tolist(), y.tolist(), strict=True))
        strokes.append(np.array(points))
    return strokes


@lru_cache(maxsize=2048)
def _glyph(glyph: str, cap_px: float, weight: float) -> tuple[np.ndarray, float]:
    """Coverage (h, w) uint8 of one letter, GAP / 2 of blank before its first stroke, and its advance in pixels."""
    unit = cap_px / CAP
    if glyph == " ":
        return np.zeros((1, 1), np.uint8), SPACE * unit
    strokes = _strokes(glyph if glyph in _GLYPHS else "?")
    # digits are of one width: numbers that change must not jump
    widest = 4.1 if glyph.isdigit() else max(stroke[:, 0].max() for stroke in strokes)
    size = (int(np.ceil((widest + GAP) * unit)) + 1, round(ABOVE * unit) + round(BELOW * unit))  # width, height
    big = np.zeros((size[1] * OVERSAMPLE, size[0] * OVERSAMPLE), np.uint8)
    base = round(ABOVE * unit) * OVERSAMPLE - 0.5
    thick = max(weight * unit, 0.95) * OVERSAMPLE  # thinner than a pixel it would only turn grey
    middle = weight / 2 * unit * OVERSAMPLE  # letters stand on the base line with the edge of their strokes
    height = (cap_px * OVERSAMPLE - 2 * middle) / CAP
    for stroke in strokes:
        x = (stroke[:, 0] + GAP / 2) * unit * OVERSAMPLE
        y = base - middle - stroke[:, 1] * height
        points = np.round(np.column_stack([x, y]) * ONE).astype(np.int32)
        if len(points) == 1:
            cv2.circle(big, points[0].tolist(), round(0.62 * thick * ONE), 255, -1, cv2.LINE_8, SHIFT)
        else:
            cv2.polylines(big, [points], False, 255, round(thick), cv2.LINE_8, SHIFT)
    return cv2.resize(big, size, interpolation=cv2.INTER_AREA), (widest + GAP) * unit


@lru_cache(maxsize=512)
def text_mask(text: str, cap_px: float, *, bold: bool = False) -> tuple[np.ndarray, int]:
    """Coverage of a line of text, (h, w) uint8 0..255 (read only), and the row of its base line.

    ``cap_px``: height of a capital in pixels. Characters the alphabet lacks are shown as "?".
    """
    weight = BOLD if bold else REGULAR
    parts = [_glyph(letter, float(cap_px), weight) for letter in text]
    width = int(np.ceil(sum(advance for _, advance in parts))) + 2
    base = round(ABOVE * cap_px / CAP)
    mask = np.zeros((base + round(BELOW * cap_px / CAP), max(width, 1)), np.uint8)
    x = 0.0
    for letter, advance in parts:
        h, w = letter.shape
        at = round(x)
        room = mask[:h, at : at + w]
        np.maximum(room, letter[:, : room.shape[1]], out=room)
        x += advance
    mask.setflags(write=False)
    return mask, base


def text_width(text: str, cap_px: float, *, bold: bool = False) -> int:
    """Width of a line of text in pixels."""
    return text_mask(text, cap_px, bold=bold)[0].shape[1]


def stamp(picture: np.ndarray, mask: np.ndarray, xy: tuple[int, int], colour) -> None:
    """Lay ``colour`` over ``picture`` (H, W) or (H, W, C) uint8, in place, as far as ``mask`` (h, w) covers it.

    ``colour``: a number for each channel; ``xy``: column and row of the mask's upper left pixel, anywhere.
    """
    x, y = xy
    top, left = max(0, -y), max(0, -x)
    room = picture[max(y, 0) : max(y + mask.shape[0], 0), max(x, 0) : max(x + mask.shape[1], 0)]
    mask = mask[top : top + room.shape[0], left : left + room.shape[1]]
    if room.size == 0:
        return
    cover = (mask if picture.ndim == 2 else cv2.merge([mask] * picture.shape[2])).astype(np.uint16)
    mixed = room * (255 - cover) + np.asarray(colour, np.uint16) * cover
    mixed += np.uint16(128)  # (m + 128 + (m + 128 >> 8)) >> 8 is m / 255 rounded, exactly, up to 255 * 255
    mixed += mixed >> 8
    room[...] = mixed >> 8


def put_text(
    picture: np.ndarray,
    text: str,
    xy: tuple[float, float],
    colour,
    *,
    cap_px: float = 14,
    bold: bool = False,
    align: str = "left",
) -> None:
    """Write ``text`` into ``picture``, in place.

    ``xy``: where the base line begins, has its middle or ends, for an ``align`` of left, centre or right.
    """
    mask, base = text_mask(text, cap_px, bold=bold)
    shifts = {"left": 0.0, "centre": mask.shape[1] / 2, "right": mask.shape[1]}
    if align not in shifts:
        raise LanelibError(f"text must be aligned {', '.join(shifts)}, found {align!r}")
    stamp(picture, mask, (round(xy[0] - shifts[align]), round(xy[1]) - base), colour)


def shortened(text: str, cap_px: float, width_px: float, *, bold: bool = False) -> str:
    """``text``, cut at the end with "…" where it is wider than ``width_px``."""
    if text_width(text, cap_px, bold=bold) <= width_px:
        return text
    while text and text_width(text + "…", cap_px, bold=bold) > width_px:
        text = text[:-1].rstrip()
    return text + "…"


def wrapped(text: str, cap_px: float, width_px: float, *, max_lines: int = 3) -> list[str]:
    """``text`` broken between words into at most ``max_lines`` lines of at most ``width_px``; "…" for the rest."""
    lines: list[str] = []
    words = text.split()
    while words:
        line = words.pop(0)
        while words and text_width(f"{line} {words[0]}", cap_px) <= width_px:
            line += " " + words.pop(0)
        if len(lines) == max_lines - 1:
            line = " ".join([line, *words])
            words = []
        lines.append(shortened(line, cap_px, width_px))
    return lines
