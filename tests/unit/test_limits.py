"""Texts and settings that mention a limit show its present value."""

import re
from pathlib import Path

from ground.client.api import robot as client
from ground.client.api.robot import Robot
from ground.client.emergency_stop import HELD_NS, REPEAT_NS
from ground.client.operations.commands import StopNow
from ground.client.operations.teleop import TTL_MS
from ground.client.parameter_rows import NAME, NAME_RULE
from ground.map import pen
from plant.process.robot_link import MAX_AGE_TICKS
from protocol.topics import DRIVE, OPERATOR, SONAR, STOP, TELEOP, WHEELS, Topic
from protocol.wire.limits import (
    MAX_LEASE_MS,
    MAX_OPERATOR_NAME_BYTES,
    MAX_PARAMETER_NAME_BYTES,
    MAX_TELEOP_TTL_MS,
    MAX_WHEEL_TTL_MS,
    OPERATOR_LOST_MS,
    SCAN_LOST_MS,
    TICKS_LOST_MS,
)
from protocol.wire.message import LAYOUT, Message
from protocol.wire.reasons import Reason, reason_text
from robot.core.parameters import DEFAULTS
from robot.core.safety.failsafe import ROWS
from robot.lease import IDLE_NS, IDLE_S, LAPSE_NS, LAPSE_S
from robot.process import OVERRUNS_IN_A_ROW
from robot.senses import MAX_EXTRA_NS
from runtime.units import CONTROL_HZ, NS_PER_MS, NS_PER_S, PERIOD_MS
from runtime.watchdog import HUNG_S
from study.cli.study_run import parser
from study.intervals import CHI2_2, CONFIDENCE, CONFIDENT
from study.runner.plan import DETOUR_FACTOR, MIN_TIMEOUT_S, UNREACHABLE_TIMEOUT_S
from tests.support.each import each

ROOT = Path(__file__).resolve().parents[2]
S = 1000
IN_WORDS = ("zero", "one", "two", "three", "four", "five", "six")


def page(name: str) -> str:
    """Return a page of the documentation as one line."""
    return " ".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8").split())


@each(
    ("reason", "words"),
    [
        (Reason.TICKS_LOST, f"for {TICKS_LOST_MS} ms"),
        (Reason.SCAN_LOST, f"for {SCAN_LOST_MS} ms"),
    ],
)
def test_the_text_of_a_failsafe_shows_its_limit(reason: Reason, words: str) -> None:
    assert reason_text(reason).endswith(words)


@each(
    ("topic", "limit_ms"),
    [
        (WHEELS, TICKS_LOST_MS),
        (SONAR, SCAN_LOST_MS),
        (OPERATOR, OPERATOR_LOST_MS),
        (DRIVE, MAX_WHEEL_TTL_MS),
        (TELEOP, MAX_TELEOP_TTL_MS),
    ],
)
def test_a_topic_is_stale_when_its_limit_is_over(topic: Topic[Message], limit_ms: int) -> None:
    assert topic.stale_after_ns == limit_ms * NS_PER_MS


def test_the_sizes_of_names_are_those_of_the_wire() -> None:
    sizes = {field.name: field.length for field in LAYOUT["LeaseRequest"].fields}
    assert sizes["name"] == MAX_OPERATOR_NAME_BYTES
    sizes = {field.name: field.length for field in LAYOUT["ParamSet"].fields}
    assert sizes["param_id"] == MAX_PARAMETER_NAME_BYTES
    assert NAME.match("p" * MAX_PARAMETER_NAME_BYTES)
    assert not NAME.match("p" * (MAX_PARAMETER_NAME_BYTES + 1))
    assert str(MAX_PARAMETER_NAME_BYTES) in NAME_RULE


def test_the_core_and_the_lease_use_the_limits_of_the_wire() -> None:
    assert DEFAULTS.op_lost_ms == OPERATOR_LOST_MS
    assert LAPSE_NS < IDLE_NS == MAX_LEASE_MS * NS_PER_MS
    assert DEFAULTS.period_s * S == PERIOD_MS


