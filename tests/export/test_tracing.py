"""Random words for the tuples of a FusionNet."""

import torch

from tex_lightning.decision.voting import random_tuples
from tex_lightning.export.tracing import draws


def test_words_modulo_positions_are_the_tuples_of_pytorchs_generator():
    positions = (7, 1, 1234)
    words = draws(seed=2**32 - 5, count=300, senses=3)
    assert torch.equal(words % torch.tensor(positions), random_tuples(positions, 300, 2**32 - 5))
