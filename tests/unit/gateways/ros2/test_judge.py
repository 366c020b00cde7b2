"""Rows of `ros2 check` that need no network, and its words."""

import argparse
from functools import partial

import numpy as np
import pytest

from gateways.ros2 import judge
from gateways.ros2.check_verb import arguments, home_of, printable
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.wire import Attachment, Distro
from tests.support.each import each

ROTATION = "geometry_msgs/msg/Quaternion"


@each("text", ["0", "-1", "nan", "601", "x"])
def test_time_of_a_check_is_within_its_limits(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["check", f"--seconds={text}"])
    assert "use seconds up to 600" in capsys.readouterr().err


@each(
    "node, home",
    [("/r1/sidestep", "/r1"), ("/r1/arm/driver", "/r1/arm"), ("/r10/x", ""), ("/rviz", "")],
)
def test_node_belongs_to_the_innermost_robot(node: str, home: str) -> None:
    assert home_of(node, {"", "/r1", "/r1/arm"}) == home


def test_evidence_is_fit_for_a_terminal() -> None:
    assert printable("a\x1b[2J\n") == "a?[2J?"


def test_velocities_are_compared_with_the_way() -> None:
    made = Interfaces(Distro.JAZZY).make

    def robot(speed_m_s: float, yaw_rad: float) -> judge.RobotSeen:
        topic = judge.TopicSeen("/odom", judge.ODOMETRY)
        for number in range(11):
            time = made("builtin_interfaces/msg/Time", 0, number * 100_000_000)
            where = made("geometry_msgs/msg/Point", 0.05 * number, 0.0, 0.0)
            turned = made(ROTATION, 0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2))
            pose = made("geometry_msgs/msg/Pose", where, turned)
            vector = partial(made, "geometry_msgs/msg/Vector3")
            twist = made(
                "geometry_msgs/msg/Twist", vector(speed_m_s, 0.0, 0.0), vector(0.0, 0.0, 0.0)
            )
            message = made(
                judge.ODOMETRY,
                made("std_msgs/msg/Header", time, "odom"),
                "base_link",
                made("geometry_msgs/msg/PoseWithCovariance", pose, np.eye(6).reshape(36)),
                made("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
            )
            topic.samples.append(judge.Sample(message, Attachment(1, 0, b""), 0))
        return judge.RobotSeen("", 1.0, {}, [topic])

    assert judge.axes(robot(0.5, 0.0)).verdict is judge.Verdict.PASS
    assert judge.axes(robot(0.5, np.pi)).verdict is judge.Verdict.FAIL
    assert judge.axes(robot(50.0, 0.0)).verdict is judge.Verdict.FAIL


def test_row_that_cannot_be_read_fails() -> None:
    topic = judge.TopicSeen("/odom", judge.ODOMETRY)
    topic.samples.append(judge.Sample(None, Attachment(1, 0, b""), 0))
    robot = judge.RobotSeen("", 1.0, {}, [topic], parameters=None)
    found = {row.title: one for row, one in judge.judged(robot)}
    assert "unusable values" in found["odometry: rate, frames, covariance"].evidence


def test_age_is_by_the_time_of_a_simulation_that_is_fast() -> None:
    made = Interfaces(Distro.JAZZY).make
    clock, joints = judge.TopicSeen("/clock", judge.CLOCK), judge.TopicSeen("/j", judge.JOINTS)
    for number in range(20):
        time = made("builtin_interfaces/msg/Time", number, 0)
        arrived_ns, beside = 10**18 + number * 10**8, Attachment(1, 0, b"")
        told = made(judge.CLOCK, time)
        clock.samples.append(judge.Sample(told, beside, arrived_ns))
        header = made("std_msgs/msg/Header", time, "")
        state = made(judge.JOINTS, header, [], np.zeros(0), np.zeros(0), np.zeros(0))
        joints.samples.append(judge.Sample(state, beside, arrived_ns + 1))
    robot = judge.RobotSeen("", 2.0, {}, [clock, joints])
    assert judge.ages_s(robot, joints) == [0.0] * 20
    assert judge.stamps(robot).verdict is judge.Verdict.PASS
