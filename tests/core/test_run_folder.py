"""Which checkpoint a run folder stands for."""

import json
import os
import signal
import time

import pytest

from tex_lightning.core.run_folder import find_checkpoint, locked_folder
from tex_lightning.errors import UserError


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


@pytest.mark.parametrize("content", ["[" * 50_000, "[1]", "{", "\xff"])
def test_a_damaged_record_of_settings_is_said(tmp_path, content):
    folder = make(tmp_path, "haptic", "fusion")
    (folder / "settings.json").write_text(content, encoding="latin-1")
    with pytest.raises(UserError, match=r"Record .*settings.json is (no JSON|damaged).*\.$"):
        find_checkpoint(folder)


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


def test_a_folder_belongs_to_one_process_until_that_ends(tmp_path):
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        with locked_folder(tmp_path / "run"):
            os.write(writing, b"x")
            time.sleep(60)
        os._exit(0)
    os.read(reading, 1)
    with (
        pytest.raises(UserError, match=r"Another process runs in .*choose another hydra\.run\.dir"),
        locked_folder(tmp_path / "run"),
    ):
        pass
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    for _ in range(2):
        with locked_folder(tmp_path / "run"):
            pass
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="Cannot write"), locked_folder(tmp_path / "file"):
        pass
