"""Scenario files: YAML with positions, the schema, overrides, and the cells of a study.

scenario = load("contamination-rates", sets=["steps=100"], runs=20)
for cell in scenario.cells: print(cell.reading, cell.case, cell.spec["measurement_noise"])
"""

from __future__ import annotations

from rkfbench.interrupts import held

with held():  # the schema is built while it is imported
    from rkfbench.scenario.files import bundled
    from rkfbench.scenario.load import load, load_bundled
    from rkfbench.scenario.paper import load_paper
    from rkfbench.scenario.scenario import Cell, Scenario

__all__ = ["Cell", "Scenario", "bundled", "load", "load_bundled", "load_paper"]
