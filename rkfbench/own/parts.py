"""Own models, noise laws, robust weights and metrics: what each must be, tried on a small example before anything runs.

A model is a class with states, measurements, f and h, best derived from rkfbench.models.base.Smooth or Linear. x has
the states on its first axis and any axes behind it. Filters that linearise want F (n, n) or (n, n, M), and H. On
recordings with irregular times it must be a dataclass with a field `dt`, which f and F compute with: it is replaced
step by step.

    @dataclass(frozen=True)
    class Pendulum(Smooth):
        '''Angle and rate of a pendulum, seen from the side.'''

        dt: Annotated[float, Gt(0), "time step"] = 0.1
        states = ("angle", "rate")
        measurements = ("swing",)

        def f(self, x, k):
            return np.array([x[0] + self.dt * x[1], x[1] - self.dt * np.sin(x[0])])

        def h(self, x, k):
            return np.sin(x[:1])

        def F(self, x, k):
            one = np.ones_like(x[0])
            return np.array([[one, self.dt * one], [-self.dt * np.cos(x[0]), one]])

        def H(self, x, k):
            return np.array([[np.cos(x[0]), 0 * x[0]]])

A noise law is a class or function with a parameter `dim`, making an object with cov (dim, dim) and sample(draw, steps),
the noise (steps, dim, draw.runs) or a Sample. All chance comes from draw.normal, draw.uniform and draw.exponential
(purpose, *shape), which give (*shape, draw.runs). The purpose is any word; each word is drawn once, as it always gives
the same numbers. draw.within("part") has words of its own. Particle filters ask for logpdf(e), the log density at e
(dim, ...), and where components are missing for marginal(rows), the law of those that are there.

    class Uniform:
        '''Uniform on [-half, half], component by component.'''

        def __init__(self, dim, half=1.0):
            self.dim, self.half, self.cov = dim, half, half**2 / 3 * np.eye(dim)

        def sample(self, draw, steps):
            return self.half * (2 * draw.uniform("value", steps, self.dim) - 1)

A metric is a function of trial and states (indices): the quantity at each step of each run (T, M), reduced to its mean
over the steps. Of a trial there are estimate.mean (T, n, M), estimate.cov (T, n, n, M or 1), estimate.failed (M,) and
estimate.extras, the histories that the function's `keep` names (prior_mean, prior_cov, nu, S, ...); truth() (T, n, M);
world.y (T, m, M); experiment.model and experiment.told with P0, Q and R. One with `needs = {"truth"}` is refused where
there is no truth; `better = "small"` or "large" is what `rkfbench tune` looks for. A function of no trial makes the
parts of a metric as those of the catalogue do.

    def worst(trial, states):
        '''Largest absolute error of the states asked for.'''
        return np.abs(trial.estimate.mean[:, states] - trial.truth()[:, states]).max(1)

    worst.needs, worst.better = {"truth"}, "small"

A robust weight is a function of nu, e, R, Szz, or a class that makes one: the inflated R' (m, m, M), or a Weighted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate
from rkfbench.filters.weights import Weighted
from rkfbench.linalg import Array, mul
from rkfbench.metrics.base import Better, Metric, Trial
from rkfbench.noise import Law, Sample
from rkfbench.own.draws import Draws
from rkfbench.own.faults import PluginFault, said
from rkfbench.streams import Streams

Adapted = tuple[Callable[[Mapping[str, Any]], Any], tuple[str, ...]]
WEIGHED = ("nu", "e", "R", "Szz")
QUANTITY = ("keep", "partners", "steps")
SAMPLES = 3  # runs of the small examples


def _tried(name: str, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        with np.errstate(all="ignore"):
            return function(*arguments)
    except SpecError:
        raise
    except (Exception, SystemExit) as error:
        raise SpecError(f"{what} of {name} raised {type(error).__name__}: {error}") from error


def _expect(name: str, what: str, value: Any, *shapes: tuple[int, ...]) -> None:
    if np.shape(value) not in shapes:
        expected = " or ".join(map(str, dict.fromkeys(shapes)))
        raise SpecError(f"{what} of {name} has shape {np.shape(value)}, expected {expected}")


def model(name: str, target: Any, signature: Collection[str]) -> Adapted:
    """An own model: made, then asked once for everything that filters ask."""

    def make(params: Mapping[str, Any]) -> Any:
        made = target(**params)
        for attribute in ("states", "measurements", "linear", "f", "h", "residual"):
            if not hasattr(made, attribute):
                raise SpecError(
                    f"{name} makes a {type(made).__name__} without `{attribute}`: "
                    "derive its class from rkfbench.models.base.Smooth or Linear"
                )
        for attribute in ("states", "measurements"):
            names = getattr(made, attribute)
            if not (isinstance(names, tuple) and names and all(isinstance(each, str) for each in names)):
                raise SpecError(f"`{attribute}` of {name} is not a tuple of names")
        n, m = len(made.states), len(made.measurements)
        for shape in ((n, SAMPLES), (n, 2, SAMPLES)):  # runs, and points of each run
            x = np.linspace(0.5, 1.0, int(np.prod(shape))).reshape(shape)
            before = x.copy()
            _expect(name, "f", _tried(name, "f", made.f, x, 1), (n, *shape[1:]))
            z = _tried(name, "h", made.h, x, 1)
            _expect(name, "h", z, (m, *shape[1:]))
            _expect(name, "the residual", _tried(name, "the residual", made.residual, z, z), (m, *shape[1:]))
            if not np.array_equal(x, before):
                raise SpecError(f"f or h of {name} changes x in place")
        x = np.linspace(0.5, 1.0, n * SAMPLES).reshape(n, SAMPLES)
        for jacobian, rows in (("F", n), ("H", m)):
            if hasattr(made, jacobian):
                J = _tried(name, jacobian, getattr(made, jacobian), x, 1)
                _expect(name, jacobian, J, (rows, n), (rows, n, SAMPLES))
        if getattr(made, "affine", False):
            _expect_affine(name, made, x)
        return made

    return make, ()


def _expect_affine(name: str, model: Any, x: Array) -> None:
    """SpecError unless f changes as F says between x and another place: filters leave out its points then."""
    if not hasattr(model, "F"):
        raise SpecError(f"{name} is called affine and has no F")
    there = 2.0 - x[:, ::-1] ** 2
    with np.errstate(all="ignore"):
        moved, expected = model.f(there, 1) - model.f(x, 1), mul(model.F(x, 1), there - x)
    if not np.allclose(moved, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max()):
        raise SpecError(f"f of {name} is not F x + b, as its class says: give the class `affine = False`")


def noise(name: str, target: Any, signature: Collection[str]) -> Adapted:
    """An own noise law: what the catalogue's entries make, a function of the dimension and the law of the body."""
    if "dim" not in signature:
        raise SpecError(f"{name} has no parameter `dim`, the dimension of the noise")
    given = tuple(each for each in ("dim", "body") if each in signature)

    def make(params: Mapping[str, Any]) -> Callable[[int, Law | None], Law]:
        def of(dim: int, body: Law | None) -> Law:
            told = {"dim": dim, "body": body}
            made = _tried(name, "the making", lambda: target(**{key: told[key] for key in given}, **params))
            return OwnLaw(name, made, dim)

        return of

    return make, given


