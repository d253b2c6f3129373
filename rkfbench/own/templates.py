"""The start of an own filter or scenario: short, working, commented."""

from __future__ import annotations

import keyword

from pydantic import TypeAdapter, ValidationError

from rkfbench.errors import UsageError
from rkfbench.filters import FILTERS
from rkfbench.own import names
from rkfbench.scenario.schema import LONGEST_NAME, FolderName
from rkfbench.scenario.yaml import scalar

ONE_RUN = '''\
"""{name}: a filter of one run. `rkfbench check {name}.py:{name}` tries it, `rkfbench run {name}.yaml` compares it."""

from typing import Annotated

import numpy as np
from annotated_types import Gt


class {name}:
    """Kalman filter whose innovations are clipped at some standard deviations."""

    # Behind the first five, every parameter can be set in a scenario: {{use: {name}.py:{name}, threshold: 2}}.
    def __init__(self, model, x0, P0, Q, R, threshold: Annotated[float, Gt(0), "in standard deviations"] = 3.0):
        self.model, self.threshold = model, threshold
        self.x, self.P = x0, P0  # mean (n,) and covariance (n, n); read after each step

    def predict(self, k, Q):
        """From step k - 1 to step k; Q is that of the step, of which a recording with irregular times has many."""
        F = self.model.F(self.x, k)  # the Jacobian of f, or the matrix of a linear model
        self.x = self.model.f(self.x, k)
        self.P = F @ self.P @ F.T + Q

    def update(self, y, k, R):
        """With the measurement y (m,); not called where all of it is missing."""
        seen = np.isfinite(y)  # single components may be missing
        H = self.model.H(self.x, k)[seen]
        S = H @ self.P @ H.T + R[np.ix_(seen, seen)]
        K = np.linalg.solve(S, H @ self.P).T
        nu = self.model.residual(y, self.model.h(self.x, k))[seen]  # y - h(x), angles wrapped
        limit = self.threshold * np.sqrt(np.diag(S))
        self.x = self.x + K @ np.clip(nu, -limit, limit)
        self.P = self.P - K @ S @ K.T
'''

BATCH = '''\
"""{name}: a filter of all runs. `rkfbench check {name}.py:{name}` tries it, `rkfbench run {name}.yaml` compares it."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt

from rkfbench.filters import GaussianFilter
from rkfbench.filters.moments import Taylor
from rkfbench.filters.weights import Weighted


@dataclass(frozen=True)
class Clip:
    """The robust weight: innovations nu (m, M) are clipped. M runs are the last axis of every array."""

    threshold: float
    sees = frozenset()

    def __call__(self, nu, e, R, Szz):
        S = Szz + (R if R.ndim == 3 else R[..., None])
        limit = self.threshold * np.sqrt(np.einsum("iim->im", S))
        return Weighted(R, np.clip(nu, -limit, limit))


# The parameters can be set in a scenario: {{use: {name}.py:{name}, threshold: 2}}. Any object with the method
# run(model, y, x0, P0, *, Q, R, keep, known, streams) -> rkfbench.filters.Estimate is a filter;
# this one is made of parts.
def {name}(threshold: Annotated[float, Gt(0), "in standard deviations"] = 3.0):
    """Kalman filter whose innovations are clipped at some standard deviations."""
    return GaussianFilter(moments=Taylor(), weight=Clip(threshold))
'''

SCENARIO = """\
# rkfbench run {file}: numbers, tables and figures in results/{name}; rkfbench report makes a page of them
name: {name}
seed: 1
runs: {{paper: 100, reference: 1000}}
steps: 100
model: {{kind: navigation, dt: 0.5, observed: [px, py, vx]}}      # rkfbench list models
start: {{truth: [1, 1, 1, 1]}}
process_noise: {{kind: gaussian, cov: 1}}
measurement_noise:                                              # what is simulated: some outliers
  kind: contaminated
  rate: 0.1
  body: {{kind: gaussian, cov: 1}}
  outliers: {{kind: laplace, cov: {{times: 100, of: body}}}}
assumed: {{mean: [0, 0, 0, 0], cov: 1, measurement_cov: body}}    # what the filters are told
sweep: {{measurement_noise.rate: [0, 0.1, 0.3]}}
filters:                                                        # rkfbench list filters
  - kf
  - hkf
{own}
metrics: [err_norm, "rmse[px]"]                                 # rkfbench list metrics
figures: [{{id: errors, kind: sweep, over: rate, metric: err_norm}}]
tables: [{{id: errors, metric: err_norm}}]
"""


def own_filter(name: str, batch: bool) -> dict[str, str]:
    """The file of a filter, and a scenario that runs it beside kf and hkf: by file name."""
    if not name.isidentifier() or keyword.iskeyword(name):
        raise UsageError(f"'{name}' cannot be the name of a Python function or class")
    if name in FILTERS:
        raise UsageError(f"there is a filter '{name}' already (rkfbench show {name}): choose another name")
    if names.hides(name):
        raise UsageError(
            f"'{name}' is a module that Python can import, which {name}.py would hide: choose another name"
        )
    called = _scenario_name(name.strip("_") or "own")
    own = f"  - {{use: {name}.py:{name}, threshold: 3}}"
    return {
        f"{name}.py": (BATCH if batch else ONE_RUN).format(name=name),
        f"{name}.yaml": SCENARIO.format(name=called, file=f"{name}.yaml", own=own),
    }


def scenario(name: str) -> dict[str, str]:
    """A scenario, by file name, which may be given with its ending."""
    name = _scenario_name(name.removesuffix(".yaml"))
    own = "  # - {use: my_filter.py:my_filter, threshold: 3}               your own: rkfbench new filter my_filter"
    return {f"{name}.yaml": SCENARIO.format(name=name, file=f"{name}.yaml", own=own)}


def _scenario_name(name: str) -> str:
    """The name, if a scenario file that gives it is valid; else UsageError."""
    try:
        found: str = TypeAdapter(FolderName).validate_python(name)
        TypeAdapter(FolderName).validate_python(scalar(found))
    except ValidationError:
        raise UsageError(
            f"'{name}' cannot name a scenario: ASCII letters, digits, `_`, `.` and `-`, "
            f"at most {LONGEST_NAME}, and no word such as 12 or true that YAML reads as something else"
        ) from None
    return found
