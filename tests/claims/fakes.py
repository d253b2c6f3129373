"""Results made of arrays, and claims judged on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench.claims.checks import checks_of
from rkfbench.claims.ledger import Row, claim_verdicts, ledger
from rkfbench.claims.plan import Outline, outline, own_paper, plan
from rkfbench.claims.verdict import Verdict
from rkfbench.scenario import load
from rkfbench.scenario.claims import Claim

Array = NDArray[np.float64]
Key = tuple[str, str, str]  # case, filter, metric


class Arrays:
    """Stats whose values do not depend on the reading; lost runs by (case, filter)."""

    def __init__(
        self,
        values: Mapping[Key, Array],
        lost: Mapping[tuple[str, str], Any] | None = None,
        checks: Mapping[str, tuple[float, float]] | None = None,
        tuning: Arrays | None = None,
    ) -> None:
        self.arrays, self.gone, self.checks, self.tuning = dict(values), dict(lost or {}), dict(checks or {}), tuning
        self.runs = len(next(iter(self.arrays.values()))) if self.arrays else 0

    def values(self, reading: str, case: str, filter: str, metric: str) -> Array:
        return np.asarray(self.arrays[case, filter, metric], float)

    def failed(self, reading: str, case: str, filter: str) -> NDArray[np.bool_]:
        found = [v for (c, f, _), v in self.arrays.items() if (c, f) == (case, filter)]
        return np.isnan(np.array(found, float)).any(axis=0) if found else np.zeros(self.runs, bool)

    def lost(self, reading: str, case: str, filter: str) -> NDArray[np.bool_]:
        return np.asarray(self.gone.get((case, filter), np.zeros(self.runs, bool)), bool) | self.failed(
            reading, case, filter
        )

    def check(self, id: str) -> tuple[float, float]:
        return self.checks[id]


def outline_of(stats: Arrays, readings: tuple[str, ...] = ("default",)) -> Outline:
    cases, filters, metrics = (tuple(dict.fromkeys(key[i] for key in stats.arrays)) for i in range(3))
    return Outline(readings, cases or ("",), filters, metrics, tuple(stats.checks))


def offered(scenario: str, paper: str) -> Outline:
    """What a bundled scenario offers to the claims of a paper."""
    loaded = load(scenario)
    return outline(loaded.cells, loaded.paper_runs, checks_of(paper))


def rows_of(claim: Mapping[str, Any], stats: Arrays) -> tuple[Row, ...]:
    paper = own_paper("s", [Claim.model_validate({"id": "c", "says": "x", **claim})])
    outlines = {"s": outline_of(stats)}
    return ledger(paper, plan(paper, outlines), {"s": stats}, outlines)


def verdict_of(claim: Mapping[str, Any], stats: Arrays) -> Verdict:
    paper = own_paper("s", [Claim.model_validate({"id": "c", "says": "x", **claim})])
    outlines = {"s": outline_of(stats)}
    rows = ledger(paper, plan(paper, outlines), {"s": stats}, outlines)
    return claim_verdicts(paper, rows, outlines)[0].verdicts["default"]
