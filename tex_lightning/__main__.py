"""``python -m tex_lightning``: see :mod:`tex_lightning.cli`."""

import sys

try:
    from tex_lightning.cli import main
except KeyboardInterrupt:  # Ctrl-C before anything has begun
    print("Interrupted.", file=sys.stderr)
    raise SystemExit(130) from None

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
