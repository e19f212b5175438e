"""Convolutions in 8 bits, calibrated on training recordings (static quantisation)."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.errors import UserError
from tex_lightning.export.layers import BandedResponseNorm
from tex_lightning.export.onnx_file import require
from tex_lightning.export.recordings import Given
from tex_lightning.export.tracing import quiet

CALIBRATION = 20  # recordings


def quantised(model: Any, samples: Sequence[Given]) -> Any:  # noqa: ANN401
    """A copy of an ONNX model whose convolutions compute in int8, weights by channel.

    Sums of squares of response normalisation stay float: they span too many powers of ten.

    Args:
        model: ``onnx.ModelProto`` as :func:`~tex_lightning.export.onnx_file.plain_onnx` gives it.
        samples: By which the ranges of activations are measured.

    Raises:
        UserError: If there is nothing to quantise.
    """
    onnx, tools = require("onnx"), require("onnxruntime.quantization")
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    left_out = [node.name for node in convolutions if _is_within(node, BandedResponseNorm.__name__)]
    if len(left_out) == len(convolutions):
        raise UserError("This network has no convolution; leave export.int8=true out.")
    with tempfile.TemporaryDirectory() as folder, quiet():
        before, after = Path(folder) / "float.onnx", Path(folder) / "int8.onnx"
        before.write_bytes(model.SerializeToString())
        tools.quantize_static(
            str(before),
            str(after),
            _Reader(samples),
            quant_format=tools.QuantFormat.QDQ,
            op_types_to_quantize=["Conv"],
            nodes_to_exclude=left_out,
            per_channel=True,
        )
        small = onnx.load(str(after))
    if not small.metadata_props:
        small.metadata_props.extend(model.metadata_props)
    return small


def _is_within(node: Any, name: str) -> bool:  # noqa: ANN401
    """Whether a node comes from a module of that class."""
    return any(name in entry.value for entry in node.metadata_props if "class" in entry.key)


class _Reader:
    """Gives onnxruntime one recording after the other, as its own reader would."""

    def __init__(self, samples: Sequence[Given]) -> None:
        self.feeds = iter(
            {name: each.numpy() for name, each in sample.raw.items()} for sample in samples
        )

    def get_next(self) -> dict[str, Any] | None:
        return next(self.feeds, None)
