"""What a benchmark writes, from made-up times and from a real small one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rkfbench.bench import measure, report
from rkfbench.bench.__main__ import main
from rkfbench.bench.measure import Cost
from rkfbench.bench.peers import FILTERS, MODULES
from rkfbench.store.files import read_records


def cost(peer: str, cpu: list[float]) -> Cost:
    return Cost("kf", peer, 100, 100, 50, np.array(cpu), np.array(cpu) + 1, 0.0, 0.0)


def test_ratios_are_of_minima_and_their_range_round_by_round():
    ours, other = report.records([cost("rkfbench", [10, 20, 40]), cost("C", [5, 5, 4])])
    assert (ours["ratio"], ours["cpu_ns"], ours["wall_ns"]) == (1, 10, 11)
    assert other["ratio"] == pytest.approx(0.4)
    assert (other["ratio_q25"], other["ratio_q75"]) == pytest.approx((0.175, 0.375))
    assert report.cell(other) == "4 (0.4; 0.17–0.38)"


def test_the_summary_shows_our_cost_and_the_multiples_of_it():
    costs = [
        replace(cost(peer, [ns]), runs=runs) for runs in report.SHOWN for peer, ns in (("rkfbench", 8.0), ("C", 2.0))
    ]
    rows = list(report.records(costs))
    assert report.summary(rows).splitlines() == [
        "|  | rkfbench, ns | C |",
        "| --- | ---: | ---: |",
        "| KF, one covariance for all runs | 8 / 8 | 0.25 / 0.25 |",
    ]
    assert "## Multiples" in report.markdown(rows, {}, [0, 0])
    assert "## Multiples" not in report.markdown(rows[:2], {}, [0, 0])


def test_every_filter_has_a_title_and_every_peer_a_look():
    assert set(report.TITLES) == set(FILTERS)
    assert set(report.LOOKS) == {peer.name for module in MODULES for peer in module.PEERS}


def test_times_are_scaled_to_one_run_and_step(monkeypatch):
    monkeypatch.setattr(measure, "_seconds", lambda call, often: (2e-3, 4e-3))
    found = list(measure.measure(["pekf"], [2], rounds=2))
    steps = {each.steps * each.timed for each in found}
    assert all(np.allclose(each.cpu * each.steps * each.timed, 2e6) and len(each.cpu) == 2 for each in found)
    assert all(np.allclose(each.wall, 2 * each.cpu) for each in found)
    assert steps == {200}


def test_a_benchmark_writes_table_page_and_figure(tmp_path, capsys):
    arguments = ["--filters", "kf", "aladkf", "--sizes", "1", "9", "--rounds", "1", "--slice", "1e-6"]
    main([*arguments, "--out", str(tmp_path / "bench")])
    written = [Path(line) for line in capsys.readouterr().out.split()]
    assert [path.name for path in written] == ["bench.csv", "bench.md", "bench.png", "bench.pdf"]
    rows = read_records(written[0])
    assert {(row["filter"], row["runs"]) for row in rows} == {(f, m) for f in ("kf", "aladkf") for m in (1, 9)}
    assert all(row["ratio"] == 1 for row in rows if row["peer"] == "rkfbench")
    page = written[1].read_text()
    assert "| rkfbench |" in page and "M = 9" in page
    assert str(tmp_path) not in page and str(Path.home()) not in page
    assert all(path.stat().st_size > 5000 for path in written[2:])


@pytest.mark.parametrize("wrong", [["--rounds", "0"], ["--sizes", "0"], ["--filters", "kv"]])
def test_wrong_arguments_are_refused(wrong, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(wrong)
    assert stopped.value.code == 2
    assert wrong[0] in capsys.readouterr().err
