"""Wizards by key, found through the entry points ``mvp_cell.wizards``."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, cast

from mvp.errors import MvpCellError, PluginError

if TYPE_CHECKING:
    from mvp.wizard.protocol import Wizard

WIZARDS = "mvp_cell.wizards"
_NEEDED = ("key", "writes", "sessions", "steps", "outcome", "page")


def wizard_keys() -> tuple[str, ...]:
    """Keys of the installed wizards, sorted; loads none of them."""
    return tuple(sorted({entry.name for entry in entry_points(group=WIZARDS)}))


def load_wizard(key: str) -> Wizard[Any]:
    """The wizard called ``key``.

    Raises:
        PluginError: unknown, installed twice, or it does not load.
    """
    wizard = load_named(WIZARDS, key, "calibration", made=True)
    missing = [name for name in _NEEDED if not hasattr(wizard, name)]
    if missing:
        raise PluginError(
            f"the calibration {key!r} has no {', '.join(missing)}",
            hint="a wizard needs " + ", ".join(_NEEDED),
            where=key,
        )
    return cast("Wizard[Any]", wizard)


def load_named(group: str, key: str, what: str, *, made: bool = False) -> object:
    """What an entry point of a group names.

    Args:
        group: of entry points.
        key: of the entry point.
        what: it is, in words.
        made: it is a class, and one of it is wanted.

    Raises:
        PluginError: unknown, installed twice, or it does not load.
    """
    found = list(entry_points(group=group, name=key))
    if not found:
        there = sorted({entry.name for entry in entry_points(group=group)})
        raise PluginError(
            f"there is no {what} called {key!r}",
            hint=f"there are: {', '.join(there) or 'none'}",
            where=key,
        )
    if len(found) > 1:
        owners = sorted(e.dist.name if e.dist else "unknown" for e in found)
        raise PluginError(
            f"the {what} {key!r} is installed more than once, by {', '.join(owners)}",
            hint="uninstall all but one of them",
            where=key,
        )
    try:
        loaded = found[0].load()
        return loaded() if made else loaded
    except MvpCellError:
        raise
    except Exception as error:
        raise PluginError(
            f"the {what} {key!r} does not load: {type(error).__name__}: {error}",
            hint="install mvp-cell, or the plugin that brings it, again",
            where=key,
        ) from error
