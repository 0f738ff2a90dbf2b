"""A real JupyterLab server on loopback and a real Chromium; skipped, with the reason, where one is missing."""

import os
import shutil
from pathlib import Path

import explorer_scenes
import nbformat
import pytest
from lab_server import BROWSERS, CELLS, FLAGS, end, open_and_run, serve


@pytest.fixture(scope="session")
def browser():
    """Chromium under Playwright."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is not installed: pip install playwright"
    )
    program = os.environ.get("LANELIB_CHROME") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if not program:
        pytest.skip(
            "no Chromium found (Debian: apt-get install -y --no-install-recommends chromium; or LANELIB_CHROME)"
        )
    with playwright.sync_playwright() as p:
        started = p.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    """The server's folder: the notebook, its clip, its scenes; and a configuration of its own."""
    root = tmp_path_factory.mktemp("lab")
    shutil.copy(explorer_scenes.__file__, root)
    explorer_scenes.write_clip(root / "clip.mp4")
    notebook = nbformat.v4.new_notebook(metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}})
    notebook.cells = [nbformat.v4.new_code_cell(source) for source in CELLS.values()]
    nbformat.write(notebook, root / "explorers.ipynb")
    (root / ".cfg/labconfig").mkdir(parents=True)
    off = '{"disabledExtensions": {"@jupyterlab/apputils-extension:announcements": true}}'
    (root / ".cfg/labconfig/page_config.json").write_text(off)
    settings = root / ".set/@jupyterlab/notebook-extension"
    settings.mkdir(parents=True)
    (settings / "tracker.jupyterlab-settings").write_text('{"windowingMode": "none"}')  # cells below the fold, too
    return root


@pytest.fixture(scope="session")
def lab_page(browser, folder):
    """JupyterLab with the notebook of all explorers, run."""
    url, process = serve(folder, "jupyterlab", "--LabApp.expose_app_in_browser=True")
    try:
        page = open_and_run(browser, url, "doc/tree/explorers.ipynb?reset")
        yield page
        page.close()
    finally:
        end(process)
