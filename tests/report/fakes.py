"""A results folder with made-up numbers that look like those of a contamination study, and a paper's printed table."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rkfbench.report.material import Material
from rkfbench.scenario.paper_schema import PrintedLine, PrintedRow, PrintedTable
from rkfbench.store import Results, files, manifest
from rkfbench.study import clock
from rkfbench.study.summary import QUANTILES

READINGS = ("literal", "root")
RATES = (0.05, 0.2, 0.3, 0.4)
VARIANTS = {"hkf[threshold=0.5]": 1.5, "hkf[threshold=3]": 1.7}
LEVEL = {"clairvoyant_kf": 1.0, "kf": 2.0, "hkf": 1.4, "aladkf": 1.3, **VARIANTS}
EXTRAS = frozenset(VARIANTS)
TIMES = {"kf": 14.0, "hkf": 33.0}
RUNS, STEPS = 60, 40

SCENARIO = """\
name: fake
title: A study with made-up numbers
notes: What <one> must know of it.
paper: {cite: "A. Author & B. Author, Journal of <Examples> 1(1), 2020", doi: 10.0000/example}
seed: 5
runs: {paper: 60, reference: 60}
steps: 40
model: {kind: navigation, dt: 0.5, observed: [px, py, vx]}
start: {truth: [1, 1, 1, 1]}
process_noise: {kind: gaussian, cov: 1}
measurement_noise:
  kind: contaminated
  rate: 0.05
  body: {kind: gaussian, cov: 1}
  outliers: {kind: laplace, cov: {times: 100, of: body}}
assumed: {mean: [0, 0, 0, 0], cov: 1, measurement_cov: body}
readings: {literal: {}, root: {process_noise.cov: 4, caveat: A guess of ours.}}
sweep: {measurement_noise.rate: [0.05, 0.2, 0.3, 0.4]}
filters: [clairvoyant_kf, kf, hkf, aladkf, {use: hkf, threshold: [0.5, 3], extra: true}]
metrics: [err_norm, cond_S, err_norm@k, rmse@k]
figures:
  - {id: fig1, kind: sweep, over: rate, metric: cond_S, y: {label: cond(S)}, title: Condition numbers}
  - {id: fig2, kind: runs, metric: err_norm, cases: [rate=0.4], first: 20, readings: [literal]}
  - {id: fig3, kind: forest, claims: [mine-1, mine-2], readings: [literal]}
tables:
  - {id: table1, metric: err_norm, title: "Errors & co."}
  - {id: table2, metric: err_norm, statistic: median, readings: [literal]}
claims:
  - id: mine-1
    says: "the HKF beats the KF <always>"
    ordering: {metric: err_norm, filters: [kf, hkf], cases: [rate=0.05, rate=0.4]}
  - id: mine-2
    says: the ALADKF beats the HKF
    ordering: {metric: err_norm, filters: [hkf, aladkf], cases: [rate=0.4]}
