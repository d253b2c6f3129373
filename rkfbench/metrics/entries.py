"""Metrics that are imported when they are first used, as data."""

from __future__ import annotations

from rkfbench.catalogue import Entry
from rkfbench.metrics.base import TRUTH

_HERE = "rkfbench.metrics."

METRICS: dict[str, Entry] = {
    "state": Entry(_HERE + "diagnostics:state"),
    "error": Entry(_HERE + "diagnostics:error", needs=TRUTH),
    "fluctuation": Entry(_HERE + "diagnostics:fluctuation", paper="daf", equations="conclusions", needs=TRUTH),
    "settling": Entry(_HERE + "diagnostics:settling", needs=TRUTH),
    "nees": Entry(_HERE + "diagnostics:nees", needs=TRUTH),
    "sd": Entry(_HERE + "diagnostics:sd"),
    "rms_difference": Entry(_HERE + "diagnostics:rms_difference"),
    "distance": Entry(_HERE + "diagnostics:distance"),
    "mean_of": Entry(_HERE + "diagnostics:mean_of"),
    "share_below": Entry(_HERE + "diagnostics:share_below"),
    "share_above": Entry(_HERE + "diagnostics:share_above"),
    "mse_prior": Entry(_HERE + "point:mse_prior", needs=TRUTH),
    "tracking_mse": Entry(_HERE + "point:tracking_mse", needs=TRUTH),
    "kept_mse": Entry(_HERE + "point:kept_mse", needs=TRUTH),
    "trace": Entry(_HERE + "point:trace"),
    "improvement": Entry(_HERE + "point:improvement", paper="fpmcs-2024", equations="(33)"),
    "distinct": Entry(_HERE + "point:distinct"),
    "axis_rmse": Entry(_HERE + "consistency:axis_rmse", needs=TRUTH),
    "stated_rmse": Entry(_HERE + "consistency:stated_rmse"),
    "radial_rmse": Entry(_HERE + "consistency:radial_rmse", needs=TRUTH),
    "tangential_rmse": Entry(_HERE + "consistency:tangential_rmse", needs=TRUTH),
    "radial_sd": Entry(_HERE + "consistency:radial_sd"),
    "tangential_sd": Entry(_HERE + "consistency:tangential_sd"),
    "principal_sd": Entry(_HERE + "consistency:principal_sd"),
    "excess": Entry(_HERE + "consistency:excess", paper="pekf-2017", equations="section 1", needs=TRUTH),
    "excess_entry": Entry(_HERE + "consistency:excess_entry", paper="pekf-2017", equations="section 1", needs=TRUTH),
    "indefinite": Entry(_HERE + "consistency:indefinite"),
    "crossed": Entry(_HERE + "consistency:crossed", needs=TRUTH),
    "score": Entry(_HERE + "consistency:score", needs=TRUTH),
    "nis": Entry(_HERE + "innovations:nis"),
    "nis_beyond": Entry(_HERE + "innovations:nis_beyond"),
    "whiteness": Entry(_HERE + "innovations:whiteness"),
    "innovation_rms": Entry(_HERE + "innovations:innovation_rms"),
    "log_likelihood": Entry(_HERE + "innovations:log_likelihood"),
}
