"""Checkpoints whose plain values and tensors are others than were trained."""

import copy
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks._attempts import Attempt, attempt
from benchmarks._seeds import FORMATS

CARDS = {"checkpoint's values": "checkpoint", "baseline's values": "checkpoint of a baseline"}
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, math.nan, math.inf, 1e300, 10**30, 10**9, 1e-300, "", "abc", "a\nb", "\0",
    "os.system", "builtins.eval", "tex_lightning.config.trust.find_class", [], {}, [1], [[[]]],
    {"_target_": "os.system", "command": "touch x"}, {"a": 1}, b"abc", ("a",), 1j,
)  # fmt: skip


def damaged_cards(name: str, count: int, folder: Path) -> Iterator[tuple[str, Attempt]]:
    """Each value by its place and what came of it."""
    kind = FORMATS[CARDS[name]]
    path = folder / kind.name
    kind.write(path)
    whole = torch.load(path, weights_only=True)
    rng = np.random.default_rng(len(name))
    kind.read(path)  # what is imported on the way is no cost of the first
    for _ in range(count):
        content = copy.deepcopy(whole)
        where = _damage(content, rng)
        torch.save(content, path)
        yield where, attempt(lambda: kind.read(path), str(folder))


def _damage(content: dict[str, Any], rng: np.random.Generator) -> str:
    """Exchange or take out one value or tensor; gives its place."""
    node: Any = content
    place, last = "", content
    key: Any = None
    while isinstance(node, dict | list) and node and (key is None or rng.random() < 0.9):
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key, last = keys[int(rng.integers(len(keys)))], node
        node, place = node[key], f"{place}.{key}"
    if rng.random() < 0.1:
        del last[key]
        return f"{place} taken out"
    if isinstance(node, torch.Tensor) and rng.random() < 0.8:
        last[key] = _other_tensor(node, rng)
        return f"{place} is {last[key].dtype} {tuple(last[key].shape)}"
    last[key] = VALUES[int(rng.integers(len(VALUES)))]
    return f"{place} is {last[key]!r}"


def _other_tensor(tensor: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    ways = (
        lambda: torch.full_like(tensor, math.nan) if tensor.is_floating_point() else tensor[:0],
        lambda: tensor[..., :0],
        lambda: tensor[None],
        lambda: tensor.to(torch.complex64),
        lambda: tensor.double() * 1e300,
        lambda: tensor.to(torch.int8),
        lambda: torch.zeros(1).expand(10**12),
        lambda: torch.zeros(1).expand(tensor.shape),
        lambda: tensor.to_sparse() if tensor.dim() else tensor,
        lambda: torch.empty(tensor.shape, device="meta"),
    )
    return ways[int(rng.integers(len(ways)))]()
