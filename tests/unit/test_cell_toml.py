"""Lines of TOML keys and readable validation errors."""

from __future__ import annotations

import json
import tomllib
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvp.cell.cell_config import CellConfig
from mvp.cell.places import bundled_root
from mvp.cell.schemas import all_schemas
from mvp.cell.task_config import TaskConfig
from mvp.cell.toml_file import read_toml, validated
from mvp.cell.toml_positions import line_of, positions
from mvp.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

TEXT = '''
# a comment with [brackets] and = signs
title = "one # not a comment"

[table.inner]
"quoted key" = 1
list = [
  1,
  [2, 3],   # nested
  { x = 4, y = """
multi
line""" },
]
dotted.key = true

[[row]]
id = 'a'
[row.sub]
deep = 1
[[row]]
id = 'b'
'''


def test_every_key_is_found_on_its_line() -> None:
    tomllib.loads(TEXT)
    lines = positions(TEXT)
    expected = {
        ("title",): 3,
        ("table", "inner"): 5,
        ("table", "inner", "quoted key"): 6,
        ("table", "inner", "list"): 7,
        ("table", "inner", "list", 0): 8,
        ("table", "inner", "list", 1, 1): 9,
        ("table", "inner", "list", 2, "x"): 10,
        ("table", "inner", "dotted", "key"): 14,
        ("row", 0): 16,
        ("row", 0, "id"): 17,
        ("row", 0, "sub", "deep"): 19,
        ("row", 1): 20,
        ("row", 1, "id"): 21,
    }
    assert {path: lines[path] for path in expected} == expected


def test_a_missing_key_is_placed_at_its_table() -> None:
    assert line_of(positions(TEXT), ("row", 1, "name")) == 20


def leaves(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[object, ...]]:
    if isinstance(value, dict):
        return [q for k, v in value.items() for q in leaves(v, (*path, k))]
    if isinstance(value, list):
        return [q for i, v in enumerate(value) for q in leaves(v, (*path, i))]
    return [path]


@pytest.mark.parametrize("name", ["cell.toml", "tasks/paper_object.toml"])
def test_the_bundled_files_are_fully_located(name: str) -> None:
    file = bundled_root() / "virtual" / name
    text = file.read_text()
    lines = positions(text)
    written = text.splitlines()
    for path in leaves(tomllib.loads(text)):
        assert path in lines
        keys = [part for part in path if isinstance(part, str)]
        assert str(keys[-1]) in written[lines[path] - 1]


names = st.from_regex(r"[a-z]{1,6}", fullmatch=True)
scalars = st.one_of(st.integers(0, 9).map(str), names.map(lambda n: f'"{n} [#= "'))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(names, st.lists(st.tuples(names, scalars), max_size=4))))
def test_the_scanner_agrees_with_the_parser(
    tables: list[tuple[str, list[tuple[str, str]]]],
) -> None:
    lines = []
    for name, pairs in tables:
        lines.append(f"[[{name}]]  # [{name}]")
        lines += [f"{key} = {value}" for key, value in dict(pairs).items()]
    text = "\n".join(lines)
    found = positions(text)
    for path in leaves(tomllib.loads(text)):
        written = lines[found[path] - 1]
        assert written.startswith(str(path[-1]) + " =")


def task_with(tmp_path: Path, old: str, new: str) -> Path:
    text = (bundled_root() / "virtual/tasks/paper_object.toml").read_text()
    assert old in text
    path = tmp_path / "task.toml"
    path.write_text(text.replace(old, new))
    return path


def test_an_unknown_key_names_line_and_suggestion(tmp_path: Path) -> None:
    path = task_with(tmp_path, 'id = "vertical edge"', 'idd = "vertical edge"')
    line = 1 + path.read_text().splitlines().index('idd = "vertical edge"')
    with pytest.raises(ConfigError) as caught:
        validated(read_toml(path), TaskConfig)
    assert f"{path}:{line}: features[1].idd: unknown key" in caught.value.message
    assert 'did you mean "id"?' in caught.value.message
    assert "features[1].id: this key is missing" in caught.value.message


def test_several_problems_come_in_one_message_in_file_order(tmp_path: Path) -> None:
    path = task_with(tmp_path, "pixels = 1.0", "pixels = -2.0\ncolour = 3")
    with pytest.raises(ConfigError) as caught:
        validated(read_toml(path), TaskConfig)
    first, second = caught.value.message.splitlines()
    assert "resolution.pixels" in first
    assert "resolution.colour" in second
    assert first.startswith(caught.value.where)


CELL = bundled_root() / "simulated_gantry" / "cell.toml"


def refusal_of(path: Path, text: str) -> ConfigError:
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        validated(read_toml(path), CellConfig)
    return caught.value


def test_a_check_over_several_tables_points_at_the_one_that_it_names(
    tmp_path: Path,
) -> None:
    text = CELL.read_text().replace("[simulators.lens]", "[simulators.none]")
    text = text.replace('kind = "scf4"', "").replace("speed_scale = 3\n", "")
    text = text.replace("[simulators.none]", "")
    line = 2 + text[: text.index("\n[simulators.arm]")].count("\n")
    error = refusal_of(tmp_path / "cell.toml", text)
    assert error.where == f"{tmp_path / 'cell.toml'}:{line}"
    assert f"cell.toml:{line}: [simulators] stand for arm, lens and camera" in str(
        error
    )


def test_what_is_nowhere_in_a_file_is_located_at_the_file_alone(tmp_path: Path) -> None:
    text = CELL.read_text().replace("default_task", "# default_task")
    error = refusal_of(tmp_path / "cell.toml", text)
    assert error.where == str(tmp_path / "cell.toml")
    assert str(error).endswith("cell.toml: default_task: this key is missing")
    text = CELL.read_text().replace("simulated = true", "simulated = false")
    error = refusal_of(tmp_path / "cell.toml", text)
    assert "cell.toml:1:" not in str(error)
    assert ": [world] is the truth of a simulated cell" in str(error)


def test_the_published_schemas_fit_the_code() -> None:
    folder = bundled_root() / "schema"
    published = {p.stem: json.loads(p.read_text()) for p in folder.glob("*.json")}
    assert published == json.loads(json.dumps(all_schemas()))
