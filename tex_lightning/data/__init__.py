"""From files to batches: readers, the table of recordings, decoding, the store, folds and batches.

A reader makes :class:`~.recordings.Recordings`, a table with a row for each file. A decoder turns
a file into an array, and :class:`~.store.Store` keeps the arrays. :mod:`.folds` divides the table
into training, validation and test. A bank holds the training recordings of one sense, and
:mod:`.datamodule` cuts batches from the banks.
"""
