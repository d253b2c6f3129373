import pytest

from rkfbench.errors import ScenarioError, SpecError, UsageError
from rkfbench.scenario import load, load_paper
from rkfbench.scenario.display import metrics_in
from rkfbench.scenario.files import papers
from rkfbench.scenario.names import known_names

TEXT = """\
cite: A journal 1, 2000
scenarios: [contamination-rates]
headline: [a1]
claims:
  - id: a1
    says: the first is larger
    ordering: {metric: rmse, filters: [kf, hkf]}
"""


@pytest.fixture
def paper(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def load_changed(old: str = "", new: str = "", **options):
        assert old in TEXT
        (tmp_path / "p.yaml").write_text(TEXT.replace(old, new, 1))
        return load_paper("p.yaml", **options)

    return load_changed


def test_a_paper_file_is_read(paper) -> None:
    assert paper().claims[0].id == "a1"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cite:", "cit:", r"^p\.yaml:1:1: cit: unknown key \(did you mean 'cite'\?\)"),
        (
            "metric: rmse",
            "metrik: rmse",
            r"p\.yaml:7:16: claims\.a1\.ordering\.metrik: unknown key \(did you mean 'metric'",
        ),
        ("says: the first is larger", "says: 3", r"p\.yaml:6:11: claims\.a1\.says: should be a valid string"),
    ],
)
def test_faults_are_told_where_they_stand(paper, old, new, message) -> None:
    with pytest.raises(ScenarioError, match=message):
        paper(old, new)


def test_further_faults_are_located_too(paper) -> None:
    with pytest.raises(ScenarioError, match=r"^p\.yaml:7:39: claims\.a1\.ordering\.filters: nothing like it"):
        paper(more=lambda paper: [SpecError("nothing like it", ("claims", 0, "ordering", "filters"))])


def test_an_unknown_paper_is_an_error() -> None:
    with pytest.raises(UsageError, match="no paper file 'none'"):
        load_paper("none")


@pytest.mark.parametrize("name", papers())
def test_every_bundled_paper_file_is_valid(name) -> None:
    assert load_paper(name).claims


def test_the_printed_tables_that_navigation_shows_name_what_it_measures() -> None:
    scenario, paper = load("navigation"), load_paper("fpmcs-2024")
    known = known_names(scenario.cells, [])
    for table in (paper.tables[each.paper] for each in scenario.tables if each.paper):
        for row in table.rows:
            for column, _ in table.numbers(row):
                cell = table.cell(row, column)
                assert cell["filter"] in known["filter"]
                assert all(name in known["metric"] or name == "time_ms" for name in metrics_in(cell["metric"]))
