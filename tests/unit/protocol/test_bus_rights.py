"""The tables of topics and services define all rights; everything else is rejected."""

from typing import Any

import pytest
import zenoh

from protocol.bus.network import Network
from protocol.bus.rights import (
    GATEWAY_ASKS,
    GATEWAY_RECEIVES,
    access_control,
    denial,
    dialled_access_control,
    ends_of,
    grant_of,
    grants,
    may_fetch,
    operator_name,
    role_mismatch,
    unanswered,
)
from protocol.topics import (
    ANSWERED,
    COMMAND,
    COMMANDED,
    GATEWAY,
    MARK,
    PARAMETERS,
    RUN,
    SERVICES,
    TEXT,
    TOPICS,
    WORLD,
    Role,
)
from runtime.errors import UserError
from tests.support.each import each

ALL_ROLES = {"router", "plant", "ground", "viewer", "recorder", "gateway", "robot-r1", "robot-r2"}


def rules(network: Network | None = None) -> dict[str, Any]:
    return access_control(network or Network(robots=("r1", "r2")))


def test_there_is_a_grant_for_each_role_and_each_robot() -> None:
    assert set(grants(("r1", "r2"))) == ALL_ROLES


@each("topic", TOPICS)
def test_a_topic_has_one_kind_of_publisher(topic: Any) -> None:
    end = "/ground/*" if topic.of_operators else ""
    found = grants(("r1", "r2")).items()
    puts = {name for name, grant in found if f"r1/{topic.path}{end}" in grant.puts} - {"router"}
    publisher = {Role.PLANT: "plant", Role.ROBOT: "robot-r1", Role.GROUND: "ground"}
    assert puts == {publisher[topic.publisher]}


@each("service", SERVICES)
def test_only_ground_stations_may_query_changing_services(service: Any) -> None:
    keys = {f"r1/{service.path}", f"r1/{service.path}/ground/*"}
    asks = {name for name, grant in grants(("r1",)).items() if keys & set(grant.asks)}
    assert asks - {"router"} == (
        {"ground"} if service.requests else {"ground", "viewer", "recorder"}
    )


def test_plant_receives_only_wheel_commands_and_own_topics() -> None:
    plant = grants(("r1",))["plant"]
    assert set(plant.subscribes) - set(plant.puts) == {"r1/drive/wheels"}


def test_robot_receives_only_senses_and_commands() -> None:
    robot = grants(("r1", "r2"))["robot-r1"]
    families = {path.split("/")[1] for path in set(robot.subscribes) - set(robot.puts)}
    assert families == {"sense", "op"}


def test_gateway_has_the_least_rights_that_its_clients_need() -> None:
    grant = grants(("r1",))["gateway"]
    assert not [key for key in grant.subscribes if not key.startswith(("r1/tlm/", "r1/sense/"))]
    assert not {"r1/sim/run", "r1/sim/world"} & {*grant.asks, *grant.puts}
    assert all(key.endswith("/gateway/*") for key in (*grant.puts, *grant.asks))
    assert f"r1/{GATEWAY.path}/gateway/*" in grant.puts
    assert operator_name("gateway") == "gateway"
    assert denial("gateway", "r1", COMMAND) == ""
    assert "may not query sim/run" in denial("gateway", "r1", RUN)
    assert not may_fetch("gateway", "r1", COMMANDED)


def test_publisher_may_subscribe_to_its_own_topics() -> None:
    for name in ("plant", "robot-r1"):
        grant = grants(("r1",))[name]
        assert set(grant.puts) < set(grant.subscribes)


def test_robot_has_no_rights_under_another_name() -> None:
    grant = grants(("r1", "r2"))["robot-r2"]
    for paths in (grant.puts, grant.subscribes, grant.answers, grant.shows):
        assert all(path.startswith("r2/") for path in paths)


@each(("name", "fetches"), [("viewer", False), ("recorder", True)])
def test_only_a_recorder_may_fetch_past_commands(name: str, fetches: bool) -> None:
    asked = [
        key
        for rule in rules()["rules"]
        if rule["id"] == f"{name} ingress query"
        for key in rule["key_exprs"]
    ]
    may = [zenoh.KeyExpr(key) for key in asked]

    def covered(path: str) -> bool:
        key = zenoh.KeyExpr(f"sidestep/r1/{path}/@adv/pub/1/2/_")
        return any(one.includes(key) for one in may)

    assert covered(TEXT.path)
    assert covered(f"{MARK.path}/ada/1")
    assert [covered(topic.path) for topic in (COMMANDED, ANSWERED)] == [fetches, fetches]
    for topic in (TEXT, MARK, COMMANDED, ANSWERED):
        assert may_fetch(name, "r1", topic) is (fetches or topic in (TEXT, MARK))
        assert may_fetch(None, "r1", topic)


def test_everything_not_granted_is_denied() -> None:
    found = rules()
    assert (found["enabled"], found["default_permission"]) == (True, "deny")
    assert {rule["permission"] for rule in found["rules"]} == {"allow"}


