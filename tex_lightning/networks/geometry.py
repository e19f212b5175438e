"""Which part of an input each prediction of a dense network depends on.

This package's networks say it themselves. Of any other network it is found by trying: output sizes
on the meta device, where nothing is computed, then how far NaN in the input spreads. What is found
holds only if pieces of random inputs give the scores of the whole.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from math import prod
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import Window, is_builtin
from tex_lightning.networks.tiles import in_tiles, layer_windows, receptive_field
from tex_lightning.networks.windows import Scores

MAX_SIDE = 1 << 13  # elements along an axis that are tried
MAX_COMPUTED = 1 << 20  # of an input that is computed
Sizes = Callable[[tuple[int, ...]], tuple[int, ...] | None]
Count = Callable[[int], int]


class Steps(NamedTuple):
    """How many positions a module gives on an axis of ``size``: (size + shift) // stride.

    Attributes:
        min_size: Smallest size that gives one.
        stride: Elements of the input between neighbouring positions.
        shift: See above.
    """

    min_size: int
    stride: int
    shift: int


def map_sizes(module: nn.Module) -> Sizes:
    """Return a function from the shape of an input (B, C, ...) to the size of the map.

    It gives None for inputs that the module cannot take.
    """
    copies = {"meta": deepcopy(module).to("meta"), "cpu": deepcopy(module).cpu()}

    def sizes(shape: tuple[int, ...]) -> tuple[int, ...] | None:
        for device, copy in copies.items():  # values, which a module may ask for, are on one only
            if device == "meta" or prod(shape) <= MAX_COMPUTED:
                with suppress(Exception), torch.no_grad():  # of a kernel larger than its input
                    found = copy(torch.zeros(shape, device=device))
                    return tuple(found.shape[2:]) if len(found) == shape[0] else None
        return None

    return sizes


def smallest(count: Count, least: int) -> int | None:
    """Return the smallest size that gives at least so many positions, if one does."""
    high = 1
    while count(high) < least:
        high *= 2
        if high > MAX_SIDE:
            return None
    low = high // 2  # too small, or 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if count(middle) >= least else (middle, high)
    return high


def measure_steps(count: Count) -> Steps | None:
    """Return the steps of an axis, or None where positions do not come at even distances."""
    first = smallest(count, 1)
    if first is None:
        return None
    begins = [smallest(count, count(first) + more) for more in (1, 2)]
    if begins[0] is None or begins[1] is None:
        return None
    stride = begins[1] - begins[0]
    if stride < 1:  # more positions than elements
        return None
    shift = stride * (count(first) + 1) - begins[0]
    tried = range(first, first + 3 * stride + 1, max(1, stride // 5))
    even = all(count(size) == (size + shift) // stride for size in tried)
    return Steps(first, stride, shift) if even else None


MAX_ELEMENTS = 1 << 22  # of an input that is tried
DECLARED = ("window_size", "min_size", "stride", "output_size")
Layers = tuple[Sequence[Window], Sequence[Window]]
Run = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Geometry:
    """Geometry of a dense network.

    Attributes:
        layers: Windows in a row along rows and along columns, of its layers or of the whole.
        window_size: Height and width of an input that gives exactly one position.
        min_size: Height and width of the smallest input that gives a position.
    """

    layers: Layers
    window_size: tuple[int, int]
    min_size: tuple[int, int]

    @property
    def stride(self) -> int:
        """Elements of the input between neighbouring positions."""
        return prod(window.stride for window in self.layers[1])

    @property
    def receptive_field(self) -> int:
        """Columns that one position depends on."""
        return receptive_field(self.layers[1])

    def output_size(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of positions; 0 where the input is too small."""
        found = [height, width]
        for axis, layers in enumerate(self.layers):
            found[axis] *= found[axis] >= self.min_size[axis]
            for window in layers:
                found[axis] = window.output(found[axis])
        return found[0], found[1]


def geometry_of(
    network: nn.Module, example: Callable[[], Tensor], *, rows_vary: bool
) -> Geometry | None:
    """Return the geometry of a network, or None where pieces would not give what the whole does.

    Args:
        network: In evaluation mode. What is found is kept with it, also in its copies.
        example: Makes an input (1, C, H, W) of it.
        rows_vary: Whether inputs may have any height; else they have that of the example.
    """
    if is_builtin(network):
        if not all(hasattr(network, name) for name in DECLARED):
            return None
        declared: Any = network
        layers = layer_windows(network, 0), layer_windows(network, 1)
        return Geometry(layers, declared.window_size, declared.min_size)
    found: Geometry | None = _kept(
        network, "probed_geometry", lambda: probe_geometry(network, example(), rows_vary=rows_vary)
    )
    return found


def min_size_of(
    network: nn.Module, example: Callable[[], Tensor], *, rows_vary: bool
) -> tuple[int, int] | None:
    """Return height and width of the smallest input that gives a position, if that can be told.

    Arguments are those of :func:`geometry_of`, which takes much longer.
    """
    if is_builtin(network):
        return getattr(network, "min_size", None)
    found: tuple[int, int] | None = _kept(
        network,
        "probed_min_size",
        lambda: _min_size(probe_steps(network, example(), rows_vary=rows_vary)),
    )
    return found


