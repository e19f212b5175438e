"""Sequential decisions and calibration from the command line."""

import json
from pathlib import Path

import pytest

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import read_outcomes


@pytest.fixture(scope="module")
def sequential(run_once, tiny) -> Path:
    return run_once("model=haptic", "decision=sequential", "logger=csv", *tiny)


def network(directory: Path) -> dict:
    return json.loads((directory / "results.json").read_text())["networks"]["haptic"]


def test_a_sequential_run_says_what_it_saved_and_how_far_to_believe_it(sequential):
    outcomes = read_outcomes(sequential / "predictions" / "haptic.csv")
    mean = sum(outcome.relative_macs for outcome in outcomes) / len(outcomes)
    entry = network(sequential)
    assert 0 < mean <= 1.5
    assert entry.get("relative_macs", 1) == pytest.approx(mean)
    assert set(entry["calibration"]) == {"ece", "brier", "nll"}
    assert (sequential / "figures" / "haptic_confusion.png").is_file()
    assert 0.1 <= tl.load(sequential).card.calibration["temperature"] <= 10


def test_predictions_say_what_they_looked_at(fused, surfaces):
    files = {
        "haptic": surfaces / "alpha/haptic/alpha_0.wav",
        "image": surfaces / "alpha/image/alpha_0.png",
    }
    given = ["decision=sequential", "decision.confidence_threshold=0"]
    quick = tl.load(fused, *given).predict(**files)
    assert 0 < quick.relative_macs < 1
    assert quick.fragments < 10
    whole = tl.load(fused).predict(**files)
    assert (whole.relative_macs, whole.fragments) == (1, 50)  # pairs of debug=tiny
    assert tl.load(fused, "decision.pairs=7").predict(**files).fragments == 7