def test_only_the_router_may_put_or_query_wildcards() -> None:
    """Admit a wildcard only by a rule with one; below @adv no process acts on it."""
    for rule in rules()["rules"]:
        name, flow, *_ = rule["id"].split()
        if name == "router" or flow == "egress":
            continue
        if {"put", "query", "reply", "declare_queryable"} & set(rule["messages"]):
            plain = [key.partition("/@adv/")[0] for key in rule["key_exprs"]]
            commands = [key for key in rule["key_exprs"] if "/@adv/" not in key]
            ends = ("/ground/*", "/gateway/*", "/*/*")
            own = [
                next((key.removesuffix(e) for e in ends if key.endswith(e)), key)
                for key in commands
            ]
            assert all("*" not in key for key in own), rule["id"]
            is_robot = name.startswith("robot-")
            asker = is_robot or name in ("ground", "viewer", "recorder", "gateway")
            assert asker or all("*" not in key for key in plain), rule["id"]


def may_come(network: Network, dialling: str = "") -> list[tuple[str, list[str], str]]:
    """Return name, kinds of message and key of each rule about what may come in."""
    found: Any = dialled_access_control(network, dialling) if dialling else access_control(network)
    return [
        (rule["id"].split()[0], rule["messages"], key)
        for rule in found["rules"]
        if "ingress" in rule["flows"]
        for key in rule["key_exprs"]
    ]


HOSTILE = ("**", "sidestep/**", "sidestep/r1/**", "sidestep/r1/a/**", "sidestep/r1/**/a/**/a/**/c")


@each("dialling", ["", "viewer", "recorder", "gateway", "ground-ada", "plant", "robot-r1"])
def test_no_permission_includes_a_pattern_with_many_wildcards(dialling: str) -> None:
    """A holder may declare whatever its keys include; `**` would include every pattern."""
    network = Network(robots=("r1", "r2"), operators=("ada",))
    for name, _, key in may_come(network, dialling):
        assert "**" not in key, (name, key)
        below = (f"{key}/**", f"{key.rpartition('/')[0]}/**", f"{key}/**/a/**/a")
        for pattern in (*HOSTILE, *below):
            assert not zenoh.KeyExpr(key).includes(zenoh.KeyExpr(pattern)), (name, key, pattern)


def test_no_grant_contains_a_double_wildcard() -> None:
    for name, grant in grants(("r1", "r2"), ("ada",)).items():
        lists = (
            grant.puts,
            grant.subscribes,
            grant.fetches,
            grant.asks,
            grant.answers,
            grant.shows,
        )
        assert not [key for one in lists for key in one if "**" in key], name


USED = {
    "viewer": (TOPICS, (PARAMETERS, WORLD)),
    "recorder": (TOPICS, (PARAMETERS, WORLD)),
    "ground-ada": (TOPICS, SERVICES),
    "gateway": (GATEWAY_RECEIVES, GATEWAY_ASKS),
    "plant": ([topic for topic in TOPICS if topic.path.startswith("drive/")], ()),
    "robot-r1": ([t for t in TOPICS if t.path.startswith(("sense/", "op/"))], ()),
}
"""Topics that each role receives, and services that it asks, beside all that it sends."""


@each(("name", "used"), USED.items())
def test_every_topic_and_service_in_use_is_permitted(name: str, used: Any) -> None:
    mine = [one for one in may_come(Network(robots=("r1",), operators=("ada",))) if one[0] == name]
    own = f"/{operator_name(name)}/1"

    def permitted(kind: str, key: str) -> bool:
        asked = zenoh.KeyExpr(f"sidestep/r1/{key}")
        return any(kind in kinds and zenoh.KeyExpr(one).includes(asked) for _, kinds, one in mine)

    topics, services = used
    for topic in topics:
        for end in ends_of(topic):
            assert permitted("declare_subscriber", f"{topic.path}{end}"), topic.path
        if may_fetch(name, "r1", topic) and topic.history:
            kept = f"{topic.path}{ends_of(topic)[-1]}/@adv/pub/*/*/_"
            assert permitted("declare_subscriber", kept), topic.path
            assert permitted("declare_liveliness_subscriber", kept), topic.path
            assert permitted("query", kept), topic.path
    for service in services:
        end = own if service.of_operators and operator_name(name) else ""
        assert permitted("query", f"{service.path}{end}"), service.path
    role = {"plant": Role.PLANT, "robot-r1": Role.ROBOT}.get(name)
    for topic in (one for one in TOPICS if one.publisher is role):
        assert permitted("put", topic.path), topic.path
        if topic.history:
            for kind in ("put", "declare_queryable", "liveliness_token", "reply"):
                assert permitted(kind, f"{topic.path}/@adv/pub/1/2/_"), (topic.path, kind)
    for service in (one for one in SERVICES if one.server is role):
        for end in ends_of(service):
            assert permitted("declare_queryable", f"{service.path}{end}"), service.path


