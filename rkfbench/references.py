"""References: the exact answer, the trivial one, and filters that know more than a filter may.

They are drawn beside the filters that a study compares and are not compared themselves. What a filter is decides, not
how somebody labels it.
"""

from collections.abc import Mapping
from typing import Any

REFERENCES = frozenset({"clairvoyant_kf", "kf_clair", "bayes", "zero", "truth"})


def is_reference(filt: Any) -> bool:
    """Whether a filter, by its name in the catalogue or its description in a scenario, is a reference or is put around
    one, as a smoother around the clairvoyant Kalman filter.
    """
    if isinstance(filt, str):
        return filt in REFERENCES
    if not isinstance(filt, Mapping):
        return False
    names = [filt["use"]] if "use" in filt else filt
    around = [each["filter"] for each in (filt, *filt.values()) if isinstance(each, Mapping) and "filter" in each]
    return any(map(is_reference, (*names, *around)))
