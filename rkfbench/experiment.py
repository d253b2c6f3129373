"""One cell of a study, made from its plain description: the model, the noise, what the filters are told, the filters,
the metrics.

`Experiment.of` checks that all of it fits together; `simulate` draws the truth and the measurements that every filter
of the cell sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rkfbench import own, parts, recorded
from rkfbench.errors import SpecError, collect, under
from rkfbench.filters import Filter, Known, Setting
from rkfbench.linalg import Array
from rkfbench.metrics import Metric
from rkfbench.models import Model
from rkfbench.models.timed import Timed
from rkfbench.models.truths import Truth
from rkfbench.noise import Law, Sample
from rkfbench.noise.disturbances import Disturbance
from rkfbench.noise.matrices import factor
from rkfbench.parts import Lost, Told
from rkfbench.recording import Recording
from rkfbench.streams import GROUP, Streams


@dataclass(frozen=True)
class World:
    """What happened in the runs of a block: true states x (T, n, M), measurements y (T, m, M), the noise behind them,
    and the filters' start x0 (n, M). Of recorded data nobody knows the noise, and the truth may be NaN.
    """

    x: Array
    y: Array
    x0: Array
    w: Sample
    v: Sample

    @property
    def known(self) -> Known:
        return Known(self.x, self.w, self.v)

    def of(self, runs: slice) -> World:
        """What happened in some of the runs."""
        return World(self.x[..., runs], self.y[..., runs], self.x0[:, runs], self.w.of(runs), self.v.of(runs))


@dataclass(frozen=True)
class Experiment:
    """A checked cell."""

    steps: int
    model: Model
    process: Law
    measurement: Law
    start: tuple[Array, Array | None] | None  # true initial state: its mean, and a factor of its covariance if drawn
    told: Told
    mean_drawn: bool
    filters: Mapping[str, tuple[Filter, Told]]
    metrics: tuple[Metric, ...]
    lost: Lost | None
    assumed_model: Any  # the model as the filters know it
    script: Truth | None = None
    disturbances: tuple[Disturbance, ...] = ()
    point: tuple[int, int] | None = None  # the step j and the lag of point smoothers
    score: str = "rmse"  # the metric by which runs are judged
    recording: Recording | None = None  # what stands in place of a simulation

    @classmethod
    def of(cls, spec: Mapping[str, Any]) -> Experiment:
        """The experiment that a cell's specification describes; SpecError with the paths of all faults found."""
        if "plugins" in spec:
            own.ready(**spec["plugins"])
        faults: list[SpecError] = []
        model, assumed_model = parts.models_of(spec)
        n, m = len(model.states), len(model.measurements)
        data = recorded.recording_of(spec, model)
        intervals = recorded.intervals_of(model, data)
        if intervals is not None:
            assumed_model = Timed(assumed_model, intervals)
        lacking = recorded.lacking(data, intervals is not None)
        made: dict[str, Any] = {"recording": data}
        for name, make in {
            "process": lambda: recorded.law(spec, "process_noise", n),
            "measurement": lambda: recorded.law(spec, "measurement_noise", m),
            "start": lambda: parts.start(spec["start"], n) if data is None else None,
            "script": lambda: parts.script_of(spec.get("truth", "model"), model),
            "disturbances": lambda: tuple(
                parts.disturbance(i, each, model, spec["steps"])
                for i, each in enumerate(spec.get("disturbances") or ())
            ),
            "lost": lambda: parts.lost_of(spec.get("lost"), model, spec["steps"]),
            "point": lambda: parts.point_of(spec.get("point"), spec["steps"]),
            "score": lambda: parts.score_of(spec.get("score") or "rmse", model, spec),
            "metrics": lambda: tuple(
                parts.metric(i, text, assumed_model, spec) for i, text in enumerate(spec["metrics"])
            ),
        }.items():
            with collect(faults):
                made[name] = make()
        if "process" in made and "measurement" in made:
            laws = made["process"], made["measurement"]
            with collect(faults):
                made["told"] = recorded.paced(parts.told(spec["assumed"], laws, n, m), model, intervals)
            made["filters"] = {}
            for i, each in enumerate(spec["filters"]):
                with collect(faults), under("filters", i):
                    recorded.check_filter(each, lacking)
                    built = parts.filter_of(each, assumed_model, Setting(spec["steps"], *laws, made.get("point")))
                    told = made.get("told")
                    if each.get("assumed"):
                        told = parts.told_apart(each["assumed"], spec["assumed"], laws, n, m)
                        told = recorded.paced(told, model, intervals)
                    parts.check_told(built, told)
                    made["filters"][each["label"]] = built, told
        with collect(faults):
            recorded.check_metrics(made.get("metrics", ()), lacking)
        with collect(faults):
            recorded.check_lost(spec, lacking)
        if not faults:
            with collect(faults):
                parts.check_partners(made["metrics"], made["filters"])
        if faults:
            raise SpecError.all(faults)
        return cls(
            spec["steps"],
            model,
            assumed_model=assumed_model,
            mean_drawn=spec["assumed"].get("mean_drawn", False),
            **made,
        )

    def simulate(self, streams: Streams) -> World:
        """Truth and measurements of the runs of the streams: x_k = f(x_{k-1}) + w_k, y_k = h(x_k) + v_k, k = 1..T; or
        the recorded ones.
        """
        if self.recording is not None:
            x, y = self.recording.block(streams.first * GROUP, streams.runs)
            return World(x, y, self._estimated_start(streams), recorded.unknown(x), recorded.unknown(y))
        x, x0, w, v = self.drawn(streams)
        return World(*self.follow(x, w.value, v.value), x0, w, v)

    def drawn(self, streams: Streams) -> tuple[Array, Array, Sample, Sample]:
        """All that chance decides of the runs: true start and filters' start (n, M), noise of process and
        measurement.
        """
        assert self.start is not None
        mean, L = self.start
        x = np.repeat(mean[:, None], streams.runs, axis=1)
        if L is not None:
            x = x + L @ streams.normal("start", len(mean))
        w = self._noise("process", self.process, streams, self.model.states)
        v = self._noise("measurement", self.measurement, streams, self.model.measurements)
        return x, self._estimated_start(streams), w, v

    def _estimated_start(self, streams: Streams) -> Array:
        """Where the filters start (n, M): at the mean that they are told, or drawn around it."""
        x0 = np.repeat(self.told.mean[:, None], streams.runs, axis=1)
        return x0 + factor(self.told.P0) @ streams.normal("estimate", len(x0)) if self.mean_drawn else x0

    def follow(self, x: Array, w: Array, v: Array) -> tuple[Array, Array]:
        """States (T, n, M) and measurements (T, m, M) from a start x (n, M) and the values of the noise."""
        script = None if self.script is None else self.script.states(self.steps)
        X, y = np.empty_like(w), np.empty_like(v)
        with np.errstate(all="ignore"):
            for k in range(1, self.steps + 1):
                x = self.model.f(x, k) if script is None else script[k - 1][:, None]
                x = X[k - 1] = x + w[k - 1]
                y[k - 1] = self.model.h(x, k) + v[k - 1]
        return X, y

    def _noise(self, channel: str, law: Law, streams: Streams, names: tuple[str, ...]) -> Sample:
        """Noise of one channel with the disturbances that enter it."""
        sample = law.sample(streams.within(channel), self.steps)
        for i, each in enumerate(each for each in self.disturbances if each.channel == channel):
            sample = sample + each.sample(streams.within(f"disturbance/{channel}/{i}"), self.steps, names)
        return sample
