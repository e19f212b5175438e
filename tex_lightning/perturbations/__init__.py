"""Perturbations of a recording before it is classified, each on a scale with a unit."""
