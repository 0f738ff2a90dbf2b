"""Guard of the course's notebooks: in step with their sources, run in order, of one template, small, and told to all.

nbval (`make test-notebooks`) compares what they say; it compares nothing in a cell that was never run, so that is
looked at here. Nothing runs here.
"""

import ast
import builtins
import json
import re
import sys
import tempfile
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

import notebook_source as source  # noqa: E402

import notebooks as tool  # noqa: E402

SOURCES = tool.sources()
MAX_BYTES = 1_000_000
MAX_LINES, MAX_COLUMNS = 15, 100  # a code-hosting page shows no more columns
IGNORED = "nbval-ignore-output"
HEAD = ("**What you will do:**", "**What you will learn:**", "**What you need:**", "**Minutes:**")
END = (
    "## What you have learned",
    "## When it fails",
    "## How production systems do it",
    "## Further reading",
    "## Three questions",
)
# A path of some machine: a quote or a space, then /word/ or C:\ or ~/
ABSOLUTE = re.compile(r"""(?:^|[\s"'(=])(?:/(?:home|root|tmp|usr|work|Users|mnt|opt|var|data)/|~/|[A-Za-z]:\\)""", re.M)
FORBIDDEN = {
    r"\bsys\.path\b": "sys.path: the package is installed",
    r"^\s*[%!]": "a magic or a shell command",
    r"\bget_ipython\(": "a magic",
    r"\binteract\(": "interact: an explorer of lanelib.explore instead",
    r"warnings\.(simple)?filter": "a silenced warning: cure it",
}

each = pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)


def stored(path: Path) -> nbformat.NotebookNode:
    book = tool.BOOKS / f"{path.stem}.ipynb"
    if not book.exists():
        pytest.fail(f"{book.name} is missing; run: python tools/notebooks.py build {path.stem[:2]}")
    return nbformat.read(book, 4)


def code_cells(notebook) -> list:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def is_ignored(cell) -> bool:
    return IGNORED in cell.metadata.get("tags", [])


def texts(output) -> str:
    """Everything textual in an output, HTML with embedded data apart."""
    data = output.get("data", {})
    return "\n".join(str(output.get(key, "")) for key in ("text", "evalue")) + "\n".join(
        str(value) for kind, value in data.items() if kind.startswith("text/") and "base64," not in str(value)
    )


def test_the_course_has_sources():
    assert [path.stem for path in SOURCES if path.stem not in source.COURSE] == [], "names stand in COURSE"
    assert tool.strangers() == [], "edit the source, not the notebook"


@each
def test_source_solved_and_learner_are_in_step(path):
    assert tool.out_of_step(path) == [], f"run: python tools/notebooks.py build {path.stem[:2]}"


@each
def test_every_cell_ran_in_order_without_error(path):
    notebook = stored(path)
    nbformat.validate(notebook)
    code = code_cells(notebook)
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1)), "run all, in a fresh kernel"
    kinds = {output.output_type for cell in code for output in cell.outputs}
    assert "error" not in kinds
    streams = {o.name for cell in code for o in cell.outputs if o.output_type == "stream"}
    assert "stderr" not in streams, "a warning is stored"


@each
def test_nothing_of_this_machine_is_stored(path):
    notebook = stored(path)
    assert notebook.metadata.kernelspec == source.KERNELSPEC
    assert set(notebook.metadata) == {"kernelspec", "language_info"}, "no widget state, nothing of the author's tools"
    assert dict(notebook.metadata.language_info) == {"name": "python"}
    for cell in notebook.cells:
        everything = cell.source + "\n" + "\n".join(texts(output) for output in cell.get("outputs", []))
        assert not ABSOLUTE.search(everything), f"{cell.id}: an absolute path in: {everything[:300]}"
        assert str(ROOT) not in everything and tempfile.gettempdir() + "/" not in everything, cell.id
        assert set(cell.metadata) <= {"tags"}, f"{cell.id}: {dict(cell.metadata)}"
        assert not any(tool.WIDGET in output.get("data", {}) for output in cell.get("outputs", [])), cell.id


@each
def test_size(path):
    for book in (tool.BOOKS, tool.LEARNER):
        file = book / f"{path.stem}.ipynb"
        assert file.stat().st_size < MAX_BYTES, f"{file.name} has {file.stat().st_size / 1e6:.1f} MB"


@each
def test_cells_are_short_and_plain(path):
    for cell in code_cells(stored(path)):
        lines = cell.source.splitlines()
        assert len(lines) <= MAX_LINES, f"{cell.id} has {len(lines)} lines:\n{cell.source}"
        assert [line for line in lines if len(line) > MAX_COLUMNS] == [], f"{cell.id}: over {MAX_COLUMNS} columns"
        for pattern, what in FORBIDDEN.items():
            assert not re.search(pattern, cell.source, re.M), f"{cell.id}: {what}:\n{cell.source}"


@each
def test_template(path):
    notebook = stored(path)
    first, last = notebook.cells[0].source, "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    assert first.startswith(f"# {path.stem[:2]} {source.COURSE[path.stem]}"), first[:80]
    assert [head for head in HEAD if head not in first] == []
    links = source.navigation(path.stem)
    assert links in first and links in notebook.cells[-1].source
    places = [last.find(f"\n{heading}\n") if f"\n{heading}\n" in f"\n{last}\n" else -1 for heading in END]
    assert -1 not in places and places == sorted(places), dict(zip(END, places, strict=True))
    assert re.search(r"\*\*Minutes:\*\* \d+", first)
    assert "notebook.start(" in code_cells(notebook)[0].source, "the first code cell checks what is needed"
    imports = [c for c in code_cells(notebook)[1:] if re.search(r"^(from|import) ", c.source, re.M)]
    assert len(imports) == 1 and imports[0] is code_cells(notebook)[1], "one import cell, the second code cell"


