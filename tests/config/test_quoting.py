"""What a person calls something stays as it was typed, whatever Hydra would read in it."""

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from tex_lightning.config.composition import compose_config
from tex_lightning.config.quoting import as_typed, holds_text

NAMES = [
    "1_0", "2024_05_01", "1e3", "1E-3", "true", "TRUE", "False", "007", "1.50", "+5", ".5", "inf",
    "NaN", "-0", "0x1F", "1_0-2", "on", "no", "12:30", "Grün", "木", "it's", "a;b", "a&b", "a~b",
    "#3", "3 mm", "1_0 mm", "!", "C:\\1_0",
]  # fmt: skip
KEYS = (
    "data.root", "data.manifest", "checkpoint", "record.label", "haptic", "image", "sound",
    "weights", "own.grip", "+grip", "+record.conditions.person", "stability.systems",
    "model.fusion.haptic_checkpoint", "hydra.run.dir",
)  # fmt: skip


def parsed(override: str) -> object:
    """What Hydra makes of an override."""
    (given,) = as_typed([override])
    return OverridesParser.create().parse_override(given).value()


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_the_text_that_was_typed(name):
    for key in KEYS:
        assert str(parsed(f"{key}={name}")) == name
    assert list(map(str, parsed(f"data.hold_out=[oak,{name}, {name}]"))) == ["oak", name, name]
    assert str(parsed(f"data.test_where={{who: {name}, n: 1}}")["who"]) == name
    for sweep in (f"record.label={name},oak", f"record.label=choice({name},oak)"):
        (override,) = as_typed([sweep])
        swept = OverridesParser.create().parse_override(override)
        jobs = [parsed(f"record.label={item}") for item in swept.sweep_string_iterator()]
        assert [*map(str, jobs)] == [name, "oak"]


def test_what_is_no_name_stays_a_number_or_null():
    for override in ("seed=1_0", "data.test_fold=1_0", "trainer.tf32=TRUE", "data.channels=[1_0]"):
        assert as_typed([override]) == [override]
    for override in ("data.root=null", "data.hold_out=NULL", "~data.root", "data.hold_out=[]"):
        assert as_typed([override]) == [override]
    assert parsed("frontier.systems={a: null, b: 1_0}") == {"a": None, "b": "1_0"}
    assert as_typed(["data.root=range(1,3)", "data.root=a(1_0"]) == [
        "data.root=range(1,3)", "data.root=a(1_0"
    ]  # fmt: skip
    assert as_typed(['record.label="1_0"', "data.root='${oc.env:HOME}'"]) == [
        'record.label="1_0"', "data.root='${oc.env:HOME}'"
    ]  # fmt: skip


def test_the_home_folder_needs_no_quotes(monkeypatch):
    monkeypatch.setenv("HOME", "/home/anna")
    assert parsed("data.root=~/recordings") == "/home/anna/recordings"
    assert parsed("haptic=[~/a.wav,b.wav]") == ["/home/anna/a.wav", "b.wav"]
    assert parsed("hydra.run.dir=~/runs/1") == "/home/anna/runs/1"


def test_every_key_of_text_is_known_as_one():
    text = ("record.out", "export.out", "data.hold_out", "frontier.only", "trusted", "experiment")
    text += (
        "sense@model.grip",
        "hydra/launcher",
        "data.reader.session",
        "hydra.searchpath",
        "hydra.sweep.subdir",
    )
    numbers = ("seed", "top_k", "model.haptic.width", "trainer.devices", "hydra.verbose")
    numbers += ("model.haptic.fit.optimizer", "trainer.limit_train_batches", "data.folds")
    assert {key: holds_text(key) for key in (*text, *numbers)} == {
        **dict.fromkeys(text, True), **dict.fromkeys(numbers, False)
    }  # fmt: skip


def test_the_configuration_has_the_names(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "2024_05_01.yaml").write_text("# @package _global_\nseed: 7\n")
    composed = compose_config([
        f"hydra.searchpath=[file://{tmp_path}]", "experiment=2024_05_01", "data=folder",
        "data.root=1e3", "data.hold_out=[1_0]", "data.test_where={day: [2024_05_01, 3]}",
    ])  # fmt: skip
    data = OmegaConf.to_container(composed.data)
    assert composed.seed == 7
    assert (data["root"], data["hold_out"]) == ("1e3", ["1_0"])
    assert data["test_where"] == {"day": ["2024_05_01", 3]}
    assert composed.data.reader.root == "1e3"
