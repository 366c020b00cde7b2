"""`python pilot.py ORDER`: drive a robot with nodes of zenoh-ros2-sdk, and record a bag.

It imports nothing of this project. ORDER is a file of JSON with `port` of the router, `types`,
definitions of messages by name, `hashes` of types and services, `goal` [x, y], and `bag`, a new
folder. Each result is a line of JSON on standard output, `{"step": ..., ...}`.
"""

import json
import math
import sys
import threading
import time
import uuid
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2Subscriber
from zenoh_ros2_sdk.session import ZenohSession

PATIENCE_S = 60.0
GOAL_S = 240.0
NAVIGATE = "nav2_msgs/action/NavigateToPose"
TWIST = "geometry_msgs/msg/Twist"
RECORDED = (
    ("/r1/odom", "nav_msgs/msg/Odometry"),
    ("/r1/tf", "tf2_msgs/msg/TFMessage"),
    ("/r1/sonar_3", "sensor_msgs/msg/Range"),
)


def told(step: str, **found: Any) -> None:
    """Print the result of a step."""
    print(json.dumps({"step": step, **found}), flush=True)


class Pilot:
    """The nodes, on one session to the router."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.hashes, self.port = order["hashes"], order["port"]
        session = ZenohSession.get_instance("127.0.0.1", self.port)
        session.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in order["types"].items():
            (fields,) = get_types_from_msg(text, name).values()
            session.store.register({name: fields})
        # It looks for the services of an action among those of its package.
        known = {name.replace("/action/", "/srv/"): name for name in session.store.types}
        session._registered_types.update(known | {name: name for name in session.store.types})
        self.session = session
        self.changed = threading.Condition()
        self.newest: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.feedback: list[float] = []

    def new(self, name: str, *values: Any) -> Any:
        """Return a message of a type."""
        return self.session.store.types[name](*values)

    def words(self, kind: str) -> dict[str, Any]:
        """Return the arguments that each node has."""
        return {"router_ip": "127.0.0.1", "router_port": self.port, "type_hash": self.hashes[kind]}

    def subscribe(self, topic: str, kind: str, take: Any) -> Any:
        """Call `take` with each message of a topic."""

        def arrived(message: Any) -> None:
            with self.changed:
                self.newest[topic] = message
                self.counts[topic] = self.counts.get(topic, 0) + 1
                take(message)
                self.changed.notify_all()

        return ROS2Subscriber(topic, kind, arrived, **self.words(kind))

    def wait(self, condition: Any, what: str) -> None:
        """Wait for a condition on what has arrived."""
        with self.changed:
            if not self.changed.wait_for(condition, PATIENCE_S):
                raise TimeoutError(what)

    def ask(self, service: str, kind: str, *values: Any, timeout_s: float = PATIENCE_S) -> Any:
        """Return the answer of a service."""
        client = ROS2ServiceClient(service, kind, timeout=timeout_s, **self.words(kind))
        names = self.session.store.types[f"{kind}_Request"].__dataclass_fields__
        answer = client.call(**dict(zip(names, values, strict=False)))
        client.close()
        if answer is None:
            raise TimeoutError(f"no answer of {service}")
        return answer

    def place(self) -> tuple[float, float]:
        """Return where the robot is, by its odometry."""
        where = self.newest["/r1/odom"].pose.pose.position
        return where.x, where.y


def parameters(pilot: Pilot) -> None:
    """List, read, set and restore a parameter."""
    kind, path = "rcl_interfaces/srv/", "/r1/sidestep/"
    names = pilot.ask(f"{path}list_parameters", f"{kind}ListParameters", [], 0).result.names
    asked = ["v_max_m_s"]
    (before,) = pilot.ask(f"{path}get_parameters", f"{kind}GetParameters", asked).values
    changed = pilot.new("rcl_interfaces/msg/ParameterValue", *value_of(0.25))
    results = []
    for value in (changed, before):
        one = pilot.new("rcl_interfaces/msg/Parameter", "v_max_m_s", value)
        answer = pilot.ask(f"{path}set_parameters", f"{kind}SetParameters", [one])
        results += [one.successful for one in answer.results]
    told("parameters", count=len(names), before=before.double_value, results=results)


def value_of(number: float) -> tuple[Any, ...]:
    """Return the fields of a parameter that is a real number."""
    bytes_, wholes, reals = np.zeros(0, np.int8), np.zeros(0, np.int64), np.zeros(0)
    return (3, False, 0, number, "", bytes_, np.zeros(0, bool), wholes, reals, [])


def teleop(pilot: Pilot) -> None:
    """Drive by hand until the robot has moved, then cease."""
    publisher = ROS2Publisher("/r1/cmd_vel", TWIST, **pilot.words(TWIST))
    vector, began = "geometry_msgs/msg/Vector3", pilot.place()
    ends_s = time.monotonic() + PATIENCE_S
    while math.dist(began, pilot.place()) < 0.1:
        if time.monotonic() > ends_s:
            raise TimeoutError("the robot does not move by cmd_vel")
        ahead = pilot.new(vector, 0.2, 0.0, 0.0)
        publisher.publish(linear=ahead, angular=pilot.new(vector, 0.0, 0.0, 0.0))
        with pilot.changed:
            pilot.changed.wait(0.05)
    publisher.close()
    pilot.wait(lambda: abs(pilot.newest["/r1/odom"].twist.twist.linear.x) < 1e-3, "no stop")
    told("teleop", moved_m=math.dist(began, pilot.place()))


def navigate(pilot: Pilot, goal: list[float]) -> None:
    """Send a goal, and wait for its result."""
    id_bytes = np.frombuffer(uuid.uuid4().bytes, np.uint8)
    number = pilot.new("unique_identifier_msgs/msg/UUID", id_bytes)
    stamp = pilot.new("builtin_interfaces/msg/Time", 0, 0)
    header = pilot.new("std_msgs/msg/Header", stamp, "map")
    where = pilot.new("geometry_msgs/msg/Point", *goal, 0.0)
    turned = pilot.new("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 0.0)
    pose = pilot.new("geometry_msgs/msg/Pose", where, turned)
    stamped = pilot.new("geometry_msgs/msg/PoseStamped", header, pose)
    target = pilot.new(f"{NAVIGATE}_Goal", stamped, "")
    topic = "/r1/navigate_to_pose/_action"
    kind = f"{NAVIGATE}_FeedbackMessage"

    def take(message: Any) -> None:
        pilot.feedback.append(message.feedback.distance_remaining)

    keep = pilot.subscribe(f"{topic}/feedback", kind, take)
    sent = pilot.ask(f"{topic}/send_goal", f"{NAVIGATE}_SendGoal", number, target)
    kind = f"{NAVIGATE}_GetResult"
    ended = pilot.ask(f"{topic}/get_result", kind, number, timeout_s=GOAL_S)
    keep.close()
    told(
        "navigate",
        accepted=bool(sent.accepted),
        status=int(ended.status),
        error_code=int(ended.result.error_code),
        error=ended.result.error_msg,
        feedback=len(pilot.feedback),
        place=pilot.place(),
    )


def main() -> None:
    """Perform all steps, with a bag of three topics."""
    order = json.loads(Path(sys.argv[1]).read_text())
    pilot = Pilot(order)
    with Writer(Path(order["bag"]), version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        try:
            for topic, kind in RECORDED:
                connection = bag.add_connection(topic, kind, typestore=pilot.session.store)

                def record(message: Any, connection: Any = connection, kind: str = kind) -> None:
                    data = pilot.session.store.serialize_cdr(message, kind)
                    bag.write(connection, time.time_ns(), data)

                pilot.subscribe(topic, kind, record)
            pilot.wait(lambda: len(pilot.newest) == len(RECORDED), "no telemetry")
            parameters(pilot)
            teleop(pilot)
            navigate(pilot, order["goal"])
        finally:
            pilot.session.close()  # its threads would keep this process, and write to a closed bag
    told("bag", **pilot.counts)


if __name__ == "__main__":
    main()
