"""From one source to two notebooks: the solved one and the learner's. Pure text work, nothing runs here.

The format is described in notebooks/source/README.md; in short, percent format with four additions:

    # %% [markdown]                       text, each line a comment
    # %% tags=["answer"] alt="what …"     options of a cell, as JSON after the marker
    # BEGIN SOLUTION … # END SOLUTION     code that the learner writes
    # STUB: return None                   inside it: what the learner finds there instead of `...`
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import dedent

import nbformat

MARKER = re.compile(r"# %%(?P<kind> \[markdown\])?(?P<options>(?: .*)?)$")
BEGIN, END, STUB = "# BEGIN SOLUTION", "# END SOLUTION", "# STUB: "
YOUR_CODE = "...  # your code here"
ANSWER = "answer"  # tag of a Markdown cell: folded away in the learner's notebook
OPTIONS = {"tags": list, "alt": str}
KERNELSPEC = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}

# The course in order: every link between notebooks comes from here.
COURSE = {
    "00_find_a_lane": "Find a lane in ten minutes",
    "01_calibrate_the_camera": "Calibrate the camera",
    "02_threshold": "Threshold",
    "03_warp_to_a_birds_eye_view": "Warp to a bird's-eye view",
    "04_detect_the_lane": "Detect the lane",
    "05_process_video": "Process video",
    "06_measure_how_good_it_is": "Measure how good it is",
    "07_make_it_real_time": "Make it real-time",
    "08_use_your_own_camera": "Use your own camera",
}


class SourceError(ValueError):
    """A source that breaks the format; the text names the file, the line and what is wrong."""


@dataclass(frozen=True)
class Cell:
    """One cell of a source: kind "markdown" or "code", its text, and its options."""

    kind: str
    text: str
    tags: tuple[str, ...] = ()
    alt: str = ""
    line: int = field(default=0, compare=False)

    @property
    def is_exercise(self) -> bool:
        """Whether the learner has something to write here."""
        return self.kind == "code" and BEGIN in self.text


def parse(text: str, name: str = "source") -> list[Cell]:
    """The cells of a source in percent format; what stands before the first marker is for authors only."""
    cells, lines, head = [], [], None
    for number, line in enumerate([*text.splitlines(), "# %%"], 1):
        marker = MARKER.match(line)
        if not marker:
            lines.append(line)
            continue
        if head is not None:
            cells.append(_cell(head, lines, name))
        lines, head = [], (marker, number)
    return cells


def _cell(head, lines: list[str], name: str) -> Cell:
    marker, number = head
    kind = "markdown" if marker["kind"] else "code"
    options = _options(marker["options"], f"{name}, line {number}")
    if kind == "markdown":
        for i, line in enumerate(lines, number + 1):
            if line.strip() and not line.startswith("#"):
                raise SourceError(f"{name}, line {i}: in a Markdown cell each line begins with #, found {line!r}")
        lines = [re.sub(r"^# ?", "", line) for line in lines]
    text = "\n".join(lines).strip("\n")
    if not text.strip():
        raise SourceError(f"{name}, line {number}: an empty cell")
    cell = Cell(kind, text, tuple(options.get("tags", ())), options.get("alt", ""), number)
    _solutions(cell, name)
    return cell


def _options(text: str, where: str) -> dict:
    """`tags=["a"] alt="…"` as a dictionary."""
    options, text = {}, text.strip()
    while text:
        key, equals, rest = text.partition("=")
        try:
            value, end = json.JSONDecoder().raw_decode(rest)
        except json.JSONDecodeError:
            value, end = None, 0
        if not equals or not isinstance(value, OPTIONS.get(key, ())):
            raise SourceError(f"{where}: needed options like tags=[\"answer\"] or alt=\"text\", found {text!r}")
        options[key], text = value, rest[end:].strip()
    return options


def _solutions(cell: Cell, name: str = "source") -> list[tuple[int, int]]:
    """Line numbers (begin, end) of the solution markers in a cell."""
    marks = [(i, line.strip()) for i, line in enumerate(cell.text.splitlines()) if line.strip() in (BEGIN, END)]
    if [mark for _, mark in marks] != [BEGIN, END] * (len(marks) // 2) or (marks and cell.kind != "code"):
        raise SourceError(f"{name}, line {cell.line}: each '{BEGIN}' in a code cell needs its '{END}'")
    places = [i for i, _ in marks]
    return list(zip(places[::2], places[1::2], strict=True))


def solved_text(cell: Cell) -> str:
    """A code cell with its solutions, without the marker lines."""
    lines = cell.text.splitlines()
    kept = [line for line in lines if line.strip() not in (BEGIN, END) and not line.strip().startswith(STUB)]
    return _close("\n".join(kept))


def learner_text(cell: Cell) -> str:
    """A code cell with stubs in place of its solutions."""
    lines = cell.text.splitlines()
    for begin, end in reversed(_solutions(cell)):
        inside = lines[begin + 1 : end]
        indent = lines[begin][: len(lines[begin]) - len(lines[begin].lstrip())]
        stubs = [line.strip().removeprefix(STUB) for line in inside if line.strip().startswith(STUB)]
        lines[begin : end + 1] = [indent + stub for stub in stubs or [YOUR_CODE]]
    return _close("\n".join(lines))


def _close(text: str) -> str:
    """In a cell one empty line parts as well as two."""
    return re.sub(r"\n{3,}", "\n\n", text)


def answer_text(cell: Cell) -> str:
    """The solutions of a code cell, as Markdown to be folded away."""
    lines = cell.text.splitlines()
    parts = []
    for begin, end in _solutions(cell):
        inside = [line for line in lines[begin + 1 : end] if not line.strip().startswith(STUB)]
        parts.append(dedent("\n".join(inside)).strip("\n"))
    return "```python\n" + "\n\n".join(parts) + "\n```"


def folded(text: str, summary: str = "Answer") -> str:
    """Markdown that opens with a click."""
    return f"<details>\n<summary><b>{summary}</b></summary>\n\n{text}\n\n</details>"


def navigation(stem: str) -> str:
    """Previous, contents, next."""
    names = list(COURSE)
    if stem not in names:
        return ""
    here, parts = names.index(stem), []

    def link(i: int, text: str) -> str:
        return f"[{text}]({names[i]}.ipynb)"

    if here > 0:
        parts.append(link(here - 1, f"← {names[here - 1][:2]} {COURSE[names[here - 1]]}"))
        parts.append(f"[Contents]({names[0]}.ipynb#The-map-of-the-course)")
    else:
        parts.append("[Contents](#The-map-of-the-course)")
    if here + 1 < len(names):
        parts.append(link(here + 1, f"{names[here + 1][:2]} {COURSE[names[here + 1]]} →"))
    return " · ".join(parts)


def with_navigation(cells: list[Cell], stem: str) -> list[Cell]:
    """The links below the first cell's title, and at the end of the last cell."""
    links = navigation(stem)
    if not links or not cells:
        return cells
    title, _, rest = cells[0].text.partition("\n")
    first = replace(cells[0], text=f"{title}\n\n{links}\n\n{rest.lstrip()}")
    cells = [first, *cells[1:]]
    last = cells[-1]
    if last.kind == "markdown" and ANSWER not in last.tags:
        return [*cells[:-1], replace(last, text=f"{last.text}\n\n---\n{links}")]
    return [*cells, Cell("markdown", f"---\n{links}")]


