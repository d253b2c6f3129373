"""Whatever is done to a scenario, loading it gives a valid scenario or located problems: never anything else."""

from pathlib import Path
from tempfile import TemporaryDirectory

import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rkfbench.errors import Problem, ScenarioError, UsageError
from rkfbench.scenario import load
from tests.scenario.conftest import SMALL

ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 2**70),
    st.floats(allow_nan=True),
    st.text(max_size=8),
    st.sampled_from(["kf", "body", "law", "steps", {}, [], [[]], {"kind": "gaussian"}, {"use": "hkf"}, [1, [2, 3]]]),
)


def places(node: object, path: tuple = ()) -> list[tuple]:
    """The paths of everything in the data."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [path, *(each for key, value in items for each in places(value, (*path, key)))]


DATA = yaml.safe_load(SMALL)


def attempt(text: str, **options: object) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.yaml"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            load(path, **options)
        except ScenarioError as error:
            problems = error.problems
        except UsageError as error:
            problems = (Problem(str(path), 0, 0, "", str(error)),)
        else:
            return
    assert problems
    assert all(each.message and (each.line > 0 or each.file) for each in problems)


@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.sampled_from(places(DATA)[1:]), ODD)
def test_any_value_may_be_replaced_by_anything(path: tuple, value: object) -> None:
    data = yaml.safe_load(SMALL)
    node = data
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    attempt(yaml.safe_dump(data))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, len(SMALL)), st.integers(0, 12), st.text(max_size=6))
def test_any_piece_of_text_may_be_replaced_by_anything(start: int, length: int, text: str) -> None:
    attempt(SMALL[:start] + text + SMALL[start + length :])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.sampled_from(places(DATA)[1:]), ODD.map(lambda value: yaml.safe_dump(value, default_flow_style=True)))
def test_any_path_may_be_set_to_anything(path: tuple, value: str) -> None:
    attempt(SMALL, sets=[f"{'.'.join(map(str, path))}={value}"])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.text(max_size=30), st.text(max_size=30))
def test_options_may_be_any_text(a: str, b: str) -> None:
    attempt(SMALL, sets=[a, f"steps={b}"], sweeps=[b, f"steps={a}"])
