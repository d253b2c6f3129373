"""The contract of a filter: what every filter of the catalogue keeps and every own filter should, tried on small
problems.

A check is a function of a `Subject`, a filter on a problem; it yields one sentence for each thing that is wrong. The
test suite runs all checks on the whole catalogue, `rkfbench check` runs them on a plug-in.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from rkfbench.catalogue import Limit
from rkfbench.errors import RkfbenchError, SpecError
from rkfbench.experiment import Experiment, World
from rkfbench.filters import Estimate, Filter, build
from rkfbench.linalg import Array
from rkfbench.own.onerun import OneByOne
from rkfbench.parts import Told, check_told
from rkfbench.streams import GROUP, Streams

STEPS = 12  # of a scenario that are tried
LOOPED = 12  # runs that are tried of a filter that takes them one by one
SMALLEST = 1e-150  # particles may have run into a single point

SPECS: dict[str, dict[str, Any]] = {
    "navigation": {
        "steps": 12,
        "model": {"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]},
        "start": {"truth": [1, 1, 1, 1]},
        "process_noise": {
            "kind": "gaussian",
            "cov": [[1, 0.2, 0, 0.1], [0.2, 0.8, 0.1, 0], [0, 0.1, 0.5, 0], [0.1, 0, 0, 0.4]],
        },
        "measurement_noise": {
            "kind": "contaminated",
            "rate": 0.2,
            "body": {"kind": "gaussian", "cov": [[1, 0.5, 0.3], [0.5, 2, 0.4], [0.3, 0.4, 1]]},
            "outliers": {"kind": "laplace", "cov": {"times": 100, "of": "body"}},
        },
        "assumed": {
            "mean": [0, 0, 0, 0],
            "cov": [[2, 0.3, 0, 0], [0.3, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0.2, 1]],
            "measurement_cov": "body",
        },
        "filters": [{"label": "kf", "use": "kf"}],
        "metrics": ["rmse"],
    },
    "range_bearing": {
        "steps": 8,
        "model": {"kind": "range_bearing"},
        "start": {"truth": [100, 100]},
        "measurement_noise": {"kind": "gaussian", "cov": [0.01, 0.006]},
        "assumed": {"mean": [80, 110], "cov": 100},
        "filters": [{"label": "ekf", "use": "ekf"}],
        "metrics": ["rmse"],
    },
    "odometers": {
        "steps": 10,
        "model": {"kind": "odometers"},
        "truth": {"kind": "drive", "acceleration": 3, "start": 4, "duration": 3},
        "start": {"truth": [0, 20]},
        "measurement_noise": {"kind": "gaussian", "cov": [25, 1]},
        "disturbances": [{"kind": "gross_errors", "component": "A", "size": 300, "every": 5}],
        "assumed": {"mean": [0, 20], "cov": [[25, 1], [1, 1]], "process_cov": [[0.25, 0.5], [0.5, 1.1]]},
        "filters": [{"label": "skf", "use": "skf"}],
        "metrics": ["rmse"],
    },
}


@dataclass(frozen=True)
class Problem:
    """An experiment, and what happened in it."""

    name: str
    experiment: Experiment
    world: World

    @classmethod
    def of(cls, name: str, spec: Mapping[str, Any]) -> Problem:
        """The problem that a cell's specification describes."""
        experiment = Experiment.of(spec)
        return cls(name, experiment, experiment.simulate(Streams(3)))

    def serves(self, filt: Any) -> bool:
        """Whether the filter can run here: its own check of the model says no where it cannot."""
        check: Callable[[Any], None] | None = getattr(filt, "check", None)
        try:
            if check is not None:
                check(self.experiment.model)
        except SpecError:
            return False
        return True


@cache
def problems() -> tuple[Problem, ...]:
    """The problems on which filters are tried."""
    return tuple(Problem.of(name, spec) for name, spec in SPECS.items())


def problem_of(name: str, spec: Mapping[str, Any]) -> Problem:
    """The first steps of a scenario's cell as a problem."""
    steps = min(spec["steps"], STEPS)
    bare = {key: value for key, value in spec.items() if key not in ("lost", "point", "score", "disturbances")}
    return Problem.of(name, {**bare, "steps": steps, "filters": [], "metrics": []})


@dataclass(frozen=True)
class Subject:
    """A filter on a problem. `randomised`: its draws belong to groups of runs, not to runs."""

    filter: Filter
    problem: Problem
    randomised: bool = False

    @property
    def runs(self) -> int:
        """How many runs are tried."""
        return LOOPED if isinstance(self.filter, OneByOne) else GROUP

    @property
    def y(self) -> Array:
        """The measurements (T, m, M) of the runs that are tried."""
        return self.problem.world.y[..., : self.runs]

    def estimate(
        self,
        runs: slice | None = None,
        y: Array | None = None,
        keep: Collection[str] = ("cov",),
        told: Told | None = None,
    ) -> Estimate:
        """The estimates of some of the runs, or of all of them from other measurements or told other covariances."""
        experiment, world = self.problem.experiment, self.problem.world
        told = experiment.told if told is None else told
        runs = slice(0, self.runs) if runs is None else runs
        filt = replace(self.filter, begin=runs.start) if isinstance(self.filter, OneByOne) else self.filter
        sees = getattr(filt, "sees", frozenset({"cov"}))
        return filt.run(
            experiment.assumed_model,
            (world.y if y is None else y)[..., runs],
            world.x0[:, runs],
            told.P0,
            Q=told.Q,
            R=told.R,
            keep=tuple(each for each in keep if each in sees),
            known=world.known if runs == slice(0, GROUP) else world.known.of(runs),
            streams=Streams(1),
        )


