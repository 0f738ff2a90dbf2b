"""Start a Jupyter server, open a notebook in it and run its cells: what the fixtures are made of."""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ARTEFACTS = Path(__file__).parent / "artefacts"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
]
# One notebook holds all explorers: opening a notebook and starting a kernel takes longer than all tests of one.
CELLS = {
    "setup": "import explorer_scenes as scenes\nfrom lanelib import explore\nframe, truth = scenes.frame_and_truth()",
    "distortion": "explore.distortion(scenes.CAMERA, frame)",
    "boards": "explore.boards(*scenes.calibration())",
    "threshold": "explore.threshold(frame, truth)",
    "warp": "explore.warp(frame, scenes.RIG, truth)",
    "detect": "explore.detect(frame, scenes.RIG, truth)",
    "smoothing": "frames, truths = scenes.drive()\nexplore.smoothing(scenes.results_of(frames) * 3, truths * 3)",
    "scrub": "explore.scrub('clip.mp4', explore.simulated_rig())",
    "simulator": "explore.simulator()",
    "broken": "from lanelib.explore.kit import slider\n"
    "def make(x):\n    if x > 1:\n        raise KeyError('on purpose')\n"
    "    return explore.simulator_look()\n"
    "explore.Explorer('Broken explorer', make, {'x': slider('x', 1, 0, 9, 1)})",
}


def serve(root: Path, module: str, *options: str):
    """Start a Jupyter server in ``root``; its address, and its process."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    places = {
        "JUPYTER_CONFIG_DIR": ".cfg",
        "JUPYTERLAB_SETTINGS_DIR": ".set",
        "JUPYTERLAB_WORKSPACES_DIR": ".ws",
        "JUPYTER_RUNTIME_DIR": ".run",
        "IPYTHONDIR": ".ipy",
    }
    environment = os.environ | {name: str(root / place) for name, place in places.items()}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    environment["OPENCV_FOR_THREADS_NUM"] = "1"
    with open(root / f"{module}.log", "w") as log:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                module,
                "--no-browser",
                "--allow-root",
                "--ip=127.0.0.1",
                f"--port={port}",
                "--ServerApp.port_retries=0",
                "--IdentityProvider.token=",
                f"--ServerApp.root_dir={root}",
                "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
                "--LabApp.news_url=None",
                *options,
            ],
            env=environment,
            cwd=root,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
    url = f"http://127.0.0.1:{port}"
    for _ in range(300):
        try:
            urllib.request.urlopen(url + "/api/status", timeout=1).close()
            return url, process
        except OSError:
            if process.poll() is not None:
                break
            time.sleep(0.2)
    end(process)
    pytest.fail(f"the server did not start:\n{(root / f'{module}.log').read_text()[-3000:]}")


def end(process: subprocess.Popen) -> None:
    """Ask a server to end, and see that it does."""
    process.terminate()
    try:
        process.wait(15)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(5)


def open_and_run(browser, url: str, address: str, *, width: int = 1200):
    """A page with a notebook of which every cell was run. It keeps what went wrong: ``page.faults`` (of the page),
    ``page.outside`` (requests that left the machine), and in the page ``_kernelErrors``."""
    page = browser.new_page(viewport={"width": width, "height": 1000})
    page.set_default_timeout(15_000)
    page.faults, page.outside = [], []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("console", lambda m: page.faults.append(f"{m.text} {m.location['url']}") if m.type == "error" else None)
    inside = (url, "data:", "blob:", url.replace("http", "ws"))
    page.on("request", lambda r: None if r.url.startswith(inside) else page.outside.append(r.url))
    page.goto(f"{url}/{address}", wait_until="domcontentloaded")
    page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=90_000)
    # The toolbar says "idle" before the kernel is reached: ask the session itself.
    page.wait_for_function(
        """() => {
        const kernel = window.jupyterapp?.shell.currentWidget?.context?.sessionContext?.session?.kernel;
        return kernel && kernel.connectionStatus === 'connected' && kernel.status === 'idle';
    }""",
        timeout=90_000,
    )
    page.evaluate("""() => {
        const kernel = window.jupyterapp.shell.currentWidget.context.sessionContext.session.kernel;
        window._kernelErrors = [];
        kernel.iopubMessage.connect((_, m) => {
            if (m.header.msg_type === 'error') window._kernelErrors.push(`${m.content.ename}: ${m.content.evalue}`);
            if (m.header.msg_type === 'stream' && m.content.name === 'stderr'
                && !m.content.text.startsWith('No such comm')) window._kernelErrors.push(m.content.text);
        });
        window.jupyterapp.commands.execute('notebook:run-all-cells').then(
            () => { window._ran = 'yes'; }, e => { window._ran = String(e); });
    }""")
    page.wait_for_function("() => window._ran", timeout=120_000)
    assert page.evaluate("() => window._ran") == "yes"
    assert page.evaluate("() => window._kernelErrors") == []
    return page
