"""The catalogue of state-space models, and how one is built from a scenario's description."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rkfbench.catalogue import Catalogue, Entry, build_kind
from rkfbench.models.base import Linear, Model, Observed, wrap
from rkfbench.models.navigation import Navigation

__all__ = ["MODELS", "Linear", "Model", "Navigation", "Observed", "build", "wrap"]

MODELS: dict[str, Entry] = Catalogue(
    "models",
    {
        "navigation": Entry(Navigation, paper="aladkf-2020", equations="(78)-(79)"),
        "odometers": Entry("rkfbench.models.odometers:Odometers", paper="daf"),
        "falling_body": Entry("rkfbench.models.falling_body:FallingBody", paper="nrukf-2012"),
        "range_bearing": Entry("rkfbench.models.range_bearing:RangeBearing", paper="pekf-2017", equations="(42)"),
        "ungm": Entry("rkfbench.models.ungm:UNGM", paper="pekf-2017", equations="(44)"),
        "altitude": Entry("rkfbench.models.altitude:Altitude", paper="pekf-2017", equations="(45)-(49)"),
    },
)


def build(spec: Mapping[str, Any]) -> Model:
    """The model that `{kind: name, **parameters}` describes; SpecError where it makes no sense."""
    model: Model = build_kind(MODELS, "model", spec)
    return model
