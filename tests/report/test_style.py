"""A system's colour: the same in every chart, its own in each, seen by any reader."""

from itertools import combinations

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from skimage.color import deltaE_ciede2000, rgb2lab

from tex_lightning.report.style import FAMILIES, OTHERS, STYLE, brief, colour_of, looks, styled

NETWORKS = ["haptic", "visual", "sound", "fusion"]
PEERS = ["minirocket", "mfcc_gmm", "mfcc_nb", "acnn", "lbp", "alexnet_fv", "tcnn"]
NAMES = st.sampled_from([
    *NETWORKS, *PEERS, "visualnet_w0.5", "haptic_bands", "fusion (run)",
    "haptic+visual", "haptic+visual_sequential", "force", "",
])  # fmt: skip
# How dichromats see linear RGB (Machado, Oliveira and Fernandes 2009, severity 1)
SEEN = {
    "all": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


def lab(colour: str, seen: object) -> np.ndarray:
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = (np.array(seen) @ linear).clip(0, 1)
    gamma = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return rgb2lab(gamma[None, None])[0, 0]


def least_distance(colours, seen) -> float:
    """In CIEDE2000, of which 1 to 2 are just seen side by side."""
    return min(
        float(deltaE_ciede2000(lab(one, seen), lab(other, seen)))
        for one, other in combinations(colours, 2)
    )


@pytest.mark.parametrize("seen", SEEN)
def test_colours_are_told_apart_by_any_reader(seen):
    assert least_distance([*FAMILIES.values(), *OTHERS], SEEN[seen]) > 10


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


def test_the_middle_of_a_long_name_is_left_out():
    assert brief("abcdefgh", 8) == "abcdefgh"
    assert brief("abcdefghi", 8) == "abcd…fghi"
