"""A study small enough to check by hand: fake scenario, fake compute, fake metrics.

The value of a run is a known function of seed, run, case and filter, so every number of a table has a formula.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

BLOCK = 4


@dataclass(frozen=True)
class Cell:
    reading: str
    case: str
    point: dict[str, Any]
    switch: str | None
    extra: bool
    spec: dict[str, Any]


@dataclass(frozen=True)
class Scenario:
    name: str = "toy"
    title: str = "A toy study"
    paper: str | None = None
    seed: int = 7
    file: str = "toy.yaml"
    plugins: Path = Path()
    runs: int = 10
    cells: tuple[Cell, ...] = ()
    sensitivity: tuple[Cell, ...] = ()
    figures: tuple[Any, ...] = ()
    resolved: dict[str, Any] = field(default_factory=lambda: {"name": "toy", "seed": 7})
    copies: dict[str, bytes] = field(default_factory=dict)

    def changed(self, **spec: Any) -> Scenario:
        """The same study with entries of every cell's specification replaced."""
        return replace(self, cells=tuple(replace(cell, spec={**cell.spec, **spec}) for cell in self.cells))


def scenario(rates: Sequence[float] = (0.1, 0.2), filters: Sequence[str] = ("kf", "hkf"), **more: Any) -> Scenario:
    cells = tuple(
        Cell(
            "literal",
            f"rate={rate}",
            {"rate": rate},
            None,
            False,
            {
                "steps": 3,
                "rate": rate,
                "filters": [{"label": each, "use": each, "extra": each == "spare"} for each in filters],
                "metrics": ["rmse", "pooled_rmse"],
            },
        )
        for rate in rates
    )
    return Scenario(cells=cells, **more)


def value(seed: int, run: int, rate: float, label: str) -> float:
    """What the fake filter gives for one run."""
    return float(np.random.default_rng([seed, run, len(label)]).standard_normal() ** 2 + rate)


class Compute:
    """A stand-in for study.compute: counts its calls; raises for the labels of `broken`; run 3 of hkf fails."""

    def __init__(self) -> None:
        self.calls: list[tuple[float, int, tuple[str, ...]]] = []
        self.broken: set[str] = set()

    def together(
        self, specs: Sequence[dict[str, Any]], seed: int, block: int, runs: int, labels: Sequence[str]
    ) -> Iterator[Any]:
        results = [self(spec, seed, block, runs, labels).filters for spec in specs]
        for label in labels:
            yield label, [result[label] for result in results]

    def __call__(self, spec: dict[str, Any], seed: int, block: int, runs: int, labels: Sequence[str]) -> Any:
        self.calls.append((spec["rate"], block, tuple(labels)))
        if self.broken & set(labels):
            raise ValueError("no such matrix")
        mine = range(block * BLOCK, min((block + 1) * BLOCK, runs))
        filters = {}
        for label in labels:
            failed = np.array([run == 3 and label == "hkf" for run in mine])
            values = np.array([value(seed, run, spec["rate"], label) for run in mine])
            values = np.where(failed, np.nan, values)
            curve = values * np.arange(1.0, spec["steps"] + 1)[:, None]
            filters[label] = SimpleNamespace(
                failed=failed,
                death="",
                lost=np.array([run == 0 for run in mine]),
                values={"rmse": values, "pooled_rmse": values},
                curves={"rmse": curve},
            )
        return SimpleNamespace(filters=filters)


def install(monkeypatch: pytest.MonkeyPatch) -> Compute:
    """Put the fakes in the place of the compute part."""
    import rkfbench.metrics

    @lru_cache
    def metric(name: str) -> Any:
        quantity = SimpleNamespace(partners=("kf",) if name == "beside_kf" else ())
        return SimpleNamespace(
            root=name.startswith("pooled"), ks=lambda steps: np.arange(1, steps + 1), quantity=quantity, tracking=False
        )

    compute = Compute()
    for name, content in {
        "compute": {"together": compute.together},
        "blocks": {"block_size": lambda steps: BLOCK},
    }.items():
        monkeypatch.setitem(sys.modules, f"rkfbench.study.{name}", SimpleNamespace(**content))
    monkeypatch.setattr(rkfbench.metrics, "get", metric, raising=False)
    return compute
