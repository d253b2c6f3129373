"""What a filter is given and what it returns.

`Filter.run` takes a model, measurements and what the filter is told (start, P0, Q, R) and returns an `Estimate`. It
knows neither truth nor experiment;
only references (a clairvoyant filter) read `Known`, and their catalogue entry declares that they need it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.noise import Law, Sample
from rkfbench.streams import Streams


@dataclass(frozen=True)
class Estimate:
    """Posterior means (T, n, M), their covariances (T, n, n, M or 1) if kept, which runs failed (M,), and the kept
    extras by name, time first.

    `target` is the step j whose state all the means estimate (a smoother of one point, its first axis being the lag);
    None: mean[k-1] estimates x_k.
    `passed` is the estimate of the smoother's own filter, with its prior means, where the smoother was asked to keep
    it.
    """

    mean: Array
    cov: Array | None
    failed: NDArray[np.bool_]
    extras: Mapping[str, Array] = field(default_factory=dict)
    target: int | None = None
    passed: Estimate | None = None
    death: str = ""  # how the first of the failed runs died, where that is known
    derived: dict[str, Array] = field(default_factory=dict, repr=False)  # what metrics made of it and look at again

    def of(self, runs: slice) -> Estimate:
        """The estimate of some of the runs, as views; what all runs share stays shared."""

        def cut(A: Array) -> Array:
            return A if A.shape[-1] == 1 else A[..., runs]

        return Estimate(
            cut(self.mean),
            None if self.cov is None else cut(self.cov),
            cut(self.failed),
            {name: cut(A) for name, A in self.extras.items()},
            self.target,
            None if self.passed is None else self.passed.of(runs),
            self.death,
        )


@dataclass(frozen=True)
class Known:
    """What no real filter knows: the true states (T, n, M) and the record behind process and measurement noise."""

    truth: Array
    w: Sample
    v: Sample

    def of(self, runs: slice, steps: int | None = None) -> Known:
        """What is known of some of the runs, in the first steps."""
        return Known(self.truth[:steps, :, runs], self.w.of(runs, steps), self.v.of(runs, steps))


@dataclass(frozen=True)
class Setting:
    """What an experiment tells a filter that has a method `placed`, to fill in what its own description leaves out.

    The laws of the noise are those of the truth without disturbances; `point` is the step j and the lag that point
    smoothers take.
    """

    steps: int
    process: Law
    measurement: Law
    point: tuple[int, int] | None = None


class Filter(Protocol):
    """Estimates the states of all runs from their measurements."""

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """Estimate from y (T, m, M) or (T, m), starting before the first step from mean x0 (n,) or (n, M) and
        covariance P0 (n, n). References that read `known`, and estimates from a file, take y (T, m, M) alone.

        Q (n, n) and R (m, m) are the covariances that the filter is told, or (T, n, n, M or 1) and (T, m, m, M or 1).
        NaN in y is a missing component.
        `keep` names the histories to return: cov, prior_mean, prior_cov, and what the filter sees in a step (nu, S,
        ...).
        """
        ...


class Posterior(NamedTuple):
    """One measurement update: mean x (n, M), covariance P (n, n, M or 1) and what was seen on the way, by name."""

    x: Array
    P: Array
    seen: Mapping[str, Array]
