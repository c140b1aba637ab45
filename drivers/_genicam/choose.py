"""Which library to use: the one asked for, or the one that is there."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivers._genicam.aravis import AravisBackend, aravis_problem
from drivers._genicam.telegenicam import TelegenicamBackend
from mvp.errors import PluginError

if TYPE_CHECKING:
    from drivers._genicam.backend import Backend

BackendName: TypeAlias = Literal["auto", "aravis", "telegenicam"]
BACKENDS = ("aravis", "telegenicam")
_HINT = (
    "`pip install 'mvp-cell[genicam]'` for telegenicam (GigE Vision), or Debian's "
    "gir1.2-aravis-0.8 with PyGObject<3.51 for Aravis (GigE Vision and USB3 Vision)"
)


def installed_backends() -> dict[str, str]:
    """By name: empty when the library can be used, else what is missing."""
    missing = "" if find_spec("telegenic") else "the package telegenicam is missing"
    return {"aravis": aravis_problem(), "telegenicam": missing}


def backend_for(name: BackendName) -> Backend:
    """A new backend, not yet open; ``auto`` prefers Aravis, which knows USB3 as well.

    Raises:
        PluginError: the library is not installed.
    """
    problems = installed_backends()
    usable = [key for key in BACKENDS if not problems[key]]
    wanted = usable[:1] if name == "auto" else [key for key in usable if key == name]
    if not wanted:
        asked = BACKENDS if name == "auto" else (name,)
        why = "; ".join(problems[key] for key in asked)
        raise PluginError(f"no GenICam library for backend {name!r}: {why}", hint=_HINT)
    return AravisBackend() if wanted[0] == "aravis" else TelegenicamBackend()
