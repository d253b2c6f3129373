"""Metrics that are imported when they are first used, as data."""

from __future__ import annotations

from rkfbench.catalogue import Entry

_HERE = "rkfbench.metrics."

METRICS: dict[str, Entry] = {
    "state": Entry(_HERE + "diagnostics:state"),
    "error": Entry(_HERE + "diagnostics:error"),
    "fluctuation": Entry(_HERE + "diagnostics:fluctuation", paper="daf", equations="conclusions"),
    "settling": Entry(_HERE + "diagnostics:settling"),
    "nees": Entry(_HERE + "diagnostics:nees"),
    "sd": Entry(_HERE + "diagnostics:sd"),
    "distance": Entry(_HERE + "diagnostics:distance"),
    "mean_of": Entry(_HERE + "diagnostics:mean_of"),
    "share_below": Entry(_HERE + "diagnostics:share_below"),
    "share_above": Entry(_HERE + "diagnostics:share_above"),
    "mse_prior": Entry(_HERE + "point:mse_prior"),
    "tracking_mse": Entry(_HERE + "point:tracking_mse"),
    "trace": Entry(_HERE + "point:trace"),
    "improvement": Entry(_HERE + "point:improvement", paper="fpmcs-2024", equations="(33)"),
    "distinct": Entry(_HERE + "point:distinct"),
    "axis_rmse": Entry(_HERE + "consistency:axis_rmse"),
    "stated_rmse": Entry(_HERE + "consistency:stated_rmse"),
    "radial_rmse": Entry(_HERE + "consistency:radial_rmse"),
    "tangential_rmse": Entry(_HERE + "consistency:tangential_rmse"),
    "radial_sd": Entry(_HERE + "consistency:radial_sd"),
    "tangential_sd": Entry(_HERE + "consistency:tangential_sd"),
    "excess": Entry(_HERE + "consistency:excess", paper="pekf-2017", equations="section 1"),
    "indefinite": Entry(_HERE + "consistency:indefinite"),
    "crossed": Entry(_HERE + "consistency:crossed"),
    "score": Entry(_HERE + "consistency:score"),
}
