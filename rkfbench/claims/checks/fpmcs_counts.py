"""Operation counts of the FP-MCS paper, Table 1 and (29)-(31), in exact integers; the inverses O(m^3) are left
symbolic, as printed.

N is the number of smoothing steps. A, B, D are the sums of the rows of MCKF, of one step of FP-MCS and of one step of
KS; m divisions go with (16-3).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

from rkfbench.claims.checks import Check, Outcome

Count = Callable[[int, int], int]

ROWS: dict[str, Count] = {  # n, m -> additions, subtractions and multiplications as printed
    "(16-1)": lambda n, m: 2 * n**2 + 4 * n * m - n,
    "(16-2)": lambda n, m: 2 * n**3 + 2 * m**3 + 4 * n**2 * m + 6 * m**2 * n - n**2 - m**2 - 4 * n * m,
    "(16-3)": lambda n, m: 2 * n * m + m,
    "(16-4)": lambda n, m: 4 * n**3 + 2 * n**2 * m - 2 * n**2,
    "(20-1)": lambda n, m: 2 * n**2 + 4 * n * m - n,
    "(20-2)": lambda n, m: 4 * n * m,
    "FP (22-1)": lambda n, m: 2 * n**3 + 8 * m**2 * n + 4 * n**2 * m - n**2 - 5 * n * m,
    "FP (22-2)": lambda n, m: 8 * m**2 * n + 4 * n**2 * m - 5 * n * m,
    "KS (22-1)": lambda n, m: 2 * n**3 + 4 * m**2 * n + 4 * n**2 * m - n**2 - 3 * n * m,
    "KS (22-2)": lambda n, m: 4 * m**2 * n + 4 * n**2 * m - 3 * n * m,
    "(24-2)": lambda n, m: 2 * n**3 + 2 * n**2 * m - n**2,
    "(24-4)": lambda n, m: 4 * n**2 * m - n * m,
}


def _product(p: int, q: int, r: int) -> int:
    """Operations of a dense product (p x q)(q x r)."""
    return p * r * (2 * q - 1)


RECOUNTED: dict[str, Count] = {  # rows whose count is unambiguous
    "(16-1)": lambda n, m: _product(n, n, 1) + _product(m, n, 1) + m + _product(n, m, 1) + n,
    "(16-4)": lambda n, m: _product(n, m, n) + n * n + 2 * _product(n, n, n) + n * n,
    "(20-1)": lambda n, m: _product(n, n, 1) + _product(m, n, 1) + m + _product(n, m, 1) + n,
    "(20-2)": lambda n, m: _product(m, n, 1) + m + _product(n, m, 1) + n,
    "(24-2)": lambda n, m: _product(n, m, n) + n * n + _product(n, n, n),
    "(24-4)": lambda n, m: _product(n, n, m) + _product(n, m, n) + n * n,
}


def total_29(n: int, m: int) -> int:
    """(29), MCKF."""
    return 6 * n**3 + 2 * m**3 + 6 * n**2 * m - n**2 + 6 * m**2 * n - m**2 + 2 * n * m - n + 2 * m


def total_30(n: int, m: int, N: int) -> int:
    """(30), FP-MCS."""
    cubic = (4 * N + 6) * n**3 + 2 * m**3 + (14 * N + 6) * n**2 * m - n**2
    return cubic + (16 * N + 6) * m**2 * n - m**2 + m - (3 * N - 2) * n * m


def total_31(n: int, m: int, N: int) -> int:
    """(31), KS."""
    cubic = (4 * N + 6) * n**3 + 2 * m**3 + (14 * N + 6) * n**2 * m - n**2
    return cubic + (8 * N + 6) * m**2 * n - m**2 - (1 + N) * n + (2 + N) * n * m + m


def sums(n: int, m: int) -> tuple[int, int, int]:
    """A, B, D: the rows of MCKF, of a step of FP-MCS and of a step of KS, with the divisions."""
    rows = {name: count(n, m) for name, count in ROWS.items()}
    A = rows["(16-1)"] + rows["(16-2)"] + rows["(16-3)"] + rows["(16-4)"] + m
    shared = rows["(20-1)"] + rows["(20-2)"] + rows["(24-2)"] + rows["(24-4)"]
    B = rows["(16-3)"] + m + shared + rows["FP (22-1)"] + rows["FP (22-2)"]
    return A, B, shared + rows["KS (22-1)"] + rows["KS (22-2)"]


def sum_30(n: int, m: int, N: int, covariance: bool = False) -> int:
    """A + N B, the rows behind (30); with `covariance` each step also has (24-1), which no row counts, at the cost of
    (16-4).
    """
    A, B, _ = sums(n, m)
    return A + N * (B + covariance * ROWS["(16-4)"](n, m))


def sum_31(n: int, m: int, N: int, weights: bool = True, covariance: bool = False) -> int:
    """A + N D, the rows behind (31); without `weights` A is without (16-3) and its divisions; `covariance` as above."""
    A, _, D = sums(n, m)
    base = A if weights else A - ROWS["(16-3)"](n, m) - m
    return base + N * (D + covariance * ROWS["(16-4)"](n, m))


SIZES = [*product(range(2, 9), range(1, 5))]
LENGTHS = (1, 10, 100, 101, 1000)
MCKF, KS, FPMCS = 6.58, 8.41, 10.92  # printed times at sigma = 1, s


def rows_29() -> Outcome:
    """(29) is the sum of the rows of Table 1."""
    worst = max(abs(total_29(n, m) - sums(n, m)[0]) for n, m in SIZES)
    return Outcome(worst, 0.0, f"n = 2..8, m = 1..4; n = 4, m = 2: {total_29(4, 2)} against {sums(4, 2)[0]}")


def rows_30() -> Outcome:
    """(30) is A + N B."""
    worst = max(abs(total_30(n, m, N) - sum_30(n, m, N)) for (n, m), N in product(SIZES, LENGTHS))
    return Outcome(worst, 0.0, f"n = 4, m = 2, N = 100: {total_30(4, 2, 100)} against {sum_30(4, 2, 100)}")


def rows_31(weights: bool) -> Outcome:
    """(31) is A + N D, with the rows of the weights in A or without them."""
    worst = max(abs(total_31(n, m, N) - sum_31(n, m, N, weights)) for (n, m), N in product(SIZES, LENGTHS))
    return Outcome(worst, 0.0, f"n = 4, m = 2, N = 100: {total_31(4, 2, 100)} against {sum_31(4, 2, 100, weights)}")


def recount() -> Outcome:
    """The rows of Table 1 are those of dense products: largest difference at n = 4, m = 2."""
    off = {name: ROWS[name](4, 2) - count(4, 2) for name, count in RECOUNTED.items()}
    text = ", ".join(f"{name} off by {value}" for name, value in off.items() if value) or "none is off"
    return Outcome(max(map(abs, off.values())), 0.0, f"six rows; {text}")


def order_of_costs() -> Outcome:
    """By the printed totals FP-MCS costs more than MCKF, and KS less than FP-MCS, and by the printed times as well:
    number of sizes, and of times, where not.
    """
    cases = [*product(SIZES, LENGTHS)]
    wrong = sum(not total_29(n, m) < total_31(n, m, N) < total_30(n, m, N) for (n, m), N in cases)
    return Outcome(
        wrong + (not MCKF < KS < FPMCS),
        0.0,
        f"{len(cases)} sizes; n = 4, m = 2, N = 1000: KS / FP-MCS = {total_31(4, 2, 1000) / total_30(4, 2, 1000):.3f}",
    )


def counts_and_times() -> Outcome:
    """The ratio FP-MCS / MCKF of the printed times (sigma = 1) is that of the counts, 900 filter steps and 101
    smoothing steps: relative difference.
    """
    A, B, _ = sums(4, 2)
    counted, timed = (900 * A + 101 * (B + ROWS["(16-4)"](4, 2))) / (1000 * A), FPMCS / MCKF
    printed = total_30(4, 2, 1000) / (1000 * total_29(4, 2))
    return Outcome(
        abs(counted / timed - 1),
        0.25,
        f"counted {counted:.2f}, (30) over 1000 steps of (29) {printed:.2f}, printed times {timed:.2f}",
    )


CHECKS: dict[str, Check] = {
    "C11": rows_29,
    "C12": rows_30,
    "C13": lambda: rows_31(weights=True),
    "C13-without-weights": lambda: rows_31(weights=False),
    "C14": recount,
    "C15": order_of_costs,
    "C15-times": counts_and_times,
}
