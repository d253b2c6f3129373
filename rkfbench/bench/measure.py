"""Measuring: all implementations of a filter ready at once, checked against ours, then timed in interleaved rounds.

The CPU time of the process counts, wall time stands beside it. A round calls every implementation for about SLICE
seconds; the minimum over the rounds is the cost, quartiles show the spread.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rkfbench.bench.peers import Peer, Task, peers
from rkfbench.bench.peers.ours import estimate
from rkfbench.bench.problems import Problem, altitude, linear
from rkfbench.linalg import Array

SLICE = 0.05  # seconds of one measurement, at least
ROUNDS = 15
BUDGET = 60.0  # seconds for one filter at one number of runs, after which FEWEST rounds are enough
FEWEST = 3
STEPS = {"pf": 10}  # 100 of the other filters
SIZES = (1, 100, 1000, 10000)
ALSO = dict.fromkeys(("ukf", "ckf", "pekf"), (3000,))
ERRORS, FEW = 5.0, 50  # of a particle filter, in standard errors; with fewer runs it is not looked at


class Different(Exception):
    """An implementation does not compute what ours computes: its time would mean nothing."""


@dataclass(frozen=True)
class Cost:
    """One implementation of one filter at one number of runs M; times in ns a run and step, one value a round.

    `timed` runs are timed (less than M for loops in Python). `deviation` is the largest difference from our means, in
    standard deviations of the states.
    """

    filter: str
    peer: str
    runs: int
    timed: int
    steps: int
    cpu: Array
    wall: Array
    deviation: float
    compile_s: float


def problem_of(name: str, runs: int, steps: int) -> Problem:
    """The problem on which a filter is timed."""
    if name in ("ukf", "ckf", "pekf"):
        return altitude(runs, steps)
    return linear(runs, steps, outliers=name != "pf")


def measure(
    filters: Sequence[str], sizes: Sequence[int] | None = None, rounds: int = ROUNDS, slice_s: float = SLICE
) -> Iterator[Cost]:
    """The costs, filter after filter and size after size."""
    for name in filters:
        for runs in sizes or sorted({*SIZES, *ALSO.get(name, ())}):
            yield from _size(name, problem_of(name, runs, STEPS.get(name, 100)), rounds, slice_s)


def _size(name: str, problem: Problem, rounds: int, slice_s: float) -> Iterator[Cost]:
    ready = [made_ready(peer, problem) for peer in peers([name])]
    for each in ready:
        each.deviation = deviation(each, ready[0], problem)
    end = time.perf_counter() + BUDGET
    for done in range(rounds):
        if done >= FEWEST and time.perf_counter() > end:
            break
        for each in ready:
            each.time(slice_s)
    for each in ready:
        cpu, wall = np.array(each.seconds).T
        scale = 1e9 / (each.timed * problem.steps)
        compile_s = max(0.0, each.first - wall.min()) if each.peer.compiled else 0.0
        yield Cost(
            name, each.peer.name, problem.runs, each.timed, problem.steps,
            cpu * scale, wall * scale, each.deviation, compile_s,
        )  # fmt: skip


@dataclass
class Entry:
    """A peer that is ready: what its first call returned and how long that took, and (CPU, wall) seconds a call of each
    round.
    """

    peer: Peer
    task: Task
    timed: int
    means: Array
    first: float
    deviation: float = 0.0
    seconds: list[tuple[float, float]] = field(default_factory=list)

    def time(self, slice_s: float) -> None:
        if self.seconds:
            expected = self.seconds[-1][1]
        else:
            expected = _seconds(self.task.call, 1)[1] if self.peer.compiled else self.first
        self.seconds.append(_seconds(self.task.call, max(1, round(slice_s / expected))))


def made_ready(peer: Peer, problem: Problem) -> Entry:
    """The peer ready for the first runs of a problem, called once."""
    timed = min(problem.runs, peer.most or problem.runs)
    task = peer.ready(problem.first(timed))
    begin = time.perf_counter()
    returned = task.call()
    first = time.perf_counter() - begin
    return Entry(peer, task, timed, np.array(task.means(returned)), first)


def _seconds(call: Callable[[], Any], often: int) -> tuple[float, float]:
    """CPU time of the process and wall time, a call."""
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(often):
        call()
    return (time.process_time() - cpu) / often, (time.perf_counter() - wall) / often


def deviation(one: Entry, ours: Entry, problem: Problem) -> float:
    """How far the means of an implementation are from ours; Different where that is too far."""
    reference = ours.means[..., : one.timed]
    if one.peer.filter == "pf":
        return _in_distribution(one, reference, problem.first(one.timed))
    apart = float(np.max(np.abs(one.means - reference) / reference.std((0, 2), keepdims=True)))
    if not apart <= one.peer.tolerance:
        raise Different(f"{one.peer.name}: {one.peer.filter} is {apart:.1e} standard deviations away from rkfbench")
    return apart


def _in_distribution(one: Entry, reference: Array, problem: Problem) -> float:
    """Particle filters: the difference of their mean square distances from the exact means, those of the Kalman filter,
    in standard errors over the runs.
    """
    exact = estimate("kf", problem).mean
    ours, theirs = (np.square(means - exact).mean((0, 1)) for means in (reference, one.means))
    if problem.runs < FEW:
        return float("nan")
    apart = float(abs(theirs.mean() - ours.mean()) / np.hypot(*(a.std() / np.sqrt(a.size) for a in (ours, theirs))))
    if not apart <= ERRORS:
        raise Different(f"{one.peer.name}: {one.peer.filter} is {apart:.1f} standard errors away from rkfbench")
    return apart