@dataclass(frozen=True, eq=False)
class OwnLaw:
    """A plug-in's law with its samples checked."""

    name: str
    law: Any
    dim: int
    cov: Array = field(init=False)
    _marginals: dict[tuple[int, ...], OwnLaw] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        for attribute in ("cov", "sample"):
            if not hasattr(self.law, attribute):
                raise SpecError(f"{self.name} makes a {type(self.law).__name__} without `{attribute}`")
        C = np.array(self.law.cov, dtype=float)
        _expect(self.name, "cov", C, (self.dim, self.dim))
        if not np.allclose(C, C.T) or np.linalg.eigvalsh(C)[0] < -1e-9 * np.abs(C).max():
            raise SpecError(f"cov of {self.name} is not a covariance: symmetric and without negative eigenvalues")
        object.__setattr__(self, "cov", C)
        one, two = (_tried(self.name, "sample", self.sample, Streams(0), 2).value for _ in range(2))
        if not np.array_equal(one, two, equal_nan=True):
            raise SpecError(
                f"sample of {self.name} gives other values each time: it must draw from `draw` (draw.normal, "
                "draw.uniform, draw.exponential), not from random numbers of its own"
            )

    @property
    def parts(self) -> Mapping[str, Array]:
        """Covariances that the law can name."""
        parts: Mapping[str, Array] = getattr(self.law, "parts", {})
        return parts

    def sample(self, draw: Streams, steps: int) -> Sample:
        """Noise of `steps` steps for the runs of the stream."""
        drawn = self.law.sample(Draws(draw, self.name), steps)
        sample = drawn if isinstance(drawn, Sample) else Sample(np.asarray(drawn, dtype=float), self._no_record)
        if sample.value.shape != (steps, self.dim, draw.runs):
            expected = (steps, self.dim, draw.runs)
            raise SpecError(f"sample of {self.name} has shape {sample.value.shape}, expected {expected}")
        return sample

    def logpdf(self, e: Array) -> Array:
        """Log density at e (d, ...)."""
        if not hasattr(self.law, "logpdf"):
            raise PluginFault(f"{self.name} has no `logpdf`, which this filter needs")
        return np.asarray(self.law.logpdf(e))

    def marginal(self, rows: Array) -> OwnLaw:
        """The law of some components."""
        key = tuple(rows.tolist())
        if key not in self._marginals:
            if not hasattr(self.law, "marginal"):
                raise PluginFault(
                    f"{self.name} has no `marginal(rows)`, the law of some components, which this filter needs where "
                    "others are missing"
                )
            self._marginals[key] = OwnLaw(f"the marginal of {self.name}", self.law.marginal(rows), len(rows))
        return self._marginals[key]

    def _no_record(self) -> Array:
        raise PluginFault(f"{self.name} returns no Sample with the record of its draws, which this filter needs")