"""


def write_results(folder: Path, *, with_runs: bool = True, dead: str = "") -> Results:
    """The folder; every run of the filter `dead` has failed."""
    random = np.random.default_rng(5)
    summary: list[dict[str, Any]] = []
    series: list[dict[str, Any]] = []
    runs: list[dict[str, Any]] = []
    for reading, rate, label in itertools.product(READINGS, RATES, LEVEL):
        level = LEVEL[label] * (1 + 6 * rate * (label == "kf") + 2 * rate) * (30 if reading == "root" else 1)
        failed = np.full(RUNS, label == dead)
        lost = failed | (random.random(RUNS) < (0.05 if label == "kf" and rate == 0.4 else 0))
        values = {"err_norm": level * random.lognormal(0, 0.1, RUNS), "cond_S": level * random.lognormal(0, 0.3, RUNS)}
        place = {"reading": reading, "case": f"rate={rate}"}
        counts = {"runs": RUNS, "failed": int(failed.sum()), "lost": int(lost.sum())}
        for metric, value in values.items():
            statistics = _statistics(value, failed)
            summary.append({**place, "rate": rate, "filter": label, "metric": metric, **counts, **statistics})
        noise = random.lognormal(0, 0.15, STEPS)
        for metric, times in (("err_norm@k", 1.0), ("rmse@k", 0.8)):
            for k in range(1, STEPS + 1):
                mean = None if label == dead else float(level * times * noise[k - 1])
                row = {"k": k, "mean": mean, "se": mean and 0.04 * mean, "median": mean and 0.98 * mean}
                series.append({**place, "filter": label, "metric": metric, **row})
        for run in range(RUNS):
            shown = {metric: float("nan") if failed[run] else float(value[run]) for metric, value in values.items()}
            flags = {"failed": int(failed[run]), "lost": int(lost[run])}
            runs.append({**place, "run": run, "filter": label, **flags, **shown})
    files.write(folder / "scenario.yaml", SCENARIO)
    files.write_records(folder / "summary.csv", list(summary[0]), summary)
    files.write_records(folder / "series.csv", list(series[0]), series)
    files.write_records(folder / "filters.csv", ["label", "name", "threshold"], list(_filters()))
    files.write_records(folder / "claims.csv", list(claim_row()), list(_claims()))
    if with_runs:
        files.write_records(folder / "runs.csv", list(runs[0]), runs)
    facts = {"argv": ["rkfbench", "run", "fake"], "commit": "abc", "versions": {"numpy": "2"}}
    manifest.seal(folder, *manifest.TOP, scenario="fake", seed=5, runs=RUNS, **facts)
    timed = {("literal", "rate=0.05", label, "time_ms"): [ms, ms + 1, ms + 2] for label, ms in TIMES.items()}
    clock.write(clock.Times("", timed), folder)
    return Results.open(folder)


def material(results: Results, printed: PrintedTable | None = None) -> Material:
    return Material(results, EXTRAS, readings=READINGS, printed={"table-1": printed or printed_table()})


def printed_table(**changes: Any) -> PrintedTable:
    """A printed table of four cases and three filters, the last one without numbers."""
    columns = [PrintedLine(label=label.upper(), filter=label) for label in ("kf", "hkf", "aladkf")]
    rows = [PrintedRow(label=f"case {i}", case=f"rate={r}", values=[4.1, 1.5, None]) for i, r in enumerate(RATES, 1)]
    table = {"title": "Mean error", "runs": 100, "metric": "err_norm", "decimals": 2, "columns": columns, "rows": rows}
    return PrintedTable(**{**table, **changes})


def claim_row(**changes: Any) -> dict[str, Any]:
    """A line of claims.csv: an ordering that holds."""
    row = {
        "claim": "mine-1", "role": "decides", "kind": "ordering", "estimand": "kf - hkf in err_norm at rate=0.4",
        "scenario": "fake", "reading": "literal", "evidence": "ours", "family": "primary", "family_size": 4,
        "claimed": "> 0", "region_low": 0.0, "region_high": float("inf"), "printed": None, "printed_runs": None,
        "estimate": 2.49, "se": 0.012, "runs": RUNS, "law": "t", "decided_on": "estimate", "mean": 2.49, "median": 2.5,
        "failed": 0, "lost": 0, "lower": 2.45, "upper": 2.53, "verdict": "reproduced", "flip_at": 2.45, "flip": 2.45,
        "flip_percent": 98.0, "scale": 2.5, "runs_needed": None, "reason": None,
    }  # fmt: skip
    return row | changes


def _claims() -> Iterator[dict[str, Any]]:
    open_ = {"estimate": 0.02, "se": 0.01, "lower": -0.01, "upper": 0.05, "verdict": "inconclusive", "flip_at": 0.05}
    wrong = {"estimate": -0.49, "se": 0.1, "lower": -0.8, "upper": -0.2, "verdict": "not reproduced", "flip_at": -0.2}
    yield claim_row()
    yield claim_row(estimand="kf - hkf in err_norm at rate=0.05", flip_percent=3.0)
    yield claim_row(reading="root", **open_, flip_percent=1.0, runs_needed=700, lost=3)
    yield claim_row(claim="mine-2", estimand="hkf - aladkf in err_norm", **wrong)
    yield claim_row(claim="mine-2", estimand="hkf - aladkf in err_norm", reading="root", **open_)
    yield claim_row(claim="mine-1", reading="literal+mixture R", **wrong)
    yield claim_row(role="beside", kind="show", estimand="kf in err_norm", claimed="", region_low=float("-inf"))


def _statistics(values: Any, failed: Any) -> dict[str, float | None]:
    good = values[~failed]
    if not good.size:
        return {"mean": None, "se": None, "sd": None, **dict.fromkeys(QUANTILES, float("inf"))}
    sd = float(good.std(ddof=1))
    quantiles = {name: float(np.quantile(good, q)) for name, q in QUANTILES.items()}
    return {"mean": float(good.mean()), "se": sd / good.size**0.5, "sd": sd, **quantiles}


def _filters() -> Iterator[dict[str, Any]]:
    for label in LEVEL:
        name, _, value = label.rstrip("]").partition("[threshold=")
        yield {"label": label, "name": name, "threshold": float(value or 1.345) if name == "hkf" else None}
