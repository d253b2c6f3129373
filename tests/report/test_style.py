from __future__ import annotations

import subprocess
import sys

import matplotlib
import pytest

from rkfbench.report import style


def test_a_known_filter_looks_the_same_in_every_scenario() -> None:
    assert style.looks(["hkf", "kf"])["kf"] == style.looks(["kf", "mine", "other"])["kf"] == style.FILTERS["kf"]


def test_no_two_filters_look_alike_but_the_two_names_of_one() -> None:
    looks = [*style.SPARE, *(look for name, look in style.FILTERS.items() if name != "dd2")]
    assert len(set(looks)) == len(looks)


PAPERS = [
    ("kf", "hkf", "aladkf"),
    ("ekf", "ukf", "ckf", "pekf", "tempered", "inflated", "iterated", "flow"),
    ("kf", "mckf", "fpmcs", "ks", "pf", "ps"),
    (
        "ekf",
        "ukf",
        "dd2",
        "hukf",
        "hukf0",
        "hddf",
        "nrukf_r",
        "nrukf_y",
        "nrukf_r_it",
        "nrukf_y_it",
        "ukf_match",
        "hekf",
    ),
    ("skf", "sdf", "raf", "daf"),
]


@pytest.mark.parametrize("filters", PAPERS, ids=lambda names: names[-1])
def test_within_a_paper_every_filter_differs_in_more_than_colour(filters: tuple[str, ...]) -> None:
    looks = style.looks(filters)
    assert len({(look.marker, str(look.dash)) for look in looks.values()}) == len(filters)


def test_unknown_filters_take_spare_looks_in_their_order() -> None:
    looks = style.looks(["first", "second"])
    assert (looks["first"], looks["second"]) == style.SPARE[:2]


def test_unknown_filters_take_the_colours_that_the_known_ones_leave() -> None:
    looks = style.looks(["ekf", "mine", "ukf", "hekf", "yours"])
    assert len({look.colour for look in looks.values()}) == 5


def test_variants_of_an_unknown_filter_share_a_look_as_those_of_a_known_one_do() -> None:
    names = {"studentt[dof=3]": "my.py:studentt", "studentt[dof=9]": "my.py:studentt", "vbakf": "my.py:vbakf"}
    looks = style.looks(["ekf", *names, *names.values()], names)
    base = looks["my.py:studentt"]
    assert looks["studentt[dof=3]"] == style.variant(base, 0, 2)
    assert looks["studentt[dof=9]"] == style.variant(base, 1, 2)
    assert looks["vbakf"] == looks["my.py:vbakf"]
    assert len({looks["ekf"].colour, base.colour, looks["vbakf"].colour}) == 3


def test_variants_of_a_filter_put_together_from_parts_belong_to_their_label() -> None:
    labels = ["tempered", "tempered[dl=0.5]", "tempered[dl=0.2]"]
    looks = style.looks(labels, {label: label for label in labels})
    assert looks["tempered"] == style.FILTERS["tempered"]
    assert looks["tempered[dl=0.5]"] == style.variant(looks["tempered"], 0, 2)


def test_references_are_grey_without_marker_and_told_apart_by_their_dash() -> None:
    looks = style.looks(["clairvoyant_kf", "kf", "zero"])
    assert {looks[name].colour for name in ("clairvoyant_kf", "zero")} == {style.GREY}
    assert looks["clairvoyant_kf"].reference
    assert looks["clairvoyant_kf"].dash != looks["zero"].dash


def test_a_filter_that_is_labelled_like_a_reference_is_none() -> None:
    labels = ["optimal_hkf", "zero_lag", "exact"]
    looks = style.looks([*labels, "bayes"], dict(zip(labels, ("hkf", "kf", "bayes"), strict=True)))
    assert [looks[label].reference for label in (*labels, "bayes")] == [False, False, True, True]
    looks = style.looks(["zero", "kf"], {"zero": "zero"}, references=())
    assert not looks["zero"].reference


def test_variants_of_a_filter_go_from_dark_to_light_and_leave_the_filter_its_own_look() -> None:
    labels = ["hkf", "hkf[threshold=0.5]", "hkf[threshold=1]", "hkf[threshold=3]"]
    looks = style.looks(labels, dict.fromkeys(labels, "hkf"))
    brightness = [sum(int(looks[label].colour[i : i + 2], 16) for i in (1, 3, 5)) for label in labels[1:]]
    assert looks["hkf"] == style.FILTERS["hkf"]
    assert brightness == sorted(brightness)
    assert len({looks[label].marker for label in labels[1:]}) == 3


def test_names_are_those_of_the_field() -> None:
    assert style.display_name("aladkf") == "ALADKF"
    assert style.display_name("fpmcs[sigma=1]") == "FP-MCS, sigma = 1"
    assert style.display_name("clairvoyant_ks") == "clairvoyant KS"
    assert style.display_name("my_filter") == "my filter"


def test_a_label_that_begins_or_ends_with_an_underscore_is_shown_as_it_is_written() -> None:
    assert style.display_name("complex_[threshold=1]") == "complex_, threshold = 1"
    assert style.display_name("_my_own") == "_my_own"


def test_settings_of_the_caller_do_not_matter_and_are_not_touched() -> None:
    with matplotlib.rc_context({"lines.linewidth": 9.0}):
        with style.styled():
            assert matplotlib.rcParams["lines.linewidth"] == style.SETTINGS["lines.linewidth"]
        assert matplotlib.rcParams["lines.linewidth"] == 9.0


def test_importing_the_report_does_not_import_matplotlib_and_drawing_does_not_import_pyplot() -> None:
    code = (
        "import sys, rkfbench.report.page as page\n"
        "assert 'matplotlib' not in sys.modules, 'matplotlib at import'\n"
        "from rkfbench.report import forest, style\n"
        "with style.styled(): style.png(forest.draw([]))\n"
        "assert 'matplotlib.pyplot' not in sys.modules, 'pyplot'\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
