"""What measurements alone say about a filter: its innovations nu and their covariance S, as the filter used it.

If the model, Q and R are right, nu_k are independent N(0, S_k). Then nu' S^-1 nu has a mean equal to the number of
components measured, and the standardised innovations e = L^-1 nu, L L' = S, are white with variance 1 (Bar-Shalom, Li
and Kirubarajan, 2001, section 5.4). S is that of the weighted update: a filter that inflates R at what it takes for an
outlier has a small nu' S^-1 nu there, one that scales the innovation down (correntropy) a large one. These metrics need
no truth, so they are there for recorded data too. Steps without a measurement are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Interval

from rkfbench.linalg import Array, cholesky, solve_lower
from rkfbench.metrics.base import Better, Each, Trial, over_time
from rkfbench.metrics.histories import Shown

Parts = dict[str, Any]


def standardised(trial: Trial) -> tuple[Array, Array, Array]:
    """e = L^-1 nu (T, m, M), 0 where a component is missing; log det S (T, M); how many components there are (T, M)."""
    derived = trial.estimate.derived
    if "standardised" not in derived:
        nu, S = trial.estimate.extras["nu"], trial.estimate.extras["S"]
        there = ~np.isnan(nu)
        if not there.all():
            S = np.where(there[:, :, None] & there[:, None], S, np.eye(nu.shape[1])[None, ..., None])
        L = over_time(cholesky, S)
        e = over_time(solve_lower, L, np.where(there, nu, 0.0))
        derived["standardised"] = e
        derived["log_det"] = 2 * np.log(np.einsum("tiim->tim", L)).sum(1)
        derived["measured"] = there.sum(1)
    return derived["standardised"], derived["log_det"], derived["measured"]


@dataclass(frozen=True)
class Nis(Each):
    """nu' S^-1 nu of the components measured; NaN where none is."""

    keep: ClassVar[frozenset[str]] = frozenset({"nu", "S"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        e, _, measured = standardised(trial)
        return np.where(measured > 0, (e * e).sum(1), np.nan)


@dataclass(frozen=True)
class NisBeyond(Nis):
    """1 where nu' S^-1 nu exceeds the quantile of chi-square at `level`, else 0; NaN where nothing is measured."""

    level: float = 0.95

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        from scipy.special import gammaincinv

        e, _, measured = standardised(trial)
        limit = 2 * gammaincinv(np.arange(e.shape[1] + 1)[1:] / 2, self.level)
        beyond = (e * e).sum(1) > np.append(np.inf, limit)[measured]
        return np.where(measured > 0, beyond.astype(float), np.nan)


@dataclass(frozen=True)
class LogLikelihood(Nis):
    """log N(nu; 0, S) of the components measured."""

    better: ClassVar[Better | None] = "large"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        e, log_det, measured = standardised(trial)
        density = -0.5 * ((e * e).sum(1) + log_det + measured * np.log(2 * np.pi))
        return np.where(measured > 0, density, np.nan)


@dataclass(frozen=True)
class Whiteness(Nis):
    """sum_k e_k' e_{k-l} / sum_k e_k' e_k: autocorrelation of the standardised innovations, one number a run; NaN where
    no component is measured at two steps that far apart.
    """

    lag: int = 1
    of_run: ClassVar[bool] = True

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        e, _, _ = standardised(trial)
        there = ~np.isnan(trial.estimate.extras["nu"])
        pairs = (there[self.lag :] & there[: -self.lag]).any((0, 1))
        correlation = (e[self.lag :] * e[: -self.lag]).sum((0, 1)) / (e * e).sum((0, 1))
        return np.where(pairs, correlation, np.nan)[None]


@dataclass(frozen=True)
class SquaredInnovation(Shown):
    """nu^2 of a component, or the sum over those measured; NaN where there is none."""

    name: str = "nu"
    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        nu = self.values(trial)
        return np.where(np.isnan(nu).all(1), np.nan, np.nansum(nu * nu, axis=1))


def nis() -> Parts:
    """Normalised innovation squared nu' S^-1 nu, averaged over the steps with a measurement; its mean is the number of
    components measured if the filter is consistent.
    """
    return {"quantity": Nis(), "reduce": "mean_where"}


def nis_beyond(
    level: Annotated[float, Interval(gt=0, lt=1), "probability of the chi-square quantile"] = 0.95,
) -> Parts:
    """Share of the steps whose nu' S^-1 nu exceeds the chi-square quantile: 1 - level if the filter is consistent."""
    return {"quantity": NisBeyond(level), "reduce": "mean_where"}


def whiteness(lag: Annotated[int, Ge(1), "steps between the two"] = 1) -> Parts:
    """Autocorrelation of the standardised innovations over the run: about 0 +- 2/sqrt(T m) if the filter is right."""
    return {"quantity": Whiteness(lag), "reduce": "last"}


def innovation_rms(component: Annotated[str, "one measurement by its name; default: all"] = "") -> Parts:
    """Root of the mean squared innovation: how well the filter predicts the measurement of the next step."""
    return {"quantity": SquaredInnovation(component=component), "reduce": "root_where"}


def log_likelihood() -> Parts:
    """Log density of the innovations under N(0, S), averaged over the steps with a measurement: larger is better."""
    return {"quantity": LogLikelihood(), "reduce": "mean_where"}
