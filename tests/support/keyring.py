"""Certificates for tests: good ones of each role, and each kind of bad one."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ground.certificates.authority import Authority
from ground.certificates.folder import CA, SECRET_MODE, dialled_at
from protocol.bus.network import Tls

NOW = datetime.now(UTC)
DAY = timedelta(days=1)


class Keyring:
    """One authority's certificates, made when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)
        self._authority = Authority(NOW - 30 * DAY, NOW + 30 * DAY)
        (folder / CA).write_bytes(self._authority.pem)

    def tls(
        self, name: str, since: datetime = NOW - DAY, until: datetime = NOW + DAY, label: str = ""
    ) -> Tls:
        """Return the certificate of a role; routers and robots are valid for this machine."""
        label = label or name
        dialled = name == "router" or name.startswith("robot-")
        if not (self._folder / f"{label}.pem").exists():
            hosts: Sequence[str] = dialled_at(name) if dialled else ()
            pair = self._authority.certify(name, hosts, (since, until))
            (self._folder / f"{label}.pem").write_bytes(pair.certificate)
            (self._folder / f"{label}.key").touch(SECRET_MODE)
            (self._folder / f"{label}.key").write_bytes(pair.key)
        return Tls(
            ca=str(self._folder / CA),
            certificate=str(self._folder / f"{label}.pem"),
            key=str(self._folder / f"{label}.key"),
        )

    def config(self, name: str, tls: Tls | None = None) -> Path:
        """Write the `--config` file of a role, with its own certificate or with another."""
        tls = tls or self.tls(name)
        path = self._folder / f"{name}.toml"
        path.write_text(
            f'[network.tls]\nca = "{tls.ca}"\n'
            f'certificate = "{tls.certificate}"\nkey = "{tls.key}"\n'
        )
        return path

    def expired(self, name: str) -> Tls:
        return self.tls(name, NOW - 2 * DAY, NOW - DAY, f"{name}-expired")

    def early(self, name: str) -> Tls:
        return self.tls(name, NOW + DAY, NOW + 2 * DAY, f"{name}-early")
