"""From fragment predictions to one label: pure functions."""
