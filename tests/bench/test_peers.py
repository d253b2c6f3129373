"""Every implementation that is installed computes what ours computes; nothing here depends on a clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rkfbench.bench import kernels, peers
from rkfbench.bench.measure import Different, deviation, made_ready, problem_of
from rkfbench.bench.peers import MODULES, ours
from rkfbench.bench.peers.base import Peer, Task
from rkfbench.bench.problems import altitude, linear

OURS = {peer.filter: peer for peer in ours.PEERS}
PEERS = [peer for module in MODULES if module is not ours for peer in module.PEERS]
MISSING = {peer.name: module.missing() for module in MODULES for peer in module.PEERS}


def small(name: str):
    """Few runs, not a multiple of the vectors of C; more for a comparison in distribution."""
    return problem_of(name, *((60, 4) if name == "pf" else (11, 8)))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # other libraries use each other's old names
@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: f"{peer.name}-{peer.filter}")
def test_a_peer_has_our_means(peer):
    if MISSING[peer.name]:
        pytest.skip(f"{peer.name}: {MISSING[peer.name]}")
    problem = small(peer.filter)
    one = made_ready(peer, problem)
    assert one.means.shape == (problem.steps, len(problem.x0), one.timed)
    assert deviation(one, made_ready(OURS[peer.filter], problem), problem) <= (
        5 if peer.filter == "pf" else peer.tolerance
    )


@pytest.mark.parametrize("name", ["kf", "pf"])
def test_one_that_computes_something_else_is_refused(name):
    problem = small(name)
    wrong = Peer("wrong", name, lambda p: Task(lambda: p.x + 1, lambda means: means))
    with pytest.raises(Different, match="wrong"):
        deviation(made_ready(wrong, problem), made_ready(OURS[name], problem), problem)


def test_one_that_gives_no_numbers_is_refused():
    problem = small("kf")
    wrong = Peer("wrong", "kf", lambda p: Task(lambda: p.x * np.nan, lambda means: means))
    with pytest.raises(Different):
        deviation(made_ready(wrong, problem), made_ready(OURS["kf"], problem), problem)


@pytest.mark.parametrize("make", [linear, altitude])
def test_the_first_runs_of_a_wide_problem_are_the_narrow_problem(make):
    wide, narrow = make(140, 3), make(2, 3)
    np.testing.assert_array_equal(wide.first(2).y, narrow.y)
    np.testing.assert_array_equal(wide.first(2).x, narrow.x)


def test_no_bearing_comes_near_its_cut():
    assert (np.abs(altitude(200, 100).y[:, 0]) < 3).all()


def test_a_peer_that_is_not_there_is_left_out_with_a_reason(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert peers.absent()["C"] == "no C compiler"
    assert {peer.name for peer in peers.peers(["kf"])} >= {"rkfbench"}
    assert "C" not in {peer.name for peer in peers.peers(["kf"])}


def test_a_compiler_that_refuses_is_a_reason_too(monkeypatch, tmp_path):
    (tmp_path / "cc").write_text("#!/bin/sh\necho no such processor >&2\nexit 1\n")
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    monkeypatch.setattr(kernels, "library", kernels.library.__wrapped__)
    assert "no such processor" in peers.absent()["C"]


def test_a_loop_is_timed_on_few_runs():
    loop = replace(OURS["kf"], most=2)
    assert made_ready(loop, linear(5, 3)).timed == 2
