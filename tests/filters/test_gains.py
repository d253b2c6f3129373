"""Gains first: the same numbers as the loop over all runs, and nothing computed twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rkfbench import filters
from rkfbench.filters import gains, recursion
from tests.problems import FullLinear, linear_problem


def both(p, y=None, keep=("cov", "prior_mean", "prior_cov", "nu", "S"), **changes):
    """By gains first, and by the loop."""
    told, y = {**p.told, **changes}, p.y if y is None else y
    kf = filters.build("kf")
    loop = recursion.run(kf, p.model, y, told["x0"], told["P0"], told["Q"], told["R"], keep)
    return kf.run(p.model, y, keep=keep, **told), loop


def same(one, other):
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(one.cov, other.cov, rtol=1e-12, atol=1e-12)
    assert np.array_equal(one.failed, other.failed)
    for name, values in other.extras.items():
        np.testing.assert_allclose(np.broadcast_to(one.extras[name], values.shape), values, rtol=1e-11, atol=1e-11)


def test_the_same_as_the_loop():
    same(*both(linear_problem(steps=40)))


def test_the_same_where_all_runs_miss_the_same_components():
    p = linear_problem(steps=20)
    y = p.y.copy()
    y[3] = y[6, 0] = y[7, 1:] = np.nan
    one, other = both(p, y)
    same(one, other)
    assert one.cov.shape[-1] == 1
    assert np.isnan(one.extras["nu"][3]).all() and np.isnan(one.extras["S"][6, 0, 1]).all()


def test_the_same_with_covariances_that_change_with_time():
    p = linear_problem(steps=12)
    scale = np.linspace(1, 3, 12)[:, None, None, None]
    same(*both(p, Q=scale * p.Q[..., None], R=scale[::-1] * p.R[..., None]))


def test_a_settled_filter_computes_no_gain_again(monkeypatch):
    p, computed, step = linear_problem(steps=1000), [], gains._step
    monkeypatch.setattr(gains, "_step", lambda *args: computed.append(1) or step(*args))
    filters.build("kf").run(p.model, p.y, **p.told)
    assert 10 < len(computed) < 300


def test_a_prior_that_is_not_positive_definite_fails_all_runs():
    p = linear_problem(steps=5)
    estimate = filters.build("kf").run(p.model, p.y, **{**p.told, "P0": 0 * p.P0, "Q": 0 * p.Q})
    assert estimate.failed.all() and np.isnan(estimate.mean).all()


def test_step_after_step_the_same_as_at_once():
    p = linear_problem(steps=15)
    y = p.y.copy()
    y[4, 1] = np.nan
    y[6, 0, 2] = np.inf
    kf, keep = filters.build("kf"), ("cov", "prior_mean", "prior_cov", "nu", "S")
    steps = recursion.collect(kf.steps(p.model, y, **p.told), keep, len(y))
    whole = kf.run(p.model, y, keep=keep, **p.told)
    same(whole, steps)
    assert np.array_equal(whole.mean, steps.mean, equal_nan=True)


@pytest.mark.parametrize("own", ["f", "h", "residual", "angles"])
def test_a_model_with_a_mind_of_its_own_is_asked_at_every_step(own):
    """A subclass of a linear model may move, see or compare in its own way: then its matrices do not tell all."""
    changed = {
        "f": lambda self, x, k: FullLinear.f(self, x, k) + k,
        "h": lambda self, x, k: FullLinear.h(self, x, k) - k,
        "residual": lambda self, y, z: 2 * (y - z),
        "angles": (0,),
    }
    p = linear_problem(steps=6)
    one, other = both(replace(p, model=type("Own", (FullLinear,), {own: changed[own]})()))
    same(one, other)
    assert np.abs(one.mean - both(p)[0].mean).max() > 1e-3


def test_a_run_with_an_infinite_measurement_fails_alone():
    p = linear_problem(steps=6)
    y = p.y.copy()
    y[2, 0, 1] = np.inf
    one, other = both(p, y)
    same(one, other)
    assert list(np.flatnonzero(one.failed)) == [1] and np.isnan(one.mean[2:, :, 1]).all()


@pytest.mark.parametrize("first", ["wide", "narrow"])
def test_a_history_is_as_wide_as_its_widest_step(first):
    history = recursion.History((), 3)
    steps = [np.ones((2, 1)), np.ones((2, 4)), np.ones((2, 1))]
    for each in steps if first == "narrow" else steps[1:] + steps[:1]:
        history.add(mean=each)
    np.testing.assert_array_equal(history.estimate(np.zeros(4, bool)).mean, np.ones((3, 2, 4)))


def test_what_a_step_does_not_show_is_nan():
    history = recursion.History(("nu",), 3)
    for seen in ({}, {"nu": np.ones((1, 2))}, {}):
        history.add(mean=np.zeros((1, 2)), **seen)
    np.testing.assert_array_equal(history.estimate(np.zeros(2, bool)).extras["nu"][:, 0, 0], [np.nan, 1, np.nan])
