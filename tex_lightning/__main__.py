"""``python -m tex_lightning``: see :mod:`tex_lightning.cli`."""

import sys

from tex_lightning.cli import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
