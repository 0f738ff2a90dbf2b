"""The one exception of lanelib, and how errors become one line and an exit code."""

FAULT, BAD_INPUT = 1, 2  # exit codes: lanelib itself failed; some input could not be used


class LanelibError(ValueError):
    """Something the user gave cannot be used.

    The text is one line: what was needed, what was found, what to do. The command line prints it
    and ends with the exit code BAD_INPUT; nothing in lanelib raises another type on purpose.
    """


def one_line(text: object, error: object = None) -> str:
    """The text on one line, followed by what is noted on the error (`add_note`), as where unfinished results are.

    >>> one_line("needed a road,\\n found a lake")
    'needed a road, found a lake'
    """
    return " ".join("; ".join([str(text), *getattr(error, "__notes__", [])]).split())
