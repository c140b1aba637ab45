"""Traffic kept for a fault report, and a report played back as a test.

A dump is JSON lines: a header, then one line per piece of traffic::

    {"schema": "mvp-cell/wire/1", "device": "lens", "address": "...", "dropped_bytes": 0}
    {"t_s": 12.01, "what": "out", "hex": "24530a"}
    {"t_s": 12.02, "what": "in", "hex": "4f4b0d0a"}
    {"t_s": 12.50, "what": "lost", "hex": ""}
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from mvp.errors import (
    DeviceError,
    LimitError,
    LinkLost,
    MotionStopped,
    RecordError,
    WireError,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from mvp.devices.transport import Transport

SCHEMA = "mvp-cell/wire/1"
SUFFIX = ".wire.jsonl"
What: TypeAlias = Literal["open", "out", "in", "lost", "close"]
# What a traffic line costs beside its bytes; keeps a stream of single bytes bounded.
_OVERHEAD_BYTES = 64


@dataclass(frozen=True)
class Traffic:
    """One piece of traffic; ``t_s`` is monotonic."""

    t_s: float
    what: What
    data: bytes = b""


class RecordingTransport:
    """Keeps the last traffic of another transport in a bounded buffer.

    Args:
        inner: carries the bytes.
        capacity_bytes: memory for traffic; the oldest is forgotten first.
        now_s: monotonic time.
    """

    def __init__(
        self,
        inner: Transport,
        *,
        capacity_bytes: int = 1 << 20,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = inner.name
        self._inner = inner
        self._capacity = capacity_bytes
        self._now_s = now_s
        self._lock = threading.Lock()
        self._traffic: deque[Traffic] = deque()
        self._held = 0
        self._dropped = 0

    @property
    def address(self) -> str:
        """Where it leads."""
        return self._inner.address

    def open(self) -> None:
        """Connect; see ``Transport``."""
        self._inner.open()
        self._keep("open")

    def close(self) -> None:
        """Disconnect; see ``Transport``."""
        self._inner.close()
        self._keep("close")

    def write(self, data: bytes) -> None:
        """Send; kept before it goes out, so that an answer never comes first."""
        self._keep("out", data)
        with self._noting_loss():
            self._inner.write(data)

    def read(self, *, timeout_s: float) -> bytes:
        """Receive; see ``Transport``."""
        with self._noting_loss():
            data = self._inner.read(timeout_s=timeout_s)
        if data:
            self._keep("in", data)
        return data

    def traffic(self) -> tuple[Traffic, ...]:
        """What is kept, oldest first."""
        with self._lock:
            return tuple(self._traffic)

    def dump(self, path: Path) -> Path:
        """Write what is kept as JSON lines; return the path.

        Raises:
            OSError: the file cannot be written.
        """
        with self._lock:
            traffic, dropped = tuple(self._traffic), self._dropped
        header = {
            "schema": SCHEMA,
            "device": self.name,
            "address": self.address,
            "dropped_bytes": dropped,
        }
        lines = [json.dumps(header)]
        lines += [
            json.dumps({"t_s": t.t_s, "what": t.what, "hex": t.data.hex()})
            for t in traffic
        ]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def dump_into(self, folder: Path) -> Path:
        """Write to the first free ``<device>-<n>.wire.jsonl`` of a folder.

        Raises:
            OSError: the folder cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        number = 1
        while (path := folder / f"{self.name}-{number}{SUFFIX}").exists():
            number += 1
        return self.dump(path)

    @contextmanager
    def _noting_loss(self) -> Iterator[None]:
        try:
            yield
        except LinkLost:
            self._keep("lost")
            raise

    def _keep(self, what: What, data: bytes = b"") -> None:
        with self._lock:
            self._traffic.append(Traffic(self._now_s(), what, data))
            self._held += len(data) + _OVERHEAD_BYTES
            while self._held > self._capacity and len(self._traffic) > 1:
                oldest = self._traffic.popleft()
                self._held -= len(oldest.data) + _OVERHEAD_BYTES
                self._dropped += len(oldest.data)


