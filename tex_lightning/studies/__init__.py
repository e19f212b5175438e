"""Train, test and compare systems: a checkpoint under a decision, on the folds of a data set."""
