"""The command line: `python -m lanelib …`, installed as `lanelib`.

This file knows how a command may end, `arguments.py` what it may be given, `commands.py` what it does. What the user
gave and cannot be used is one line on stderr and exit code 2; a fault of lanelib itself is one line and exit code 1
(LANELIB_DEBUG=1 shows where).
"""

import contextlib
import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from lanelib.errors import BAD_INPUT, FAULT, LanelibError, one_line

OK, INTERRUPTED, BROKEN_PIPE, TERMINATED = 0, 130, 141, 143  # as a shell has it: 128 and the number of the signal


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    old: dict[int, object] = {}
    came: list[int] = []

    def end(number: int, frame: object) -> NoReturn:
        """SIGTERM ends like Ctrl-C: what was begun is taken away first. It is said in the end, not here, where stderr
        may just be caught (`pictures` does so while OpenCV decodes)."""
        came.append(number)
        raise KeyboardInterrupt

    try:
        old[signal.SIGTERM] = _on_signal(signal.SIGTERM, end)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            old[signal.SIGINT] = _on_signal(signal.SIGINT, end)
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")  # a file's name may hold what the terminal cannot show
        from lanelib.arguments import build_parser  # here: from now on Ctrl-C is answered in one line

        args = build_parser().parse_args(argv)
        with _signals_wait():
            from lanelib import commands  # here: --help answers without OpenCV

        to_stderr = str(getattr(args, "json", None)) == "-"
        console = commands.Console(quiet=getattr(args, "quiet", False), to_stderr=to_stderr, came=came)
        code = getattr(commands, args.command)(args, console)
        sys.stdout.flush()
        return code
    except SystemExit as error:  # argparse
        return error.code if isinstance(error.code, int) else FAULT
    except KeyboardInterrupt as error:
        return _ended_by(came, error)
    except BrokenPipeError:  # `lanelib … | head`: nobody reads on; keep Python from complaining at exit
        _silence_stdout()
        return BROKEN_PIPE
    except LanelibError as error:
        if came:  # a library may make another error of it
            return _ended_by(came, error)
        _complain(error, error)
        return BAD_INPUT
    except OSError as error:  # a folder that may not be listed, a full disk under a redirected stdout
        _silence_stdout()
        _complain(f"{error.filename or 'input or output'}: {error.strerror or error}", error)
        return BAD_INPUT
    except Exception as error:
        if came:
            return _ended_by(came, error)
        if os.environ.get("LANELIB_DEBUG") == "1":
            raise
        kind = "not enough memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"
        _complain(f"a fault of lanelib ({kind}); please report it, LANELIB_DEBUG=1 shows where it happened", error)
        return FAULT
    finally:
        for number, handler in old.items():
            _on_signal(number, handler)


# ---------------------------------------------------------------------------------------------- how it ends
def _complain(what: object, error: BaseException) -> None:
    print(f"lanelib: {one_line(what, error)}", file=sys.stderr)


def _ended_by(came: Sequence[int], error: BaseException) -> int:
    terminated = signal.SIGTERM in came
    how = "ended by a signal" if terminated else "interrupted"
    kept = "an unfinished video is not kept" if hasattr(error, "__notes__") else "nothing half-written was left"
    _complain(f"{how}; {kept}", error)
    return TERMINATED if terminated else INTERRUPTED


def _on_signal(number: int, handler):
    """Set the handler where this is possible (the main thread); returns the one before."""
    try:
        return signal.signal(number, handler)
    except (ValueError, TypeError):
        return None


@contextlib.contextmanager
def _signals_wait():
    """Libraries are loaded undisturbed: broken off in the middle they may take Python down with them. What comes
    meanwhile is answered right afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _silence_stdout() -> None:
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
