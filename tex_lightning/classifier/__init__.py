"""The classifier of a sample: senses, fusion layer and decision rule, rebuilt from its card.

:class:`~.card.Card` holds the plain values of a checkpoint, :mod:`.vote` the decision rules, and
:mod:`.statistics` what tells an unknown recording.
"""
