"""An action of a node: goals with feedback, cancellation and a result that waits to be fetched.

An action has three services and two topics. The answer to `get_result` is sent when the goal ends.
Results are kept for clients that ask late, but only the newest ones. A goal whose client has left
the network is cancelled: nobody would end it.
"""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Final

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import action_msgs__msg__GoalInfo as GoalInfo
from rosbags.typesys.stores.ros2_jazzy import action_msgs__msg__GoalStatus as GoalStatus
from rosbags.typesys.stores.ros2_jazzy import action_msgs__msg__GoalStatusArray as GoalStatusArray
from rosbags.typesys.stores.ros2_jazzy import unique_identifier_msgs__msg__UUID as Uuid

from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import RosNode
from gateways.ros2.wire import Attachment, EntityKind, TokenParts
from ground.ros2.messages import time_of
from ground.ros2.offer import LATCHED
from runtime.units import NS_PER_S

UNKNOWN: Final = 0
EXECUTING: Final = 2
CANCELING: Final = 3
SUCCEEDED: Final = 4
CANCELED: Final = 5
ABORTED: Final = 6

NONE: Final = 0
UNKNOWN_GOAL: Final = 2
TERMINATED: Final = 3
"""Answers to a cancellation."""

MAX_KEPT: Final = 64
"""Ended goals whose results are kept, and goals that run at the same time."""

CANCEL: Final = "action_msgs/srv/CancelGoal"
ANY: Final = bytes(16)
"""The id of a goal in a cancellation that is for all."""


Build = Callable[[Interfaces], Any]
"""Makes a message as a distribution defines it."""


class Goal:
    """A goal that was accepted. `client` is the id of the entity that has sent it."""

    def __init__(self, goal_id: bytes, request: Any, client: bytes, accepted_ns: int) -> None:
        self.goal_id, self.request, self.client = goal_id, request, client
        self.accepted_ns = accepted_ns
        self.status = EXECUTING
        self.ended = asyncio.Event()
        self.result: Build | None = None
        self.work: asyncio.Task[None] | None = None

    @property
    def info(self) -> GoalInfo:
        """Id and time of acceptance."""
        return GoalInfo(Uuid(np.frombuffer(self.goal_id, np.uint8)), time_of(self.accepted_ns))

    def cancel(self) -> None:
        """Ask the goal to end; it ends as its work does."""
        if self.status == EXECUTING and self.work is not None:
            self.status = CANCELING
            self.work.cancel()


Feedback = Callable[[Build], None]
Execute = Callable[[Any, Feedback], Awaitable[tuple[int, Build]]]
"""Carries out a goal: receives it, and what sends feedback; returns status and result.

It is cancelled if the client wants so. Then it stops the robot, and raises CancelledError.
"""


