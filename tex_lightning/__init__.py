"""Surface material classification from acceleration traces and photos."""

import os

__version__ = "0.1.0"

# PyTorch's threads spin while they wait for each other, and beside another busy process they wait
# for one that does not run: up to ten times as long. Sleeping costs an idle machine 5 to 20 %
# (`python -m benchmarks threads`). OpenMP reads this once, when PyTorch is imported.
if not {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME"} & os.environ.keys():
    os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
