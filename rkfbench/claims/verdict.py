"""The one rule for all verdicts: an interval against a claimed region.

Interval: estimate +- c se, c the quantile of Student's t with M - 1 degrees of freedom at tail probability
0.05 / (2 N), N the size of the family (Bonferroni). t and not the normal: a standard error is itself estimated from
the M runs; at M = 1000 it costs nothing, at ten runs it is the difference between 95 % and 92 %. Shares of runs and
win probabilities have exact (Clopper-Pearson) intervals, which stay right at 0 and 1. A sum or difference of shares is
sum v p_v, p_v the share of runs in which it is v: each of its n terms has a Clopper-Pearson interval at tail/n, and
their sum misses the true value with no more than the tail in all, whatever the dependence (conservative). So runs that
were lost by neither filter, or by both, say how rare the others must be, and not that there are none. A share that
counts ties one half is 1/2 + (wins - losses)/(2 M), such a sum; only whether it is above or below 1/2 can be judged
given the number of ties, by the sign test. Standard deviations and their ratios have an interval of their logarithm,
estimate exp(+- c se/estimate): the law of a sample variance is skewed, and far out in its tails, where families are
judged, the symmetric interval is much too short. A least eigenvalue has an interval from two numbers that bound it.

Inside the region: reproduced. Outside: not reproduced. Else inconclusive, as is everything without a standard error
(one run, NaN). With se = 0 (all runs agree exactly) the estimate alone decides; on the very edge of an open region
(`a > b` when a equals b in every run) it lies outside.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import exp, inf, isfinite, isnan, nan, sqrt
from typing import Literal

LEVEL = 0.95  # of a family
RESOLUTION = 25.0  # %: a replication interval coarser than this decides nothing
MOST = 700.0  # exp of it is about the largest number
RUNS_CAP = 1_000_000  # more runs than this are nobody's plan

Holds = Literal["all", "any"]
Verdict = Literal["reproduced", "not reproduced", "inconclusive", "not testable", "unsupported", "not run", "shown"]


@dataclass(frozen=True)
class Region:
    """The claimed values: low to high; `open` leaves out the edges."""

    low: float = -inf
    high: float = inf
    open: bool = False

    def holds(self, low: float, high: float) -> bool:
        """Whether all of the interval lies inside."""
        return (low > self.low and high < self.high) if self.open else (low >= self.low and high <= self.high)

    def excludes(self, low: float, high: float) -> bool:
        """Whether all of the interval lies outside."""
        return (high <= self.low or low >= self.high) if self.open else (high < self.low or low > self.high)

    @property
    def edges(self) -> set[float]:
        """The finite ones."""
        return {edge for edge in (self.low, self.high) if isfinite(edge)}

    def __str__(self) -> str:
        if self.low == -inf:
            return f"{'<' if self.open else '<='} {self.high:.6g}"
        if self.high == inf:
            return f"{'>' if self.open else '>='} {self.low:.6g}"
        return f"in [{self.low:.6g}, {self.high:.6g}]"


ANYWHERE = Region()


@dataclass(frozen=True)
class Measured:
    """What the runs say about an estimand: all that a verdict needs, and all that is stored.

    `law` says how the interval is made: "t" from se; "share" from the exact law of a share with `ties` runs that count
    one half; "shares" from those of `terms`, pairs (v, number of runs) with estimate = sum v number/runs; "log" from se
    by the logarithm; "least" from se below `floor` and above the estimate; "exact" for numbers without chance.
    """

    estimate: float
    se: float
    runs: int
    law: Literal["t", "share", "shares", "log", "least", "exact"] = "t"
    ties: int = 0
    scale: float = nan  # the level of what was compared, to give margins in %
    terms: tuple[tuple[float, int], ...] = ()
    floor: float = nan  # of a least eigenvalue: an estimate that lies below it in the mean

    @property
    def freedom(self) -> int:
        """How many runs the standard error is made from: for a least eigenvalue one half, the other has chosen."""
        return self.runs // 2 if self.law == "least" else self.runs

    def at(self, runs: int) -> Measured:
        """What another number of runs would measure if the estimate stayed: se falls like 1/sqrt(runs)."""
        if self.law == "exact":
            return self
        ratio = runs / self.runs
        terms = tuple((value, round(count * ratio)) for value, count in self.terms)
        floor = self.estimate - (self.estimate - self.floor) / sqrt(ratio)
        se, ties = self.se / sqrt(ratio), round(self.ties * ratio)
        return replace(self, se=se, runs=runs, ties=ties, terms=terms, floor=floor)


@dataclass(frozen=True)
class Printed:
    """A number printed in the paper: its value, the runs behind it, half a unit of its last digit."""

    value: float
    runs: int
    rounding: float = 0.0


@dataclass(frozen=True)
class Judgement:
    """A verdict with its interval and what the reader should see beside it."""

    verdict: Verdict
    lower: float
    upper: float
    c: float
    flip_at: float  # where an edge of the region would have to stand for the verdict to change
    flip: float  # how far that is from the edge, in the units of the estimate
    flip_percent: float  # the same in % of the level of what is compared
    runs_needed: int | None = None  # for inconclusive: runs that would decide, if any would
    resolution: float = nan  # of a replication interval: half-width in % of the printed value
    reason: str = ""


def judge(measured: Measured, region: Region, family: int = 1, printed: Printed | None = None) -> Judgement:
    """The verdict on one cell, by the rule above; with `printed` by the replication interval (see `replicate`)."""
    if printed is not None:
        return replicate(measured, printed, family)
    tail = (1 - LEVEL) / (2 * max(family, 1))
    lower, upper = interval(measured, tail, region)
    c = critical(tail, measured.freedom) if measured.law in ("t", "log", "least") else nan
    if isnan(lower) or isnan(upper):
        return Judgement("inconclusive", lower, upper, c, nan, nan, nan, None, nan, _why_not(measured))
    verdict = _place(lower, upper, region)
    edge, flip_at = _nearest_flip(lower, upper, region, verdict)
    flip = abs(flip_at - edge)
    needed = None
    if verdict == "inconclusive":
        needed = _least_runs(
            measured, lambda runs: _place(*interval(measured.at(runs), tail, region), region) != "inconclusive"
        )
    return Judgement(verdict, lower, upper, c, flip_at, flip, _percent(flip, measured.scale), needed)


def replicate(measured: Measured, printed: Printed, family: int = 1) -> Judgement:
    """Whether a printed number is compatible with ours: printed - ours against c sqrt(se^2 + se_paper^2).

    se_paper^2 = se^2 M / n_paper: for a mean it is sd^2 / n_paper. Half a unit of the last printed digit is added.
    Inside: reproduced, unless the half-width exceeds 25 % of the printed value. The interval that is returned is
    where the paper's number is expected.
    """
    tail = (1 - LEVEL) / (2 * max(family, 1))
    half, c = _replication_half(measured, printed, tail), critical(tail, measured.freedom)
    if isnan(half):
        return Judgement("inconclusive", nan, nan, c, nan, nan, nan, None, nan, _why_not(measured))
    lower, upper = measured.estimate - half, measured.estimate + half
    flip_at = lower if printed.value < measured.estimate else upper
    flip = abs(flip_at - printed.value)
    resolution = _percent(half, printed.value)
    verdict: Verdict = "reproduced" if lower <= printed.value <= upper else "not reproduced"
    reason, needed = "", None
    if verdict == "reproduced" and not resolution <= RESOLUTION:
        verdict, reason = "inconclusive", f"the interval is wider than {RESOLUTION:g} % of the printed value"
        fine = RESOLUTION / 100 * abs(printed.value)
        needed = _least_runs(measured, lambda runs: _replication_half(measured.at(runs), printed, tail) <= fine)
    return Judgement(verdict, lower, upper, c, flip_at, flip, _percent(flip, printed.value), needed, resolution, reason)


def combine(verdicts: Collection[Verdict], holds: Holds = "all") -> Verdict:
    """The verdict on a claim of several cells.

    all: it fails if one cell is outside and holds if all are inside. any: it holds if one cell is inside and fails if
    all are outside. In between it is inconclusive, or `not run` if a cell was not.
    """
    one: Verdict = "not reproduced" if holds == "all" else "reproduced"
    every: Verdict = "reproduced" if holds == "all" else "not reproduced"
    order: tuple[Verdict, ...] = ("unsupported", "not testable", one, "not run", "inconclusive", every)
    return next((verdict for verdict in order if verdict in verdicts), "not testable")


def decisive(cells: Sequence[tuple[Verdict, float]], holds: Holds = "all") -> int:
    """Which cell, (verdict, flip margin in % or NaN) each, decides a claim: of those with its verdict the extreme one.

    all: a claim that holds is as strong as its cell nearest to flipping, another one as its cell farthest from it. any:
    one that holds is as strong as its cell farthest from flipping, one that fails as its cell nearest to it.
    """
    verdict = combine([each for each, _ in cells], holds)
    margins = {i: 0.0 if isnan(margin) else margin for i, (each, margin) in enumerate(cells) if each == verdict}
    weakest = verdict == ("reproduced" if holds == "all" else "not reproduced")
    return (min if weakest else max)(margins, key=margins.__getitem__)


@lru_cache(maxsize=4096)
def critical(tail: float, runs: int) -> float:
    """The quantile of Student's t with runs - 1 degrees of freedom that is exceeded with probability `tail`."""
    from scipy.special import stdtrit

    return float(-stdtrit(runs - 1, tail)) if runs > 1 else nan


