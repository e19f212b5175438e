"""Turns, warm-up and budgets, with a clock that only the timed functions move."""

import pytest

from tex_lightning.studies import timing
from tex_lightning.studies.timing import interleaved


class Clock:
    """Seconds that pass when a function says so; remembers who was called."""

    def __init__(self):
        self.now = 0.0
        self.calls = []

    def perf_counter(self):
        return self.now

    def lasting(self, name, *seconds):
        """A function that takes the seconds given, the last of them ever after."""
        remaining = list(seconds)

        def function():
            self.calls.append(name)
            self.now += remaining.pop(0) if len(remaining) > 1 else remaining[0]

        return function


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    return clock


def test_functions_take_turns_after_a_warm_up_that_does_not_count(clock):
    functions = {"a": clock.lasting("a", 9.0, 9.0, 1.0), "b": clock.lasting("b", 2.0)}
    timings = interleaved(functions, repeats=3, warm_up=2)
    assert clock.calls == ["a", "a", "b", "b", "a", "b", "a", "b", "a", "b"]
    assert (timings["a"].median, timings["a"].p95, len(timings["a"].calls)) == (1000.0, 1000.0, 3)
    assert timings["b"].median == 2000.0


def test_a_quick_function_is_called_until_its_slice_is_spent(clock):
    functions = {"slow": clock.lasting("slow", 8.0), "quick": clock.lasting("quick", 0.25)}
    timings = interleaved(functions, repeats=2, warm_up=0, slice_s=1.0)
    assert (len(timings["slow"].calls), len(timings["quick"].calls)) == (2, 8)


def test_the_budget_ends_the_rounds_but_not_before_the_least(clock):
    function = clock.lasting("a", 1.0)
    assert len(interleaved({"a": function}, 100, 0, budget_s=10)["a"].calls) == 11
    assert len(interleaved({"a": function}, 100, 0, budget_s=0)["a"].calls) == 3
    assert len(interleaved({"a": function}, 2, 0, budget_s=0)["a"].calls) == 2
