"""Predictions of a trained classifier: the accelerated copy, files, live streams, early stopping.

:class:`~.predictor.Predictor` classifies files and arrays, and :class:`~.stream.LiveStream` a
signal that is being recorded. Both use the copy that :func:`~.engine.accelerate` makes.
"""
