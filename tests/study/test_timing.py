"""Computing times: what is timed, in which order, and how it is scaled. No clock value decides a test."""

from __future__ import annotations

import pytest

from rkfbench.scenario import load
from rkfbench.study import clock, timing
from tests.contract import SPECS

SPEC = {**SPECS["navigation"], "filters": [{"label": label, "use": label} for label in ("kf", "hkf", "clairvoyant_kf")]}


def test_filters_are_interleaved_and_measured_in_both_forms(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 3)
    times = list(timing.measure("case", SPEC, 1, ["kf", "hkf"]))
    assert [(t.repeat, t.metric, t.filter) for t in times] == [
        (repeat, metric, label) for repeat in range(3) for metric in ("time_ms", "time_ns") for label in ("kf", "hkf")
    ]
    assert all(t.value > 0 and t.case == "case" for t in times)


def test_a_time_is_scaled_to_the_steps_of_a_run_and_to_one_run_and_step(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    monkeypatch.setattr(timing, "seconds", lambda experiment, world, label, runs, steps: 0.001 * steps)
    found = {t.metric: t.value for t in timing.measure("case", {**SPEC, "steps": 400}, 1, ["kf"])}
    assert found["time_ms"] == 400.0  # 1 ms a step, 400 steps
    assert abs(found["time_ns"] - 1e6 / 128) < 1e-6


def test_a_reference_that_needs_the_record_is_timed_too(monkeypatch):
    monkeypatch.setattr(timing, "REPEATS", 1)
    assert len(list(timing.measure("case", SPEC, 1, ["clairvoyant_kf"]))) == 2


@pytest.mark.parametrize(
    ("metric", "labels"), [("time_ms", {"kf", "hkf"}), ("1000 * time_ms", {"kf", "hkf"}), ("err_norm", set())]
)
def test_the_times_that_a_table_shows_are_wanted_also_within_arithmetic(small, metric, labels):
    small.write_text(small.read_text() + f"tables: [{{id: t, metric: {metric}}}]\n")
    assert clock.wanted(load(small), ()) == dict.fromkeys(("rate=0", "rate=0.4"), labels)
