"""One module for each ``task=NAME``, with a function ``run(config, job)``.

It returns what ``results.json`` will hold, which :mod:`tex_lightning.cli` writes.
"""
