"""How a number with its standard error is written: as many digits as the error supports, in plain text or LaTeX.

Two significant digits of the error decide: 2.48731 with error 0.01124 is `2.487 ± 0.011`. A value below its error keeps
two digits of its own, unless it is next to nothing beside it: 1662 with error 30010 is `1700 ± 30000`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

DIGITS = 4  # significant digits of a number without an error
NOTHING = 0.01  # of the error: a smaller value is shown as 0
MOST_DIGITS = 7  # an error below 1e-7 of the number is rounding, and shown as 0
LARGE, SMALL = 1e6, 1e-4  # beyond these a power of ten is split off
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Written:
    """A number in words: digits, those of its error, and a power of ten that belongs to both."""

    value: str
    error: str = ""
    exponent: int = 0

    def text(self) -> str:
        body = f"{self.value} ± {self.error}" if self.error else self.value
        if not self.exponent:
            return body
        return (f"({body})" if self.error else body) + "·10" + str(self.exponent).translate(SUPERSCRIPT)

    def tex(self) -> str:
        value = self.value.replace("∞", r"\infty").replace("−", "-")
        if value in ("nan", "–"):  # no numbers, so outside mathematics
            return value.replace("–", "--")
        body = rf"{value} \pm {self.error}" if self.error else value
        if self.exponent:
            body = (f"({body})" if self.error else body) + rf" \times 10^{{{self.exponent}}}"
        return f"${body}$"


def written(value: float, error: float | None = None) -> Written:
    """`value` with as many digits as its standard error supports; without one, four significant digits."""
    if not math.isfinite(value):
        return Written("nan" if math.isnan(value) else "∞" if value > 0 else "−∞")
    known = error is not None and math.isfinite(error)
    size = max(abs(value), error if known and error is not None else 0.0)
    exponent = math.floor(math.log10(size)) if size and not SMALL <= size < LARGE else 0
    value *= 10.0**-exponent
    if not known or error is None:
        return Written(fixed(value, _decimals(value, DIGITS)), "", exponent)
    error *= 10.0**-exponent
    if error <= abs(value) * 10.0**-MOST_DIGITS:
        return Written(fixed(value, _decimals(value, MOST_DIGITS - 1)), "0", exponent)
    decimals = _decimals(error, 2)
    own = _decimals(value, 2) if NOTHING * error < abs(value) < error else decimals
    return Written(fixed(value, own), fixed(error, decimals), exponent)


def fixed(value: float, decimals: int) -> str:
    """Fixed-point digits; a negative number of decimals rounds to tens, hundreds ..., minus signs are true ones."""
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    if not text.strip("-0."):
        text = text.lstrip("-")
    return text.replace("-", "−")


def as_printed(value: float, decimals: int | None) -> str:
    """A number as the paper prints it."""
    return fixed(value, decimals) if decimals is not None else f"{value:.10g}".replace("-", "−")


def _decimals(value: float, digits: int) -> int:
    """Decimals that show `value` with so many significant digits; rounding up to the next power of ten is seen."""
    if value == 0:
        return 0
    rounded = float(f"{abs(value):.{digits - 1}e}")
    return digits - 1 - math.floor(math.log10(rounded))
