"""The names of all filters and of their parts, as data: reading them imports none of what they stand for."""

from __future__ import annotations

from math import inf

from rkfbench.catalogue import Catalogue, Entry, Limit

_HERE = "rkfbench.filters."
_OFF = {"threshold": 1e12}
_UKF = {"moments": "unscented"}
_FACTORS_OFF = Limit({"lambda_alpha": 1e9, "lambda_beta": 1e9}, "skf")
_ONE_STEP = Limit({"dl": 1.0}, "once")
_UNIT = {"alpha": 1.0, "beta": 0.0, "kappa": 0}

FILTERS: dict[str, Entry] = Catalogue(
    "filters",
    {
        "kf": Entry(_HERE + "linear:kf", "aladkf-2020", "(3)-(7)", limits=(Limit({"reuse_gains": False}, "kf"),)),
        "hkf": Entry(_HERE + "linear:hkf", "aladkf-2020", "(9)-(11)", limits=(Limit({"threshold": 1e9}, "kf"),)),
        "aladkf": Entry(_HERE + "linear:aladkf", "aladkf-2020", "(23), (33), (37)-(39), (41)"),
        "clairvoyant_kf": Entry(_HERE + "linear:clairvoyant_kf", needs=frozenset({"record"})),
        "ekf": Entry(_HERE + "nonlinear:ekf", "pekf-2017", "(39)-(40)"),
        "ukf": Entry(_HERE + "nonlinear:ukf", limits=(Limit(_UNIT, "ckf"),)),
        "ckf": Entry(_HERE + "nonlinear:ckf"),
        "ddf": Entry(_HERE + "nonlinear:ddf"),
        "iekf": Entry(_HERE + "nonlinear:iekf", limits=(Limit({"iterations": 1}, "ekf"),)),
        "pekf": Entry(_HERE + "nonlinear:pekf", "pekf-2017", "(37)-(40)", limits=(Limit({"dl": 1.0}, "ekf"),)),
        "zero": Entry(_HERE + "nonlinear:zero"),
        "bayes": Entry(_HERE + "nonlinear:bayes"),
        "mckf": Entry(_HERE + "fpmcs:mckf", "fpmcs-2024", "(5)-(6), (16)", limits=(Limit({"sigma": inf}, "kf"),)),
        "ks": Entry(_HERE + "fpmcs:ks", "fpmcs-2024", "(17)-(24) with C = I"),
        "fpmcs": Entry(_HERE + "fpmcs:CorrentropySmoother", "fpmcs-2024", "(16), (20)-(24)"),
        "pf": Entry(_HERE + "particle:pf", "fpmcs-2024", needs=frozenset({"streams"})),
        "ps": Entry(_HERE + "particle:ps", "fpmcs-2024", needs=frozenset({"streams"})),
        "fixed_point": Entry(_HERE + "smoothing:fixed_point", "fpmcs-2024", "(17)-(24)"),
        "rts": Entry(_HERE + "smoothing:rts"),
        "decoupled": Entry(_HERE + "decoupled:decoupled"),
        "hkf_regression": Entry(_HERE + "nrukf:hkf_regression", "nrukf-2012", "(8)-(16)", limits=(Limit(_OFF, "kf"),)),
        "hekf": Entry(_HERE + "nrukf:hekf", "nrukf-2012", "(8)-(16)", limits=(Limit(_OFF, {"moments": "taylor"}),)),
        "hukf": Entry(_HERE + "nrukf:hukf", "nrukf-2012", "(8)-(16)", limits=(Limit(_OFF, _UKF, "linear"),)),
        "hukf0": Entry(_HERE + "nrukf:hukf0", "nrukf-2012", "(23)-(24)", limits=(Limit(_OFF, _UKF, "linear"),)),
        "hddf": Entry(
            _HERE + "nrukf:hddf",
            "nrukf-2012",
            "(8)-(16)",
            limits=(Limit(_OFF, {"moments": "divided_difference"}, "linear"),),
        ),
        "nrukf_r": Entry(_HERE + "nrukf:nrukf_r", "nrukf-2012", "(25)-(36)", limits=(Limit(_OFF, _UKF),)),
        "nrukf_y": Entry(_HERE + "nrukf:nrukf_y", "nrukf-2012", "(25)-(33), (37)-(39)", limits=(Limit(_OFF, _UKF),)),
        "nrukf_r_it": Entry(_HERE + "nrukf:nrukf_r_it", limits=(Limit(_OFF, _UKF),)),
        "nrukf_y_it": Entry(_HERE + "nrukf:nrukf_y_it", limits=(Limit(_OFF, _UKF),)),
        "swap": Entry(_HERE + "nrukf:Swap"),
        "quantised": Entry(_HERE + "quantised:quantised"),
        "skf": Entry(_HERE + "adaptive:skf", "daf", "(1)-(2), (7)"),
        "sdf": Entry(
            _HERE + "adaptive:SimplifiedDualFactorFilter", "daf", "(3)-(10), reconstructed", limits=(_FACTORS_OFF,)
        ),
        "raf": Entry(_HERE + "adaptive:RobustAdaptiveFilter", "daf", "scheme 3, reconstructed", limits=(_FACTORS_OFF,)),
        "daf": Entry(_HERE + "adaptive:DualFactorFilter", "daf", "(3)-(10), reconstructed", limits=(_FACTORS_OFF,)),
        "kf_clair": Entry(_HERE + "references:kf_clair", needs=frozenset({"flags"})),
        "truth": Entry(_HERE + "references:Truth", needs=frozenset({"truth"})),
        "estimates": Entry(_HERE + "estimates:Estimates", needs=frozenset({"file"})),
    },
)
MOMENTS: dict[str, Entry] = {
    "linear": Entry(_HERE + "moments:Linear"),
    "taylor": Entry(_HERE + "moments:Taylor"),
    "unscented": Entry(_HERE + "sigma:Unscented", limits=(Limit(_UNIT, "cubature"),)),
    "cubature": Entry(_HERE + "sigma:Cubature"),
    "divided_difference": Entry(_HERE + "sigma:DividedDifference"),
}
WEIGHTS: dict[str, Entry] = Catalogue(
    "weights",
    {
        "none": Entry(_HERE + "weights:Plain"),
        "huber": Entry(_HERE + "weights:Huber", "aladkf-2020", "(9)-(11)"),
        "least_absolute": Entry(_HERE + "weights:LeastAbsolute", "aladkf-2020", "(37)-(38)"),
        "correntropy": Entry(_HERE + "correntropy:Correntropy", "fpmcs-2024", "(2), (6)"),
        "residual_huber": Entry(_HERE + "residual_weights:ResidualHuber", "nrukf-2012", "(34)-(36)"),
        "pseudo_observation": Entry(_HERE + "residual_weights:PseudoObservation", "nrukf-2012", "(37)-(39)"),
    },
)
SCHEMES: dict[str, Entry] = {
    "once": Entry(_HERE + "schemes:Once"),
    "progressive": Entry(_HERE + "schemes:Progressive", "pekf-2017", "(37)-(38)", limits=(_ONE_STEP,)),
    "tempered": Entry(_HERE + "schemes:Tempered", "pekf-2017", "(2)", limits=(_ONE_STEP,)),
    "inflated": Entry(_HERE + "schemes:Inflated", limits=(_ONE_STEP,)),
    "iterated": Entry(_HERE + "schemes:Iterated", limits=(Limit({"iterations": 1}, "once"),)),
    "flow": Entry(_HERE + "flow:Flow", "pekf-2017", "(35)"),
    "graded": Entry(_HERE + "flow:Graded", "pekf-2017", "(35)"),
    "joseph": Entry(_HERE + "joseph:Joseph", "fpmcs-2024", "(6)"),
    "regression": Entry(_HERE + "regression:Regression", "nrukf-2012", "(8)-(16)"),
    "reweighted": Entry(_HERE + "residual_weights:Reweighted"),
}
