"""Tables that no results enter: counts that follow from formulas, each under the name that a scenario gives as
`computed`.

A function gives its cells as (heading of the row, heading of the column, integer).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

Cell = tuple[str, str, int]

SIZES = ((4, 2), (6, 3))  # n, m: the example of the FP-MCS paper, and another one
LENGTHS = (1, 10, 100, 101, 1000)  # N, smoothing steps
QUANTITIES = {
    "(16-1)": "prior mean", "(16-2)": "gain L", "(16-3)": "weights C", "(16-4)": "covariance P",
    "(20-1)": "prior mean", "(20-2)": "x_j", "(22-1)": "gain L", "(22-2)": "gain lambda", "(24-2)": "Sigma",
    "(24-4)": "Pi",
}  # fmt: skip


def operation_counts() -> Iterator[Cell]:
    """Table 1 of the FP-MCS paper: its rows as printed, those that are unambiguous counted anew, and the sums A, B, D
    of the rows of MCKF, of a step of FP-MCS and of one of KS.
    """
    from rkfbench.claims.checks.fpmcs_counts import RECOUNTED, ROWS, sums

    for n, m in SIZES:
        printed, recounted, difference = _columns("printed", "recounted", "difference", at=f"n = {n}, m = {m}")
        for name, count in ROWS.items():
            row = f"{name} {QUANTITIES[name.split(' ', 1)[-1]]}"
            yield row, printed, count(n, m)
            if name in RECOUNTED:
                yield row, recounted, RECOUNTED[name](n, m)
                yield row, difference, count(n, m) - RECOUNTED[name](n, m)
        for row, total in zip(("A: MCKF", "B: a step of FP-MCS", "D: a step of KS"), sums(n, m), strict=True):
            yield row, printed, total


def operation_totals() -> Iterator[Cell]:
    """(29)-(31) of the FP-MCS paper as printed beside the sums of the rows of its Table 1, these also with (24-1)."""
    from rkfbench.claims.checks import fpmcs_counts as counts

    for n, m in SIZES:
        at = f"n = {n}, m = {m}: "
        yield from _total(f"{at}(29) MCKF", counts.total_29(n, m), counts.sums(n, m)[0])
        for N in LENGTHS:
            sums = (counts.sum_30(n, m, N, covariance=each) for each in (False, True))
            yield from _total(f"{at}(30) FP-MCS, N = {N}", counts.total_30(n, m, N), *sums)
        for base, weights in (("A", True), ("A without (16-3)", False)):
            for N in LENGTHS:
                sums = (counts.sum_31(n, m, N, weights, covariance=each) for each in (False, True))
                yield from _total(f"{at}(31) KS from {base}, N = {N}", counts.total_31(n, m, N), *sums)


COMPUTED: Mapping[str, Callable[[], Iterator[Cell]]] = {
    "operation_counts": operation_counts,
    "operation_totals": operation_totals,
}


def _columns(*headings: str, at: str) -> Iterator[str]:
    return (f"{at}: {heading}" for heading in headings)


def _total(row: str, printed: int, *sums: int) -> Iterator[Cell]:
    """A printed total beside the sum of its rows, and if given the sum with (24-1)."""
    yield row, "printed", printed
    for total, heading in zip(sums, ("sum of rows", "with (24-1)"), strict=False):
        yield row, heading, total
        yield row, f"printed − {heading}", printed - total
