"""`docker compose` as a person types it, and a browser's first steps without a browser."""

import json
import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qs, urlsplit
from uuid import uuid4

from checks.harness.crew import free_endpoint
from checks.harness.until import until

PATIENCE_S = 30.0


class Answer(NamedTuple):
    status: int
    text: str
    cookie: str


def asked(address: str, path: str = "/", cookie: str = "") -> Answer:
    """Return the server's answer for a path."""
    place = urlsplit(address)
    assert place.hostname is not None
    with closing(HTTPConnection(place.hostname, place.port, timeout=PATIENCE_S)) as connection:
        connection.request("GET", path, headers={"Cookie": cookie} if cookie else {})
        answer = connection.getresponse()
        given = (answer.getheader("Set-Cookie") or "").partition(";")[0]
        return Answer(answer.status, answer.read().decode(errors="replace"), given)


def token_in(address: str) -> str:
    return parse_qs(urlsplit(address).query)["token"][0]


ROOT: Final = Path(__file__).parents[2]
BUILD_S: Final = 600.0
WITHIN_S: Final = 120.0
HEALTHY_S: Final = 180.0
POLL_S: Final = 0.2
"""Between two calls of docker, which would keep a core busy."""
PARTS: Final = ("plant", "robot")
ADDRESS: Final = re.compile(r"open (http://\S+)")
LAST_WORDS: Final = 4000
CGROUPS: Final = Path("/sys/fs/cgroup")
LABEL: Final = "com.docker.compose"
LEFTOVERS: Final = (
    (("ps", "--all"), ("rm", "--force")),
    (("network", "ls"), ("network", "rm")),
    (("volume", "ls"), ("volume", "rm")),
)
"""How to list them, and how to remove them."""

TRIES: Final = 6
BUSY: Final = ("control loop too slow", "not armed", "no fresh", "no answer")
"""What becomes of a drive where others take the processor away."""


@dataclass(frozen=True)
class Done:
    """Result of a command: its exit code and its output on both streams."""

    code: int
    said: str

    @property
    def object(self) -> dict[str, Any]:
        """Return the JSON object after docker's own output."""
        lines = self.said.strip().splitlines()
        assert lines
        assert lines[-1].startswith("{"), self.said
        found: dict[str, Any] = json.loads(lines[-1])
        return found


def docker(*words: str, within_s: float = WITHIN_S) -> str:
    """Run `docker`; return its output. AssertionError with the output when it fails."""
    done = tried(["docker", *words], os.environ, within_s)
    assert done.code == 0, f"docker {' '.join(words)}: {done.said}"
    return done.said


def tried(words: list[str], environment: Mapping[str, str], within_s: float) -> Done:
    done = subprocess.run(
        words,
        cwd=ROOT,
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=within_s,
        check=False,
    )
    return Done(done.returncode, done.stdout.decode(errors="replace"))


