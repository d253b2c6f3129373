"""What the papers' notes demand to be said is said in the bundled scenarios."""

import pytest

from rkfbench.scenario import load_bundled


@pytest.mark.parametrize("name", ["falling-body", "odometers"])
def test_a_reconstruction_is_labelled_as_one_under_every_reading(name: str) -> None:
    scenario = load_bundled(name)
    readings = {cell.reading for cell in scenario.cells}
    assert "labelled reconstruction" in scenario.title
    assert all(scenario.caveat(reading).startswith("Labelled reconstruction") for reading in readings)


def test_the_conjecture_is_named_as_such() -> None:
    tracking, switches = load_bundled("altitude-tracking"), load_bundled("altitude-switches")
    assert "conjecture about code that nobody has seen" in tracking.caveat("conjecture")
    assert tracking.caveat("literal") == ""
    assert switches.paper == tracking.paper
    assert all("conjecture about code that nobody has seen" in table.caption for table in switches.tables)


def test_figures_of_the_odometers_share_their_axes_and_name_their_filters() -> None:
    figures = {figure.id: figure for figure in load_bundled("odometers").figures}
    assert figures["errors-keep"].share == "all"
    assert "truth" not in figures["gross-errors"].filters
    assert figures["gross-errors"].cases == ["gross 30", "gross 100", "case2", "gross 1000", "gross 3000"]