def weight(name: str, target: Any, signature: Collection[str]) -> Adapted:
    """An own robust weight."""
    if "nu" not in signature:
        return (lambda params: OwnWeight(name, target(**params))), ()
    if lacking := [each for each in WEIGHED if each not in signature]:
        raise SpecError(f"{name} lacks the parameters {', '.join(lacking)}: a weight is a function of nu, e, R, Szz")

    def make(params: Mapping[str, Any]) -> OwnWeight:
        def weighted(nu: Array, e: Array, R: Array, Szz: Array) -> Any:
            return target(nu=nu, e=e, R=R, Szz=Szz, **params)

        return OwnWeight(name, weighted)

    return make, WEIGHED


@dataclass(frozen=True)
class OwnWeight:
    """A plug-in's weight with its answers checked."""

    name: str
    weight: Any

    def __post_init__(self) -> None:
        if not callable(self.weight):
            raise SpecError(f"{self.name} makes a {type(self.weight).__name__}, not a function of nu, e, R, Szz")

    @property
    def sees(self) -> frozenset[str]:
        """What its updates show beside nu and S."""
        return frozenset(getattr(self.weight, "sees", ()))

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        result = self.weight(nu, e, R, Szz)
        found = result if isinstance(result, Weighted) else Weighted(np.asarray(result, dtype=float), nu)
        (m, M), shape = nu.shape, np.shape(found.R)
        if shape not in ((m, m), (m, m, 1), (m, m, M)):
            raise PluginFault(f"{self.name} returned an R of shape {shape}, expected {(m, m, M)} or {(m, m, 1)}")
        if np.shape(found.nu) != (m, M):
            raise PluginFault(f"{self.name} returned a nu of shape {np.shape(found.nu)}, expected {(m, M)}")
        return found if len(shape) == 3 else found._replace(R=found.R[..., None])


