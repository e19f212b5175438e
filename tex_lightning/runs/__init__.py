"""Shared parts of tasks: recordings and networks of one run, one fold, a family of systems."""
