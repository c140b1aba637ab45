"""Write the JSON schema of every file and document to ``cell_configs/schema``.

Editors complete and check TOML files with them. ``--check`` writes nothing and fails
when a published schema no longer fits the code.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from mvp.cell.schemas import all_schemas

FOLDER = Path(__file__).resolve().parents[1] / "cell_configs" / "schema"


def main(*, check: bool) -> int:
    stale = []
    for name, schema in all_schemas().items():
        text = json.dumps(schema, indent=1, sort_keys=True) + "\n"
        path = FOLDER / f"{name}.json"
        if not path.is_file() or path.read_text() != text:
            stale.append(path.name)
            if not check:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
    if stale:
        print(f"{'stale' if check else 'written'}: {', '.join(stale)}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main(check="--check" in sys.argv[1:]))
