"""Compare the calibrations of a simulated cell with what is true in its world.

    python -m tools.compare_with_truth CELLDIR

The same as ``mvp-cell truth CELLDIR``, for a checkout that is not installed.
"""

from __future__ import annotations

import sys

from mvp.cell.truth_compared import Compared, compare, told
from mvp.cli.main import invoke

__all__ = ["Compared", "compare", "told"]

if __name__ == "__main__":
    sys.exit(invoke(["truth", *sys.argv[1:]]))