@each
def test_what_is_shown_is_stored(path):
    """A cell that ends in a value or prints has an output to compare with: nbval passes cells without any."""
    for cell in code_cells(stored(path)):
        body = ast.parse(cell.source).body
        shows = bool(body) and isinstance(body[-1], ast.Expr)
        prints = re.search(r"\b(print|display)\(", cell.source)
        if shows or prints:
            assert cell.outputs, f"{cell.id} shows something, but nothing is stored:\n{cell.source}"


@each
def test_compared_cells_have_text_to_compare(path):
    """Only widgets, videos and times are left out of the comparison; what is compared tells no address."""
    cells = code_cells(stored(path))
    assert sum(is_ignored(cell) for cell in cells) <= len(cells) / 3, "too much is left out of the comparison"
    for cell in cells:
        if not is_ignored(cell):
            for output in cell.outputs:
                assert not re.search(r"\b0x[0-9a-f]{6,}", texts(output)), f"{cell.id}: an address is no result"


@each
def test_figures_are_jpeg_and_described(path):
    for cell in code_cells(stored(path)):
        for output in cell.outputs:
            kinds = {kind for kind in output.get("data", {}) if kind.startswith("image/")}
            assert kinds <= {tool.JPEG}, f"{cell.id}: {kinds}: figures are stored as JPEG"
            for kind in kinds:
                alt = output.metadata.get(kind, {}).get("alt", "")
                assert len(alt) >= 20, f'{cell.id}: say what the figure shows: # %% alt="…"\n{cell.source}'


@each
def test_explorers_have_a_figure_beside_them(path):
    cells = code_cells(stored(path))
    explorers = [i for i, cell in enumerate(cells) if any(tool.WIDGET_TEXT in texts(o) for o in cell.outputs)]
    assert explorers, "each notebook has an explorer"
    for i in explorers:
        assert is_ignored(cells[i]), f"{cells[i].id}: a widget's output is not compared: tag {IGNORED}"
        near = [o for cell in cells[i + 1 : i + 3] for o in cell.outputs]
        assert any(tool.JPEG in o.get("data", {}) for o in near), f"{cells[i].id}: a static figure must follow"


@each
def test_exercises(path):
    cells = source.read(path)
    exercises = [cell for cell in cells if cell.is_exercise]
    assert len(exercises) >= (1 if path.stem.startswith("00") else 3)
    headings = re.findall(r"^### Exercise (\d+): \S", "\n".join(c.text for c in cells if c.kind == "markdown"), re.M)
    assert headings == [str(i + 1) for i in range(len(exercises))]
    for cell in exercises:
        last = ast.parse(source.solved_text(cell)).body[-1]
        assert isinstance(last, ast.Expr) and "check_" in ast.unparse(last), f"line {cell.line}: end with the checker"


@each
def test_solved_exercises_are_right(path):
    for cell in code_cells(stored(path)):
        if "exercises.check_" in cell.source:
            assert "✓ Right" in "".join(texts(output) for output in cell.outputs), cell.source


@each
def test_no_cell_needs_what_the_learner_writes(path):
    """So the learner's notebook runs from top to bottom with all exercises open."""
    written: set[str] = set()
    for cell in source.read(path):
        if cell.kind == "markdown":
            continue
        tree = ast.parse(source.solved_text(cell))
        bound, loaded = names(tree)
        assert not loaded & written, f"line {cell.line} uses {sorted(loaded & written)}, which an exercise defines"
        if cell.is_exercise:
            written |= bound - names(ast.parse(outside_solution(cell)))[0]
            own_functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            written |= own_functions
        else:
            written -= bound


def outside_solution(cell) -> str:
    """The learner's version, where it is Python."""
    return source.learner_text(cell)


def names(tree: ast.Module) -> tuple[set[str], set[str]]:
    """Names that a cell binds at its top level, and names it uses without having bound them."""
    bound = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    stores = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    loads = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
    bound |= stores | {alias.asname or alias.name for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)
                       for alias in n.names}
    return bound, loads - bound - set(dir(builtins))


@each
def test_learner_notebook(path):
    notebook = nbformat.read(tool.LEARNER / f"{path.stem}.ipynb", 4)
    nbformat.validate(notebook)
    for cell in code_cells(notebook):
        assert cell.execution_count is None and cell.outputs == []
        ast.parse(cell.source)
    text = json.dumps(notebook)
    assert source.BEGIN not in text and source.END not in text and source.STUB.strip() not in text
    for cell in source.read(path):
        if cell.is_exercise:
            learner = next(c for c in code_cells(notebook) if c.source == source.learner_text(cell))
            after = notebook.cells[notebook.cells.index(learner) + 1]
            assert after.source.startswith("<details>") and "```python" in after.source


def test_what_is_cleaned_of_outputs_is_cleaned_on_every_system():
    """nbval reads these patterns in the letters that the system prefers."""
    assert (tool.BOOKS / "nbval_sanitize.cfg").read_bytes().isascii()
