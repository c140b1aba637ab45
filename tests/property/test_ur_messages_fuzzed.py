"""Whatever a dying worker or a broken network says, only our own errors come of it."""

from contextlib import suppress

from hypothesis import given
from hypothesis import strategies as st

from drivers._ur.messages import Unreadable, decode, encode
from drivers._ur.status import Freshness, Implausible, Status
from tests.fuzzing import MANY, Mutants, at_length, fuzz

ANGLE = st.floats(-6.3, 6.3)
SIX = st.tuples(*[ANGLE] * 6)
STATUS = st.builds(
    Status,
    t_controller_s=st.floats(0, 1e7),
    joints_rad=SIX,
    speeds_rad_s=SIX,
    target_speeds_rad_s=SIX,
    tcp_m_rad=SIX,
    robot_mode=st.integers(-1, 8),
    safety_mode=st.integers(1, 13),
    safety_bits=st.integers(0, 4095),
    runtime_state=st.integers(0, 5),
    slider=st.floats(0, 1),
    payload_kg=st.none() | st.floats(0, 35),
    payload_cog_m=st.none() | st.tuples(*[ANGLE] * 3),
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


def is_taken_or_refused(line: bytes) -> bool:
    """A message that comes back as it was sent, or none."""
    try:
        found = decode(line)
    except Unreadable:
        return True
    return decode(encode(found)).keys() == found.keys()


def is_status_or_implausible(good: Status, name: str, value: object) -> bool:
    """A status that can be judged, or none."""
    try:
        found = Status.from_wire({**good.to_wire(), name: value})
    except Implausible:
        return True
    return isinstance(found.standing, bool)


@given(STATUS)
def test_a_status_comes_back_as_it_was_sent(status):
    again = decode(encode({"status": status.to_wire()}))["status"]
    assert Status.from_wire(again) == status


@given(st.binary(max_size=200))
def test_any_line_is_a_message_or_unreadable(line):
    assert is_taken_or_refused(line)


@given(STATUS, st.sampled_from(sorted(Status.__dataclass_fields__)), JSON)
def test_any_status_is_one_or_implausible(good, name, value):
    assert is_status_or_implausible(good, name, value)


SEEN = {
    "id": 7,
    "ok": True,
    "status": Status(
        12.5, (0.1,) * 6, (0.0,) * 6, (0.0,) * 6, (0.3,) * 6, 7, 1, 1, 2, 1.0, 1.5
    ).to_wire(),
}
LINES = [
    encode(SEEN),
    encode({"status": SEEN["status"]}),
    encode({"id": 3, "ok": False, "kind": "refused", "message": "no"}),
    encode({"lost": "the controller hung up"}),
    encode({"hello": 1}),
]
PIECES = b'{ } [ ] [1] [] {} null true "x" "" , : "id": "status": \\ \\u'.split()


@at_length
def test_any_line_is_a_message_or_unreadable_at_length():
    def check(line: bytes) -> None:
        assert is_taken_or_refused(line)

    fuzz(check, Mutants([*LINES, b"[" * 1500], PIECES))


@at_length
def test_any_status_is_one_or_implausible_at_length():
    """Damaged on the wire; those that are no message any more do not count."""
    statuses = Mutants([encode(SEEN["status"])], PIECES)
    judged = 0

    def check(line: bytes) -> None:
        nonlocal judged
        try:
            found = decode(line)
        except Unreadable:
            return
        judged += 1
        with suppress(Implausible):
            assert Status.from_wire(found).standing in (True, False)

    while judged < MANY:
        fuzz(check, statuses, count=statuses.given + MANY)


@given(st.lists(st.floats(0.001, 0.05), min_size=1, max_size=50), st.floats(0, 5))
def test_age_is_never_negative_and_grows_in_a_silence(gaps, silence_s):
    fresh = Freshness()
    now = stamp = 100.0
    for gap in gaps:
        stamp += 0.008
        now += gap
        fresh.note(stamp, now)
        assert fresh.age_s(now) >= 0
    assert fresh.age_s(now + silence_s) >= silence_s * 0.999 - 1e-9
