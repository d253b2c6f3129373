"""Own filters: the three interfaces give the Kalman filter of the catalogue, and every fault is one sentence."""

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.own.faults import PluginFault, told
from rkfbench.own.onerun import innovation
from rkfbench.streams import Streams
from tests.problems import Bent, linear_problem, spd

FORMS = ("stepwise", "whole", "batch")


@pytest.fixture
def problem():
    return linear_problem()


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_kalman_filter(folder, problem, form):
    problem.y[4] = np.nan
    mine, kf = (build(name).run(problem.model, problem.y, **problem.told) for name in (f"plugins:{form}", "kf"))
    np.testing.assert_allclose(mine.mean, kf.mean, atol=1e-10)
    np.testing.assert_allclose(mine.cov, np.broadcast_to(kf.cov, mine.cov.shape), atol=1e-10)
    assert not mine.failed.any()


def test_one_recorded_run_is_enough(folder, problem):
    whole = build("plugins:stepwise").run(problem.model, problem.y, **problem.told)
    one = build("plugins:stepwise").run(problem.model, problem.y[..., 2], **problem.told)
    np.testing.assert_array_equal(one.mean[..., 0], whole.mean[..., 2])


def test_the_prior_is_kept_where_it_is_asked_for(folder, problem):
    keep = ("cov", "prior_mean", "prior_cov")
    mine, kf = (
        build(name).run(problem.model, problem.y, **problem.told, keep=keep) for name in ("plugins:stepwise", "kf")
    )
    np.testing.assert_allclose(mine.extras["prior_mean"], kf.extras["prior_mean"], atol=1e-10)
    np.testing.assert_allclose(mine.extras["prior_cov"][..., 1], kf.extras["prior_cov"][..., 0], atol=1e-10)


def test_innovations_are_formed_from_what_is_predicted(folder, problem):
    problem.y[4] = np.nan
    problem.y[6, 1, 2:] = np.nan
    keep = ("cov", "nu", "S")
    mine, kf = (
        build(name).run(problem.model, problem.y, **problem.told, keep=keep) for name in ("plugins:stepwise", "kf")
    )
    for name in ("nu", "S"):
        expected = np.broadcast_to(kf.extras[name], mine.extras[name].shape)
        np.testing.assert_allclose(mine.extras[name], expected, atol=1e-10)


def test_a_filter_that_has_nu_and_S_of_their_shapes_is_believed(folder, problem):
    def nu(name):
        return build(name).run(problem.model, problem.y, **problem.told, keep=("nu", "S")).extras["nu"]

    np.testing.assert_allclose(2 * nu("plugins:halved"), nu("plugins:stepwise"), atol=1e-10)
    np.testing.assert_array_equal(nu("plugins:scalar"), nu("plugins:paced"))


def test_S_of_a_model_without_H_is_that_of_its_slope():
    model = Bent()

    class Without:
        measurements, h, residual = model.measurements, model.h, model.residual

    x, P = np.array([0.3, -0.4, 0.8]), spd(3, 1)
    one, other = (innovation(each, x, P, np.array([3.0]), 1, np.eye(1)) for each in (model, Without()))
    np.testing.assert_allclose(other["S"], one["S"], rtol=1e-8)
    np.testing.assert_array_equal(other["nu"], one["nu"])


def test_a_filter_is_given_the_Q_and_R_of_the_step(folder, problem):
    scale = 1 + np.arange(12)[:, None, None, None] % 3
    told = {**problem.told, "Q": problem.Q[None, ..., None] * scale, "R": problem.R[None, ..., None] * scale[::-1]}
    mine, kf = (build(name).run(problem.model, problem.y, **told) for name in ("plugins:paced", "kf"))
    np.testing.assert_allclose(mine.mean, kf.mean, atol=1e-9)
    for name, message in (("stepwise", r"predict\(self, k, Q\)"), ("whole", "a function of a whole run")):
        with pytest.raises(SpecError, match=f"Q changes with time here, .*{message}"):
            build(f"plugins:{name}").run(problem.model, problem.y, **told)


def test_how_the_first_run_died_is_kept(folder, problem):
    def death(name, y):
        return build(name).run(problem.model, y, **problem.told, streams=Streams(0, first=1)).death

    whole = problem.y.copy()
    problem.y[5, 1, 3] = np.nan
    assert death("plugins:bare_dies", whole).startswith(
        "run 128, step 4: LinAlgError: Singular matrix (plugins.py, line"
    )
    assert death("plugins:naive", problem.y).startswith("run 131, step 6: x is not finite (y has missing components")
    assert death("plugins:stepwise", problem.y) == ""


def test_parameters_come_from_the_signature(folder):
    from rkfbench.catalogue import lookup, parameters
    from rkfbench.filters import FILTERS

    entry = lookup(FILTERS, "filter", "plugins:stepwise")
    (inflate,) = parameters(entry.make).values()
    assert (inflate.name, inflate.default, inflate.doc) == ("inflate", 1.0, "factor of R")
    assert entry.summary == "A Kalman filter of one run."


