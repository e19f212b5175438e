"""The run around the work: files, devices, console, progress, the run folder."""
