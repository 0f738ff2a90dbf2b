"""The arguments of the command line: every command with its options, help and example."""

import argparse
import glob
import math
import os
import re
import textwrap
from pathlib import Path
from typing import NoReturn

from lanelib.errors import LanelibError
from lanelib.names import natural_key

PRESETS = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow")  # x264's

HELP_WIDTH = 100
RIG_HELP = (
    "Without --rig the rig is the one of the data set that the file lies in (test_images/SET, test_videos/SET); for "
    "other files every rig in rigs/ whose proportions fit is tried on up to 8 frames, and the one is taken under which "
    "lanes are found most confidently and with the least strain. Which one it was is said. Make one for your own "
    "camera with `lanelib rig`."
)
EXIT_HELP = textwrap.fill(
    "`lanelib COMMAND --help` says more, with examples. Exit codes: 0 done, 1 a fault of lanelib, 2 some input could "
    "not be used (one line on stderr says which and why), 130 interrupted, 141 nobody read on, 143 ended by a signal.",
    HELP_WIDTH,
)
OVERWRITE_HELP = (
    "A file that is there is replaced, and only when the new one is complete. A name that begins with a dash goes "
    "after `--`."
)


class Parser(argparse.ArgumentParser):
    """argparse, with errors in one line."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False, **kwargs)

    def error(self, message: str) -> NoReturn:
        """As for every other bad input: one line, exit code 2."""
        raise LanelibError(f"{message}; see {self.prog} --help")


class _Files(argparse.Action):
    """Names of files; a pattern stands for what it matches, as the shells of Windows hand it on unchanged."""

    def __call__(self, parser, namespace, values, option_string=None) -> None:
        setattr(namespace, self.dest, [path for value in values for path in _matching(value)])


def build_parser() -> argparse.ArgumentParser:
    """Every command and option."""
    parser = Parser(
        prog="lanelib",
        description="Classical lane finding on dash-cam pictures and videos.",
        epilog=f"Example:\n  lanelib image test_images/udacity/*.jpg -o out --stages\n\n{EXIT_HELP}",
    )
    parser.add_argument("--version", action="version", version=f"lanelib {_version()}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    for add in (_calibrate, _image, _video, _live, _rig, _evaluate, _fetch, _course):
        add(commands)
    return parser


# ---------------------------------------------------------------------------------------------- commands
def _calibrate(commands) -> None:
    p = _command(
        commands,
        "calibrate",
        "a camera from pictures of a chessboard",
        "Calibrate a camera from chessboard pictures: prints what became of every picture, the RMS "
        "reprojection error over all corners, and the camera's numbers with their standard deviations. "
        "Boards that the frame cuts off count as far as they are seen.",
        "lanelib calibrate camera_cal/udacity -o calibration.json\n"
        "lanelib calibrate --board 8x5 --square 0.03 --bent board*.jpg -o my_camera.json",
        OVERWRITE_HELP,
    )
    p.add_argument(
        "boards", nargs="+", type=_path, action=_Files, metavar="BOARDS", help="pictures, or folders of them"
    )
    p.add_argument(
        "--board", type=_board, default=(9, 6), metavar="9x6", help="inner corners in a row and a column (default 9x6)"
    )
    p.add_argument(
        "--square",
        type=_positive,
        default=1.0,
        metavar="M",
        help="side of a square in metres; changes only the boards' poses",
    )
    p.add_argument(
        "--bent", action="store_true", help="the board is not flat (a sheet of paper): estimate its shape as well"
    )
    p.add_argument("-o", "--output", required=True, type=_path, metavar="FILE", help="the calibration, JSON")
    _quiet(p)


def _image(commands) -> None:
    p = _command(
        commands,
        "image",
        "the lane in single pictures",
        "Find the lane in pictures, each on its own, and draw it. A picture that cannot be used is "
        "reported, the others are done, and the exit code is 2.",
        "lanelib image test_images/udacity/*.jpg -o out --stages\n"
        "lanelib image road.jpg --rig udacity --json -",
        RIG_HELP,
        OVERWRITE_HELP,
    )
    p.add_argument(
        "pictures", nargs="+", type=_path, action=_Files, metavar="PICTURES", help="pictures, or folders of them"
    )
    _rig_and_recipe(p)
    p.add_argument(
        "-o",
        "--output",
        type=_path,
        metavar="DIR|PICTURE",
        help="folder of the results (default: output_images/SET for pictures of a data set, else lanelib_output); for "
        "one picture also a name that ends in .jpg or .png",
    )
    p.add_argument(
        "--stages",
        action="store_true",
        help="also every intermediate picture: undistorted, mask, bird's-eye view, fit …",
    )
    _json(p)
    _quiet(p)


def _video(commands) -> None:
    p = _command(
        commands,
        "video",
        "the lane in videos",
        "Follow the lane through videos and draw it: H.264 that plays in a browser, with the sound and "
        "the times of the source. A damaged video is done as far as it can be read; one that ends too "
        "early gives exit code 2.",
        "lanelib video drive.mp4 -o annotated.mp4 --rig udacity\n"
        "lanelib video drive.mp4 --view diagnostic --start 20 --end 30\n"
        "lanelib video drive.mp4 --no-video --json lanes.jsonl",
        RIG_HELP,
        OVERWRITE_HELP,
    )
    p.add_argument("videos", nargs="+", type=_path, action=_Files, metavar="IN", help="video files")
    p.add_argument(
        "-o",
        "--output",
        type=_path,
        metavar="OUT.mp4",
        help="the result; a folder for several videos (default: output_videos/SET or lanelib_output)",
    )
    _rig_and_recipe(p)
    _view(p)
    p.add_argument("--start", type=_seconds, default=0.0, metavar="S", help="begin at this second")
    p.add_argument("--end", type=_seconds, metavar="S", help="end before this second")
    p.add_argument("--no-video", action="store_true", help="write no video (with --json: only numbers)")
    p.add_argument(
        "--preset",
        choices=PRESETS,
        default="veryfast",
        metavar="NAME",
        help=f"x264's effort, {PRESETS[0]} … {PRESETS[-1]} (default veryfast): slower makes smaller files",
    )
    p.add_argument("--jobs", type=_count, default=1, metavar="N", help="videos worked on at the same time (default 1)")
    _json(p)
    _quiet(p)


def _live(commands) -> None:
    p = _command(
        commands,
        "live",
        "the lane in a camera or stream, as it comes",
        "Follow the lane in a camera or stream: in a window where there is a display and OpenCV has "
        "windows (q ends it), otherwise as a page for the browser on this machine, whose address is said. "
        "A lost source is tried again.",
        "lanelib live 0 --rig my_rig.json\nlanelib live rtsp://192.168.0.20/stream --page --port 8080",
    )
    p.add_argument("source", metavar="DEVICE|URL", help="camera number or /dev/video0, an address, or a video file")
    _rig_and_recipe(p)
    _view(p)
    p.add_argument("--page", action="store_true", help="the page even where a window is possible")
    p.add_argument(
        "--host", default="127.0.0.1", help="where the page listens (default 127.0.0.1: only this machine can see it)"
    )
    p.add_argument("--port", type=_port, default=0, help="port of the page (default: any free one)")
    p.add_argument("--frames", type=_count, metavar="N", help="end after so many frames")
    _quiet(p)


def _rig(commands) -> None:
    p = _command(
        commands,
        "rig",
        "a rig from pictures of straight road",
        "Make a rig, the camera and how it sees the road, from a frame or better a clip of fairly "
        "straight, marked road. The lane's width is the scale. Without a calibration (--camera none) the "
        "focal length is assumed, and said.",
        "lanelib rig straight_road.jpg --camera camera.json -o my_rig.json\n"
        "lanelib rig dashcam.mp4 --camera none --lane-width 3.5 -o my_rig.json",
        OVERWRITE_HELP,
    )
    p.add_argument(
        "frames", nargs="+", type=_path, action=_Files, metavar="FRAME", help="pictures or videos of one camera"
    )
    p.add_argument(
        "--camera", required=True, type=_path, metavar="FILE|none", help="the file of `lanelib calibrate`, or none"
    )
    p.add_argument(
        "--lane-width", type=_positive, default=3.7, metavar="M", help="width of the lane in metres (default 3.7)"
    )
    p.add_argument(
        "--dash-period",
        type=_positive,
        metavar="M",
        help="dash and gap together in metres (California 14.63, federal manual 12.19): sets the focal length; "
        "only with --camera none",
    )
    p.add_argument("-o", "--output", required=True, type=_path, metavar="RIG", help="the rig, JSON")
    _quiet(p)


def _evaluate(commands) -> None:
    p = _command(
        commands,
        "evaluate",
        "predictions against labels or truth",
        "Score predictions (the JSON lines of --json, or any in the TuSimple layout) against labels in "
        "the same layout: TuSimple's criterion (20 px), a strict one (5 px), lines found, pixel errors. "
        "Against a truth.json also in metres: lateral error at 5, 10, 20 and 30 m, offset, width, "
        "heading, bend, false lanes; jitter, lag and reset time of clips; all by tag.",
        "lanelib image test_images/rendered/*.jpg --json lanes.jsonl\n"
        "lanelib evaluate test_images/rendered/truth.json lanes.jsonl",
    )
    p.add_argument("labels", type=_path, metavar="LABELS", help="JSON lines, a truth.json, or its folder")
    p.add_argument(
        "predictions",
        type=_path,
        metavar="PREDICTIONS|-",
        help="JSON lines (-: from stdin); matched by raw_file, else by its last part",
    )
    p.add_argument("--json", type=_path, metavar="FILE|-", help="the figures as JSON")
    _quiet(p)


def _fetch(commands) -> None:
    p = _command(
        commands,
        "fetch",
        "bring a public data set (udacity, 88 MB)",
        "Bring the public Udacity set (MIT licence) into camera_cal/, test_images/ and test_videos/: 20 "
        "chessboards, the test pictures and the well-known clips. Every file is checked by its SHA-256; "
        "what is there and right is not fetched again.",
        "lanelib fetch udacity",
    )
    p.add_argument("name", metavar="NAME", help="udacity")
    _quiet(p)


def _course(commands) -> None:
    p = _command(
        commands,
        "course",
        "the main job: everything on every data set that is there",
        "For every data set that is there: calibrate, run all pictures with every stage and all videos, "
        "and write results and a summary to output_images/SET and output_videos/SET. Goes on after a "
        "failure and says so at the end. `make` runs this.",
        "lanelib course\nlanelib course --sets udacity rendered --no-videos",
    )
    p.add_argument("--sets", nargs="+", metavar="SET", help="only these (default: all)")
    p.add_argument("--no-videos", action="store_true", help="leave the videos out")
    p.add_argument(
        "--preset", choices=PRESETS, default="veryfast", metavar="NAME", help="x264's effort (default veryfast)"
    )
    _quiet(p)


# ---------------------------------------------------------------------------------------------- options
def _command(commands, name: str, short: str, text: str, example: str, *more: str) -> argparse.ArgumentParser:
    indented = "".join(f"  {line}\n" for line in example.splitlines())
    notes = "".join(f"\n{textwrap.fill(part, HELP_WIDTH)}" for part in more)
    epilog = f"Example{'s' if example.count(chr(10)) else ''}:\n{indented}{notes}"
    return commands.add_parser(name, help=short, description=textwrap.fill(text, HELP_WIDTH), epilog=epilog)


def _rig_and_recipe(p: argparse.ArgumentParser) -> None:
    p.add_argument("--rig", metavar="RIG", help="the rig's file, or the name of one in rigs/")
    p.add_argument(
        "--recipe",
        default="paint",
        metavar="NAME",
        help="paint (default) or a classic recipe, in the textbook order: see lanelib.threshold.RECIPES",
    )
    p.add_argument(
        "--neighbours",
        action="store_true",
        help="also the lanes beside the ego lane, where their far boundary is painted and seen: drawn thin and purple",
    )


def _view(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--view",
        choices=("overlay", "diagnostic", "birdseye"),
        default="overlay",
        help="what to show (default overlay)",
    )


def _json(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--json",
        type=_path,
        metavar="FILE|-",
        help="results as JSON lines in the TuSimple layout (-: on stdout, which then carries nothing else); with "
        "--neighbours their lines follow the ego lane's two",
    )


def _quiet(p: argparse.ArgumentParser) -> None:
    p.add_argument("--quiet", action="store_true", help="say only what went wrong")


def _path(text: str) -> Path:
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError("an empty name is no file")
    return Path(text)


def _matching(path: Path) -> list[Path]:
    """The files that a pattern matches, in natural order; the path itself where it is there, or nothing matches."""
    found = [] if os.path.lexists(path) else glob.glob(str(path))
    return [Path(name) for name in sorted(found, key=natural_key)] or [path]


def _board(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,3})[xX×](\d{1,3})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"needed inner corners as 9x6, found {text!r}")
    return int(match[1]), int(match[2])


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"needed a number above 0, found {text!r}")
    return value


def _seconds(text: str) -> float:
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"needed seconds from 0, found {text!r}")
    return value


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"needed a number, found {text!r}")
    return value


def _count(text: str) -> int:
    if not re.fullmatch(r"[1-9][0-9]{0,8}", text):
        raise argparse.ArgumentTypeError(f"needed a whole number from 1, found {text!r}")
    return int(text)


def _port(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,5}", text) or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"needed a port from 0 to 65535, found {text!r}")
    return int(text)


def _version() -> str:
    import lanelib

    return getattr(lanelib, "__version__", "(unknown version)")
