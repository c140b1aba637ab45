"""Where cells are found, and which files a configuration may name."""

from __future__ import annotations

import hashlib
from importlib import resources
from pathlib import Path

from mvp.errors import ConfigError, UsageError
from mvp.fileedge import read_file

CELL_FILE = "cell.toml"
_TEMPLATES = "templates"


def bundled_root() -> Path:
    """The folder of bundled cells: inside an installed wheel, or of a checkout.

    Raises:
        ConfigError: the installation holds none.
    """
    package = Path(str(resources.files("mvp")))
    for folder in (package / "_data" / "cell_configs", package.parent / "cell_configs"):
        if folder.is_dir():
            return folder
    raise ConfigError(
        f"the installed package in {package} holds no bundled cells",
        hint="install mvp-cell again from its wheel",
        where=str(package),
    )


def bundled_names() -> list[str]:
    """Names of the cells that come with the program."""
    try:
        root = bundled_root()
    except ConfigError:
        return []
    return sorted(p.name for p in root.iterdir() if (p / CELL_FILE).is_file())


def template_names() -> list[str]:
    """Names of the templates for real hardware; they are copied, never used in place."""
    try:
        root = bundled_root() / _TEMPLATES
    except ConfigError:
        return []
    return sorted(p.parent.name for p in root.glob(f"*/{CELL_FILE}"))


def source_folder(name: str) -> Path:
    """The folder of a bundled cell or of a template.

    Raises:
        UsageError: neither; all of them are listed.
    """
    if name in bundled_names():
        return bundled_root() / name
    if name in template_names():
        return bundled_root() / _TEMPLATES / name
    raise UsageError(
        f"no bundled cell is called {name!r}",
        hint=f"bundled cells: {', '.join(bundled_names()) or 'none'}; templates for real "
        f"hardware: {', '.join(template_names()) or 'none'}",
        where=name,
    )


def find_cell(cell: str) -> Path:
    """The ``cell.toml`` of a path or a bundled name; a path wins.

    Raises:
        UsageError: neither; the bundled names are listed.
    """
    path = Path(cell)
    if path.is_file():
        return path.resolve()
    if (path / CELL_FILE).is_file():
        return (path / CELL_FILE).resolve()
    if cell in bundled_names():
        return (bundled_root() / cell / CELL_FILE).resolve()
    if cell in template_names():
        raise UsageError(
            f"{cell} is a template, not a cell",
            hint=f"`mvp-cell init DIR --from {cell}` makes a cell of it, to edit",
            where=cell,
        )
    where = f"{path}" if not path.is_dir() else f"{path}/{CELL_FILE}"
    raise UsageError(
        f"no cell called {cell!r}: {where} does not exist and no bundled cell has "
        "that name",
        hint=f"bundled cells: {', '.join(bundled_names()) or 'none'}; "
        "`mvp-cell init DIR` makes one to edit",
        where=cell,
    )


def find_task(cell_file: Path, default_task: str, task: str | None) -> Path:
    """The task file of ``--task`` (a path, or a name in the cell) or the default.

    Raises:
        UsageError: no such task; those of the cell are listed.
        ConfigError: the default task is not there or outside the cell.
    """
    if task is None:
        return inside(cell_file.parent, cell_file.parent, default_task, str(cell_file))
    path = Path(task)
    if path.is_file():
        return path.resolve()
    named = cell_file.parent / "tasks" / f"{task}.toml"
    if Path(task).name == task and named.is_file():
        return named.resolve()
    names = sorted(p.stem for p in (cell_file.parent / "tasks").glob("*.toml"))
    raise UsageError(
        f"no task {task!r}: neither a file nor a task of {cell_file.parent.name}",
        hint=f"tasks of this cell: {', '.join(names) or 'none'}",
        where=task,
    )


def home_of(file: Path) -> Path:
    """The folder a file's paths must stay in: its cell's, else its own."""
    for folder in (file.parent, *file.parent.parents):
        if (folder / CELL_FILE).is_file():
            return folder
    return file.parent


def as_stored(file: Path, home: Path) -> str:
    """How a plan names a file: relative to the cell's folder when it lies inside it."""
    file, home = file.resolve(), home.resolve()
    return file.relative_to(home).as_posix() if file.is_relative_to(home) else str(file)


def as_found(stored: str, home: Path) -> Path:
    """The file that ``as_stored`` named, whatever the current folder is."""
    return home / stored


def inside(home: Path, start: Path, name: str, where: str) -> Path:
    """Resolve ``name`` from ``start`` to an existing file inside ``home``.

    Raises:
        ConfigError: outside of ``home``, or no such file.
    """
    target = (start / name).resolve()
    if not target.is_relative_to(home.resolve()):
        raise ConfigError(
            f"{where}: {name!r} lies outside of {home}",
            hint="copy the file into that folder and name it relative to the file "
            "that uses it",
            where=where,
        )
    if not target.is_file():
        raise ConfigError(
            f"{where}: file {name!r} does not exist (looked for {target})",
            hint="correct the name or put the file there",
            where=where,
        )
    return target


def sha256_of(*files: Path) -> str:
    """SHA-256 over the bytes of the files, in order.

    Raises:
        ConfigError: a file cannot be read.
    """
    digest = hashlib.sha256()
    for file in files:
        digest.update(
            read_file(file, ConfigError, hint="check the path and its permissions")
        )
    return digest.hexdigest()
