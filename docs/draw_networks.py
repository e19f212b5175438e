"""Tables and drawings of the networks' layers, made of the code: ``python docs/draw_networks.py``.

Nothing is computed: tensors on PyTorch's device ``meta`` have sizes and no values. The tables go
between two comments of ``docs/networks.md``, the drawings into ``docs/NAME.svg``.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from hydra.utils import get_class
from torch import nn

import tex_lightning as tl
from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_config
from tex_lightning.inference.engine import count_macs
from tex_lightning.networks.blocks import ResponseNorm
from tex_lightning.networks.geometry import layer_windows, receptive_field
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.report.table import markdown
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

DOCS = Path(__file__).parent
PAGE = DOCS / "networks.md"
CLASSES = 69  # the paper's
LAYERS = (nn.Conv2d, nn.MaxPool2d, nn.LocalResponseNorm, nn.Dropout)
NAMES = {nn.MaxPool2d: "max pooling", ResponseNorm: "response norm.", nn.Dropout: "dropout"}
HEADINGS = (
    "layer", "kernel", "stride", "output", "receptive field", "parameters", "multiply-accumulates",
)  # fmt: skip
SIZE_HEADINGS = (
    "network", "input of one prediction", "stride", "receptive field", "features", "parameters",
    "multiply-accumulates",
)  # fmt: skip
TRUNK_HEADINGS = (
    "`trunk=`", "fragment", "smallest input", "stride", "receptive field",
    "fragments of 1632 x 1224", "parameters",
)  # fmt: skip
FUSION_HEADINGS = (
    "level", "features of both", "parameters of the joint layer", "additions for K = 1000",
)  # fmt: skip
Size = tuple[int, ...]


@dataclass(frozen=True)
class Layer:
    """A layer as it meets an input that gives exactly one prediction.

    Attributes:
        name: What it is.
        kernel: Height and width; none of a layer that works on each element.
        stride: Of its output.
        output: Channels, rows and columns.
        reach: Elements of the input along its longer side that one position depends on.
        parameters: Weights and biases.
        macs: Multiply-accumulates.
    """

    name: str
    kernel: Size | None
    stride: int
    output: Size
    reach: int
    parameters: int
    macs: int

    @property
    def cells(self) -> list[str]:
        """Of its row in a table."""
        kernel = "" if self.kernel is None else " x ".join(map(str, self.kernel))
        stride = "" if self.kernel is None else str(self.stride)
        output = " x ".join(map(str, self.output))
        counts = [f"{each:,}" if each else "" for each in (self.parameters, self.macs)]
        return [self.name, kernel, stride, output, str(self.reach), *counts]


def networks() -> dict[str, tuple[nn.Module, Size]]:
    """The paper's networks, each with an input that gives one prediction."""
    with torch.device("meta"):
        haptic = tl.HapticNet(CLASSES, width=1.0, norm="lrn")
        visual = tl.VisualNet(CLASSES, TRUNKS["alexnet_caffe"](width=1.0, norm="lrn"))
    return {
        "hapticnet": (haptic, (1, *haptic.window_size)),
        "visualnet": (visual, (3, *visual.window_size)),
    }


def sizes() -> dict[str, list[list[str]]]:
    """Rows of the smaller networks, by the name of their table."""
    names = ("efficientnet_lite0", "efficientnet_lite2")
    with torch.device("meta"):
        nets = {f"width {width:g}": tl.HapticNet(CLASSES, width=width) for width in (1, 0.48, 0.25)}
    return {
        "efficientnet": [_row(name, _texture_network(name), 3) for name in names],
        "sound": [_row(name, network, 1) for name, network in nets.items()],
    }


def trunk_rows() -> list[list[str]]:
    """Geometry of VisualNet on each option of ``trunk=``, at full width."""
    rows = []
    for path in sorted((CONF / "trunk").glob("*.yaml")):
        visual = compose_config(["model=visual", f"trunk={path.stem}"]).model.visual
        with torch.device("meta"):
            trunk = get_class(visual.trunk._target_)(width=1.0, norm=visual.norm)
            network = tl.VisualNet(CLASSES, trunk, head=visual.head)
        fragments = "{} x {}".format(*network.output_size(1224, 1632))
        parameters = sum(weights.numel() for weights in network.parameters())
        lengths = (network.window_size[0], network.min_size[0], network.stride)
        reach = receptive_field(layer_windows(network, 1))
        rows.append(
            [f"`{path.stem}`", *map(str, lengths), f"{reach:,}", fragments, f"{parameters:,}"]
        )
    return rows


