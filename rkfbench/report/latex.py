"""Tables as LaTeX: what `\\input` puts into a paper, and pdflatex compiles in whatever encoding its fonts have.

What plain text may hold is written with commands where the old font encoding has another sign in its place (`<`, `|`)
or where `inputenc` does not know the character; letters with accents it knows.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from rkfbench.report.entries import Entry
from rkfbench.report.numbers import SUPERSCRIPT
from rkfbench.report.tables import Sheet, title
from rkfbench.scenario.display import Table

FLOAT = 36  # rows; a longer table and its caption may not fit a page
_MATHS = {
    "<": "<", ">": ">", "±": r"\pm", "×": r"\times", "·": r"\cdot", "−": "-", "∞": r"\infty", "≤": r"\le", "≥": r"\ge",
    "≠": r"\ne", "≈": r"\approx", "≡": r"\equiv", "∝": r"\propto", "∈": r"\in", "√": r"\surd", "∑": r"\sum",
    "∏": r"\prod", "∂": r"\partial", "∇": r"\nabla", "‖": r"\Vert", "∥": r"\Vert", "→": r"\rightarrow",
    "←": r"\leftarrow", "↔": r"\leftrightarrow", "⇒": r"\Rightarrow", "⊤": r"\top",
    "α": r"\alpha", "β": r"\beta", "γ": r"\gamma", "δ": r"\delta", "ε": r"\varepsilon", "ϵ": r"\epsilon",
    "ζ": r"\zeta", "η": r"\eta", "θ": r"\theta", "ϑ": r"\vartheta", "ι": r"\iota", "κ": r"\kappa", "λ": r"\lambda",
    "μ": r"\mu", "ν": r"\nu", "ξ": r"\xi", "ο": "o", "π": r"\pi", "ρ": r"\rho", "σ": r"\sigma",
    "ς": r"\varsigma", "τ": r"\tau", "υ": r"\upsilon", "φ": r"\varphi", "ϕ": r"\phi", "χ": r"\chi", "ψ": r"\psi",
    "ω": r"\omega", "Γ": r"\Gamma", "Δ": r"\Delta", "Θ": r"\Theta", "Λ": r"\Lambda", "Ξ": r"\Xi", "Π": r"\Pi",
    "Σ": r"\Sigma", "Υ": r"\Upsilon", "Φ": r"\Phi", "Ψ": r"\Psi", "Ω": r"\Omega",
}  # fmt: skip
_COMMANDS = str.maketrans(
    {character: "\\" + character for character in "&%$#_{}"}
    | {character: f"${command}$" for character, command in _MATHS.items()}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "|": r"\textbar{}"}
    | {"–": "--", "—": "---", "⁺": r"\textsuperscript{+}"}
    | {chr(raised): rf"\textsuperscript{{{chr(plain)}}}" for plain, raised in SUPERSCRIPT.items()}
    | {subscript: rf"\textsubscript{{{digit}}}" for digit, subscript in enumerate("₀₁₂₃₄₅₆₇₈₉")}
)


def tables(table: Table, sheets: Sequence[Sheet], scenario: str) -> str:
    """The sheets of a scenario's table, each a float in the style of the booktabs package, or a longtable."""
    long = any(_rows(sheet) > FLOAT for sheet in sheets)
    packages = "booktabs,longtable" if long else "booktabs"
    return "\n".join([rf"% needs \usepackage{{{packages}}}", *(_sheet(table, sheet, scenario) for sheet in sheets)])


def escape(plain: str) -> str:
    """Plain text as LaTeX."""
    return plain.translate(_COMMANDS)


def _rows(sheet: Sheet) -> int:
    return sum(1 + len(line.beneath) for line in sheet.lines)


def _sheet(table: Table, sheet: Sheet, scenario: str) -> str:
    head = _row("", map(escape, sheet.headings))
    body = []
    for line in sheet.lines:
        body.append(_row(escape(line.heading), ("" if cell is None else _cell(cell) for cell in line.cells)))
        for heading, cells in line.beneath:
            italic = (rf"\textit{{{escape(number)}}}" if number else "" for number in cells)
            body.append(_row(rf"\quad\textit{{{escape(heading)}}}", italic))
    said = " ".join(part for part in (f"{title(table)}.", table.caption, sheet.note) if part)
    label = "-".join(part for part in (scenario, table.id, re.sub(r"[^A-Za-z0-9]+", "-", sheet.reading)) if part)
    caption = rf"\caption{{{escape(' '.join(said.split()))}}}\label{{tab:{label}}}"
    columns = f"l{'r' * len(sheet.headings)}"
    if _rows(sheet) > FLOAT:
        first = [rf"{caption} \\", r"\toprule", head, r"\midrule", r"\endfirsthead"]
        later = [r"\toprule", head, r"\midrule", r"\endhead", r"\bottomrule", r"\endfoot"]
        lines = [rf"\begin{{longtable}}{{{columns}}}", *first, *later, *body, r"\end{longtable}"]
    else:
        inside = [r"\toprule", head, r"\midrule", *body, r"\bottomrule"]
        frame = [rf"\begin{{tabular}}{{{columns}}}", *inside, r"\end{tabular}"]
        lines = [r"\begin{table}", r"\centering", caption, *frame, r"\end{table}"]
    return "\n".join([*lines, ""])


def _row(heading: str, cells: Iterable[str]) -> str:
    """A row; `[` or `*` at its beginning would be read as belonging to the end of the one before."""
    start = "{}" if heading.startswith(("[", "*")) else ""
    return start + " & ".join([heading, *cells]) + r" \\"


def _cell(entry: Entry) -> str:
    return f"{entry.written.tex()} ({escape(entry.note)})" if entry.note else entry.written.tex()
