"""The contract of the catalogue: what every filter that is listed there must keep. A new filter is tested by being
listed.

A filter that needs a nonlinear model, or cannot run on these problems, says so through its `check`, and is run on the
models it serves.
"""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import FILTERS, build
from rkfbench.streams import GROUP, Streams
from tests.contract import PROBLEMS, arguments, serves

RUNNING = [name for name, entry in FILTERS.items() if "file" not in entry.needs]  # the others ran elsewhere
RANDOMISED = {name for name, entry in FILTERS.items() if "streams" in entry.needs}


def cases(randomised=True):
    """All filters on all problems that they serve; draws belong to groups of runs, not to runs."""
    return [
        pytest.param(name, problem, id=f"{name} on {problem}")
        for name in RUNNING
        for problem in PROBLEMS
        if serves(name, problem) and (randomised or name not in RANDOMISED)
    ]


def estimate(name, problem, runs=slice(None), y=None, keep=("cov",)):
    filt = build(name, **arguments(name, problem))
    experiment, world = PROBLEMS[problem]
    told = experiment.told
    known = world.known
    if runs != slice(None):
        known = known.of(runs)
    measured = (world.y if y is None else y)[..., runs]
    keep = tuple(each for each in keep if each in getattr(filt, "sees", {"cov"}))
    return filt.run(
        experiment.assumed_model,
        measured,
        world.x0[:, runs],
        told.P0,
        Q=told.Q,
        R=told.R,
        keep=keep,
        known=known,
        streams=Streams(1),
    )


def test_every_filter_of_the_catalogue_serves_some_problem():
    assert not [name for name in RUNNING if not any(serves(name, problem) for problem in PROBLEMS)]


@pytest.mark.parametrize(("name", "problem"), cases())
def test_shapes_and_symmetric_positive_definite_covariances(name, problem):
    result = estimate(name, problem)
    n, M = PROBLEMS[problem][1].x.shape[1:]
    assert result.mean.shape[1:] == (n, M) and result.failed.shape == (M,)
    assert np.isfinite(result.mean[..., ~result.failed]).all()
    # As its paper prints it, fpmcs has a covariance for a diagonal R only: that is one of the claims judged.
    if result.cov is not None and name != "fpmcs":
        P = result.cov if result.cov.shape[-1] == 1 else result.cov[..., ~result.failed]
        assert np.abs(P - P.swapaxes(1, 2)).max() <= 1e-9 * np.abs(P).max()
        scale = np.maximum(np.sqrt(np.einsum("tiim->tim", P)), 1e-150)  # particles may have run into a single point
        correlation = np.moveaxis(P / (scale[:, :, None] * scale[:, None]), -1, 1)
        assert np.linalg.eigvalsh(correlation).min() > -1e-9


@pytest.mark.parametrize(("name", "problem"), cases(randomised=False))
def test_a_batch_of_runs_equals_batches_of_one(name, problem):
    whole = estimate(name, problem)
    for i in (0, 3, 77):
        alone = estimate(name, problem, slice(i, i + 1))
        np.testing.assert_allclose(alone.mean[..., 0], whole.mean[..., i], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "problem"), cases(randomised=False))
def test_the_order_of_runs_is_irrelevant_and_a_failed_run_stays_alone(name, problem):
    _, world = PROBLEMS[problem]
    base = estimate(name, problem)
    broken = world.y.copy()
    broken[2:, :, 5] = np.inf
    hurt = estimate(name, problem, y=broken)
    others = np.arange(GROUP) != 5
    assert np.array_equal(hurt.mean[..., others], base.mean[..., others], equal_nan=True)
    assert hurt.failed[5] and np.isnan(hurt.mean[-1, :, 5]).all()


@pytest.mark.parametrize(("name", "problem"), cases())
def test_a_wholly_missing_measurement_is_a_prediction(name, problem):
    _, world = PROBLEMS[problem]
    y = world.y.copy()
    y[3] = np.nan
    result = estimate(name, problem, y=y, keep=("cov", "prior_mean", "prior_cov"))
    if "prior_mean" not in result.extras or result.target is not None:
        return
    alive = ~result.failed  # a prediction may be the end of a run too
    np.testing.assert_array_equal(result.mean[3][:, alive], result.extras["prior_mean"][3][:, alive])
    if result.cov is not None:
        expected = np.broadcast_to(result.extras["prior_cov"][3], result.cov[3].shape)
        runs = alive if expected.shape[-1] == len(alive) else slice(None)
        np.testing.assert_array_equal(result.cov[3][..., runs], expected[..., runs])


@pytest.mark.parametrize(("name", "problem"), cases())
def test_inputs_are_not_changed(name, problem):
    experiment, world = PROBLEMS[problem]
    before = [a.copy() for a in (world.y, world.x0, experiment.told.P0, experiment.told.Q, experiment.told.R)]
    estimate(name, problem)
    for a, b in zip(before, (world.y, world.x0, experiment.told.P0, experiment.told.Q, experiment.told.R), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize(
    ("name", "limit", "problem"),
    [
        pytest.param(name, limit, problem, id=f"{name} {dict(limit.params)} = {limit.equals} on {problem}")
        for name, entry in FILTERS.items()
        for limit in entry.limits
        for problem in PROBLEMS
        if serves(name, problem) and (limit.where != "linear" or PROBLEMS[problem][0].model.linear)
    ],
)
def test_declared_limits_hold(name, limit, problem):
    experiment, world = PROBLEMS[problem]
    told = experiment.told
    results = []
    for spec, params in ((name, {**arguments(name, problem), **limit.params}), (limit.equals, {})):
        filt = build(spec, **params)
        results.append(
            filt.run(
                experiment.assumed_model,
                world.y,
                world.x0,
                told.P0,
                Q=told.Q,
                R=told.R,
                known=world.known,
                streams=Streams(1),
            )
        )
    np.testing.assert_allclose(results[0].mean, results[1].mean, rtol=1e-7, atol=1e-7)


def test_an_unknown_filter_or_parameter_is_said():
    with pytest.raises(SpecError, match="did you mean 'hkf'"):
        build("hfk")
    with pytest.raises(SpecError, match="did you mean 'threshold'"):
        build("hkf", treshold=1.0)
    with pytest.raises(SpecError, match="greater than 0"):
        build("hkf", threshold=-1.0)
    assert isinstance(PROBLEMS["navigation"][0], Experiment)