class ReplayTransport:
    """Plays traffic back: answers come after the bytes that they followed.

    Pieces need not be cut as they were; only the order of the bytes counts.

    Args:
        name: of the device, for errors.
        traffic: in the order in which it was recorded.
    """

    def __init__(self, name: str, traffic: Sequence[Traffic]) -> None:
        self.name = name
        self._left = deque(t for t in traffic if t.what in ("in", "out", "lost"))
        self._offset = 0
        self._changed = threading.Condition()
        self._open = False

    @classmethod
    def load(cls, path: Path) -> ReplayTransport:
        """Read a dump.

        Raises:
            RecordError: not a dump, or one whose beginning was forgotten.
        """
        try:
            lines = [json.loads(x) for x in path.read_text("utf-8").splitlines()]
            header, entries = lines[0], lines[1:]
            traffic = [
                Traffic(float(e["t_s"]), e["what"], bytes.fromhex(e["hex"]))
                for e in entries
            ]
            if header["schema"] != SCHEMA or not isinstance(header["device"], str):
                raise ValueError(f"schema {header['schema']!r}")
            lost_bytes = int(header["dropped_bytes"])
        except (
            OSError,
            ValueError,
            LookupError,
            TypeError,
            OverflowError,
            RecursionError,
        ) as error:
            raise RecordError(
                f"{path} is no recording of a wire: {error}", where=str(path)
            ) from error
        if lost_bytes:
            raise RecordError(
                f"{path} has lost its first {lost_bytes} bytes",
                hint="only a complete recording can be played back",
                where=str(path),
            )
        return cls(header["device"], traffic)

    @classmethod
    def of_exchanges(
        cls, name: str, exchanges: Sequence[tuple[bytes, bytes]]
    ) -> ReplayTransport:
        """A script of (what is sent, what is answered); either may be empty."""
        traffic: list[Traffic] = []
        for sent, answered in exchanges:
            traffic += [Traffic(0.0, "out", sent), Traffic(0.0, "in", answered)]
        return cls(name, [t for t in traffic if t.data])

    @property
    def address(self) -> str:
        """Says that it is a recording."""
        return "replay"

    @property
    def finished(self) -> bool:
        """Whether everything has been sent and answered."""
        return not self._left

    def open(self) -> None:
        """Begin, or go on where it was closed."""
        self._open = True

    def close(self) -> None:
        """Pause."""
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def write(self, data: bytes) -> None:
        """Compare with what was sent when it was recorded.

        Raises:
            WireError: something else was sent then, naming the offset among the bytes
                sent.
            LinkLost: not open.
        """
        with self._changed:
            self._require_open()
            for byte in data:
                self._match(byte)
            self._changed.notify_all()

    def read(self, *, timeout_s: float) -> bytes:
        """The next answer that is due; empty when none is.

        Raises:
            LinkLost: not open, or the recording says so.
        """
        with self._changed:
            self._require_open()
            self._changed.wait_for(self._is_due, timeout=timeout_s)
            self._require_open()
            if not self._is_due():
                return b""
            piece = self._left.popleft()
        if piece.what == "lost":
            raise LinkLost("the link was lost in the recording", device=self.name)
        return piece.data

    def _is_due(self) -> bool:
        return not self._open or bool(self._left and self._left[0].what != "out")

    def _match(self, byte: int) -> None:
        """Take one byte off what must be sent next, past answers not yet read."""
        for index, piece in enumerate(self._left):
            if piece.what != "out":
                continue
            if piece.data[0] != byte:
                raise WireError(
                    f"byte {self._offset} sent is {byte:02x}, "
                    f"recorded was {piece.data[0]:02x}",
                    device=self.name,
                )
            rest = Traffic(piece.t_s, "out", piece.data[1:])
            if rest.data:
                self._left[index] = rest
            else:
                del self._left[index]
            self._offset += 1
            return
        raise WireError(
            f"byte {self._offset} sent is {byte:02x}, the recording ends before it",
            device=self.name,
        )

    def _require_open(self) -> None:
        if not self._open:
            raise LinkLost("the recording is not open", device=self.name)


@contextmanager
def dumping_faults(transport: Transport, folder: Path | None) -> Iterator[None]:
    """Write the traffic down when a device error passes, and name the file in its hint.

    Refusals and stops that were asked for are no faults. Nested uses write once.

    Args:
        transport: dumped when it is a ``RecordingTransport``.
        folder: where to; None writes nothing.
    """
    try:
        yield
    except (LimitError, MotionStopped):
        raise
    except DeviceError as error:
        if (
            folder is not None
            and isinstance(transport, RecordingTransport)
            and SUFFIX not in error.hint
        ):
            error.hint = _with_file(error.hint, transport, folder)
        raise


def _with_file(hint: str, transport: RecordingTransport, folder: Path) -> str:
    try:
        note = f"the bytes are in {transport.dump_into(folder)}"
    except OSError as error:
        note = f"the bytes could not be written down: {error}"
    return f"{hint}; {note}" if hint else note
