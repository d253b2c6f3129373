from __future__ import annotations

import threading

import pytest

from rkfbench.aside import Aside


def test_calls_are_made_in_their_order_beside_the_main_work() -> None:
    done: list[int] = []
    go = threading.Event()

    def first() -> None:
        assert go.wait(30)
        done.append(1)

    with Aside(1) as aside:
        aside(first)
        aside(lambda: done.append(2))
        assert done == []
        go.set()
        aside.wait()
        assert done == [1, 2]


def test_without_a_thread_a_call_is_made_at_once() -> None:
    done: list[int] = []
    with Aside(0) as aside:
        aside(lambda: done.append(1))
        assert done == [1]


def test_with_two_threads_one_call_need_not_wait_for_another() -> None:
    done: list[int] = []
    go = threading.Event()

    def first() -> None:
        assert go.wait(30)
        done.append(1)

    def second() -> None:
        done.append(2)
        go.set()

    with Aside(2) as aside:
        aside(first)
        aside(second)
    assert done == [2, 1]


@pytest.mark.parametrize("threads", [0, 1, 2])
def test_what_a_call_raises_is_raised_at_the_end(threads: int) -> None:
    with pytest.raises(ZeroDivisionError), Aside(threads) as aside:
        aside(lambda: print(1 // 0))


@pytest.mark.parametrize(("error", "expected"), [(ValueError, [1, 2]), (KeyboardInterrupt, [1])])
def test_an_error_waits_for_all_calls_and_an_interruption_drops_those_that_have_not_begun(
    error: type[BaseException], expected: list[int]
) -> None:
    done: list[int] = []
    begun, go = threading.Event(), threading.Event()
    aside = Aside(1)

    def first() -> None:
        begun.set()
        assert go.wait(30)
        done.append(1)

    def ended() -> None:
        with aside:
            aside(first)
            aside(lambda: done.append(2))
            assert begun.wait(30)
            if error is ValueError:
                go.set()
            raise error

    with pytest.raises(error):
        ended()
    go.set()
    assert aside._threads is not None
    aside._threads.shutdown()
    assert done == expected