def _kept(network: nn.Module, name: str, probe: Callable[[], object]) -> Any:  # noqa: ANN401
    values = vars(network)
    if name not in values:
        try:
            with torch.inference_mode():
                values[name] = probe()
        except Exception:  # of a user's class, in any way: it raises again where it is used
            values[name] = None
    return values[name]


def _min_size(steps: tuple[Steps, Steps] | None) -> tuple[int, int] | None:
    return None if steps is None else (steps[0].min_size, steps[1].min_size)


def probe_geometry(network: nn.Module, example: Tensor, *, rows_vary: bool) -> Geometry | None:
    """Find the geometry of a network by trying; arguments are those of :func:`geometry_of`."""
    steps = probe_steps(network, example, rows_vary=rows_vary)
    if steps is None:
        return None
    network = deepcopy(network).eval()  # which may keep something of what it is given
    run, least = _runner(network, "fc3"), (steps[0].min_size, steps[1].min_size)
    columns = _measure_reach(run, example, steps, 1)
    rows = _measure_reach(run, example, steps, 0) if rows_vary else Window(least[0], least[0])
    if rows is None or columns is None:
        return None
    found = Geometry(([rows], [columns]), getattr(network, "window_size", least), least)
    if found.output_size(*found.window_size) != (1, 1):
        found = replace(found, window_size=least)
    height = least[0] + 2 * steps[0].stride if rows_vary else least[0]
    several = _noise(example, (height, least[1] + 2 * steps[1].stride))
    if several is None or _runner(network, "fc2")(several).shape[2:] != run(several).shape[2:]:
        return None
    holds = all(_holds(run, example, found, axis) for axis in ((0, 1) if rows_vary else (1,)))
    return found if holds else None


def probe_steps(
    network: nn.Module, example: Tensor, *, rows_vary: bool
) -> tuple[Steps, Steps] | None:
    """Find how many positions a network gives along rows and columns."""
    if example.dim() != 4:
        return None
    sizes: Sizes = map_sizes(Scores(network))
    channels, height = example.shape[1:3]

    def count(rows: int, columns: int, axis: int) -> int:
        found = sizes((2, channels, rows, columns))
        return 0 if found is None else (1, *found)[-2:][axis]

    if not rows_vary:
        columns = measure_steps(lambda size: count(height, size, 1))
        return None if columns is None else (Steps(height, height, 0), columns)
    side = smallest(lambda size: count(size, size, 0), 1)
    if side is None:
        return None
    rows = measure_steps(lambda size: count(size, side, 0))
    columns = measure_steps(lambda size: count(side, size, 1))
    return None if rows is None or columns is None else (rows, columns)


def _runner(network: Any, level: str) -> Run:  # noqa: ANN401
    def run(x: Tensor) -> Tensor:
        found: Tensor = network.features(x, level)
        return found[:, :, None] if found.dim() == 3 else found.flatten(2, -2)

    return run


def _noise(example: Tensor, size: Sequence[int]) -> Tensor | None:
    if example.shape[1] * prod(size) > MAX_ELEMENTS:
        return None
    generator = torch.Generator().manual_seed(0)
    return torch.randn(1, example.shape[1], *size, generator=generator).to(example)


def _measure_reach(
    run: Run, example: Tensor, steps: tuple[Steps, Steps], axis: int
) -> Window | None:
    """One window that is as good as all layers along an axis.

    NaN in as many neighbouring elements as the stride reaches every position that reads one of
    them. The window may reach less than a stride farther than the network does.
    """
    min_size, stride, shift = steps[axis]
    size = [steps[0].min_size, steps[1].min_size]
    size[axis] = min_size + 8 * stride
    while (x := _noise(example, size)) is not None:
        begin = size[axis] // 2
        x.narrow(2 + axis, begin, stride).fill_(torch.nan)
        reached = run(x)[0].isnan().any(dim=0).any(dim=1 - axis).nonzero().flatten().tolist()
        if not reached:
            return None
        if reached[0] > 0 and reached[-1] < (size[axis] + shift) // stride - 1:
            before = max(0, stride * reached[-1] - begin)
            after = begin + stride - stride * reached[0]
            beyond = shift + after - before - stride
            return Window(before + after, stride, before, beyond=beyond)
        size[axis] *= 2
    return None


def _holds(run: Run, example: Tensor, geometry: Geometry, axis: int) -> bool:
    """Whether pieces along an axis give what the whole does, of an even and an odd size."""
    kernel, stride = geometry.layers[axis][0][:2]
    for more in (0, stride // 2 + 1):
        size = list(geometry.min_size)
        size[axis] += 2 * kernel + 6 * stride + more
        x = _noise(example, size)
        if x is None:
            return False
        whole, pieces = run(x), in_tiles(run, x, geometry.layers, prod(size) * 2 // 3)
        scale = float(whole.abs().max())
        if whole.shape != pieces.shape or not bool(
            ((whole - pieces).abs() <= 1e-3 * scale + 1e-6).all()
        ):
            return False
        if tuple(whole.shape[2:]) != geometry.output_size(size[0], size[1]):
            return False
    return True
