"""The fonts of PDF files: of each only the letters that a figure uses.

To take them out of a whole font was a sixth of the time of all figures. So each process takes the letters that figures
use out of it once, and those of a single figure out of these. Matplotlib does this by `fontTools.subset` and has no
option for how: inside `small()` it finds our `Subsetter` there.
"""

from __future__ import annotations

import io
import string
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from fontTools import subset
from fontTools.subset import Subsetter as Original
from fontTools.ttLib.sfnt import SFNTReader

UNUSED = ("GSUB", "GPOS", "GDEF", "kern")  # tables for ligatures and kerning: in a PDF every letter has its place
LETTERS = string.digits + string.ascii_letters + string.punctuation + " −–…×·±≤≥∞√αβδθκλμνξρσφψΔΣΦΨ"


@dataclass(frozen=True)
class Font:
    """A font file with some of the letters of another one: its content, and the number here of each number there."""

    content: bytes
    number: dict[int, int]


class Subsetter(Original):
    """Takes letters out of a font, by way of a font of the letters that were asked for so far."""

    fonts: ClassVar[dict[str, Font]] = {}  # by the file of the whole font

    def subset(self, font: Any) -> None:
        """Leave in `font` the letters that are asked for; `glyph_index_map` has the new number of each."""
        self.options.drop_tables += UNUSED
        asked: set[int] = self.glyph_ids_requested  # type: ignore[has-type]
        if self.unicodes_requested or self.glyph_names_requested or not asked:
            super().subset(font)
            return
        path = font.reader.file.name
        few = self.fonts.get(path)
        if few is None or not asked <= few.number.keys():
            few = self.fonts[path] = self._font(path, {*asked, *(few.number if few else ())})
        _replace(font, few.content)
        self.glyph_ids_requested = {few.number[i] for i in asked}
        super().subset(font)
        was = {number: i for i, number in few.number.items()}
        self.glyph_index_map: dict[int, int] = {was[i]: new for i, new in self.glyph_index_map.items()}

    def _font(self, path: str, asked: set[int]) -> Font:
        out, of_all = io.BytesIO(), Original(self.options)
        of_all.populate(gids=asked, text=LETTERS)
        with subset.load_font(path, self.options) as whole:
            of_all.subset(whole)
            whole.save(out, reorderTables=False)
        return Font(out.getvalue(), of_all.glyph_index_map)


def _replace(font: Any, content: bytes) -> None:
    """Let an open font, of which nothing was changed, be that of another file."""
    font.reader.close()
    font.reader = SFNTReader(io.BytesIO(content))
    font.tables.clear()
    vars(font).pop("glyphOrder", None)


@contextmanager
def small() -> Iterator[None]:
    """Meanwhile embedded fonts are made by our `Subsetter`."""
    subset.Subsetter = Subsetter
    try:
        yield
    finally:
        subset.Subsetter = Original