@each(
    ("name", "words"),
    [
        ("concepts/architecture", f"wheel speeds, valid for {MAX_WHEEL_TTL_MS} ms"),
        ("concepts/architecture", f'"control loop, {CONTROL_HZ:g} Hz"'),
        ("concepts/architecture", f"accepts the command for {MAX_WHEEL_TTL_MS} ms"),
        ("concepts/clocks", f"on a fixed grid of {PERIOD_MS} ms"),
        ("concepts/safety", f"| no fresh wheel ticks | {TICKS_LOST_MS} ms |"),
        ("concepts/safety", f"| no fresh sonar scan | {SCAN_LOST_MS} ms |"),
        ("concepts/safety", f"lost in GUIDED or MANUAL | {OPERATOR_LOST_MS / S:g} s after"),
        ("concepts/safety", f"| its loop hangs | {MAX_WHEEL_TTL_MS} ms |"),
        ("concepts/safety", f"after {HUNG_S:g} s it ends itself"),
        ("concepts/safety", f"over a period late | {OVERRUNS_IN_A_ROW} in a row; one |"),
        ("concepts/safety", f"a tenth of it for {DEFAULTS.wheel_time_ms / S:g} s, checked"),
        ("concepts/safety", f"| the robot itself is gone | {MAX_WHEEL_TTL_MS} ms |"),
        ("concepts/safety", f"repeat it every {REPEAT_NS // NS_PER_MS} ms"),
        ("concepts/safety", f"without this id for {IN_WORDS[HELD_NS // NS_PER_S]} second"),
        ("concepts/safety", f"more than {MAX_EXTRA_NS // NS_PER_MS} ms later than usual"),
        ("concepts/safety", f"a time-to-live of at most {MAX_TELEOP_TTL_MS / S:g} s"),
        ("concepts/safety", f"all its programs were silent for {LAPSE_S:g} s"),
        ("concepts/safety", f"after {IDLE_S:g} s in which the person has neither driven"),
        ("concepts/safety", f"one of the last {IN_WORDS[MAX_AGE_TICKS + 1]} ticks"),
        ("concepts/safety", f"ends it {MAX_WHEEL_TTL_MS} ms after that tick"),
        ("how-to/missions", f"{LAPSE_S:g} s after the last sign of life"),
        ("how-to/real-robot", f"time-to-live, {MAX_WHEEL_TTL_MS} ms at most"),
        ("how-to/real-robot", f"one of the last {IN_WORDS[MAX_AGE_TICKS + 1]} ticks"),
    ],
)
def test_pages_show_the_limits(name: str, words: str) -> None:
    assert words in page(name)


@each(
    ("documented", "words"),
    [
        (client, f"by itself after its `op_lost_ms`, by default {OPERATOR_LOST_MS / S:g} s"),
        (Robot.drive, f"Each speed expires after {TTL_MS} ms"),
        (Robot.emergency_stop, f"repeat every {REPEAT_NS // NS_PER_MS} ms until"),
        (StopNow, f"repeat every {REPEAT_NS // NS_PER_MS} ms until"),
    ],
)
def test_documented_operations_show_the_limits(documented: object, words: str) -> None:
    assert words in " ".join((documented.__doc__ or "").split())


def test_the_failsafe_of_the_budget_shows_its_overruns() -> None:
    (row,) = (row for row in ROWS if row.reason == Reason.BUDGET)
    assert row.limit.startswith(f"{OVERRUNS_IN_A_ROW} overruns in a row")


def test_the_table_of_topics_shows_how_often_a_stop_is_repeated() -> None:
    assert re.search(rf"\b{REPEAT_NS // NS_PER_MS} ms\b", STOP.doc)


def test_texts_about_confidence_take_it_from_its_constant() -> None:
    """Require the constant: a literal number would stay when it changes."""
    literal = re.compile(r"\d %\)? (intervals?|ellipse|inside|bounds)|(intervals? of|\() ?\d+ %")
    files = [*(ROOT / "study").rglob("*.py"), *(ROOT / "ground").rglob("*.py")]
    found = [f.name for f in files if literal.search(f.read_text(encoding="utf-8"))]
    assert found == []


def test_the_confidence_of_both_ellipses_is_the_same() -> None:
    """Draw in the ground station the ellipse that the study evaluates."""
    assert pen.CHI2_2 == CHI2_2
    assert f"{100 * CONFIDENCE:g} %" == CONFIDENT


def test_helps_show_the_defaults_in_force() -> None:
    study_help = " ".join(parser().format_help().split())
    for words in (
        f"{DETOUR_FACTOR:g} times",
        f"at least {MIN_TIMEOUT_S:g} s",
        f"{UNREACHABLE_TIMEOUT_S:g} s where",
    ):
        assert words in study_help
