"""Flags of a command line, anywhere in it."""

import pytest

from tex_lightning.config.composition import split_flags
from tex_lightning.errors import UserError


def test_flags_may_stand_between_overrides():
    flags = ["-m", "--cfg", "job", "--config-dir=a"]
    given = ["model=haptic", *flags[:3], "seed=0,1", flags[3], "+x=-1"]
    assert split_flags(given) == (flags, ["model=haptic", "seed=0,1", "+x=-1"])


@pytest.mark.parametrize("given", [["--foo", "seed=1"], ["--cfg", "jab"], ["seed=1", "--package"]])
def test_flags_that_do_not_exist_are_one_sentence(given):
    with pytest.raises(UserError, match=r"cannot be read \(.*--hydra-help. lists\.") as error:
        split_flags(given)
    assert "\n" not in str(error.value)
