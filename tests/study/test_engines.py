"""Engines, shards, and how work is packed: whatever gets it done, the bytes of the results are the same."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rkfbench.errors import RkfbenchError, UsageError
from rkfbench.experiment import Experiment
from rkfbench.pool import Pool
from rkfbench.scenario import Scenario, load
from rkfbench.store import Results
from rkfbench.store.lock import locked, shared
from rkfbench.study import cluster, engines, jobs, plan
from rkfbench.study.compute import sharing
from rkfbench.study.engines import Engine
from rkfbench.study.jobs import Done, Job
from rkfbench.study.packing import Agenda, divided, packed
from rkfbench.study.run import compute_shard, run_study
from rkfbench.study.shards import Shard
from tests.conftest import SMALL

ROOT = str(Path(__file__).parents[2])
LARGER = (
    SMALL.replace("steps: 12", "steps: 1500")
    .replace("{paper: 6,", "{paper: 300,")
    .replace(
        "filters: [kf, {use: hkf, threshold: 2}]", "filters: [kf, {use: hkf, threshold: 2}, aladkf, clairvoyant_kf]"
    )
    .replace("metrics: [", "metrics: [cond_ratio_top_psi, ")
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scenario of two cases, two blocks each, four filters, two of which are compared with a third."""
    path = tmp_path_factory.mktemp("scenario") / "small.yaml"
    path.write_text(LARGER)
    return path


@pytest.fixture(scope="module")
def study(file: Path) -> Scenario:
    return load(file)


