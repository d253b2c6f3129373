"""The two-segment factor functions of adaptively robust filtering: how much weight a standardised residual u keeps.

    exponential   f(u) = 1 for |u| <= lambda, else exp(-(|u| - lambda)^2)
    ratio         f(u) = 1 for |u| <= lambda, else lambda/|u|

The DAF paper names the exponential form and gives no formula; both forms are from the literature. A factor never falls
below its floor: without one, a prediction of weight zero would leave the speed unobserved.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Interval

from rkfbench.linalg import Array

Form = Literal["exp", "ratio"]
LambdaAlpha = Annotated[float, Gt(0), "threshold of the measurement factors alpha, in standard deviations"]
LambdaBeta = Annotated[float, Gt(0), "threshold of the prediction factor beta, in standard deviations"]
FactorForm = Annotated[Form, "factor function: exponential, or lambda/|u|"]
Floor = Annotated[float, Interval(gt=0, le=1), "lower bound of all factors"]


def log_factor(u: Array, threshold: float, form: Form) -> Array:
    """log f(u): where f itself would underflow, its logarithm does not."""
    size = np.abs(u)
    if form == "ratio":
        return -np.log(np.maximum(size / threshold, 1.0))
    return -(np.maximum(size - threshold, 0.0) ** 2)


def factor(u: Array, threshold: float, form: Form, floor: float) -> Array:
    """max(f(u), floor)."""
    return np.maximum(np.exp(log_factor(u, threshold, form)), floor)