class ActionServer:
    """Serves an action. `refuse` returns why a goal is not accepted; `empty` makes a result."""

    def __init__(
        self,
        node: RosNode,
        name: str,
        type_name: str,
        refuse: Callable[[Any], str],
        execute: Execute,
        empty: Callable[[str], Build],
        now_ns: Callable[[], int],
    ) -> None:
        self.goals: dict[bytes, Goal] = {}
        """Those that run, and the newest that have ended, in the order of their acceptance."""

        self._refuse, self._execute, self._empty, self._now_ns = refuse, execute, empty, now_ns
        self._make, self._type = node.session.interfaces.make, type_name
        self._name = node.name.resolve(f"{name}/_action")
        topic, kind = f"{name}/_action/feedback", f"{type_name}_FeedbackMessage"
        self._feedbacks = [
            node.publisher(topic, kind, interfaces=interfaces) for interfaces in node.variants(kind)
        ]
        self._status = node.publisher(
            f"{name}/_action/status", "action_msgs/msg/GoalStatusArray", LATCHED
        )
        node.serve(f"{name}/_action/send_goal", f"{type_name}_SendGoal", self._send_goal)
        topic, kind = f"{name}/_action/get_result", f"{type_name}_GetResult"
        for interfaces in node.variants(kind):
            serve = partial(self._get_result, interfaces)
            node.serve(topic, kind, serve, interfaces=interfaces)
        node.serve(f"{name}/_action/cancel_goal", CANCEL, self._cancel_goal)

    @property
    def running(self) -> list[Goal]:
        """The goals that have not ended."""
        return [goal for goal in self.goals.values() if not goal.ended.is_set()]

    def note_gone(self, parts: TokenParts, gid: bytes) -> None:
        """Cancel the goals of a client that has left the network."""
        if parts.kind is EntityKind.CLIENT and parts.topic == f"{self._name}/send_goal":
            for goal in self.running:
                if goal.client == gid:
                    goal.cancel()

    async def end(self) -> None:
        """Cancel all goals, and wait until they have ended."""
        for goal in self.running:
            goal.cancel()
        works = [goal.work for goal in self.running if goal.work is not None]
        await asyncio.gather(*works, return_exceptions=True)

    async def _send_goal(self, request: Any, attachment: Attachment) -> Any:
        now_ns, goal_id = self._now_ns(), bytes(request.goal_id.uuid)
        is_new = goal_id != ANY and goal_id not in self.goals
        accepted = is_new and len(self.running) < MAX_KEPT and not self._refuse(request.goal)
        if accepted:
            goal = Goal(goal_id, request.goal, attachment.gid, now_ns)
            self.goals[goal_id] = goal
            goal.work = asyncio.get_running_loop().create_task(self._carry_out(goal))
            goal.work.add_done_callback(lambda _: self._end_of(goal))
            self._publish_status()
        return self._make(f"{self._type}_SendGoal_Response", accepted, time_of(now_ns))

    async def _carry_out(self, goal: Goal) -> None:
        """Carry out a goal, whatever happens."""

        def send(feedback: Build) -> None:
            name = f"{self._type}_FeedbackMessage"
            for publisher in self._feedbacks:
                if publisher.is_wanted:
                    made = feedback(publisher.interfaces)
                    publisher.publish(self._make(name, goal.info.goal_id, made))

        try:
            goal.status, goal.result = await self._execute(goal.request, send)
        except asyncio.CancelledError:
            goal.status, goal.result = CANCELED, self._empty("cancelled")
        except Exception as error:
            goal.status, goal.result = ABORTED, self._empty(f"{type(error).__name__}: {error}")

    def _end_of(self, goal: Goal) -> None:
        """Note the end of a goal; its work has not even begun if it was cancelled at once."""
        if goal.result is None:
            goal.status, goal.result = CANCELED, self._empty("cancelled")
        goal.ended.set()
        ended = [one.goal_id for one in self.goals.values() if one.ended.is_set()]
        for goal_id in ended[:-MAX_KEPT]:
            del self.goals[goal_id]
        self._publish_status()

    def _publish_status(self) -> None:
        found = [GoalStatus(goal.info, goal.status) for goal in self.goals.values()]
        self._status.publish(GoalStatusArray(found))

    async def _get_result(
        self, interfaces: Interfaces, request: Any, _attachment: Attachment
    ) -> Any:
        name = f"{self._type}_GetResult_Response"
        goal = self.goals.get(bytes(request.goal_id.uuid))
        if goal is None:
            nothing = self._empty("there is no such goal")
            return interfaces.make(name, UNKNOWN, nothing(interfaces))
        await goal.ended.wait()
        assert goal.result is not None, "set before it has ended"
        return interfaces.make(name, goal.status, goal.result(interfaces))

    async def _cancel_goal(self, request: Any, _attachment: Attachment) -> Any:
        """Cancel one goal, those until a time, or all, as the request has an id or a stamp."""
        goal_id, stamp = bytes(request.goal_info.goal_id.uuid), request.goal_info.stamp
        until_ns = stamp.sec * NS_PER_S + stamp.nanosec
        answer = f"{CANCEL}_Response"
        if goal_id != ANY and goal_id not in self.goals and not until_ns:
            return self._make(answer, UNKNOWN_GOAL, [])
        chosen = [
            goal
            for goal in self.running
            if goal.goal_id == goal_id
            or (until_ns > 0 and goal.accepted_ns <= until_ns)
            or (goal_id == ANY and not until_ns)
        ]
        if not chosen and goal_id in self.goals:
            return self._make(answer, TERMINATED, [])
        for goal in chosen:
            goal.cancel()
        if chosen:
            self._publish_status()
        return self._make(answer, NONE, [goal.info for goal in chosen])
