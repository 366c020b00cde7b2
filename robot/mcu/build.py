"""Build the firmware: `make firmware`."""

import ast
import contextlib
import importlib
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robot.mcu import messages
from robot.mcu.image import CORE, OUTPUT, ROOT, core_hash, core_version
from robot.mcu.freeze import Binding, Program

HERE: Final = Path(__file__).resolve().parent


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


def module_name(path: Path, root: Path) -> str:
    """Return the dotted name of a module."""
    parts = list(path.relative_to(root).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def sources() -> dict[str, str]:
    """Return all sources that may be frozen, by module."""
    paths = {module_name(path, ROOT): path for path in CORE.rglob("*.py")}
    paths["robot"] = ROOT / "robot" / "__init__.py"
    paths |= {path.stem: path for path in (HERE / "onboard").glob("*.py")}
    texts = {name: path.read_text(encoding="utf-8") for name, path in paths.items()}
    return texts | {"wire": messages.python_module()}


def values(sources: Mapping[str, str]) -> dict[Binding, object]:
    """Return the values of all module-level constants, as CPython computes them."""
    found: dict[Binding, object] = {}
    for name, text in sources.items():
        if name.startswith("robot"):
            names = vars(importlib.import_module(name))
        else:
            names = dict(constants_of(text))
        found |= {Binding(name, key): value for key, value in names.items()}
    return found


def constants_of(source: str) -> Iterator[tuple[str, object]]:
    """Yield the constants of a module that are literals."""
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            with contextlib.suppress(ValueError, TypeError):
                yield statement.target.id, ast.literal_eval(statement.value or statement)


def freeze(folder: Path) -> None:
    """Write the linked program and its manifest."""
    texts = sources()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    program = Program(texts, values(texts)).linked("main")
    (folder / "main.py").write_text(program, encoding="utf-8")
    (folder.parent / "manifest.py").write_text(f"freeze({str(folder)!r})\n", encoding="utf-8")


def write_headers(folder: Path) -> None:
    """Write the headers generated for the port."""
    folder.mkdir(parents=True, exist_ok=True)
    hashed = "".join(f"\\x{byte:02x}" for byte in core_hash())
    image = f'#define CORE_HASH "{hashed}"\n#define CORE_VERSION "{core_version()[:24]}"\n'
    (folder / "messages.h").write_text(messages.c_header(), encoding="utf-8")
    (folder / "image.h").write_text(image, encoding="utf-8")


def build(image: Image, top: Path) -> None:
    """Build one variant."""
    write_headers(image.folder)
    freeze(image.folder / "frozen")
    command = [
        "make",
        "-C",
        str(HERE / "port"),
        f"-j{os.cpu_count() or 1}",
        f"TOP={top}",
        f"BUILD={image.folder}",
        f"FROZEN_MANIFEST={image.folder / 'manifest.py'}",
        f"MICROPY_MPYCROSS={top}/mpy-cross/build/mpy-cross",
        f"HEAP_BYTES={image.heap_bytes}",
        f"STACK_BYTES={image.stack_bytes}",
        f"RAM_BYTES={image.ram_bytes}",
        f"FLOAT_BITS={image.float_bits}",
    ]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    build(Image(), OUTPUT / "micropython-1.25.0")
