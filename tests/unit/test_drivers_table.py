"""``drivers/README.md`` says of every driver what it has met, and every key."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from mvp.devices import list_drivers, load_driver

README = Path(__file__).parents[2] / "drivers" / "README.md"
OURS = [e for e in list_drivers() if e.distribution == "mvp-cell"]


def rows(title: str) -> dict[str, str]:
    """Lines of the table under a heading, by each name in its first column."""
    text = README.read_text(encoding="utf-8")
    section = text.split(f"# {title}\n", 1)[1].split("\n## ", 1)[0]
    found = {}
    for line in section.splitlines():
        first = line.split("|")[1] if line.startswith("| `") else ""
        found.update(dict.fromkeys(re.findall(r"`([^`]+)`", first), line))
    return found


@pytest.mark.parametrize("title", ["Drivers", "Limits", "Keys"])
def test_every_driver_is_in_every_table(title: str) -> None:
    assert set(rows(title)) == {entry.key for entry in OURS}


@pytest.mark.parametrize("entry", OURS, ids=lambda entry: str(entry.key))
def test_the_keys_of_a_driver_are_those_of_its_configuration(entry) -> None:  # type: ignore[no-untyped-def]
    fields = load_driver(entry.key, entry.role).Config.model_fields
    cells = rows("Keys")[entry.key].split("|")[2]
    assert set(re.findall(r"`([^`]+)`", cells)) == set(fields)
    required = {name for name, field in fields.items() if field.is_required()}
    assert set(re.findall(r"\*\*`([^`]+)`\*\*", cells)) == required


def test_every_driver_names_its_file_and_whether_it_met_hardware() -> None:
    for entry in OURS:
        line = rows("Drivers")[entry.key]
        module = entry.target.partition(":")[0].removeprefix("drivers.")
        assert f"`{module}.py`" in line
        assert "hardware" in line.rsplit("|", 2)[1]


def test_every_simulator_is_listed() -> None:
    found = {entry.name for entry in entry_points(group="mvp_cell.simulators")}
    assert set(rows("Simulators")) == found


def test_every_link_leads_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")):
        assert (README.parent / target).exists(), target
