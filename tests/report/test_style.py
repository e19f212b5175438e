"""A system's colour: the same in every chart, its own in each, seen by any reader."""

import matplotlib
from hypothesis import given, settings
from hypothesis import strategies as st

from tex_lightning.report.style import FAMILIES, OTHERS, STYLE, colour_of, looks, styled

NETWORKS = ["haptic", "visual", "sound", "fusion"]
PEERS = ["minirocket", "mfcc_gmm", "mfcc_nb", "acnn", "lbp", "alexnet_fv", "tcnn"]
NAMES = st.sampled_from([
    *NETWORKS, *PEERS, "visualnet_w0.5", "haptic_bands", "fusion (run)",
    "haptic+visual", "haptic+visual_sequential", "force", "",
])  # fmt: skip


# How dichromats see linear RGB (Machado, Oliveira and Fernandes 2009, severity 1)
@settings(max_examples=30)
@given(st.lists(NAMES, unique=True, max_size=20))
def test_a_chart_draws_no_two_systems_alike_and_networks_as_ever(names):
    found = looks(names)
    assert list(found) == names
    assert found == {name: looks(names[::-1])[name] for name in names}
    if len(names) <= 8:
        assert len({(look.colour, look.marker) for look in found.values()}) == len(names)
    for name in {*NETWORKS} & {*names}:
        assert found[name].colour == FAMILIES[name]


def test_names_of_one_network_have_its_colour():
    names = ["haptic", "HapticNet", "haptic_bands", "hapticnet_w0.5", "haptic (RUN)"]
    assert {colour_of(name) for name in names} == {FAMILIES["haptic"]}
    assert colour_of("haptic+visual") == colour_of("fusion_fc3") == FAMILIES["fusion"]
    assert {colour_of(name) for name in PEERS} <= {*OTHERS}


def test_the_callers_settings_stay(monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 33)
    size = styled(lambda: matplotlib.rcParams["font.size"])()
    assert (size, matplotlib.rcParams["font.size"]) == (STYLE["font.size"], 33)