@dataclass
class Compose:
    """One project: its containers, networks and volumes have its name in theirs."""

    image: str
    settings: Mapping[str, str] = field(default_factory=dict)
    profiles: tuple[str, ...] = ()
    name: str = field(default_factory=lambda: f"sidestep-{uuid4().hex[:8]}")
    port: str = field(default_factory=lambda: free_endpoint().rpartition(":")[2])
    _restore: ExitStack = field(default_factory=ExitStack)

    def command(self, *words: str) -> list[str]:
        chosen = [word for profile in self.profiles for word in ("--profile", profile)]
        return ["docker", "compose", "--ansi=never", "-p", self.name, *chosen, *words]

    @property
    def environment(self) -> dict[str, str]:
        own = {"SIDESTEP_IMAGE": self.image, "PORT": self.port, **self.settings}
        return {**os.environ, **own}

    def tries(self, *words: str, within_s: float = WITHIN_S) -> Done:
        """`docker compose` with these words, however it ends."""
        return tried(self.command(*words), self.environment, within_s)

    def does(self, *words: str, within_s: float = WITHIN_S) -> str:
        """Run `docker compose`; return its output. AssertionError with the output when it fails."""
        done = self.tries(*words, within_s=within_s)
        assert done.code == 0, f"{' '.join(words)}: {done.said}\n{self.logs()[-LAST_WORDS:]}"
        return done.said

    def up(self, *words: str) -> None:
        """Start it, and wait until the data of plant and robots flow.

        The others are asked for their health less often; `becomes` waits for one of them.
        """
        self.does("up", "-d", "--no-build", *words)
        self.prefer()
        self.recovers()

    def recovers(self) -> None:
        """Wait until the data of plant and robots flow."""
        until(
            lambda: not self.ailing(),
            within_s=HEALTHY_S,
            what=lambda: f"healthy: {self.ailing()}; {self.logs()[-LAST_WORDS:]}",
            poll_s=POLL_S,
        )

    def prefer(self) -> None:
        """Give the containers more processor time than other programs have, if this user may.

        All of them together have the share of one program, which is little on a busy machine. Other
        programs are not under test.
        """
        (router,) = self.containers("router")
        pid = docker("inspect", "--format", "{{.State.Pid}}", router).strip()
        with suppress(OSError):
            groups = dict(
                line.split(":", 2)[1:]
                for line in Path(f"/proc/{pid}/cgroup").read_text().splitlines()
            )
            name, weight, root = ("cpu.shares", "20480", CGROUPS / "cpu")
            if "cpu" not in groups:  # version 2
                name, weight, root = ("cpu.weight", "2000", CGROUPS)
            of_all = root.joinpath(*Path(groups.get("cpu", groups.get("", "/"))).parts[1:-1])
            if of_all != root:
                before = (of_all / name).read_text()
                (of_all / name).write_text(weight)
                self._restore.callback((of_all / name).write_text, before)

    def containers(self, *services: str) -> list[str]:
        """Return the containers of services, also those that have ended."""
        found: list[str] = []
        for service in services:
            labels = f"{LABEL}.service={service}", f"{LABEL}.project={self.name}"
            filters = [word for label in labels for word in ("--filter", f"label={label}")]
            found += docker("ps", "--all", "--quiet", *filters).split()
        return found

    def ailing(self) -> list[str]:
        """Return what plant and robots lack to be healthy."""
        asked = self.containers(*PARTS)
        if not asked:
            return ["no container"]
        states = docker("inspect", "--format", "{{.Name}} {{.State.Health.Status}}", *asked)
        return [line for line in states.splitlines() if not line.endswith(" healthy")]

    def verb(self, *words: str) -> Done:
        """`sidestep` with these words in the container of the ground station."""
        entry = self.inspected("web")["Config"]["Entrypoint"]
        return self.inside("web", *entry, *words)

    def arms(self, *words: str) -> None:
        """Arm the robot, again while it refuses because the machine is busy."""
        until(
            lambda: self.verb("arm", *words).code == 0,
            within_s=HEALTHY_S,
            what="armed",
            poll_s=POLL_S,
        )

    def goes(self, x_m: str, y_m: str) -> Done:
        """Sends the robot there, and again when it stops because the machine is busy."""
        for _ in range(TRIES):
            done = self.verb("goto", x_m, y_m, "--json")
            if done.code == 0 or not any(words in done.said for words in BUSY):
                break
            self.arms()  # a failsafe stays until then
        return done

    @contextmanager
    def running(self, *words: str) -> Iterator[subprocess.Popen[bytes]]:
        """`docker compose` with these words while something else is done; read its `stdout`."""
        with subprocess.Popen(
            self.command(*words),
            cwd=ROOT,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        ) as process:
            try:
                yield process
            finally:
                process.terminate()

    def logs(self, *services: str) -> str:
        return self.tries("logs", "--no-log-prefix", *services).said

    def container(self, service: str, number: int = 1) -> str:
        """Return docker's name of a container of a service."""
        return f"{self.name}-{service}-{number}"

    def network(self, name: str = "bus") -> str:
        return f"{self.name}_{name}"

    def inspected(self, service: str, number: int = 1) -> dict[str, Any]:
        """Return everything that `docker inspect` shows of a container."""
        found: list[dict[str, Any]] = json.loads(docker("inspect", self.container(service, number)))
        return found[0]

    def health(self, service: str, number: int = 1) -> str:
        """`starting`, `healthy` or `unhealthy`; empty when it is not there or is not asked."""
        done = tried(["docker", "inspect", self.container(service, number)], os.environ, WITHIN_S)
        state = json.loads(done.said)[0]["State"] if done.code == 0 else {}
        return str(state.get("Health", {}).get("Status", ""))

    def becomes(
        self, health: str, service: str, number: int = 1, within_s: float = HEALTHY_S
    ) -> None:
        until(
            lambda: self.health(service, number) == health,
            within_s=within_s,
            what=lambda: f"{service} {number} {health}; it is {self.health(service, number)!r}",
            poll_s=POLL_S,
        )

    def inside(self, service: str, *words: str, number: int = 1, user: str = "") -> Done:
        """Run a command in a running container, as its user or as another one."""
        whose = ("--user", user) if user else ()
        exec_ = ["docker", "exec", *whose, self.container(service, number), *words]
        return tried(exec_, os.environ, WITHIN_S)

    def users(self, service: str, number: int = 1) -> dict[str, str]:
        """Return the user of each process, by the first two words of its command line."""
        lines = docker("top", self.container(service, number), "-eo", "pid,uid,args").splitlines()
        rows = [line.split() for line in lines[1:]]
        return {" ".join(row[2:]): row[1] for row in rows}

    @property
    def address(self) -> str:
        """Return the address that the ground station prints for a browser."""
        until(
            lambda: ADDRESS.search(self.logs("web")),
            within_s=HEALTHY_S,
            what="an address in the log",
            poll_s=POLL_S,
        )
        return str(ADDRESS.findall(self.logs("web"))[-1])

    def down(self) -> None:
        """Remove everything, also what docker would keep."""
        self._restore.close()
        self.tries("--profile", "*", "down", "-v", "--remove-orphans", "-t", "0")
        label = f"label={LABEL}.project={self.name}"
        for kind, remove in LEFTOVERS:
            left = docker(*kind, "--quiet", "--filter", label).split()
            if left:
                docker(*remove, *left)


@contextmanager
def project(
    image: str, *profiles: str, settings: Mapping[str, str] | None = None
) -> Iterator[Compose]:
    """Provide a project; take it down at the end, also after a failure."""
    compose = Compose(image, settings or {}, profiles)
    try:
        yield compose
    finally:
        compose.down()
