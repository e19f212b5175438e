"""Run an ONNX file by onnxruntime, with as many threads as PyTorch has."""

from typing import Any

import torch

from tex_lightning.export.check import Runner
from tex_lightning.export.onnx_file import require

ERRORS_ONLY = 3  # of onnxruntime's levels: it warns of every input that has a default


def onnx_runner(model: Any) -> Runner:  # noqa: ANN401
    """Return a function that runs a model, given as ``onnx.ModelProto``."""
    runtime = require("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.log_severity_level = ERRORS_ONLY
    session = runtime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    names = [each.name for each in session.get_outputs()]
    return lambda inputs: dict(zip(names, session.run(names, dict(inputs)), strict=True))
