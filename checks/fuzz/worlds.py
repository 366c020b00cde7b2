"""Worlds in TOML and JSON, and the maps of ROS, Moving AI and BARN."""

import json
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np

from checks.fuzz.target import FuzzTarget
from checks.fuzz.words import JSON_WORDS, TOML_WORDS, from_file, json_bombs, toml_bombs
from plant.imports.importer import ImportOptions, import_worlds
from plant.world.file import SHIPPED_DIR, loads
from plant.world.file import load as load_world
from plant.world.writer import dumps
from protocol.world import as_json

SMALL_BYTES: Final = 6000
FEW_OBSTACLES: Final = 50
MAP_WORDS: Final = (b"@", b".", b"T", b"\n", b" ", b"\t", b"type octile\n", b"height ", b"map\n")
YAML_WORDS: Final = (b": ", b"- ", b"[", b"]", b"\n", b"image: ", b"'", b'"', b"#", b"---\n")
ROS_YAML: Final = b"""image: map.pgm
resolution: 0.25
origin: [0.0, -1.0, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM: Final = b"P5\n# made\n24 16\n255\n" + (b"\xfe" * 23 + b"\0") * 8 + b"\xfe" * 24 * 8
PGM_AS_TEXT: Final = b"P2 24 16 255\n" + b" ".join([b"254"] * 300 + [b"0"] * 84)
OCTILE: Final = b"type octile\nheight 12\nwidth 16\nmap\n" + b"\n".join([b"." * 11 + b"@@T.."] * 12)
SCENARIO: Final = b"version 1\n0\tworld.map\t16\t12\t1\t1\t9\t8\t11.2\n"
CYLINDERS: Final = b"x_m,y_m,radius\n1.5, 0.3, 0.075\n2.0 1.1\n# no more\n3.1;0.2;0.3\n"


def shipped() -> Sequence[bytes]:
    """Return some shipped worlds."""
    names = ("box", "moving", "u_trap", "paper_fig5", "corner")
    return [(SHIPPED_DIR / f"{name}.toml").read_bytes() for name in names]


def as_texts() -> Sequence[bytes]:
    """Return worlds as JSON."""
    return [
        json.dumps(as_json(load_world(name), None)).encode() for name in ("box", "moving", "door")
    ]


def read_world(path: Path) -> None:
    """Read a world and write it; a small one must read back as the same world."""
    found = load_world(path)
    text = dumps(found)
    if len(found.obstacles) < FEW_OBSTACLES and dumps(loads(text)) != text:
        raise AssertionError("the written world differs from the one that was read")


def import_all(path: Path) -> object:
    """Import the worlds of a file; only a part of a large file."""
    small = path.stat().st_size <= SMALL_BYTES
    return list(import_worlds(path, ImportOptions() if small else ImportOptions(window=20)))


def beside(name: str, data: bytes) -> Callable[[Path], object]:
    """Return an importer of a file that refers to another one, which is good."""

    def read(path: Path) -> object:
        (path.parent / name).write_bytes(data)
        return import_all(path)

    return read


def picture(path: Path) -> object:
    """Import a picture with the settings of a ROS map."""
    settings = path.with_name("map.yaml")
    settings.write_bytes(ROS_YAML)
    return import_all(settings)


def grids() -> Sequence[bytes]:
    """Return good NumPy files."""
    found = []
    for made in (np.eye(12, dtype=np.uint8), np.zeros((8, 9)), np.asfortranarray(np.eye(7) > 0)):
        np.save(out := BytesIO(), made)
        found.append(out.getvalue())
    return found


def map_bombs() -> Sequence[bytes]:
    """Return maps that announce too much, or data that is missing."""
    huge = b"{'descr': '<f8', 'fortran_order': False, 'shape': (900000000, 9)}"
    return [
        b"type octile\nheight 4096\nwidth 4096\nmap\n" + b"." * 4096,
        b"type octile\nheight 900000000\nwidth 900000000\nmap\n",
        b"P5 20000 20000 255\n" + b"\0" * 1000,
        b"P2 20000 20000 65535\n" + b"1 " * 100_000,
        b"\x93NUMPY\x01\0" + len(huge).to_bytes(2, "little") + huge,
        b"\x93NUMPY\x01\0\x10\x27" + b"(" * 10_000,
        b"1 1 1e-9\n" * 50_000,
    ]


WORLDS: Final = (
    FuzzTarget(
        name="world",
        samples=shipped,
        run=from_file("world.toml", read_world),
        words=TOML_WORDS,
        bombs=toml_bombs,
    ),
    FuzzTarget(
        name="world_json",
        samples=as_texts,
        run=from_file("world.json", read_world),
        words=JSON_WORDS,
        bombs=json_bombs,
    ),
    FuzzTarget(
        name="moving_ai",
        samples=lambda: [OCTILE],
        run=from_file("world.map", import_all),
        words=MAP_WORDS,
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="scenarios",
        samples=lambda: [SCENARIO],
        run=from_file("world.scen", beside("world.map", OCTILE)),
        words=MAP_WORDS,
    ),
    FuzzTarget(
        name="ros_map",
        samples=lambda: [ROS_YAML],
        run=from_file("map.yaml", beside("map.pgm", PGM)),
        words=YAML_WORDS,
    ),
    FuzzTarget(
        name="picture",
        samples=lambda: [PGM, PGM_AS_TEXT],
        run=from_file("map.pgm", picture),
        words=(b"P5 ", b"P2 ", b"#", b"\n", b" ", b"65535 "),
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="barn_grid",
        samples=grids,
        run=from_file("grid.npy", import_all),
        words=(b"(", b")", b"'descr'", b"'<f8'", b"'|O'", b"True", b"\x93NUMPY"),
        bombs=map_bombs,
    ),
    FuzzTarget(
        name="barn_list",
        samples=lambda: [CYLINDERS],
        run=from_file("list.csv", import_all),
        bombs=map_bombs,
    ),
)