def interval(measured: Measured, tail: float, region: Region = ANYWHERE) -> tuple[float, float]:
    """The interval that misses the true value with probability `tail` on either side; NaN where there is none.

    With a `region` it is the one to judge against its edges, which matters for a share with ties.
    """
    if measured.law == "exact":
        return measured.estimate, measured.estimate
    if measured.law == "share" and measured.ties and region.edges != {0.5}:
        return _tied_interval(measured, tail)
    if measured.law == "share":
        return _share_interval(measured.estimate, measured.runs, measured.ties, tail)
    if measured.law == "shares":
        return _shares_interval(measured.terms, measured.runs, tail)
    certain = measured.se == 0 and measured.runs > 1
    half = 0.0 if certain else critical(tail, measured.freedom) * measured.se
    if measured.law == "log":
        factor = _exp(half / measured.estimate)
        return measured.estimate / factor, measured.estimate * factor
    low = min(measured.floor, measured.estimate) if measured.law == "least" else measured.estimate
    return low - half, measured.estimate + half


def _share_interval(share: float, runs: int, ties: int, tail: float) -> tuple[float, float]:
    """Clopper-Pearson for the share of wins among the runs that are no ties, carried over to share = wins + ties/2.

    Without ties this is exact. With ties it holds for their number as it is, which is right for the position against
    one half alone: that of the sign test. Without any decided run it says how rare wins and losses must be not to have
    shown up once.
    """
    from scipy.special import betaincinv

    if runs < 1 or isnan(share):
        return nan, nan
    decided = runs - ties
    if decided == 0:
        unseen = (1 - tail ** (1 / runs)) / 2
        return 0.5 - unseen, 0.5 + unseen
    wins = min(max(share * runs - ties / 2, 0.0), decided)
    losses = decided - wins
    low = float(betaincinv(wins, losses + 1, tail)) if wins > 0 else 0.0
    high = float(betaincinv(wins + 1, losses, 1 - tail)) if losses > 0 else 1.0
    return (low * decided + ties / 2) / runs, (high * decided + ties / 2) / runs


