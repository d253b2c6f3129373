"""Metrics of one block against their definitions, run by run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from rkfbench import metrics
from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import build
from rkfbench.filters.histories import components
from rkfbench.filters.weights import Huber, LeastAbsolute, Plain
from rkfbench.metrics import METRICS, Trial
from rkfbench.metrics.influence import influence, window, xi_of
from rkfbench.metrics.objective import minimise
from rkfbench.models.odometers import Odometers
from rkfbench.models.ungm import UNGM
from rkfbench.streams import Streams
from tests.contract import SPECS
from tests.oracles import linear as oracle

SPEC = {
    **SPECS["navigation"],
    "steps": 60,
    "filters": [{"label": name, "use": name} for name in ("kf", "hkf", "aladkf", "clairvoyant_kf")],
    "metrics": ["rmse"],
}
EXPERIMENT = Experiment.of(SPEC)
WORLD = EXPERIMENT.simulate(Streams(6))
ODOMETERS, GROWTH = Odometers(), UNGM()
KEEP = {"kf": ("S",), "hkf": ("S", "inflation"), "aladkf": ("S", "lambda"), "clairvoyant_kf": ("S",)}
TOLD = {"P0": EXPERIMENT.told.P0, "Q": EXPERIMENT.told.Q, "R": EXPERIMENT.told.R}
ESTIMATES = {
    label: filt.run(EXPERIMENT.model, WORLD.y, WORLD.x0, **TOLD, keep=KEEP[label], known=WORLD.known)
    for label, (filt, _) in EXPERIMENT.filters.items()
}


def measure(name, label):
    return metrics.get(name)(Trial(EXPERIMENT, WORLD, EXPERIMENT.filters[label][0], ESTIMATES[label], ESTIMATES))


def errors(label):
    return ESTIMATES[label].mean - WORLD.x


def test_error_metrics_are_what_they_say():
    e = errors("hkf")
    np.testing.assert_allclose(measure("err_norm", "hkf"), np.linalg.norm(e, axis=1).mean(0))
    np.testing.assert_allclose(measure("err_norm[px,vx]", "hkf"), np.linalg.norm(e[:, [0, 2]], axis=1).mean(0))
    np.testing.assert_allclose(measure("rmse", "hkf"), np.sqrt((e**2).sum(1).mean(0)))
    np.testing.assert_allclose(measure("rmse[vy]@11..40", "hkf"), np.sqrt((e[10:40, 3] ** 2).mean(0)))
    np.testing.assert_allclose(measure("mse[py]@7", "hkf"), e[6, 1] ** 2)
    np.testing.assert_allclose(measure("max_error", "hkf"), np.abs(e).max((0, 1)))
    np.testing.assert_allclose(measure("err_norm@k", "hkf"), np.linalg.norm(e, axis=1))
    assert metrics.get("rmse@k").root
    np.testing.assert_allclose(measure("rmse@k", "hkf"), (e**2).sum(1))
    assert metrics.get("rmse(steps=outlier)@k").root and metrics.get("innovation_rms@k").root
    assert metrics.get("pooled_rmse").root
    np.testing.assert_allclose(measure("pooled_rmse", "hkf"), (e**2).sum(1).mean(0))


def test_condition_numbers_equal_numpys():
    for label in ESTIMATES:
        S = np.broadcast_to(ESTIMATES[label].extras["S"], (60, 3, 3, 128)).transpose(0, 3, 1, 2)
        expected = np.linalg.cond(S)
        np.testing.assert_allclose(measure("cond_S", label), expected.mean(0), rtol=1e-9)
        np.testing.assert_allclose(measure("cond_S_max", label), expected.max(0), rtol=1e-9)


def conditions(label):
    return np.linalg.cond(np.broadcast_to(ESTIMATES[label].extras["S"], (60, 3, 3, 128)).transpose(0, 3, 1, 2))


def test_shares_of_46_by_kind_of_step():
    phi = 1 / ESTIMATES["hkf"].extras["inflation"]
    holds = np.sqrt(phi.max(1) / phi.min(1)) >= np.linalg.cond(EXPERIMENT.told.R)
    flags, worse = WORLD.v.flags, conditions("hkf") > conditions("kf") * (1 + 1e-9)
    for name, which in (("all", np.ones_like(flags)), ("outlier", flags), ("clean", ~flags), ("worse", worse)):
        np.testing.assert_allclose(measure(f"share_46(steps={name})", "hkf"), share(holds, which))
    np.testing.assert_allclose(measure("share_worse_given_46", "hkf"), share(worse, holds))
    single = (phi.min(1) < 0.1) & ((phi < 1).sum(1) == 1)
    assert single.any()
    np.testing.assert_allclose(measure("share_46(steps=single)", "hkf"), share(holds, single))


def test_share_of_47_by_the_inflated_noise():
    w, V = np.linalg.eigh(EXPERIMENT.told.R)
    root = (V * np.sqrt(w)) @ V.T
    inflated = np.einsum("ij,tjm,kj->tmik", root, ESTIMATES["hkf"].extras["inflation"], root)
    holds = np.linalg.cond(inflated) >= np.linalg.cond(EXPERIMENT.told.R) * (1 - 1e-9)
    np.testing.assert_allclose(measure("share_47", "hkf"), holds.mean(0))
    assert not metrics.applies(metrics.get("share_47"), build("aladkf"))


@pytest.mark.parametrize("name", ["share_46", "share_47", "share_46(steps=worse)"])
def test_steps_with_a_missing_component_are_no_steps_of_46(name):
    y = WORLD.y.copy()
    y[[4, 9, 30], 1] = np.nan
    gaps = {each: build(each).run(EXPERIMENT.model, y, WORLD.x0, **TOLD, keep=KEEP[each]) for each in ("kf", "hkf")}
    trial = Trial(EXPERIMENT, WORLD, build("hkf"), gaps["hkf"], gaps)
    shown = metrics.get(name).quantity(trial, (0, 1, 2, 3))
    assert np.isnan(shown[[4, 9, 30]]).all()
    assert np.isfinite(metrics.get(name)(trial)).all()


def share(what, among):
    """NaN in a run where there is nothing to take a share of."""
    with np.errstate(invalid="ignore"):
        return (what & among).sum(0) / among.sum(0)


def test_what_only_rounds_is_not_worse():
    """One innovation covariance is the other but for its last bits, by turns larger and smaller."""
    hkf, S = ESTIMATES["hkf"], ESTIMATES["kf"].extras["S"]
    last_bits = 1 + 1e-13 * np.random.default_rng(3).choice([-1, 1], (len(S), 1, 1, 128))
    rounded = np.broadcast_to(S, (*S.shape[:3], 128)).copy()
    rounded[:, :1, :1] *= last_bits
    estimate = replace(hkf, extras={**hkf.extras, "S": rounded}, derived={})
    trial = Trial(EXPERIMENT, WORLD, EXPERIMENT.filters["hkf"][0], estimate, ESTIMATES)
    assert (np.linalg.cond(np.moveaxis(rounded, 3, 1)) > np.linalg.cond(np.moveaxis(S, 3, 1))).any()
    assert np.isnan(metrics.get("share_46(steps=worse)")(trial)).all()  # no step counts
    given = metrics.get("share_worse_given_46")(trial)
    assert (given[~np.isnan(given)] == 0).all()
    assert (~np.isnan(given)).any()


def test_metrics_at_the_steps_with_the_largest_factors():
    lam = ESTIMATES["aladkf"].extras["lambda"][:, 0]
    psi = ESTIMATES["hkf"].extras["inflation"].max(1) / ESTIMATES["hkf"].extras["inflation"].min(1)
    for i in (0, 50):
        top = np.argsort(-lam[:, i], kind="stable")[:25]
        np.testing.assert_allclose(measure("cond_S_top_lambda", "hkf")[i], conditions("hkf")[top, i].mean(), rtol=1e-9)
        np.testing.assert_allclose(
            measure("cond_S_top_lambda", "aladkf")[i], conditions("aladkf")[top, i].mean(), rtol=1e-9
        )
        top = np.argsort(-psi[:, i], kind="stable")[:10]
        expected = np.median(conditions("hkf")[top, i] / conditions("kf")[top, i])
        np.testing.assert_allclose(measure("cond_ratio_top_psi(count=10)", "hkf")[i], expected, rtol=1e-9)


def test_lambda_tells_outliers_as_ranks_say():
    lam, flags = ESTIMATES["aladkf"].extras["lambda"][:, 0], WORLD.v.flags
    np.testing.assert_allclose(measure("lambda_mean", "aladkf"), lam.mean(0))
    auc, top = measure("lambda_auc", "aladkf"), measure("outlier_rate(fifth=5)", "aladkf")
    for i in (3, 90):
        u = stats.mannwhitneyu(lam[flags[:, i], i], lam[~flags[:, i], i]).statistic
        assert auc[i] == pytest.approx(u / (flags[:, i].sum() * (~flags[:, i]).sum()))
        assert top[i] == pytest.approx(flags[np.argsort(lam[:, i])[48:], i].mean())


def naive_influence(weight, k, i, c=None, Q=EXPERIMENT.told.Q, R=EXPERIMENT.told.R, y=WORLD.y, literal=False, u=None):
    """Eqs (59)-(77) for one run, term by term; what a known input added to x_{k-d} since is taken off by going back."""
    F, H, _ = EXPERIMENT.model.matrices
    c = WORLD.x[k - 1, :, i] if c is None else c
    back, G, total, was = np.linalg.inv(F), np.zeros((4, 4)), np.zeros(4), c
    for d in range(k):
        B = sum(
            (np.linalg.matrix_power(back, p) @ Q @ np.linalg.matrix_power(back, p).T for p in range(1, d + 1)),
            np.zeros((4, 4)),
        )
        W = np.linalg.inv(oracle.symmetric_root(H @ B @ H.T + R))
        h = W @ H @ np.linalg.matrix_power(back, d)
        was = c if d == 0 else back @ (was - (0 if u is None else u))
        v = W @ (H @ was - y[k - 1 - d, :, i])
        counts = np.abs(v) < weight.threshold if literal else np.ones(3)
        if isinstance(weight, Huber):
            v = np.clip(v, -weight.threshold, weight.threshold)
        elif isinstance(weight, LeastAbsolute):
            v = v / np.linalg.norm(v)
        G += h.T @ np.diag(counts) @ h
        total += h.T @ v
    return np.linalg.pinv(xi_of(weight, 3) * G) @ total


@pytest.mark.parametrize("weight", [Plain(), Huber(), LeastAbsolute()], ids=["kf", "hkf", "aladkf"])
def test_influence_functions_equal_a_naive_evaluation_at_full_window_length(weight):
    F, H, _ = EXPERIMENT.model.matrices
    IF = influence(weight, F, H, EXPERIMENT.told.Q, EXPERIMENT.told.R, WORLD.x, WORLD.y, [10, 60])
    for i in (0, 99):
        for j, k in enumerate((10, 60)):
            np.testing.assert_allclose(IF[j, :, i], naive_influence(weight, k, i), rtol=1e-7, atol=1e-9)
    label = {"Plain": "kf", "Huber": "hkf", "LeastAbsolute": "aladkf"}[type(weight).__name__]
    curve = measure("if_norm@k", label)
    assert curve.shape == (6, 128)
    np.testing.assert_allclose(curve[[0, 5]], np.linalg.norm(IF, axis=1))
    np.testing.assert_allclose(measure("if_norm", label), curve.mean(0))


@pytest.mark.parametrize("label", ["kf", "hkf", "aladkf"])
def test_influence_about_the_own_estimate_and_with_literal_integrals(label):
    filt = EXPERIMENT.filters[label][0]
    own, literal = measure("if_norm(about=own,every=20)@k", label), measure("if_norm(xi=literal,every=20)@k", label)
    for i in (0, 99):
        for j, k in enumerate((20, 40, 60)):
            about = naive_influence(filt.weight, k, i, ESTIMATES[label].mean[k - 1, :, i])
            np.testing.assert_allclose(own[j, i], np.linalg.norm(about), rtol=1e-7)
            inside = naive_influence(filt.weight, k, i, literal=label == "hkf")
            np.testing.assert_allclose(literal[j, i], np.linalg.norm(inside), rtol=1e-7)
    assert (literal == measure("if_norm(every=20)@k", label)).all() == (label != "hkf")


def test_a_literal_integral_that_leaves_a_singular_matrix_takes_the_pseudo_inverse():
    """All |v| beyond a tiny threshold: the matrix is zero, and so is its pseudo-inverse."""
    F, H, _ = EXPERIMENT.model.matrices
    told = F, H, EXPERIMENT.told.Q, EXPERIMENT.told.R, WORLD.x, WORLD.y, [20]
    assert (influence(Huber(1e-12), *told, xi="literal") == 0).all()
    IF = influence(Huber(0.2), *told, xi="literal")[0]
    for i in range(0, 128, 9):
        np.testing.assert_allclose(IF[:, i], naive_influence(Huber(0.2), 20, i, literal=True), rtol=1e-5)


def test_what_a_filter_alone_is_told_counts():
    """Its own Q and R in the influence function, the objective and the premise."""
    R, Q = 9 * np.eye(3) + np.diag([0.0, 1.0, 20.0]), 0.25 * np.eye(4)
    own = {"measurement_cov": R.tolist(), "process_cov": Q.tolist()}
    names = ("kf", "hkf", "aladkf")
    changed = Experiment.of({**SPEC, "filters": [{"label": name, "use": name, "assumed": own} for name in names]})
    assert not np.allclose(changed.told.R, R)
    for label in names:
        filt, told = changed.filters[label]
        estimate = filt.run(changed.model, WORLD.y, WORLD.x0, P0=told.P0, Q=told.Q, R=told.R, keep=KEEP[label])
        trial = Trial(changed, WORLD, filt, estimate, ESTIMATES, told)
        found = metrics.get("if_norm(every=60)@k")(trial)[0, 3]
        assert found == pytest.approx(np.linalg.norm(naive_influence(filt.weight, 60, 3, Q=Q, R=R)))
        if label == "hkf":
            phi = 1 / estimate.extras["inflation"]
            holds = np.sqrt(phi.max(1) / phi.min(1)) >= np.linalg.cond(R)
            np.testing.assert_allclose(metrics.get("share_46")(trial), holds.mean(0))
        if label == "aladkf":
            F, H, _ = changed.model.matrices
            W, h, _ = window(F, H, Q, R, 50)
            best = minimise(h, W @ WORLD.y[49::-1], estimate.mean[49])
            distance = np.linalg.norm(estimate.mean[49] - best, axis=0)
            np.testing.assert_allclose(metrics.get("argmin_distance@50")(trial), distance, rtol=1e-9)


def test_a_known_input_is_no_influence():
    """Truth, measurements and estimates move with it; the influence function and the objective stay what they were."""
    driven = Experiment.of({**SPEC, "input": {"value": 2.0}})
    u = driven.model.matrices[2]
    world = driven.simulate(Streams(6))
    assert np.abs(world.y - WORLD.y).max() > 100
    for label in ("kf", "hkf", "aladkf"):
        filt, told = driven.filters[label]
        estimate = filt.run(driven.model, world.y, WORLD.x0, P0=told.P0, Q=told.Q, R=told.R, keep=KEEP[label])
        trial = Trial(driven, world, filt, estimate, ESTIMATES, told)
        found = metrics.get("if_norm@k")(trial)
        np.testing.assert_allclose(found, measure("if_norm@k", label), rtol=1e-6)
        naive = naive_influence(filt.weight, 20, 7, world.x[19, :, 7], y=world.y, u=u)
        assert found[1, 7] == pytest.approx(np.linalg.norm(naive))
        if label == "aladkf":
            for name in ("gradient_rest@50", "argmin_distance@50"):
                np.testing.assert_allclose(metrics.get(name)(trial), measure(name, label), rtol=1e-5)


def test_influence_functions_of_a_single_measurement_and_of_what_cannot_be_observed():
    one = {**SPEC, "model": {**SPEC["model"], "observed": ["px"]}}
    one |= {"measurement_noise": {"kind": "gaussian", "cov": 1.0}, "assumed": {"mean": [0, 0, 0, 0], "cov": 1.0}}
    experiment = Experiment.of({**one, "metrics": ["if_norm"]})
    world = experiment.simulate(Streams(6))
    filt, told = experiment.filters["aladkf"]
    estimate = filt.run(experiment.model, world.y, world.x0, P0=told.P0, Q=told.Q, R=told.R, keep=("lambda",))
    trial = Trial(experiment, world, filt, estimate, {}, told)
    assert np.isnan(metrics.get("if_norm")(trial)).all()  # py and vy are never seen
    F, H = np.array([[1, 0.5], [0, 1]]), np.array([[1.0, 0]])
    IF = influence(LeastAbsolute(), F, H, np.eye(2), np.eye(1), world.x[:, ::2], world.y, [1, 2, 40])
    assert np.isnan(IF[0]).all() and np.isfinite(IF[1:]).all()
    np.testing.assert_allclose(metrics.get("if_norm(every=1)")(measured("kf")), np.nanmean(curve_of("kf"), axis=0))


def measured(label):
    return Trial(EXPERIMENT, WORLD, EXPERIMENT.filters[label][0], ESTIMATES[label], ESTIMATES)


def curve_of(label):
    """At k = 1 there is no influence function; it is left out of the mean."""
    curve = measure("if_norm(every=1)@k", label)
    assert np.isnan(curve[0]).all() and np.isfinite(curve[1:]).all()
    return curve


def test_the_constants_of_the_influence_functions():
    assert xi_of(LeastAbsolute(), 1) == pytest.approx(np.sqrt(2 / np.pi))
    assert xi_of(Huber(), 3) == pytest.approx(0.8213747654, abs=1e-10)
    assert xi_of(LeastAbsolute(), 3) == pytest.approx(0.5319230405, abs=1e-10)
    rng = np.random.default_rng(0)
    for m in (2, 4):
        draws = 1 / np.linalg.norm(rng.standard_normal((400_000, m)), axis=1) * (1 - 1 / m)
        assert abs(xi_of(LeastAbsolute(), m) - draws.mean()) < 5 * draws.std() / np.sqrt(len(draws))


def test_the_window_of_the_paper():  # checks 14 and 15 of the note
    F, H = np.kron([[1, 0.5], [0, 1]], np.eye(2)), np.eye(4)[:3]
    R = oracle.symmetric_root(0.5 * np.eye(3) + 0.5)
    W, _, G = window(F, H, np.eye(4), R, 3)
    Sigma = [np.linalg.inv(w @ w) for w in W]
    np.testing.assert_allclose(Sigma[0], R, atol=1e-12)
    np.testing.assert_allclose(Sigma[1] - R, [[1.25, 0, -0.5], [0, 1.25, 0], [-0.5, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(Sigma[2] - R, [[3.25, 0, -1.5], [0, 3.25, 0], [-1.5, 0, 2]], atol=1e-12)
    assert [np.linalg.matrix_rank(g) for g in G[:2]] == [3, 4]


def test_the_influence_of_the_kf_is_a_distance_from_a_least_squares_solution_and_bounds_hold():  # 15, 16
    F, H, _ = EXPERIMENT.model.matrices
    k = 20
    W, h, G = window(F, H, EXPERIMENT.told.Q, EXPERIMENT.told.R, k)
    IF = {
        name: influence(w, F, H, EXPERIMENT.told.Q, EXPERIMENT.told.R, WORLD.x, WORLD.y, [k])[0]
        for name, w in (("kf", Plain()), ("wide", Huber(1e9)), ("hkf", Huber()), ("lad", LeastAbsolute()))
    }
    i = 4
    z = np.concatenate([W[d] @ WORLD.y[k - 1 - d, :, i] for d in range(k)])
    solution = np.linalg.lstsq(h[:k].reshape(-1, 4), z, rcond=None)[0]
    np.testing.assert_allclose(IF["kf"][:, i], WORLD.x[k - 1, :, i] - solution, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(IF["wide"], IF["kf"] / xi_of(Huber(1e9), 3), rtol=1e-12)
    for name, size, weight in (("hkf", 1.345 * np.sqrt(3), Huber()), ("lad", 1.0, LeastAbsolute())):
        reach = sum(np.linalg.norm(np.linalg.solve(xi_of(weight, 3) * G[k - 1], h[d].T), 2) for d in range(k))
        assert (np.linalg.norm(IF[name], axis=0) <= size * reach).all()


def test_the_minimiser_of_the_objective_equals_scipys():
    F, H, _ = EXPERIMENT.model.matrices
    W, h, _ = window(F, H, EXPERIMENT.told.Q, EXPERIMENT.told.R, 30)
    z = W @ WORLD.y[29::-1]
    best = minimise(h, z, np.zeros((4, 128)))
    for i in (0, 60):
        found = optimize.minimize(
            lambda x, zi=z[..., i]: np.linalg.norm(h @ x - zi, axis=1).sum(),
            best[:, i],
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 20000},
        )
        np.testing.assert_allclose(best[:, i], found.x, atol=1e-5)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rmsee", "did you mean 'rmse'"),
        ("rmse(", "is not a metric"),
        ("share_46(stepz=all)", "did you mean 'steps'"),
        ("outlier_rate(fifth=9)", "less than or equal to 5"),
        ("share_46(all)", "parameter=value"),
        ("whiteness@k", "about a run as a whole"),
        ("lambda_auc@500", "write it without @500"),
        ("outlier_rate(fifth=5)@1..9", "about a run as a whole"),
        ("cond_S_top_lambda@k", "about a run as a whole"),
        ("cond_ratio_top_psi@k", "about a run as a whole"),
        ("if_norm(about=me)", "about"),
    ],
)
def test_a_metric_that_makes_no_sense_is_said(text, says):
    with pytest.raises(SpecError, match=says.replace("(", r"\(")):
        metrics.get(text)


def test_every_metric_of_the_catalogue_has_a_description():
    assert all(entry.summary for entry in METRICS.values())


@pytest.mark.parametrize(
    ("name", "length", "model", "names"),
    [
        ("weight", 2, ODOMETERS, ODOMETERS.measurements),
        ("state_weight", 2, ODOMETERS, ODOMETERS.states),  # as many as there are odometers
        ("beta", 1, ODOMETERS, [""]),
        ("beta", 2, ODOMETERS, ODOMETERS.states),
        ("lambda", 1, GROWTH, [""]),
        ("state_weight", 1, GROWTH, GROWTH.states),
        ("theirs", 1, GROWTH, GROWTH.measurements),
        ("theirs", 3, ODOMETERS, ["0", "1", "2"]),
    ],
)
def test_the_components_of_a_history_have_names(name, length, model, names):
    assert list(components(name, length, model)) == list(names)
