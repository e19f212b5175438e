"""Ladders that end before a step becomes too long, with a clock that only the steps move."""

import pytest
import torch
from conftest import make_card

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import ProfileConfig
from tex_lightning.profiling import growth, timing
from tex_lightning.profiling.growth import Ladder, climb
from tex_lightning.profiling.subject import Subject


@pytest.fixture
def settings() -> ProfileConfig:
    return ProfileConfig(budget_s=1.0, max_seconds=1.0)


def ladder(monkeypatch, cost) -> tuple[Ladder, list[float]]:
    """Steps of 1, 2, 4, 8, 16 that take ``cost(value)`` seconds, and those that were tried."""
    now = [0.0]
    tried = []

    class Clock:
        @staticmethod
        def perf_counter() -> float:
            return now[0]

    def prepare(value):
        tried.append(value)

        def step():
            now[0] += cost(value)

        return step

    monkeypatch.setattr(timing, "time", Clock)
    monkeypatch.setattr(growth, "time", Clock)
    return Ladder("size", "haptic", "label", (1.0, 2.0, 4.0, 8.0, 16.0), prepare), tried


def test_what_would_take_too_long_is_never_tried_and_has_a_note(monkeypatch, settings):
    steps, tried = ladder(monkeypatch, lambda value: 0.2 * value)
    points = climb(steps, settings)
    assert tried == [1.0, 2.0, 4.0]
    assert [point.value for point in points] == [1.0, 2.0, 4.0, 8.0, 16.0]
    assert [point.median_ms for point in points[:3]] == pytest.approx([200, 400, 800])
    assert points[3].median_ms is None
    assert points[3].note == "about 1.6 s, profile.max_seconds is 1"


def test_a_cost_that_hardly_depends_on_the_value_is_measured_to_the_end(monkeypatch, settings):
    steps, tried = ladder(monkeypatch, lambda value: 0.5 + 0.001 * value)
    assert all(not point.note for point in climb(steps, settings))
    assert tried == [1.0, 2.0, 4.0, 8.0, 16.0]


def test_a_step_that_happens_to_be_quicker_does_not_make_later_ones_look_free(
    monkeypatch, settings
):
    steps, _ = ladder(monkeypatch, lambda value: 0.9 if value == 1 else 0.8)
    assert all(not point.note for point in climb(steps, settings))


@pytest.mark.parametrize("rate", [10_000, 8_000, 2_200])
def test_the_shortest_trace_has_a_window_at_every_rate(rate):
    card = make_card("haptic", classes=["a", "b"], sampling_rate=rate, width=0.05)
    subject = Subject(SurfaceClassifier(card).eval(), torch.zeros(3, 1))
    assert growth._sufficient(subject)[0] == 2.0
    assert subject.classifier.classify(haptic=growth._noise(subject, 2.0)).label in (0, 1)


def test_photos_are_noise_of_so_many_megapixels():
    card = make_card("visual", width=0.05)
    subject = Subject(SurfaceClassifier(card).eval(), torch.zeros(1, 1, 3, dtype=torch.uint8))
    assert growth._sufficient(subject) == growth.SIZES["photo"]
    height, width, _ = growth._noise(subject, 2.0).shape
    assert height * width / 1e6 == pytest.approx(2.0, rel=0.01)
