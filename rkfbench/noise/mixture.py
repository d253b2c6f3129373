"""Mixtures of zero-mean Gaussians, and the weighted sum that the same notation `p1 N(0, C1) + p2 N(0, C2)` may also
mean.

per_component: every component of the vector has a label of its own at every time (the components are independent, so
each C_k is diagonal).
per_vector:    one label a vector.
weighted_sum:  p1 e1 + p2 e2 of independent Gaussians: a Gaussian with covariance p1^2 C1 + p2^2 C2, no mixture at all.

Value and label come from their own primitives, e = L_label g, so the three meanings and all scales share the normals g.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rkfbench.linalg import Array, exp
from rkfbench.noise.base import Sample, gaussian_logpdf
from rkfbench.noise.matrices import factor
from rkfbench.streams import Streams

Labels = Literal["per_component", "per_vector", "weighted_sum"]


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """sum_k weights_k N(0, covs_k); weights (K,) sum to 1, covs (K, d, d), diagonal where the labels are those of
    components.
    """

    weights: Array
    covs: Array
    labels: Labels = "per_component"

    @property
    def dim(self) -> int:
        return self.covs.shape[1]

    @property
    def cov(self) -> Array:
        """Covariance: sum p_k C_k, or sum p_k^2 C_k of the weighted sum."""
        p = self.weights**2 if self.labels == "weighted_sum" else self.weights
        return np.tensordot(p, self.covs, 1)

    @property
    def parts(self) -> Mapping[str, Array]:
        """`body`: the covariance of the first part; `mixture`: sum p_k C_k whatever the labels are."""
        return {"body": self.covs[0], "mixture": np.tensordot(self.weights, self.covs, 1)}

    def sample(self, draw: Streams, steps: int) -> Sample:
        g = draw.normal("normal", steps, self.dim)
        if self.labels == "weighted_sum":
            return Sample(factor(self.cov) @ g, lambda: self.cov[None, ..., None])
        if self.labels == "per_vector":
            label = self._label(draw.uniform("label", steps))
            value = self._pick(label[:, None], [factor(C) @ g for C in self.covs])
            return Sample(
                value, lambda: self._pick(label[:, None, None], list(self.covs[:, None, ..., None])), flags=label > 0
            )
        label = self._label(draw.uniform("labels", steps, self.dim))
        scales = np.sqrt(np.einsum("kii->ki", self.covs))

        def cov() -> Array:
            variance = self._pick(label, list(scales[:, None, :, None] ** 2))
            return variance[:, :, None] * np.eye(self.dim)[..., None]

        scale = self._pick(label, list(scales[:, None, :, None]))
        # numbers of our own are overwritten, which halves the time of large samples; remembered ones belong to others
        return Sample(np.multiply(g, scale, out=g if g.flags.writeable else None), cov, flags=label > 0)

    def _label(self, u: Array) -> np.ndarray:
        """Which part each uniform number chooses."""
        label = np.zeros(u.shape, dtype=np.int8)
        for edge in np.cumsum(self.weights)[:-1]:
            label += u >= edge
        return label

    @staticmethod
    def _pick(label: np.ndarray, values: list[Array]) -> Array:
        """The value that belongs to each label."""
        picked = values[0]
        for k, value in enumerate(values[1:], 1):
            picked = np.where(label == k, value, picked)
        return picked

    def logpdf(self, e: Array) -> Array:
        """log of the density at e (d, ...): by component sum_i log sum_k p_k N(e_i; 0, s_ki^2), by vector log sum_k
        p_k N(e; 0, C_k).
        """
        if self.labels == "weighted_sum":
            return gaussian_logpdf(e, self.cov)
        if self.labels == "per_vector":
            return np.logaddexp.reduce(
                [np.log(p) + gaussian_logpdf(e, C) for p, C in zip(self.weights, self.covs, strict=True)], axis=0
            )
        return sum(map(self._log_density, e, np.einsum("kii->ik", self.covs)), start=np.zeros(()))

    def _log_density(self, e: Array, variances: Array) -> Array:
        """log sum_k p_k N(e; 0, s_k^2), relative to the widest part: its own term is a constant, so nothing underflows
        and nothing overflows.
        """
        height = self.weights / np.sqrt(2 * np.pi * variances)
        widest = int(np.argmax(variances))
        half = e * e
        half *= -0.5
        density: Any = height[widest]
        for k in range(len(variances)):
            if k != widest:
                part = exp(half * (1 / variances[k] - 1 / variances[widest]))
                part *= height[k]
                part += density
                density = part
        half /= variances[widest]
        half += np.log(density)
        return half

    def marginal(self, rows: Array) -> GaussianMixture:
        """The law of some components."""
        return GaussianMixture(self.weights, self.covs[:, rows][:, :, rows], self.labels)
