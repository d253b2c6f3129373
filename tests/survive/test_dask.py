"""A worker of a dask cluster that is killed: others take its work over, and the study completes."""

from __future__ import annotations

import os
import signal

import pytest

from tests.survive.study import Study, ended
from tests.survive.test_killed import no_process_is_left, wait_for_blocks, workers

pytest.importorskip("distributed")
pytest.importorskip("rkfbench.study.cluster")  # the engine


@pytest.mark.slow
def test_the_study_completes_when_a_dask_worker_is_killed(study: Study) -> None:
    long = ("--set", "steps=120")
    process = study.start("--scheduler", "local", "--jobs", "2", *long)
    wait_for_blocks(study, 1)
    os.kill(workers(process.pid)[0], signal.SIGKILL)
    done = ended(process)
    assert (done.code, "Traceback" in done.err) == (0, False), done.err
    assert no_process_is_left(process.pid)
    other = Study.at(study.place / "other")
    other.run("--jobs", "1", *long)
    assert study.numbers() == other.numbers()
