"""Metrics of behaviour and of what filters show of themselves."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rkfbench import metrics
from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import Estimate
from rkfbench.metrics import Trial
from rkfbench.models import build, truths

T, M = 40, 3
MODEL = build({"kind": "odometers"})
RNG = np.random.default_rng(5)
ERROR = RNG.standard_normal((T, 2, M))
FACTOR = RNG.standard_normal((2, 2, M))
COV = np.broadcast_to(np.einsum("ikm,jkm->ijm", FACTOR, FACTOR) + np.eye(2)[..., None], (T, 2, 2, M))


def trial(error=ERROR, cov=COV, others=(), script=None, flags=None, **extras):
    x = RNG.standard_normal((T, 2, M))
    world = SimpleNamespace(x=x, y=np.zeros((T, 2, M)), v=SimpleNamespace(flags=flags))
    estimate = Estimate(x + error, cov, np.zeros(M, bool), extras)
    experiment = SimpleNamespace(model=MODEL, script=script)
    return Trial(experiment, world, None, estimate, dict(others))


def test_the_error_keeps_its_sign():
    np.testing.assert_allclose(metrics.get("error[S]@k")(trial()), ERROR[:, 0])


def test_fluctuation_is_the_rms_of_the_changes_of_the_error():
    expected = [np.sqrt(np.mean(np.diff(ERROR[:, 0, i]) ** 2)) for i in range(M)]
    np.testing.assert_allclose(metrics.get("fluctuation[S]")(trial()), expected)


def test_settling_counts_from_the_end_of_the_manoeuvre():
    error = np.zeros((T, 2, M))
    error[:25, 0, 0] = 6  # settled at k = 26
    error[:, 0, 1] = 6
    error[9, 0, 2] = -6
    script = truths.build({"kind": "drive", "start": 10, "duration": 10})
    np.testing.assert_array_equal(metrics.get("settling(limit=5)[S]")(trial(error, script=script)), [6, np.inf, 0])


def test_the_normalised_error_uses_the_covariance_of_the_states_named():
    P = COV[0, ..., 0]
    full = metrics.get("nees@3")(trial())
    assert full[0] == pytest.approx(ERROR[2, :, 0] @ np.linalg.inv(P) @ ERROR[2, :, 0])
    one = metrics.get("nees(over=median)[S]")(trial())
    assert one[0] == pytest.approx(np.median(ERROR[:, 0, 0] ** 2 / P[0, 0]))
    assert metrics.get("sd[S]")(trial())[0] == pytest.approx(np.sqrt(P[0, 0]))


def test_differences_from_another_filter_are_in_units_of_the_state():
    mine = trial()
    other = Estimate(mine.estimate.mean + 2.0, None, mine.estimate.failed, {})
    apart = Trial(mine.experiment, mine.world, None, mine.estimate, {"skf": other})
    np.testing.assert_allclose(metrics.get("rms_difference(to=skf)")(apart), np.sqrt(8.0))


def test_distances_are_in_own_standard_deviations():
    mine = trial()
    other = Estimate(mine.estimate.mean + 2.0, None, mine.estimate.failed, {})
    result = metrics.get("distance(to=skf)[S]")(Trial(mine.experiment, mine.world, None, mine.estimate, {"skf": other}))
    np.testing.assert_allclose(result, 2 / np.sqrt(COV[0, 0, 0]))


def test_errors_at_outliers_and_elsewhere_are_told_apart():
    flags = np.zeros((T, 2, 1), bool)
    flags[[4, 20], 0] = True
    squares = ERROR[:, 0] ** 2
    at, off = (metrics.get(f"rmse(steps={steps})[S]")(trial(flags=flags)) for steps in ("outlier", "clean"))
    np.testing.assert_allclose(at, np.sqrt(squares[[4, 20]].mean(0)))
    np.testing.assert_allclose(off, np.sqrt(np.delete(squares, [4, 20], axis=0).mean(0)))
    assert np.isnan(metrics.get("rmse(steps=outlier)[S]")(trial())).all()


def test_shares_and_means_of_what_a_filter_shows():
    alpha = np.ones((T, 2, M))
    alpha[:10, 0, 0] = 0.4
    alpha[5:20, 1, 0] = 0.8
    shown = trial(alpha=alpha)
    assert metrics.get("share_below(name=alpha)")(shown)[0] == 0.5
    assert metrics.get("share_below(name=alpha,component=A)")(shown)[0] == 0.25
    assert metrics.get("share_below(name=alpha,component=B,limit=0.5)")(shown)[0] == 0
    assert metrics.get("share_above(name=alpha,component=A,limit=0.5)")(shown)[0] == 0.75
    assert metrics.get("mean_of(name=alpha,component=A)")(shown)[0] == pytest.approx(0.85)
    flags = np.zeros((T, 2, 1), bool)
    flags[[4, 20, 30], 0] = True
    at_outliers = metrics.get("mean_of(name=alpha,component=A,steps=outlier)")(trial(flags=flags, alpha=alpha))
    assert at_outliers[0] == pytest.approx((0.4 + 1 + 1) / 3)


def test_a_component_that_does_not_exist_is_refused_with_its_place():
    from tests.contract import SPECS

    with pytest.raises(SpecError) as caught:
        Experiment.of({**SPECS["odometers"], "metrics": ["rmse", "share_below(name=alpha,component=C)"]})
    assert caught.value.path == ("metrics", 1)
