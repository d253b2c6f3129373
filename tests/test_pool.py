from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from rkfbench.errors import RkfbenchError
from rkfbench.pool import Pool, interrupts_held


def process_of(seconds: float) -> tuple[float, int]:
    time.sleep(seconds)
    return seconds, os.getpid()


def large(begun: Path) -> bytes:
    begun.touch()
    return bytes(200_000_000)


def write_line(item: tuple[str, float]) -> str:
    with open(item[0], "a") as file:
        file.write("once")
    time.sleep(item[1])
    return item[0]


def has_imported(module: str) -> bool:
    return module in sys.modules


def die(_: int) -> None:
    os._exit(9)


def test_results_come_in_the_order_of_the_items_or_in_that_of_their_ends() -> None:
    with Pool(2) as pool:
        list(pool.ordered(process_of, [0.0, 0.0]))  # both processes are up
        slow, fast = 0.5, 0.0
        assert [seconds for seconds, _ in pool.ordered(process_of, [slow, fast])] == [slow, fast]
        items = iter([slow, fast])
        assert [item for item, _ in pool.fed(process_of, lambda: next(items, None))] == [fast, slow]


def test_processes_are_started_when_they_are_wanted_and_kept() -> None:
    with Pool(1) as pool:
        (_, first), (_, second) = (next(pool.ordered(process_of, [0.0])) for _ in range(2))
    assert first == second != os.getpid()


def test_processes_pay_when_the_work_is_long_or_when_they_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rkfbench.pool.START_UP", 3.0)
    assert not Pool(1).pays(100)
    with Pool(2) as pool:
        assert (pool.pays(2.9), pool.pays(3.1)) == (False, True)
        list(pool.ordered(process_of, [0.0]))
        assert pool.pays(0)


def test_the_death_of_a_process_is_one_message() -> None:
    with pytest.raises(RkfbenchError, match="a worker process was killed"), Pool(1) as pool:
        list(pool.ordered(die, [0]))


def test_an_interruption_ends_the_processes_at_once() -> None:
    running: list[Any] = []

    def interrupted() -> None:
        with Pool(1) as pool:
            pool.submit(process_of, 600.0)
            running.extend(multiprocessing.active_children())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    for process in running:
        process.join(60)
    assert [process.exitcode for process in running] == [-signal.SIGTERM]


@pytest.mark.parametrize("seconds", [0.05, 0.15, 0.3])
def test_an_interruption_in_the_middle_of_a_result_leaves_nobody_waiting(tmp_path: Path, seconds: float) -> None:
    readers: list[Any] = []

    def interrupted() -> None:
        with Pool(1) as pool:
            list(pool.ordered(process_of, [0.0]))  # its process is up
            pool.submit(large, tmp_path / "begun")
            assert pool._processes is not None
            readers.append(pool._processes._executor_manager_thread)
            while not (tmp_path / "begun").exists():
                time.sleep(0.001)
            time.sleep(seconds)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    readers[0].join(20)
    assert not readers[0].is_alive()


@pytest.mark.parametrize("threaded", [False, True], ids=["to this thread", "to another thread"])
def test_an_interruption_that_is_held_is_answered_afterwards(threaded: bool) -> None:
    steps: list[str] = []

    def held() -> None:
        with interrupts_held():
            if threaded:  # as any thread but the main one may take a signal that is sent to the process
                other = threading.Thread(target=lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT))
                signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
                other.start()
                other.join()
            else:
                os.kill(os.getpid(), signal.SIGINT)
            steps.append("held")
        steps.append("never")

    with pytest.raises(KeyboardInterrupt):
        held()
    assert steps == ["held"]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_what_is_foreseen_begins_where_processes_would_wait_and_is_not_done_twice(tmp_path: Path) -> None:
    done: list[tuple[str, ...]] = []
    with Pool(2) as pool:
        list(pool.ordered(process_of, [0.0, 0.0]))  # both processes are up
        first, second = iter([(str(tmp_path / "a"), 1.0)]), [(str(tmp_path / name), 0.0) for name in "bcdef"]
        pool.foresee(lambda: second)
        done.extend((item[0], result) for item, result in pool.fed(write_line, lambda: next(first, None)))
        begun = [place for place, _ in second if Path(place).exists()]
        assert begun == [place for place, _ in second]  # the process beside the long one did all the others
        again = iter([second[4], second[0], (str(tmp_path / "g"), 0.0)])
        done.extend((item[0], result) for item, result in pool.fed(write_line, lambda: next(again, None)))
    assert sorted(Path(place).name for place, _ in done) == ["a", "b", "f", "g"]
    assert all(Path(place).read_text() == "once" for place, _ in done)


def test_what_was_foreseen_counts_for_one_round_only(tmp_path: Path) -> None:
    with Pool(2) as pool:
        items = iter([0.0])
        pool.foresee(tuple)
        list(pool.fed(process_of, lambda: next(items, None)))
        pool.foresee(lambda: [0.25])
        list(pool.fed(process_of, lambda: None))
        items = iter([0.0])
        list(pool.fed(process_of, lambda: next(items, None)))
        assert pool._early == []


def test_processes_that_are_started_ahead_are_up_with_their_imports_and_quiet_before_they_work() -> None:
    with Pool(2) as pool:
        pool.start("wave", "colorsys")
        pool.started()
        assert len(multiprocessing.active_children()) == 2
        assert all(set(pool.ordered(has_imported, ["wave", "colorsys"])))
        assert next(pool.ordered(has_imported, ["xdrlib"])) is False
    with Pool(1) as pool:
        pool.start("wave")
        pool.started()
        assert not pool.pays(100)


def test_a_closed_pool_finishes_what_it_was_given_and_is_not_shut_down_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    shutdown, calls = ProcessPoolExecutor.shutdown, []
    monkeypatch.setattr(ProcessPoolExecutor, "shutdown", lambda self: calls.append(shutdown(self)))
    with Pool(1) as pool:
        future = pool.submit(process_of, 0.2)
        pool.close()
        with pytest.raises(RuntimeError, match="after shutdown"):
            pool.submit(process_of, 0.0)
    assert calls == [None]
    assert future.result()[0] == 0.2
    assert not multiprocessing.active_children()
