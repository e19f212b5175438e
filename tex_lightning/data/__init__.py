"""Readers, store, folds and data module: the way from files to batches."""
