"""Plain JAX: each filter written for one run with lax.scan over the steps, then jax.vmap over the runs and jax.jit.

Float64 on the CPU, one thread. What does not depend on the run is computed once by vmap without being told; where P
starts the same and never depends on y, that is the KF with a shared covariance. Each filter stands twice: as one writes
it, with jnp.linalg, and with the solutions of small systems unrolled by hand, as jnp.linalg calls LAPACK for each run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, missing_package, time_first
from rkfbench.bench.problems import PARTICLES, PARTS, SEED, THRESHOLD, Problem
from rkfbench.filters.sigma import Cubature, Unscented
from rkfbench.linalg import root
from rkfbench.noise.matrices import factor

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
Carry = Any
Step = Callable[[Carry, Any], tuple[Carry, Any]]


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("jax")


def double_jax() -> Any:
    """JAX in double precision on one thread of the CPU (the flags count if it has not been imported before)."""
    os.environ.setdefault("XLA_FLAGS", ONE_THREAD)
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import jax

    jax.config.update("jax_enable_x64", True)
    return jax


def scanned(step: Step, problem: Problem) -> Task:
    """The means of all runs, from a step (x, P), y -> (x, P), x; P begins the same in all runs."""
    jax = double_jax()

    def one(y: Any) -> Any:
        return jax.lax.scan(step, (problem.x0, problem.P0), y)[1]

    return compiled(jax.vmap(one), problem.by_run)


def compiled(function: Callable[..., Any], *arguments: Any) -> Task:
    """The call of a function that JAX compiles at first."""
    jax = double_jax()
    there = [jax.device_put(each) for each in arguments]
    jitted = jax.jit(function)
    return Task(lambda: jitted(*there).block_until_ready(), time_first)


class Algebra(NamedTuple):
    """The two operations on small matrices that filters need."""

    condition: Callable[..., tuple[Any, Any]]  # x, P, C, S, nu, part -> x + part C S^-1 nu, P - part C S^-1 C'
    cholesky: Callable[[Any], Any]


def condition(x: Any, P: Any, C: Any, S: Any, nu: Any, part: float = 1.0) -> tuple[Any, Any]:
    """As one writes it."""
    import jax.numpy as jnp

    K = jnp.linalg.solve(S, C.T).T
    return x + part * (K @ nu), P - part * (K @ C.T)


def condition_unrolled(x: Any, P: Any, C: Any, S: Any, nu: Any, part: float = 1.0) -> tuple[Any, Any]:
    """By elimination, unrolled."""
    import jax.numpy as jnp

    m = len(nu)
    rows, e = [jnp.concatenate([S[i], C[:, i]]) for i in range(m)], list(nu)
    for k in range(m):
        d = jnp.sqrt(rows[k][k])
        rows[k], e[k] = rows[k] / d, e[k] / d
        for i in range(k + 1, m):
            rows[i], e[i] = rows[i] - rows[k][i] * rows[k], e[i] - rows[k][i] * e[k]
    g = jnp.stack([row[m:] for row in rows])
    return x + part * (jnp.stack(e) @ g), P - part * (g.T @ g)


def cholesky(P: Any) -> Any:
    """As one writes it."""
    import jax.numpy as jnp

    return jnp.linalg.cholesky(P)


def cholesky_unrolled(P: Any) -> Any:
    """Column by column."""
    import jax.numpy as jnp

    n = len(P)
    columns: list[Any] = []
    for j in range(n):
        rest = P[:, j] - sum((column * column[j] for column in columns), jnp.zeros(n))
        columns.append(jnp.where(np.arange(n) >= j, rest / jnp.sqrt(rest[j]), 0.0))
    return jnp.stack(columns, axis=1)


def kalman(inflate: Callable[[Any, Problem], Any], algebra: Algebra, problem: Problem) -> Task:
    """The KF, told R' in each step."""
    return scanned(kalman_step(inflate, algebra, problem), problem)


def kalman_step(inflate: Callable[[Any, Problem], Any], algebra: Algebra, problem: Problem) -> Step:
    """Prediction, and update with R' from the innovation."""
    F, H = problem.matrices

    def step(carry: Carry, y: Any) -> tuple[Carry, Any]:
        x, P = carry
        x, P = F @ x, F @ P @ F.T + problem.Q
        nu, C = y - H @ x, P @ H.T
        x, P = algebra.condition(x, P, C, H @ C + inflate(nu, problem), nu)
        return (x, P), x

    return step


def kalman_own(algebra: Algebra, problem: Problem) -> Task:
    """The KF mapped over initial covariances, too."""
    jax = double_jax()
    step = kalman_step(plain, algebra, problem)
    covariances = np.repeat(problem.P0[None], problem.runs, axis=0)
    return compiled(jax.vmap(lambda y, P: jax.lax.scan(step, (problem.x0, P), y)[1]), problem.by_run, covariances)


def plain(nu: Any, problem: Problem) -> Any:
    """R."""
    return problem.R


def huber(nu: Any, problem: Problem) -> Any:
    """L diag(max(1, |e|/threshold)) L', e = L^-1 nu."""
    import jax.numpy as jnp

    L = root(problem.R)
    return (L * jnp.maximum(1.0, jnp.abs(np.linalg.inv(L) @ nu) / THRESHOLD)) @ L.T


