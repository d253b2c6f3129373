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
from tests.fuzz.limits import PROFILE, bounded

# Problems with a place in a file or in an option; what is wrong with a file as a whole has none.
PLACE = re.compile(r"[^\n]*?(\.yaml:\d+:\d+: |--(set|sweep) )", re.S)
WHOLE = re.compile(
    r".*\.yaml(:\d+)?: (the file is empty|not a text file|not UTF-8 text|contains characters that|larger)", re.S
)


def loaded(text: str, load: Any = load, **options: list[str]) -> Any:
    """What the text is for the command; None where it is refused as it should be."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.yaml"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            with bounded(), warnings.catch_warnings():
                warnings.simplefilter("error")
                return load(path, **options)
        except ScenarioError as error:
            assert error.problems
            for problem in error.problems:
                assert PLACE.match(problem.render()) or WHOLE.match(problem.render()), problem
                assert problem.message
        except UsageError as error:
            assert WHOLE.match(str(error)), str(error)
        return None


@PROFILE
@given(hostile.mutated(hostile.BASES))
def test_small_scenarios_with_other_values(text: str) -> None:
    loaded(text)


@PROFILE
@given(hostile.mutated(hostile.LARGE))
def test_bundled_scenarios_with_other_values(text: str) -> None:
    loaded(text)


@PROFILE
@given(hostile.spliced(hostile.BASES | hostile.LARGE))
def test_scenarios_with_pieces_of_text_put_in(text: str) -> None:
    loaded(text)


@PROFILE
@given(hostile.options(hostile.SMALL + hostile.CLAIMS))
def test_options(options: dict[str, list[str]]) -> None:
    loaded(hostile.SMALL + hostile.CLAIMS, **options)


@PROFILE
@given(st.one_of(hostile.mutated(hostile.PAPERS), hostile.spliced(hostile.PAPERS)))
def test_papers(text: str) -> None:
    loaded(text, load_paper)
