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
    found = list(entry_points(group=WIZARDS, name=key))
    if not found:
        raise PluginError(
            f"there is no calibration called {key!r}",
            hint=f"there are: {', '.join(wizard_keys()) or 'none'}",
            where=key,
        )
    if len(found) > 1:
        owners = sorted(e.dist.name if e.dist else "unknown" for e in found)
        raise PluginError(
            f"the calibration {key!r} is installed more than once, by "
            f"{', '.join(owners)}",
            hint="uninstall all but one of them",
            where=key,
        )
    try:
        wizard = found[0].load()()
    except MvpCellError:
        raise
    except Exception as error:
        raise PluginError(
            f"the calibration {key!r} does not load: {type(error).__name__}: {error}",
            hint="install mvp-cell, or the plugin that brings it, again",
            where=key,
        ) from error
    missing = [name for name in _NEEDED if not hasattr(wizard, name)]
    if missing:
        raise PluginError(
            f"the calibration {key!r} has no {', '.join(missing)}",
            hint="a wizard needs " + ", ".join(_NEEDED),
            where=key,
        )
    return cast("Wizard[Any]", wizard)
