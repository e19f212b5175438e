"""Names of files and flags that Hydra would read as something else."""

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from tex_lightning.config.composition import quote_files, split_flags
from tex_lightning.errors import UserError

NAMES = [
    "my file [1].wav",
    "a,b.wav",
    "a=b (2).wav",
    '5" {x}.wav',
    "it's.wav",
    "1e3",
    'a\\,b\\"c\\',
]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_that_exists_is_meant_by_its_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).touch()
    (argument,) = quote_files([f"haptic={name}"])
    assert OverridesParser.create().parse_override(argument).value() == name
    (whole,) = quote_files([f"haptic={tmp_path / name}"])
    assert OverridesParser.create().parse_override(whole).value() == str(tmp_path / name)


def test_a_pattern_in_an_odd_folder_is_one(tmp_path):
    (tmp_path / "my [1]").mkdir()
    (tmp_path / "my 1").mkdir()
    (tmp_path / "my 1" / "a.wav").touch()
    (argument,) = quote_files([f"haptic={tmp_path}/my [1]/*.wav"])
    assert OverridesParser.create().parse_override(argument).value() == f"{tmp_path}/my [1]/*.wav"


def test_everything_else_stays_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("[0,1]", "haptic", "4"):
        (tmp_path / name).touch()
    arguments = [
        "model=haptic",
        "-m",
        "crossval.only=[0,1]",
        "haptic=[a.wav,b.wav]",
        "seed",
        "haptic=",
    ]
    assert quote_files(arguments) == arguments


def test_flags_may_stand_between_overrides():
    flags = ["-m", "--cfg", "job", "--config-dir=a"]
    given = ["model=haptic", *flags[:3], "seed=0,1", flags[3], "+x=-1"]
    assert split_flags(given) == (flags, ["model=haptic", "seed=0,1", "+x=-1"])


@pytest.mark.parametrize("given", [["--foo", "seed=1"], ["--cfg", "jab"], ["seed=1", "--package"]])
def test_flags_that_do_not_exist_are_one_sentence(given):
    with pytest.raises(UserError, match=r"cannot be read \(.*--hydra-help. lists\.") as found:
        split_flags(given)
    assert "\n" not in str(found.value)
