"""A filter for each part of a model that falls into independent parts: two axes, two sensors with states of their own.

The exact answer is the same, and what costs more with every dimension (particles) then sees one part at a time. With
thousands of particles on two states this is the particle reference of the FP-MCS paper's experiment; how far it is from
the optimum, only more particles tell.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from rkfbench.errors import SpecError, did_you_mean
from rkfbench.filters.base import Estimate, Filter, Known, Setting
from rkfbench.filters.recursion import prepare
from rkfbench.filters.smoothing import SEES, Inner, inner_filter, placed
from rkfbench.linalg import Array
from rkfbench.models import Linear, Model
from rkfbench.noise import Law
from rkfbench.streams import GROUP, Streams

Parts = Annotated[tuple[tuple[str, ...], ...], "names of the states of each part; all states, each once"]


@dataclass(frozen=True)
class Part(Linear):
    """Some states of a linear model, with the measurements that are about them alone."""

    model: Any
    rows: tuple[int, ...]

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(self.model.states[i] for i in self.rows)

    @property
    def measurements(self) -> tuple[str, ...]:
        return tuple(self.model.measurements[i] for i in self.measured)

    @cached_property
    def measured(self) -> tuple[int, ...]:
        """The measurements that depend on these states."""
        H = self.model.matrices[1]
        return tuple(i for i in range(len(H)) if np.any(H[i, list(self.rows)]))

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array | None]:  # type: ignore[override]
        F, H, Bu = self.model.matrices
        rows = list(self.rows)
        return F[np.ix_(rows, rows)], H[np.ix_(self.measured, rows)], None if Bu is None else Bu[rows]


@dataclass(frozen=True)
class Decoupled:
    """One filter a part, of a linear model and noises that fall into these parts."""

    filter: Any
    parts: Parts
    setting: Setting | None = None

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return SEES & self.filter.sees

    @property
    def target(self) -> int | None:
        """The step j, around a smoother of one point."""
        return getattr(self._whole, "target", None)

    @property
    def lag(self) -> int | None:
        """Measurements after j that it uses."""
        return getattr(self._whole, "lag", None)

    @property
    def _whole(self) -> Filter:
        whole: Filter = self.filter if self.setting is None else placed(self.filter, self.setting)
        return whole

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear and falls into the parts."""
        named = [name for part in self.parts for name in part]
        for i, part in enumerate(self.parts):
            for name in part:
                if name not in model.states:
                    raise SpecError(f"the model has no state '{name}'{did_you_mean(name, model.states)}", ["parts", i])
        if sorted(named) != sorted(model.states):
            raise SpecError("the parts must have all states, each once", ["parts"])
        if not model.linear:
            raise SpecError("only a linear model can fall into parts")
        F, H, _ = model.matrices  # type: ignore[attr-defined]
        belongs = [_belongs(model, self.parts, name) for name in model.states]
        mixed = any(F[i, k] and belongs[i] != belongs[k] for i in range(len(F)) for k in range(len(F)))
        if mixed or any(len({belongs[k] for k in np.flatnonzero(row)}) > 1 for row in H):
            raise SpecError("the model does not fall into these parts", ["parts"])

    def placed(self, setting: Setting) -> Decoupled:
        """The filter in an experiment; the laws are divided where the parts are known."""
        placed(self.filter, setting)  # says what is wrong with it
        return replace(self, setting=setting)

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
        """The estimates; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        prepare(model, y, x0, P0, Q, R)  # says what is wrong with them
        streams = streams or Streams(0, groups=-(-np.atleast_3d(y).shape[2] // GROUP))
        found: dict[tuple[int, ...], Estimate] = {}
        for i, names in enumerate(self.parts):
            rows = tuple(model.states.index(name) for name in names)
            part = Part(model, rows)
            _check_blocks(rows, P0, Q)
            measured = list(part.measured)
            _check_blocks(tuple(measured), R)
            found[rows] = self._of(part).run(
                part,
                np.asarray(y)[:, measured],
                np.asarray(x0)[list(rows)],
                _block(P0, rows),
                Q=_block(Q, rows),
                R=_block(R, measured),
                keep={*keep} & self.sees,
                streams=streams.within(f"part {i}"),
            )
        return _together(found, len(model.states))

    def _of(self, part: Part) -> Filter:
        """The filter with the laws of the part's noises."""
        if self.setting is None:
            one: Filter = self.filter
            return one
        laws = _marginal(self.setting.process, part.rows), _marginal(self.setting.measurement, part.measured)
        return placed(self.filter, Setting(self.setting.steps, *laws, self.setting.point))


def decoupled(filter: Inner, parts: Parts) -> Decoupled:
    """One filter for each independent part of a linear model: with many particles a reference."""
    return Decoupled(inner_filter(filter), parts)


def _belongs(model: Model, parts: Parts, name: str) -> int:
    return next(i for i, part in enumerate(parts) if name in part)


def _block(A: Array, rows: Collection[int], columns: Collection[int] | None = None) -> Array:
    """Rows and columns of a covariance (d, d), (d, d, M) or (T, d, d, M)."""
    A, of_both = np.asarray(A), (rows, rows if columns is None else columns)
    i, j = np.ix_(*(np.array([*each], dtype=np.intp) for each in of_both))
    return A[:, i, j] if A.ndim == 4 else A[i, j]


def _check_blocks(rows: tuple[int, ...], *covariances: Array) -> None:
    """SpecError where a covariance couples these components with others."""
    for C in covariances:
        others = np.setdiff1d(np.arange(np.shape(C)[1]), rows)
        if np.any(_block(C, rows, others)):
            raise SpecError("a covariance couples the parts")


def _marginal(law: Any, rows: Collection[int]) -> Law:
    marginal: Law = law.marginal(np.array([*rows]))
    return marginal


def _together(found: dict[tuple[int, ...], Estimate], n: int) -> Estimate:
    """The estimates of the parts as that of the whole: covariances are block-diagonal."""
    estimates, first = [*found.values()], next(iter(found.values()))

    def whole(parts: Sequence[Array]) -> Array:
        width = max(part.shape[-1] for part in parts)
        A = np.zeros((len(parts[0]), *([n] * (parts[0].ndim - 2)), width))
        for rows, part in zip(found, parts, strict=True):
            A[np.ix_(range(len(A)), *([rows] * (part.ndim - 2)), range(width))] = part
        return A

    covs = [each.cov for each in estimates if each.cov is not None]
    extras = {name: whole([each.extras[name] for each in estimates]) for name in SEES & first.extras.keys()}
    failed = np.any([each.failed for each in estimates], axis=0)
    mean = whole([each.mean for each in estimates])
    return Estimate(mean, whole(covs) if covs else None, failed, extras, first.target)
