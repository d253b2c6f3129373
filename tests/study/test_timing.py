"""Computing times: what is timed, in which order, and how it is scaled. No clock value decides a test."""

from __future__ import annotations

import pytest

from rkfbench.experiment import Experiment
from rkfbench.scenario import load
from rkfbench.streams import Streams
from rkfbench.study import clock, timing
from tests.contract import SPECS

FILTERS = [
    *({"label": label, "use": label} for label in ("kf", "hkf", "clairvoyant_kf")),
    {"label": "kf_each_step", "use": "kf", "reuse_gains": False},
    {"label": "ks", "use": "ks", "at": 300, "lag": 100},
    {"label": "ps", "use": "ps", "at": 300, "lag": 100, "particles": 20},
]
SPEC = {**SPECS["navigation"], "steps": 400, "filters": FILTERS}


def test_filters_are_interleaved_and_measured_in_both_forms(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 3)
    times = list(timing.measure(SPEC, 1, ["kf", "hkf"], full=True))
    repeat = [(metric, label) for metric in ("time_ms", "time_ns") for label in ("kf", "hkf")]
    assert [(t.metric, t.filter) for t in times] == 3 * repeat
    assert all(t.value > 0 for t in times)


def test_a_time_is_scaled_to_the_steps_of_a_run_and_to_one_run_and_step(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    monkeypatch.setattr(timing, "seconds", lambda experiment, world, label, runs, steps: 0.001 * steps)
    found = {t.metric: t.value for t in timing.measure(SPEC, 1, ["hkf"], full=True)}
    assert found["time_ms"] == 400.0  # 1 ms a step, 400 steps
    assert abs(found["time_ns"] - 1e6 / 128) < 1e-6


def test_a_filter_whose_gains_settle_is_timed_over_all_steps(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    asked = {}

    def seconds(experiment, world, label, runs, steps):
        asked.setdefault(label, []).append(steps)
        return 0.001 * steps

    monkeypatch.setattr(timing, "seconds", seconds)
    list(timing.measure(SPEC, 1, ["kf", "ks", "kf_each_step", "hkf"]))
    assert asked == {"kf": [5, 400, 400], "ks": [5, 400, 400], "kf_each_step": [5] * 3, "hkf": [5] * 3}
    asked.clear()
    list(timing.measure(SPEC, 1, ["kf", "hkf"], full=True))  # runs by themselves are whole, then batches
    assert asked == {"kf": [5, 5, 400, 400, 400, 400], "hkf": [5, 5, 400, 5, 400, 5]}


def test_a_particle_smoother_is_timed_with_the_estimates_of_its_filter(monkeypatch):
    kept = {}
    for label in ("ps", "ks"):
        filt = type(Experiment.of(SPEC).filters[label][0])
        run = filt.run
        monkeypatch.setattr(
            filt,
            "run",
            lambda *args, run=run, label=label, **more: kept.update({label: more["keep"]}) or run(*args, **more),
        )
    experiment = Experiment.of(SPEC)
    world = experiment.simulate(Streams(1))
    for label in ("ps", "ks"):
        timing.seconds(experiment, world, label, slice(0, 1), 20)
    assert kept == {"ps": ("passed",), "ks": ()}


def test_a_reference_that_needs_the_record_is_timed_too(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    assert len(list(timing.measure(SPEC, 1, ["clairvoyant_kf"], full=True))) == 2


@pytest.mark.parametrize(
    ("metric", "labels"), [("time_ms", {"kf", "hkf"}), ("1000 * time_ms", {"kf", "hkf"}), ("err_norm", set())]
)
def test_the_times_that_a_table_shows_are_wanted_also_within_arithmetic(small, metric, labels):
    small.write_text(small.read_text() + f"tables: [{{id: t, metric: {metric}}}]\n")
    assert clock.wanted(load(small), ()) == dict.fromkeys(("rate=0", "rate=0.4"), labels)


def test_a_smoother_inside_another_filter_is_timed_over_all_steps(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    inside = {"label": "inside", "quantised": {"filter": "ks", "step": 0.1}}
    spec = {**SPEC, "point": {"at": 300, "lag": 100}, "filters": [inside]}
    assert [each.filter for each in timing.measure(spec, 1, ["inside"])] == ["inside"]