@pytest.fixture(scope="module")
def expected(study: Scenario, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The tables of a serial run."""
    folder = tmp_path_factory.mktemp("serial") / "r"
    assert not run_study(study, folder).failures
    return tables(folder)


def tables(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.csv"))}


def case_by_case(work: Sequence[Job]) -> Generator[Done]:
    """Every filter of every case in a job of its own."""
    yield from map(jobs.work, (single for job in work for single in job.singles()))


def pooled(engine: Callable[[Sequence[Job], Pool], Generator[Done]]) -> Engine:
    """An engine with a pool of two processes for one study."""

    def engine_of_its_own(work: Sequence[Job]) -> Generator[Done]:
        with Pool(2) as pool:
            yield from engine(work, pool)

    return engine_of_its_own


@pytest.fixture
def in_process() -> Iterator[str]:
    """The address of a scheduler with one worker in this very process."""
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options, silence_logs="ERROR") as here:
        yield here.scheduler_address


def same_bytes(study: Scenario, folder: Path, engine: Engine, expected: dict[str, bytes]) -> None:
    assert not run_study(study, folder, engine=engine).failures
    assert {"summary.csv", "runs.csv", "series.csv"} <= expected.keys()
    assert tables(folder) == expected
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    "engine",
    [case_by_case, pooled(engines.automatic), pooled(engines.processes), partial(cluster.local, workers=2)],
    ids=["case by case", "automatic", "2 processes", "dask with 2 processes"],
)
def test_every_engine_gives_the_same_bytes(
    study: Scenario, tmp_path: Path, engine: Engine, expected: dict[str, bytes]
) -> None:
    same_bytes(study, tmp_path / "r", engine, expected)


def test_dask_in_one_process_gives_the_same_bytes(
    study: Scenario, tmp_path: Path, in_process: str, expected: dict[str, bytes]
) -> None:
    same_bytes(study, tmp_path / "r", partial(cluster.remote, address=in_process), expected)


def test_the_study_survives_a_killed_worker(study: Scenario, tmp_path: Path, expected: dict[str, bytes]) -> None:
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": "CRITICAL"}
    with distributed.LocalCluster(**options) as two, distributed.Client(two, set_as_default=False) as client:
        killed: list[int] = []

        def shot(work: Sequence[Job]) -> Generator[Done]:
            for done in cluster.remote(work, two.scheduler_address):
                if not killed:
                    killed.extend(list(client.run(os.getpid).values())[:1])
                    os.kill(killed[0], signal.SIGKILL)
                yield done

        assert not run_study(study, tmp_path / "r", engine=shot).failures
        assert killed and killed[0] not in client.run(os.getpid).values()
    assert tables(tmp_path / "r") == expected


def test_a_killed_process_is_one_message_and_what_was_finished_is_kept(
    study: Scenario, tmp_path: Path, expected: dict[str, bytes]
) -> None:
    def shot(work: Sequence[Job]) -> Generator[Done]:
        for done in pooled(engines.processes)(work):
            for process in {*multiprocessing.active_children()} - before:
                process.kill()
            yield done

    before = {*multiprocessing.active_children()}  # a cluster of another test may still be ending
    with pytest.raises(RkfbenchError, match="a worker process was killed"):
        run_study(study, tmp_path / "r", engine=shot)
    assert {*multiprocessing.active_children()} <= before
    assert list((tmp_path / "r/blocks").iterdir())
    assert run_study(study, tmp_path / "r").computed > 0
    assert tables(tmp_path / "r") == expected


def test_a_worker_with_other_code_is_refused(study: Scenario, tmp_path: Path) -> None:
    unit = next(plan.units(study, tmp_path, full=False))
    (job, *_) = packed([(unit, unit.labels)], study.seed, study.runs)
    with pytest.raises(RkfbenchError, match="another version of rkfbench"):
        cluster.checked(job, "another")


def test_a_scheduler_that_is_not_there_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 0.2)
    with pytest.raises(UsageError, match="no dask scheduler answers at tcp"):
        list(cluster.remote([], "tcp://127.0.0.1:9"))


@pytest.mark.parametrize("address", ["foo", "tcp://[::1", "http://here:8786", "inproc://x", "tls://127.0.0.1:9"])
def test_what_is_no_address_of_a_scheduler_is_told_before_a_client_is_made(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", None)  # half made, it hangs when it is collected
    with pytest.raises(UsageError, match=r"no dask scheduler answers at .*, which should be tcp://HOST:PORT: "):
        list(cluster.remote([], address))


def test_a_scheduler_without_workers_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "WORKERS", 0.2)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        pytest.raises(UsageError, match="has no workers: start some with `dask worker"),
    ):
        list(cluster.remote([], empty.scheduler_address))


def test_shards_at_once_in_one_folder_are_merged_by_a_plain_run(
    file: Path, study: Scenario, tmp_path: Path, expected: dict[str, bytes]
) -> None:
    command = [sys.executable, "-m", "rkfbench", "run", str(file), "--out", str(tmp_path / "r"), "--shard"]
    environment = os.environ | {"PYTHONPATH": ROOT}
    shards = [
        subprocess.Popen([*command, f"{i}/3"], env=environment, stderr=subprocess.PIPE, text=True) for i in (1, 2, 3)
    ]
    said = [shard.communicate(timeout=120)[1] for shard in shards]
    assert [shard.returncode for shard in shards] == [0, 0, 0]
    assert all("the same command without --shard makes the tables" in each for each in said)
    assert [path.name for path in (tmp_path / "r").iterdir() if not path.name.startswith(".")] == ["blocks"]
    assert len(list((tmp_path / "r/blocks").iterdir())) == 4
    outcome = run_study(study, tmp_path / "r")
    assert (outcome.computed, outcome.reused) == (0, 4)
    assert tables(tmp_path / "r") == expected
    assert not (tmp_path / "r/.lock").exists()


def test_shards_of_their_own_folders_are_merged_by_copying_blocks(
    study: Scenario, tmp_path: Path, expected: dict[str, bytes]
) -> None:
    left = [compute_shard(study, tmp_path / f"{i}", Shard(i, 2)).open for i in (1, 2)]
    assert left == [2, 2]
    (tmp_path / "r/blocks").mkdir(parents=True)
    for block in tmp_path.glob("[12]/blocks/*"):
        block.rename(tmp_path / "r/blocks" / block.name)
    assert run_study(study, tmp_path / "r").computed == 0
    assert tables(tmp_path / "r") == expected


def test_shards_share_a_folder_and_a_run_wants_it_alone(tmp_path: Path) -> None:
    both = shared(tmp_path / "r"), shared(tmp_path / "r")
    with both[0], both[1], pytest.raises(UsageError, match="in use by shards"), locked(tmp_path / "r"):
        pass
    with locked(tmp_path / "r"), pytest.raises(UsageError, match="in use by another run"), shared(tmp_path / "r"):
        pass


def test_shards_go_without_locks_where_there_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(handle: int, kind: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("rkfbench.store.lock.fcntl.flock", flock)
    with shared(tmp_path / "r"):
        pass
    with pytest.raises(UsageError, match="No locks available"), locked(tmp_path / "r"):
        pass


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "1/0", "a/b", "-1/3"])
def test_a_shard_that_does_not_exist_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="i/n with i from 1 to n"):
        Shard.of(text)


def test_shards_divide_the_blocks() -> None:
    assert [[i for i in range(7) if Shard(number, 3).has(i)] for number in (1, 2, 3)] == [[0, 3, 6], [1, 4], [2, 5]]


def places(work: Sequence[Job]) -> list[tuple[int, str]]:
    return sorted((unit, label) for job in work for unit in job.units for label in job.labels)


@pytest.mark.parametrize("workers", [1, 2, 3, 100])
def test_work_that_is_divided_is_all_the_work_once(study: Scenario, tmp_path: Path, workers: int) -> None:
    units = list(plan.units(study, tmp_path, full=False))
    whole = packed([(unit, unit.labels) for unit in units], study.seed, study.runs)
    pieces = divided(whole, workers)
    assert (
        places(pieces) == places(whole) == sorted((i, label) for i, unit in enumerate(units) for label in unit.labels)
    )
    assert len(pieces) >= min(2 * workers, 16)


def test_cases_are_packed_side_by_side_within_the_memory_of_a_block(tmp_path: Path, file: Path) -> None:
    short = load(file, sweeps=["measurement_noise.rate=0:0.9:10"], sets=["steps=500"], runs=100)
    units = list(plan.units(short, tmp_path, full=False))
    whole = packed([(unit, unit.labels) for unit in units], short.seed, short.runs)
    assert [len(job.units) for job in whole] == [8, 2]  # 8 times 128 runs are one block of 500 steps


def test_filters_that_share_work_are_divided_last(study: Scenario, tmp_path: Path) -> None:
    units = list(plan.units(study, tmp_path, full=False))[:1]
    whole = packed([(unit, unit.labels) for unit in units], study.seed, study.runs)
    tied = [("kf", "hkf"), ("aladkf",), ("clairvoyant_kf",)]  # hkf has a metric that compares it with kf
    assert sharing(Experiment.of(whole[0].specs[0]), whole[0].labels) == tied
    assert divided(whole * 4, 2) == whole * 4
    assert [job.labels for job in divided(whole, 1)] == [("kf", "hkf", "clairvoyant_kf"), ("aladkf",)]
    assert [job.labels for job in divided(whole, 2)] == [(label,) for label in whole[0].labels]


def test_filters_that_go_case_by_case_have_their_cases_divided(tmp_path: Path, file: Path) -> None:
    units = list(plan.units(load(file, runs=100), tmp_path, full=False))
    whole = packed([(unit, unit.labels) for unit in units], 1, 100)
    assert [job.units for job in whole] == [(0, 1)]
    assert [(job.units, job.labels) for job in divided(whole, 1)] == [
        ((0, 1), ("kf", "hkf")),
        ((0, 1), ("aladkf",)),
        ((0,), ("clairvoyant_kf",)),
        ((1,), ("clairvoyant_kf",)),
    ]


@pytest.mark.parametrize(("workers", "heaps"), [(2, [(0, 1, 2)]), (16, [(0,), (1,), (2,)])])
def test_particles_are_a_job_of_their_own_and_draw_once_for_all_cases_unless_there_are_many_workers(
    workers: int, heaps: list[tuple[int, ...]], tmp_path: Path
) -> None:
    navigation = load("navigation")
    units = list(plan.units(navigation, tmp_path, full=False))
    whole = packed([(unit, unit.labels) for unit in units], navigation.seed, navigation.runs)
    assert [job.units for job in whole] == [(0, 1, 2), (3, 4), (5,)]
    particles = [job.units for job in divided(whole, workers) if job.labels == ("ps", "pf")]
    assert [units for units in particles if max(units) < 3] == heaps


def test_a_smoother_takes_the_filter_along_that_it_runs_anyhow() -> None:
    spec = load("navigation").cells[0].spec
    assert sharing(Experiment.of(spec), ["ps", "pf", "kf"], partners=False) == [("ps", "pf"), ("kf",)]


def test_the_agenda_tries_every_group_first_and_then_takes_the_longest() -> None:
    def job(block: int, label: str) -> Job:
        return Job((0,), ({},), 0, block, 10, (label,))

    agenda = Agenda([job(block, label) for label in ("a", "b", "c") for block in range(3)])
    begun = [agenda.take() for _ in range(3)]
    assert [each.labels for each in begun if each] == [("a",), ("b",), ("c",)]
    for each, seconds in zip(begun, (1.0, 5.0, 2.0), strict=True):
        assert each is not None
        agenda.learn(each, seconds)
    rest = []
    while (each := agenda.take()) is not None:
        rest.append((*each.labels, each.block))
    assert rest == [("b", 1), ("b", 2), ("c", 1), ("c", 2), ("a", 1), ("a", 2)]


def test_a_job_that_raises_keeps_the_filters_and_cases_that_work(
    study: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rkfbench.study.compute as module

    together = module.together

    def broken(specs: Any, seed: int, block: int, runs: int, labels: Any) -> Any:
        for label, results in together(specs, seed, block, runs, labels):
            if label == "hkf" and any(spec["measurement_noise"]["rate"] > 0 for spec in specs):
                raise ValueError("no such root")
            yield label, results

    monkeypatch.setattr(module, "together", broken)
    short = load(study.file, sets=["steps=12"], runs=6)
    outcome = run_study(short, tmp_path / "r")
    assert [str(failure) for failure in outcome.failures] == [
        "case rate=0.4 (default), filter hkf, block 0: ValueError: no such root"
    ]
    summary = Results.open(tmp_path / "r").summary
    assert {row["filter"] for row in summary if row["case"] == "rate=0"} == {"kf", "hkf", "aladkf", "clairvoyant_kf"}
    assert {row["filter"] for row in summary if row["case"] == "rate=0.4"} == {"kf", "aladkf", "clairvoyant_kf"}


def test_a_warning_tells_that_cases_could_not_be_computed_together(
    study: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rkfbench.study.compute as module

    together = module.together

    def broken(specs: Any, seed: int, block: int, runs: int, labels: Any) -> Any:
        if len(specs) > 1:
            raise ValueError("read-only")
        yield from together(specs, seed, block, runs, labels)

    monkeypatch.setattr(module, "together", broken)
    short = load(study.file, sets=["steps=12"], runs=6)
    specs = tuple(cell.spec for cell in short.cells)
    job = jobs.Job(tuple(range(len(specs))), specs, 1, 0, 6, ("kf", "hkf"))
    with pytest.warns(UserWarning, match="computed one at a time.*ValueError: read-only"):
        done = jobs.work(job)
    assert not done.faults
    assert set(done.parts) == {(unit, label) for unit in job.units for label in job.labels}
