"""What a run says of its data before it begins, and keeps for its report."""

import json
import re

from tex_lightning.core.console import console
from tex_lightning.report.data_page import data_tables

TRACES = "30 files; 2.4 s each, 72 in all; 10 of a class; 30 groups; 1 axis; 10,000 Hz"


def test_the_opening_says_rate_axes_and_what_is_trained_and_tested(
    cli, tiny, tmp_path, monkeypatch
):
    monkeypatch.setattr(console, "width", 120)
    fit = ["model=mfcc_nb", *tiny, "logger=csv"]
    said = cli(*fit, f"hydra.run.dir={tmp_path}/a").err
    lines = dict(re.findall(r"^(\w+) +(\S.*)$", said, re.MULTILINE))
    assert lines["Traces"] == TRACES
    assert lines["Reads"] == "10,000 Hz by the header of the file"
    assert lines["Parts"] == "traces: 24 trained on, 3 validate, 3 tested"
    said = cli("task=crossval", *fit, "crossval.only=[0,1]", f"hydra.run.dir={tmp_path}/b").err
    assert "Parts    each time traces: 27 trained on, 3 tested" in said


def test_copies_in_several_folds_are_said_before_training(cli, tiny, surfaces, tmp_path):
    lines = ["label,modality,path,group"]
    for label in ("alpha", "beta"):
        for n in range(4):
            lines.append(f"{label},haptic,{surfaces}/{label}/haptic/{label}_{n}.wav,{n}")
    copy = tmp_path / "copy.wav"
    copy.write_bytes((surfaces / "alpha/haptic/alpha_0.wav").read_bytes())
    for group, told in ((0, False), (3, True)):
        table = tmp_path / f"{group}.csv"
        table.write_text("\n".join([*lines, f"alpha,haptic,{copy},{group}"]))
        data = ["data=manifest", f"data.manifest={table}", "logger=csv", "debug=tiny"]
        outcome = cli("model=mfcc_nb", *data, f"hydra.run.dir={tmp_path}/{group}")
        assert outcome.status == 0, outcome.err
        assert ("alpha/alpha_0.wav, alpha/copy.wav; keep one" in outcome.err) == told


def test_the_report_of_a_training_has_what_its_data_are(fused):
    told = json.loads((fused / "data.json").read_text())
    assert [*told["recordings"]] == ["haptic", "image"]
    page = (fused / "report.html").read_text()
    first, by_class, *_ = data_tables(fused)
    facts = {row[""]: row["data"] for row in first.rows}
    assert facts["Traces"] == TRACES
    parts = "24 trained on, 3 validate, 3 tested"
    assert facts["Parts"] == f"traces: {parts}; photos: {parts}"
    assert [row["class"] for row in by_class.rows] == ["alpha", "beta", "gamma"]
    for text in (*facts.values(), "examples: haptic", "examples: image"):
        assert text in page
