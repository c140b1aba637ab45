"""The dashboard server: one line in, one line out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.simulators.ur.profiles import model_number

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.simulators.ur.robot import Robot
    from drivers.simulators.ur.safety import RobotMode, SafetyMode

GREETING = "Connected: Universal Robots Dashboard Server"
_LOCAL = (
    "Command is not allowed due to safety reasons, please switch robot to Remote "
    "Control mode and reconnect to port 29999"
)
_LOCKED = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
    "protective stop before unlocking"
)
_CONTROLS = (
    "load",
    "play",
    "stop",
    "pause",
    "power on",
    "power off",
    "brake release",
    "unlock protective stop",
    "close popup",
    "close safety popup",
    "popup",
    "restart safety",
    "shutdown",
)
_STATES = {True: "PLAYING", False: "STOPPED"}


class Dashboard:
    """One client's session: whether it may control is settled when it connects."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._may_control = robot.remote or not robot.profile.has_remote_mode
        self._commands: dict[str, Callable[[str], str]] = {
            **self._questions(),
            **self._orders(),
        }

    def reply(self, line: str) -> str:
        """The answer to one line, without its line feed."""
        text = line.strip()
        if not self._may_control and text.startswith(_CONTROLS):
            return _LOCAL
        for name in sorted(self._commands, key=len, reverse=True):
            if text == name or text.startswith(f"{name} "):
                return self._commands[name](text[len(name) :].strip())
        return f"could not understand: '{text}'"

    def _questions(self) -> dict[str, Callable[[str], str]]:
        robot = self._robot
        safety = robot.safety
        questions = {
            "running": lambda _: f"Program running: {_lower(robot.is_program_running)}",
            "robotmode": lambda _: f"Robotmode: {_mode(safety.power)}",
            "safetymode": lambda _: f"Safetymode: {_safety(safety.mode)}",
            "safetystatus": lambda _: f"Safetystatus: {_safety(safety.mode)}",
            "programState": lambda _: self._program_state(),
            "get loaded program": lambda _: (
                f"Loaded program: /programs/{robot.loaded}"
                if robot.loaded
                else "No program loaded"
            ),
            "PolyscopeVersion": lambda _: robot.profile.polyscope,
            "version": lambda _: robot.profile.polyscope,
            "get robot model": lambda _: model_number(robot.model),
            "isProgramSaved": lambda _: f"true {robot.loaded}",
            "get operational mode": lambda _: "NONE",
        }
        if robot.profile.has_remote_mode:
            questions["is in remote control"] = lambda _: _lower(robot.remote)
            questions["get serial number"] = lambda _: robot.serial
        return questions

    def _orders(self) -> dict[str, Callable[[str], str]]:
        return {
            "load": self._load,
            "play": self._play,
            "stop": self._stop,
            "pause": self._pause,
            "power on": lambda _: self._said(
                self._robot.safety.power_on, "Powering on"
            ),
            "power off": lambda _: self._said(
                self._robot.safety.power_off, "Powering off"
            ),
            "brake release": lambda _: self._said(
                self._robot.safety.brake_release, "Brake releasing"
            ),
            "unlock protective stop": lambda _: (
                "Protective stop releasing" if self._robot.safety.unlock() else _LOCKED
            ),
            "restart safety": lambda _: self._said(
                self._robot.safety.restart, "Restarting safety"
            ),
            "close popup": lambda _: "closing popup",
            "close safety popup": lambda _: "closing safety popup",
            "popup": lambda _: "showing popup",
            "addToLog": lambda _: "Added log message",
            "setUserRole": lambda role: f"Setting user role: {role}",
            "shutdown": lambda _: "Shutting down",
            "quit": lambda _: "Disconnected",
        }

    @staticmethod
    def _said(order: Callable[[], None], reply: str) -> str:
        order()
        return reply

    def _load(self, name: str) -> str:
        if not name.endswith((".urp", ".installation")):
            return f"File not found: {name}"
        self._robot.loaded = name
        return f"Loading program: {name}"

    def _play(self, _: str) -> str:
        robot = self._robot
        resumed = robot.safety.may_run and robot.resume()
        if resumed or (robot.loaded and robot.play_foreign(robot.loaded)):
            return "Starting program"
        return "Failed to execute: play"

    def _stop(self, _: str) -> str:
        self._robot.end_program("dashboard stop")
        return "Stopped"

    def _pause(self, _: str) -> str:
        if self._robot.program is None:
            return "Failed to execute: pause"
        self._robot.pause()
        return "Pausing program"

    def _program_state(self) -> str:
        robot = self._robot
        if robot.paused:
            state = "PAUSED"
        else:
            state = _STATES[robot.is_program_running]
        return f"{state} {robot.loaded or '<unnamed>'}"


def _lower(value: bool) -> str:
    return "true" if value else "false"


def _mode(mode: RobotMode) -> str:
    return mode.name


def _safety(mode: SafetyMode) -> str:
    return mode.name
