"""Speed and memory as ratios: what is compared takes turns in one run, on one machine.

``python -m benchmarks`` runs them all, ``python -m benchmarks NAME ...`` some. Each is a module
here with a function ``measure() -> dict`` of figures, which may be nested; names that end in
``ratio`` are what to look at, as they hardly depend on how busy the machine was.
"""

import sys
from pathlib import Path

# the runtime is a package of its own, which a checkout has beside it and need not have installed
sys.path.append(str(Path(__file__).parents[1] / "runtime"))
