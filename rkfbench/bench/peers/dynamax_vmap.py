"""dynamax under jax.vmap and jax.jit: all runs at once.

It adds 1e-9 to the diagonal of S before it solves, so its means agree with ours to about 1e-9/R only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, missing_package, predicted, time_first
from rkfbench.bench.peers.jax_vmap import double_jax
from rkfbench.bench.problems import Problem

BOOST = 1e-5


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("dynamax")


def kalman(problem: Problem) -> Task:
    """lgssm_filter, mapped over the measurements alone: the covariances are computed once for all runs."""
    return _linear(problem, own=False)


def kalman_own(problem: Problem) -> Task:
    """lgssm_filter, mapped over measurements and initial covariances."""
    return _linear(problem, own=True)


def _linear(problem: Problem, own: bool) -> Task:
    jax = double_jax()
    from dynamax.linear_gaussian_ssm.inference import lgssm_filter, make_lgssm_params

    F, H = problem.matrices
    x0, P0 = predicted(problem)

    def one(y: Any, P: Any) -> Any:
        params = make_lgssm_params(x0, P, F, problem.Q, H, problem.R)
        return lgssm_filter(params, y).filtered_means

    covariances = np.repeat(P0[None], problem.runs, axis=0) if own else P0
    return _task(jax.vmap(one, in_axes=(0, 0 if own else None)), problem, covariances)


def unscented(problem: Problem) -> Task:
    """unscented_kalman_filter with alpha = 1, beta = 0, kappa = 3 - n; it knows no angles."""
    jax = double_jax()
    import jax.numpy as jnp
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams, unscented_kalman_filter

    F = problem.model.F(problem.x0, 1)
    x0, P0 = predicted(problem)

    def h(x: Any) -> Any:
        r = jnp.sqrt(x[:3] @ x[:3])
        return jnp.stack([jnp.arctan2(x[1], x[0]), r, x[2], x[:3] @ x[3:] / r])

    params = ParamsNLGSSM(x0, P0, lambda x: F @ x, problem.Q, h, problem.R)
    rule = UKFHyperParams(alpha=1.0, beta=0.0, kappa=3.0 - len(x0))

    def one(y: Any) -> Any:
        return unscented_kalman_filter(params, y, rule, output_fields=["filtered_means"]).filtered_means

    return _task(jax.vmap(one), problem)


def _task(mapped: Callable[..., Any], problem: Problem, *more: Any) -> Task:
    jax = double_jax()
    arguments = [jax.device_put(each) for each in (problem.by_run, *more)]
    compiled = jax.jit(mapped)
    return Task(lambda: compiled(*arguments).block_until_ready(), time_first)


PEERS = (
    Peer("dynamax vmap", "kf", kalman, compiled=True, tolerance=BOOST),
    Peer("dynamax vmap", "kf_own", kalman_own, compiled=True, tolerance=BOOST),
    Peer("dynamax vmap", "ukf", unscented, compiled=True, tolerance=BOOST),
)
