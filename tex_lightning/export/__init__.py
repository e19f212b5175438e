"""Trained networks as files that run without this package: ONNX, torch.export, model cards."""
