"""Plug-ins of every kind, in a folder of their own."""

from __future__ import annotations

from pathlib import Path

import pytest

from rkfbench import own

PLUGINS = '''\
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt

from helper import gain
from rkfbench.filters import GaussianFilter
from rkfbench.filters.base import Estimate
from rkfbench.models.altitude import Altitude
from rkfbench.models.base import Linear, Smooth


class stepwise:
    """A Kalman filter of one run.

    More of it.
    """

    def __init__(self, model, x0, P0, Q, R, inflate: Annotated[float, Gt(0), "factor of R"] = 1.0):
        self.model, self.x, self.P, self.Q, self.R = model, x0, P0, Q, inflate * R

    def predict(self, k):
        F = self.model.F(self.x, k)
        self.x, self.P = self.model.f(self.x, k), F @ self.P @ F.T + self.Q

    def update(self, y, k):
        seen = ~np.isnan(y)
        H = self.model.H(self.x, k)[seen]
        S = H @ self.P @ H.T + self.R[np.ix_(seen, seen)]
        K = gain(self.P, H, S)
        self.x, self.P = self.x + K @ (y - self.model.h(self.x, k))[seen], self.P - K @ S @ K.T


class paced(stepwise):
    """The same with the Q and R of the step."""

    def predict(self, k, Q):
        self.Q = Q
        super().predict(k)

    def update(self, y, k, R=None):
        self.R = self.R if R is None else R
        super().update(y, k)


class naive(stepwise):
    """It computes with what is missing."""

    def update(self, y, k):
        self.x = self.x + (y - self.model.h(self.x, k)).sum()


class scalar(paced):
    """What it calls nu is something else."""

    nu, S = 4.0, None


class halved(paced):
    """It shows innovations of its own."""

    def update(self, y, k, R=None):
        H = self.model.H(self.x, k)
        self.nu, self.S = (y - H @ self.x) / 2, H @ self.P @ H.T + self.R
        super().update(y, k, R)


def forgets(model, y, x0, P0, Q, R):
    np.zeros((len(y), len(x0)))


def three(model, y, x0, P0, Q, R):
    return np.zeros((len(y), len(x0))), np.tile(np.eye(len(x0)), (len(y), 1, 1)), None


class leaves(stepwise):
    def update(self, y, k):
        raise SystemExit(3)


class bare_dies(stepwise):
    def update(self, y, k):
        if k == 4:
            np.linalg.inv(np.zeros((2, 2)))


def whole(model, y, x0, P0, Q, R):
    """The same as a function of a whole run."""
    filt, means, covs = stepwise(model, x0, P0, Q, R), [], []
    for k, yk in enumerate(y, 1):
        filt.predict(k)
        if not np.isnan(yk).all():
            filt.update(yk, k)
        means.append(filt.x)
        covs.append(filt.P)
    return np.array(means), np.array(covs)


def batch():
    """The Kalman filter of the catalogue."""
    return GaussianFilter()


def noisy(model, y, x0, P0, Q, R, rng):
    return rng.standard_normal((len(y), len(x0)))


def only_means(model, y, x0, P0, Q, R, level=0, word="a", flag=False):
    return np.full((len(y), len(x0)), level)


def dies(model, y, x0, P0, Q, R):
    if y[0, 0] > 0:
        np.linalg.cholesky(-np.eye(2))
    return np.zeros((len(y), len(x0)))


class raises:
    def __init__(self, model, x0, P0, Q, R):
        self.x, self.P = x0, P0

    def predict(self):
        pass

    def update(self, y, k):
        if k == 5 and y[0] > 100:
            raise ValueError("no such thing")


class in_place(stepwise):
    def update(self, y, k):
        y -= 1


class grows(raises):
    def update(self, y):
        self.x = np.append(self.x, 0)


def transposed(model, y, x0, P0, Q, R):
    return np.zeros((len(x0), len(y)))


def complex_means(model, y, x0, P0, Q, R):
    return np.zeros((len(y), len(x0))) * 1j


@dataclass(frozen=True)
class Batch:
    fault: str = "writes"

    def run(self, model, y, x0, P0, *, Q, R, **_):
        T, _, M = y.shape
        n = len(model.states)
        if self.fault == "writes":
            x0 += 1
        if self.fault == "array":
            return np.zeros((T, n, M))
        return Estimate(
            np.zeros((T, n, M + (self.fault == "wide"))),
            np.zeros((n, n)) if self.fault == "covariance" else np.zeros((T, n, n, 1)),
            np.zeros(M + (self.fault == "failed"), dtype=bool),
        )


class no_update:
    def __init__(self, model, x0, P0, Q, R):
        pass

    def predict(self):
        pass


def no_run(threshold=1.0):
    return {}


class wrong_run:
    def run(self, y):
        pass


def few(model, y):
    pass


@dataclass(frozen=True)
class Walk(Smooth):
    """A walk seen through a cube."""

    step: Annotated[float, Gt(0), "length"] = 1.0
    states = ("a", "b")
    measurements = ("c",)

    def f(self, x, k):
        return self.step * x

    def h(self, x, k):
        return x[:1] ** 3

    def F(self, x, k):
        return self.step * np.eye(2)

    def H(self, x, k):
        H = np.zeros((1, 2, *x.shape[1:]))
        H[0, 0] = 3 * x[0] ** 2
        return H


class Turn(Altitude):
    def f(self, x, k):
        return super().f(x, k) + 0.1 * np.sin(x)


class Flat(Walk):
    def h(self, x, k):
        return x[0]


class Bare:
    states = ("a",)


class student:
    """Student's t by component."""

    def __init__(self, dim, nu: Annotated[float, Gt(2), "degrees of freedom"] = 5.0):
        self.dim, self.nu = dim, nu
        self.cov = nu / (nu - 2) * np.eye(dim)

    def sample(self, draw, steps):
        z = draw.normal("normal", steps, self.dim)
        g = sum(draw.exponential(f"scale {i}", steps, self.dim) for i in range(2))
        return z / np.sqrt(g / 2)


class wild(student):
    def sample(self, draw, steps):
        return np.random.default_rng().standard_normal((steps, self.dim, draw.runs))


class shaped(student):
    def sample(self, draw, steps):
        return draw.normal((steps, self.dim))


class twice(student):
    def sample(self, draw, steps):
        return draw.normal("value", steps, self.dim) + draw.uniform("value", steps, self.dim)


class generating(student):
    def sample(self, draw, steps):
        (generator,) = draw.generators("value")
        return generator.standard_normal((steps, self.dim, draw.runs))


class around(student):
    """A law that is put around another one."""

    def sample(self, draw, steps):
        from rkfbench import noise

        return noise.build({"kind": "plugins.py:student"}, self.dim).sample(draw.within("inner"), steps)


class dense(student):
    """A law with a density, for any components too."""

    def logpdf(self, e):
        return -3 * np.log1p(e * e / self.nu).sum(0)

    def marginal(self, rows):
        return dense(len(rows), self.nu)


class in_parts(student):
    def sample(self, draw, steps):
        one, two = (draw.within(part).normal("value", steps, self.dim) for part in "ab")
        return one - two


class narrow(student):
    def sample(self, draw, steps):
        return draw.normal("normal", steps)


def lopsided(dim):
    law = student(dim)
    law.cov = law.cov + np.triu(np.ones((dim, dim)), 1)
    return law


def inflate(nu, e, R, Szz, c=2.0):
    """A Geman-McClure-like weight."""
    return (1 + (nu * nu).sum(0) / c**2) * R.reshape(*R.shape[:2], -1)


def thin(nu, e, R, Szz):
    return R[0]


def largest(trial, states, power=1.0):
    """The largest absolute error."""
    return np.abs(trial.estimate.mean[:, states] - trial.truth()[:, states]).max(1) ** power


def spread(trial, states):
    return np.einsum("tiim->tm", np.broadcast_to(trial.estimate.cov, (*trial.estimate.cov.shape[:3], 128)))


spread.keep = {"cov"}


def short(trial, states):
    return np.zeros(3)


def lost(trial, states):
    return trial.errors


def likely(trial, states):
    nu, S = (np.moveaxis(trial.estimate.extras[name], -1, 1) for name in ("nu", "S"))
    e = np.linalg.solve(np.broadcast_to(S, (*nu.shape, nu.shape[-1])), nu[..., None])
    return e[..., 0].sum(-1)


likely.keep = {"nu", "S"}
'''
HELPER = """\
import numpy as np


def gain(P, H, S):
    return P @ H.T @ np.linalg.inv(S)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with plugins.py and helper.py, where plug-ins are looked for."""
    (tmp_path / "plugins.py").write_text(PLUGINS)
    (tmp_path / "helper.py").write_text(HELPER)
    own.beside(tmp_path)
    return tmp_path
