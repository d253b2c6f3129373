"""Noise laws: covariances, moments, densities and the record behind a draw."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from rkfbench import noise
from rkfbench.errors import SpecError
from rkfbench.streams import Streams
from tests.problems import spd

C = spd(3, 8)
A3 = (0.5 * np.eye(3) + 0.5).tolist()
BODY = {"kind": "gaussian", "cov": C.tolist()}
LAWS = {
    "gaussian": BODY,
    "gaussian by factor": {"kind": "gaussian", "factor": np.linalg.cholesky(C).tolist()},
    "laplace": {"kind": "laplace", "cov": C.tolist()},
    "laplace independent": {"kind": "laplace", "cov": C.tolist(), "components": "independent"},
    "joint": {
        "kind": "contaminated",
        "rate": 0.3,
        "body": BODY,
        "outliers": {"kind": "laplace", "cov": {"times": 9, "of": "body"}},
    },
    "component": {
        "kind": "contaminated",
        "rate": 0.3,
        "coin": "component",
        "body": BODY,
        "outliers": {"kind": "laplace", "cov": {"times": 9, "of": "body"}},
    },
}
DRAW = Streams(3, groups=40)


@pytest.mark.parametrize("name", LAWS)
def test_the_sample_covariance_and_the_mean_of_the_conditional_covariances_are_the_laws_covariance(name):
    law = noise.build(LAWS[name], 3)
    sample = law.sample(DRAW, 40)
    e = sample.value.transpose(1, 0, 2).reshape(3, -1)
    N = e.shape[1]
    products = e[:, None] * e[None]
    error = 5 * products.std(-1) / np.sqrt(N)
    assert (np.abs(products.mean(-1) - law.cov) < error).all()
    given = np.broadcast_to(sample.cov(), (40, 3, 3, DRAW.runs))
    spread = given.transpose(1, 2, 0, 3).reshape(3, 3, -1)
    assert (np.abs(spread.mean(-1) - law.cov) < 5 * spread.std(-1) / np.sqrt(N) + 1e-9).all()


@pytest.mark.parametrize("name", LAWS)
def test_given_its_record_the_noise_is_gaussian(name):
    sample = noise.build(LAWS[name], 3).sample(Streams(5, groups=4), 10)
    given = np.broadcast_to(sample.cov(), (10, 3, 3, 512)).transpose(0, 3, 1, 2)
    white = np.linalg.solve(np.linalg.cholesky(given), sample.value.transpose(0, 2, 1)[..., None]).ravel()
    assert stats.kstest(white, "norm").pvalue > 1e-4


@pytest.mark.parametrize(("components", "product"), [("mixture", 2.0), ("independent", 1.0)])
def test_laplace_components_share_their_tails_or_not(components, product):
    law = noise.build({"kind": "laplace", "cov": C.tolist(), "components": components}, 3)
    e = law.sample(Streams(2, groups=120), 60).value
    w, V = np.linalg.eigh(C)
    u = ((V / np.sqrt(w)) @ V.T @ e).transpose(1, 0, 2).reshape(3, -1) ** 2
    blocks = u.reshape(3, 60, -1)

    def within(values, expected):
        means = values.mean(-1)
        return abs(means.mean() - expected) < 5 * means.std(ddof=1) / np.sqrt(len(means))

    assert all(within(blocks[i], 1) and within(blocks[i] ** 2, 6) for i in range(3))
    assert within(blocks[0] * blocks[1], product) and within(blocks[1] * blocks[2], product)


def test_one_dimensional_laplace_has_numpys_density_and_variance_2_b_squared():
    law = noise.build({"kind": "laplace", "scale": 4.0}, 1)  # b = 2
    assert law.cov[0, 0] == pytest.approx(8)
    grid = np.linspace(-9, 9, 7)[None]
    np.testing.assert_allclose(law.logpdf(grid), stats.laplace(scale=2).logpdf(grid[0]), rtol=1e-10)
    assert stats.kstest(law.sample(Streams(1, groups=8), 20).value.ravel(), stats.laplace(scale=2).cdf).pvalue > 1e-4


@pytest.mark.parametrize("name", ["gaussian", "laplace", "laplace independent", "joint"])
def test_densities_integrate_to_one_in_two_dimensions(name):
    spec = {"kind": "gaussian", "cov": [[1.0, 0.4], [0.4, 0.7]]}
    if "laplace" in name:
        spec = {**spec, "kind": "laplace", "components": "independent" if "independent" in name else "mixture"}
    if name == "joint":
        spec = {
            "kind": "contaminated",
            "rate": 0.3,
            "body": spec,
            "outliers": {"kind": "gaussian", "cov": {"times": 4, "of": "body"}},
        }
    law = noise.build(spec, 2)
    axis = np.linspace(-14, 14, 1401) + 1e-3  # off the (integrable) peak of the Laplace mixture
    X, Y = np.meshgrid(axis, axis)
    mass = integrate.simpson(integrate.simpson(np.exp(law.logpdf(np.array([X, Y]))), x=axis), x=axis)
    assert mass == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("coin", ["joint", "component"])
def test_the_density_of_some_components_is_that_of_all_with_the_others_integrated_out(coin):
    body = {"kind": "gaussian", "cov": C[:2, :2].tolist()}
    outliers = {"kind": "laplace", "cov": {"times": 9, "of": "body"}}
    spec = {"kind": "contaminated", "rate": 0.3, "coin": coin, "body": body, "outliers": outliers}
    law = noise.build(spec, 2)
    width = 60 * np.sqrt(law.cov[1, 1])
    for e in (-4.0, 0.3, 2.0):
        density = integrate.quad(
            lambda u, e=e: np.exp(law.logpdf(np.array([[e], [u]])))[0], -width, width, points=[0.0, e], limit=400
        )[0]
        assert np.exp(law.marginal(np.array([0])).logpdf(np.array([[e]])))[0] == pytest.approx(density, rel=1e-6)


def test_component_coins_have_the_density_of_all_patterns_of_coins():
    spec = {
        "kind": "contaminated",
        "rate": 0.25,
        "coin": "component",
        "body": {"kind": "gaussian", "cov": [1.0, 2.0]},
        "outliers": {"kind": "gaussian", "cov": [9.0, 30.0]},
    }
    law = noise.build(spec, 2)
    e = np.array([[0.3, -2.0], [4.0, 1.0]])
    one = [
        0.75 * stats.norm(scale=np.sqrt(a)).pdf(x) + 0.25 * stats.norm(scale=np.sqrt(b)).pdf(x)
        for x, a, b in ((e[0], 1, 9), (e[1], 2, 30))
    ]
    np.testing.assert_allclose(law.logpdf(e), np.log(one[0] * one[1]), rtol=1e-10)


def test_outliers_of_a_smaller_rate_are_outliers_of_a_larger_one_and_share_their_values():
    samples = [noise.build({**LAWS["joint"], "rate": rate}, 3).sample(Streams(4), 50) for rate in (0.05, 0.4)]
    few, many = (s.flags for s in samples)
    assert (few <= many).all() and few.sum() < many.sum()
    np.testing.assert_array_equal(samples[0].value[:, 1][few], samples[1].value[:, 1][few])
    np.testing.assert_array_equal(samples[0].value[:, 2][~many], samples[1].value[:, 2][~many])


def test_rate_zero_is_the_body():
    law = noise.build({**LAWS["joint"], "rate": 0}, 3)
    np.testing.assert_allclose(law.cov, C)
    sample = law.sample(Streams(4), 5)
    assert not sample.flags.any()


def test_what_the_paper_may_mean_by_D1_and_D2():
    def covs(body, outliers):
        law = noise.build(
            {
                "kind": "contaminated",
                "rate": 0.1,
                "body": {"kind": "gaussian", **body},
                "outliers": {"kind": "laplace", **outliers},
            },
            3,
        )
        return law.body.cov, law.outliers.cov

    root = np.array(
        [
            [0.9428090416, 0.2357022604, 0.2357022604],
            [0.2357022604, 0.9428090416, 0.2357022604],
            [0.2357022604, 0.2357022604, 0.9428090416],
        ]
    )
    D1 = {"matrix_root_of": A3}
    times = {"times": 100, "of": "body"}
    for body, C1 in (
        ({"cov": D1}, root),
        ({"factor": D1}, np.array(A3)),
        ({"cov": {"elementwise_root_of": A3}}, np.sqrt(A3)),
    ):
        for outliers, factor in (({"cov": times}, 100), ({"scale": times}, 200), ({"factor": times}, 1e4)):
            first, second = covs(body, outliers)
            np.testing.assert_allclose(first, C1, atol=1e-9)
            np.testing.assert_allclose(second, factor * first, rtol=1e-9)


@pytest.mark.parametrize(
    ("spec", "path", "says"),
    [
        ({"kind": "gaussian", "cov": [[1, 2], [2, 1]]}, ("cov",), "indefinite"),
        ({"kind": "gaussian", "cov": [[1, 0.5], [0, 1]]}, ("cov",), "symmetric"),
        ({"kind": "gaussian", "cov": np.eye(3).tolist()}, ("cov",), "3 x 3, expected 2 x 2"),
        ({"kind": "gaussian", "cov": [[1, 0], [0]]}, ("cov",), "rows of equal length"),
        ({"kind": "gaussian", "cov": 1, "sd": 1}, (), "exactly one of"),
        ({"kind": "gaussian"}, (), "exactly one of"),
        ({"kind": "gauss", "cov": 1}, ("kind",), "did you mean 'gaussian'"),
        ({"kind": "gaussian", "cov": {"matrix_rot_of": 1}}, ("cov", "matrix_rot_of"), "did you mean 'matrix_root_of'"),
        ({"kind": "gaussian", "cov": {"times": 2, "of": "body"}}, ("cov", "of"), "names no matrix"),
        (
            {
                "kind": "contaminated",
                "rate": 1.5,
                "body": {"kind": "gaussian", "cov": 1},
                "outliers": {"kind": "gaussian", "cov": 1},
            },
            ("rate",),
            "less than or equal to 1",
        ),
        (
            {
                "kind": "contaminated",
                "rate": 0.5,
                "body": {"kind": "gaussian", "cov": -1},
                "outliers": {"kind": "gaussian", "cov": 1},
            },
            ("body", "cov"),
            "indefinite",
        ),
    ],
)
def test_a_description_that_makes_no_sense_is_said_with_its_place(spec, path, says):
    with pytest.raises(SpecError) as caught:
        noise.build(spec, 2)
    assert caught.value.path == path
    assert says in str(caught.value)


@pytest.mark.parametrize("largest", [1e308, -1e308, 1e200, float("inf"), float("nan")])
@pytest.mark.parametrize("law", ["cov", "factor", "scale"])
def test_numbers_whose_squares_are_none_are_refused(law, largest):
    with pytest.raises(SpecError, match="must have finite elements, none beyond 1e\\+150"):
        noise.build({"kind": "laplace", law: largest}, 2)
    with pytest.raises(SpecError, match="must have finite elements, none beyond 1e\\+150"):
        noise.build({"kind": "laplace", law: {"times": largest, "of": 2}}, 2)


def test_outliers_may_take_a_factor_of_a_body_without_noise_in_some_direction():
    body = {"kind": "gaussian", "cov": [1, 0]}
    outliers = {"kind": "laplace", "factor": {"times": 3, "of": "body"}}
    law = noise.build({"kind": "contaminated", "rate": 0.5, "body": body, "outliers": outliers}, 2)
    np.testing.assert_allclose(law.outliers.cov, [[9, 0], [0, 0]], atol=1e-15)
