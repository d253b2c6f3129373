"""From finished blocks to the tables of a results folder.

Blocks are read case by case and in their order, so the bytes depend neither on the order in which blocks were finished
nor on the engine, and the memory holds one filter of one case at a time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench import metrics, own, sheet
from rkfbench.scenario import attached
from rkfbench.scenario.yaml import dump
from rkfbench.store import blocks, files
from rkfbench.store.blocks import Curve, Part
from rkfbench.store.results import KEYS
from rkfbench.study import plan
from rkfbench.study.plan import Unit
from rkfbench.study.summary import along, summarise

if TYPE_CHECKING:
    from rkfbench.scenario import Cell, Scenario

COPIES = (attached.COPIES, own.COPIES)  # folders of what a study was made from
TABLES = ("scenario.yaml", "filters.csv", "summary.csv", "series.csv", "runs.csv")
STATISTICS = ("mean", "se", "sd", "median", "q05", "q95", "max")
CURVE_STATISTICS = frozenset({"mean", "median", "first"})
MOST_STEPS, STRETCHES = 600, 200


@dataclass(frozen=True)
class Finished:
    """The units of one cell, in order, and those of its filters that are finished in all of them."""

    cell: Cell
    units: tuple[Unit, ...]
    labels: tuple[str, ...]

    @property
    def identity(self) -> dict[str, Any]:
        """The leading columns of its rows: reading, case and the point of the sweep."""
        return {"reading": plan.reading(self.cell), "case": self.cell.case, **self.cell.point}


@dataclass(frozen=True)
class Held:
    """What a study was made from: the scenario, and by path in the results folder the data and plug-ins beside it."""

    scenario: str
    copies: Mapping[str, bytes]

    @classmethod
    def of(cls, scenario: Scenario) -> Held:
        """InputChanged where a file of data is not there as it was read."""
        resolved, named = attached.carried(scenario.resolved)
        read = attached.hashes([*scenario.cells, *scenario.sensitivity])
        data = {f"{attached.COPIES}/{name}": sheet.content(path, read.get(path, "")) for name, path in named.items()}
        return cls(dump(resolved), data | {f"{own.COPIES}/{name}": each for name, each in scenario.copies.items()})

    def write(self, folder: Path) -> list[str]:
        """Write it into the results folder, so that the stored scenario can be run again; the names of its copies."""
        files.write(folder / "scenario.yaml", self.scenario)
        for name, content in self.copies.items():
            files.write(folder / name, content)
        return [*self.copies]


def write(folder: Path, held: Held, scenario: Scenario, finished: Sequence[Finished]) -> list[str]:
    """Write scenario.yaml with its copies, filters.csv, summary.csv, series.csv and runs.csv; the names of all."""
    copies = held.write(folder)
    _write_filters(folder / "filters.csv", finished)

    finished = [each for each in finished if each.labels]  # there is no block where every filter raised
    sweep = list(dict.fromkeys(column for each in finished for column in each.cell.point))
    series: list[dict[str, Any]] = []
    summary = list(_summary(finished, scenario, series))
    statistics = ("runs", "failed", "lost", *STATISTICS)
    files.write_records(folder / "summary.csv", ["reading", "case", *sweep, "filter", "metric", *statistics], summary)
    files.write_records(
        folder / "series.csv", ["reading", "case", "filter", "metric", "k", "mean", "se", "median", "first"], series
    )
    names = list(dict.fromkeys(row["metric"] for row in summary))
    files.write_csv(folder / "runs.csv", [*KEYS, *names], _runs(finished, names))
    return [*TABLES, *copies]


def _summary(
    finished: Sequence[Finished], scenario: Scenario, series: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """The rows of summary.csv; those of series.csv are appended to `series` on the way."""
    for each in finished:
        for label, part in _parts(each):
            identity = {**each.identity, "filter": label}
            counts = {"runs": len(part.failed), "failed": int(part.failed.sum()), "lost": int(part.lost.sum())}
            for metric, values in part.values.items():
                there = ~part.lost if metrics.get(metric).tracking else slice(None)
                row = summarise(values[there], part.failed[there], metrics.get(metric).root)
                yield {**identity, "metric": metric, **counts, **row}
            for metric, curve in part.curves.items():
                wanted = shown(scenario, each.cell, label, metric)
                rows = list(along(curve, metrics.get(metric).root)) if wanted else []
                series.extend({**identity, "metric": metric, **row} for row in thinned(rows, wanted))


def shown(scenario: Scenario, cell: Cell, label: str, metric: str) -> frozenset[str]:
    """Which statistics of a curve series.csv keeps: those that figures show, all if none shows the metric at all.

    Curves are long; all of those of all cases and filters would make a folder too large to be committed. The blocks
    keep them.
    """
    from rkfbench.scenario.display import Steps, case_matches

    extra = any(each["label"] == label and each.get("extra") for each in cell.spec["filters"])
    figures = [each for each in scenario.figures if isinstance(each, Steps)]
    figures = [each for each in figures if metric in (*each.metrics, each.beside, each.band)]
    if not figures:
        return CURVE_STATISTICS
    return frozenset(
        "mean" if metric == each.band and each.statistic == "first" else each.statistic
        for each in figures
        if (cell.switch is None if each.readings is None else plan.reading(cell) in each.readings)
        and (not cell.extra if each.cases is None else any(case_matches(name, cell.case) for name in each.cases))
        and (not extra if each.filters is None else label in each.filters)
    )


def thinned(rows: list[dict[str, Any]], wanted: frozenset[str]) -> list[dict[str, Any]]:
    """The rows of a curve with the statistics that are wanted, and no more steps than a figure can show.

    Of a curve of more than MOST_STEPS steps each of STRETCHES equal stretches keeps the steps with its least and its
    largest value, so that every peak stays where it is. With all statistics wanted the curve is left whole.
    """
    if wanted == CURVE_STATISTICS:
        return rows
    if len(rows) > MOST_STEPS:
        keep = {0, len(rows) - 1}
        for stretch in np.array_split(np.arange(len(rows)), STRETCHES):
            for name in sorted(wanted):
                values = [(rows[i][name], i) for i in stretch.tolist() if rows[i][name] is not None]
                keep |= {min(values)[1], max(values)[1]} if values else set()
        rows = [rows[i] for i in sorted(keep)]
    columns = {"k", *wanted} | ({"se"} if "mean" in wanted else set())
    return [{name: value if name in columns else None for name, value in row.items()} for row in rows]


def _parts(finished: Finished) -> Iterator[tuple[str, Part]]:
    """Filter after filter over all blocks of a cell; with a single block its file is read once."""
    if len(finished.units) == 1:
        parts = blocks.read(finished.units[0].path, set(finished.labels))
        yield from ((label, parts[label]) for label in finished.labels)
    else:
        yield from ((label, _whole(finished.units, label)) for label in finished.labels)


def _whole(units: Sequence[Unit], label: str) -> Part:
    """One filter over all blocks of a cell."""
    parts = [blocks.read(unit.path, {label})[label] for unit in units]
    curves: dict[str, Curve] = dict(parts[0].curves)
    for part in parts[1:]:
        curves = {metric: curve.merge(part.curves[metric]) for metric, curve in curves.items()}
    return Part(
        np.concatenate([part.failed for part in parts]),
        np.concatenate([part.lost for part in parts]),
        {metric: np.concatenate([part.values[metric] for part in parts]) for metric in parts[0].values},
        curves,
    )


def _runs(finished: Sequence[Finished], names: Sequence[str]) -> Iterator[list[Any]]:
    """The rows of runs.csv: case after case, run after run, filter after filter."""
    for each in finished:
        reading, case = plan.reading(each.cell), each.cell.case
        for unit in each.units:
            parts = blocks.read(unit.path, set(each.labels))
            tables = {label: _table(parts[label], names) for label in each.labels}
            for run in range(unit.first, unit.last):
                for label in each.labels:
                    yield [reading, case, run, label, *tables[label][run - unit.first]]


def _table(part: Part, names: Sequence[str]) -> list[tuple[Any, ...]]:
    """Per run: failed, lost and the metrics `names` (None for one that this filter does not have)."""
    absent = [None] * len(part.failed)
    columns = (part.values[name].tolist() if name in part.values else absent for name in names)
    return list(zip(part.failed.astype(int).tolist(), part.lost.astype(int).tolist(), *columns, strict=True))


def _write_filters(path: Path, finished: Sequence[Finished]) -> None:
    """One row for each label; one more where a case or a reading gives the label other parameters."""
    rows: dict[str, dict[str, Any]] = {}
    for each in finished:
        for spec in each.cell.spec["filters"]:
            if spec["label"] in each.labels:
                row = {"label": spec["label"], **dict(_parameters(spec))}
                rows.setdefault(json.dumps(row), row)
    columns = list(dict.fromkeys(["label", "name", *(column for row in rows.values() for column in row)]))
    labels = list(dict.fromkeys(row["label"] for row in rows.values()))
    files.write_records(path, columns, sorted(rows.values(), key=lambda row: labels.index(row["label"])))


def _parameters(spec: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The parameters of a filter with nested ones under dotted names: weight.huber.threshold."""
    for key, value in spec.items():
        if prefix or key not in ("label", "extra", "timing"):
            column = "name" if key == "use" and not prefix else prefix + key
            if isinstance(value, Mapping):
                yield from _parameters(value, f"{column}.")
            else:
                value = own.short(value) if column == "name" else value
                yield column, json.dumps(value) if isinstance(value, list) else value
