"""Whatever a key is given, it is taken or refused in one sentence."""

import copy
import math

import pytest
from omegaconf import OmegaConf

from tex_lightning.config import CONF, flatten
from tex_lightning.config.check import check_config, check_known, check_missing
from tex_lightning.config.composition import compose_config
from tex_lightning.config.mistakes import MISTAKES
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError

VALUES = ["abc", -1, 0, math.nan, math.inf, 1e300, 10**30, "", [], {}, [1], ["a"], {"a": 1}]
VALUES += [None, True, [[1]], "a\nb", "\x00"]
LONG = 900  # characters; the longest lists all perturbations


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        ["model=fusion"],
        ["task=predict", "checkpoint=RUN", "haptic=A.wav"],
        ["task=stability", "stability.systems=[RUN]"],
    ],
    ids=lambda given: given[0],
)
def test_every_key_takes_or_refuses_every_value(given):
    composed = compose_config(CONF, given)
    keys = sorted(flatten(OmegaConf.to_container(composed, resolve=False)))
    accepted, said = 0, {}
    for key in keys:
        for value in VALUES:
            changed = copy.deepcopy(composed)
            try:
                OmegaConf.update(changed, key, value)
                check_known(changed)
                check_missing(changed)
                check_config(read_config(changed))
                accepted += 1
            except UserError as error:
                said[key, repr(value)] = str(error)
            except MISTAKES:  # which the command line puts into words
                said[key, repr(value)] = ""
    assert not {case: text for case, text in said.items() if "\n" in text or len(text) > LONG}
    assert len(said) > accepted > len(keys)
