"""Build the firmware: `make firmware`."""

import ast
import contextlib
import fcntl
import importlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from firmware import literals, messages, native, toolchain
from firmware.image import (
    IMAGE,
    IMAGES,
    OUTPUT,
    ROOT,
    Image,
    core_hash,
    core_sources,
    core_version,
)
from firmware.linker import NATIVE, Binding, Program
from runtime.errors import UserError

HERE: Final = Path(__file__).resolve().parent


def sources() -> dict[str, str]:
    """Return all sources that may be frozen, by module."""
    paths = dict(core_sources())
    paths |= {path.stem: path for path in (HERE / "onboard").glob("*.py")}
    texts = {name: path.read_text(encoding="utf-8") for name, path in paths.items()}
    return texts | {"wire": messages.python_module()}


def values(sources: Mapping[str, str]) -> dict[Binding, object]:
    """Return the values of all module-level constants, as CPython computes them."""
    found: dict[Binding, object] = {}
    for name, text in sources.items():
        if "." in name or name == "robot":
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


def write(path: Path, text: str) -> None:
    """Write a generated file, unless it has this content already."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def generate(folder: Path) -> None:
    """Write the linked program with its manifest, and the headers of the port."""
    texts = sources()
    frozen = folder / "frozen"
    for name, short in NATIVE.items():
        source = texts.pop(name)
        functions = native.translated(source, importlib.import_module(name))
        write(folder / f"{short}.h", functions + native.bindings(source, short))
    write(frozen / "main.py", Program(texts, values(texts)).linked("main"))
    write(folder / "manifest.py", f"freeze({str(frozen)!r})\n")
    hashed = "".join(f"\\x{byte:02x}" for byte in core_hash())
    header = f'#define CORE_HASH "{hashed}"\n#define CORE_VERSION "{core_version()[:24]}"\n'
    write(folder / "image.h", header)
    write(folder / "messages.h", messages.c_header())


def build(image: Image) -> None:
    """Build one variant."""
    toolchain.check_tools()
    tree = toolchain.source_tree()
    compiler = toolchain.compiler(tree)
    generate(image.folder)
    settings = {
        "TOP": tree,
        "BUILD": image.folder,
        "FROZEN_MANIFEST": image.folder / "manifest.py",
        "MICROPY_MPYCROSS": compiler,
        "HEAP_BYTES": image.heap_bytes,
        "STACK_BYTES": image.stack_bytes,
        "RAM_BYTES": image.ram_bytes,
        "FLOAT_BITS": image.float_bits,
    }
    port = str(HERE / "port")
    make = ["make", "-C", port, *(f"{name}={value}" for name, value in settings.items())]
    frozen = image.folder / "frozen_content.c"
    toolchain.run([*make, str(frozen)])
    wanted = literals.floats_in((image.folder / "frozen" / "main.py").read_text(encoding="utf-8"))
    write(frozen, literals.exact(frozen.read_text(encoding="utf-8"), wanted))
    toolchain.run(make)


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the variants named on the command line; by default the double-precision one."""
    names = list(sys.argv[1:] if arguments is None else arguments) or [IMAGE.name]
    try:
        OUTPUT.mkdir(parents=True, exist_ok=True)
        with (OUTPUT / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            for name in names:
                build(IMAGES[name])
                elf = IMAGES[name].elf.relative_to(ROOT)
                print(f"{elf}: core {core_version()}, {core_hash().hex()[:12]}")
    except KeyError as error:
        print(f"make firmware: no variant {error}; known: {', '.join(IMAGES)}", file=sys.stderr)
        return 2
    except UserError as error:
        print(f"make firmware: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