def least_absolute(nu: Any, problem: Problem) -> Any:
    """lambda R, lambda = |L^-1 nu|."""
    import jax.numpy as jnp

    e = np.linalg.inv(factor(problem.R)) @ nu
    return jnp.sqrt(e @ e) * problem.R


def sight(x: Any) -> Any:
    """h of the altitude model."""
    import jax.numpy as jnp

    r = jnp.sqrt(x[:3] @ x[:3])
    return jnp.stack([jnp.arctan2(x[1], x[0]), r, x[2], x[:3] @ x[3:] / r])


def wrapped(nu: Any) -> Any:
    """Differences of measurements, the bearing in [-pi, pi)."""
    import jax.numpy as jnp

    return nu.at[..., 0].set((nu[..., 0] + jnp.pi) % (2 * jnp.pi) - jnp.pi)


def sigma(rule: Any, algebra: Algebra, problem: Problem) -> Task:
    """Sigma-point filter with weights, new points at the update."""
    jax = double_jax()
    import jax.numpy as jnp

    n = len(problem.x0)
    h2, _, b = rule.rule(n)
    w = np.r_[1 - n / h2, np.full(2 * n, 0.5 / h2)]
    wc = np.r_[2 + b - n / h2, w[1:]]
    F = problem.model.F(problem.x0, 1)

    def points(x: Any, P: Any) -> Any:
        A = np.sqrt(h2) * algebra.cholesky(P).T
        return jnp.concatenate([x[None], x + A, x - A])

    def step(carry: Carry, y: Any) -> tuple[Carry, Any]:
        moved = points(*carry) @ F.T
        x = w @ moved
        d = moved - x
        P = (d.T * wc) @ d + problem.Q
        drawn = points(x, P)
        seen = jax.vmap(sight)(drawn)
        seen = seen[0] + wrapped(seen - seen[0])
        z = w @ seen
        e = seen - z
        x, P = algebra.condition(x, P, ((drawn - x).T * wc) @ e, (e.T * wc) @ e + problem.R, wrapped(y - z))
        return (x, P), x

    return scanned(step, problem)


def progressive(algebra: Algebra, problem: Problem) -> Task:
    """EKF prediction, then sub-steps; H by automatic differentiation."""
    jax = double_jax()
    F, R = problem.model.F(problem.x0, 1), problem.R
    slopes = jax.jacfwd(sight)

    def step(carry: Carry, y: Any) -> tuple[Carry, Any]:
        x, P = carry
        x, P = F @ x, F @ P @ F.T + problem.Q
        for _ in range(PARTS):
            H = slopes(x)
            C = P @ H.T
            x, P = algebra.condition(x, P, C, H @ C + R, wrapped(y - sight(x)), 1 / PARTS)
        return (x, P), x

    return scanned(step, problem)


def particles(problem: Problem) -> Task:
    """Bootstrap particle filter; under vmap both ways of the resampling decision are computed."""
    jax = double_jax()
    import jax.numpy as jnp

    F, H = problem.matrices
    start, process = factor(problem.P0), factor(problem.Q)
    whiten = np.linalg.inv(factor(problem.R))
    N, n = PARTICLES, len(problem.x0)

    def step(carry: Carry, y: Any) -> tuple[Carry, Any]:
        key, x, logs = carry
        key, noise, offset = jax.random.split(key, 3)
        x = F @ x + process @ jax.random.normal(noise, (n, N))
        e = whiten @ (y[:, None] - H @ x)
        logs = logs - 0.5 * (e * e).sum(0)
        W = jnp.exp(logs - logs.max())
        W = W / W.sum()
        mean = x @ W
        at = jnp.searchsorted(jnp.cumsum(W), (jnp.arange(N) + jax.random.uniform(offset)) / N)
        few = 1 / (W @ W) < 0.5 * N
        x = jnp.where(few, x[:, jnp.minimum(at, N - 1)], x)
        return (key, x, jnp.where(few, 0.0, logs)), mean

    def one(key: Any, y: Any) -> Any:
        key, first = jax.random.split(key)
        x = problem.x0[:, None] + start @ jax.random.normal(first, (n, N))
        return jax.lax.scan(step, (key, x, jnp.zeros(N)), y)[1]

    return compiled(jax.vmap(one), jax.random.split(jax.random.key(SEED), problem.runs), problem.by_run)


MAKERS: Mapping[str, Callable[[Algebra, Problem], Task]] = {
    "kf": partial(kalman, plain),
    "kf_own": kalman_own,
    "hkf": partial(kalman, huber),
    "aladkf": partial(kalman, least_absolute),
    "ukf": partial(sigma, Unscented()),
    "ckf": partial(sigma, Cubature()),
    "pekf": progressive,
}
ALGEBRAS = {
    "JAX vmap": Algebra(condition, cholesky),
    "JAX vmap, unrolled": Algebra(condition_unrolled, cholesky_unrolled),
}
PEERS = (
    *(
        Peer(label, name, partial(make, algebra), compiled=True)
        for label, algebra in ALGEBRAS.items()
        for name, make in MAKERS.items()
    ),
    Peer("JAX vmap", "pf", particles, compiled=True),
)
