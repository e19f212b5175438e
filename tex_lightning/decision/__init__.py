"""The decision: pure functions from fragment predictions to one label."""
