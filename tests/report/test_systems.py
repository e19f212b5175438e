"""Systems of any senses side by side."""

import json
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.evaluation.outcomes import RANDOM, Outcome, write_outcomes
from tex_lightning.report.systems import System, _start, read_systems
from tex_lightning.report.tables import accuracy_tables, profiling_table

ENTRY = {"fit_seconds": 1.0, "parameters": 7}


def make(kind: str, right: str, *modalities: str, **changes: Any) -> System:
    """A system and the numbers of the samples that it was right on, as + and -."""
    outcomes = [
        Outcome({name: f"{n}.{name}" for name in modalities}, "a", "ba"[mark == "+"], 1, 1, 1, 2.0)
        for n, mark in enumerate(right)
    ]
    settings = {"model": kind, "inside": "", "data": "folder", "variant": "", **changes}
    return System(kind=kind, classes=["a", "b"], entries=[ENTRY], outcomes=outcomes,
                  directories=[Path()], **settings)  # fmt: skip


def test_a_sense_that_the_paper_does_not_have_gets_a_table_of_its_own():
    asked = {"complete": True, "paper": True}
    tables = accuracy_tables([make("force", "++-", "force")], **asked)
    assert tables.startswith("### Force classification\n\nOurs: folder, 2 classes (chance 50.0%), ")
    assert "| **force** | - | 66.7% (2/3) |" in tables
    assert "The paper's" not in tables
    part = accuracy_tables([make("force", "+--", "force", inside="fusion")], **asked)
    assert "| **force network inside fusion** | - | 33.3% (1/3) |" in part
    network = {"reference_ms": 1.0, "sliding_window_ms": 10.0, "speedup": 10.0, "kind": "force",
               "speedup_same_engine": 5.0, "label_agreement": 1.0}  # fmt: skip
    table = profiling_table({"force": network}, paper=True)
    assert "| force | - | - | 10.0 / 1.0 | 10.0x |" in table


def test_the_papers_columns_stay_out_of_ones_own_data():
    own = accuracy_tables([make("haptic", "++-", "haptic")], complete=False, paper=False)
    assert "| system | votes | 95 % interval |" in own
    assert "| **HapticNet** | 66.7% (2/3) |" in own
    assert "Data: folder, 2 classes" in own
    assert "paper" not in own.lower()
    network = {"reference_ms": 1.0, "sliding_window_ms": 10.0, "speedup": 10.0, "kind": "haptic",
               "speedup_same_engine": 5.0, "label_agreement": 1.0}  # fmt: skip
    assert "paper" not in profiling_table({"haptic": network}, paper=False)


def test_a_system_of_fewer_senses_is_compared_on_its_part_of_each_sample():
    fused = make("fusion", "+++-", "haptic", "image", "sound")
    pair = make("fusion", "+--+", "haptic", "sound")
    assert mcnemar(fused.successes, pair.successes_beside(fused)) == (2, 1, 1.0)
    assert mcnemar(pair.successes, fused.successes_beside(pair)) is None


def test_rows_say_which_trunks_did_not_begin_at_random():
    given = {"haptic": RANDOM, "visual": "/w/alexnet.pth", "touch": "/r/a.ckpt (trained on 27)"}
    assert _start({"weights": given}, "visual") == ["trunk from alexnet.pth"]
    assert _start({"weights": given}, "haptic") == []
    both = ["visual trunk from alexnet.pth", "touch trunk from /r/a.ckpt"]
    assert _start({"weights": given}, "fusion") == both
    assert _start({}, "fusion") == []


def test_what_runs_draw_makes_no_other_system(tmp_path):
    for name, asked in (("a", []), ("b", ["explained_samples=0"])):
        entry = {"fit_seconds": 1.0, "vote_accuracy": 1.0}
        results = {"model": "haptic", "data": "folder", "classes": ["a"]}
        write_outcomes([Outcome({"haptic": name}, "a", "a", 1, 1, 1, 2.0)],
                       tmp_path / name / "predictions" / "haptic.csv")  # fmt: skip
        (tmp_path / name / "results.json").write_text(
            json.dumps({**results, "networks": {"haptic": entry}})
        )
        (tmp_path / name / ".hydra").mkdir()
        OmegaConf.save(["model=haptic", *asked], tmp_path / name / ".hydra" / "overrides.yaml")
    (system,) = read_systems([tmp_path / "a", tmp_path / "b"])
    assert len(system.outcomes) == 2
