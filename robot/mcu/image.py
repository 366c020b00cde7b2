"""The image of the firmware: where it is built, and the core that it contains."""

import tomllib
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
CORE: Final = ROOT / "robot" / "core"
OUTPUT: Final = ROOT / "build" / "firmware"
IMAGE: Final = OUTPUT / "lpc1768" / "firmware.elf"


@cache
def core_hash(folder: Path = CORE) -> bytes:
    """Return the SHA-256 over the names and the contents of the sources of the core."""
    digest = sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(path.read_bytes() + b"\0")
    return digest.digest()


@cache
def core_version() -> str:
    """Return the version of the project."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        return str(tomllib.load(file)["project"]["version"])
