"""One module for each ``task=NAME``, with a function ``run(config, job)``."""
