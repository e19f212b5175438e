"""``report.html``: what is on it; ``test_text.py`` tests that it fetches nothing."""

import base64
import json
import re

import pytest

from tex_lightning.report import figures, page


def test_headline_command_versions_and_every_figure_are_there(fused):
    content = (fused / "report.html").read_text(encoding="utf-8")
    for words in ("haptic", "visual", "fusion", "model=fusion", "torch 2", "shrank every budget"):
        assert words in content
    assert re.search(r"\d+/3", content)
    pictures = re.findall(r"<img [^>]+>", content)
    assert all(re.search(r'alt="[^"]', picture) for picture in pictures)
    for figure in fused.glob("figures/*.png"):
        assert base64.b64encode(figure.read_bytes()).decode() in content


@pytest.mark.parametrize("validated", [True, False])
def test_learning_curves_are_those_of_one_network_without_empty_axes(
    tmp_path, monkeypatch, validated
):
    networks = {"force": {}, "force2": {}}
    (tmp_path / "results.json").write_text(json.dumps({"networks": networks}))
    for name, epoch, loss in (("force", 0, 3), ("force_resumed1", 1, 2), ("force2", 0, 9)):
        folder = tmp_path / "metrics" / name
        folder.mkdir(parents=True)
        more = (",val/vote_accuracy", ",0.5") if validated else ("", "")
        text = f"epoch,train/loss{more[0]}\n{epoch},{loss}{more[1]}\n"
        (folder / "metrics.csv").write_text(text)
    drawn = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, _: drawn.append(figure))
    page.draw_learning(tmp_path)
    (figure,) = drawn
    assert len(figure.axes) == 1 + validated
    (line,) = figure.axes[0].get_lines()
    assert line.get_xydata().tolist() == [[1, 3], [2, 2]]
    assert figure.axes[-1].get_xlabel() == "epoch"
