"""Features: modules that run on the device of the batch and travel with the checkpoint."""
