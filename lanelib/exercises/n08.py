"""Checkers of notebook 08."""

from __future__ import annotations

from collections.abc import Mapping

from lanelib.exercises.judges import choice, first_failed, function, missing, never_raises, not_yet, number, right

CAUSES = ("height", "pitch", "yaw", "focal length")


@never_raises
def check_square_px(answer):
    """Side of a square in pixels of a page printed at so many dots an inch; whole or not."""
    slips = {
        "an inch has 25.4 mm, and dpi counts dots an inch": lambda mm, dpi: mm * dpi,
        "the other way round: a larger square has more dots": lambda mm, dpi: 25.4 / mm * dpi,
        "an inch has 25.4 mm, not 2.54: that is cm": lambda mm, dpi: mm / 2.54 * dpi,
        "an inch has 25.4 mm, not 25": lambda mm, dpi: mm / 25 * dpi,
        "from millimetres to inches one divides by 25.4": lambda mm, dpi: mm * 25.4 * dpi,
        "more dots an inch are more dots: multiply by dpi": lambda mm, dpi: mm / 25.4 / dpi,
        "these are the dots of one millimetre": lambda mm, dpi: dpi / 25.4,
        "how many inches is the square? It has dpi dots in each of them": lambda mm, dpi: dpi / mm,
        "these are the dots of the whole square; its side is asked for": lambda mm, dpi: (mm / 25.4 * dpi) ** 2,
    }
    cases = [((mm, dpi), mm / 25.4 * dpi) for mm, dpi in ((30, 600), (25, 300))]
    return function(answer, cases, number, unit="px", rel=0, tolerance=1.0, slips=slips)  # rounded up or down


@never_raises
def check_diagnosis(answer):
    """{"a" … "d": cause} for four symptoms."""
    if (verdict := missing(answer)) is not None:
        return verdict
    if not isinstance(answer, Mapping):
        return not_yet(f"a dictionary with a, b, c, d is needed, found {type(answer).__name__}")
    answer = {str(key).strip(" ().").lower(): value for key, value in answer.items()}
    if absent := [key for key in "abcd" if key not in answer]:
        return not_yet(f"{', '.join(absent)} not there yet")
    hints = {
        "a": {"focal length": "then the width would be right: it is set by the lane itself",
              "pitch": "then the lines would not stay parallel",
              "yaw": "a wrong yaw turns the lines and changes no length"},
        "b": {"height": "a wrong height scales everything alike; these lines do not stay parallel",
              "yaw": "a wrong yaw turns both lines the same way",
              "focal length": "a wrong focal length stretches the way ahead; what is parallel stays so"},
        "c": {"height": "then the width would be wrong, too", "pitch": "then the lines would spread or close",
              "yaw": "a wrong yaw turns the lines and changes no length"},
        "d": {"pitch": "a wrong pitch moves the two lines in opposite directions",
              "height": "a wrong height changes lengths, no directions",
              "focal length": "on straight road ahead a wrong focal length changes lengths, no directions"},
    }
    wanted = {"a": "height", "b": "pitch", "c": "focal length", "d": "yaw"}

    def one(key: str):
        said = answer[key]
        said = "focal length" if isinstance(said, str) and said.strip().lower() in ("focal", "f") else said
        verdict = choice(said, wanted[key], among=CAUSES, hints=hints[key])
        return verdict if verdict else not_yet(f"{key}: {verdict.hint}")

    return first_failed(*(one(key) for key in "abcd"), right())


@never_raises
def check_zoomed_focal(answer):
    """Focal length in pixels after the middle share of the frame was enlarged to the old size."""
    slips = {
        "smaller? what is enlarged has more pixels for the same angle": lambda focal, share: focal * share,
        "an area has two sides; the focal length goes with one of them": lambda focal, share: focal / share**2,
        "unchanged? what is enlarged has more pixels for the same angle": lambda focal, share: focal,
        "a share of 0.8 is enlarged to 1: by which factor? (Not by 1.2.)": lambda focal, share: focal * (2 - share),
        "`share` is of the sides already, not of the area": lambda focal, share: focal / share**0.5,
        "the share that stays is enlarged, not the one that is cut off":
            lambda focal, share: focal / (1 - share) if share < 1 else focal,
    }
    cases = [((focal, share), focal / share) for focal, share in ((1155.0, 0.8), (900.0, 0.5), (640.0, 1.0))]
    return function(answer, cases, number, unit="px", rel=0, tolerance=1.0, slips=slips)  # whole pixels will do
