"""`python -m render …`: make the shipped pictures, one or all. See README.md."""

import argparse
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(prog="python -m render", description=__doc__)
    kinds = ["boards", "stills", "rig", "video", "encode", "check", "stats", "strangers", "all"]
    parser.add_argument("what", choices=kinds)
    parser.add_argument(
        "names", nargs="*", help="pictures (without .jpg) or clips (without .mp4); default: all of them"
    )
    parser.add_argument("--spp", type=int, help="samples a pixel (boards and stills 24, clips 4)")
    parser.add_argument("--shrink", type=int, default=1, help="render smaller by this factor, for a preview")
    parser.add_argument("--to", type=Path, help="another folder than the shipped one (previews)")
    parser.add_argument("--force", action="store_true", help="also what is up to date")
    parser.add_argument("--frames", type=int, help="video: stop after so many frames")
    parser.add_argument("--every", type=int, default=1, help="video: only every n-th frame (previews)")
    parser.add_argument("--cameras", type=int, default=24, help="strangers: how many, five pictures each")
    parser.add_argument("--first", type=int, help="strangers: the first one (default: the first that nobody looked at)")
    a = parser.parse_args()
    if a.shrink > 1 and a.to is None:
        parser.error("a preview (--shrink) needs a folder of its own: --to FOLDER")
    folder = {"folder": a.to} if a.to else {}
    options = {k: v for k, v in (("spp", a.spp), ("shrink", a.shrink), ("force", a.force)) if v is not None}
    if a.what in ("boards", "all"):
        from .boards import render_boards

        render_boards(a.names, **options, **folder)
    if a.what in ("rig", "all"):
        from .rig import write_rig

        write_rig()
    if a.what in ("stills", "all"):
        from .stills import render_stills

        render_stills(a.names, **options, **folder)
    if a.what in ("video", "all"):
        from .clips import render_clips

        options.pop("force")
        render_clips(a.names, frames=a.frames, every=a.every, work=a.to, **options)
    if a.what in ("encode", "all"):
        from .clips import encode_clips

        encode_clips(a.names)
    if a.what == "strangers":
        from .strangers import render_strangers

        first = {} if a.first is None else {"first": a.first}
        render_strangers(a.cameras, spp=a.spp or 6, **first, **folder)
    if a.what == "check":
        from .check import check

        raise SystemExit(check(a.names))
    if a.what == "stats":
        from .stats import table

        table([Path(n) for n in a.names])


main()
