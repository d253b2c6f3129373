"""Scenario files and options as an enemy or a tired person would write them."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from typing import Any

import yaml
from hypothesis import strategies as st

from rkfbench.scenario.files import bundled, papers
from tests.conftest import CLAIMS, SMALL
from tests.scenario.conftest import SMALL as READINGS

Path = tuple[Any, ...]

NUMBERS = st.one_of(
    st.sampled_from([0, -0.0, 1, -1, 1e308, -1e308, 1e-308, 5e-324, float("inf"), -float("inf"), float("nan")]),
    st.sampled_from([2**31, 2**63 - 1, 2**63, 2**64, 10**18, 10**30, 10**400, 1_000_000, 10_000_000]),
    st.integers(-3, 40),
    st.floats(),
)
WORDS = """
    kf hkf ukf rmse rmse@k rmse[px] err_norm@k err_norm@3..1 time_ms body law model gaussian laplace contaminated kind
    use label extra assumed truth cov mean rate steps px times of joint literal << . .. , = == a=b a,b * ? [ {x}
    ../../../etc/passwd /dev/zero /dev/stdin !!python/object:os.system
"""
RANGES = "0:1:1000000000 1e308:-1e308:5 0:inf:3 nan:1:3 0:1:2.5 1:1:1 , ,,, 1:2:3:4 [1,2] ::"
TEXTS = st.one_of(
    st.sampled_from(WORDS.split()),
    st.text(max_size=12),
    st.sampled_from(["é", "‮", "\U0001f600", "a\nb", "\t", " ", "nul\0", "\ud800", "\x85", "﻿", "x" * 100_000]),
)
SMALL_VALUES = st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS)
VALUES = st.one_of(
    SMALL_VALUES,
    st.lists(SMALL_VALUES, max_size=4),
    st.lists(st.lists(NUMBERS, max_size=4), max_size=4),
    st.dictionaries(TEXTS, SMALL_VALUES, max_size=3),
    st.sampled_from(
        [
            {"from": 0, "to": 1, "step": 1e-9},
            {"from": 0, "to": 1e308, "step": 1e-308},
            {"from": 0, "to": float("inf"), "step": 1},
            {"from": 1, "to": 0, "step": 1},
            {"values": [1, 2], "extra": [2, 3]},
            {"kind": "gaussian", "cov": -1},
            {"kind": "contaminated"},
            {"matrix_root_of": [[1, 2], [2, 1]]},
            {"times": 1e300, "of": "body"},
            {"use": "hkf", "threshold": list(range(1, 200))},
            {"use": "ukf", "alpha": list(range(1, 60)), "beta": list(range(60)), "kappa": list(range(60))},
            {"fixed_point": {"filter": {"fixed_point": {"filter": "kf", "at": 1, "lag": 1}}, "at": 2, "lag": 9}},
            {"moments": "cubature", "weight": {"huber": {"threshold": -1}}, "update": {"progressive": {"dl": 0.3}}},
            list(range(5000)),
            [[0.0] * 60] * 60,
        ]
    ),
)

# Eleven lists, each of nine times the one before.
BOMB = "b0: &b0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"b{i + 1}: &b{i + 1} [{', '.join([f'*b{i}'] * 9)}]\n" for i in range(10)
)

# Pieces of YAML that are put into a text as they are.
PIECES = st.sampled_from(
    [
        "[" * 10_000,
        "{a: " * 10_000,
        "- " * 10_000,
        "? " * 1_000,
        "a: &x [*x]\n",
        "a: *nothing\n",
        "&a &b c\n",
        "<<: {steps: 3}\n",
        "<<: *nothing\n",
        "x: !!python/object/apply:os.system ['touch /tmp/pwned']\n",
        "x: !!python/name:os.system\n",
        "x: !!binary aGVsbG8=\n",
        "x: !!timestamp 2020-01-01\n",
        "x: !include /etc/passwd\n",
        "!!map {a: 1}\n",
        "%YAML 9.9\n---\n",
        "%TAG ! tag:evil,2020:\n---\n",
        "---\n",
        "...\n",
        "\t",
        "\0",
        "\ufeff",
        "\x85",
        "\u2028",
        "'",
        '"\\x',
        '"\\ud800"',
        "|\n",
        ">9\n",
        "#",
        ": ",
        "\n\n  \n - ",
        "steps: 9\nsteps: 9\n",
        "=======\n",
        BOMB,
        "sweep: {start.truth: [" + "1, " * 20_000 + "1]}\n",
        "long: " + "x" * 1_000_000 + "\n",
        "k" * 2_000 + ": 1\n",
    ]
)

BASES = {"small": SMALL + CLAIMS, "readings": READINGS}
LARGE = {name: path.read_text(encoding="utf-8") for name, path in bundled().items()}
PAPERS = {name: path.read_text(encoding="utf-8") for name, path in papers().items()}


def places(node: Any, path: Path = ()) -> Iterator[Path]:
    """The paths of everything inside plain data."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


@st.composite
def mutated(draw: st.DrawFn, bases: dict[str, str]) -> str:
    """One of the texts with some of its values replaced, removed, doubled, renamed, or moved to another place."""
    data = yaml.safe_load(bases[draw(st.sampled_from(sorted(bases)))])
    for _ in range(draw(st.integers(1, 3))):
        *outer, key = draw(st.sampled_from(list(places(data))))
        node = at(data, outer)
        match draw(st.sampled_from(["replace", "replace", "replace", "remove", "insert", "rename", "move", "wrap"])):
            case "replace":
                node[key] = copy.deepcopy(draw(VALUES))
            case "remove":
                del node[key]
            case "insert" if isinstance(node, dict):
                node[draw(TEXTS)] = copy.deepcopy(draw(VALUES))
            case "insert":
                node.insert(key, copy.deepcopy(draw(VALUES)) if draw(st.booleans()) else copy.deepcopy(node[key]))
            case "rename" if isinstance(node, dict):
                node[draw(TEXTS)] = node.pop(key)
            case "move":
                node[key] = copy.deepcopy(at(data, draw(st.sampled_from(list(places(data))))))
            case _:
                node[key] = draw(st.sampled_from([[node[key]], {"kind": node[key]}, {"values": node[key]}]))
        if not data:
            break
    return written(data)


@st.composite
def spliced(draw: st.DrawFn, bases: dict[str, str]) -> str:
    """One of the texts with a piece cut out and another one put in."""
    text = bases[draw(st.sampled_from(sorted(bases)))]
    lines = st.sampled_from([each.start() for each in re.finditer("^", text, re.M)])
    start, length = draw(st.one_of(lines, st.integers(0, len(text)))), draw(st.integers(0, 30))
    return text[:start] + draw(st.one_of(PIECES, PIECES, st.text(max_size=8))) + text[start + length :]


@st.composite
def options(draw: st.DrawFn, text: str) -> dict[str, list[str]]:
    """`--set` and `--sweep` on paths of a text, or on none."""
    paths = [".".join(map(str, path)) for path in places(yaml.safe_load(text))]
    named = ["filters.hkf.threshold", "filters.kf", "metrics.rmse", "measurement_noise.rate", "sweep.x", "readings.a.b"]
    path = st.one_of(st.sampled_from(paths + named), TEXTS)
    values = st.one_of(VALUES.map(written), TEXTS)
    ranges = st.one_of(
        st.tuples(NUMBERS, NUMBERS, NUMBERS).map(lambda three: ":".join(map(str, three))),
        st.sampled_from(RANGES.split()),
        st.lists(SMALL_VALUES.map(str), max_size=5).map(",".join),
    )
    made = {"sets": st.tuples(path, values), "sweeps": st.tuples(path, st.one_of(ranges, values))}
    return {
        key: draw(st.lists(st.one_of(pair.map("=".join), TEXTS), min_size=min_size, max_size=2))
        for (key, pair), min_size in zip(made.items(), (1, 0), strict=True)
    }


def at(data: Any, path: Any) -> Any:
    for key in path:
        data = data[key]
    return data


def written(data: Any) -> str:
    """Plain data as YAML, on one line; JSON is YAML but for its numbers without an end."""
    text = json.dumps(data, ensure_ascii=False)
    return text.replace("Infinity", ".inf").replace("NaN", ".nan")
