"""Classes of every form are built from a node."""

import re
import traceback
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from tex_lightning.config.instantiation import build, make, trust
from tex_lightning.core.contract import fault_of
from tex_lightning.errors import UserError


@dataclass
class Plain:
    folder: str
    rate: float = 10.0
    inner: Any = None


class Heir(Plain):
    """Inherits fields and takes other arguments."""

    def __init__(self, folder: str, *, tag: str = "x"):
        super().__init__(folder)
        self.tag = tag


def node(cls: type, **values: object) -> dict[str, object]:
    return {"_target_": f"{__name__}.{cls.__name__}", **values}


def test_types_of_a_dataclass_hold():
    assert build("data.reader", node(Plain, folder="a", rate=3)).rate == 3
    with pytest.raises(UserError, match=r"data\.reader\.rate is 'fast': give a number"):
        build("data.reader", node(Plain, folder="a", rate="fast"))
    with pytest.raises(UserError, match=r"no key data\.reader\.rat \(did you mean .*rate"):
        build("data.reader", node(Plain, folder="a", rat=3))


def test_a_constructor_of_its_own_counts():
    made = build("data.reader", node(Heir, folder="a", tag="y"))
    assert (made.folder, made.rate, made.tag) == ("a", 10.0, "y")


def test_nodes_inside_are_built():
    inner = node(Plain, folder="in", rate=2)
    assert build("data.reader", node(Plain, folder="a", inner=inner)).inner.rate == 2
    listed = build("data.reader", node(Plain, folder="a", inner=[{"x": inner}])).inner
    assert listed[0]["x"].folder == "in"
    call = {"_target_": "builtins.len", "_partial_": True}
    made = build("data.reader", node(Plain, folder="a", inner=call)).inner
    assert isinstance(made, partial)
    assert made("abc") == 3


def test_nodes_inside_keep_to_their_signatures():
    for wrong, said in (
        ({"rat": 2}, r"no key data\.reader\.inner\.0\.x\.rat \(did you mean .*\.rate\?"),
        ({"rate": "fast"}, r"^data\.reader\.inner\.0\.x\.rate is 'fast': give a number"),
        ({}, r"^data\.reader\.inner\.0\.x lacks folder"),
    ):
        inner = node(Plain, **({"folder": "in"} if wrong else {}), **wrong)
        with pytest.raises(UserError, match=said):
            build("data.reader", node(Plain, folder="a", inner=[{"x": inner}]))
    unbuilt = node(Plain, folder="a", inner=node(Plain, rat=2), _recursive_=False)
    assert build("data.reader", unbuilt).inner["rat"] == 2


@dataclass
class Ranged:
    size: Annotated[int, "[1, 64] mm", "a size"] = 1
    kind: Literal["a", "b"] = "a"


@pytest.mark.parametrize("maker", [build, make])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"size": 65}, "model.x.y.size is 65: give a number in [1, 64] mm."),
        ({"kind": "c"}, "model.x.y.kind is 'c': give one of a, b."),
        ({"siz": 5}, "no key model.x.y.siz (did you mean model.x.y.size?); its class has size, k"),
    ],
)
def test_a_configuration_and_a_card_keep_to_one_signature(maker, given, said):
    trust(f"{__name__}.Ranged")
    with pytest.raises(UserError, match=re.escape(said)):
        maker("model.x.y", node(Ranged, **given))


def test_what_a_card_shares_with_its_parts_keeps_to_their_signatures():
    trust(f"{__name__}.Ranged")
    with pytest.raises(UserError, match=r"^model\.x\.size is 65: give a number"):
        make("model.x.y", node(Ranged), size=65)
    assert make("model.x.y", node(Ranged, size=3), size=65, other=1).size == 3


BROKEN = {
    "import no_such_library\n": ModuleNotFoundError,
    "class Net:\n    def\n": SyntaxError,
    "class Net:\n    def __init__(self):\n        raise KeyError('boom')\n": KeyError,
}


@pytest.mark.parametrize(("text", "kind"), BROKEN.items(), ids=["import", "syntax", "constructor"])
@pytest.mark.parametrize("maker", [build, make])
def test_what_a_users_own_module_raises_keeps_its_traceback_after_its_key(
    tmp_path, monkeypatch, maker, text, kind
):
    package = f"broken_{tmp_path.name.replace('-', '_')}"
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("tex_lightning.config.instantiation._TRUSTED", {package})
    (tmp_path / f"{package}.py").write_text(text)
    with pytest.raises(kind) as caught:
        maker("model.force.network", {"_target_": f"{package}.Net"})
    line = f"model.force.network raised {kind.__name__} while it was "
    assert fault_of(caught.value).startswith(line)
    names = {Path(frame.filename).stem for frame in traceback.extract_tb(caught.tb)}
    assert kind is SyntaxError or package in names


@pytest.mark.parametrize("maker", [build, make])
def test_what_the_packages_classes_refuse_and_what_is_not_there_stay_one_sentence(maker):
    for target, said in (
        (
            "tex_lightning.networks.hapticnet.Nothing",
            "no attribute 'Nothing'; correct its _target_",
        ),
        ("tex_lightning.networks.hapticnet.HaptcNet", r"HaptcNet' \(did you mean HapticNet\?\); c"),
        ("lightning.pytorch.loggers.WandbLogger", "wandb.*; install what it needs"),
        ("tex_lightning.networks.linear.LinearNet", "lacks classes, .*; give .*classes=VALUE"),
        (
            f"{__name__}.Heir",
            r"lacks folder, of which .* give \+model\.x\.folder=VALUE",
        ),
    ):
        trust(target)
        with pytest.raises(UserError, match=rf"^model\.x .*{said}"):
            maker("model.x", {"_target_": target})


def test_what_another_class_of_a_node_took_is_left_out():
    with pytest.raises(
        UserError, match=r"has folder, tag, so leave it out, as by ~data\.reader\.colour\."
    ):
        build("data.reader", node(Heir, folder="a", colour=3))


def test_of_a_module_that_is_not_found_it_is_said_where_python_looks():
    trust("nowhere_at_all.Net")
    with pytest.raises(UserError, match=r"No module named 'nowhere_at_all'; .* or set PYTHONPATH"):
        make("model.x", {"_target_": "nowhere_at_all.Net"})
