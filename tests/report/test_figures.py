"""Figures are files."""

import numpy as np

from tex_lightning.report.figures import confusion_figure, save_figure


def test_a_figure_is_saved_alike_every_time(tmp_path):
    def saved(folder: str) -> bytes:
        figure = confusion_figure(np.eye(2, dtype=int), ["a", "b"], "votes")
        return save_figure(figure, tmp_path / folder / "w0.5_a").read_bytes()

    assert saved("one") == saved("other")
    assert (tmp_path / "one" / "w0.5_a.png").read_bytes().startswith(b"\x89PNG")
