"""Simulated lens controllers, byte by byte, on a clock that the test turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.simulators.scf4 import Scf4Config, Scf4Machine
from drivers.simulators.theia import TheiaConfig, TheiaMachine
from drivers.simulators.visca import ViscaConfig, ViscaMachine
from tests.fuzzing import Mutants, at_length, fuzz
from tests.wire.machine_bench import MachineBench

if TYPE_CHECKING:
    from drivers.simulators.lens_machine import LensMachine


Scf4Bench = MachineBench[Scf4Machine]
TheiaBench = MachineBench[TheiaMachine]
ViscaBench = MachineBench[ViscaMachine]


class TestScf4:
    @pytest.fixture
    def lens(self) -> Scf4Bench:
        return Scf4Bench(Scf4Machine(Scf4Config()))

    def status(self, lens: Scf4Bench) -> list[int]:
        return [int(n) for n in lens.say(b"!1\n").split(b",")]

    def test_it_says_who_it_is(self, lens: Scf4Bench) -> None:
        assert lens.say(b"$S\r\n").startswith(b"EVB.1.0.2, SCF4-M RevB, Kurokesu")

    def test_a_move_is_answered_before_it_ends(self, lens: Scf4Bench) -> None:
        lens.say(b"G92 A24000\n")
        assert lens.say(b"G0 A26000\n") == b"OK\r\n"
        lens.wait(0.1)
        assert self.status(lens)[6] == 1
        assert lens.wait(3) == b""
        assert self.status(lens)[0::6] == [26_000, 0]

    def test_counters_wrap_silently(self, lens: Scf4Bench) -> None:
        lens.say(b"G91\n")
        lens.say(b"G0 C-10\n")
        lens.wait(1)
        assert self.status(lens)[2] == 65_526

    def test_a_motor_at_its_end_goes_on_counting(self, lens: Scf4Bench) -> None:
        lens.say(b"G91\n")
        lens.say(b"G0 C-2000\n")
        lens.wait(3)
        assert lens.machine.places()["iris"] == 0.0
        assert self.status(lens)[2] == 65_536 - 2000

    def test_a_forced_move_runs_to_the_light_barrier(self, lens: Scf4Bench) -> None:
        for line in (b"M232 A400 E700\n", b"M238\n", b"G91\n", b"M231 A\n"):
            assert lens.say(line) == b"OK\r\n"
        assert self.status(lens)[3] == 0
        lens.say(b"G0 A100\n")
        lens.wait(10)
        assert lens.machine.places()["zoom"] == 32_000.0
        assert self.status(lens)[3] == 1

    def test_without_its_lamp_the_barrier_is_blind(self, lens: Scf4Bench) -> None:
        lens.say(b"M232 A400 E700\nG91\nM231 A\n")
        lens.say(b"G0 A100\n")
        lens.wait(10)
        assert lens.machine.places()["zoom"] == 39_500.0

    def test_a_wait_makes_it_deaf(self, lens: Scf4Bench) -> None:
        assert lens.say(b"G4 P500\n") == b""
        assert lens.say(b"$S\n") == b""
        said = lens.wait(0.6)
        assert said.startswith(b"OK\r\nEVB")

    def test_a_restart_forgets_counters_but_not_places(self, lens: Scf4Bench) -> None:
        lens.say(b"G92 A24000\n")
        lens.say(b"$B3\n")
        lens.wait(1.1)
        assert self.status(lens)[0] == 0
        assert lens.machine.places()["zoom"] == 24_000.0

    def test_an_unknown_command_is_an_error(self, lens: Scf4Bench) -> None:
        assert lens.say(b"G77\n") == b"ERROR\r\n"


class TestTheia:
    @pytest.fixture
    def lens(self) -> TheiaBench:
        return TheiaBench(TheiaMachine(TheiaConfig()))

    def places(self, lens: TheiaBench) -> dict[str, float]:
        return lens.machine.places()

    def test_firmware_and_serial_number(self, lens: TheiaBench) -> None:
        assert lens.say(b"\x76\x0d") == bytes.fromhex("76050300000000"[:12]) + b"\x0d"
        assert lens.say(b"\x79\x0d") == bytes.fromhex("790550000012340d")

    def test_a_move_is_answered_when_it_has_ended(self, lens: TheiaBench) -> None:
        # 600 steps at 1200 steps/s
        assert lens.say(bytes.fromhex("6202025801 04b0 0d")) == b""
        assert lens.wait(0.45) == b""
        assert lens.wait(0.1) == bytes.fromhex("74000d")
        assert self.places(lens)["zoom"] == 200.0

    def test_it_is_deaf_while_it_moves_and_answers_later(
        self, lens: TheiaBench
    ) -> None:
        lens.say(bytes.fromhex("620202580104b00d"))
        assert lens.say(b"\x76\x0d") == b""
        assert lens.wait(0.6).startswith(bytes.fromhex("74000d76"))

    def test_its_buffer_overflows(self, lens: TheiaBench) -> None:
        lens.say(bytes.fromhex("620202580104b00d"))
        lens.say(b"\x76\x0d" * 400)
        said = lens.wait(0.6)
        assert said.count(b"\x76") == 256

    def test_a_carriage_return_inside_a_frame_is_a_number(
        self, lens: TheiaBench
    ) -> None:
        # 3338 steps = 0D0A, from focus 2000 up to 5338
        lens.say(bytes.fromhex("66010d0a0104b00d"))
        assert lens.wait(3) == bytes.fromhex("74000d")
        assert self.places(lens)["focus"] == 5338.0

    def test_a_move_stops_at_the_barrier_and_says_nothing_of_it(
        self, lens: TheiaBench
    ) -> None:
        lens.say(bytes.fromhex("66012000 01 04b0 0d"))
        assert lens.wait(8) == bytes.fromhex("74000d")
        assert self.places(lens)["focus"] == 7959.0

    def test_an_absolute_move_counts_from_the_barrier(self, lens: TheiaBench) -> None:
        lens.say(bytes.fromhex("73010f770104b00d"))  # 3959 steps away
        assert lens.wait(12) == bytes.fromhex("74000d")
        assert self.places(lens)["focus"] == 4000.0

    def test_the_iris_has_no_barrier_to_count_from(self, lens: TheiaBench) -> None:
        assert lens.say(bytes.fromhex("730300100100640d")) == b""
        assert lens.wait(2) == b""

    def test_set_ups_survive_a_power_cycle(self, lens: TheiaBench) -> None:
        written = bytes.fromhex("6301000000 20c6 0064 05dc 0d")
        assert lens.say(written) == bytes.fromhex("63000d")
        lens.machine.power_up(lens.now_s)
        lens.wait(1)
        read = lens.say(bytes.fromhex("67010d"))
        assert read == b"\x67" + written[1:]

    def test_a_bad_motor_number(self, lens: TheiaBench) -> None:
        assert lens.say(bytes.fromhex("67090d")) == b"\x67" + b"\xff" * 10 + b"\x0d"
        assert lens.say(bytes.fromhex("6309000000" + "00" * 6 + "0d")) == b"\x63\x01\r"


class TestVisca:
    @pytest.fixture
    def lens(self) -> ViscaBench:
        return ViscaBench(ViscaMachine(ViscaConfig()))

    def test_acknowledged_completed_and_asked(self, lens: ViscaBench) -> None:
        assert lens.say(bytes.fromhex("8101044702000000ff")) == b""
        assert lens.wait(0.03) == bytes.fromhex("9041ff")
        assert lens.wait(3) == bytes.fromhex("9051ff")
        assert lens.say(bytes.fromhex("81090447ff")) == bytes.fromhex("905002000000ff")

    def test_two_commands_at_once_and_no_third(self, lens: ViscaBench) -> None:
        lens.say(bytes.fromhex("81010438 03 ff"))
        lens.wait(0.1)
        lens.say(bytes.fromhex("8101044702000000ff"))
        lens.say(bytes.fromhex("8101044808000000ff"))
        assert lens.say(bytes.fromhex("8101044703000000ff")) == bytes.fromhex(
            "906003ff"
        )
        said = lens.wait(4)
        assert said.count(bytes.fromhex("ff")) == 4

    def test_focus_is_locked_in_auto_focus(self, lens: ViscaBench) -> None:
        assert lens.say(bytes.fromhex("8101044808000000ff")) == bytes.fromhex(
            "906141ff"
        )

    def test_iris_is_locked_in_automatic_exposure(self, lens: ViscaBench) -> None:
        asked = bytes.fromhex("8101044b0000000aff")
        assert lens.say(asked) == bytes.fromhex("906141ff")
        lens.say(bytes.fromhex("8101043903ff"))
        assert lens.wait(0.1) == bytes.fromhex("9041ff9051ff")
        lens.say(asked)
        assert lens.wait(1) == bytes.fromhex("9041ff9051ff")
        said = lens.say(bytes.fromhex("8109044bff"))
        assert said == bytes.fromhex("90500000000aff")

    def test_a_cancelled_command_stops_where_it_is(self, lens: ViscaBench) -> None:
        lens.say(bytes.fromhex("8101044704000000ff"))
        lens.wait(0.5)
        assert lens.say(bytes.fromhex("8121ff")) == bytes.fromhex("906104ff")
        assert 0x1000 < lens.machine.places()["zoom"] < 0x4000

    def test_the_power_comes_on_with_a_word(self, lens: ViscaBench) -> None:
        lens.machine.power_up(lens.now_s)
        assert lens.wait(1.1) == bytes.fromhex("9038ff")

    def test_clear_and_address(self, lens: ViscaBench) -> None:
        assert lens.say(bytes.fromhex("883001ff")) == bytes.fromhex("883002ff")
        assert lens.say(bytes.fromhex("88010001ff")) == bytes.fromhex("88010001ff")
        assert lens.say(bytes.fromhex("81010001ff")) == bytes.fromhex("9050ff")

    def test_a_clone_that_never_acknowledges(self) -> None:
        lens = ViscaBench(ViscaMachine(ViscaConfig(no_ack=True)))
        lens.say(bytes.fromhex("8101044702000000ff"))
        assert lens.wait(3) == bytes.fromhex("9051ff")

    def test_a_clone_that_completes_too_early(self) -> None:
        lens = ViscaBench(ViscaMachine(ViscaConfig(completes_at_once=True)))
        lens.say(bytes.fromhex("8101044704000000ff"))
        assert lens.wait(0.1) == bytes.fromhex("9041ff9051ff")
        assert lens.machine.places()["zoom"] < 0x4000


_CHUNKS = st.lists(st.binary(max_size=40), max_size=12)


def _nonsense(
    lens: MachineBench[LensMachine], chunks: list[bytes], *, moving: bytes
) -> dict[str, float]:
    """Say it, and wait for the end of whatever it began; where the motors are then.

    Args:
        lens: a machine that has just been switched on.
        chunks: what is said.
        moving: bytes without which no command moves a motor.
    """
    machine = lens.machine
    before = machine.places()
    for chunk in chunks:
        lens.say(chunk)
        lens.wait(0.01)
    if not set(b"".join(chunks).upper()) & set(moving):
        assert machine.places() == before
    machine.power_up(lens.now_s)
    lens.wait(5.0)
    for axis, motor in machine.axes.items():
        assert motor.travel.low <= machine.places()[axis] <= motor.travel.high
    return machine.places()


def _scf4_survives(chunks: list[bytes]) -> None:
    lens = Scf4Bench(Scf4Machine(Scf4Config()))
    stands = _nonsense(lens, chunks, moving=b"G")
    assert lens.say(b"$S\n").startswith(b"EVB.1.0.2")
    assert lens.say(b"!1\n").count(b",") == 8
    lens.wait(0.2)
    assert lens.machine.places() == stands


def _theia_survives(chunks: list[bytes]) -> None:
    lens = TheiaBench(TheiaMachine(TheiaConfig()))
    stands = _nonsense(lens, chunks, moving=b"\x62\x66\x73BFS")
    assert lens.say(b"\x76\x0d").startswith(b"\x76\x05")
    lens.wait(0.2)
    assert lens.machine.places() == stands


def _visca_survives(chunks: list[bytes]) -> None:
    lens = ViscaBench(ViscaMachine(ViscaConfig()))
    stands = _nonsense(lens, chunks, moving=b"\x04\xff")
    asked = lens.say(bytes.fromhex("81090002ff"))
    assert asked.startswith(bytes.fromhex("90500020"))
    lens.wait(0.2)
    assert lens.machine.places() == stands


SURVIVES = {"scf4": _scf4_survives, "theia": _theia_survives, "visca": _visca_survives}


@pytest.mark.parametrize("make", SURVIVES)
@given(chunks=_CHUNKS)
@settings(max_examples=100, deadline=None)
def test_nonsense_does_not_upset_it(make: str, chunks: list[bytes]) -> None:
    SURVIVES[make](chunks)


def _frames(*frames: str) -> list[bytes]:
    return [bytes.fromhex(frame) for frame in frames]


LINES = {
    "scf4": [
        b"G92 A24000\nG0 A26000 B100 C-5\n",
        b"G91\nM231 A\nM232 A400 E700\n",
        b"$S\n!1\n$B2\n$B3\nM0\n",
        b"M234 A190 B190 C190\nM240 A600\nM243 C6\nM238\nG4 P500\n",
    ],
    "theia": _frames(
        "760D790D67010D",
        "6201001E0104B00D",
        "66020064010BB80D",
        "730200000104B00D",
        "63010001000C9B006405DC0D",
    ),
    "visca": _frames(
        "883001FF81010001FF",
        "8101044704000000FF",
        "8101044801020304FF81090448FF",
        "81090002FF81090447FF",
        "8101040002FF8121FF",
    ),
}
PIECES = {
    "scf4": b"G0 G91 A B-1 $ ! M0 M231 M230 \n \r".split(b" "),
    "theia": _frames("0D", "62", "66", "73", "7301", "0D0D", "FFFF"),
    "visca": _frames("FF", "81", "88", "0104", "010447", "0904", "21"),
}


@at_length
@pytest.mark.parametrize("make", SURVIVES)
def test_much_nonsense_does_not_upset_it(make: str) -> None:
    mutants = Mutants(LINES[make], PIECES[make])
    fuzz(lambda first: SURVIVES[make](mutants.several(first, 10)), mutants)
