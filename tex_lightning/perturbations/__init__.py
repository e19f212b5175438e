"""What may go wrong with a recording before it is classified, each on a scale of its own unit."""