Check = Callable[[Subject], Iterator[str]]


def shapes(subject: Subject) -> Iterator[str]:
    """Means (T, n, M), one `failed` a run, and numbers in every run that has not failed."""
    result = subject.estimate()
    n, M = len(subject.problem.experiment.model.states), subject.runs
    if result.mean.shape[1:] != (n, M):
        yield f"its means have shape {result.mean.shape}, expected (T, {n}, {M})"
    elif result.failed.shape != (M,):
        yield f"`failed` has shape {result.failed.shape}, expected ({M},)"
    elif not np.isfinite(result.mean[..., ~result.failed]).all():
        yield "some means of runs that have not failed are not finite"
    elif result.failed.all():
        yield "every run fails"


def covariances(subject: Subject) -> Iterator[str]:
    """Every P is symmetric and positive definite, but for rounding."""
    result = subject.estimate()
    if result.cov is None or result.failed.all():
        return
    P = result.cov if result.cov.shape[-1] == 1 else result.cov[..., ~result.failed]
    if np.isnan(P).all():  # it has none
        return
    if not np.isfinite(P).all():
        yield "some covariances of runs that have not failed are not finite"
        return
    if np.abs(P - P.swapaxes(1, 2)).max() > 1e-9 * np.abs(P).max():
        yield "P is not symmetric"
    scale = np.maximum(np.sqrt(np.maximum(np.einsum("tiim->tim", P), 0)), SMALLEST)
    correlation = np.moveaxis(P / (scale[:, :, None] * scale[:, None]), -1, 1)
    least = np.linalg.eigvalsh(correlation).min()
    if not least > -1e-9:
        yield f"P is not positive definite: the smallest eigenvalue of its correlations is {least:.2g}"