def solved_notebook(cells: list[Cell], stem: str) -> nbformat.NotebookNode:
    """The solved notebook, not yet run."""
    out = []
    for cell in with_navigation(cells, stem):
        text = f"**Answer**\n\n{cell.text}" if ANSWER in cell.tags else solved_text(cell)
        out.append(replace(cell, text=text))
    return _notebook(out, stem)


def learner_notebook(cells: list[Cell], stem: str) -> nbformat.NotebookNode:
    """The learner's notebook: stubs, and the answers folded away right below."""
    out = []
    for cell in with_navigation(cells, stem):
        if cell.kind == "markdown":
            out.append(replace(cell, text=folded(cell.text)) if ANSWER in cell.tags else cell)
            continue
        out.append(replace(cell, text=learner_text(cell)))
        if cell.is_exercise:
            out.append(Cell("markdown", folded(answer_text(cell)), (ANSWER,)))
    return _notebook(out, stem)


def _notebook(cells: list[Cell], stem: str) -> nbformat.NotebookNode:
    notebook = nbformat.v4.new_notebook(metadata={"kernelspec": KERNELSPEC, "language_info": {"name": "python"}})
    for number, cell in enumerate(cells):
        make = nbformat.v4.new_code_cell if cell.kind == "code" else nbformat.v4.new_markdown_cell
        metadata = {"tags": list(cell.tags)} if cell.tags else {}
        notebook.cells.append(make(cell.text, id=f"n{stem[:2]}-{number:03}", metadata=metadata))
    return notebook


def same_cells(one: nbformat.NotebookNode, other: nbformat.NotebookNode) -> bool:
    """Whether two notebooks have the same cells, whatever their outputs."""

    def essence(notebook):
        return [(c.cell_type, c.source, c.metadata.get("tags", []), c.id) for c in notebook.cells]

    return essence(one) == essence(other)


def with_outputs_of(notebook: nbformat.NotebookNode, stored: nbformat.NotebookNode) -> bool:
    """Take outputs and counts of a stored notebook over, where every code cell is the same; whether that was so."""
    code, old = ([c for c in nb.cells if c.cell_type == "code"] for nb in (notebook, stored))
    if [(c.source, c.metadata) for c in code] != [(c.source, c.metadata) for c in old]:
        return False
    for cell, before in zip(code, old, strict=True):
        cell.outputs, cell.execution_count = before.outputs, before.execution_count
    return True


def read(path: Path) -> list[Cell]:
    """The cells of a source file."""
    return parse(Path(path).read_text(encoding="utf-8"), Path(path).name)