def _texture_network(trunk: str) -> tl.VisualNet:
    with torch.device("meta"):
        return tl.VisualNet(CLASSES, TRUNKS[trunk](width=1.0, norm="none"), head=[])


def _row(name: str, network: Any, channels: int) -> list[str]:  # noqa: ANN401
    size = (channels, *network.window_size)
    macs = count_macs(lambda: network.eval()(torch.empty(1, *size, device="meta")))
    reach = receptive_field(layer_windows(network, 1))
    parameters = sum(each.numel() for each in network.parameters())
    window = " x ".join(map(str, network.window_size))
    counts = (network.stride, reach, network.hidden, parameters, macs)
    return [f"`{name}`", window, *(f"{each:,}" for each in counts)]


def fusion_rows() -> list[list[str]]:
    """What FusionNet adds to its networks at either level, for 69 classes and 1000 pairs."""
    (haptic, _), (visual, _) = networks().values()
    rows = []
    for level in ("fc2", "fc3"):
        with torch.device("meta"):
            network = tl.FusionNet(haptic, visual, classes=CLASSES, level=level)
        parameters = sum(each.numel() for each in network.head.parameters())
        sizes = [f"{each}" for each in network.sizes]
        rows.append([f"`{level}`", " + ".join(sizes), f"{parameters:,}", f"{1000 * CLASSES:,}"])
    return rows


def layers(network: nn.Module, size: Size) -> list[Layer]:
    """Layers of a network in the order in which an input (channels, rows, columns) meets them."""
    found: list[tuple[nn.Module, Size]] = []

    def note(layer: nn.Module, _: object, output: torch.Tensor) -> None:
        found.append((layer, tuple(output.shape[1:])))

    hooks = [each.register_forward_hook(note) for each in network.modules() if is_layer(each)]
    network.eval()(torch.empty(1, *size, device="meta"))
    for hook in hooks:
        hook.remove()
    return list(_measured(found))


def is_layer(module: nn.Module) -> bool:
    """Whether a module has a row of its own."""
    return isinstance(module, LAYERS)


def _measured(found: list[tuple[nn.Module, Size]]) -> Iterator[Layer]:
    reach, spacing, number, head = 1, 1, 0, 0
    for layer, output in found:
        parameters = sum(each.numel() for each in layer.parameters())
        kernel, stride, macs, name = None, 1, 0, NAMES.get(type(layer), "")
        if isinstance(layer, nn.Conv2d | nn.MaxPool2d):
            kernel, stride = _pair(layer.kernel_size), _pair(layer.stride)[1]
            reach += (kernel[1] - 1) * spacing
            spacing *= stride
        if isinstance(layer, nn.Conv2d):
            macs = math.prod(output) * layer.weight[0].numel()
            pad = not any(_pair(layer.padding)) and number > 1  # the heads' are not padded
            number, head = number + 1, head + pad
            name = f"FC{head}" if pad else f"convolution {number}"
        yield Layer(name, kernel, stride, output, reach, parameters, macs)


def _pair(value: Any) -> Size:  # noqa: ANN401
    return (value, value) if isinstance(value, int) else tuple(value)


def layer_table(rows: list[Layer]) -> str:
    """The layers in Markdown, with their sums."""
    sums = [f"**{sum(getattr(each, key) for each in rows):,}**" for key in ("parameters", "macs")]
    lines = [*(each.cells for each in rows), ["**in all**", "", "", "", "", *sums]]
    return "\n".join(markdown(HEADINGS, lines))


GAP, HIGHEST, TOP = 22, 150, 40


def drawing(rows: list[Layer], size: Size) -> str:
    """The layers as slabs, as high and wide as their maps and channels are (logarithmic)."""
    shown = [each for each in rows if each.kernel is not None]
    parts: list[str] = []
    left = GAP
    source = Layer("input", None, 1, size, 1, 0, 0)
    for each in (source, *shown):
        channels, height, width = each.output
        tall, wide = _scaled(max(height, width)), 6 + 5 * math.log2(channels + 1)
        colour = "#8fa8c8" if each.name.startswith("FC") else "#c9d6e8"
        colour = "#f0e2c4" if each.kernel is None else colour
        colour = "#ffffff" if "pooling" in each.name else colour
        top, middle = TOP + (HIGHEST - tall) / 2, left + 36
        kernel = "" if each.kernel is None else "x".join(map(str, each.kernel))
        stride = f" / {each.stride}" if each.stride > 1 else ""
        parts += [
            f'<rect x="{middle - wide / 2:.1f}" y="{top:.1f}" width="{wide:.1f}" '
            f'height="{tall:.1f}" fill="{colour}" stroke="#44546a"/>',
            _text(middle, TOP - 22, each.name.replace("convolution", "conv.")),
            _text(middle, TOP - 8, f"{kernel}{stride}"),
            _text(middle, TOP + HIGHEST + 18, f"{channels} ch."),
            _text(middle, TOP + HIGHEST + 33, f"{height} x {width}"),
            _text(middle, TOP + HIGHEST + 48, f"sees {each.reach}"),
        ]
        left += 72
    return _svg(left + GAP, TOP + HIGHEST + 62, parts)


