"""What results say of the machine that they were measured on."""

import os

import torch

from tex_lightning.core.environment import environment


def test_results_name_what_those_of_an_nvidia_gpu_depend_on(monkeypatch, tmp_path):
    """Of a GPU that is not there; the CPU's have nothing of it."""
    said = tmp_path / "nvidia-smi"
    said.write_text("#!/bin/sh\necho 570.86.10\necho 570.86.10\n")
    said.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"GPU {device.index}")
    monkeypatch.setattr(torch.version, "cuda", "12.8")
    monkeypatch.setattr(torch.backends.cudnn, "version", lambda: 91002)
    found = environment(torch.device("cuda", 1), "bf16-mixed")
    assert found["device"] == "GPU 1"
    assert found["cuda"] == {
        "cuda": "12.8", "cudnn": 91002, "driver": "570.86.10",
        "tf32": torch.backends.cuda.matmul.allow_tf32, "precision": "bf16-mixed",
    }  # fmt: skip
    said.write_text("#!/bin/sh\nexit 9\n")
    assert environment(torch.device("cuda", 1))["cuda"]["driver"] is None
    assert "cuda" not in environment(torch.device("cpu"))
