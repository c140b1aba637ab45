"""``mvp-cell recover``: a walk that a person confirms step by step."""

import io
import json

import pytest

from mvp.cell.recover_job import Guide, recover_device
from mvp.cli.main import invoke
from mvp.cli.recover import agree
from mvp.devices import Recoverable, RecoveryStep
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    LinkLost,
    StoppedByOperator,
    UsageError,
)


class Stuck:
    """A device two steps away from being ready."""

    role = "arm"
    name = "arm"

    def __init__(self) -> None:
        self.left = ["look at it", "power it on"]
        self.done: list[str] = []

    def open(self) -> None:
        pass

    def recovery(self):
        while self.left:
            text = self.left[0]
            yield RecoveryStep(text, acknowledge=True, act=self._do)

    def _do(self) -> str:
        self.done.append(self.left.pop(0))
        return f"{self.done[-1]}: done"


class Plain:
    """A device that knows no way back, and may not answer."""

    role = "camera"
    name = "camera"

    def __init__(self, error: DeviceError | None = None) -> None:
        self.error = error

    def open(self) -> None:
        if self.error is not None:
            raise self.error


def guide(*answers: bool) -> tuple[Guide, list[str]]:
    said: list[str] = []
    left = list(answers)
    return Guide(
        agree=lambda _, step: (said.append(step.text), left.pop(0))[1],
        tell=lambda _, reached: said.append(reached),
    ), said


def test_each_step_is_asked_done_and_told_in_turn():
    device = Stuck()
    assert isinstance(device, Recoverable)
    walk, said = guide(True, True)
    found = recover_device(device, walk)
    assert said == [
        "look at it",
        "look at it: done",
        "power it on",
        "power it on: done",
    ]
    assert [step.reached for step in found.steps] == said[1::2]


def test_a_step_that_is_not_agreed_to_is_not_done_nor_any_after_it():
    device = Stuck()
    walk, _ = guide(True, False)
    with pytest.raises(StoppedByOperator, match="power it on"):
        recover_device(device, walk)
    assert device.done == ["look at it"]


def test_a_step_without_its_effect_ends_the_walk():
    class Broken(Stuck):
        def _do(self) -> str:
            raise DeviceFault("still locked", device="arm", code="still-there")

    walk, _ = guide(True, True)
    with pytest.raises(DeviceFault, match="still locked"):
        recover_device(Broken(), walk)


def test_a_device_without_a_way_back_is_only_asked_how_it_is():
    walk, said = guide()
    found = recover_device(Plain(), walk)
    assert not found.recoverable
    assert found.ready
    assert not said


@pytest.mark.parametrize("hint", ["", "look at the cable"])
def test_a_device_that_does_not_answer_needs_something_by_hand(hint):
    walk, _ = guide()
    found = recover_device(
        Plain(ConnectError("nobody answers", device="camera", hint=hint)), walk
    )
    assert not found.ready
    assert found.detail == "nobody answers"
    assert found.hint
    assert hint in found.hint


def test_an_arm_that_cannot_be_asked_keeps_nobody_from_asking_the_others():
    class Away(Stuck):
        def recovery(self):
            raise LinkLost("unplugged", device="arm")
            yield

    walk, said = guide()
    found = recover_device(Away(), walk)
    assert found.recoverable
    assert not found.ready
    assert found.detail == "unplugged"
    assert not said


def test_nothing_is_confirmed_where_nobody_can_be_asked():
    with pytest.raises(UsageError) as error:
        agree("arm", RecoveryStep("power it on", acknowledge=True, act=str))
    assert "terminal" in error.value.hint


@pytest.mark.parametrize(("typed", "agreed"), [("y\n", True), ("\n", False)])
def test_only_a_yes_is_a_yes(monkeypatch, typed, agreed):
    monkeypatch.setattr("sys.stdin", _Terminal(typed))
    monkeypatch.setattr("sys.stderr", _Terminal())
    step = RecoveryStep("power it on", acknowledge=True, act=str)
    assert agree("arm", step) is agreed


def test_a_virtual_cell_has_nothing_to_recover(capsys):
    assert invoke(["recover", "virtual", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mvp-cell/recover/1"
    assert not any(device["recoverable"] for device in document["devices"])
    assert all(device["ready"] for device in document["devices"])


def test_what_has_to_be_done_by_hand_is_said_for_this_very_cell(
    virtual_copy, monkeypatch, capsys
):
    with (virtual_copy / "cell.toml").open("a") as file:
        file.write("\n[world.faults.camera]\nunreachable = true\n")
    monkeypatch.chdir(virtual_copy.parent)
    assert invoke(["recover", "my cell"]) == 4
    told = capsys.readouterr().err
    assert "arm: ready, nothing to do" in told
    assert "lens: answers; not homed (`mvp-cell home 'my cell'` homes it" in told
    assert "camera: NOT ready: nobody answers" in told
    assert "by hand: " in told
    assert "CELL" not in told


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True
