"""The image of the firmware: where it is built, and the core that it contains."""

import tomllib
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
CORE: Final = ROOT / "robot" / "core"
OUTPUT: Final = ROOT / "build" / "firmware"


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """One variant of the firmware; sizes in bytes."""

    name: str = "lpc1768"
    float_bits: int = 64
    ram_bytes: int = 64 * 1024
    heap_bytes: int = 48 * 1024
    stack_bytes: int = 6 * 1024

    @property
    def folder(self) -> Path:
        """Folder of the results."""
        return OUTPUT / self.name

    @property
    def elf(self) -> Path:
        """The image itself."""
        return self.folder / "firmware.elf"


IMAGE: Final = Image()
IMAGES: Final = {one.name: one for one in (IMAGE, Image(name="lpc1768-float32", float_bits=32))}
