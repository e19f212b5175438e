"""Any set of senses through the command line: training, testing, prediction."""

import json
from pathlib import Path

import pytest

from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.data.readers import read_recordings

SENSES = {"haptic": "haptic", "visual": "image", "sound": "sound"}  # and their modalities
SMALL = ["debug=tiny", "data.classes=2", "data.synthetic.recordings=3", "data.folds=3"]
SMALL += ["data.test_fold=0", "data.val_fold=null", "trainer.threads=1"]


def listed(senses) -> str:
    return f"[{','.join(senses)}]"


@pytest.fixture(scope="module")
def every(run_once) -> Path:
    """A FusionNet of all senses."""
    return run_once("model=fusion", f"model.senses={listed(SENSES)}", *SMALL)


def test_all_senses_are_trained_and_fused(every):
    results = json.loads((every / "results.json").read_text())
    networks = results["networks"]
    assert list(networks) == [*SENSES, "fusion"]
    assert results["weights"].keys() == SENSES.keys()
    parts = sum(networks[name]["parameters"] for name in SENSES)
    assert abs(networks["fusion"]["parameters"] - parts) <= 2 * (len(SENSES) - 1)  # one bias
    for name in networks:
        assert (every / "checkpoints" / f"{name}.ckpt").is_file()
        assert networks[name]["test_samples"] == 2


@pytest.fixture(scope="module")
def files(cache) -> dict[str, Path]:
    """A file of each modality."""
    chosen = [*SMALL, f"model.senses={listed(SENSES)}", f"data.cache_dir={cache}"]
    config = read_config(compose_config(chosen))
    rows = read_recordings(config.data)
    return {modality: rows.of(modality).rows[0].path for modality in SENSES.values()}


def test_it_predicts_by_whichever_are_given(cli, every, files):
    given = {modality: files[modality] for modality in ("haptic", "sound")}
    outcome = cli(
        "task=predict", f"checkpoint={every}", *[f"{name}={file}" for name, file in given.items()]
    )
    assert outcome.status == 0, outcome.err
    prediction = json.loads(outcome.out)
    assert prediction["modalities"] == list(given)
    assert {name: Path(prediction[name]) for name in given} == given
    assert prediction["fragments"] == 50  # `debug=tiny` draws so many tuples
