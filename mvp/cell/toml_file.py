"""Read a TOML file into a model, with messages that name file, line and key."""

from __future__ import annotations

import difflib
import re
import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from mvp.cell.toml_positions import line_of, positions
from mvp.errors import ConfigError
from mvp.fileedge import read_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from pydantic_core import ErrorDetails

_Model = TypeVar("_Model", bound=BaseModel)
_MAX_SHOWN = 5
_TABLE = re.compile(r"\[([a-z_.]+)\]")
_MAX_BYTES = 4_000_000


@dataclass(frozen=True)
class TomlFile:
    """A parsed file that can still say where each value stands."""

    path: Path
    data: Mapping[str, Any]
    lines: dict[tuple[str | int, ...], int] = field(repr=False)

    def where(self, location: Sequence[str | int]) -> str:
        """``file:line`` of a key; the file alone when nothing of the key is in it."""
        line = line_of(self.lines, tuple(location))
        return f"{self.path}:{line}" if line else str(self.path)

    def error(
        self, location: Sequence[str | int], message: str, hint: str = ""
    ) -> ConfigError:
        """An error about one key of this file."""
        where = self.where(location)
        name = dotted(location)
        named = not location or message.startswith(f"[{name}]")
        what = "" if named else f"{name}: "
        return ConfigError(f"{where}: {what}{message}", hint=hint, where=where)


