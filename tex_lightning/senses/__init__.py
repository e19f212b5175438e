"""Senses: the decoder, the features and the network of one modality, from file to class scores.

:class:`~.base.Sense` is the base class, :class:`~.signal.SignalSense` that of traces and sounds,
and :class:`~.photo.PhotoSense` that of photos. Features map a decoded recording to network input.
"""
