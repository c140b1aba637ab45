"""Values of the RTDE output variables."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.ur.safety import RobotMode
from drivers.simulators.ur.wire import Value

if TYPE_CHECKING:
    from drivers.simulators.ur.robot import Robot

Reader = Callable[[], Value]
_ZERO6 = (0.0,) * 6
_ZERO3 = (0.0,) * 3
_NUMBERED = re.compile(r"^(output|input)_(int|double|bit)_register_(\d+)$")
_JOINT_RUNNING, _JOINT_IDLE, _JOINT_OFF = 253, 255, 239
_WORD = 0xFFFFFFFF


class Telemetry:
    """Reads output variables off the robot; poses are computed once per place."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._joints: object = None
        self._tcp: tuple[float, ...] = ()
        self._pose: Value = _ZERO6
        self._tool_speed: tuple[int, Value] = (-1, _ZERO6)
        self._readers = self._named()

    def reader(self, name: str) -> Reader:
        """What reads one variable.

        Raises:
            KeyError: there is no such variable.
        """
        numbered = _NUMBERED.match(name)
        if numbered is None:
            return self._readers[name]
        side, kind, number = numbered[1], numbered[2], int(numbered[3])
        registers = self._robot.registers
        short = "out" if side == "output" else "in"
        if kind == "bit":
            return lambda: bool(getattr(registers, f"{short}_bits") >> number & 1)
        values = getattr(registers, f"{short}_{kind}")
        return lambda: values[number]

    def _tool_pose(self) -> Value:
        robot = self._robot
        if robot.arm.joints is not self._joints or robot.tcp != self._tcp:
            self._joints, self._tcp = robot.arm.joints, robot.tcp
            self._pose = tuple(robot.kin.tool_pose(robot.arm.joints, robot.tcp))
        return self._pose

    def _tool_rate(self) -> Value:
        robot = self._robot
        if robot.arm.standing:
            return _ZERO6
        if self._tool_speed[0] != robot.cycle:
            rate = robot.kin.jacobian(robot.arm.joints, robot.tcp) @ robot.arm.rate
            self._tool_speed = (robot.cycle, tuple(rate))
        return self._tool_speed[1]

    def _joint_mode(self) -> Value:
        power = self._robot.safety.power
        if power == RobotMode.RUNNING:
            return (_JOINT_RUNNING,) * 6
        return (_JOINT_OFF if power <= RobotMode.POWER_OFF else _JOINT_IDLE,) * 6

    def _named(self) -> dict[str, Reader]:
        return {
            **self._arm(),
            **self._status(),
            **self._electrics(),
            **self._payload(),
        }

    def _arm(self) -> dict[str, Reader]:
        arm = self._robot.arm
        zero6: Reader = lambda: _ZERO6  # noqa: E731
        joints: Reader = lambda: arm.joints.tolist()  # noqa: E731
        rate: Reader = lambda: arm.rate.tolist()  # noqa: E731
        gained: Reader = lambda: arm.acceleration.tolist()  # noqa: E731
        return {
            **dict.fromkeys(("target_q", "actual_q"), joints),
            **dict.fromkeys(("target_qd", "actual_qd"), rate),
            **dict.fromkeys(("target_qdd", "actual_qdd"), gained),
            **dict.fromkeys(("actual_TCP_pose", "target_TCP_pose"), self._tool_pose),
            **dict.fromkeys(("actual_TCP_speed", "target_TCP_speed"), self._tool_rate),
            **dict.fromkeys(
                (
                    "target_current",
                    "target_moment",
                    "actual_current",
                    "joint_control_output",
                    "actual_TCP_force",
                    "actual_current_as_torque",
                    "actual_moment",
                    "ft_raw_wrench",
                ),
                zero6,
            ),
            "elbow_position": lambda: _ZERO3,
            "elbow_velocity": lambda: _ZERO3,
            "actual_tool_accelerometer": lambda: (0.0, 0.0, 9.81),
            "tcp_force_scalar": lambda: 0.0,
            "actual_momentum": lambda: float(np.abs(arm.rate).sum()),
        }

    def _status(self) -> dict[str, Reader]:
        robot = self._robot
        registers = robot.registers
        return {
            "timestamp": lambda: robot.timestamp_s,
            "actual_execution_time": lambda: 0.3,
            "robot_mode": lambda: int(robot.safety.power),
            "joint_mode": self._joint_mode,
            "safety_mode": lambda: int(robot.safety.mode),
            "safety_status": lambda: int(robot.safety.mode),
            "safety_status_bits": lambda: robot.safety.status_bits,
            "robot_status_bits": lambda: robot.status_bits,
            "runtime_state": lambda: int(robot.state),
            "speed_scaling": lambda: robot.arm.scaling,
            "target_speed_fraction": lambda: registers.slider,
            "script_control_line": lambda: 0,
            "output_bit_registers0_to_31": lambda: registers.out_bits & _WORD,
            "output_bit_registers32_to_63": lambda: registers.out_bits >> 32 & _WORD,
            "input_bit_registers0_to_31": lambda: registers.in_bits & _WORD,
            "input_bit_registers32_to_63": lambda: registers.in_bits >> 32 & _WORD,
        }

    def _electrics(self) -> dict[str, Reader]:
        robot = self._robot
        registers = robot.registers
        readers: dict[str, Reader] = {
            "joint_temperatures": lambda: (30.0,) * 6,
            "actual_joint_voltage": lambda: (48.0,) * 6,
            "actual_main_voltage": lambda: 48.0,
            "actual_robot_voltage": lambda: 48.0,
            "actual_robot_current": lambda: 1.0,
            "io_current": lambda: 0.0,
            "actual_digital_input_bits": lambda: registers.digital_inputs,
            "actual_digital_output_bits": lambda: registers.digital_outputs,
            "tool_temperature": lambda: 30.0,
            "tool_output_current": lambda: 0.0,
            "tool_analog_input0": lambda: 0.0,
            "tool_analog_input1": lambda: 0.0,
            "tool_output_voltage": lambda: 0,
            "tool_analog_input_types": lambda: 0,
            "analog_io_types": lambda: 0,
            "tool_mode": lambda: _JOINT_RUNNING,
        }
        for k in range(2):
            readers[f"standard_analog_input{k}"] = (
                lambda k=k: registers.analog_inputs[k]  # type: ignore[misc]
            )
            readers[f"standard_analog_output{k}"] = (
                lambda k=k: registers.analog_outputs[k]  # type: ignore[misc]
            )
        return readers

    def _payload(self) -> dict[str, Reader]:
        robot = self._robot
        return {
            "payload": lambda: robot.payload_kg,
            "payload_cog": lambda: robot.payload_centre_m,
            "payload_inertia": lambda: robot.payload_inertia,
            "tcp_offset": lambda: robot.tcp,
        }
