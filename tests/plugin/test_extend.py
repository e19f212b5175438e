"""What the documentation says on extending the package runs as it stands there."""

import importlib
import json
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_photo
from PIL import Image

from tex_lightning.config.user_folders import use_config_dir
from tex_lightning.testing import check_part

PAGE = Path(__file__).parents[2] / "docs" / "extend.md"
MODULE = "my_ext"


@pytest.fixture
def empty(tmp_path, monkeypatch) -> Path:
    """An empty folder that Python finds modules in; the plugin of the other tests stays out."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    others = {name: sys.modules.pop(name) for name in [MODULE] if name in sys.modules}
    yield tmp_path
    sys.modules.pop(MODULE, None)
    sys.modules.update(others)
    use_config_dir([])


def test_the_parts_of_the_page_run_from_an_empty_folder(cli, empty):
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    files = [text for language, text in blocks if language in ("python", "yaml")]
    for text in files:
        path = empty / re.search(r"^# (\S+\.\w+)$", text, re.MULTILINE)[1]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    assert len(files) == 10
    parts = importlib.import_module(MODULE)
    assert check_part(parts.Levels(samples=10), rate=1000) == "features"
    assert check_part(parts.ForceNet(3, 8), example=torch.randn(2, 2, 64)) == "network"
    assert check_part(parts.SmallTrunk) == "trunk"
    (empty / "DIR").mkdir()
    for kind, label in enumerate(("wood", "felt")):
        for number in range(10):
            Image.fromarray(make_photo(kind, number)).save(empty / f"DIR/{label}_{number}.png")
            force = kind + np.random.default_rng(number).standard_normal(3000)
            np.save(empty / f"DIR/{label}_{number}.npy", force)
    (commands,) = [text.splitlines() for language, text in blocks if language == "bash"]
    outcomes = []
    for command in commands:
        arguments = shlex.split(command)[3:]
        outcomes.append(cli(*arguments, "debug=tiny", "trainer.threads=1"))
        assert outcomes[-1].status == 0, outcomes[-1].err
    assert "Epoch 1 is over." in outcomes[0].out
    assert (empty / "RUN" / "mine" / "visual" / "metrics.csv").is_file()
    results = json.loads((empty / "RUN" / "results.json").read_text())
    assert (results["data"], results["networks"]["fusion"]["test_samples"]) == ("flat", 2)
    assert json.loads(outcomes[2].out)["label"] in ("wood", "felt")


@pytest.mark.slow
def test_the_networks_of_the_page_take_one_key(cli, empty):
    text = PAGE.read_text()
    (module,) = re.findall(r"^```python\n(# my_net\.py\n.*?)^```$", text, re.DOTALL | re.MULTILINE)
    (empty / "my_net.py").write_text(module)
    np.save(empty / "A.npy", np.random.default_rng(0).standard_normal(40_000))
    (check,) = re.findall(r"^```python\n(# check\.py\n.*?)^```$", text, re.DOTALL | re.MULTILINE)
    exec(check, {})
    commands = re.findall(r"^    python -m tex_lightning (model=.*my_net.*)$", text, re.MULTILINE)
    given = [shlex.split(command) for command in commands]
    assert len(given) == 2
    for arguments in given:
        outcome = cli(*arguments, "debug=tiny", "trainer.threads=1")
        assert outcome.status == 0, outcome.err
    outcome = cli("task=predict", "checkpoint=RUN", "haptic=A.npy", "trusted=[my_net]")
    assert json.loads(outcome.out)["label"]
