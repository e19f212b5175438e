"""YAML that stands for more than it is."""

import pytest

from tex_lightning.config import CONF
from tex_lightning.config.search import use_config_dir
from tex_lightning.errors import UserError
from tex_lightning.perturbations.table import SCALES, read_severities
from tex_lightning.yaml_files import LARGEST, check_yaml

ALIASES = "a0: &a0 [x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 10)
)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (ALIASES.encode(), "its aliases stand for too much"),
        (b"a: &a [*a]", "its aliases stand for too much"),
        (b"[" * 50_000, "too many brackets"),
        (b"[" * 2000, "recursion"),
        (b"a: \xff", "can't decode"),
        (b"#" * (LARGEST + 1), "larger than 1 MiB"),
    ],
    ids=["aliases", "itself", "brackets", "depth", "bytes", "size"],
)
def test_it_is_refused_before_it_is_read(tmp_path, content, message):
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "own.yaml"
    path.write_bytes(content)
    said = rf"{path} cannot be read as YAML \(.*{message}"
    with pytest.raises(UserError, match=said):
        use_config_dir([f"--config-dir={tmp_path}"])
    with pytest.raises(UserError, match=r"own\.yaml cannot be"):
        read_severities(path)


def test_our_own_files_and_mistakes_of_other_kinds_pass(tmp_path):
    for path in [SCALES, *CONF.rglob("*.yaml")]:
        check_yaml(path)
    (tmp_path / "a.yaml").write_text("a: [")
    check_yaml(tmp_path / "a.yaml")