def _scaled(side: int) -> float:
    return HIGHEST * (0.08 + 0.92 * math.log2(side) / 8.0)  # 256 is as high as it goes


def _text(x: float, y: float, words: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="#222222">{words}</text>'


def fusion_drawing() -> str:
    """FusionNet as boxes: two networks, pairs of their positions, one layer, one vote."""
    (haptic, _), (visual, _) = networks().values()
    with torch.device("meta"):
        network = tl.FusionNet(haptic, visual, classes=CLASSES)
    places = [
        haptic.output_size(50, SpectrogramFeatures().frames(200_000))[1],
        *visual.output_size(1224, 1632),
    ]
    one, other = network.sizes
    lanes = [
        (50, ["trace, 20 s", "HapticNet to FC2", f"{places[0]} positions x {one}"]),
        (
            130,
            [
                "photo, 1632 x 1224",
                "VisualNet to FC2",
                f"{places[1]} x {places[2]} positions x {other}",
            ],
        ),
    ]
    after = [
        "1000 random pairs",
        f"side by side: {one + other}",
        f"1x1 layer: {CLASSES} scores",
        "vote",
    ]
    parts = [part for y, words in lanes for part in _lane(20, y, words)]
    parts += _lane(560, 90, after)
    parts += [_arrow(512, 50, 558, 84), _arrow(512, 130, 558, 96)]
    return _svg(1240, 180, parts)


def _lane(x: float, y: float, boxes: list[str]) -> list[str]:
    """Boxes in a row with arrows between them."""
    parts, wide = [], 150
    for number, words in enumerate(boxes):
        left = x + number * (wide + 20)
        parts.append(
            f'<rect x="{left}" y="{y - 18}" width="{wide}" height="36" rx="4" fill="#c9d6e8" '
            'stroke="#44546a"/>'
        )
        parts.append(_text(left + wide / 2, y + 4, words))
        if number:
            parts.append(_arrow(left - 20, y, left - 2, y))
    return parts


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    return (
        f'<line x1="{x}" y1="{y}" x2="{to_x}" y2="{to_y}" stroke="#44546a" '
        'marker-end="url(#head)"/>'
    )


def _svg(width: int, height: int, parts: list[str]) -> str:
    head = (
        '<defs><marker id="head" markerWidth="7" markerHeight="7" refX="6" refY="3.5" '
        'orient="auto"><path d="M0,0 L7,3.5 L0,7 z" fill="#44546a"/></marker></defs>'
    )
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            'font-family="sans-serif" font-size="11" text-anchor="middle">',
            head,
            f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
            *parts,
            "</svg>\n",
        ]
    )


def filled(page: str, name: str, made: str) -> str:
    """A page with what was made between its comments ``made by …: NAME`` and ``end``."""
    pattern = rf"(<!-- made by [^>]*: {name} -->\n).*?(<!-- end -->)"
    text, count = re.subn(
        pattern, lambda found: f"{found[1]}\n{made}\n\n{found[2]}", page, flags=re.DOTALL
    )
    if count != 1:
        raise ValueError(f"The page has {count} places for what is made, not one.")
    return text


def made_files() -> dict[Path, str]:
    """Every file that is made here, with the content that it should have."""
    tables = {"fusionnet": "\n".join(markdown(FUSION_HEADINGS, fusion_rows()))}
    tables |= {name: "\n".join(markdown(SIZE_HEADINGS, rows)) for name, rows in sizes().items()}
    tables["trunks"] = "\n".join(markdown(TRUNK_HEADINGS, trunk_rows()))
    made = {DOCS / "fusionnet.svg": fusion_drawing()}
    for name, (network, size) in networks().items():
        rows = layers(network, size)
        tables[name] = layer_table(rows)
        made[DOCS / f"{name}.svg"] = drawing(rows, size)
    page = PAGE.read_text(encoding="utf-8")
    for name, lines in tables.items():
        page = filled(page, name, lines)
    return made | {PAGE: page}


def main() -> None:
    """Write tables and drawings."""
    for path, content in made_files().items():
        path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
