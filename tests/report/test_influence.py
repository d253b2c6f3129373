from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from rkfbench.errors import UsageError
from rkfbench.filters import build
from rkfbench.report import figures, style
from rkfbench.report.captions import caption
from rkfbench.report.influence import curve, influence_points
from rkfbench.scenario.display import Influence

NU = np.array([1.0, 5.0, 10.0, -20.0, 100.0])
FILTERS = [
    {"label": "kf", "use": "kf"},
    {"label": "my hkf", "use": "hkf", "threshold": 2},
    {"label": "ps", "use": "ps"},
]


@pytest.fixture(autouse=True)
def house_style() -> Iterator[None]:
    with style.styled():
        yield


@pytest.mark.parametrize(
    ("spec", "shifts"),
    [
        ({"use": "kf"}, [0.8, 4, 8, -16, 80]),
        ({"use": "hukf0", "passes": 200}, [0.8, 4, 5.38, -5.38, 5.38]),
        ({"use": "nrukf_r"}, [0.8, 2.591522, 3.498049, -4.239559, 5.105333]),
        ({"use": "nrukf_y"}, [0.8, 1.076, 1.076, -1.076, 1.076]),
    ],
    ids=lambda value: value["use"] if isinstance(value, dict) else "",
)
def test_the_curves_are_those_of_the_nrukf_note(spec: dict[str, Any], shifts: list[float]) -> None:
    np.testing.assert_allclose(curve(build(spec), NU, prior=4.0, noise=1.0), shifts, atol=6e-7)


def test_a_figure_has_one_curve_a_filter_with_its_parameters() -> None:
    figure = Influence(id="f", kind="influence", filters=["kf", "my hkf"], prior=4, noise=1, largest=20)
    found = list(influence_points(figure, FILTERS, "literal"))
    at_20 = {point.filter: point.y for point in found if point.x == 20}
    assert at_20 == {"kf": pytest.approx(16), "my hkf": pytest.approx(4 * 20 / (4 + 20 / 2))}  # R' = |nu|/2
    (ax,) = figures.draw(figure, found, style.looks(["kf", "my hkf"])).axes
    assert (ax.get_xlabel(), ax.get_ylabel(), len(ax.lines)) == ("innovation", "x⁺ − x⁻", 2)
    assert caption(figure, found).endswith("P⁻ = 4, R = 1. Reading literal.")


def test_a_filter_without_such_an_update_is_named() -> None:
    figure = Influence(id="f", kind="influence", filters=["ps"])
    with pytest.raises(UsageError, match="figure f: ps has no update of a scalar state alone"):
        list(influence_points(figure, FILTERS, ""))