@pytest.mark.parametrize(
    ("spec", "path", "message"),
    [
        ({"use": "plugins:stepwise", "inflate": -1}, ("inflate",), "greater than 0"),
        ({"use": "plugins:stepwise", "inflat": 1}, ("inflat",), "did you mean 'inflate'"),
        ({"use": "plugins:only_means", "level": "1"}, ("level",), "valid number"),
        ({"use": "plugins:only_means", "word": 1}, ("word",), "valid string"),
        ({"use": "plugins:only_means", "flag": 1}, ("flag",), "valid boolean"),
        ({"use": "plugins:no_update"}, ("use",), "no method update"),
        ({"use": "plugins:few"}, ("use",), "lacks the parameters x0, P0, Q, R"),
        ({"use": "plugins:no_run"}, (), "makes a dict, which has no `run`"),
        ({"use": "plugins:wrong_run"}, (), "cannot be called as run"),
        ({"use": "plugins:np"}, ("use",), "not callable"),
    ],
)
def test_what_makes_no_filter_is_told_where_it_stands(folder, spec, path, message):
    with pytest.raises(SpecError, match=message) as error:
        build(spec)
    assert error.value.path == path


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("plugins:in_place", r"plugins:in_place in run 0 changes its argument y in place"),
        (
            "plugins:raises",
            r"plugins:raises raised ValueError in run 3, step 5: no such thing \(plugins.py, line \d+\)",
        ),
        ("plugins:grows", r"plugins:grows has x of shape \(5,\) in run 0, step 1, expected \(4,\)"),
        ("plugins:three", r"plugins:three in run 0 returned 3 values, expected means \(12, 4\), or means and cov"),
        ("plugins:forgets", r"plugins:forgets in run 0 returned None, expected means \(12, 4\)"),
        ("plugins:leaves", r"plugins:leaves raised SystemExit in run 0, step 1: 3 \(plugins.py, line \d+\)"),
        ("plugins:complex_means", "has complex means: give its real part"),
        ("plugins:transposed", r"plugins:transposed in run 0 returned means of shape \(4, 12\), expected \(12, 4\)"),
        ({"use": "plugins:Batch"}, "plugins:Batch changes its argument x0"),
        ({"use": "plugins:Batch", "fault": "array"}, "returned a ndarray, not an rkfbench.filters.Estimate"),
        ({"use": "plugins:Batch", "fault": "wide"}, r"means of shape \(12, 4, 6\), expected \(12, 4, 5\)"),
        ({"use": "plugins:Batch", "fault": "failed"}, r"`failed` of shape \(6,\), expected \(5,\)"),
        ({"use": "plugins:Batch", "fault": "covariance"}, r"covariances of shape \(4, 4\), expected"),
    ],
)
def test_faults_name_plugin_run_and_step(folder, problem, spec, message):
    problem.y[:] = np.abs(problem.y) % 50
    problem.y[4, 0, 3] = 101
    with pytest.raises(PluginFault, match=message):
        build(spec).run(problem.model, problem.y, **problem.told, streams=Streams(0))


def test_the_number_of_a_run_is_that_of_the_study(folder, problem):
    problem.y[4, 0, 3] = 101
    with pytest.raises(PluginFault, match="in run 387, step 5"):
        build("plugins:raises").run(problem.model, problem.y, **problem.told, streams=Streams(0, first=3))


def test_what_is_numerically_dead_is_a_failed_run_and_no_fault(folder, problem):
    problem.y[0, 0] = [1, -1, 1, -1, -1]
    estimate = build("plugins:dies").run(problem.model, problem.y, **problem.told)
    assert estimate.failed.tolist() == [True, False, True, False, False]
    assert np.isnan(estimate.mean[..., 0]).all() and (estimate.mean[..., 1] == 0).all()


def test_a_run_with_infinite_estimates_is_buried(folder, problem):
    problem.y[3, :, 2] = np.inf
    estimate = build("plugins:stepwise").run(problem.model, problem.y, **problem.told)
    assert np.flatnonzero(estimate.failed).tolist() == [2]
    assert np.isfinite(estimate.mean[:3, :, 2]).all() and np.isnan(estimate.mean[3:, :, 2]).all()


def test_random_numbers_belong_to_the_run(folder, problem):
    def means(first, runs):
        y = np.zeros((12, 3, runs))
        return build("plugins:noisy").run(problem.model, y, **problem.told, streams=Streams(4, first)).mean

    np.testing.assert_array_equal(means(0, 5), means(0, 130)[..., :5])
    np.testing.assert_array_equal(means(1, 2), means(0, 130)[..., 128:])
    assert len(np.unique(means(0, 130))) == 12 * 4 * 130


def test_runs_that_nobody_wants_are_not_computed(folder, problem):
    whole = build("plugins:stepwise")
    cut = whole.first(2).run(problem.model, problem.y, **problem.told)
    np.testing.assert_array_equal(cut.mean[..., :2], whole.run(problem.model, problem.y, **problem.told).mean[..., :2])
    assert cut.failed.tolist() == [False, False, True, True, True]


def test_a_recursive_filter_of_all_runs_smooths(folder, problem):
    spec = {"fixed_point": {"filter": {"use": "plugins:batch"}, "at": 3, "lag": 2}}
    kf = {"fixed_point": {"filter": "ekf", "at": 3, "lag": 2}}
    mine, ours = (build(each).run(problem.model, problem.y, **problem.told) for each in (spec, kf))
    np.testing.assert_array_equal(mine.mean, ours.mean)


def test_an_exception_in_any_plugin_is_told_with_its_name(folder):
    from rkfbench.own import names

    model = names.find("plugins:Walk")()
    with pytest.raises(IndexError) as error:
        model.h(np.zeros(()), 1)
    assert told(error.value).startswith("plugins:Walk raised IndexError: ")
    assert told(ValueError("ours")) == "ValueError: ours"
