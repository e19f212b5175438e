import itertools

import pytest

from tex_lightning.synthetic.materials import BLOCK, make_materials


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_a_smaller_set_is_the_beginning_of_a_larger_one(seed):
    assert make_materials(12, seed)[:6] == make_materials(6, seed)
    assert make_materials(69, seed)[:12] == make_materials(12, seed)


@pytest.mark.parametrize("classes", [2, 12, 69, 101])
def test_names_are_unique_sorted_and_plain(classes):
    names = [material.name for material in make_materials(classes, 0)]
    assert len(set(names)) == classes
    assert names == sorted(names)
    assert all(name.replace("_", "").isalnum() and name.isascii() for name in names)


def look_alike(one, other):
    """Whether no photo can tell the two apart."""
    return (one.relief, one.skin) == (other.relief, other.skin)


def feel_alike(one, other):
    """Whether no acceleration trace can tell the two apart."""
    return (one.relief, one.body) == (other.relief, other.body)


def sound_alike(one, other):
    """Whether hardly a sound tells the two apart: a foil that both have drowns them."""
    drowned = one.voice.rustle > 0 or feel_alike(one, other)
    return drowned and one.voice == other.voice


@pytest.mark.parametrize("seed", range(5))
def test_every_block_has_one_pair_alike_to_each_sense(seed):
    materials = make_materials(72, seed)
    pairs = list(itertools.combinations(enumerate(materials), 2))
    for place, alike in ((0, look_alike), (2, feel_alike), (4, sound_alike)):
        found = [(i, j) for (i, first), (j, second) in pairs if alike(first, second)]
        assert found == [(at, at + 1) for at in range(place, 72, BLOCK)]
