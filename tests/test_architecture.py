"""The rooms of docs/ARCHITECTURE.md: every module has a floor, arrows go downward, image functions touch no files.

The table in that document is the source; this test reads it, so the two cannot drift apart.
"""

import ast
import os
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "lanelib"
FLOORS = ("basement", "ground", "first", "second", "third", "roof")
# Only from the third floor up: figures, widgets, video, programs, network.
UPSTAIRS = {"matplotlib", "ipywidgets", "IPython", "anywidget", "tqdm", "imageio_ffmpeg", "pooch"}
UPSTAIRS |= {"subprocess", "socket"}
# No image function calls these, on any floor below the third.
BANNED_CALLS = {"print", "input", "open", "exec", "eval"}
BANNED_CV2 = {"imread", "imwrite", "imshow", "waitKey", "VideoCapture", "VideoWriter"}
FILE_METHODS = {"read_text", "read_bytes", "write_text", "write_bytes"}
# The two rooms below that read and write files for others; a class may `load` and `save` its own.
OF_FILES = {"files", "pictures"}


def floor_table() -> dict[str, int]:
    table = {}
    for line in (ROOT / "docs" / "ARCHITECTURE.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) >= 4 and cells[1] in FLOORS:
            for module in re.findall(r"`(\w+)(?:\.py|/)`", cells[2]):
                assert module not in table, f"{module} stands twice in the table of rooms"
                table[module] = FLOORS.index(cells[1])
    return table


FLOOR = floor_table()
MODULES = sorted(
    {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in PACKAGE.rglob("*.py")} - {"__init__"}
)


def sources(module: str) -> list[Path]:
    """The module's file, or all files of a package."""
    single = PACKAGE / f"{module}.py"
    return [single] if single.exists() else sorted((PACKAGE / module).rglob("*.py"))


def trees(module: str) -> list[ast.Module]:
    return [ast.parse(path.read_text(encoding="utf-8")) for path in sources(module)]


def imports(module: str) -> tuple[set[str], set[str]]:
    """Modules of lanelib, and top-level names of other packages, that it imports anywhere."""
    ours, others = set(), set()
    for tree in trees(module):
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = ("lanelib." if node.level else "") + (node.module or "")
                base = base.rstrip(".")
                names = [f"{base}.{alias.name}" for alias in node.names] if base == "lanelib" else [base]
            else:
                continue
            for name in names:
                top, _, rest = name.partition(".")
                if top != "lanelib":
                    others.add(top)
                elif rest.split(".")[0] in MODULES:
                    ours.add(rest.split(".")[0])
    return ours - {module}, others


def test_every_module_has_its_place_in_the_document():
    assert set(MODULES) - set(FLOOR) == set(), "these modules stand in no row of docs/ARCHITECTURE.md"


@pytest.mark.parametrize("module", MODULES)
def test_arrows_only_go_downward(module):
    upward = {other for other in imports(module)[0] if FLOOR.get(other, 0) > FLOOR.get(module, len(FLOORS))}
    assert not upward, f"{module} imports from a higher floor: {sorted(upward)}"


def test_no_module_depends_on_itself_through_others():
    try:
        TopologicalSorter({module: imports(module)[0] for module in MODULES}).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


BELOW_THIRD = [module for module in MODULES if FLOOR.get(module, 99) < FLOORS.index("third")]


@pytest.mark.parametrize("module", BELOW_THIRD)
def test_figures_widgets_and_programs_are_upstairs(module):
    assert not imports(module)[1] & UPSTAIRS


@pytest.mark.parametrize("module", [module for module in BELOW_THIRD if module not in OF_FILES])
def test_image_functions_touch_no_files_and_print_nothing(module):
    found = []
    for tree in trees(module):
        inside = {id(n): f.name for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            called, where = node.func, inside.get(id(node), "the module")
            if isinstance(called, ast.Name) and called.id in BANNED_CALLS:
                found.append(f"{called.id} in {where}, line {node.lineno}")
            if isinstance(called, ast.Attribute):
                owner = called.value.id if isinstance(called.value, ast.Name) else ""
                if owner == "cv2" and called.attr in BANNED_CV2:
                    found.append(f"cv2.{called.attr} in {where}, line {node.lineno}")
                if called.attr in FILE_METHODS and where not in ("load", "save"):
                    found.append(f"{called.attr} in {where}, line {node.lineno}")
    assert not found


def test_importing_the_finder_loads_no_figures_and_no_widgets():
    """What an engineer embeds must not drag in a plotting library or Jupyter."""
    heavy = sorted(UPSTAIRS - {"subprocess", "socket"})
    program = f"import sys, lanelib.finder; print([name for name in {heavy} if name in sys.modules])"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program]
    assert subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout == "[]\n"


@pytest.mark.parametrize("module", MODULES)
def test_no_text_is_read_or_written_in_whatever_the_system_prefers(module):
    """On Windows that has neither a κ nor a ✓."""
    found = []
    for tree in trees(module):
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            given = {keyword.arg for keyword in call.keywords}
            modes = {value.value for value in call.args if isinstance(value, ast.Constant)}
            text = isinstance(call.func, ast.Attribute) and name in ("read_text", "write_text")
            text = text or (name in ("run", "Popen") and "text" in given) or (name == "open" and modes & set("rwax"))
            if text and "encoding" not in given:
                found.append(f"{name}, line {call.lineno}")
    assert not found


@pytest.mark.parametrize("module", sorted(set(MODULES) - {"datasets"}))
def test_only_datasets_builds_paths_of_the_data_folders(module):
    folder = re.compile(r"(camera_cal|test_images|test_videos|output_images|output_videos)")
    for tree in trees(module):
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        joined = {id(end) for n in ast.walk(tree) if isinstance(n, ast.BinOp) for end in (n.left, n.right)}
        joined |= {id(argument) for node in ast.walk(tree) if isinstance(node, ast.Call) for argument in node.args
                   if isinstance(node.func, ast.Name) and node.func.id == "Path"}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                # Alone, such a word may be an attribute's name; with a slash before or after it, it is a path. What
                # has a space in it is a help text.
                is_path = folder.fullmatch(node.value) and id(node) in joined
                is_path = is_path or re.fullmatch(folder.pattern + r"/\S*", node.value)
                assert not is_path, f"{module}, line {node.lineno}: {node.value!r}: ask datasets.py instead"
