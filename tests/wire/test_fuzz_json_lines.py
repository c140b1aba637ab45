"""Lines of JSON from anywhere: fault channels answer all, recordings refuse in words."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from drivers.simulators.control import answer
from drivers.simulators.host import SerialHost
from drivers.simulators.lens_machine import lens_verbs
from drivers.simulators.scf4 import Scf4Config, Scf4Machine
from mvp.devices import RealClock, ReplayTransport
from mvp.errors import RecordError
from tests.fuzzing import Mutants, at_length, fuzz

if TYPE_CHECKING:
    from pathlib import Path

VERBS = ["noise", "unplug", "say", "hold_next", "drop_next", "turn", "stall", "state"]
KEYS = ["seconds", "count", "hex", "axis", "steps", "drop", "flip", "do", "late_s"]
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner)
    ),
    max_leaves=6,
)
asked = st.builds(
    lambda verb, keys: json.dumps({"do": verb, **keys}).encode(),
    st.sampled_from(VERBS) | st.text(max_size=5),
    st.dictionaries(st.sampled_from(KEYS), values, max_size=3),
)
lines = asked | st.binary(max_size=60) | values.map(lambda v: json.dumps(v).encode())


@pytest.fixture(scope="module")
def verbs() -> dict[str, object]:
    """Those of a simulator that does not run: nothing listens, nothing can hang."""
    machine = Scf4Machine(Scf4Config())
    return {**SerialHost(machine).verbs(), **lens_verbs(machine, RealClock())}


def state_after(verbs: dict, line: bytes) -> dict[str, object]:
    """The line is answered in form; what the channel then says of its machine."""
    said = json.loads(answer(line, verbs))
    assert said["ok"] in (True, False)
    assert said["ok"] or said["message"]
    after = json.loads(answer(b'{"do": "state"}', verbs))
    assert after["ok"]
    return dict(after)


@settings(deadline=None)
@given(line=lines)
@example(line=b"[" * 1500)
@example(line=b'{"do": "noise", "seconds": 1e400}')
@example(line=b'{"do": "hold_next", "seconds": 0.5, "count": 1999999999999999991}')
def test_a_fault_channel_answers_every_line(verbs: dict, line: bytes) -> None:
    assert state_after(verbs, line)["moves_begun"] == 0  # no verb turns a motor


PIECES = b'{ } [ ] null true "" "x" , : "do": "axis": "zoom" "iris" "count": \\'.split()
ASKED = [json.dumps({"do": verb}).encode() for verb in VERBS] + [
    b'{"do": "noise", "seconds": 1, "drop": 0.5, "flip": 0.1, "late_s": 0.2}',
    b'{"do": "stall", "axis": "zoom"}',
    b'{"do": "turn", "axis": "iris", "steps": 20}',
    b'{"do": "say", "hex": "4f4b0d0a"}',
    b'{"do": "hold_next", "count": 1, "seconds": 0.5}',
    b'{"do": "drop_next", "count": 2}',
    b"[" * 1500,
]


@at_length
def test_a_fault_channel_answers_every_line_at_length(verbs: dict) -> None:
    def check(line: bytes) -> None:
        assert state_after(verbs, line)["moves_begun"] == 0  # no verb turns a motor

    fuzz(check, Mutants(ASKED, PIECES))


HEADER = {"schema": "mvp-cell/wire/1", "device": "lens", "dropped_bytes": 0}
ENTRY = {"t_s": 0.0, "what": "in", "hex": "00"}


def like(good: dict[str, object]) -> st.SearchStrategy[bytes]:
    """The line with one key changed, or with none."""
    changed = st.dictionaries(st.sampled_from(list(good)), values, max_size=1)
    return changed.map(lambda keys: json.dumps({**good, **keys}).encode())


dumps = st.builds(
    lambda head, rest: b"\n".join([head, *rest]),
    like(HEADER) | lines,
    st.lists(like(ENTRY) | lines, max_size=4),
)


def is_recording_or_refused(place: Path, content: bytes) -> bool:
    place.write_bytes(content)
    try:
        return ReplayTransport.load(place).address == "replay"
    except RecordError as error:
        return str(place) in error.message


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=dumps)
def test_any_file_is_a_recording_or_refused(tmp_path: Path, content: bytes) -> None:
    assert is_recording_or_refused(tmp_path / "dump", content)


@at_length
def test_any_file_is_a_recording_or_refused_at_length(tmp_path: Path) -> None:
    head, entry = json.dumps(HEADER).encode(), json.dumps(ENTRY).encode()
    lost = json.dumps({**ENTRY, "what": "lost", "hex": ""}).encode()
    dumps = Mutants([b"\n".join([head, entry, entry, lost]), head], PIECES)

    def check(content: bytes) -> None:
        assert is_recording_or_refused(tmp_path / "dump", content)

    fuzz(check, dumps)
