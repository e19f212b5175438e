"""Files of a user's own sense, ``+NAME=FILE``, on the command line of all tasks that read files."""

import json

import pytest
import soundfile
from conftest import RATE, make_card, make_trace, save_checkpoint


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A network on what a force sensor measured, and a trace."""
    folder = tmp_path_factory.mktemp("force")
    path = folder / "a stroke (1).wav"  # a name that needs quotes
    soundfile.write(path, make_trace(0, 0, 5.0), RATE, subtype="FLOAT")
    card = make_card("haptic", width=0.1, modality="force")
    return save_checkpoint(card, folder / "force.ckpt"), path


def test_it_is_predicted_from_and_streamed(cli, files):
    given = [f"checkpoint={files[0]}", f'+force="{files[1]}"']
    outcome = cli("task=predict", *given)
    assert outcome.status == 0, outcome.err
    outcome = cli("task=stream", *given, "stream.chunk=2.5")
    assert outcome.status == 0, outcome.err
    assert [json.loads(line)["time"] for line in outcome.out.splitlines()] == [2.5, 5.0]
