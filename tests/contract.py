"""The problems on which the contract test runs every filter of the catalogue."""

from __future__ import annotations

from typing import Any

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment, World
from rkfbench.filters import FILTERS, build
from rkfbench.streams import Streams

# Parameters that a filter cannot do without, by filter name: "*" for any problem.
POINT = {"at": 4, "lag": 4}
REQUIRED: dict[str, dict[str, Any]] = {
    "fixed_point": {"filter": "kf", **POINT},
    "decoupled": {"filter": "kf", "parts": [["px", "py", "vx", "vy"]]},
    **dict.fromkeys(("ks", "fpmcs", "ps"), POINT),
}

SPECS: dict[str, dict[str, Any]] = {
    "navigation": {
        "steps": 12,
        "model": {"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]},
        "start": {"truth": [1, 1, 1, 1]},
        "process_noise": {
            "kind": "gaussian",
            "cov": [[1, 0.2, 0, 0.1], [0.2, 0.8, 0.1, 0], [0, 0.1, 0.5, 0], [0.1, 0, 0, 0.4]],
        },
        "measurement_noise": {
            "kind": "contaminated",
            "rate": 0.2,
            "body": {"kind": "gaussian", "cov": [[1, 0.5, 0.3], [0.5, 2, 0.4], [0.3, 0.4, 1]]},
            "outliers": {"kind": "laplace", "cov": {"times": 100, "of": "body"}},
        },
        "assumed": {
            "mean": [0, 0, 0, 0],
            "cov": [[2, 0.3, 0, 0], [0.3, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0.2, 1]],
            "measurement_cov": "body",
        },
        "filters": [{"label": "kf", "use": "kf"}],
        "metrics": ["rmse"],
    },
    "range_bearing": {
        "steps": 8,
        "model": {"kind": "range_bearing"},
        "start": {"truth": [100, 100]},
        "measurement_noise": {"kind": "gaussian", "cov": [0.01, 0.006]},
        "assumed": {"mean": [80, 110], "cov": 100},
        "filters": [{"label": "ekf", "use": "ekf"}],
        "metrics": ["rmse"],
    },
    "odometers": {
        "steps": 10,
        "model": {"kind": "odometers"},
        "truth": {"kind": "drive", "acceleration": 3, "start": 4, "duration": 3},
        "start": {"truth": [0, 20]},
        "measurement_noise": {"kind": "gaussian", "cov": [25, 1]},
        "disturbances": [{"kind": "gross_errors", "component": "A", "size": 300, "every": 5}],
        "assumed": {"mean": [0, 20], "cov": [[25, 1], [1, 1]], "process_cov": [[0.25, 0.5], [0.5, 1.1]]},
        "filters": [{"label": "skf", "use": "skf"}],
        "metrics": ["rmse"],
    },
}


def _problem(spec: dict[str, Any]) -> tuple[Experiment, World]:
    experiment = Experiment.of(spec)
    return experiment, experiment.simulate(Streams(3))


PROBLEMS = {name: _problem(spec) for name, spec in SPECS.items()}


def arguments(name: str, problem: str) -> dict[str, Any]:
    """What the filter cannot do without on this problem."""
    return REQUIRED.get(name, {})


def serves(name: str, problem: str) -> bool:
    """Whether the filter can run on the problem: its own check says no where it cannot."""
    assert name in FILTERS
    check = getattr(build(name, **arguments(name, problem)), "check", None)
    try:
        if check is not None:
            check(PROBLEMS[problem][0].model)
    except SpecError:
        return False
    return True
