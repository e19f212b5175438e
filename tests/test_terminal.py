"""Whole runs in a pseudo-terminal: what a person sees while they go on, and what is left."""

import re
import sys

import pytest
from terminal import SEQUENCE, run_in_terminal

TINY = ("debug=tiny", "data.classes=3", "trainer.threads=1")


def run(cache, folder, *arguments, **more):
    given = [*arguments, *TINY, f"data.cache_dir={cache}", f"hydra.run.dir={folder}"]
    command = [sys.executable, "-m", "tex_lightning", *given]
    return run_in_terminal(command, 80, 24, OMP_NUM_THREADS="1", **more)


@pytest.mark.slow
@pytest.mark.parametrize("given", [("model=fusion",), ("task=crossval", "crossval.only=[0,3]")])
def test_bars_that_go_away_and_a_table_that_fits(cache, tmp_path, given):
    session = run(cache, tmp_path / "run", *given)
    assert session.status == 0, session.screen.text
    assert not session.screen.cursor_is_hidden
    written = re.split("[\r\n]+", SEQUENCE.sub("", session.screen.raw))
    # paths and commands to copy are wrapped by the terminal alone
    assert max(len(row) for row in written if "/" not in row and "python -m" not in row) <= 80
    assert session.screen.drawn
    text = session.screen.text
    assert not {*text} & {"╸", "╺", "…"}
    assert re.search(r"\d\.\d%", text)


@pytest.mark.slow
def test_an_interrupted_run_leaves_whole_lines_and_the_cursor(cache, tmp_path):
    arguments = ("task=crossval", "model.haptic.fit.epochs=400")
    session = run(cache, tmp_path / "run", *arguments, interrupt_at="epoch 9/400")
    assert session.status == 130
    assert not session.screen.cursor_is_hidden
    before, _, after = session.screen.text.partition("Interrupted")
    assert "epoch" not in before
    assert " ".join(after.split()).endswith("goes on after the last finished epoch.")
