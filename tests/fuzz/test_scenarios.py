"""Whatever stands in a file or an option: a valid study or problems with their places, soon, in little memory."""

from __future__ import annotations

import re
import tempfile
import warnings
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from rkfbench.errors import ScenarioError, UsageError
from rkfbench.scenario import load, load_paper
from tests.fuzz import hostile
from tests.fuzz.limits import bounded, percent

# Problems have a place in a file or an option; what is wrong with a file as a whole has none.
PLACE = re.compile(r"[^\n]*?(\.yaml:\d+:\d+: |--(set|sweep) )", re.S)
WHOLE = re.compile(r".*\.yaml(:\d+)?: (the file is empty|not a text file|not UTF-8|contains characters|larger)", re.S)


def problems(text: str, load: Any = load, **options: list[str]) -> list[str]:
    """What the command tells of the text; [] where it is valid."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.yaml"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            with bounded(), warnings.catch_warnings():
                warnings.simplefilter("error")
                load(path, **options)
        except ScenarioError as error:
            return [problem.render() for problem in error.problems if problem.message] or ["nothing told"]
        except UsageError as error:
            return [str(error)]
        return []


def is_sound(told: list[str]) -> bool:
    return all(PLACE.match(each) or WHOLE.match(each) for each in told)


@percent(30)
@given(hostile.mutated(hostile.BASES))
def test_small_scenarios_with_other_values(text: str) -> None:
    assert is_sound(problems(text))


@percent(10)
@given(hostile.mutated(hostile.LARGE))
def test_bundled_scenarios_with_other_values(text: str) -> None:
    assert is_sound(problems(text))


@percent(25)
@given(hostile.spliced(hostile.BASES | hostile.LARGE))
def test_scenarios_with_pieces_of_text_put_in(text: str) -> None:
    assert is_sound(problems(text))


@percent(25)
@given(hostile.options(hostile.SMALL + hostile.CLAIMS))
def test_options(options: dict[str, list[str]]) -> None:
    assert is_sound(problems(hostile.SMALL + hostile.CLAIMS, **options))


@percent(10)
@given(st.one_of(hostile.mutated(hostile.PAPERS), hostile.spliced(hostile.PAPERS)))
def test_papers(text: str) -> None:
    assert is_sound(problems(text, load_paper))
