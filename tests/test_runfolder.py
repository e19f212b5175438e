"""Which checkpoint a run folder stands for."""

import json

import pytest

from tex_lightning.errors import UserError
from tex_lightning.runfolder import find_checkpoint


def make(folder, *kinds, senses=None):
    (folder / "checkpoints").mkdir(parents=True)
    for kind in kinds:
        (folder / "checkpoints" / f"{kind}.ckpt").touch()
    if senses is not None:
        (folder / "settings.json").write_text(json.dumps({"model.senses": senses}))
    return folder


def test_a_run_folder_stands_for_its_models_own_network(tmp_path):
    fusion = make(tmp_path / "a", "haptic", "visual", "fusion", senses=["haptic", "visual"])
    assert find_checkpoint(fusion) == fusion / "checkpoints" / "fusion.ckpt"
    sound = make(tmp_path / "d", "haptic", "sound", senses=["sound"])
    assert find_checkpoint(sound) == sound / "checkpoints" / "sound.ckpt"
    alone = make(tmp_path / "b", "visual")
    assert find_checkpoint(str(alone)) == alone / "checkpoints" / "visual.ckpt"
    assert find_checkpoint(tmp_path / "none.ckpt") == tmp_path / "none.ckpt"


def test_an_ambiguous_or_empty_folder_is_said(tmp_path):
    with pytest.raises(UserError, match="no finished checkpoint"):
        find_checkpoint(tmp_path)
    with pytest.raises(UserError, match="several checkpoints and no settings"):
        find_checkpoint(make(tmp_path / "a", "haptic", "visual"))
    with pytest.raises(UserError, match=r"no finished fusion.ckpt; give .*haptic.ckpt"):
        find_checkpoint(make(tmp_path / "b", "haptic", "visual", senses=["haptic", "visual"]))
    make(tmp_path / "c" / "folds" / "0", "haptic")
    with pytest.raises(UserError, match=r"one for each fold; .*folds/0/checkpoints/haptic.ckpt"):
        find_checkpoint(tmp_path / "c")