def batches(subject: Subject) -> Iterator[str]:
    """A batch of N runs gives what N batches of one give."""
    if subject.randomised:
        return
    whole = subject.estimate()
    for i in (0, 3, subject.runs * 3 // 5):
        alone = subject.estimate(slice(i, i + 1))
        if not np.allclose(alone.mean[..., 0], whole.mean[..., i], rtol=1e-6, atol=1e-6, equal_nan=True):
            yield f"run {i} by itself gives other estimates than in a batch: runs must not depend on each other"
            return


def alone(subject: Subject) -> Iterator[str]:
    """A run whose measurements become infinite fails, or goes on with finite estimates, and no other run changes."""
    if subject.randomised:
        return
    hit = 5
    broken = subject.y.copy()
    broken[2:, :, hit] = np.inf
    base, hurt = subject.estimate(), subject.estimate(y=broken)
    others = np.arange(subject.runs) != hit
    # with missing components runs go in portions of any width, which round differently
    rounding = 1e-9 if np.isnan(subject.y).any() else 0.0
    if not np.allclose(hurt.mean[..., others], base.mean[..., others], rounding, rounding, equal_nan=True):
        yield "infinite measurements of one run change the estimates of others"
    if not hurt.failed[hit] and not np.isfinite(hurt.mean[..., hit]).all():
        yield "a run whose estimates are not finite is not marked as failed"
    if hurt.failed[hit] and not np.isnan(hurt.mean[-1, :, hit]).all():
        yield "a run that has failed has estimates after its failure: they must be NaN"


def missing(subject: Subject) -> Iterator[str]:
    """A wholly missing measurement (NaN) is a prediction, and no run fails of it or of one missing component."""
    y = subject.y.copy()
    y[3] = np.nan
    base, result = subject.estimate(), subject.estimate(y=y, keep=("cov", "prior_mean", "prior_cov"))
    if (result.failed & ~base.failed).all() and not base.failed.all():
        yield "a missing measurement (NaN in y) makes every run fail"
        return
    y = subject.y.copy()
    y[3, 0] = np.nan
    if (subject.estimate(y=y).failed & ~base.failed).all() and not base.failed.all():
        yield "a missing component (NaN in y) makes every run fail: use those where np.isfinite(y)"
        return
    yield from _with_one_component(subject)
    if "prior_mean" not in result.extras or result.target is not None:
        return
    alive = ~result.failed  # a prediction may be the end of a run too
    prior = result.extras["prior_mean"][3]
    if not np.array_equal(result.mean[3][:, alive], prior[:, alive]):
        yield "where a measurement is missing the mean is not the predicted one"
    if result.cov is not None and "prior_cov" in result.extras:
        expected = np.broadcast_to(result.extras["prior_cov"][3], result.cov[3].shape)
        runs = alive if expected.shape[-1] == len(alive) else slice(None)
        if not np.array_equal(result.cov[3][..., runs], expected[..., runs]):
            yield "where a measurement is missing the covariance is not the predicted one"


def _with_one_component(subject: Subject) -> Iterator[str]:
    """What a filter shows of itself keeps its shape where one measurement component is there alone."""
    sees: frozenset[str] = getattr(subject.filter, "sees", frozenset())
    usual = subject.estimate(keep=sees).extras
    for i in range(subject.y.shape[1]):
        y = subject.y.copy()
        y[3, np.arange(y.shape[1]) != i] = np.nan
        for name, history in subject.estimate(y=y, keep=sees).extras.items():
            if history.shape[1:-1] != usual[name].shape[1:-1]:
                yield f"where one component is measured, {name} has shape {history.shape}, else {usual[name].shape}"


def inputs(subject: Subject) -> Iterator[str]:
    """y, x0, P0, Q and R are as they were."""
    experiment, world = subject.problem.experiment, subject.problem.world
    given = {"y": world.y, "x0": world.x0, "P0": experiment.told.P0, "Q": experiment.told.Q, "R": experiment.told.R}
    before = {name: each.copy() for name, each in given.items()}
    subject.estimate()
    for name, each in given.items():
        if not np.array_equal(each, before[name], equal_nan=True):
            yield f"it changes its argument {name}"


def randomness(subject: Subject) -> Iterator[str]:
    """The same data give the same estimates, whatever the state of the global random numbers."""
    kept = np.random.get_state(), random.getstate()  # noqa: NPY002 - these are what is looked for
    means = []
    for seed in (1, 1, 2):
        np.random.seed(seed)  # noqa: NPY002
        random.seed(seed)
        means.append(subject.estimate().mean)
    np.random.set_state(kept[0])  # noqa: NPY002
    random.setstate(kept[1])
    if not np.array_equal(means[0], means[1], equal_nan=True):
        yield "it gives other estimates when it is run again on the same data"
    elif not np.array_equal(means[0], means[2], equal_nan=True):
        yield "it draws from the global random numbers of NumPy or Python: draw from `streams` or a parameter `rng`"


def stepped(subject: Subject) -> Iterator[str]:
    """A Q and R told for each step that are the same at all steps change nothing; who cannot take them says so."""
    told, T = subject.problem.experiment.told, len(subject.y)
    Q, R = (np.repeat(A[None, ..., None], T, axis=0) for A in (told.Q, told.R))
    base = subject.estimate()
    try:
        result = subject.estimate(told=replace(told, Q=Q, R=R))
    except SpecError:
        return
    if not np.allclose(result.mean, base.mean, rtol=1e-6, atol=1e-6, equal_nan=True):
        yield "a Q and R told for each step, (T, n, n, 1) and (T, m, m, 1), give other estimates than told once"


def limits_of(filt: Any, problem: Problem) -> Iterator[str]:
    """What a filter may well lack, but its author should know: a place for a Q that changes with time."""
    told = problem.experiment.told
    try:
        check_told(filt, replace(told, Q=told.Q[None, ..., None]))
    except SpecError as error:
        yield f"not for recordings with irregular times: {error}"


CHECKS: tuple[Check, ...] = (shapes, covariances, batches, alone, missing, inputs, randomness, stepped)


def limit_holds(make: Callable[..., Filter], limit: Limit, problem: Problem) -> Iterator[str]:
    """With the parameters of a declared limit the filter is the other one; nothing to say where it is not meant."""
    if limit.where == "linear" and not problem.experiment.model.linear:
        return
    mine, other = (Subject(each, problem) for each in (make(**limit.params), build(limit.equals)))
    if not problem.serves(other.filter):
        return
    runs = slice(0, mine.runs) if mine.runs < other.runs else None
    if not np.allclose(mine.estimate().mean, other.estimate(runs).mean, rtol=1e-7, atol=1e-7, equal_nan=True):
        yield f"with {dict(limit.params)} it is not equal to {limit.equals}, as it declares"


@dataclass(frozen=True)
class Result:
    """What a check found on a problem; no findings mean that it passed."""

    problem: str
    check: str
    findings: tuple[str, ...]


def results(
    make: Callable[..., Filter], limits: Sequence[Limit], randomised: bool, on: Sequence[Problem]
) -> Iterator[Result]:
    """All checks on those problems that the filter serves; after an exception the problem is left."""
    for problem in on:
        subject = Subject(make(), problem, randomised)
        if not problem.serves(subject.filter):
            continue
        named: dict[str, Callable[[], Iterator[str]]] = {check.__name__: _on(check, subject) for check in CHECKS}
        named |= {f"limit {i}": _limit(make, limit, problem) for i, limit in enumerate(limits, 1)}
        for name, check in named.items():
            try:
                yield Result(problem.name, name, tuple(check()))
            except RkfbenchError as error:
                yield Result(problem.name, name, (str(error),))
                break


def _on(check: Check, subject: Subject) -> Callable[[], Iterator[str]]:
    return lambda: check(subject)


def _limit(make: Callable[..., Filter], limit: Limit, problem: Problem) -> Callable[[], Iterator[str]]:
    return lambda: limit_holds(make, limit, problem)
