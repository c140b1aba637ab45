"""The private fault channel of the simulators."""

import threading
from collections.abc import Mapping

import pytest

from drivers.simulators.control import (
    ControlClient,
    ControlRefused,
    ControlServer,
    answer,
)


def _double(asked: Mapping[str, object]) -> dict[str, object]:
    return {"twice": 2 * int(str(asked["number"]))}


VERBS = {"double": _double, "nothing": lambda asked: None}


def test_a_verb_gets_its_arguments_and_answers() -> None:
    assert answer(b'{"do": "double", "number": 4}', VERBS) == (
        b'{"ok": true, "twice": 8}\n'
    )


@pytest.mark.parametrize(
    "line", [b"", b"[]", b"3", b"{", b'{"do": "fly"}', b'{"do": "double"}', b"\xff\n"]
)
def test_nonsense_is_refused_with_a_reason(line: bytes) -> None:
    assert answer(line, VERBS).startswith(b'{"ok": false, "message": ')


def test_a_client_asks_over_loopback_and_no_thread_stays() -> None:
    server = ControlServer(VERBS)
    server.start()
    with ControlClient(server.port) as first, ControlClient(server.port) as second:
        assert first.do("double", number=3) == {"twice": 6}
        assert second.do("nothing") == {}
        with pytest.raises(ControlRefused, match="fly"):
            second.do("fly")
        server.stop()
    assert server.port == 0
    assert not [t for t in threading.enumerate() if t.name == "simulator-control"]
