"""The particle filter and its smoother: their limits, their randomness, runs whose weights vanish."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.filters.base import Setting
from rkfbench.filters.cloud import Cloud
from rkfbench.models import Navigation
from rkfbench.noise import Gaussian
from rkfbench.noise import build as build_noise
from rkfbench.streams import GROUP, Onward, Streams

MODEL = Navigation()
Q, R = 0.109 * np.eye(4), 2.008 * np.eye(2)
TOLD = {"x0": np.array([1.0, 1, 0, 0]), "P0": np.diag([4.0, 4, 3, 3]), "Q": Q, "R": R}


def mixture(first, second, share, dim, **more):
    parts = [{"kind": "gaussian", "cov": first}, {"kind": "gaussian", "cov": second}]
    return build_noise({"kind": "mixture", "weights": [1 - share, share], "components": parts, **more}, dim)


def simulate(w, v, steps, runs=GROUP, seed=1):
    streams = Streams(seed, groups=-(-runs // GROUP))
    W, V = (
        w.sample(streams.within("w"), steps).value[..., :runs],
        v.sample(streams.within("v"), steps).value[..., :runs],
    )
    start = np.random.default_rng(seed).standard_normal((4, runs))
    x = TOLD["x0"][:, None] + np.sqrt(np.diag(TOLD["P0"]))[:, None] * start
    X, y = [], []
    for k in range(steps):
        x = MODEL.f(x, k + 1) + W[k]
        X.append(x)
        y.append(MODEL.h(x, k + 1) + V[k])
    return np.array(X), np.array(y)


def variances(estimate):
    return np.einsum("tiim->ti", estimate.cov) / estimate.cov.shape[-1]


def test_on_gaussian_noise_the_particle_filter_tends_to_the_kalman_filter():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 20, runs=32)
    kf = build("kf").run(MODEL, y, **TOLD)
    gaps = {}
    for N in (500, 8000):
        pf = build("pf", particles=N).run(MODEL, y, keep=("cov",), streams=Streams(4), **TOLD)
        gaps[N] = np.sqrt(((pf.mean - kf.mean) ** 2).mean())
        assert abs(variances(pf) / variances(kf) - 1).max() < 0.3
    assert gaps[500] < 0.5
    assert 2.5 < gaps[500] / gaps[8000] < 6.5  # N^(-1/2): 4


def test_on_gaussian_noise_the_particle_smoother_tends_to_the_kalman_smoother():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 12, runs=32)
    point = {"at": 8, "lag": 4}
    ks = build("ks", **point).run(MODEL, y, **TOLD)
    ps = build("ps", particles=8000, **point).run(MODEL, y, keep=("cov", "distinct"), streams=Streams(4), **TOLD)
    assert np.sqrt(((ps.mean - ks.mean) ** 2).mean()) < 0.12
    assert abs(variances(ps) / variances(ks) - 1).max() < 0.3
    distinct = ps.extras["distinct"][:, 0].mean(-1)
    assert distinct[0] <= 8000
    assert (np.diff(distinct) <= 0).all()
    for name in ("prior_mean", "post_mean"):
        assert np.abs(ps.extras[name] - ks.extras[name]).mean() < 0.15


def test_lag_0_of_the_smoother_is_the_particle_filter():
    w, v = mixture(0.01, 1, 0.1, 4), mixture(0.01, 10, 0.2, 2)
    _, y = simulate(w, v, 10)
    setting = Setting(10, w, v, (6, 4))
    pf, ps = (build(name, particles=50).placed(setting) for name in ("pf", "ps"))
    a = pf.run(MODEL, y, keep=("prior_mean",), streams=Streams(2), **TOLD)
    b = ps.run(MODEL, y, keep=("cov",), streams=Streams(2), **TOLD)
    np.testing.assert_array_equal(b.mean[0], a.mean[5])
    np.testing.assert_array_equal(b.extras["prior_mean"][0], a.extras["prior_mean"][5])
    passed = ps.run(MODEL, y, keep=("passed",), streams=Streams(2), **TOLD).passed
    np.testing.assert_array_equal(passed.mean, a.mean)
    np.testing.assert_array_equal(passed.extras["prior_mean"], a.extras["prior_mean"])


def test_numbers_do_not_depend_on_the_runs_beside():
    w, v = Gaussian.of(Q), Gaussian.of(R)
    _, y = simulate(w, v, 6, runs=2 * GROUP)
    pf = build("pf", particles=30)
    both = pf.run(MODEL, y, streams=Streams(3, 0, 2), **TOLD)
    second = pf.run(MODEL, y[..., GROUP:], streams=Streams(3, 1, 1), **TOLD)
    np.testing.assert_array_equal(both.mean[..., GROUP:], second.mean)
    assert np.abs(both.mean[..., :GROUP] - second.mean).max() > 0


def test_runs_that_nobody_wants_are_left_out():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 8, runs=GROUP)
    for every in (build("pf", particles=30), build("ps", particles=30, at=3, lag=2)):
        whole, some = (each.run(MODEL, y, streams=Streams(3), **TOLD) for each in (every, every.first(30)))
        assert whole.mean.shape == some.mean.shape
        np.testing.assert_array_equal(whole.mean[..., :30], some.mean[..., :30])
        np.testing.assert_array_equal(whole.cov[..., :30], some.cov[..., :30])
        assert not some.failed[:30].any()
        assert some.failed[-1]
        assert np.isnan(some.mean[..., -1]).all()


def test_runs_beyond_the_streams_are_those_of_other_cases_with_the_same_draws(monkeypatch):
    drawn = []
    plain = Onward._draw
    monkeypatch.setattr(Onward, "_draw", lambda self, *a: drawn.append(np.size(out := plain(self, *a))) or out)
    streams, wanted = Streams(3, groups=2), GROUP + 30
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 5, runs=3 * streams.runs)
    y[2, 0, 7::11] = np.nan
    x0 = np.random.default_rng(1).standard_normal((4, y.shape[2]))
    smoother = build("ps", particles=20, at=3, lag=2).first(wanted)
    told, keep = {**TOLD, "x0": x0}, ("cov", "distinct", "passed")
    whole = smoother.run(MODEL, y, keep=keep, streams=streams, **told)
    together = sum(drawn)
    for case in range(3):
        runs = slice(case * streams.runs, (case + 1) * streams.runs)
        drawn.clear()
        alone = smoother.run(MODEL, y[..., runs], keep=keep, streams=streams, **{**told, "x0": x0[:, runs]})
        assert sum(drawn) == together
        assert alone.failed[-1] and not alone.failed[:wanted].any()
        for one, other in ((alone, whole), (alone.passed, whole.passed)):
            np.testing.assert_array_equal(one.mean, other.mean[..., runs])
            np.testing.assert_array_equal(one.failed, other.failed[runs])
            for name, value in one.extras.items():
                np.testing.assert_array_equal(value, other.extras[name][..., runs])
        np.testing.assert_array_equal(alone.cov, whole.cov[..., runs])


def test_runs_that_are_no_whole_cases_are_refused():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 2, runs=GROUP + 1)
    with pytest.raises(SpecError, match="129 runs are not those of several cases: there are streams for 128"):
        build("pf", particles=5).run(MODEL, y, streams=Streams(1), **TOLD)


def test_a_run_whose_weights_all_vanish_fails_alone():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 8, runs=40)
    base = build("pf", particles=30).run(MODEL, y, streams=Streams(3), **TOLD)
    y[3, :, 5] = np.inf
    hurt = build("pf", particles=30).run(MODEL, y, streams=Streams(3), **TOLD)
    others = np.arange(40) != 5
    assert hurt.failed.tolist() == (~others).tolist()
    assert np.isnan(hurt.mean[3:, :, 5]).all()
    np.testing.assert_array_equal(hurt.mean[..., others], base.mean[..., others])


def test_far_measurements_do_not_make_the_weights_underflow():
    w, v = mixture(0.01, 1, 0.1, 4), mixture(0.01, 10, 0.2, 2)
    _, y = simulate(w, v, 5, runs=8)
    y[2:] += 1e4
    estimate = build("pf", particles=30).placed(Setting(5, w, v)).run(MODEL, y, streams=Streams(3), **TOLD)
    assert not estimate.failed.any()
    assert np.isfinite(estimate.mean).all()


def test_a_missing_component_says_nothing():
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 6, runs=40)
    y[3, 1, :] = np.nan
    y[4] = np.nan
    kf = build("kf").run(MODEL, y, **TOLD)
    pf = build("pf", particles=16000).run(MODEL, y, keep=("prior_mean",), streams=Streams(3), **TOLD)
    assert np.sqrt(((pf.mean - kf.mean) ** 2).mean()) < 0.2
    np.testing.assert_array_equal(pf.mean[4], pf.extras["prior_mean"][4])


def test_systematic_resampling_keeps_every_particle_its_share():
    """Each particle is chosen floor(N W) or ceil(N W) times, in its old order."""
    N, M = 40, 6
    draw = Onward(1, width=M * N)
    cloud = Cloud(MODEL, Gaussian.of(Q), Gaussian.of(R), draw, np.zeros((4, M)), np.eye(4), N, 1.0)
    cloud.x = np.broadcast_to(np.arange(N, dtype=float), (4, M, N)).copy()
    W = np.random.default_rng(2).dirichlet(np.full(N, 0.3), M)
    cloud.weights, cloud.size = W.copy(), 1 / (W**2).sum(-1)
    cloud.resample()
    chosen = cloud.x[0]
    assert (np.diff(chosen, axis=-1) >= 0).all()
    for m in range(M):
        counts = np.bincount(chosen[m].astype(int), minlength=N)
        assert (np.abs(counts - N * W[m]) < 1).all()


def test_memory_does_not_grow_with_the_steps(monkeypatch):
    """What is drawn in one go is one step of one part of a group."""
    drawn = []
    plain = Onward._draw
    monkeypatch.setattr(Onward, "_draw", lambda self, *a: drawn.append(np.size(out := plain(self, *a))) or out)
    _, y = simulate(Gaussian.of(Q), Gaussian.of(R), 30)
    build("pf", particles=10).run(MODEL, y, streams=Streams(1), **TOLD)
    assert max(drawn) <= 4 * 10 * 32


def test_a_likelihood_without_density_is_said():
    flat = mixture(0.0, 1, 0.1, 2)
    with pytest.raises(SpecError, match="no density"):
        build("pf").placed(Setting(10, Gaussian.of(Q), flat))
    assert build("pf", likelihood="gauss").placed(Setting(10, Gaussian.of(Q), flat)).particles == 500


def test_the_mixture_likelihood_beats_the_gaussian_one_with_many_particles():
    w, v = mixture(0.01, 1, 0.1, 4), mixture(0.01, 10, 0.2, 2)
    X, y = simulate(w, v, 12, runs=64)
    errors = {}
    for likelihood in ("law", "gauss"):
        pf = build("pf", particles=3000, likelihood=likelihood).placed(Setting(12, w, v))
        mean = pf.run(MODEL, y, streams=Streams(1), **TOLD).mean
        errors[likelihood] = np.median(((mean - X)[-1, :2] ** 2).sum(0))
    assert errors["law"] < 0.5 * errors["gauss"]
