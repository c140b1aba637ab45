"""Keys of a table that only a plug-in understands, checked by its own model."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from pydantic import BaseModel, ValidationError

from mvp.cell.toml_file import config_error, dotted
from mvp.errors import PluginError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.loading import LoadedCell

_Model = TypeVar("_Model", bound=BaseModel)


@contextmanager
def naming_place(cell: LoadedCell, key: tuple[str, ...]) -> Iterator[None]:
    """Say where in the cell file the plug-in was asked for that does not load."""
    try:
        yield
    except PluginError as error:
        where = cell.source.where(key)
        raise PluginError(
            f"{where}: {dotted(key)}: {error.message}", hint=error.hint, where=where
        ) from error


def own_keys(
    cell: LoadedCell,
    table: tuple[str, ...],
    options: dict[str, object],
    model: type[_Model],
    *,
    may_miss: bool = False,
) -> _Model:
    """Check a plug-in's keys; with ``may_miss``, missing ones are no problem yet.

    Raises:
        ConfigError: with file and line.
    """
    try:
        return model.model_validate(options)
    except ValidationError as error:
        kinds = {problem["type"] for problem in error.errors(include_url=False)}
        if may_miss and kinds == {"missing"}:
            return model.model_construct(None, **options)
        awaited = frozenset({"missing"}) if may_miss else frozenset[str]()
        raise config_error(
            cell.source, model, error, table, leave_out=awaited
        ) from error
