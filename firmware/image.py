"""The image of the firmware: where it is built, and the core that it contains."""

import ast
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
CORE: Final = ROOT / "robot" / "core"
PACKAGES: Final = ("robot", "runtime")
"""The core may import from these."""
OUTPUT: Final = ROOT / "build" / "firmware"


@cache
def core_sources() -> Mapping[str, Path]:
    """Return the modules of the core, and those of other packages that it imports."""
    todo = sorted(CORE.rglob("*.py"))
    found: dict[str, Path] = {}
    while todo:
        path = todo.pop()
        found[module_name(path)] = path
        for name in imported(path.read_text(encoding="utf-8")):
            other = ROOT.joinpath(*name.split(".")).with_suffix(".py")
            if name.partition(".")[0] in PACKAGES and name not in found and other.exists():
                todo.append(other)
    return MappingProxyType(found)


def imported(source: str) -> Iterator[str]:
    """Yield the modules from which a module imports."""
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.ImportFrom) and statement.module:
            yield statement.module


def module_name(path: Path) -> str:
    """Return the dotted name of a module."""
    parts = list(path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def core_hash() -> bytes:
    """Return the SHA-256 over the names and the contents of the sources of the core."""
    digest = sha256()
    for name, path in sorted(core_sources().items()):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
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
    heap_bytes: int = 54 * 1024
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
