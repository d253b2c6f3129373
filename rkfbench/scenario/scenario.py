"""What a checked scenario file is for the rest of the package: numbers, names, and the cells of its study."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rkfbench.scenario.claims import Claim
from rkfbench.scenario.display import Figure, Table
from rkfbench.scenario.schema import Citation


@dataclass(frozen=True)
class Cell:
    """One experimental condition under one reading; `spec` is plain data with every default written out."""

    reading: str
    case: str  # label: "", "R2", "rate=0.2", "R2,rate=0.2"
    point: dict[str, Any]  # the sweep columns
    switch: str | None  # the switch of the sensitivity study that it belongs to
    extra: bool
    spec: dict[str, Any]


@dataclass(frozen=True)
class Scenario:
    """A scenario file that makes sense, as the options of the command line have changed it."""

    name: str
    title: str
    paper: str | None  # name of a paper file
    citation: Citation | None  # what the scenario itself says of its source
    notes: str
    names: dict[str, str]  # what readers see in the place of labels
    caveats: dict[str, str]  # reading: what must be said wherever it is shown
    seed: int
    runs: int  # in force: those of the paper, if nothing else is wanted
    paper_runs: int
    reference_runs: int
    file: str
    plugins: Path  # the folder of plug-ins that are files
    columns: tuple[str, ...]  # of the sweeps
    cells: tuple[Cell, ...]
    sensitivity: tuple[Cell, ...]
    tables: tuple[Table, ...]
    figures: tuple[Figure, ...]
    claims: tuple[Claim, ...]
    resolved: dict[str, Any]  # the file with options and defaults written out: can be stored and run again
    copies: dict[str, bytes] = field(default_factory=dict)  # the files of its plug-ins as they were read, by path

    def caveat(self, reading: str) -> str:
        """What must be said of a reading, or of a switch that starts from it; empty where there is nothing."""
        return self.caveats.get(reading.partition("+")[0], "")
