"""Outcomes of classifiers on test samples, and their statistics."""
