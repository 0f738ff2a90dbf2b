"""Notebooks from their sources: `python tools/notebooks.py build [NN …]`, and `check` for what is out of step.

One source, notebooks/source/NN_name.py, makes two notebooks:

    notebooks/NN_name.ipynb            solved, run top to bottom in a fresh kernel, outputs stored
    notebooks/learner/NN_name.ipynb    stubs instead of solutions, answers folded away, not run

`build --text` keeps the stored outputs where only text changed; `build --learner` makes only the learner's;
`run-learner NN` runs it in a fresh kernel and stores nothing.
"""

import argparse
import os
import sys
import time
from pathlib import Path

import nbformat

TOOLS = Path(__file__).resolve().parent
sys.path.insert(0, str(TOOLS))  # also when imported by a test

import notebook_source as source  # noqa: E402

from lanelib.files import write_bytes  # noqa: E402

ROOT = TOOLS.parent
BOOKS = ROOT / "notebooks"
SOURCES, LEARNER = BOOKS / "source", BOOKS / "learner"
CELL_TIMEOUT_S = 120  # as nbval's
WIDGET = "application/vnd.jupyter.widget-view+json"
WIDGET_TEXT = "*Run this cell to use the explorer; the figures around it show, standing still, what it moves.*"
JPEG = "image/jpeg"


def sources(numbers=()) -> list[Path]:
    """The source files, or those whose names begin with one of `numbers`."""
    found = sorted(SOURCES.glob("[0-9][0-9]_*.py"))
    missing = [n for n in numbers if not any(path.name.startswith(n) for path in found)]
    if missing:
        raise SystemExit(f"notebooks: no source begins with {', '.join(missing)} (there: {_names(found)})")
    return [path for path in found if not numbers or path.name.startswith(tuple(numbers))]


def build(path: Path, *, learner_only: bool = False, text_only: bool = False) -> str:
    """Both notebooks of a source; returns what was done in a line."""
    cells = source.read(path)
    _write(source.learner_notebook(cells, path.stem), LEARNER / f"{path.stem}.ipynb")
    if learner_only:
        return f"{path.stem}: wrote the learner's notebook"
    began, notebook, book = time.perf_counter(), source.solved_notebook(cells, path.stem), BOOKS / f"{path.stem}.ipynb"
    if not (text_only and book.exists() and source.with_outputs_of(notebook, nbformat.read(book, 4))):
        notebook = run(notebook, BOOKS, path.stem)
    linked = source.with_navigation(cells, path.stem)
    described = {made.id: cell.alt for made, cell in zip(notebook.cells, linked, strict=True)}
    size = _write(tidy(notebook, described), book)
    return f"{path.stem}: {len(cells)} cells in {time.perf_counter() - began:.0f} s, {size / 1000:.0f} kB"


def run(notebook, folder: Path, name: str):
    """The notebook, executed in a fresh kernel whose working directory is `folder`."""
    from nbclient.exceptions import CellExecutionError
    from patient import PatientClient

    path = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), path]))  # lanelib of this checkout
    client = PatientClient(notebook, kernel_name="python3", timeout=CELL_TIMEOUT_S, record_timing=False,
                           store_widget_state=False, resources={"metadata": {"path": str(folder)}})
    try:
        return client.execute()
    except CellExecutionError as error:
        raise SystemExit(f"notebooks: {name} failed\n{error}") from None


def tidy(notebook, described=None):
    """What is worth keeping of an executed notebook: outputs and counts, no widget models, no kernel's version."""
    described = described or {}
    notebook.metadata = {"kernelspec": source.KERNELSPEC, "language_info": {"name": "python"}}
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        for i, output in enumerate(cell.get("outputs", [])):
            if output.output_type == "stream" and output.name == "stderr":
                raise SystemExit(f"notebooks: a cell wrote to stderr; cure it:\n{cell.source}\n---\n{output.text}")
            data = output.get("data", {})
            if WIDGET in data:  # a widget without its kernel shows nothing but an error
                cell.outputs[i] = nbformat.v4.new_output("display_data", {"text/markdown": WIDGET_TEXT})
            elif described.get(cell.id):
                for kind in {JPEG, "image/png"} & set(data):
                    output.metadata[kind] = {"alt": described[cell.id]}
    return notebook


def out_of_step(path: Path) -> list[str]:
    """Which notebooks of a source are missing or do not say what it says; quick, nothing runs."""
    cells = source.read(path)
    made = {
        BOOKS / f"{path.stem}.ipynb": source.solved_notebook(cells, path.stem),
        LEARNER / f"{path.stem}.ipynb": source.learner_notebook(cells, path.stem),
    }
    found = []
    for book, expected in made.items():
        name = book.relative_to(ROOT).as_posix()
        if not book.exists():
            found.append(f"{name} is missing")
        elif not source.same_cells(nbformat.read(book, 4), expected):
            found.append(f"{name} is not what {path.name} says")
    return found


def strangers() -> list[str]:
    """Notebooks that have no source."""
    known = {path.stem for path in sources()}
    books = [*BOOKS.glob("*.ipynb"), *LEARNER.glob("*.ipynb")]
    return [f"{book.relative_to(ROOT).as_posix()} has no source" for book in books if book.stem not in known]


def main(argv=None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="notebooks", description=__doc__.split("\n")[0])
    parser.add_argument("command", choices=("build", "check", "run-learner"))
    parser.add_argument("numbers", nargs="*", metavar="NN", help="00 to 08; all if none is given")
    parser.add_argument("--learner", action="store_true", help="build: only the learner's notebooks")
    parser.add_argument("--text", action="store_true", help="build: do not run what only changed in text")
    args = parser.parse_args(argv)
    try:
        paths = sources(args.numbers)
        if args.command == "check":
            found = [line for path in paths for line in out_of_step(path)] + (strangers() if not args.numbers else [])
            print("\n".join(found) or f"in step: {_names(paths)}")
            if found:
                print("run: python tools/notebooks.py build " + " ".join(args.numbers))
            return 1 if found else 0
        for path in paths:
            if args.command == "build":
                print(build(path, learner_only=args.learner, text_only=args.text), flush=True)
            else:
                run(source.learner_notebook(source.read(path), path.stem), LEARNER, path.stem)
                print(f"{path.stem}: the learner's notebook runs top to bottom")
    except source.SourceError as error:
        raise SystemExit(f"notebooks: {error}") from None
    return 0


def _write(notebook, path: Path) -> int:
    """Write completely or not at all; returns the size in bytes."""
    nbformat.validate(notebook)
    path.parent.mkdir(exist_ok=True)
    return write_bytes(path, (nbformat.writes(notebook) + "\n").encode()).stat().st_size


def _names(paths) -> str:
    return ", ".join(path.stem for path in paths) or "none"


if __name__ == "__main__":
    raise SystemExit(main())
