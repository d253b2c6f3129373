"""The metrics that are measured with a clock: one value a repeat instead of a run."""

from __future__ import annotations

FORMS = ("time_ms", "time_ns")  # of one run by itself; of a batch, a run and step, for the full study


def is_time(metric: str) -> bool:
    """Whether a metric is measured with a clock."""
    return metric in FORMS
