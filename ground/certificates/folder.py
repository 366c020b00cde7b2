"""The folder of `keys new`: per role a certificate, its key and a configuration that names them."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Final

from ground.certificates.authority import Authority, Pair, hosts_in
from ground.client.connection import Config
from protocol.bus.network import Network
from protocol.bus.tls.access import OPERATOR, RECORDER, VIEWER
from runtime.atomic_file import replace
from runtime.config import load_shared
from runtime.errors import UserError

CA: Final = "ca.pem"
CA_KEY: Final = "authority.key"
"""The key of the authority can certify every role. Do not copy it to a machine of the stack."""

THIS_MACHINE: Final = ("localhost", "127.0.0.1", "::1")
REVOKED: Final = re.compile(r"^revoked = \[.*\]$", re.MULTILINE)
FOLDER_MODE: Final = 0o700
SECRET_MODE: Final = 0o600
PUBLIC_MODE: Final = 0o644
CONFIG: Final = """\
# Made by `sidestep keys new`: who a process is, and whom it believes. Use it with --config.
robot = "{robot}"

[network]
robots = [{robots}]
operators = [{operators}]
revoked = []

[network.tls]
ca = "{ca}"
certificate = "{role}.pem"
key = "{role}.key"
"""


def make(
    folder: Path,
    robots: Sequence[str],
    hosts: Mapping[str, Sequence[str]],
    since: datetime,
    until: datetime,
    operators: Sequence[str] = (),
    authority_until: datetime | None = None,
) -> list[str]:
    """The roles that have a certificate now. Overwrites nothing: UserError names what is there.

    `hosts` are more names and addresses of those that are dialled, by role. `authority_until`: the
    authority is valid that long, and its key is kept for `renew`.
    """
    prepare(folder)
    authority = Authority(since, authority_until or until)
    written: list[Path] = []
    try:
        put(folder / CA, authority.pem, PUBLIC_MODE, written)
        if authority_until is not None:
            put(folder / CA_KEY, authority.pair.key, SECRET_MODE, written)
        for role, robot, dialled in cast(robots, operators):
            names = (*dialled_at(role), *hosts.get(role, ())) if dialled else ()
            pair = authority.certify(role, names, (since, until))
            put(folder / f"{role}.pem", pair.certificate, PUBLIC_MODE, written)
            put(folder / f"{role}.key", pair.key, SECRET_MODE, written)
            text = configuration(role, robot, robots, operators)
            put(folder / f"{role}.toml", text.encode(), PUBLIC_MODE, written)
    except OSError as error:
        for path in written:  # half a set is of no use, and would be in the way of the next
            path.unlink(missing_ok=True)
        raise UserError(f"{folder}: {error.strerror}: nothing was kept") from error
    return [role for role, _, _ in cast(robots, operators)]


def dialled_at(role: str) -> tuple[str, ...]:
    """Return where a role is dialled: on this machine, or at a host of its own name."""
    return (*THIS_MACHINE, role)


def cast(robots: Sequence[str], operators: Sequence[str]) -> Iterator[tuple[str, str, bool]]:
    """Role, robots it is about as a configuration names them, and whether others dial it."""
    yield "router", robots[0], True
    yield "plant", ",".join(robots), False
    yield "ground", robots[0], False
    for operator in operators:
        yield f"{OPERATOR}{operator}", robots[0], False
    yield VIEWER, robots[0], False
    yield RECORDER, robots[0], False
    for robot in robots:
        yield f"robot-{robot}", robot, True


def configuration(role: str, robot: str, robots: Sequence[str], operators: Sequence[str]) -> str:
    """TOML; the names of its files are relative, so that the folder can be moved."""
    return CONFIG.format(
        role=role, robot=robot, robots=listed(robots), operators=listed(operators), ca=CA
    )


def renew(folder: Path, names: Sequence[str], since: datetime, until: datetime) -> datetime:
    """Give some roles a new certificate and key, with the names that they had; until when.

    It ends with the authority at the latest. UserError when that was not kept, or is of no use.
    """
    try:
        pair = Pair((folder / CA).read_bytes(), (folder / CA_KEY).read_bytes())
        authority = Authority.kept(pair)
    except OSError as error:
        raise UserError(
            f"{folder / CA_KEY}: {error.strerror}: only a set of `keys new --keep-authority` can "
            "be renewed; make a new one"
        ) from error
    except (ValueError, TypeError) as error:
        raise UserError(f"{folder / CA_KEY}: {error}") from error
    until = min(until, authority.until)
    before = {name: dialled_names(folder, name) for name in names}
    for name, hosts in before.items():
        made = authority.certify(name, hosts, (since, until))
        fresh(folder / f"{name}.key", made.key, SECRET_MODE)
        fresh(folder / f"{name}.pem", made.certificate, PUBLIC_MODE)
    return until


def dialled_names(folder: Path, name: str) -> list[str]:
    """Where the holder of a certificate is dialled; nowhere if it only dials."""
    path = folder / f"{name}.pem"
    if not path.is_file() or name == CA.removesuffix(".pem"):
        raise UserError(f"{folder} has no certificate {name}.pem: name one that it has")
    return hosts_in(path.read_bytes())


def fresh(path: Path, content: bytes, mode: int) -> None:
    """Replace a file atomically; the permissions are never wider than `mode`."""
    draft = path.with_name(f".{path.name}.part")
    draft.unlink(missing_ok=True)
    put(draft, content, mode, [])
    draft.replace(path)


def revoke(folder: Path, names: Sequence[str]) -> list[str]:
    """Add names to those revoked in every configuration of a folder; all that are now.

    UserError names a certificate that there is not, or a file that cannot be changed.
    """
    for name in names:
        if not (folder / f"{name}.pem").is_file():
            raise UserError(f"{folder} has no certificate {name}.pem: name one that it has")
    found: list[str] = []
    for path in sorted(folder.glob("*.toml")):
        before = load_shared(path, Config).network or Network()
        found = list(dict.fromkeys((*before.revoked, *names)))
        text, count = REVOKED.subn(f"revoked = [{listed(found)}]", path.read_text())
        if count != 1:
            raise UserError(f"{path}: there is no line `revoked = []` to change: make a new set")
        try:
            replace(path, text)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
    return found


def listed(names: Sequence[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def prepare(folder: Path) -> None:
    """An empty folder that only its owner can look into."""
    try:
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        there = next(iter(sorted(folder.iterdir())), None)
        if there is None:
            folder.chmod(FOLDER_MODE)
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}: name a folder to be made") from error
    if there is not None:
        raise UserError(
            f"{folder} is not empty (there is {there.name}), and nothing is overwritten: "
            "name a new folder, or move the old one away"
        )


def put(path: Path, content: bytes, mode: int, written: list[Path]) -> None:
    """A new file, never readable by more than `mode` says, not even for a moment."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    written.append(path)
    with open(number, "wb") as file:
        file.write(content)
