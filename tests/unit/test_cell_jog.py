"""``mvp-cell jog``: words, limits, and what moves."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvp.cell.jog_words import (
    Expose,
    JogCommand,
    Joint,
    Live,
    LiveOff,
    Optical,
    Plain,
    Shift,
    Shot,
    Steps,
    UseFrame,
    parse,
)
from mvp.cli.main import invoke
from mvp.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("x 5", Shift(0, 5.0, turns=False)),
        ("rz -2.5", Shift(2, -2.5, turns=True)),
        ("J3 10", Joint(2, 10.0)),
        ("zoom 1000", Steps("zoom", 1000, relative=False)),
        ("focus -40", Steps("focus", -40, relative=True)),
        ("iris +3", Steps("iris", 3, relative=True)),
        ("d 12.9", Optical("d", 12.9)),
        ("frame camera", UseFrame("camera")),
        ("exposure 20", Expose(0.02)),
        ("shot a b.png", Shot("a b.png")),
        ("live", Live()),
        ("live a b.PNG", Live("a b.PNG")),
        ("live off", LiveOff()),
        ("  where ", Plain("where")),
        ("q", Plain("quit")),
    ],
)
def test_words_are_understood(line: str, command: JogCommand) -> None:
    assert parse(line) == command


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("x", "needs a number"),
        ("x nan", "needs a number"),
        ("y inf", "needs a number"),
        ("zoom 1.5", "whole steps"),
        ("frame part", "no frame"),
        ("shot picture.jpg", ".png"),
        ("live picture.jpg", ".png"),
        ("live 5", "not '5'"),
        ("jump 5", "cannot understand"),
        ("j0 5", "cannot understand"),
    ],
)
def test_what_makes_no_sense_is_refused(line: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        parse(line)


@given(st.text(max_size=40))
def test_no_line_is_a_bug(line: str) -> None:
    with suppress(UsageError):
        assert parse(line) is not None


def _jog(capsys: pytest.CaptureFixture[str], *commands: str) -> tuple[int, dict, str]:
    options = [part for command in commands for part in ("--do", command)]
    code = invoke(["jog", "virtual", *options, "--speed", "1", "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def test_a_shift_moves_the_camera_along_its_own_axes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    _, before, _ = _jog(capsys, "where")
    code, after, _ = _jog(capsys, "frame camera", "z 15", "rx 4")
    assert code == 0
    first, last = (np.array(d["base_from_camera"]) for d in (before, after))
    moved = np.linalg.inv(first) @ last
    np.testing.assert_allclose(moved[:3, 3], [0, 0, 15], atol=1e-3)
    turned = cv2.Rodrigues(moved[:3, :3])[0].ravel()
    np.testing.assert_allclose(np.degrees(turned), [4, 0, 0], atol=1e-4)


def test_a_turn_in_base_axes_is_about_the_tool(
    capsys: pytest.CaptureFixture[str],
) -> None:
    _, before, _ = _jog(capsys, "where")
    _, after, _ = _jog(capsys, "rz 10", "x -7")
    first, last = (np.array(d["base_from_tool"]) for d in (before, after))
    np.testing.assert_allclose(last[:3, 3] - first[:3, 3], [-7, 0, 0], atol=1e-3)
    turned = cv2.Rodrigues(last[:3, :3] @ first[:3, :3].T)[0].ravel()
    np.testing.assert_allclose(np.degrees(turned), [0, 0, 10], atol=1e-4)


def test_the_lens_goes_to_steps_and_to_millimetres(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, document, _ = _jog(capsys, "home", "zoom 1240", "d 12.9", "focus +20")
    assert code == 0
    assert document["lens_steps"]["zoom"] == 1240
    table_step_mm = 1.1 / 8000
    assert document["d_mm"] == pytest.approx(12.9 + 20 * table_step_mm, abs=1e-3)


def test_a_lens_that_was_not_homed_is_not_moved(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, error, _ = _jog(capsys, "zoom 500")
    assert code == 2
    assert "not homed" in error["message"]


def test_the_arm_is_kept_away_from_what_stands_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    downs = ["z -60"] * 6
    code, error, err = _jog(capsys, *downs)
    assert code == 4
    assert "would come within" in error["message"]
    assert err.count("deg") >= 2  # the first ones were carried out


def test_a_slip_of_the_finger_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    code, error, _ = _jog(capsys, "x 500")
    assert code == 2
    assert "more than one jog" in error["message"]


def test_pictures_are_seen_and_kept(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "picture.png"
    code, _, err = _jog(capsys, "home", "see", f"shot {file}")
    assert code == 0
    assert "1280 x 1024 px" in err
    assert "\u2580" in err
    picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape == (1024, 1280)


def test_without_a_terminal_commands_must_be_given(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["jog", "virtual", "--json"]) == 2
    assert "no terminal" in json.loads(capsys.readouterr().out)["message"]
