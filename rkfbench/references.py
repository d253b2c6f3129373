"""References: the exact answer, the trivial one, and filters that know more than a filter may.

They are drawn beside the filters that a study compares and are not compared themselves.
"""

STARTS = ("clairvoyant", "kf_clair", "bayes", "zero", "truth", "optimal")


def is_reference(name: str) -> bool:
    """Whether a label, or the name of a filter in the catalogue, is that of a reference or a variant of one."""
    return name.lower().startswith(STARTS)
