"""From files to batches: readers, store, folds and data module."""