def _tied_interval(measured: Measured, tail: float) -> tuple[float, float]:
    """Of a share with a random number of ties: 1/2 + (share of wins)/2 - (share of losses)/2, a sum of shares."""
    wins = round(measured.estimate * measured.runs - measured.ties / 2)
    terms = ((0.5, wins), (-0.5, measured.runs - measured.ties - wins))
    low, high = _shares_interval(terms, measured.runs, tail)
    return 0.5 + low, 0.5 + high


def _shares_interval(terms: Collection[tuple[float, int]], runs: int, tail: float) -> tuple[float, float]:
    """sum v [low_v, high_v] over terms (v, number of runs), each share by Clopper-Pearson at tail/(number of terms)."""
    if runs < 1 or not terms:
        return nan, nan
    ends = [
        sorted(value * end for end in _share_interval(count / runs, runs, 0, tail / len(terms)))
        for value, count in terms
    ]
    return sum(low for low, _ in ends), sum(high for _, high in ends)


def _replication_half(measured: Measured, printed: Printed, tail: float) -> float:
    """Half-width of a replication interval on the printed side; of a share the two exact ones added in squares."""
    side = 1 if printed.value > measured.estimate else 0
    if measured.law != "share":
        both = replace(measured, se=measured.se * sqrt(1 + measured.runs / printed.runs))
        return abs(interval(both, tail)[side] - measured.estimate) + printed.rounding
    ours = interval(measured, tail)[side] - measured.estimate
    theirs = _share_interval(measured.estimate, printed.runs, 0, tail)[side] - measured.estimate
    return sqrt(ours**2 + theirs**2) + printed.rounding


def _place(lower: float, upper: float, region: Region) -> Verdict:
    if region.holds(lower, upper):
        return "reproduced"
    return "not reproduced" if region.excludes(lower, upper) else "inconclusive"


def _nearest_flip(lower: float, upper: float, region: Region, verdict: Verdict) -> tuple[float, float]:
    """The edge of the region that decides, and where it would have to stand for another verdict."""
    inside = [(region.low, lower), (region.high, upper)]
    outside = [(region.low, upper), (region.high, lower)]
    if verdict == "reproduced":
        moves = inside
    elif verdict == "not reproduced":
        moves = [outside[0] if upper <= region.low else outside[1]]
    else:  # an edge that lies within the interval may leave it on either side
        moves = [move for move in inside + outside if lower <= move[0] <= upper]
    finite = [(edge, to) for edge, to in moves if isfinite(edge)]
    return min(finite, key=lambda move: abs(move[1] - move[0])) if finite else (nan, nan)


def _least_runs(measured: Measured, decides: Callable[[int], bool]) -> int | None:
    """The least number of runs (to 2 %) at which the same estimate would decide; None if no affordable number would."""
    if not isfinite(measured.se) or measured.runs < 1 or not decides(RUNS_CAP):
        return None
    few, many = measured.runs, RUNS_CAP
    while many > few + max(1, few // 50):
        middle = round(sqrt(few * many)) if many > 1.5 * few else (few + many) // 2
        few, many = (few, middle) if decides(middle) else (middle, many)
    return many


def _exp(x: float) -> float:
    return exp(x) if x < MOST else inf


def _percent(part: float, whole: float) -> float:
    return 100 * part / abs(whole) if whole and isfinite(whole) else nan


def _why_not(measured: Measured) -> str:
    if isnan(measured.estimate):
        return "no number: no run without failure, or a value that is infinite or undefined"
    if measured.runs < 2:
        return "one run has no standard error"
    return "no standard error: the values are too few or not finite"
