"""What the components of a history are: measurement components, states, or one number.

A filter that others wrote may show what it likes: of a name that is not here, the number of components decides.
"""

from __future__ import annotations

from collections.abc import Sequence

from rkfbench.models import Model

OF_MEASUREMENT = frozenset({"nu", "S", "inflation", "weight", "alpha", "u_alpha"})
OF_STATE = frozenset({"state_weight", "beta"})  # or one number, where one serves all states
NUMBERS = frozenset({"lambda", "last_change", "u_beta", "u_simplified", "evaluations", "ess", "distinct"})


def of_measurement(name: str, length: int, observed: int) -> bool:
    """Whether an axis of this length runs over the measurement components, of which so many are `observed`."""
    return name in OF_MEASUREMENT or (length == observed and name not in OF_STATE | NUMBERS)


def components(name: str, length: int, model: Model) -> Sequence[str]:
    """Names for the `length` components of a history: those of the measurements or states, "" of one number, else
    numbers.
    """
    if name in OF_MEASUREMENT:
        return model.measurements
    if name in NUMBERS:
        return [""]
    known = [model.states] if name in OF_STATE else [model.measurements, model.states]
    numbers = [""] if length == 1 else [str(j) for j in range(length)]
    return next((names for names in known if len(names) == length), numbers)
