"""What `rkfbench tune` writes: the sensitivity curves and the choices as CSV, and one figure of both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rkfbench.report import style
from rkfbench.report.words import PLAIN
from rkfbench.store import files
from rkfbench.study.axes import WIDE, Axis
from rkfbench.study.tune import Score, Tuned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLACE = ("reading", "case", "filter", "metric")
NAMES = ("curves.csv", "chosen.csv", "curves.png", "curves.pdf")
STATISTICS = ("runs", "failed", "mean", "se", "sd", "median", "q05", "q95", "max")
CURVE = (*PLACE, "parameter", "value", *STATISTICS)
CAPTION = (
    "Dots: mean over the tuning runs, band or bars: ± 2 standard errors; the other parameters have the values chosen. "
    "Line: the value chosen. Diamonds: mean over the test runs with ± 2 standard errors, filled: as chosen, open: as "
    "before."
)
LETTERS = 17  # of the caption, an inch
BESIDE = (0.12, 0.24)  # where the test runs stand beside a category, in distances of two


def write(folder: Path, found: Sequence[Tuned], label: str, metric: str) -> list[Path]:
    """Write curves.csv, chosen.csv, curves.png and curves.pdf; the files written."""
    files.write_records(folder / "curves.csv", CURVE, _curves(found, label, metric))
    rows = list(choices(found, label, metric))
    files.write_records(folder / "chosen.csv", list(rows[0]), rows)
    with style.styled():
        drawn = draw(found, label, metric)
        files.write(folder / "curves.png", style.png(drawn))
        drawn.set_layout_engine("none")
        files.write(folder / "curves.pdf", style.pdf(drawn))
    return [folder / name for name in NAMES]


def choices(found: Sequence[Tuned], label: str, metric: str) -> Iterator[dict[str, Any]]:
    """Two rows a case: the setting that the filter had and the one chosen, on the test runs; with the paired
    difference.
    """
    for each in found:
        for name, setting, score in (
            ("before", each.before, each.test_before),
            ("chosen", each.chosen, each.test_chosen),
        ):
            mean, se = each.difference if name == "chosen" else (None, None)
            yield {
                **_place(each, label, metric),
                "setting": name,
                **setting,
                **_statistics(score),
                "difference": mean,
                "difference_se": se,
            }


def _curves(found: Sequence[Tuned], label: str, metric: str) -> Iterator[dict[str, Any]]:
    for each in found:
        for path, curve in each.curves.items():
            for value, score in curve:
                yield {**_place(each, label, metric), "parameter": path, "value": value, **_statistics(score)}


def _place(each: Tuned, label: str, metric: str) -> dict[str, str]:
    return dict(zip(PLACE, (each.cell.reading, each.cell.case, label, metric), strict=True))


def _statistics(score: Score) -> dict[str, Any]:
    return {name: score.row[name] for name in STATISTICS}


def draw(found: Sequence[Tuned], label: str, metric: str) -> Figure:
    """One panel for each case and parameter (inside `style.styled()`)."""
    import textwrap

    from matplotlib.figure import Figure

    panels = [(each, path) for each in found for path in each.curves]
    wide = len(found[0].curves) if len(found[0].curves) > 1 else min(len(panels), 3)
    rows = -(-len(panels) // wide)
    width = 2.6 * wide + 1.4
    caption = textwrap.wrap(CAPTION, int(LETTERS * width))
    height = 2.4 * rows + 0.2 + 0.16 * len(caption)
    sheet = Figure(figsize=(width, height), layout="constrained")
    axes = sheet.subplots(rows, wide, squeeze=False, sharey="row").ravel()
    look = style.looks([label])[label]
    for spare in axes[len(panels) :]:
        spare.set_visible(False)
    for ax, (each, path) in zip(axes, panels, strict=False):
        _panel(ax, each, path, look)
        ax.set_title(PLAIN.case(each.cell.case))
        ax.set_xlabel(path)
    for ax in axes[::wide]:
        ax.set_ylabel(f"{PLAIN.metric(metric)} of {style.display_name(label)}")
    sheet.supxlabel("\n".join(caption), fontsize=7.5, color="#333333", x=0.01, ha="left")
    return sheet


def _panel(ax: Axes, each: Tuned, path: str, look: style.Look) -> None:
    """A curve with its band over numbers; over categories, which have nothing between them, dots with bars."""
    curve = each.curves[path]
    values = [value for value, _ in curve]
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    places = values if numbers else list(range(len(values)))
    if not numbers:
        ax.set_xticks(places, [str(value) for value in values])
        ax.set_xlim(-0.5, len(values) - 0.5)
    elif min(values) > 0 and max(values) > WIDE * min(values):
        ax.set_xscale("log")
    means, errors = zip(*(_mean(score) for _, score in curve), strict=True)
    if numbers:
        ax.plot(places, means, color=look.colour, marker=".")
        low, high = ([m + sign * 2 * e for m, e in zip(means, errors, strict=True)] for sign in (-1, 1))
        ax.fill_between(places, low, high, color=look.colour, alpha=0.15, linewidth=0)
    else:
        ax.errorbar(places, means, [2 * e for e in errors], color=look.colour, marker=".", linestyle="")
    at = dict(zip(values, places, strict=True))
    ax.axvline(at[each.chosen[path]], color=look.colour, linewidth=0.8, linestyle=style.DOTTED)
    for setting, score, face, aside in (
        (each.chosen, each.test_chosen, look.colour, BESIDE[0]),
        (each.before, each.test_before, "white", BESIDE[1]),
    ):
        place = setting[path] if numbers else at.get(setting[path])
        if place is not None:
            mean, error = _mean(score)
            ax.errorbar(
                place if numbers else place + aside,
                mean,
                2 * error,
                color=look.colour,
                marker="D",
                markerfacecolor=face,
                zorder=4,
            )


def _mean(score: Score) -> tuple[float, float]:
    row = score.row
    return (float("nan") if row[name] is None else row[name] for name in ("mean", "se"))  # type: ignore[return-value]


def sentence(each: Tuned, axes: Sequence[Axis]) -> str:
    """The choice for one case, and what to watch."""
    chosen = ", ".join(f"{path} = {_short(value)}" for path, value in each.chosen.items())
    best = "largest" if each.test_chosen.better == "large" else "smallest"
    text = f"{each.cell.case or 'the only case'}: {chosen} (the {best} mean of {each.tried} settings tried)"
    if ends := each.at_the_end(axes):
        text += f"; {', '.join(ends)} is at the end of its range: a wider --over may find a better one"
    return text


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
