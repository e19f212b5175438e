"""Readers, store, folds and data module: the way from files to batches.

Called, the package is :func:`tex_lightning.cli.data`:

    >>> import tex_lightning as tl
    >>> recordings = tl.data("model=haptic", "data=folder", "data.root=DIR")
    >>> x, label = next(iter(recordings.train_dataloader()))
    >>> x.shape[1:3], label.dtype
    (torch.Size([1, 50]), torch.int64)
"""
