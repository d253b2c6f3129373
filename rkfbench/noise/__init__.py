"""The catalogue of noise laws, and how one is built from a scenario's description.

A law keeps apart what papers often mix up: a covariance (`cov`), a factor that multiplies unit noise (`factor`, C = L
L'), standard deviations (`sd`) and, for Laplace noise, squared scales (`scale`, C = 2 M).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt, Interval, MinLen

from rkfbench.catalogue import Catalogue, Entry, build_kind
from rkfbench.errors import SpecError, under
from rkfbench.linalg import Array
from rkfbench.noise.base import Law, Sample
from rkfbench.noise.contaminated import Contaminated
from rkfbench.noise.gaussian import Gaussian
from rkfbench.noise.laplace import LaplaceIndependent, LaplaceMixture
from rkfbench.noise.matrices import covariance, matrix
from rkfbench.noise.matrices import factor as factor_of
from rkfbench.noise.mixture import GaussianMixture, Labels

__all__ = [
    "LAWS",
    "Contaminated",
    "Gaussian",
    "GaussianMixture",
    "LaplaceIndependent",
    "LaplaceMixture",
    "Law",
    "Sample",
    "build",
    "covariance",
    "matrix",
]

MatrixSpec = Any  # see rkfbench.noise.matrices
Make = Callable[[int, Law | None], Law]  # the law for a dimension, given the law that `body` means where there is one


def gaussian(
    cov: Annotated[MatrixSpec, "covariance C"] = None,
    factor: Annotated[MatrixSpec, "a factor L that multiplies unit normals, C = L L'"] = None,
    sd: Annotated[MatrixSpec, "standard deviations (a number or a list)"] = None,
) -> Make:
    """Gaussian noise N(0, C); exactly one of cov, factor and sd says what C is."""
    given = _one_of(cov=cov, factor=factor, sd=sd)

    def make(dim: int, body: Law | None) -> Law:
        if given in ("factor", "sd"):
            return Gaussian(_matrix(given, factor if given == "factor" else sd, dim, _factors(body)))
        return Gaussian.of(_covariance("cov", cov, dim, _covariances(body)))

    return make


def laplace(
    cov: Annotated[MatrixSpec, "covariance C"] = None,
    scale: Annotated[MatrixSpec, "squared Laplace scales b^2, C = 2 M"] = None,
    factor: Annotated[MatrixSpec, "a factor L that multiplies unit-variance Laplace noise, C = L L'"] = None,
    components: Annotated[
        Literal["mixture", "independent"], "one common scale a vector, or independent Laplace components"
    ] = "mixture",
) -> Make:
    """Laplace noise with covariance C; exactly one of cov, scale and factor says what C is."""
    given = _one_of(cov=cov, scale=scale, factor=factor)
    kind = LaplaceMixture if components == "mixture" else LaplaceIndependent

    def make(dim: int, body: Law | None) -> Law:
        if given == "factor":
            L = _matrix("factor", factor, dim, _factors(body))
            return kind(L @ L.T)
        if given == "scale":
            return kind(2 * _covariance("scale", scale, dim, _covariances(body)))
        return kind(_covariance("cov", cov, dim, _covariances(body)))

    return make


def contaminated(
    rate: Annotated[float, Interval(ge=0, le=1), "probability of an outlier"],
    body: Annotated[dict[str, Any], "law of the body"],
    outliers: Annotated[dict[str, Any], "law of the outliers; its matrices may refer to `body`"],
    coin: Annotated[Literal["joint", "component"], "one coin a vector, or one a component"] = "joint",
) -> Make:
    """Contaminated noise: (1 - rate) body + rate outliers."""

    def make(dim: int, _: Law | None) -> Law:
        main = _inner("body", body, dim, None)
        return Contaminated(rate, main, _inner("outliers", outliers, dim, main), coin == "joint")

    return make


def mixture(
    weights: Annotated[tuple[Annotated[float, Gt(0)], ...], MinLen(2), "probabilities of the parts; they sum to 1"],
    components: Annotated[tuple[dict[str, Any], ...], MinLen(2), "laws of the parts, all gaussian"],
    labels: Annotated[
        Labels, "a label for every component, one a vector, or no labels: the weighted sum of independent Gaussians"
    ] = "per_component",
) -> Make:
    """Mixture of Gaussians: sum of weights_k N(0, C_k)."""
    if len(weights) != len(components):
        raise ValueError(f"{len(weights)} weights for {len(components)} components")
    if abs(sum(weights) - 1) > 1e-9:
        raise ValueError(f"the weights sum to {sum(weights):g}, not to 1")

    def make(dim: int, body: Law | None) -> Law:
        parts = []
        for i, spec in enumerate(components):
            with under("components", i):
                law = build(spec, dim, body)
                if not isinstance(law, Gaussian):
                    raise SpecError("the parts of a mixture are gaussian", ["kind"])
                if labels == "per_component" and np.count_nonzero(law.cov - np.diag(np.diag(law.cov))):
                    raise SpecError("with a label for every component the covariances must be diagonal")
                parts.append(law.cov)
        return GaussianMixture(np.array(weights), np.array(parts), labels)

    return make


LAWS: dict[str, Entry] = Catalogue(
    "noises",
    {
        "gaussian": Entry(gaussian),
        "laplace": Entry(laplace, paper="aladkf-2020", equations="(80)"),
        "contaminated": Entry(contaminated, paper="aladkf-2020", equations="(8), (80)"),
        "mixture": Entry(mixture, paper="fpmcs-2024", equations="section 3"),
    },
)


def build(spec: Mapping[str, Any], dim: int, body: Law | None = None) -> Law:
    """The law of dim-dimensional noise that `{kind: name, **parameters}` describes; SpecError where it makes no
    sense.
    """
    law: Law = build_kind(LAWS, "noise law", spec)(dim, body)
    return law


def _one_of(**given: Any) -> str:
    names = [name for name, value in given.items() if value is not None]
    if len(names) != 1:
        raise ValueError(f"exactly one of {', '.join(given)} must be given")
    return names[0]


def _inner(key: str, spec: Mapping[str, Any], dim: int, body: Law | None) -> Law:
    with under(key):
        return build(spec, dim, body)


def _matrix(key: str, spec: Any, dim: int, names: Mapping[str, Array]) -> Array:
    with under(key):
        return matrix(spec, dim, names)


def _covariance(key: str, spec: Any, dim: int, names: Mapping[str, Array]) -> Array:
    with under(key):
        return covariance(spec, dim, names)


def _covariances(body: Law | None) -> Mapping[str, Array]:
    return {} if body is None else {"body": body.cov}


def _factors(body: Law | None) -> Mapping[str, Array]:
    """In the place of a factor, `body` is a factor of the body's covariance (which one makes no difference to C = L
    L').
    """
    return {} if body is None else {"body": factor_of(body.cov)}
