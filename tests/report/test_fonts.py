"""The fonts of PDF files: the letters are those of the whole font, whatever was drawn before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import pytest
from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure

from rkfbench.report import fonts, style

DEJAVU = Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"


@pytest.fixture(autouse=True)
def nothing_drawn_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fonts.Subsetter, "fonts", {})


def shape(font: Any, number: int) -> tuple[Any, ...]:
    """The outline of a letter and its width."""
    name = font.getGlyphName(number)
    points, ends, flags = font["glyf"][name].getCoordinates(font["glyf"])
    return list(points), list(ends), list(flags), font["hmtx"][name]


@pytest.mark.parametrize("earlier", ["", "aé", "ŁØ"])
def test_letters_keep_their_shapes(earlier: str) -> None:
    options = subset.Options(glyph_names=True, recommended_glyphs=True)
    with TTFont(DEJAVU) as whole:
        letters = whole.getBestCmap()
        for text in filter(None, (earlier, "R²ασé 0.5")):
            asked = {whole.getGlyphID(letters[ord(letter)]) for letter in text}
            few = fonts.Subsetter(options)
            few.populate(gids=asked)
            with subset.load_font(str(DEJAVU), options) as font:
                few.subset(font)
                for old in asked:
                    assert shape(font, few.glyph_index_map[old]) == shape(whole, old)
                assert len(font.getGlyphOrder()) < len(text) + 10


def drawn(text: str) -> bytes:
    with style.styled():
        figure = Figure()
        figure.text(0.5, 0.5, text)
        return style.pdf(figure)


def test_equal_figures_are_equal_files_whatever_was_drawn_before() -> None:
    alone = drawn("RMSE of $x_k$")
    drawn("Łódź, Ærø, 1 ½")
    assert drawn("RMSE of $x_k$") == alone
    assert subset.Subsetter is fonts.Original


def test_a_font_that_is_asked_for_by_characters_is_reduced_at_once() -> None:
    few = fonts.Subsetter(subset.Options())
    few.populate(text="ab")
    with subset.load_font(str(DEJAVU), few.options) as font:
        few.subset(font)
        assert set(font.getBestCmap()) == {ord("a"), ord("b")}
    assert not fonts.Subsetter.fonts
