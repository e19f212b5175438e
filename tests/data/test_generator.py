"""Specimens without end."""

from dataclasses import replace

import numpy as np
import pytest

from tex_lightning.data.decode import DecodeSettings, halve
from tex_lightning.data.generator import RenderedStore, SpecimenGenerator
from tex_lightning.synthetic.dataset import SyntheticSpec
from tex_lightning.synthetic.materials import another_piece, distinct_materials, make_materials

SPEC = SyntheticSpec(7, recordings=2, seed=3, seconds=1.0, photo_width=64, photo_height=48)


def stream(modality="image", *, half=False) -> SpecimenGenerator:
    return SpecimenGenerator(SPEC, modality, DecodeSettings(half_scale=half))


@pytest.mark.parametrize(("modality", "alike"), [("image", "looks_like"), ("haptic", "feels_like")])
def test_no_two_classes_are_alike_to_the_sense(modality, alike):
    for count in (2, 5, 6, 7, 30):
        materials = distinct_materials(count, 1, modality)
        assert len(materials) == len({each.name for each in materials}) == count
        assert not any(
            getattr(one, alike)(other)
            for place, one in enumerate(materials)
            for other in materials[:place]
        )


def test_another_piece_is_of_the_same_material():
    material = make_materials(3, 0)[2]
    piece = another_piece(material, np.random.default_rng(0))
    assert piece.relief.seed != material.relief.seed
    assert replace(piece.relief, seed=0) == replace(material.relief, seed=0)
    assert replace(piece.body, seed=0) == replace(material.body, seed=0)
    assert piece.skin.colour != material.skin.colour
    assert max(piece.skin.colour) == pytest.approx(max(material.skin.colour))
    assert min(piece.skin.colour) == pytest.approx(min(material.skin.colour))
    unpainted = {"seed": 0, "colour": (0, 0, 0), "accent": (0, 0, 0)}
    assert replace(piece.skin, **unpainted) == replace(material.skin, **unpainted)


def test_every_round_holds_every_class_once_in_an_order_of_its_own():
    classes = [stream().class_of(number) for number in range(70)]
    rounds = [classes[start : start + 7] for start in range(0, 70, 7)]
    assert all(sorted(each) == [*range(7)] for each in rounds)
    assert len({*map(tuple, rounds)}) > 5


@pytest.mark.parametrize("modality", ["image", "haptic"])
def test_a_specimen_depends_on_seed_and_number_alone(modality):
    far = 10**12  # without end
    first, again = stream(modality).render(far), stream(modality).render(far, 1)
    assert np.array_equal(first[0], again[0])
    assert not np.array_equal(first[0], first[1])
    shape = (48, 64, 3) if modality == "image" else (3, 10_000)
    assert [each.shape for each in first] == [shape, shape]
    other = replace(stream(modality), spec=replace(SPEC, seed=4)).render(far, 1)
    assert not np.array_equal(first[0], other[0])


def test_unseen_specimens_are_of_every_class_and_rendered_as_asked():
    rows = stream().unseen(7)
    assert sorted(row.label for row in rows) == sorted(stream().classes)
    assert min(row.group for row in rows) > 10**9
    row = rows.rows[0]
    assert stream().classes[stream().class_of(row.group)] == row.label
    half, whole = RenderedStore(stream(half=True)).image(row), RenderedStore(stream()).image(row)
    assert np.array_equal(half, halve(whole))