def test_only_role_certificates_are_named() -> None:
    subjects = rules()["subjects"]
    assert {name for one in subjects for name in one["cert_common_names"]} == ALL_ROLES
    assert all(set(one) == {"id", "cert_common_names"} for one in subjects)


def test_rule_names_are_unique_and_belong_to_one_role() -> None:
    found = rules()
    ids = [rule["id"] for rule in found["rules"]]
    used = [one for policy in found["policies"] for one in policy["rules"]]
    assert len(set(ids)) == len(ids)
    assert sorted(used) == sorted(ids)


def test_all_keys_are_below_the_prefix() -> None:
    found = rules(Network(prefix="yard", robots=("r1",)))
    keys = [key for rule in found["rules"] for key in rule["key_exprs"]]
    assert all(key.startswith("yard/") for key in keys)


def test_grant_has_a_description_of_its_holder() -> None:
    robot, viewer = grant_of("robot-r7"), grant_of("viewer")
    assert robot is not None
    assert viewer is not None
    assert (robot.description, viewer.description) == ("is the robot r7", "only observes")
    for nobody in ("", "stranger", "robot-", "robot-R 1", "Ground"):
        assert grant_of(nobody) is None


def test_rejected_query_gives_the_reason() -> None:
    assert denial("ground", "r1", COMMAND) == ""
    assert denial("viewer", "r1", WORLD) == denial("viewer", "r1", PARAMETERS) == ""
    assert denial("viewer", "r1", RUN) == (
        "the certificate in use is that of 'viewer', which only observes and may not query sim/run"
    )
    assert "which is the robot r2 and may not query" in denial("robot-r2", "r1", COMMAND)
    assert "no role" in denial("stranger", "r1", COMMAND)


def test_any_process_may_query_an_open_bus() -> None:
    assert denial(None, "r1", COMMAND) == ""
    assert unanswered(None, "r1", COMMAND) == "no process serves it (is the robot running?)"
    assert "only observes" in unanswered("viewer", "r1", COMMAND)


def test_a_process_needs_the_certificate_of_its_role() -> None:
    assert role_mismatch(None, Role.PLANT, "r1") == role_mismatch("router", Role.PLANT, "r1") == ""
    assert (
        role_mismatch("plant", Role.PLANT, "r1")
        == role_mismatch("robot-r1", Role.ROBOT, "r1")
        == ""
    )
    assert role_mismatch("viewer", Role.GROUND, "r1") == role_mismatch("stranger", None, "r1") == ""
    assert "needs that of 'robot-r2'" in role_mismatch("robot-r1", Role.ROBOT, "r2")


def test_operator_publishes_and_queries_only_under_its_name() -> None:
    found = grants(("r1",), ("ada", "bob"))
    shared = [path for path in found["ground-ada"].asks if path.startswith("r1/sim/")]
    for name, other in (("ada", "bob"), ("bob", "ada")):
        grant = found[f"ground-{name}"]
        own = [path for path in (*grant.puts, *grant.asks) if path not in shared]
        assert own
        assert all(path.endswith(f"/{name}/*") for path in own)
        assert not set(own) & {*found[f"ground-{other}"].puts, *found[f"ground-{other}"].asks}
        assert not set(own) & {*found["ground"].puts, *found["ground"].asks}


def test_rules_name_the_operators_of_the_network() -> None:
    subjects = rules(Network(robots=("r1",), operators=("ada",)))["subjects"]
    assert {"ground-ada", "ground"} <= {one["id"] for one in subjects}
    assert "ground-bob" not in {one["id"] for one in subjects}


def test_the_name_of_an_operator_comes_from_its_certificate() -> None:
    assert operator_name("ground-ada") == "ada"
    assert operator_name("ground") == "ground"
    assert operator_name(None) == "open"
    assert operator_name("viewer") is operator_name("robot-r1") is operator_name("plant") is None
    assert denial("ground-ada", "r1", COMMAND) == ""
    for nobody in ("ground-", "ground-open", "ground-ground", "ground-A B"):
        assert grant_of(nobody) is None
        assert "is no role" in denial(nobody, "r1", COMMAND)


@each(
    ("name", "why"),
    [
        ("open", "it stands for every operator on an open bus"),
        ("ground", "the holder of the certificate `ground`"),
        *(
            (role, "it is the name of a role")
            for role in ("router", "plant", "robot", "viewer", "recorder", "gateway")
        ),
        ("Ada", "use 1 to 16 of the characters"),
    ],
)
def test_a_reserved_name_of_an_operator_is_refused(name: str, why: str) -> None:
    with pytest.raises(UserError, match=why):
        Network(operators=(name,))
    with pytest.raises(UserError, match=why):
        grants((), (name,))


def test_impossible_robot_name_is_rejected() -> None:
    with pytest.raises(UserError, match="robot name"):
        grants(("R 1",))
