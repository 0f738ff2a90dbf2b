"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def real_dir() -> Path:
    """The folder of real photographs and hand labels, which is not part of the project."""
    folder = Path(os.environ.get("LANELIB_REAL", ROOT.parent / "shared" / "real"))
    if not folder.is_dir():
        pytest.skip(f"no real photographs at {folder} (set LANELIB_REAL to their folder)")
    return folder
