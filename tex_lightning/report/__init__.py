"""The output of a run: results, figures, tables."""
