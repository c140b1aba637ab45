"""What the control program does for each command number of the client."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.ur.kinematics import NoSolutionError
from drivers.simulators.ur.motion import (
    ScriptError,
    joint_move,
    line_move,
    path_move,
)
from drivers.simulators.ur.poses import Floats, matrix_of, pose_of
from drivers.simulators.ur.stream import ServoStream, SpeedStream, ToolSpeedStream

if TYPE_CHECKING:
    from drivers.simulators.ur.program import ControlProgram

Command = Callable[["ControlProgram"], None]
REALTIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71})
_FREEDRIVE = 2


def _array(program: ControlProgram, first: int) -> Floats:
    return np.array(program.floats_in(first, 6))


def _joint_target(program: ControlProgram, target: Floats) -> None:
    robot = program.robot
    speed, acceleration = program.floats_in(6, 2)
    motion = joint_move(
        robot.kin,
        robot.arm.will_stand_at(),
        target,
        speed=speed,
        acceleration=acceleration,
    )
    program.begin(lambda: robot.arm.begin(motion), asynchronous=program.int_in(1) == 1)


def _tool_target(program: ControlProgram, target: Floats) -> None:
    robot = program.robot
    speed, acceleration = program.floats_in(6, 2)
    motion = line_move(
        robot.kin,
        robot.arm.will_stand_at(),
        target,
        robot.tcp,
        speed=speed,
        acceleration=acceleration,
    )
    program.begin(lambda: robot.arm.begin(motion), asynchronous=program.int_in(1) == 1)


def _solve(program: ControlProgram, pose: Floats, near: Floats) -> Floats:
    """Inverse kinematics, or the death of the program."""
    robot = program.robot
    try:
        return robot.kin.joints(pose, robot.tcp, near)
    except NoSolutionError as error:
        raise ScriptError(str(error)) from error


def _move_j(program: ControlProgram) -> None:
    _joint_target(program, _array(program, 0))


def _move_j_ik(program: ControlProgram) -> None:
    here = program.robot.arm.joints
    _joint_target(program, _solve(program, _array(program, 0), here))


def _move_l(program: ControlProgram) -> None:
    _tool_target(program, _array(program, 0))


def _move_l_fk(program: ControlProgram) -> None:
    robot = program.robot
    _tool_target(program, robot.kin.tool_pose(_array(program, 0), robot.tcp))


def _move_path(program: ControlProgram) -> None:
    robot = program.robot
    entries = program.script.path()
    if not entries:
        return
    path = path_move(robot.kin, robot.arm.will_stand_at(), entries, robot.tcp)
    program.begin(lambda: robot.arm.begin(path), asynchronous=program.int_in(1) == 1)
    program.path = path


def _stop(program: ControlProgram) -> None:
    program.stop(program.floats_in(0, 1)[0], asynchronous=program.int_in(1) == 1)


def _halt(program: ControlProgram) -> None:
    """SpeedStop and servoStop: slow down with the given deceleration."""
    deceleration = program.floats_in(0, 1)[0]
    program.robot.stop_motion(deceleration, linear=False)
    program.wait(lambda: not program.robot.arm.idle)


def _servo_j(program: ControlProgram) -> None:
    _servo(program, _array(program, 0), program.floats_in(9, 1)[0])


def _servo_l(program: ControlProgram) -> None:
    here = program.robot.arm.joints
    target = _solve(program, _array(program, 0), here)
    _servo(program, target, program.floats_in(9, 1)[0])


def _servo_c(program: ControlProgram) -> None:
    here = program.robot.arm.joints
    _servo(program, _solve(program, _array(program, 0), here), 0.1)


def _servo(program: ControlProgram, target: Floats, lookahead_s: float) -> None:
    robot = program.robot
    limit = robot.kin.arm.joint_speed
    robot.arm.follow(ServoStream(target, max(lookahead_s, 0.03), limit))


def _ramp(program: ControlProgram) -> tuple[float, float]:
    """Acceleration and duration of a streamed speed.

    Raises:
        ScriptError: an acceleration that is not above zero.
    """
    acceleration, seconds = program.floats_in(6, 2)
    if acceleration <= 0:
        raise ScriptError("acceleration must be above zero")
    return acceleration, seconds


def _speed_j(program: ControlProgram) -> None:
    acceleration, seconds = _ramp(program)
    limit = program.robot.kin.arm.joint_speed
    stream = SpeedStream(np.clip(_array(program, 0), -limit, limit), acceleration)
    program.robot.arm.follow(stream, seconds if seconds > 0 else np.inf)


def _speed_l(program: ControlProgram) -> None:
    robot = program.robot
    _, seconds = _ramp(program)
    stream = ToolSpeedStream(robot.kin, _array(program, 0), tuple(robot.tcp), 40.0)
    robot.arm.follow(stream, seconds if seconds > 0 else np.inf)


def _set_payload(program: ControlProgram) -> None:
    robot = program.robot
    mass, *centre = program.floats_in(0, 4)
    robot.payload_kg = mass
    if any(centre):
        robot.payload_centre_m = tuple(centre)


def _set_target_payload(program: ControlProgram) -> None:
    _set_payload(program)
    program.robot.payload_inertia = tuple(program.floats_in(4, 6))


def _set_tcp(program: ControlProgram) -> None:
    program.robot.tcp = tuple(program.floats_in(0, 6))


def _tcp_offset(program: ControlProgram) -> None:
    program.write_floats(0, list(program.robot.tcp))


def _inverse(program: ControlProgram) -> None:
    here = program.robot.arm.joints
    joints = _solve(program, _array(program, 0), here)
    program.write_floats(0, joints.tolist())


def _inverse_near(program: ControlProgram) -> None:
    joints = _solve(program, _array(program, 0), _array(program, 6))
    program.write_floats(0, joints.tolist())


def _has_inverse(program: ControlProgram) -> None:
    try:
        _solve(program, _array(program, 0), program.robot.arm.joints)
    except ScriptError:
        program.write_int(1, 0)
    else:
        program.write_int(1, 1)


def _forward(program: ControlProgram) -> None:
    robot = program.robot
    pose = robot.kin.tool_pose(robot.arm.joints, robot.tcp)
    program.write_floats(0, pose.tolist())


def _forward_of(program: ControlProgram) -> None:
    """The TCP is read from doubles 6 to 11, whoever wrote them last."""
    pose = program.robot.kin.tool_pose(_array(program, 0), program.floats_in(6, 6))
    program.write_floats(0, pose.tolist())


def _flange(program: ControlProgram) -> None:
    robot = program.robot
    pose = robot.kin.tool_pose(robot.arm.joints, (0.0,) * 6)
    program.write_floats(0, pose.tolist())


def _pose_trans(program: ControlProgram) -> None:
    product = matrix_of(_array(program, 0)) @ matrix_of(_array(program, 6))
    program.write_floats(0, pose_of(product).tolist())


def _pose_within(program: ControlProgram) -> None:
    _has_inverse(program)


def _joints_within(program: ControlProgram) -> None:
    inside = program.robot.kin.reachable(_array(program, 0))
    program.write_int(1, int(inside))


def _is_steady(program: ControlProgram) -> None:
    arm = program.robot.arm
    program.write_int(1, int(arm.idle and arm.standing))


def _step_time(program: ControlProgram) -> None:
    program.write_floats(0, [1.0 / program.robot.profile.base_hz])


def _zeros(program: ControlProgram) -> None:
    program.write_floats(0, [0.0] * 6)


def _joint_history(program: ControlProgram) -> None:
    program.write_floats(0, program.robot.arm.joints.tolist())


def _target_acceleration(program: ControlProgram) -> None:
    program.write_floats(0, program.robot.arm.acceleration.tolist())


def _jacobian(program: ControlProgram) -> None:
    robot = program.robot
    columns = robot.kin.jacobian(robot.arm.joints, robot.tcp).T.ravel().tolist()
    program.write_floats(0, columns[:24])
    program.write_floats(36, columns[24:])


def _no_contact(program: ControlProgram) -> None:
    program.write_int(1, 0)


def _protective_stop(program: ControlProgram) -> None:
    program.robot.safety.protective_stop()


def _watchdog(program: ControlProgram) -> None:
    program.watchdog_hz = program.floats_in(0, 1)[0]


def _freedrive_status(program: ControlProgram) -> None:
    program.write_int(1, program.robot.freedrive)


def _set_freedrive(program: ControlProgram) -> None:
    program.robot.freedrive = _FREEDRIVE


def _end_freedrive(program: ControlProgram) -> None:
    program.robot.freedrive = 0


def _accepted(program: ControlProgram) -> None:
    """Without effect on an arm that touches nothing."""


COMMANDS: dict[int, Command] = {
    1: _move_j,
    2: _move_j_ik,
    3: _move_l,
    4: _move_l_fk,
    6: _accepted,  # force mode
    7: _accepted,
    8: _accepted,  # zero the force sensor
    9: _speed_j,
    10: _speed_l,
    11: _servo_j,
    12: _servo_c,
    15: _halt,
    16: _halt,
    17: _set_payload,
    18: _set_freedrive,  # teach mode
    19: _end_freedrive,
    20: _accepted,
    21: _accepted,
    24: _servo_l,
    25: _no_contact,
    26: _step_time,
    27: _joint_history,
    28: _forward,  # target waypoint
    29: _set_tcp,
    30: _inverse_near,
    31: _protective_stop,
    33: _stop,
    34: _stop,
    35: _watchdog,
    36: _pose_within,
    37: _joints_within,
    38: _zeros,  # joint torques
    39: _pose_trans,
    40: _tcp_offset,
    43: _forward,
    44: _forward_of,
    45: _move_path,
    46: _inverse,
    47: _is_steady,
    52: _set_freedrive,
    53: _end_freedrive,
    54: _freedrive_status,
    56: _accepted,
    57: _accepted,
    58: _flange,
    59: _accepted,  # gravity
    60: _has_inverse,
    61: _has_inverse,
    62: _accepted,  # contact detection
    63: _no_contact,
    64: _no_contact,
    65: _set_target_payload,
    66: _accepted,  # direct torque
    69: _target_acceleration,
    70: _jacobian,
}
