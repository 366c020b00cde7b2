"""The topic table: each key contains one robot's name, and no path occurs twice."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.topics import SERVICES, SONAR, TOPICS, Role, sender_of, system_id_of
from runtime.errors import UserError
from tests.support.each import each


def test_no_path_is_used_twice() -> None:
    paths = [topic.path for topic in TOPICS] + [service.path for service in SERVICES]
    assert len(paths) == len(set(paths))


def test_periodic_stream_stays_fresh_after_two_lost_frames() -> None:
    streams = [topic for topic in TOPICS if topic.stale_after_ns]
    assert streams
    for topic in streams:
        assert topic.stale_after_ns >= 2.9e9 / topic.rate_hz, topic.path


def test_every_topic_has_messages_and_a_description() -> None:
    assert all(topic.messages and topic.doc for topic in TOPICS)
    assert all(service.doc for service in SERVICES)


def test_a_key_has_prefix_robot_and_path() -> None:
    assert SONAR.key("r1") == "sidestep/r1/sense/sonar"
    assert SONAR.key("r1", prefix="test-7") == "test-7/r1/sense/sonar"
    assert SERVICES[0].key("r_2-b") == "sidestep/r_2-b/srv/command"


@each("name", ["", "R1", "a/b", "r*", "x" * 17, "r 1", "r1\n", "é"])
def test_a_name_that_could_break_a_key_is_refused_with_the_rule(name: str) -> None:
    with pytest.raises(UserError, match="1 to 16 of the characters"):
        SONAR.key(name)


@given(st.from_regex(r"[a-z0-9_-]{1,16}", fullmatch=True))
def test_every_good_name_is_one_element_of_a_key(name: str) -> None:
    assert SONAR.key(name).split("/") == ["sidestep", name, "sense", "sonar"]
    assert 1 <= system_id_of(name) <= 250


def test_senders_are_distinguishable() -> None:
    assert sender_of(Role.ROBOT, "r7") == (7, 1)
    assert sender_of(Role.PLANT, "r7") == (7, 25)
    assert sender_of(Role.GROUND, "r7") == (255, 190)
    assert sender_of(None, "r7") == (254, 0)
    assert [system_id_of(name) for name in ("r", "r0", "r250", "r251", "r999")] == [1, 1, 250, 1, 1]
