"""The order of file names: as people count, `test2` before `test10`."""

import re


def natural_key(name: str) -> list[str | int]:
    """A sort key under which `test2` comes before `test10`.

    >>> sorted(["test10.jpg", "a.jpg", "test2.jpg"], key=natural_key)
    ['a.jpg', 'test2.jpg', 'test10.jpg']
    """
    # Splitting at a group puts the digits at the odd places, so texts meet texts and numbers numbers.
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"([0-9]+)", name))]
