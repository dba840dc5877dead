"""Topics, services and actions of ROS 2 over DDS, named and encoded as rmw_cyclonedds does.

A topic `/odom` is the DDS topic `rt/odom`, a service `/clear` the pair `rq/clearRequest` and `rr/clearReply`. Each
request and reply begins with the client's id and a sequence number. An action is three services and two topics.
"""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import Any

from rvsg.core.errors import InputError, SimulationError
from rvsg_ros2.interfaces import NEWEST, Interfaces, Release, interfaces, ros_type

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
"""Final states of a goal, from action_msgs/msg/GoalStatus."""
POLL_S = 0.002
_AT_ONCE = 100


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """A reader or writer of another participant."""

    topic: str
    """The name in DDS, e.g. `rt/odom`."""
    type_name: str
    """The interface, e.g. `nav_msgs/msg/Odometry`."""
    type_hash: str
    """The RIHS01 hash; empty where it is not announced (Humble and before)."""
    reliable: bool


@dataclass(frozen=True)
class Graph:
    """What other participants offer and want."""

    writers: tuple[Endpoint, ...]
    readers: tuple[Endpoint, ...]

    def publishers(self, topic: str) -> list[Endpoint]:
        """Return the writers of a ROS topic."""
        return [found for found in self.writers if found.topic == _topic(topic)]

    def subscribers(self, topic: str) -> list[Endpoint]:
        """Return the readers of a ROS topic."""
        return [found for found in self.readers if found.topic == _topic(topic)]

    def servers(self, service: str) -> list[Endpoint]:
        """Return the request readers of a service."""
        return [found for found in self.readers if found.topic == _request(service)]

    def services(self, interface: str) -> list[str]:
        """Return the names of all services of an interface, e.g. `lifecycle_msgs/srv/GetState`."""
        wanted = f"{interface}_Request"
        found = {e.topic[3:].removesuffix("Request") for e in self.readers if e.type_name == wanted}
        return sorted(found)


