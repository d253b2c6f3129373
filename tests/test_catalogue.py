from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Gt, Interval

from rkfbench.catalogue import Entry, build, build_kind, parameter_model, parameters
from rkfbench.cli.look import CATALOGUES
from rkfbench.errors import Problem, ScenarioError, SpecError


@dataclass(frozen=True)
class Ball:
    """A round thing
    that rolls.

    More of it.
    """

    radius: Annotated[float, Gt(0), "radius in m"] = 1.0
    colour: Literal["red", "blue"] = "red"
    spots: tuple[str, ...] = ()
    pair: tuple[float, float] | None = None
    matrix: Any = None


def stick(*, length: Annotated[int, Interval(ge=1, le=9)], straight: bool = True) -> tuple[int, bool]:
    """A long thing."""
    if length == 7:
        raise ValueError("seven is no length")
    return length, straight


ROOT = Path(__file__).parents[1]
THINGS = {"ball": Entry(Ball, paper="things-1990", equations="(1)"), "stick": Entry(stick)}


def faults(name: str, **params: Any) -> dict[str, str]:
    with pytest.raises(SpecError) as error:
        build(THINGS, "thing", name, params)
    return {".".join(map(str, each.path)): each.message for each in error.value}


def test_an_entry_may_name_what_it_stands_for_which_is_imported_when_it_is_used() -> None:
    named = {"ball": Entry(f"{__name__}:Ball"), "nothing": Entry("no.such.module:thing")}
    assert list(named) == ["ball", "nothing"]
    assert build(named, "thing", "ball", {"radius": 2}) == Ball(2)
    assert named["ball"].summary == THINGS["ball"].summary


@pytest.mark.parametrize("kind", CATALOGUES)
def test_every_entry_names_something_that_is_there(kind: str) -> None:
    module, name = CATALOGUES[kind]
    catalogue = getattr(import_module(module), name)
    assert [name for name, entry in catalogue.items() if not entry.summary or not callable(entry.make)] == []


def test_names_are_listed_without_importing_what_they_stand_for() -> None:
    code = (
        "import sys; from rkfbench.filters import FILTERS; from rkfbench.metrics import METRICS\n"
        "assert 'pf' in FILTERS and 'nees' in METRICS\n"
        "print([name for name in ('filters.particle', 'filters.nrukf', 'metrics.behaviour', 'models.ungm')"
        " if f'rkfbench.{name}' in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"


def test_the_summary_is_the_first_paragraph() -> None:
    assert THINGS["ball"].summary == "A round thing that rolls."


def test_parameters_are_those_of_the_signature() -> None:
    radius = parameters(Ball)["radius"]
    assert (radius.name, radius.default, radius.required, radius.doc) == ("radius", 1.0, False, "radius in m")
    assert list(parameters(Ball)) == ["radius", "colour", "spots", "pair", "matrix"]
    assert parameters(stick)["length"].required


def test_an_entry_is_built_from_plain_data() -> None:
    assert build(THINGS, "thing", "ball", {"radius": 2, "spots": ["a"], "pair": [1, 2]}) == Ball(
        2.0, "red", ("a",), (1, 2)
    )
    assert build(THINGS, "thing", "stick", {"length": 3}) == (3, True)
    assert build_kind(THINGS, "thing", {"kind": "stick", "length": 3}) == (3, True)


@pytest.mark.parametrize("value", ["1", True, None, [1], float("nan"), 0, -1])
def test_a_number_is_never_read_from_anything_else_or_out_of_range(value) -> None:
    assert list(faults("ball", radius=value)) == ["radius"]


@pytest.mark.parametrize("value", [1, "true", None])
def test_a_boolean_is_never_read_from_anything_else(value) -> None:
    assert faults("stick", length=1, straight=value) == {"straight": "should be a valid boolean"}


@pytest.mark.parametrize("value", [1.0, True, "1"])
def test_a_whole_number_is_never_read_from_anything_else(value) -> None:
    assert faults("stick", length=value) == {"length": "should be a valid integer"}


def test_all_faults_are_told_at_once_with_their_paths() -> None:
    assert faults("ball", radios=1, colour="green", spots=["a", 1], pair=[1]) == {
        "radios": "unknown key (did you mean 'radius'?)",
        "colour": "should be 'red' or 'blue'",
        "spots.1": "should be a valid string",
        "pair.1": "is required",
    }


def test_a_mistyped_required_key_is_told_once() -> None:
    assert faults("stick", lenght=1) == {"lenght": "unknown key (did you mean 'length'?)"}
    assert faults("stick") == {"length": "is required"}


def test_what_make_itself_refuses_is_told_too() -> None:
    assert faults("stick", length=7) == {"": "seven is no length"}


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"kind": "bal"}, r"unknown thing 'bal' \(did you mean 'ball'\?\)"),
        ({"kind": "zzz"}, r"known: ball, stick"),
        ({"kind": 3}, "should be the name of a thing"),
        ({"kind": ["ball"]}, "should be the name of a thing"),
        ("ball", "a thing is written as a mapping with 'kind'"),
        ({}, "a thing is written as a mapping with 'kind'"),
    ],
)
def test_unknown_kinds_get_a_suggestion(spec, message) -> None:
    with pytest.raises(SpecError, match=message):
        build_kind(THINGS, "thing", spec)


def test_every_field_of_the_parameter_model_has_its_description() -> None:
    assert parameter_model(Ball).model_json_schema()["properties"]["radius"]["description"] == "radius in m"


def test_errors_get_longer_paths_and_survive_pickling() -> None:
    error = SpecError("wrong", ("b",), [SpecError("too", ("c", 1))]).under("a")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == "a.b: wrong\na.c.1: too"
    assert [each.path for each in again] == [("a", "b"), ("a", "c", 1)]
    scenario = ScenarioError([Problem("f", 2, 3, "a.b", "wrong", "  x: 1")])
    assert str(pickle.loads(pickle.dumps(scenario))) == "f:2:3: a.b: wrong\n    x: 1\n    ^"


def test_a_very_long_source_line_is_shown_around_the_fault() -> None:
    shown = Problem("f", 1, 5001, "", "wrong", "x" * 5000 + "Y" + "x" * 5000).render().splitlines()
    assert len(shown[1]) < 200
    assert shown[1][shown[2].index("^")] == "Y"
