"""What a scenario asks for that a filter does not have: said before the study, since the tables only leave it out."""

from __future__ import annotations

from collections.abc import Iterator

from rkfbench.experiment import Experiment
from rkfbench.parts import unmeasured
from rkfbench.scenario.scenario import Scenario


def notes(scenario: Scenario) -> Iterator[str]:
    """`clipped has no nu, S: nis not measured`: of own filters, and of others of which nothing is measured."""
    told: set[str] = set()
    for cell in scenario.cells:
        labels = [each["label"] for each in cell.spec["filters"] if each["label"] not in told]
        if not labels:
            continue
        told |= {*labels}
        experiment = Experiment.of(cell.spec)
        for label in labels:
            filt, _ = experiment.filters[label]
            if sentence := unmeasured(label, filt, experiment.metrics, whole=not getattr(filt, "own", False)):
                yield sentence
