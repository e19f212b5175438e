"""``python -m tex_lightning``: see :mod:`tex_lightning.cli`."""

import atexit
import gc
import sys

from tex_lightning.core.ranks import remember_signal

remember_signal()  # what is imported next takes seconds, in which SIGUSR1 would end this process

try:
    from tex_lightning.cli import main
except KeyboardInterrupt:  # Ctrl-C
    sys.exit(130)

__all__ = ["main"]

atexit.register(gc.freeze)  # to look through all modules for garbage takes half a second

if __name__ == "__main__":
    sys.exit(main())