def read_toml(path: Path) -> TomlFile:
    """Parse a TOML file.

    Raises:
        ConfigError: missing, unreadable, not UTF-8, or a syntax error (with line).
    """
    text = _read_text(path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        where = _syntax_place(path, text, str(error))
        raise ConfigError(
            f"{where}: not valid TOML: {error}",
            hint="strings need quotes; every key needs a value",
            where=where,
        ) from error
    except RecursionError as error:
        raise ConfigError(f"{path}: nested too deeply", where=str(path)) from error
    return TomlFile(path, data, positions(text))


def _read_text(path: Path) -> str:
    hint = "check the path and its permissions"
    content = read_file(path, ConfigError, hint=hint, at_most=_MAX_BYTES + 1)
    if len(content) > _MAX_BYTES:
        raise ConfigError(
            f"{path}: larger than {_MAX_BYTES // 1_000_000} MB, "
            "this is not a configuration file",
            hint="name a .toml file",
            where=str(path),
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: not a text file in UTF-8 (byte {error.start})",
            hint="save the file as UTF-8",
            where=str(path),
        ) from error


def _syntax_place(path: Path, text: str, message: str) -> str:
    """``file:line:column`` from tomllib's own words."""
    words = message.replace(",", " ").replace(")", " ").split()
    if "line" in words and "column" in words:
        line = words[words.index("line") + 1]
        column = words[words.index("column") + 1]
        return f"{path}:{line}:{column}"
    return f"{path}:{text.count(chr(10)) + 1}:1"


def validated(
    source: TomlFile,
    model: type[_Model],
    *,
    data: Mapping[str, Any] | None = None,
    prefix: tuple[str | int, ...] = (),
) -> _Model:
    """Check a file, or the part ``data`` at ``prefix`` of it, against a model.

    Raises:
        ConfigError: every problem at once, the first one's place in ``where``.
    """
    try:
        return model.model_validate(source.data if data is None else data)
    except ValidationError as error:
        raise config_error(source, model, error, prefix) from error


def config_error(
    source: TomlFile,
    model: type[BaseModel],
    error: ValidationError,
    prefix: tuple[str | int, ...] = (),
    *,
    leave_out: frozenset[str] = frozenset(),
) -> ConfigError:
    """The readable form of a validation error, without some kinds of problems."""
    problems = sorted(
        (p for p in error.errors(include_url=False) if p["type"] not in leave_out),
        key=lambda p: line_of(source.lines, (*prefix, *p["loc"])),
    )
    texts = []
    for problem in problems[:_MAX_SHOWN]:
        location = (*prefix, *_known(source, prefix, problem))
        texts.append(source.error(location, _words(model, problem)).message)
    if len(problems) > _MAX_SHOWN:
        texts.append(f"... and {len(problems) - _MAX_SHOWN} more")
    first = (*prefix, *_known(source, prefix, problems[0]))
    return ConfigError(
        "\n".join(dict.fromkeys(texts)),
        hint=_hint(problems[0]),
        where=source.where(first),
    )


def _known(
    source: TomlFile, prefix: tuple[str | int, ...], problem: ErrorDetails
) -> tuple[str | int, ...]:
    """The location without the names of union members; a missing key stays."""
    path: tuple[str | int, ...] = ()
    for part in problem["loc"]:
        last = part == problem["loc"][-1] and problem["type"] == "missing"
        if (*prefix, *path, part) in source.lines or last:
            path = (*path, part)
    if problem["type"] == "feature_kind" and (*prefix, *path, "kind") in source.lines:
        path = (*path, "kind")
    return path or _named_table(source, prefix, problem)


def _named_table(
    source: TomlFile, prefix: tuple[str | int, ...], problem: ErrorDetails
) -> tuple[str | int, ...]:
    """Where the words of a check over several tables begin with one of them."""
    found = _TABLE.match(str(problem.get("ctx", {}).get("error", "")))
    table = tuple(found[1].split(".")) if found else ()
    return table if (*prefix, *table) in source.lines else ()


def dotted(location: Sequence[str | int]) -> str:
    """``("features", 1, "id")`` as ``features[1].id``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.lstrip(".") or "the file"


def _words(model: type[BaseModel], problem: ErrorDetails) -> str:
    """What is wrong, without the validator's vocabulary."""
    kind, value = problem["type"], problem["input"]
    context = problem.get("ctx", {})
    if kind == "missing":
        return "this key is missing"
    if kind == "extra_forbidden":
        return "unknown key" + _suggestion(model, problem["loc"])
    if kind == "feature_kind":
        return problem["msg"] + _meant_kind(value)
    if kind == "finite_number":
        return f"must be a finite number, not {value}"
    if kind in ("value_error", "assertion_error"):
        return str(context.get("error", problem["msg"]))
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        return f"{context.get('discriminator')} must be one of {context.get('expected_tags', 'the known kinds')}"
    message = problem["msg"][:1].lower() + problem["msg"][1:]
    message = message.removeprefix("input ")
    return f"{message}, not {_short(value)}"


def _meant_kind(feature: object) -> str:
    """The kind that was given, and the one that was meant."""
    given = feature.get("kind") if isinstance(feature, dict) else None
    if given is None:
        return ""
    close = difflib.get_close_matches(str(given), ("point", "edge", "face", "hole"), 1)
    return f", not {_short(given)}" + (f"; did you mean {close[0]!r}?" if close else "")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _hint(problem: ErrorDetails) -> str:
    if problem["type"] == "extra_forbidden":
        return "remove the key or correct its name"
    if problem["type"] == "missing":
        return "add the key; `mvp-cell init DIR` writes a commented example"
    return "correct the value"


def _suggestion(model: type[BaseModel], location: tuple[str | int, ...]) -> str:
    names = _names_at(model, location[:-1])
    close = difflib.get_close_matches(str(location[-1]), names, n=1, cutoff=0.55)
    if close:
        return f', did you mean "{close[0]}"?'
    return f"; known here: {', '.join(sorted(names))}" if names else ""


def _names_at(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Key names that the model knows at a place."""
    current: list[type[BaseModel]] = [model]
    for part in location:
        named = [m.model_fields[part] for m in current if part in m.model_fields]
        if named:
            current = [m for f in named for m in _models_in(f.annotation)]
        elif isinstance(part, str):
            tagged = [m for m in current if part in _tags(m)]
            current = tagged or current
    return sorted({f.alias or n for m in current for n, f in m.model_fields.items()})


def _tags(model: type[BaseModel]) -> tuple[object, ...]:
    """What the validator calls a model in a union: its name or its ``kind``."""
    kind = model.model_fields.get("kind")
    tags = get_args(kind.annotation) if kind is not None else ()
    return (model.__name__, *tags, *(("ref",) if "ref" in model.model_fields else ()))


def _models_in(annotation: object) -> list[type[BaseModel]]:
    """Every model named anywhere inside an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in get_args(annotation) for m in _models_in(inner)]
