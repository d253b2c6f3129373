"""Random streams: what a draw depends on, and what it does not."""

from __future__ import annotations

import numpy as np
from scipy import stats

from rkfbench.streams import GROUP, Streams


def test_groups_can_be_drawn_together_or_one_by_one():
    both = Streams(7, first=3, groups=2).normal("coin", 5, 2)
    one = [Streams(7, first=i).normal("coin", 5, 2) for i in (3, 4)]
    assert np.array_equal(both, np.concatenate(one, axis=-1))


def test_the_first_steps_of_a_longer_draw_are_the_shorter_draw():
    draw = Streams(7)
    for kind in (draw.normal, draw.uniform, draw.exponential):
        assert np.array_equal(kind("a", 20, 3)[:5], kind("a", 5, 3))


def test_seed_purpose_scope_and_group_each_give_another_stream():
    base = Streams(7).normal("a", 4)
    others = [
        Streams(8).normal("a", 4),
        Streams(7).normal("b", 4),
        Streams(7).within("x").normal("a", 4),
        Streams(7, 1).normal("a", 4),
    ]
    assert all(not np.allclose(base, other) for other in others)
    assert base.shape == (4, GROUP)


def test_draws_follow_their_laws():
    draw = Streams(1, groups=40)
    for kind, law in ((draw.normal, "norm"), (draw.uniform, "uniform"), (draw.exponential, "expon")):
        assert stats.kstest(kind("test", 10).ravel(), law).pvalue > 1e-4
