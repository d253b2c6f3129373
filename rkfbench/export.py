"""The data of a study for programs in other languages: what filters see, what they are told, and the truth.

    export.json                    the cases, their files, the model, x0, P0, Q, R, and F and H where they are constant
    <case>.measurements.csv        run, k, the measurements      (an empty cell: missing)
    <case>.truth.csv               run, k, the states            (<reading>.<case> but for the first reading)
    <case>.mat                     the same for MATLAB and Octave: y (T, m, M), x (T, n, M), x0, P0, Q, R, F, H, Bu
    estimates.<label>.csv          of our filters that were asked for: what `rkfbench score` reads

The numbers are those on which `rkfbench run` runs its filters, to the last bit. Files of an earlier export of the
scenario into the same folder are replaced, or removed.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench.catalogue import parameters
from rkfbench.errors import UsageError
from rkfbench.experiment import Experiment, World
from rkfbench.filters.estimates import covariance_column
from rkfbench.linalg import Array
from rkfbench.models import MODELS
from rkfbench.store import files, loose
from rkfbench.streams import GROUP, Streams
from rkfbench.study.blocks import block_size
from rkfbench.study.wide import alone

if TYPE_CHECKING:
    from rkfbench.scenario import Cell, Scenario

FORMAT = 1
INDEX = "export.json"
KINDS = ("measurements.csv", "truth.csv", "mat")  # of one case
_ROW = re.compile(r"\[\s+([^\[\]{}]*?)\s+\]")  # a list of numbers or names: written on one line


@dataclass(frozen=True)
class Data:
    """The runs of one cell: y (T, m, M), x (T, n, M), x0 (n, M), and the estimates of filters by label: mean (T, n, M)
    and covariance (T, n, n, M), or None.
    """

    y: Array
    x: Array
    x0: Array
    estimates: dict[str, tuple[Array, Array | None]]


def export(scenario: Scenario, cells: Sequence[Cell], folder: Path, labels: Sequence[str] = ()) -> list[Path]:
    """Write the data of some cells of a scenario, and the estimates of its filters `labels`; the files written.

    UsageError, before anything is written, for a smoother of one point, whose estimates are not along the run.
    """
    experiments = [Experiment.of(cell.spec) for cell in cells]
    for label in labels:
        if any(getattr(each.filters[label][0], "target", None) is not None for each in experiments):
            raise UsageError(f"'{label}' estimates one step only: export the filter inside it")
    written: list[Path] = []
    described = []
    pages: dict[str, list[tuple[Cell, Array, Array | None]]] = {label: [] for label in labels}
    stems = _apart([cell.case or "data" for cell in cells])
    readings = _apart([cell.reading for cell in cells])
    files_of = _apart(labels)

    def stem_of(cell: Cell) -> str:
        stem = stems[cell.case or "data"]
        return stem if cell.reading == scenario.cells[0].reading else f"{readings[cell.reading]}.{stem}"

    of = f"export of {scenario.name}"
    planned = [f"{stem_of(cell)}.{kind}" for cell in cells for kind in KINDS]
    planned += (f"estimates.{each}.csv" for each in files_of.values())
    loose.refuse_foreign(folder, [INDEX, *planned], of)
    for cell, experiment in zip(cells, experiments, strict=True):
        data = simulated(experiment, scenario.seed, scenario.runs, labels)
        names = _write(stem_of(cell), experiment, data, folder)
        described.append({"case": cell.case, "reading": cell.reading, "files": names, **_told(cell, experiment, data)})
        written += (folder / name for name in names.values())
        for label, (mean, cov) in data.estimates.items():
            pages[label].append((cell, mean, cov))
    states = experiments[0].model.states
    for label, parts in pages.items():
        path = folder / f"estimates.{files_of[label]}.csv"
        with_cov = all(cov is not None for _, _, cov in parts)
        columns = estimate_columns(states, with_cov)
        rows = (row for cell, mean, cov in parts for row in _estimate_rows(cell, mean, cov if with_cov else None))
        files.write_csv(path, columns, rows)
        written.append(path)
    head = {
        "format": FORMAT,
        "scenario": scenario.name,
        "title": scenario.title,
        "seed": scenario.seed,
        "runs": scenario.runs,
        "layout": "CSV: one row a step, k = 1..steps, run = 0..runs-1. MAT: y (steps, measurements, runs), x (steps, "
        "states, runs), x0 (states, runs). x0 and P0 are before the first prediction, at k = 0.",
        "estimates": "rkfbench score reads a CSV with the columns " + ", ".join(estimate_columns(states, False)),
    }
    index = folder / INDEX
    text = json.dumps(head | {"cases": described}, indent=2)
    files.write(index, _ROW.sub(lambda row: f"[{' '.join(row[1].split())}]", text) + "\n")
    loose.record(folder, [index, *written], of)
    loose.remove_others(folder, of, [path.name for path in (index, *written)])  # they are of other data
    return [index, *written]


def simulated(experiment: Experiment, seed: int, runs: int, labels: Sequence[str] = ()) -> Data:
    """The first runs of an experiment, with the estimates of some of its filters."""
    size = block_size(experiment.steps)
    found: list[tuple[World, dict[str, Any]]] = []
    for first in range(0, runs, size):
        width = min(size, runs - first)
        streams = Streams(seed, first // GROUP, -(-width // GROUP))
        world = experiment.simulate(streams)
        made = {label: alone(experiment, world, streams, label, frozenset({"cov"})) for label in labels}
        found.append((world, made))

    def joined(parts: Sequence[Array]) -> Array:
        return np.concatenate(parts, axis=-1)[..., :runs]

    estimates: dict[str, tuple[Array, Array | None]] = {}
    for label in labels:
        each = [made[label] for _, made in found]
        covs = [_wide(one.cov, one.mean.shape[2]) for one in each if one.cov is not None]
        estimates[label] = joined([one.mean for one in each]), joined(covs) if covs else None
    x = [_wide(world.x, world.y.shape[2]) for world, _ in found]
    return Data(joined([world.y for world, _ in found]), joined(x), joined([world.x0 for world, _ in found]), estimates)


def estimate_columns(states: Sequence[str], with_cov: bool) -> list[str]:
    """The columns of a file of estimates."""
    pairs = [covariance_column(a, b) for i, a in enumerate(states) for b in states[i:]] if with_cov else []
    return ["reading", "case", "run", "k", *states, *pairs]


def _estimate_rows(cell: Cell, mean: Array, cov: Array | None) -> Iterator[list[Any]]:
    upper = np.triu_indices(mean.shape[1])
    for run in range(mean.shape[2]):
        table = mean[..., run]
        if cov is not None:
            table = np.hstack([table, cov[..., run][:, upper[0], upper[1]]])
        for k, row in enumerate(table.tolist(), 1):
            yield [cell.reading, cell.case, run, k, *row]


def _write(stem: str, experiment: Experiment, data: Data, folder: Path) -> dict[str, str]:
    """The files of one cell, whose names begin with `stem`; their names."""
    from scipy.io import savemat

    model = experiment.model
    names = {"measurements": f"{stem}.measurements.csv", "truth": f"{stem}.truth.csv", "mat": f"{stem}.mat"}
    files.write_csv(folder / names["measurements"], ["run", "k", *model.measurements], _rows(data.y))
    known = not np.isnan(data.x).any()
    if known:
        files.write_csv(folder / names["truth"], ["run", "k", *model.states], _rows(data.x))
    else:
        del names["truth"]
    arrays = {"y": data.y, "x0": data.x0, **({"x": data.x} if known else {}), **_matrices(experiment)}
    arrays |= {name: np.array(each, dtype=object) for name, each in _names(experiment).items()}
    page = io.BytesIO()
    savemat(page, arrays, do_compression=True, oned_as="column")
    files.write(folder / names["mat"], page.getvalue())
    return names


def _rows(values: Array) -> Iterator[list[Any]]:
    for run in range(values.shape[2]):
        for k, row in enumerate(values[..., run].tolist(), 1):
            yield [run, k, *(None if each != each else each for each in row)]


def _matrices(experiment: Experiment) -> dict[str, Array]:
    """P0, Q and R that filters are told; F, H and Bu of a linear model; dt at each step where it changes."""
    told, model = experiment.told, experiment.assumed_model
    Q = told.Q[..., 0] if told.Q.ndim == 4 else told.Q
    found = {"P0": told.P0, "Q": Q, "R": told.R}
    if (intervals := getattr(model, "intervals", None)) is not None:
        found["dt"] = intervals
    elif model.linear:
        F, H, Bu = model.matrices
        found |= {"F": F, "H": H, "Bu": np.zeros(len(F)) if Bu is None else Bu}
    return found


def _names(experiment: Experiment) -> dict[str, tuple[str, ...]]:
    return {"states": experiment.model.states, "measurements": experiment.model.measurements}


def _told(cell: Cell, experiment: Experiment, data: Data) -> dict[str, Any]:
    """What a filter may know, in words and numbers."""
    spec = cell.spec["model"]
    entry = MODELS.get(spec.get("kind", ""))
    meanings = {name: each.doc for name, each in parameters(entry.make).items()} if entry else {}
    values = {key: value for key, value in spec.items() if key != "kind"}
    told: dict[str, Any] = {
        "model": {
            "name": spec.get("kind", ""),
            "equations": entry.summary if entry else "",
            "parameters": {key: {"value": value, "meaning": meanings.get(key, "")} for key, value in values.items()},
            "angles": [experiment.model.measurements[i] for i in getattr(experiment.model, "angles", ())],
        },
        **_names(experiment),
        "steps": experiment.steps,
    }
    if (data.x0 == data.x0[:, :1]).all():
        told["x0"] = data.x0[:, 0].tolist()
    else:
        told["x0"] = "drawn for each run: x0 in the MAT-file"
    return told | {name: np.asarray(each).tolist() for name, each in _matrices(experiment).items()}


def _wide(A: Array, width: int) -> Array:
    return np.broadcast_to(A, (*A.shape[:-1], width))


def _apart(names: Sequence[str]) -> dict[str, str]:
    """How each name is called in the names of files; UsageError where two would be called the same."""
    slugs: dict[str, str] = {}
    for name in dict.fromkeys(names):
        called = files.slug(name)
        if twin := next((other for other, slug in slugs.items() if slug == called), None):
            raise UsageError(f"the files of '{twin}' and '{name}' would have one name: export them one at a time")
        slugs[name] = called
    return slugs
