from __future__ import annotations

from pathlib import Path

import pytest

from rkfbench.report.material import Material
from rkfbench.store import Results
from tests.report import fakes


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A results folder that tests only read."""
    return fakes.write_results(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="session")
def material(results: Results) -> Material:
    return fakes.material(results)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A results folder of the test's own."""
    return fakes.write_results(tmp_path / "fake").folder
