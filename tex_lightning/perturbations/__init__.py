"""Perturbations of decoded recordings at severities with a unit, for tests and for training."""