class Bus:
    """A DDS participant that speaks to ROS 2 nodes of one domain.

    `release` decides the definitions of messages that differ between releases; see `set_release`.
    """

    def __init__(self, domain: int, release: Release = NEWEST) -> None:
        self.types: Interfaces = interfaces(release)
        from cyclonedds.builtin import (
            BuiltinDataReader,
            BuiltinTopicDcpsPublication,
            BuiltinTopicDcpsSubscription,
        )
        from cyclonedds.core import DDSException
        from cyclonedds.domain import DomainParticipant

        self.domain = domain
        self._kept: list[Any] = []
        try:
            self._participant = self._keep(DomainParticipant(domain))
            self._writers = self._keep(BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication))
            self._readers = self._keep(BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription))
        except DDSException as error:
            raise InputError(
                f"Cannot join DDS domain {domain}: {error}. Check ROS_DOMAIN_ID and CYCLONEDDS_URI."
            ) from None
        self._own = str(self._participant.guid)
        self._known: dict[tuple[str, str], Endpoint] = {}
        self._subscriptions: dict[tuple[Any, ...], Subscription] = {}
        self._actions: dict[tuple[str, str, str], ActionClient] = {}

    def set_release(self, release: Release) -> None:
        """Use the definitions of this release for everything that is made from now on."""
        self.types = interfaces(release)

    def graph(self) -> Graph:
        """Return what is known of other participants now."""
        for side, reader in (("writer", self._writers), ("reader", self._readers)):
            for sample in _every(reader):
                self._take_over(side, sample)
        known = self._known.items()
        writers, readers = ([each for key, each in known if key[0] == side] for side in ("writer", "reader"))
        return Graph(tuple(writers), tuple(readers))

    def _take_over(self, side: str, sample: Any) -> None:
        from cyclonedds.core import InstanceState, Policy

        key = (side, str(sample.key))
        if sample.sample_info.instance_state != InstanceState.Alive:
            self._known.pop(key, None)
            return
        if not hasattr(sample, "topic_name") or str(sample.participant_key) == self._own:
            return
        data = sample.qos[Policy.Userdata].data if Policy.Userdata in sample.qos else b""
        found = re.search(rb"typehash=(RIHS01_[0-9a-f]+)", data)
        self._known[key] = Endpoint(
            topic=sample.topic_name,
            type_name=ros_type(sample.type_name),
            type_hash=found[1].decode() if found else "",
            reliable=isinstance(sample.qos[Policy.Reliability], Policy.Reliability.Reliable),
        )

    def advertise(self, topic: str, kind: str, *, latched: bool = False, depth: int = 10) -> Publisher:
        """Return a publisher; it offers reliable delivery, and `latched` its last message to late subscribers."""
        qos = self._qos(kind, reliable=True, latched=latched, depth=depth)
        return Publisher(self._writer(_topic(topic), self.types[kind], qos))

    def subscribe(
        self, topic: str, kind: str, *, reliable: bool | None = None, latched: bool = False, depth: int = 50
    ) -> Subscription:
        """Return a subscription. Without `reliable` it asks for what the present publishers offer.

        An equal one that was made before is returned again, with what arrived meanwhile thrown away.
        """
        if reliable is None:
            reliable = all(writer.reliable for writer in self.graph().publishers(topic))
        key = (self.types.release, topic, kind, reliable, latched, depth)
        if key in self._subscriptions:
            self._subscriptions[key].take()
        else:
            qos = self._qos(kind, reliable=reliable, latched=latched, depth=depth)
            self._subscriptions[key] = Subscription(self._reader(_topic(topic), self.types[kind], qos))
        return self._subscriptions[key]

    def client(self, service: str, kind: str) -> Client:
        """Return a client of a service of that interface, e.g. `lifecycle_msgs/srv/GetState`."""
        return Client(self, service, kind)

    def action(self, name: str, kind: str) -> ActionClient:
        """Return the client of an action of that interface, e.g. `nav2_msgs/action/NavigateToPose`."""
        key = (self.types.release, name, kind)
        if key not in self._actions:
            self._actions[key] = ActionClient(self, name, kind)
        return self._actions[key]

    def close(self) -> None:
        """Leave the domain; what was made by this bus cannot be used any more. May be called again."""
        for entity in reversed(self._kept):
            _delete(entity)
        self._kept.clear()
        self._subscriptions.clear()
        self._actions.clear()

    def _writer(self, topic: str, made: Any, qos: Any) -> Any:
        from cyclonedds.pub import DataWriter

        return self._keep(DataWriter(self._participant, self._named(topic, made), qos=qos))

    def _reader(self, topic: str, made: Any, qos: Any) -> Any:
        from cyclonedds.sub import DataReader

        return self._keep(DataReader(self._participant, self._named(topic, made), qos=qos))

    def _named(self, topic: str, made: Any) -> Any:
        from cyclonedds.topic import Topic

        return self._keep(Topic(self._participant, topic, made))

    def _keep(self, entity: Any) -> Any:
        self._kept.append(entity)
        return entity

    def _qos(
        self, kind: str, user_data: str = "", *, reliable: bool = True, latched: bool = False, depth: int = 10
    ) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.util import duration

        hashed = f"typehash={self.types.type_hash(kind)};"
        return Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)) if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(depth),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            Policy.IgnoreLocal.Participant,
            Policy.Userdata(f"{user_data}{hashed}".encode()),
        )


class Publisher:
    """The writing side of a topic."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer

    def close(self) -> None:
        """Publish no more; what was latched is gone for those who subscribe later."""
        _delete(self._writer)

    def publish(self, message: Any) -> None:
        """Send a message.

        Raises:
            SimulationError: a reliable reader does not take it in time.
        """
        from cyclonedds.core import DDSException

        try:
            self._writer.write(message)
        except DDSException as error:
            raise SimulationError(f"a message on {self._writer.topic.name} could not be sent: {error}") from None


class Subscription:
    """The reading side of a topic."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def take(self) -> list[Any]:
        """Return the messages that arrived since the last call, oldest first."""
        return list(_valid(self._reader))


