"""Mixtures of Gaussians in their three meanings, and shots at random times."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.noise import build, disturbances
from rkfbench.streams import Streams

W = {
    "kind": "mixture",
    "weights": [0.9, 0.1],
    "components": [{"kind": "gaussian", "cov": 0.01}, {"kind": "gaussian", "cov": 1}],
}
V = {
    "kind": "mixture",
    "weights": [0.8, 0.2],
    "components": [{"kind": "gaussian", "cov": 0.01}, {"kind": "gaussian", "cov": 10}],
}
STREAMS = Streams(7, groups=8)


def test_variances_of_the_paper():
    np.testing.assert_allclose(build(W, 4).cov, 0.109 * np.eye(4))
    np.testing.assert_allclose(build(V, 2).cov, 2.008 * np.eye(2))
    np.testing.assert_allclose(build({**W, "labels": "weighted_sum"}, 4).cov, 0.0181 * np.eye(4))
    np.testing.assert_allclose(build({**V, "labels": "weighted_sum"}, 2).cov, 0.4064 * np.eye(2))
    by_sd = {**V, "components": [{"kind": "gaussian", "sd": 0.01}, {"kind": "gaussian", "sd": 10}]}
    np.testing.assert_allclose(build(by_sd, 2).cov, 20.00008 * np.eye(2))


@pytest.mark.parametrize(("spec", "kurtosis"), [(W, 25.273), (V, 14.881)])
def test_kurtosis_of_the_paper(spec, kurtosis):
    e = build(spec, 2).sample(STREAMS, 500).value.ravel()
    ratio = (e**4).mean() / (e**2).mean() ** 2
    se = (e**4).std() / np.sqrt(e.size) / (e**2).mean() ** 2
    assert abs(ratio - kurtosis) < 5 * se
    p = np.array(spec["weights"])
    s2 = np.array([c["cov"] for c in spec["components"]])
    assert 3 * (p @ s2**2) / (p @ s2) ** 2 == pytest.approx(kurtosis, abs=5e-4)


@pytest.mark.parametrize("labels", ["per_component", "per_vector", "weighted_sum"])
def test_moments_record_and_density(labels):
    law = build({**V, "labels": labels}, 2)
    sample = law.sample(STREAMS, 400)
    e = sample.value
    C = np.einsum("tim,tjm->ij", e, e) / e[:, 0].size
    np.testing.assert_allclose(C, law.cov, atol=6 * 10 * np.sqrt(1 / e[:, 0].size))
    conditional = np.broadcast_to(sample.cov(), (400, 2, 2, STREAMS.runs))
    np.testing.assert_allclose(conditional.mean((0, 3)), law.cov, rtol=0.05, atol=1e-12)
    standard = e / np.sqrt(np.einsum("tiim->tim", conditional))
    assert abs((standard**4).mean() - 3) < 0.05
    grid = np.linspace(-25, 25, 2501)
    pair = np.stack(np.meshgrid(grid[::10], grid[::10], indexing="ij"))
    assert np.exp(law.marginal([0]).logpdf(grid[None])).sum() * (grid[1] - grid[0]) == pytest.approx(1, abs=1e-3)
    if labels == "per_component":
        both = law.marginal([0]).logpdf(pair[:1]) + law.marginal([1]).logpdf(pair[1:])
        np.testing.assert_allclose(law.logpdf(pair), both, rtol=1e-12)


def test_densities_against_their_definition():
    e = np.array([[0.0, 0.3, -4.0, 40.0], [0.1, 7.0, 0.0, -30.0]])

    def normal(x, variance):
        return np.exp(-0.5 * x**2 / variance) / np.sqrt(2 * np.pi * variance)

    one = 0.8 * normal(e, 0.01) + 0.2 * normal(e, 10)
    np.testing.assert_allclose(build(V, 2).logpdf(e), np.log(one).sum(0), rtol=1e-10)
    joint = 0.8 * normal(e, 0.01).prod(0) + 0.2 * normal(e, 10).prod(0)
    np.testing.assert_allclose(build({**V, "labels": "per_vector"}, 2).logpdf(e), np.log(joint), rtol=1e-10)
    assert np.isfinite(build(V, 2).logpdf(np.full((2, 1), 1e6))).all()


def test_labels_by_component_are_independent_and_those_of_a_vector_are_not():
    by_component = build(V, 2).sample(STREAMS, 300).flags
    assert abs(by_component.mean() - 0.2) < 0.01
    assert abs((by_component[:, 0] & by_component[:, 1]).mean() - 0.04) < 0.005
    assert build({**V, "labels": "per_vector"}, 2).sample(STREAMS, 300).flags.shape == (300, STREAMS.runs)


def test_the_three_meanings_share_their_normals():
    samples = {
        labels: build({**V, "labels": labels}, 2).sample(STREAMS, 5).value for labels in ("per_component", "per_vector")
    }
    weighted = build({**V, "labels": "weighted_sum"}, 2).sample(STREAMS, 5).value
    for value in samples.values():
        np.testing.assert_array_equal(np.sign(value), np.sign(weighted))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": [0.5, 0.6]}, "sum to 1.1"),
        ({"weights": [0.5, 0.25, 0.25]}, "3 weights for 2"),
        (
            {"components": [{"kind": "gaussian", "cov": [[1, 0.5], [0.5, 1]]}, {"kind": "gaussian", "cov": 1}]},
            "must be diagonal",
        ),
        ({"components": [{"kind": "laplace", "cov": 1}, {"kind": "gaussian", "cov": 1}]}, "are gaussian"),
    ],
)
def test_what_makes_no_mixture_is_said(change, message):
    with pytest.raises(SpecError, match=message):
        build({**V, **change}, 2)


def shots(**more):
    return disturbances.build({"kind": "shots", "label": "v", "channel": "measurement", **more})


def test_shot_times_are_those_of_the_paper_and_differ_between_runs():
    times = shots().times(STREAMS)
    assert times.shape == (10, STREAMS.runs)
    assert times.min() == 1
    assert times.max() == 50
    counts = np.bincount(times.ravel(), minlength=51)[1:]
    assert abs(counts - times.size / 50).max() < 5 * np.sqrt(times.size / 50)
    assert (np.sort(times, axis=0)[:, 0] != np.sort(times, axis=0)[:, 1]).any()


def test_equal_times_add_up_and_the_record_knows_them():
    sample = shots(window=[0, 3]).sample(STREAMS, 5, ("px", "py"))
    times = shots(window=[0, 3]).times(STREAMS)
    for k in (1, 2, 3):
        hits = (times == k).sum(0)
        np.testing.assert_array_equal(sample.cov()[k - 1, 0, 0], 100.0 * hits)
        np.testing.assert_array_equal(sample.mean[k - 1, 1], hits)
        np.testing.assert_array_equal(sample.flags[k - 1, 0], hits > 0)
    assert not sample.value[3:].any()
    size = (sample.value - sample.mean)[:3] / np.sqrt(np.maximum(np.einsum("tiim->tim", sample.cov())[:3], 1e-12))
    size = size[np.einsum("tiim->tim", sample.cov())[:3] > 0]
    assert abs(size.mean()) < 5 / np.sqrt(size.size)
    assert abs(size.std() - 1) < 0.05


def test_a_shot_in_the_process_acts_one_step_later():
    w = shots(channel="process").sample(STREAMS, 60, ("px", "py"))
    v = shots().sample(STREAMS, 60, ("px", "py"))
    np.testing.assert_array_equal(w.value[1:], v.value[:-1])
    assert not w.value[0].any()


def test_common_times_and_single_components():
    a, b = (shots(same_times=True).times(STREAMS.within(name)) for name in ("one", "two"))
    np.testing.assert_array_equal(a, b)
    assert (shots().times(STREAMS.within("one")) != shots().times(STREAMS.within("two"))).any()
    only = shots(components=["py"]).sample(STREAMS, 60, ("px", "py"))
    assert not only.value[:, 0].any()
    assert only.value[:, 1].any()


def test_bad_shots_are_said():
    with pytest.raises(SpecError, match="window is empty"):
        shots(window=[5, 5])
    with pytest.raises(SpecError, match="no component 'pz'"):
        shots(components=["pz"]).check(("px", "py"), 100)
    with pytest.raises(SpecError, match=r"not within 1\.\.20"):
        shots().check(("px", "py"), 20)
