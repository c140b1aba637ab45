"""``mvp-cell recover``: a walk that a person confirms step by step."""

import io
import json

import pytest

from mvp.cell.recover_job import Guide, recover_device
from mvp.cli.main import invoke
from mvp.cli.recover import agree
from mvp.devices import Recoverable, RecoveryStep
from mvp.errors import DeviceFault, StoppedByOperator, UsageError


class Stuck:
    """A device two steps away from being ready."""

    role = "arm"
    name = "arm"

    def __init__(self) -> None:
        self.left = ["look at it", "power it on"]
        self.done: list[str] = []

    def recovery(self):
        while self.left:
            text = self.left[0]
            yield RecoveryStep(text, acknowledge=True, act=self._do)

    def _do(self) -> str:
        self.done.append(self.left.pop(0))
        return f"{self.done[-1]}: done"


class Plain:
    role = "lens"
    name = "lens"


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


def test_a_device_without_a_way_back_is_named_so():
    walk, said = guide()
    found = recover_device(Plain(), walk)
    assert not found.recoverable
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


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True
