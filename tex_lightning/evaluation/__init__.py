"""Test results: a table with a row for each sample, and the statistics that follow from it."""