class Client:
    """A client of one service."""

    def __init__(self, bus: Bus, service: str, kind: str) -> None:
        self.service, self.kind = service, kind
        self._request = bus.types.part_of_service(f"{kind}_Request")
        reply = bus.types.part_of_service(f"{kind}_Response")
        self._id = uuid.uuid4().int >> 64
        self._numbers = count(1)
        # The server holds a reply back until it knows the reader with the same client id as the request's writer.
        mark = f"clientid={uuid.uuid4().hex};"
        topic = f"rr/{service.strip('/')}Reply"
        self._reader = bus._reader(topic, reply, bus._qos(f"{kind}_Response", mark))
        self._writer = bus._writer(_request(service), self._request, bus._qos(f"{kind}_Request", mark))
        self._replies: dict[int, Any] = {}

    @property
    def is_matched(self) -> bool:
        """Whether a server is connected in both directions."""
        return bool(self._writer.get_matched_subscriptions()) and bool(self._reader.get_matched_publications())

    def send(self, **fields: Any) -> int:
        """Send a request; return the number that `reply` takes."""
        number = next(self._numbers)
        self._writer.write(self._request(rmw_guid=self._id, rmw_sequence=number, **fields))
        return number

    def reply(self, number: int) -> Any | None:
        """Return the reply to a request, once; None while it is not there."""
        for sample in _valid(self._reader):
            if sample.rmw_guid == self._id:
                self._replies[sample.rmw_sequence] = sample
        return self._replies.pop(number, None)

    def call(self, limit_s: float, meanwhile: Callable[[], None] | None = None, **fields: Any) -> Any | None:
        """Send a request as soon as a server is there; return its reply, or None after `limit_s` of wall time."""
        until = time.monotonic() + limit_s
        number = None
        while time.monotonic() < until:
            if number is None and self.is_matched:
                number = self.send(**fields)
            if number is not None and (found := self.reply(number)) is not None:
                return found
            if meanwhile is not None:
                meanwhile()
            else:
                time.sleep(POLL_S)
        return None


class ActionClient:
    """A client of one action; it follows one goal at a time."""

    def __init__(self, bus: Bus, name: str, kind: str) -> None:
        self.name, self.kind = name, kind
        self.types = bus.types
        """The interfaces that goals are made of."""
        self._send = bus.client(f"{name}/_action/send_goal", f"{kind}_SendGoal")
        self._result = bus.client(f"{name}/_action/get_result", f"{kind}_GetResult")
        self._cancel = bus.client(f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal")
        self._feedback = bus.subscribe(f"{name}/_action/feedback", f"{kind}_FeedbackMessage", reliable=True)
        self._goal_id: list[int] = []
        self._sent = self._asked = 0
        self.accepted: bool | None = None
        """Whether the goal was accepted; None while there is no answer."""
        self.status: int | None = None
        """The final state of the goal; None while it is not final."""
        self.result: Any | None = None
        self.feedback: Any | None = None
        """The newest feedback of the goal."""

    @property
    def is_matched(self) -> bool:
        """Whether a server is connected for goals, results and cancelling."""
        return self._send.is_matched and self._result.is_matched and self._cancel.is_matched

    def send_goal(self, goal: Any) -> None:
        """Send a goal; `poll` learns what becomes of it."""
        self._goal_id = list(uuid.uuid4().bytes)
        self.accepted, self.status, self.result, self.feedback = None, None, None, None
        self._sent, self._asked = self._send.send(goal_id=self._uuid(), goal=goal), 0

    def poll(self) -> None:
        """Take over what arrived."""
        if self.accepted is None and (answer := self._send.reply(self._sent)) is not None:
            self.accepted = bool(answer.accepted)
            if self.accepted:
                self._asked = self._result.send(goal_id=self._uuid())
        if self._asked and self.status is None and (answer := self._result.reply(self._asked)) is not None:
            self.status, self.result = int(answer.status), answer.result
        for message in self._feedback.take():
            if list(message.goal_id.uuid) == self._goal_id:
                self.feedback = message.feedback

    def cancel_all(self, limit_s: float, meanwhile: Callable[[], None] | None = None) -> bool:
        """Cancel every goal of the action, also those of other clients; return whether the server answered."""
        everything = self.types["action_msgs/msg/GoalInfo"]()
        return self._cancel.call(limit_s, meanwhile, goal_info=everything) is not None

    def _uuid(self) -> Any:
        return self.types["unique_identifier_msgs/msg/UUID"](uuid=self._goal_id)


def _every(reader: Any) -> Iterator[Any]:
    while samples := reader.take(_AT_ONCE):
        yield from samples


def _valid(reader: Any) -> Iterator[Any]:
    """Yield what arrived, without the notes on writers that are gone."""
    for sample in _every(reader):
        if sample.sample_info.valid_data:
            yield sample


def _delete(entity: Any) -> None:
    from cyclonedds.core import DDSException

    with suppress(DDSException):
        entity.__del__()


def _topic(name: str) -> str:
    return f"rt/{name.strip('/')}"


def _request(service: str) -> str:
    return f"rq/{service.strip('/')}Request"
