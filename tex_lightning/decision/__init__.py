"""How fragments become one label: votes, early stopping, calibration, unknown materials."""
