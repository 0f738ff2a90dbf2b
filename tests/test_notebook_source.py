"""The format of the notebooks' sources, and the tolerance with which their outputs are compared."""

import importlib.util
import re
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

import notebook_source as source  # noqa: E402

import notebooks as tool  # noqa: E402

TEXT = '''"""For authors."""
# %% [markdown]
# # 03 Title
#
# A $y$ # %% in the middle

# %% tags=["a", "b"] alt="A \\"bent\\" road = left"
x = 1


y = 2  # %% no marker

# %%
def f(a):
    """Doc."""
    # BEGIN SOLUTION
    # STUB: b = ...
    # STUB: return b
    if a:
        return 2

    return 3
    # END SOLUTION


check_f(f)

# %% [markdown] tags=["answer"]
# because
'''


def test_cells():
    cells = source.parse(TEXT)
    assert [cell.kind for cell in cells] == ["markdown", "code", "code", "markdown"]
    assert cells[0].text == "# 03 Title\n\nA $y$ # %% in the middle"
    assert cells[1].text == "x = 1\n\n\ny = 2  # %% no marker"
    assert cells[1].tags == ("a", "b") and cells[1].alt == 'A "bent" road = left'
    assert [cell.is_exercise for cell in cells] == [False, False, True, False]
    assert [cell.line for cell in cells] == [2, 7, 13, 28]


def test_solved_and_learner_text():
    cell = source.parse(TEXT)[2]
    solved = 'def f(a):\n    """Doc."""\n    if a:\n        return 2\n\n    return 3\n\ncheck_f(f)'
    assert source.solved_text(cell) == solved
    assert source.learner_text(cell) == 'def f(a):\n    """Doc."""\n    b = ...\n    return b\n\ncheck_f(f)'
    assert source.answer_text(cell) == "```python\nif a:\n    return 2\n\nreturn 3\n```"


def test_a_stub_of_its_own_is_not_needed():
    cell = source.parse("# %%\n# BEGIN SOLUTION\nn = 4\n# END SOLUTION\ncheck(n)\n")[0]
    assert source.learner_text(cell) == "...  # your code here\ncheck(n)"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("# %%\n# BEGIN SOLUTION\nx = 1\n", "END SOLUTION"),
        ("# %%\n# END SOLUTION\n# BEGIN SOLUTION\n", "END SOLUTION"),
        ("# %% [markdown]\n# BEGIN SOLUTION\n# END SOLUTION\ntext\n", "line 4"),
        ("# %% [markdown]\n# a\nb = 1\n", "line 3"),
        ("# %% tag=['a']\nx = 1\n", "tags="),
        ('# %% alt=["a"]\nx = 1\n', "alt="),
        ('# %% tags=["a"\nx = 1\n', "line 1"),
        ("# %%\n\n# %%\nx = 1\n", "line 1: an empty cell"),
    ],
)
def test_what_breaks_the_format_is_said(text, says):
    with pytest.raises(source.SourceError, match=r"s\.py, line \d") as caught:
        source.parse(text, "s.py")
    assert says in str(caught.value)


def test_notebooks_from_a_source():
    cells = source.parse(TEXT)
    solved, learner = source.solved_notebook(cells, "03_x"), source.learner_notebook(cells, "03_x")
    for notebook in (solved, learner):
        nbformat.validate(notebook)
        assert len({cell.id for cell in notebook.cells}) == len(notebook.cells)
    assert [cell.cell_type for cell in solved.cells] == ["markdown", "code", "code", "markdown"]
    assert solved.cells[3].source == "**Answer**\n\nbecause"
    assert [cell.cell_type for cell in learner.cells] == ["markdown", "code", "code", "markdown", "markdown"]
    assert "return 3" not in learner.cells[2].source and "return 3" in learner.cells[3].source
    assert learner.cells[4].source.startswith("<details>") and "because" in learner.cells[4].source


def test_links_between_notebooks():
    first, middle, last = (source.navigation(stem) for stem in ("00_find_a_lane", "03_warp_to_a_birds_eye_view",
                                                                "08_use_your_own_camera"))
    assert "←" not in first and "](01_calibrate_the_camera.ipynb)" in first
    assert "](02_threshold.ipynb)" in middle and "](04_detect_the_lane.ipynb)" in middle
    assert "](00_find_a_lane.ipynb#The-map-of-the-course)" in middle
    assert "→" not in last and "](07_make_it_real_time.ipynb)" in last
    assert source.navigation("99_other") == ""


def test_a_changed_cell_is_out_of_step(tmp_path, monkeypatch):
    for name, folder in (("BOOKS", tmp_path), ("LEARNER", tmp_path / "learner"), ("ROOT", tmp_path)):
        monkeypatch.setattr(tool, name, folder)
    path = tmp_path / "03_x.py"
    path.write_text(TEXT)
    assert [line.split()[-1] for line in tool.out_of_step(path)] == ["missing", "missing"]
    (tmp_path / "learner").mkdir()
    cells = source.read(path)
    nbformat.write(source.solved_notebook(cells, "03_x"), tmp_path / "03_x.ipynb")
    nbformat.write(source.learner_notebook(cells, "03_x"), tmp_path / "learner" / "03_x.ipynb")
    assert tool.out_of_step(path) == []
    path.write_text(TEXT.replace("return 2", "return 4"))
    assert len(tool.out_of_step(path)) == 2
    path.write_text(TEXT.replace('["a", "b"]', '["a"]'))
    assert len(tool.out_of_step(path)) == 2


