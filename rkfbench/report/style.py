"""One look for all figures: which colour, marker and line a filter has everywhere, and how a figure becomes a file.

Colours are those of Okabe and Ito, chosen to be told apart by colour-blind readers; as some look alike in grey, every
filter also has its own marker and dash. References, which know more than a filter may, are thin grey dashes. The
variants of one filter (`hkf[threshold=0.5]`) keep its colour, from dark to light in the order of the scenario.

Matplotlib is used without pyplot and its settings are changed only inside `styled()`, so that a program that calls
rkfbench keeps its own. Equal data gives equal bytes: no date and no version is written into a file.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

from rkfbench.references import is_reference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
GREY = "#767676"
SOLID, DASHED, DOTTED, DASHDOT, LONG = "-", (0, (4, 1.6)), (0, (1.2, 1.2)), (0, (5, 1.5, 1.2, 1.5)), (0, (8, 2))
HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "----", "++++", "oooo")


@dataclass(frozen=True)
class Look:
    """How one filter is drawn."""

    colour: str
    marker: str
    dash: Any = SOLID
    reference: bool = False


FILTERS: dict[str, Look] = {
    "kf": Look(BLACK, "o"), "hkf": Look(BLUE, "s", DASHED), "aladkf": Look(RED, "^"),
    "ekf": Look(ORANGE, "v", DASHDOT), "ukf": Look(SKY, "D", DASHED), "ckf": Look(GREEN, "P", LONG),
    "ddf": Look(PURPLE, "<", DASHDOT), "dd2": Look(PURPLE, "<", DASHDOT), "pekf": Look(RED, "o"),
    "tempered": Look(BLUE, "X", DASHED), "inflated": Look(PURPLE, ">", DOTTED), "iterated": Look(GREEN, "h", DOTTED),
    "flow": Look(BLACK, "*", LONG),
    "mckf": Look(BLUE, "D"), "fpmcs": Look(RED, ">"), "ks": Look(BLACK, "s", DASHED),
    "pf": Look(GREEN, "v", DASHDOT), "ps": Look(ORANGE, "P", LONG),
    "hukf": Look(BLUE, "s"), "hukf0": Look(BLUE, "d", DOTTED), "hddf": Look(GREEN, "X", DASHDOT),
    "nrukf_r": Look(RED, "p"), "nrukf_y": Look(PURPLE, "^", LONG), "nrukf_r_it": Look(RED, "8", DASHED),
    "nrukf_y_it": Look(PURPLE, "p", DOTTED), "hekf": Look(BLACK, "s", DOTTED), "ukf_match": Look(BLACK, "*", DASHDOT),
    "skf": Look(BLACK, "d", LONG), "sdf": Look(SKY, "D", DASHDOT), "raf": Look(ORANGE, "^", DASHED),
    "daf": Look(RED, "*"), "hkf_regression": Look(PURPLE, "d", DASHED),
}  # fmt: skip

SPARE = tuple(
    Look(colour, marker, dash)
    for dash, markers in ((DASHDOT, "hp<>d8X"), (DOTTED, "*v^Ds<>"))
    for colour, marker in zip((PURPLE, GREEN, SKY, ORANGE, BLUE, RED, BLACK), markers, strict=True)
)
NAMES = {
    "fpmcs": "FP-MCS", "nrukf_r": "NRUKF-R", "nrukf_y": "NRUKF-Y", "nrukf_r_it": "NRUKF-R, iterated",
    "nrukf_y_it": "NRUKF-Y, iterated", "ukf_match": "UKF, matched R", "clairvoyant_kf": "clairvoyant KF",
    "clairvoyant_ks": "clairvoyant KS",
    "kf_clair": "KF told outliers",
    "tempered": "tempered EKF", "inflated": "inflated EKF", "iterated": "iterated EKF", "flow": "continuous flow",
    "bayes": "exact Bayes", "zero": "zero estimate", "hkf_regression": "HKF, regression",
}  # fmt: skip

SETTINGS: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 8.5, "axes.titlesize": 8.5, "axes.labelsize": 8.5,
    "axes.titlelocation": "left", "axes.titlepad": 5.0, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "legend.fontsize": 8.0, "legend.frameon": False, "legend.handlelength": 2.8, "legend.columnspacing": 1.6,
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.7, "axes.edgecolor": "#333333",
    "axes.grid": True, "grid.color": "#DDDDDD", "grid.linewidth": 0.5, "axes.axisbelow": True,
    "axes.formatter.useoffset": False, "axes.formatter.limits": (-3, 5),
    "xtick.major.width": 0.7, "ytick.major.width": 0.7, "xtick.color": "#333333", "ytick.color": "#333333",
    "lines.linewidth": 1.3, "lines.markersize": 4.5, "lines.markeredgewidth": 0.8, "hatch.linewidth": 0.5,
    "legend.borderaxespad": 0.2, "pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "rkfbench",
}  # fmt: skip
DPI = 160
COMPRESSION = 3  # of PNG files: 6, the usual one, takes twice as long and saves 2 %

_alone = threading.RLock()


def looks(
    labels: Sequence[str], names: Mapping[str, str] | None = None, references: Collection[str] | None = None
) -> dict[str, Look]:
    """The look of every filter of a scenario: `labels` in its order, `names` from label to the filter's own name,
    labels of `references` (None: as the names say).

    A known filter has its fixed look. The others take the spare ones in turn, first those in colours that no known
    filter here has, so that a scenario's figures agree.
    """
    families = {label: _family(label, (names or {}).get(label, label)) for label in labels}
    if references is None:
        references = [label for label in labels if is_reference((names or {}).get(label, label))]
    others = [label for label in labels if label not in references]
    taken = {look.colour for each in others if (look := FILTERS.get(each) or FILTERS.get(families[each]))}
    spare = cycle(sorted(SPARE, key=lambda look: look.colour in taken))
    of_family = dict(FILTERS)
    for label in others:
        if label not in FILTERS and families[label] not in of_family:
            of_family[families[label]] = next(spare)
    result: dict[str, Look] = {}
    for label in labels:
        family = families[label]
        if label in references:
            result[label] = Look(GREY, "", DASHED, reference=True)
        elif label in of_family:
            result[label] = of_family[label]
        else:
            siblings = [each for each in labels if families[each] == family and each not in of_family]
            result[label] = variant(of_family[family], siblings.index(label), len(siblings))
    for label, dash in zip(
        (each for each in labels if each in references), (DASHED, DOTTED, DASHDOT, LONG), strict=False
    ):
        result[label] = replace(result[label], dash=dash)
    return result


def _family(label: str, name: str) -> str:
    """The filter of which it may be a variant; one that is put together from parts has no name but its label."""
    return label.partition("[")[0] if name == label else name


def variant(look: Look, index: int, count: int) -> Look:
    """The look of one of `count` variants of a filter: its colour, dark to light, with a marker of its own."""
    share = index / (count - 1) if count > 1 else 0.5
    tint = 0.55 * (2 * share - 1)  # -0.55 towards black .. 0.55 towards white
    markers = look.marker + "".join(each for each in "osD^vPX" if each != look.marker)
    return replace(look, colour=blend(look.colour, tint), marker=markers[index % len(markers)])


def blend(colour: str, tint: float) -> str:
    """`colour` moved towards white (tint > 0) or black (tint < 0) by the share |tint|."""
    target = 255 if tint > 0 else 0
    parts = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(part + abs(tint) * (target - part)):02X}" for part in parts)


def display_name(label: str) -> str:
    """A filter's label as a reader sees it: `fpmcs[sigma=1]` -> `FP-MCS, sigma = 1`.

    A `_` that stands at an end (`complex_`) joins no words, and the label is as it is written.
    """
    base, _, parameters = label.partition("[")
    plain = base if base != base.strip("_") else base.replace("_", " ")
    name = NAMES.get(base) or (base.upper() if base in FILTERS else plain)
    return f"{name}, {parameters.rstrip(']').replace('=', ' = ').replace(',', ', ')}" if parameters else name


@contextmanager
def styled() -> Iterator[None]:
    """Matplotlib's own defaults and the settings above, whatever the user's are; undone at the end. One thread at a
    time: settings belong to the process.
    """
    import matplotlib
    import matplotlib.style

    with _alone, matplotlib.style.context(["default", SETTINGS]):
        yield


def png(figure: Figure, dpi: int = DPI) -> bytes:
    """A figure as PNG; equal figures give equal bytes.

    Drawn on the canvas itself: `savefig` would draw a figure with a layout engine twice, once to lay it out.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = io.BytesIO()
    figure.set_dpi(dpi)
    # the canvas on which it was laid out still knows how large each text is
    canvas = figure.canvas if type(figure.canvas) is FigureCanvasAgg else FigureCanvasAgg(figure)
    canvas.print_png(out, metadata={"Software": None}, pil_kwargs={"compress_level": COMPRESSION})
    return out.getvalue()


def pdf(figure: Figure) -> bytes:
    """A figure as PDF, with the letters that it uses embedded; equal figures give equal bytes."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    from rkfbench.report import fonts

    out = io.BytesIO()
    with fonts.small():
        FigureCanvasPdf(figure).print_pdf(out, metadata={"CreationDate": None, "Creator": "rkfbench", "Producer": None})
    return out.getvalue()
