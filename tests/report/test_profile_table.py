"""The paper's figures beside those of ``task=profile``."""

import pytest

from tex_lightning.report.table import paper_table


def test_the_papers_table_is_the_papers():
    table = paper_table("profiling")
    speedups = {
        name: table[name]["sliding_window_ms"] / table[name]["fcn_ms"]
        for name in ("haptic", "visual")
    }
    assert speedups == pytest.approx({"haptic": 9.53, "visual": 51.2}, rel=1e-3)
