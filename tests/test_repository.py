"""The repository as a whole: sizes, paths, hosts, versions that must agree, commands that must exist."""

import ast
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import lanelib
from lanelib.arguments import build_parser

ROOT = Path(__file__).resolve().parents[1]
DATA = ("camera_cal", "test_images", "test_videos", "output_images", "output_videos")
# Written in two halves, or this file would find itself.
REGISTRIES = [a + b for a, b in [("pypi", ".org"), ("pythonhosted", ".org"), ("npmjs", ".org"), ("npmjs", ".com"),
                                 ("deb.debian", ".org"), ("anaconda", ".org"), ("crates", ".io")]]
# What no file may be called on Windows, whatever its ending.
NO_NAME = re.compile(r'[<>:"|?*\\\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE)
MACHINE = re.compile(r"(?<![\w.:/-])/(?:wo" + r"rk|tm" + r"p|ro" + r"ot|ho" + r"me/\w+|Us" + r"ers/\w+|fa" + r"rm)/")


makes = pytest.mark.skipif(shutil.which("make") is None, reason="no make here, as on Windows")


def git(*arguments: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def files() -> list[Path]:
    """What is, or would be, in the repository."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    names = git("ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


def texts(files: list[Path]):
    for path in files:
        if path.stat().st_size < 5_000_000 and path.suffix not in {".jpg", ".jpeg", ".png", ".mp4", ".exr", ".npz"}:
            try:
                yield path.relative_to(ROOT), path.read_text(encoding="utf-8")
            except UnicodeDecodeError:
                continue


def requirements(name: str) -> dict[str, str]:
    lines = [line.split("#")[0].strip() for line in (ROOT / name).read_text().splitlines()]
    return dict(re.fullmatch(r"([A-Za-z0-9_.-]+?)([=<>!~].*)", line).groups() for line in lines if line)


def targets() -> set[str]:
    return set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.M))


# ------------------------------------------------------------------------------------------------------------- content


def test_no_registry_is_named(files):
    named = [f"{path}: {host}" for path, text in texts(files) for host in REGISTRIES if host in text]
    assert not named


def test_no_path_of_somebodys_machine(files):
    # Jupyter's own temporary folder has to be named where nbval's outputs are cleaned of it.
    found = [
        f"{path}: {match.group()}"
        for path, text in texts(files)
        for match in MACHINE.finditer(text)
        if path.name != "nbval_sanitize.cfg"
    ]
    assert not found


def test_large_files_are_data(files):
    large = [path for path in files if path.stat().st_size > 5_000_000 and path.relative_to(ROOT).parts[0] not in DATA]
    assert not large
    assert sum(path.stat().st_size for path in files) < 150_000_000


def test_what_is_fetched_stays_out_of_git():
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    from lanelib.fetch import manifest

    ignored = git("check-ignore", *manifest("udacity"), "test_images/rendered/a.jpg.part").split()
    assert len(ignored) == 44


def test_no_notebook_or_module_is_pickled_data(files):
    assert not [path for path in files if path.suffix in {".p", ".pkl", ".pickle", ".joblib"}]


def test_every_name_can_be_had_on_every_system(files):
    """Windows refuses some, and takes A.jpg and a.jpg for one, as macOS does."""
    names = [path.relative_to(ROOT) for path in files]
    assert not [name for name in names if any(NO_NAME.search(part) for part in name.parts)]
    places = {place.as_posix() for name in names for place in (name, *name.parents)}
    assert len({place.casefold() for place in places}) == len(places)
    assert max(map(len, places)) < 100  # with the folder of the clone a path may have 259 on Windows


def test_every_checkout_has_the_same_bytes():
    """Git for Windows would end the lines of every text with CRLF, and no shell starts such a script."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    ends = [line.split("\t") for line in git("ls-files", "--eol").splitlines()]
    assert not [name for how, name in ends if not re.match(r"i/-text |i/(lf|none) .*attr/.*eol=lf", how)]


# ------------------------------------------------------------------------------------------------ versions that agree


def test_every_requirement_has_a_lower_and_an_upper_bound():
    for name, bounds in (requirements("requirements.txt") | requirements("requirements-dev.txt")).items():
        assert re.fullmatch(r"==[\d.]+|>=[\d.]+,<\d+", bounds), f"{name}{bounds}"


def test_the_oldest_versions_are_the_lower_bounds():
    wanted = requirements("requirements.txt") | requirements("requirements-dev.txt")
    lower = {name: re.match(r">=([\d.]+)", bounds)[1] for name, bounds in wanted.items() if bounds.startswith(">=")}
    oldest = {name: bounds.removeprefix("==") for name, bounds in requirements("constraints-oldest.txt").items()}
    assert oldest.keys() == lower.keys()

    def parts(version):
        numbers = [int(n) for n in version.split(".")]
        return numbers + [0] * (4 - len(numbers))

    for name, version in oldest.items():
        assert parts(version) == parts(lower[name]), name


def test_one_version_of_ruff():
    pinned = requirements("requirements-dev.txt")["ruff"].removeprefix("==")
    assert f"rev: v{pinned}\n" in (ROOT / ".pre-commit-config.yaml").read_text()


def test_one_version_of_lanelib():
    assert f"version: {lanelib.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## {lanelib.__version__} " in (ROOT / "CHANGELOG.md").read_text()


# ----------------------------------------------------------------------------------------------------------- commands


@pytest.mark.skipif(os.name == "nt", reason="a script of bash")
def test_ci_can_be_run_and_runs_the_tests():
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    text = script.read_text()
    assert "set -euo pipefail" in text and re.search(r"^make test$", text, flags=re.M)
    assert "bash .ci/run" in (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    subprocess.run(["bash", "-n", str(script)], check=True)


@makes
def test_make_help_lists_what_there_is():
    r"""On macOS, too, whose sed writes \t as a t."""
    assert not re.search(r"\bsed\b.*\\t", (ROOT / "Makefile").read_text(encoding="utf-8"))
    listed = subprocess.run(["make", "-s", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    listed = set(re.findall(r"^make ([a-z-]+)", listed, flags=re.M))
    assert {"all", "data", "lab", "test", "test-oldest", "bench", "render", "clean", "help"} <= listed <= targets()


@makes
@pytest.mark.parametrize("python", ["nowhere/python3", "false", ""])
def test_make_says_in_one_line_which_python_is_needed(tmp_path, python):
    command = ["make", "-s", "install", f"VENV={tmp_path / 'venv'}", f"PYTHON={python}"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert run.returncode == 2
    assert "Python 3.11 or newer with venv is needed" in run.stderr.splitlines()[0]
    assert not (tmp_path / "venv").exists()


@makes
def test_make_may_stand_in_a_folder_of_any_name(tmp_path):
    folder = tmp_path / "Schüler's Kurs 1"
    folder.mkdir()
    for name in ("Makefile", "pyproject.toml", "requirements.txt", "requirements-dev.txt"):
        shutil.copy(ROOT / name, folder)
    for target in ("course", "test-oldest"):
        run = subprocess.run(["make", "-n", target], cwd=folder, capture_output=True, encoding="utf-8", timeout=60)
        assert run.returncode == 0, run.stderr


def test_the_commands_of_the_readme_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    made = set(re.findall(r"(?:^|`|\$ )make ([a-z][a-z-]*)", text, flags=re.M))
    assert {"test", "lab"} <= made <= targets()


def test_what_the_readme_types_without_make_is_what_make_runs():
    text = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ").replace("$(JOBS)", "2")
    made = [set(line.replace("/ruff", " ruff").replace("'", '"').split()) for line in text.splitlines()]
    typed = re.findall(r"`\.venv\\Scripts\\python -m ([^`]+)`", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert {command.split()[0] for command in typed} == {"pip", "lanelib", "jupyterlab", "ruff", "pytest"}
    for command in typed:
        program, *arguments = command.split()
        assert any({program, *arguments} <= line for line in made), f"make runs no {command}"
        if program == "lanelib":
            assert build_parser().parse_args(arguments).command == arguments[0]


def test_the_links_of_the_documents_lead_somewhere(files):
    broken = []
    for path, text in texts(files):
        if path.suffix == ".md":
            for link in re.findall(r"\]\(([^)\s#]+)[^)]*\)", text):
                if not re.match(r"[a-z]+:", link) and not (ROOT / path.parent / link).exists():
                    broken.append(f"{path}: {link}")
    assert not broken


def test_every_test_can_be_collected_on_windows():
    """A module that is not there costs all tests of the file, not only the one that needs it."""
    unix, found = {"fcntl", "grp", "pwd", "resource", "termios"}, []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found += [f"{path.name}: {name}" for name in names if name in unix]
    assert not found


def test_licence_is_mit():
    text = (ROOT / "LICENSE").read_text()
    assert text.startswith("MIT License") and "The lanelib contributors" in text
