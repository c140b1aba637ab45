"""Lines of the GRBL family that are answered by ``ok`` or ``error:``, one at a time."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from drivers._gantry.codes import line_error
from drivers._gantry.grbl_identity import error_number
from mvp.devices import Take, text
from mvp.errors import DeviceError

if TYPE_CHECKING:
    from drivers._gantry.config import GantryConfig
    from mvp.devices import Session

_LOG = logging.getLogger(__name__)


class GrblOrders:
    """Gives orders.

    Args:
        session: with the controller.
        config: its dialect, and how long it may take.
        name: of the device.
    """

    def __init__(self, session: Session, config: GantryConfig, name: str) -> None:
        self._session = session
        self._config = config
        self._name = name
        self._refused = False

    def give(self, line: str, timeout_s: float | None = None) -> None:
        """Send a line and wait for its ``ok``.

        Raises:
            DeviceFault, LimitError: it was refused.
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
            MvpCellError: what the session's push handler raised.
        """
        try:
            self._session.request(
                f"{line}\n".encode("ascii"),
                lambda frame: self._is_ok(line, frame),
                timeout_s=self._config.answer_s if timeout_s is None else timeout_s,
            )
        except DeviceError:
            if self._config.firmware == "grblhal" and self._refused:
                self._clear_refusal()
            raise

    def _clear_refusal(self) -> None:
        """GrblHAL refuses every G-code after an error, until an empty line."""
        self._refused = False
        try:
            self._session.request(
                b"\n", lambda f: self._is_ok("", f), timeout_s=self._config.answer_s
            )
        except DeviceError as error:
            _LOG.warning("%s: %s", self._name, error.detail)

    def _is_ok(self, line: str, frame: bytes) -> Take:
        said = text(frame).strip()
        if said == "ok":
            return Take.DONE
        if said.startswith("error:"):
            self._refused = True
            raise line_error(error_number(said), line, self._name)
        return Take.OTHER
