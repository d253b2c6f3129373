from __future__ import annotations

import re
from dataclasses import replace

import pytest

from rkfbench.report import entries, latex, tables
from rkfbench.report.material import Material
from rkfbench.report.words import METRICS
from rkfbench.scenario.display import Table


def text(table: Table, material: Material, **changes: object) -> str:
    """The first sheet as LaTeX; changes: of the sheet."""
    first = tables.layouts(table, entries.of(table, material), decimals=2)[0]
    return latex.tables(table, [replace(first, **changes)], "fake")  # type: ignore[arg-type]


def test_latex_is_escaped_and_uses_booktabs(material: Material) -> None:
    found = text(Table(id="t", title=r"50 % of R_1 & {a\b} ~ ^2 #$", paper="table-1"), material)
    assert r"50 \% of R\_1 \& \{a\textbackslash{}b\} \textasciitilde{} \textasciicircum{}2 \#\$." in found
    assert r"\begin{tabular}{lrrr}" in found
    assert found.index(r"\toprule") < found.index(r"\midrule") < found.index(r"\bottomrule")
    assert r"\quad\textit{paper} & \textit{4.10} & \textit{1.50} &  \\" in found
    assert found.count("{") == found.count("}")
    assert found.isascii()


def test_the_packages_are_named_in_the_first_line(material: Material) -> None:
    assert text(Table(id="t", paper="table-1"), material).startswith("% needs \\usepackage{booktabs}\n")


def test_labels_are_those_of_scenario_table_and_reading(material: Material) -> None:
    assert r"\label{tab:fake-errors-literal}" in text(Table(id="errors", metric="err_norm"), material)


def test_a_missing_number_is_a_dash_outside_mathematics(material: Material) -> None:
    unknown = entries.Entry("", "x", "KF", "", "", "", "mean", *[None] * 7)
    line = tables.Line("x", (unknown,))
    assert "x & -- \\\\" in text(Table(id="t", metric="err_norm"), material, headings=("KF",), lines=(line,))


@pytest.mark.parametrize("start", ["[cond]", "*"])
def test_the_end_of_a_row_does_not_read_the_beginning_of_the_next(start: str, material: Material) -> None:
    found = text(Table(id="t", metric="err_norm"), material, lines=(tables.Line(start, ()),))
    assert f"\n{{}}{start} \\\\" in found


def test_a_table_too_long_for_a_page_is_broken(material: Material) -> None:
    table = Table(id="t", metric="err_norm")
    assert "longtable" not in text(table, material, lines=(tables.Line("x", ()),) * latex.FLOAT)
    found = text(table, material, lines=(tables.Line("x", ()),) * (latex.FLOAT + 1))
    assert found.startswith("% needs \\usepackage{booktabs,longtable}\n")
    assert r"\begin{longtable}{lrrrr}" in found
    assert r"\begin{table}" not in found


def test_a_caption_is_one_paragraph_and_named_by_the_id_where_there_is_no_title(material: Material) -> None:
    found = text(Table(id="lost_runs", caption="One.\n\nTwo.", metric="err_norm"), material)
    assert r"\caption{Lost runs. One. Two. Mean of" in found


def test_signs_that_pdflatex_would_misread_or_not_know_are_commands() -> None:
    assert latex.escape("a < b > c | d") == r"a $<$ b $>$ c \textbar{} d"
    assert latex.escape("‖ε‖ ≤ 2 ± 1") == r"$\Vert$$\varepsilon$$\Vert$ $\le$ 2 $\pm$ 1"
    assert latex.escape("a → b² · 10⁻³ – x₁") == (
        r"a $\rightarrow$ b\textsuperscript{2} $\cdot$ 10\textsuperscript{-}\textsuperscript{3} -- x\textsubscript{1}"
    )
    assert all(latex.escape(name).isascii() for name in METRICS.values())
    assert latex.escape("Kálmán") == "Kálmán"  # letters of known scripts need nothing
    assert all(re.fullmatch(r"\$.+\$", latex.escape(letter)) for letter in "αβγδεζηθικλμνξοπρσςτυφχψωΓΔΘΛΞΠΣΥΦΨΩ")
