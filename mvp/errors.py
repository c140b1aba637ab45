"""Every error this project raises on purpose.

::

    MvpCellError                 1   a bug, when nothing more exact fits
    |- InputError                2   something a person gave us
    |  |- UsageError             2   a command line that makes no sense
    |  |- ConfigError            2   a key or value in a TOML file (where = file:line)
    |  |- GeometryError          2   a CAD file or mesh that cannot be used
    |  |- FeatureError           2   a feature that is not on the part, or is degenerate
    |  |- CalibrationError       2   missing, stale, foreign or too poor
    |  |- RecordError            2   a run folder that is corrupt, locked or changed
    |  |- OutputError            2   a folder or disk that cannot take the result
    |  '- PluginError            2   a driver that is unknown or does not load
    |- FrameError                1   two transforms whose frames do not meet (a bug)
    |- InfeasibleError           3   no admissible plan
    |- DeviceError               4   names the device
    |  |- ConnectError           4   nobody answers
    |  |- LinkLost               4   the link broke: unplugged, closed, reset
    |  |- DeviceTimeout          4   somebody stopped answering
    |  |- WireError              4   what came back makes no sense
    |  |- LimitError             4   asked for what the device must not do; nothing moved
    |  |- DeviceFault            4   the device reports a fault (with its own code)
    |  '- MotionStopped          4   ``stop()`` was called while it moved
    |- VerificationFailed        5   only at the command line; inside it is a record
    '- StoppedByOperator         6   Ctrl-C

The number is the exit code of the command line (``mvp/cli``).
"""

from __future__ import annotations

from typing import ClassVar


class MvpCellError(Exception):
    """What happened, to whom, and what to do next.

    Args:
        message: what happened, naming the file, device or feature.
        hint: what the reader can do about it.
        where: file (with line), device or feature.

    Attributes:
        may_still_move: what an accepted command may still be moving, and until when.
        stands: what was seen to stand after everything had been told to stop.
    """

    exit_code: ClassVar[int] = 1
    may_still_move: str = ""
    stands: str = ""

    def __init__(self, message: str, *, hint: str = "", where: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.where = where


class InputError(MvpCellError):
    """Something a person gave us cannot be used."""

    exit_code = 2


class UsageError(InputError):
    """A command line that makes no sense, or a question nobody can answer."""


class ConfigError(InputError):
    """A key or value in a configuration file."""


class GeometryError(InputError):
    """A CAD file or a mesh that cannot be used."""


class FeatureError(InputError):
    """A feature that is degenerate, inside the solid or not on the part."""


class CalibrationError(InputError):
    """A calibration that is missing, stale, foreign or too poor."""


class RecordError(InputError):
    """A run folder that is corrupt, locked, or belongs to other inputs."""


class OutputError(InputError):
    """A folder or a disk that cannot take what must be written."""


class PluginError(InputError):
    """A driver that is unknown, foreign or does not load."""


class FrameError(MvpCellError):
    """Two transforms were chained whose inner frames differ."""


class InfeasibleError(MvpCellError):
    """No admissible plan was found."""

    exit_code = 3


class DeviceError(MvpCellError):
    """A device failed.

    Attributes:
        device: its name in the cell.
        detail: the message without that name.
    """

    exit_code = 4

    def __init__(self, message: str, *, device: str, hint: str = "") -> None:
        # What is passed on from below has the name already.
        self.detail = message.removeprefix(f"{device}: ")
        super().__init__(f"{device}: {self.detail}", hint=hint, where=device)
        self.device = device


class ConnectError(DeviceError):
    """Nobody answers."""


class LinkLost(DeviceError):
    """The link to the device broke: unplugged, closed or reset by the far end."""


class DeviceTimeout(DeviceError):
    """Somebody stopped answering before the deadline."""


class WireError(DeviceError):
    """What came back over the wire makes no sense."""


class LimitError(DeviceError):
    """The device was asked for what it must not do; nothing has moved."""


class DeviceFault(DeviceError):
    """The device reports a fault; ``code`` is its own word for it."""

    def __init__(
        self, message: str, *, device: str, code: str = "", hint: str = ""
    ) -> None:
        super().__init__(message, device=device, hint=hint)
        self.code = code


class MotionStopped(DeviceError):
    """``stop()`` was called while the device moved."""


class VerificationFailed(MvpCellError):
    """A picture was taken and does not keep the promise."""

    exit_code = 5


class StoppedByOperator(MvpCellError):
    """A person stopped the run."""

    exit_code = 6
