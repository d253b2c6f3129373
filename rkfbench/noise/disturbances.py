"""Disturbances on top of the noise: shots and scripted errors that enter the process or the measurement at some
steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol

from rkfbench.catalogue import Entry, build_kind
from rkfbench.noise.base import Sample
from rkfbench.streams import Streams


class Disturbance(Protocol):
    """Something added to one channel; given its record it is Gaussian, as every noise here."""

    @property
    def channel(self) -> Literal["process", "measurement"]: ...

    def check(self, names: tuple[str, ...], steps: int) -> None:
        """SpecError where a component that it names does not exist, or an epoch lies outside 1..steps."""
        ...

    def sample(self, draw: Streams, steps: int, names: tuple[str, ...]) -> Sample:
        """What is added: (T, d, M), for the components `names` of the channel."""
        ...


DISTURBANCES: dict[str, Entry] = {
    "gross_errors": Entry("rkfbench.noise.gross_errors:GrossErrors", paper="daf"),
    "shots": Entry("rkfbench.noise.shots:Shots", paper="fpmcs-2024", equations="section 3"),
}


def build(spec: Mapping[str, Any]) -> Disturbance:
    """The disturbance that `{kind: name, **parameters}` describes; a `label`, by which overrides call it, is no
    parameter.
    """
    own = {key: value for key, value in spec.items() if key != "label"} if isinstance(spec, Mapping) else spec
    disturbance: Disturbance = build_kind(DISTURBANCES, "disturbance", own)
    return disturbance
