"""The compute part: common random numbers, the prefix property, and independence of everything that must not matter."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.experiment import Experiment
from rkfbench.filters import build
from rkfbench.streams import GROUP, Streams
from rkfbench.study.blocks import block_size
from rkfbench.study.compute import compute
from tests.contract import SPECS

LABELS = ["kf", "hkf", "aladkf", "clairvoyant_kf"]
SPEC = {
    **SPECS["navigation"],
    "steps": 40,
    "filters": [{"label": label, "use": label} for label in LABELS],
    "metrics": [
        *("rmse", "cond_S", "cond_S_top_lambda", "cond_ratio_top_psi", "lambda_mean", "err_norm@k"),
        *("if_norm", "if_norm[px,py]", "if_norm(about=own)", "if_norm(xi=literal)", "gradient_rest"),
    ],
    "lost": {"states": ["px"], "limit": 8.0, "after": 20},
}


def same(a, b, runs=slice(None)):
    for label in b.filters:
        for kind in ("values", "curves"):
            one, other = getattr(a.filters[label], kind), getattr(b.filters[label], kind)
            assert one.keys() == other.keys()
            assert all(np.array_equal(one[name][..., runs], other[name]) for name in one), (label, kind)
        assert np.array_equal(a.filters[label].lost[runs], b.filters[label].lost)


def test_the_first_runs_of_a_long_study_are_the_short_study():
    assert block_size(40) > 1000
    long = compute(SPEC, 7, 0, 1000, LABELS)
    for runs in (1, 7, 100, 250):
        same(long, compute(SPEC, 7, 0, runs, LABELS), slice(runs))


def test_no_filter_changes_the_numbers_of_another():
    everything = compute(SPEC, 7, 0, 50, LABELS)
    for labels in (["hkf"], ["aladkf", "kf"]):
        same(everything, compute(SPEC, 7, 0, 50, labels))
    fewer = {**SPEC, "filters": SPEC["filters"][:3]}
    same(everything, compute(fewer, 7, 0, 50, ["kf"]))


def test_blocks_are_the_runs_that_they_say(monkeypatch):
    whole = compute(SPEC, 7, 0, 3 * GROUP, LABELS)
    monkeypatch.setattr("rkfbench.study.compute.block_size", lambda steps: GROUP)
    for block in range(3):
        part = compute(SPEC, 7, block, 3 * GROUP, LABELS)
        same(whole, part, slice(block * GROUP, (block + 1) * GROUP))


def test_widths_of_whole_groups_give_the_same_bytes():
    experiment = Experiment.of(SPEC)
    told = experiment.told
    worlds = [experiment.simulate(Streams(1, groups=groups)) for groups in (1, 2, 9)]
    for label in LABELS[:3]:
        first = [
            build(label).run(experiment.model, w.y, w.x0, told.P0, Q=told.Q, R=told.R).mean[..., :GROUP] for w in worlds
        ]
        assert np.array_equal(first[0], first[1]) and np.array_equal(first[0], first[2]), label


def test_cases_and_readings_share_their_random_numbers():
    other = {
        **SPEC,
        "measurement_noise": {**SPEC["measurement_noise"], "rate": 0.05},
        "assumed": {**SPEC["assumed"], "cov": 9.0},
    }
    a, b = (Experiment.of(spec).simulate(Streams(7)) for spec in (SPEC, other))
    np.testing.assert_array_equal(a.x, b.x)
    clean = ~a.v.flags & ~b.v.flags
    np.testing.assert_array_equal(a.y.transpose(0, 2, 1)[clean], b.y.transpose(0, 2, 1)[clean])


def test_the_clairvoyant_filter_has_the_smallest_mean_square_error():
    spec = {**SPEC, "metrics": ["mse"], "lost": None, "steps": 100}
    result = compute(spec, 5, 0, 1000, LABELS).filters
    best = result["clairvoyant_kf"].values["mse"]
    for label in LABELS[:3]:
        worse = result[label].values["mse"] - best
        assert worse.mean() > 4 * worse.std(ddof=1) / np.sqrt(1000)


def test_lost_runs_are_those_whose_error_exceeds_the_limit():
    experiment = Experiment.of(SPEC)
    world = experiment.simulate(Streams(7))
    told = experiment.told
    mean = build("kf").run(experiment.model, world.y, world.x0, told.P0, Q=told.Q, R=told.R).mean
    expected = np.abs(mean[20:, 0] - world.x[20:, 0]).max(0) > 8
    result = compute(SPEC, 7, 0, GROUP, ["kf"]).filters["kf"]
    assert 0 < expected.sum() < GROUP
    np.testing.assert_array_equal(result.lost, expected)


@pytest.mark.parametrize(
    ("eps", "expected"),
    [
        (0.05, {"kf": (2.589, 0.004), "hkf": (2.287, 0.002), "aladkf": (2.352, 0.002)}),
        (0.4, {"kf": (6.277, 0.008), "hkf": (3.787, 0.004), "aladkf": (3.517, 0.004)}),
    ],
)
def test_sanity_values_of_the_paper_note(eps, expected):
    root = {"matrix_root_of": [[1, 0.5, 0.5], [0.5, 1, 0.5], [0.5, 0.5, 1]]}
    spec = {
        **SPEC,
        "steps": 500,
        "process_noise": {"kind": "gaussian", "cov": 1.0},
        "measurement_noise": {
            "kind": "contaminated",
            "rate": eps,
            "body": {"kind": "gaussian", "cov": root},
            "outliers": {"kind": "laplace", "cov": {"times": 100, "of": "body"}},
        },
        "assumed": {"mean": [0, 0, 0, 0], "cov": 1.0, "measurement_cov": "body"},
        "metrics": ["err_norm", "cond_S"],
        "lost": None,
    }
    result = compute(spec, 2020, 0, 512, LABELS[:3]).filters
    for label, (mean, se) in expected.items():
        values = result[label].values["err_norm"]
        assert abs(values.mean() - mean) < 4 * np.hypot(values.std(ddof=1) / np.sqrt(len(values)), se)
    assert result["kf"].values["cond_S"] == pytest.approx(2.1516, abs=5e-5)
