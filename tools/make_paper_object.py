"""Write the paper's object as an STL file, mm: the part of the `virtual` cell.

Usage: python tools/make_paper_object.py [FILE] [--without-slit]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mvp.geometry import write_stl
from mvp.scene import PaperObject, paper_object, without_slit

DEFAULT = Path(__file__).parents[1] / "cell_configs/virtual/parts/paper_object.stl"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", default=DEFAULT)
    parser.add_argument("--without-slit", action="store_true")
    arguments = parser.parse_args()
    sizes = without_slit() if arguments.without_slit else PaperObject()
    write_stl(paper_object(sizes), arguments.file)
    print(f"wrote {arguments.file}")


if __name__ == "__main__":
    main()
