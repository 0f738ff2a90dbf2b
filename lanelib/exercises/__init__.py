"""Checkers of the course's exercises: `check_NAME(answer)` returns a verdict with a hint in one line.

An answer is judged by what it must do, within a tolerance, so that another correct way passes, too. A wrong one is told
what is wrong: nothing there yet, the type, the shape, the units, the sign or the value. Checkers never raise.

The checkers of notebook NN are in `nNN.py`; every function there whose name begins with `check_` can be called from
here. They are built from the judges in `judges.py`.
"""

import pkgutil
from importlib import import_module

from lanelib.exercises.verdict import Verdict

__all__ = ["Verdict"]

for _found in sorted(module.name for module in pkgutil.iter_modules(__path__)):
    if _found[0] == "n" and _found[1:].isdigit():
        for _name, _checker in vars(import_module(f"{__name__}.{_found}")).items():
            if _name.startswith("check_"):
                if _name in globals():
                    raise ImportError(f"two exercises have a checker {_name}; rename the one in {_found}.py")
                globals()[_name] = _checker
                __all__.append(_name)
