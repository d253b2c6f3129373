"""The engine that spans machines: jobs go to the workers of a dask scheduler, their numbers come back here.

Only the driver touches the results folder, so workers need no common file system. A worker that dies takes nothing
along: its jobs go to another one. Needs the extra `rkfbench[dask]`.
"""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

from rkfbench import blas
from rkfbench.errors import RkfbenchError, UsageError
from rkfbench.pool import AHEAD, interrupts_held
from rkfbench.study.jobs import Done, Job, work
from rkfbench.study.packing import Agenda, divided
from rkfbench.study.plan import code_hash

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT = 10  # seconds for a scheduler to answer
WORKERS = 60  # seconds for its first worker to appear


def remote(jobs: Sequence[Job], address: str) -> Generator[Done]:
    """The workers of the scheduler at `address`. Raises UsageError when it does not answer or has no workers."""
    distributed = _distributed()
    try:
        asyncio.run(_knock(address))
        client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # nobody there, no address, no certificate
        raise UsageError(f"no dask scheduler answers at {address}, which should be tcp://HOST:PORT: {error}") from error
    with client:
        yield from _through(client, jobs, address)


def local(jobs: Sequence[Job], workers: int) -> Generator[Done]:
    """A cluster of its own on this machine with `workers` processes, for this study only."""
    distributed = _distributed()
    import dask

    options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": "ERROR"}
    # not dask's MALLOC_TRIM_THRESHOLD_, which gives the memory of every array back at once: 1.6 times the time
    environment = {"distributed.nanny.pre-spawn-environ": dict.fromkeys(blas.VARIABLES, "1")}
    with interrupts_held(), dask.config.set(environment):
        cluster = distributed.LocalCluster(**options)
    with cluster, distributed.Client(cluster, set_as_default=False) as client:
        yield from _through(client, jobs, cluster.scheduler_address)


async def _knock(address: str) -> None:
    """Connect and leave again. A client that could not be made hangs for 20 s when Python collects it, and then shows
    a traceback.
    """
    distributed = _distributed()
    options = distributed.Security().get_connection_args("client")
    comm = await distributed.comm.connect(address, timeout=CONNECT, **options)
    comm.abort()


def _through(client: Client, jobs: Sequence[Job], address: str) -> Generator[Done]:
    """Keep all workers busy; most jobs wait here and not at the scheduler, so that the longest go first."""
    distributed = _distributed()
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError as error:
        raise UsageError(
            f"the dask scheduler at {address} has no workers: start some with `dask worker {address}`"
        ) from error
    agenda, code = Agenda(divided(jobs, _threads(client))), code_hash()
    running: dict[Future, Job] = {}
    arrived = distributed.as_completed(loop=client.loop)
    try:
        while True:
            while len(running) < AHEAD * _threads(client) and (job := agenda.take()):
                future = client.submit(checked, job, code, pure=False)
                running[future] = job
                arrived.add(future)
            if not running:
                return
            future = next(arrived)
            done = _result(future)
            agenda.learn(running.pop(future), done.seconds)
            yield done
    finally:
        client.cancel(list(running))


def _result(future: Future) -> Done:
    """What has arrived. Raises RkfbenchError where the cluster gave up."""
    try:
        done: Done = future.result()
        return done
    except _distributed().KilledWorker as error:
        raise RkfbenchError(
            "a job has killed several workers, one after the other (out of memory?); finished blocks are kept"
        ) from error
    except (CancelledError, OSError) as error:
        raise RkfbenchError(
            "the connection to the dask scheduler is lost; finished blocks are kept: run the same command again"
        ) from error


def checked(job: Job, code: str) -> Done:
    """`work` on a worker, unless that has other code than the driver: its numbers might differ."""
    if code_hash() != code:
        raise RkfbenchError("a dask worker has another version of rkfbench, numpy or scipy than this machine")
    with redirect_stdout(sys.stderr):  # a plug-in's; the worker may share its output with the driver
        return work(job)


def _threads(client: Client) -> int:
    """The jobs that can be computed at once; workers may come and go."""
    return max(1, sum(client.nthreads().values()))


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise UsageError("--scheduler needs dask: pip install 'rkfbench[dask]'") from error
    # a call that Ctrl-C interrupts leaves a callback behind, whose failure would be told with a traceback
    logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
    return distributed
