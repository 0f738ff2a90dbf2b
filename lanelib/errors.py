"""The one exception of lanelib."""


class LanelibError(ValueError):
    """Something the user gave cannot be used.

    The text is one line: what was needed, what was found, what to do. The command line prints it
    and ends with exit code 2; nothing in lanelib raises another type on purpose.
    """
