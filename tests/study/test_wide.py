"""Wide batches: several cases side by side through one filter give, to the last bit, what each gives alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rkfbench import filters
from rkfbench.experiment import Experiment
from rkfbench.filters import FILTERS
from rkfbench.linalg import Array
from rkfbench.scenario import bundled, load
from rkfbench.streams import Remembered, Streams
from rkfbench.study import wide
from rkfbench.study.compute import compute, together
from rkfbench.study.wide import Case, estimates, goes_wide, worlds
from tests.contract import SPECS, arguments, serves

# For each problem of the contract three cases that differ in what happens, not in what filters are told.
CHANGES: dict[str, list[dict[str, Any]]] = {
    "navigation": [{"measurement_noise": {**SPECS["navigation"]["measurement_noise"], "rate": r}} for r in (0, 0.2, 1)],
    "range_bearing": [{"start": {"truth": place}} for place in ([100, 100], [80, 110], [-300, 20])],
    "odometers": [
        {"disturbances": [{"kind": "gross_errors", "component": "A", "size": size, "every": 5}]} for size in (3, 1e4)
    ]
    + [{"disturbances": []}],
}


def cases(problem: str, name: str) -> list[Case]:
    """The three cases with one filter; in the last one run dies early, and one late."""
    own = {"label": "f", "use": name, **arguments(name, problem)}
    base = {**SPECS[problem], "filters": [own]}
    found = [Case(e := Experiment.of({**base, **change}), e.simulate(Streams(3))) for change in CHANGES[problem]]
    y = found[-1].world.y.copy()
    y[1, :, 5] = y[-1, :, 77] = np.inf
    return [*found[:-1], found[-1]._replace(world=replace(found[-1].world, y=y))]


def same(one: Array | None, other: Array | None) -> bool:
    if one is None or other is None:
        return one is other
    return one.shape == other.shape and one.tobytes() == other.tobytes()


def everything(filt: Any) -> Collection[str]:
    """All histories that a filter can keep."""
    return getattr(filt, "sees", frozenset({"cov"}))


def in_experiment(name: str, problem: str) -> Any:
    """The filter as an experiment makes it."""
    own = {"label": "f", "use": name, **arguments(name, problem)}
    return Experiment.of({**SPECS[problem], "filters": [own]}).filters["f"][0]


RUNNING = {name: entry for name, entry in FILTERS.items() if "file" not in entry.needs}  # the others ran elsewhere
SERVED = [(name, problem) for name in RUNNING for problem in SPECS if serves(name, problem)]
WIDE = [(name, problem) for name, problem in SERVED if goes_wide(in_experiment(name, problem))]


@pytest.mark.parametrize(("name", "problem"), WIDE)
def test_every_filter_of_the_catalogue_gives_the_same_bytes_side_by_side(name: str, problem: str) -> None:
    """And for the first runs alone, of a case or of each of several."""
    of_cases = cases(problem, name)
    keep = everything(of_cases[0].experiment.filters["f"][0])
    wholes = [estimates([case], Streams(3), "f", keep)[0] for case in of_cases]
    for runs in (8, 104, 128):
        together = estimates(of_cases, Streams(3), "f", keep, runs)
        (first,) = estimates(of_cases[:1], Streams(3), "f", keep, runs)
        for whole, found in zip([wholes[0], *wholes], [first, *together], strict=True):
            part = whole.of(slice(runs))
            assert same(part.mean, found.mean) and same(part.cov, found.cov) and same(part.failed, found.failed)
            assert part.extras.keys() == found.extras.keys()
            assert all(same(value, found.extras[key]) for key, value in part.extras.items())
    assert wholes[-1].failed[5]


PARTS = [{"weight": name} for name in filters.WEIGHTS] + [
    {"update": name} for name in filters.SCHEMES if name != "flow"
]


@pytest.mark.parametrize("parts", PARTS, ids=lambda parts: next(iter(parts.values())))
def test_so_does_every_weight_and_every_scheme(parts: dict[str, str]) -> None:
    filt = filters.build({"moments": "cubature", **parts})
    assert goes_wide(filt)
    of_cases = cases("navigation", "kf")
    for case in of_cases:
        case.experiment.filters["f"] = filt, case.experiment.told  # type: ignore[index]
    for case, found in zip(of_cases, estimates(of_cases, Streams(3), "f", ("cov",)), strict=True):
        (alone,) = estimates([case], Streams(3), "f", ("cov",))
        assert same(alone.mean, found.mean) and same(alone.cov, found.cov)


def test_what_looks_at_more_than_measurements_stays_apart_and_what_does_not_goes_wide() -> None:
    apart = {name for name, entry in RUNNING.items() if entry.needs - {"streams"}} | {"bayes"}
    assert {name for name, _ in SERVED} - {name for name, _ in WIDE} == apart
    assert not goes_wide(filters.build({"quantised": {"filter": "clairvoyant_kf"}}))


def test_a_filter_that_others_wrote_stays_apart() -> None:
    class Foreign:
        pass

    quantised = replace(filters.build("quantised"), filter=Foreign())
    assert not goes_wide(Foreign()) and not goes_wide(quantised)


def test_filters_really_go_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    widths: list[int] = []
    run = filters.GaussianFilter.run

    def watched(self: Any, model: Any, y: Array, *args: Any, **options: Any) -> Any:
        widths.append(y.shape[-1])
        return run(self, model, y, *args, **options)

    monkeypatch.setattr(filters.GaussianFilter, "run", watched)
    of_cases = cases("navigation", "hkf")
    estimates(of_cases, Streams(3), "f", ())
    assert widths == [3 * 128]
    widths.clear()
    y = of_cases[0].world.y.copy()
    y[3, 0, 0] = np.nan  # a missing component: sorted by patterns, so this case alone
    estimates([of_cases[0]._replace(world=replace(of_cases[0].world, y=y)), *of_cases[1:]], Streams(3), "f", ())
    assert sorted(widths) == [128, 256]


def test_filters_that_are_told_differently_stay_apart() -> None:
    spec = {**SPECS["navigation"], "steps": 5}
    other = {**spec, "measurement_noise": {**spec["measurement_noise"], "body": {"kind": "gaussian", "cov": 2.0}}}
    for label, (first, second) in together([spec, other], 7, 0, 10, ["kf"]):
        assert same(first.values["rmse"], compute(spec, 7, 0, 10, [label]).filters[label].values["rmse"])
        assert same(second.values["rmse"], compute(other, 7, 0, 10, [label]).filters[label].values["rmse"])


def test_worlds_side_by_side_are_the_worlds_alone() -> None:
    for problem in ("navigation", "range_bearing"):
        experiments = [Experiment.of({**SPECS[problem], **change}) for change in CHANGES[problem]]
        for case, experiment in zip(worlds(experiments, Remembered(3)), experiments, strict=True):
            alone = experiment.simulate(Streams(3))
            assert all(same(getattr(case.world, name), getattr(alone, name)) for name in ("x", "y", "x0"))
            assert same(case.world.v.value, alone.v.value)


@pytest.mark.parametrize("name", sorted(bundled()))
def test_the_worlds_of_bundled_scenarios_can_be_made_side_by_side(name: str) -> None:
    """The first and the last of the cells that may be computed together, of every such group."""
    scenario = load(name)
    groups: list[list[Any]] = []
    for cell in scenario.cells:
        home = next((group for group in groups if wide.structure(group[0].spec) == wide.structure(cell.spec)), None)
        groups.append([cell]) if home is None else home.append(cell)
    for group in groups:
        experiments = [Experiment.of(cell.spec) for cell in (group[0], group[-1])]
        for case, experiment in zip(worlds(experiments, Remembered(3)), experiments, strict=True):
            assert same(case.world.y, experiment.simulate(Streams(3)).y)


@pytest.mark.parametrize(
    ("name", "sets", "labels"),
    [
        ("contamination-rates", ["steps=100"], ["kf", "hkf", "aladkf", "clairvoyant_kf"]),
        ("ungm", [], ["ekf", "ukf", "pekf"]),
        ("falling-body", [], ["ukf", "hukf", "nrukf_r"]),
        ("odometers", [], ["skf", "raf", "daf"]),
        ("altitude-tracking", [], ["ekf", "pekf"]),
        ("navigation", ["steps=140", "point.at=40", "lost.at=40"], ["ks", "kf", "mckf[sigma=3]"]),
    ],
)
def test_bundled_scenarios_give_the_same_bytes(name: str, sets: list[str], labels: list[str]) -> None:
    """All metrics of a scenario as it is, on the first and the last of the cases that may be computed together."""
    scenario = load(name, sets=sets)
    first = scenario.cells[0]
    alike = [cell for cell in scenario.cells if wide.structure(cell.spec) == wide.structure(first.spec)]
    specs = [first.spec, alike[-1].spec]
    alone = [compute(spec, scenario.seed, 0, 20, labels).filters for spec in specs]
    for label, found in together(specs, scenario.seed, 0, 20, labels):
        for one, other in zip((each[label] for each in alone), found, strict=True):
            assert same(one.failed, other.failed) and same(one.lost, other.lost)
            assert all(same(one.values[key], other.values[key]) for key in one.values | other.values)
            assert all(same(one.curves[key], other.curves[key]) for key in one.curves | other.curves)
