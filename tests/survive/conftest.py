"""The study that nothing disturbs, run once."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest

from tests.survive.study import SMALL, Study


class Whole(NamedTuple):
    """What the undisturbed study gives, and how long it takes."""

    numbers: dict[str, bytes]
    seconds: float


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    study = Study.at(tmp_path_factory.mktemp("undisturbed"))
    begin = time.perf_counter()
    assert study.run("--jobs", "1").code == 0
    return Whole(study.numbers(), time.perf_counter() - begin)


@pytest.fixture(scope="session")
def counted(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], int]:
    """The small study, and how many files it writes, the manifest each time."""
    study = Study.at(tmp_path_factory.mktemp("small"), runs=SMALL)
    with patch("os.replace", side_effect=os.replace) as replace:
        assert study.run_here().code == 0
    return study.numbers(), replace.call_count


@pytest.fixture
def small_whole(counted: tuple[dict[str, bytes], int]) -> dict[str, bytes]:
    return counted[0]


@pytest.fixture
def writes(counted: tuple[dict[str, bytes], int]) -> int:
    return counted[1]


@pytest.fixture
def small(tmp_path: Path) -> Study:
    """The study with few runs, for this process."""
    return Study.at(tmp_path, runs=SMALL)


@pytest.fixture
def whole(undisturbed: Whole) -> dict[str, bytes]:
    return undisturbed.numbers


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return Study.at(tmp_path)
