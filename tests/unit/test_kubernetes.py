"""The Kubernetes example: each field is one of the API, and the pods fit each other."""

from pathlib import Path
from typing import Any, Literal

import msgspec
import yaml

from ground.cli.main import parse
from ground.cli.run.container import RobotNumber, words_of
from plant.process import parser as plant_parser
from robot.run import parser as robot_parser
from runtime.cli.verb_table import find

MANIFEST = Path(__file__).parents[2] / "examples/kubernetes/fleet.yaml"


class Fields(msgspec.Struct, forbid_unknown_fields=True):
    """A part of the API; what the example does not use is left out."""


class Metadata(Fields):
    name: str = ""
    labels: dict[str, str] = {}


class Port(Fields):
    name: str
    port: int = 0
    containerPort: int = 0  # noqa: N815 - a name of the API


class Capabilities(Fields):
    drop: list[str]


class SecurityContext(Fields):
    runAsNonRoot: bool  # noqa: N815
    runAsUser: int  # noqa: N815
    readOnlyRootFilesystem: bool  # noqa: N815
    allowPrivilegeEscalation: bool  # noqa: N815
    capabilities: Capabilities


class Amounts(Fields):
    cpu: str
    memory: str


class Resources(Fields):
    requests: Amounts
    limits: Amounts


class Container(Fields):
    name: str
    image: str
    imagePullPolicy: Literal["Always", "IfNotPresent", "Never"]  # noqa: N815
    command: list[str]
    resources: Resources
    securityContext: SecurityContext  # noqa: N815
    args: list[str] = []
    ports: list[Port] = []


class PodSpec(Fields):
    containers: list[Container]


class Template(Fields):
    metadata: Metadata
    spec: PodSpec


class Selector(Fields):
    matchLabels: dict[str, str]  # noqa: N815


class Ordinals(Fields):
    start: int


class WorkloadSpec(Fields):
    selector: Selector
    template: Template


class StatefulSpec(WorkloadSpec):
    serviceName: str  # noqa: N815
    replicas: int
    ordinals: Ordinals
    podManagementPolicy: Literal["OrderedReady", "Parallel"]  # noqa: N815


class ServiceSpec(Fields):
    selector: dict[str, str]
    ports: list[Port] = []
    clusterIP: str = ""  # noqa: N815


class Service(Fields, tag_field="kind", tag="Service"):
    apiVersion: Literal["v1"]  # noqa: N815
    metadata: Metadata
    spec: ServiceSpec


class Deployment(Fields, tag_field="kind", tag="Deployment"):
    apiVersion: Literal["apps/v1"]  # noqa: N815
    metadata: Metadata
    spec: WorkloadSpec


class StatefulSet(Fields, tag_field="kind", tag="StatefulSet"):
    apiVersion: Literal["apps/v1"]  # noqa: N815
    metadata: Metadata
    spec: StatefulSpec


def objects() -> list[Service | Deployment | StatefulSet]:
    documents = list(yaml.safe_load_all(MANIFEST.read_text()))
    return msgspec.convert(documents, list[Service | Deployment | StatefulSet])


def workloads() -> dict[str, Deployment | StatefulSet]:
    return {one.metadata.name: one for one in objects() if not isinstance(one, Service)}


def words_in(workload: Deployment | StatefulSet, number: int = 1) -> list[str]:
    """Return the verb that the container of a pod ends in."""
    (container,) = workload.spec.template.spec.containers
    words = [*container.command, *container.args]
    call = find(words[1:])
    assert call is not None
    options = parse([call.word, *call.arguments])
    return words_of(options, RobotNumber(number, options.robots))


def test_each_selector_finds_its_pods() -> None:
    labels = [one.spec.template.metadata.labels for one in workloads().values()]
    for one in objects():
        wanted = one.spec.selector
        assert (wanted if isinstance(wanted, dict) else wanted.matchLabels) in labels


def test_every_robot_has_a_pod_and_a_plant() -> None:
    found = workloads()
    robots = found["robot"]
    assert isinstance(robots, StatefulSet)
    numbers = range(robots.spec.ordinals.start, robots.spec.ordinals.start + robots.spec.replicas)
    names = [robot_parser().parse_args(words_in(robots, number)[2:]).id for number in numbers]
    plants: list[Any] = [
        plant_parser().parse_args(words_in(found[name])[2:]) for name in ("plant-a", "plant-b")
    ]
    assert {one.robots for one in plants} == {",".join(names)}
    assert ",".join(one.own for one in plants) == ",".join(names)


def test_router_listens_where_its_service_sends() -> None:
    service = next(one for one in objects() if isinstance(one, Service) and one.spec.ports)
    (router,) = workloads()["router"].spec.template.spec.containers
    assert service.spec.ports[0].port == router.ports[0].containerPort
    assert router.command[-1].endswith(f":{service.spec.ports[0].port}")
    bus = (MANIFEST.parents[2] / "docker/bus.toml").read_text()
    assert f"tcp/{service.metadata.name}:{service.spec.ports[0].port}" in bus
