"""Trained classifiers as files that run without this package: ONNX, torch.export, a web page."""