def metric(name: str, target: Any, signature: Collection[str]) -> Adapted:
    """An own metric: the quantity itself, or the parts of a metric as the catalogue's functions give them."""
    if "trial" in signature:
        if "states" not in signature:
            raise SpecError(f"{name} lacks the parameter `states`, the indices of the states that are asked for")
        _expect_direction(name, target)
        keep = frozenset(getattr(target, "keep", ()))

        def make(params: Mapping[str, Any]) -> dict[str, Any]:
            return {"quantity": OwnQuantity(name, target, tuple(params.items()), keep)}

        return make, ("trial", "states")

    def parts(params: Mapping[str, Any]) -> dict[str, Any]:
        made = target(**params)
        if not isinstance(made, dict) or "quantity" not in made:
            raise SpecError(f"{name} makes no parts of a metric: a mapping with `quantity`, and perhaps `reduce`")
        lacking = [each for each in QUANTITY if not hasattr(made["quantity"], each)]
        if lacking or not callable(made["quantity"]):
            raise SpecError(f"the quantity of {name} lacks {', '.join(lacking) or '__call__'}")
        _expect_direction(name, made["quantity"])
        try:
            Metric(name, **made)
        except TypeError as error:
            raise SpecError(f"{name} makes no parts of a metric: {error}") from error
        return made

    return parts, ()


def _expect_direction(name: str, holder: Any) -> None:
    """SpecError where an own metric calls something else better than small or large numbers."""
    if (better := getattr(holder, "better", None)) not in (None, "small", "large"):
        raise SpecError(f"`better` of {name} is {better!r}, expected 'small' or 'large'")


@dataclass(frozen=True)
class OwnQuantity:
    """A plug-in's function of a trial as a quantity at each step."""

    name: str
    function: Callable[..., Any]
    params: tuple[tuple[str, Any], ...]
    keep: frozenset[str]
    own: ClassVar[bool] = True
    partners: ClassVar[Mapping[str, frozenset[str]]] = MappingProxyType({})

    @property
    def better(self) -> Better | None:
        """What the function says of it."""
        found: Better | None = getattr(self.function, "better", None)
        return found

    def steps(self, T: int) -> NDArray[np.intp]:
        """Every step."""
        return np.arange(1, T + 1)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        values = np.asarray(self.function(trial=trial, states=states, **dict(self.params)), dtype=float)
        T, M = len(trial.estimate.mean), trial.world.y.shape[2]
        if values.shape != (T, M):
            raise PluginFault(f"{self.name} returned shape {values.shape}, expected {(T, M)}: a value a step and run")
        return values


def try_metric(metric: Metric, experiment: Any) -> None:
    """SpecError if an own function of a trial raises, or answers in a wrong shape, on a few runs of an experiment with
    made-up estimates. One that needs histories other than those of every recursive filter is not tried.
    """
    if not isinstance(metric.quantity, OwnQuantity):
        return
    try:
        world = experiment.simulate(Streams(0)).of(slice(SAMPLES))
    except Exception:  # of a law or a model, not of the metric: told when the study runs
        return
    told, (T, m, M) = experiment.told, world.y.shape
    n = len(told.mean)
    mean, P = np.repeat(told.mean[None, :, None], T, axis=0), told.P0[None, ..., None]
    shapes = {"prior_mean": (n,), "prior_cov": (n, n), "nu": (m,), "S": (m, m)}
    if metric.quantity.keep - shapes.keys() - {"cov"}:
        return
    ones = {name: np.eye(*shape) if len(shape) == 2 else np.ones(shape) for name, shape in shapes.items()}
    extras = {name: np.tile(ones[name][None, ..., None], M).repeat(T, 0) for name in metric.quantity.keep - {"cov"}}
    estimate = Estimate(np.repeat(mean, M, axis=-1), np.repeat(P, T, axis=0), np.zeros(M, dtype=bool), extras)
    filt = next((filt for filt, _ in experiment.filters.values()), None)
    try:
        metric(Trial(experiment, world, filt, estimate))
    except PluginFault as fault:
        raise SpecError(str(fault)) from fault
    except (Exception, SystemExit) as error:
        raise SpecError(
            f"{metric.quantity.name} raised {said(error)}, tried on {M} runs "
            "(rkfbench/own/parts.py says what a trial has)"
        ) from error
