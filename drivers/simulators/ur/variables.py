"""RTDE variables: name, type, and the controller versions that have them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivers.simulators.ur.profiles import Profile, Version

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
COUNTS = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}
NOT_FOUND = "NOT_FOUND"
IN_USE = "IN_USE"
REGISTERS = 48
_BITS = range(64, 128)
_ALWAYS: Version = (0,)


@dataclass(frozen=True)
class Variable:
    """One variable; ``cb3`` None: the older generation never got it."""

    type: str
    cb3: Version | None = _ALWAYS
    e_series: Version = _ALWAYS


def _named(type_name: str, names: str) -> Iterable[tuple[str, Variable]]:
    return ((name, Variable(type_name)) for name in names.split())


def _numbered(
    pattern: str, type_name: str, numbers: range, cb3: Version = _ALWAYS
) -> Iterable[tuple[str, Variable]]:
    return ((pattern.format(n), Variable(type_name, cb3)) for n in numbers)


_SIX = """
    target_q target_qd target_qdd target_current target_moment actual_q actual_qd
    actual_current joint_control_output actual_TCP_pose actual_TCP_speed
    actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures
    actual_joint_voltage"""
_DOUBLES = """
    timestamp actual_execution_time speed_scaling target_speed_fraction
    actual_momentum actual_main_voltage actual_robot_voltage actual_robot_current
    standard_analog_input0 standard_analog_input1 standard_analog_output0
    standard_analog_output1 io_current tool_analog_input0 tool_analog_input1
    tool_output_current tool_temperature tcp_force_scalar"""
_WORDS = """
    runtime_state robot_status_bits safety_status_bits analog_io_types
    tool_analog_input_types output_bit_registers0_to_31 output_bit_registers32_to_63
    input_bit_registers0_to_31 input_bit_registers32_to_63"""

OUTPUTS: dict[str, Variable] = dict(
    [
        *_named("VECTOR6D", _SIX),
        *_named("DOUBLE", _DOUBLES),
        *_named("UINT32", _WORDS),
        *_named("UINT64", "actual_digital_input_bits actual_digital_output_bits"),
        *_named("INT32", "robot_mode safety_mode tool_output_voltage"),
        *_named("VECTOR6INT32", "joint_mode"),
        *_named("VECTOR3D", "actual_tool_accelerometer elbow_position elbow_velocity"),
        ("safety_status", Variable("INT32", (3, 10), (5, 4))),
        ("tool_mode", Variable("UINT32", None)),
        ("payload", Variable("DOUBLE", (3, 11), (5, 5, 1))),
        ("payload_cog", Variable("VECTOR3D", (3, 11), (5, 5, 1))),
        ("payload_inertia", Variable("VECTOR6D", (3, 15), (5, 11))),
        ("ft_raw_wrench", Variable("VECTOR6D", None, (5, 9))),
        ("tcp_offset", Variable("VECTOR6D", (3, 15), (5, 8))),
        ("script_control_line", Variable("UINT32", None)),
        ("actual_current_as_torque", Variable("VECTOR6D", None, (5, 23))),
        ("actual_qdd", Variable("VECTOR6D", None, (5, 23))),
        ("actual_moment", Variable("VECTOR6D", None, (5, 23))),
        *_numbered("output_int_register_{}", "INT32", range(24)),
        *_numbered("output_double_register_{}", "DOUBLE", range(24)),
        *_numbered("output_int_register_{}", "INT32", range(24, 48), (3, 9)),
        *_numbered("output_double_register_{}", "DOUBLE", range(24, 48), (3, 9)),
        *_numbered("input_int_register_{}", "INT32", range(48)),
        *_numbered("input_double_register_{}", "DOUBLE", range(48)),
        *_numbered("output_bit_register_{}", "BOOL", _BITS),
        *_numbered("input_bit_register_{}", "BOOL", _BITS),
    ]
)

INPUTS: dict[str, Variable] = dict(
    [
        *_named(
            "UINT32",
            "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
        ),
        *_named(
            "DOUBLE",
            "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
        ),
        *_named(
            "UINT8",
            """standard_digital_output_mask standard_digital_output
            configurable_digital_output_mask configurable_digital_output
            tool_digital_output_mask tool_digital_output
            standard_analog_output_mask standard_analog_output_type""",
        ),
        ("external_force_torque", Variable("VECTOR6D", (3, 3))),
        *_numbered("input_int_register_{}", "INT32", range(48)),
        *_numbered("input_double_register_{}", "DOUBLE", range(48)),
        *_numbered("input_bit_register_{}", "BOOL", _BITS),
    ]
)


def type_of(table: dict[str, Variable], name: str, profile: Profile) -> str:
    """The type's name, or ``NOT_FOUND`` where this controller lacks the variable."""
    variable = table.get(name)
    if variable is None or not profile.since(variable.cb3, variable.e_series):
        return NOT_FOUND
    return variable.type