def test_outputs_are_kept_where_only_text_changed():
    old = source.solved_notebook(source.parse(TEXT), "03_x")
    for count, cell in enumerate([cell for cell in old.cells if cell.cell_type == "code"], 1):
        cell.execution_count = count
        cell.outputs = [nbformat.v4.new_output("stream", name="stdout", text=str(count))]
    new = source.solved_notebook(source.parse(TEXT.replace("because", "therefore\n# \n# more")), "03_x")
    assert source.with_outputs_of(new, old)
    assert [cell.outputs[0].text for cell in new.cells if cell.cell_type == "code"] == ["1", "2"]
    other = source.solved_notebook(source.parse(TEXT.replace("x = 1", "x = 2")), "03_x")
    assert not source.with_outputs_of(other, old)
    assert not source.with_outputs_of(source.solved_notebook(source.parse(TEXT.replace('"b"]', '"c"]')), "03_x"), old)


def test_stored_outputs_are_tidied():
    notebook = source.solved_notebook(source.parse(TEXT), "03_x")
    image = nbformat.v4.new_output("display_data", {tool.JPEG: "abc", "text/plain": "<Figure>"})
    widget = nbformat.v4.new_output("display_data", {tool.WIDGET: {"model_id": "1"}, "text/plain": "Slider()"})
    notebook.cells[1].outputs = [image, widget]
    notebook.metadata["widgets"] = {"state": {}}
    tool.tidy(notebook, {notebook.cells[1].id: "A road"})
    assert notebook.cells[1].outputs[0].metadata == {tool.JPEG: {"alt": "A road"}}
    assert list(notebook.cells[1].outputs[1].data) == ["text/markdown"]
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    notebook.cells[1].outputs = [nbformat.v4.new_output("stream", name="stderr", text="a warning")]
    with pytest.raises(SystemExit, match="stderr"):
        tool.tidy(notebook)


@pytest.fixture(scope="module")
def tolerant():
    spec = importlib.util.spec_from_file_location("notebooks_conftest", ROOT / "notebooks" / "conftest.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Tolerant


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("RMS 0.8532 px over 17 boards", "RMS 0.8535 px over 17 boards", True),
        ("RMS 0.8532 px over 17 boards", "RMS 0.8552 px over 17 boards", False),
        ("RMS 0.8532 px over 17 boards", "RMS 0.8532 px over 18 boards", False),
        ("width 3.65 m", "width 3.66 m", True),  # the last of three digits may be rounded the other way
        ("width 3.64 m", "width 3.66 m", False),
        ("offset 0.04 m", "offset 0.05 m", False),  # one digit is all there is
        ("miss 0.6 cm", "miss 0.7 cm", False),
        ("radius 1000 m", "radius 1001 m", False),  # integers are counts
        ("offset -0.251 m", "offset 0.251 m", False),
        ("offset −0.251 m", "offset -0.2511 m", True),  # the typographer's minus
        ("offset −0.251 m", "offset −0.2511 m", True),
        ("left 1.0", "right 1.0", False),
        ("1.0 2.0", "1.0 2.0 3.0", False),
        ("shape (720, 1280, 3)", "shape (1280, 720, 3)", False),
        ("1.50e-03", "1.5001e-3", True),
        ("v1.2.3", "v1.2.4", False),
        ("nan", "1.0", False),
    ],
)
def test_outputs_are_compared_by_words_and_numbers(tolerant, one, other, same):
    assert (tolerant(one) == other) is same
    assert (tolerant(one) != other) is not same


def test_all_pages_say_the_same_minutes():
    """The first lines of each notebook, the map in notebook 00, the README's table and the teacher's page."""
    said = {}
    for path in sorted((ROOT / "notebooks" / "source").glob("[0-9][0-9]_*.py")):
        text = path.read_text(encoding="utf-8")
        minutes = re.search(r"\*\*Minutes:\*\* (\d+) to read and run, (\d+) with the exercises", text)
        said[path.name[:2]] = minutes.groups()
    assert len(said) == 9
    readme, teaching = ((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/TEACHING.md"))
    course_map = (ROOT / "notebooks/source/00_find_a_lane.py").read_text(encoding="utf-8")
    for number, (reading, whole) in said.items():
        assert re.search(rf"\| {number} \| \[[^\]]+\]\(\S+\) \| {whole} \|", readme), number
        assert re.search(rf"\| {number} [^|]+\| {reading} \| {whole} \|", teaching), number
        assert re.search(rf"\| (\*\*|\[){number} [^|]+\|[^|]+\| {whole} \|", course_map), number
