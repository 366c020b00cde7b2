"""The worlds of a study: where they come from, and how `world_source` makes one again."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path
from typing import Final, NamedTuple

import plant.corpus
from plant.corpus import EVERY_FAMILY, FAMILIES, generate
from plant.model.errors import Problem, WorldError
from plant.model.types import World
from plant.shortest_path import known_length_m
from plant.world.file import load, shipped
from plant.world.writer import dumps
from runtime.errors import UserError

CORPUS: Final = "corpus"
FIXED: Final = "fixed"
SHIPPED: Final = "shipped"
KEPT: Final = "worlds"
"""Subdirectory of a study with copies of the world files given on the command line."""

FIXED_DIR: Final = Path(plant.corpus.__file__).parent / FIXED


class ListedWorld(NamedTuple):
    """A world with known family and shortest path; `text` is that of its file, if it had one."""

    source: str
    digest: str
    world: World
    text: str | None = None


class WorldSelection(NamedTuple):
    """The options that select worlds."""

    places: Sequence[str]
    families: Sequence[str] | None
    per_family: int
    corpus_seed: int


def listed(selection: WorldSelection) -> list[ListedWorld]:
    """Return each selected world once.

    Raises UserError for an unknown name, WorldError with all problems of all bad files.
    """
    found: list[ListedWorld] = []
    problems: list[Problem] = []
    for place in selection.places:
        for source, file in _sources(place, selection):
            try:
                found.append(_known(source, file))
            except WorldError as error:
                problems += error.problems
    if problems:
        raise _all_problems(problems)
    return _distinct(_of_families(found, selection.families))


def world_of(source: str, directory: Path) -> World:
    """Make the world of a row again; `directory` is that of the study.

    Raises UserError for an unknown source, WorldError for a file that cannot be used.
    """
    kind, _, rest = source.partition(":")
    match kind, rest.rsplit(":", 2):
        case "shipped", [name]:
            return load(name)
        case "fixed", [name]:
            return load(FIXED_DIR / f"{name}.toml")
        case "kept", _ if rest:
            return load(directory / KEPT / rest)
        case "corpus", [family, seed, index] if family in EVERY_FAMILY:
            return generate(family, int(index), int(seed))
    raise UserError(f"world_source {source!r}: unknown; the study is of another version")


def digest_of(world: World) -> str:
    """Return the SHA-256 of all that a trial depends on in a world, and of its name."""
    bare = replace(world, family=None, family_seed=None, shortest_path_m=None, reachable=None)
    return sha256(dumps(bare).encode()).hexdigest()


def _sources(place: str, selection: WorldSelection) -> Iterator[tuple[str, Path | None]]:
    """Yield the sources that one word of --worlds selects, with the path of given files."""
    path = Path(place)
    if place == CORPUS:
        for family in selection.families or FAMILIES:
            _check(family, EVERY_FAMILY)
            for index in range(selection.per_family):
                yield f"corpus:{family}:{selection.corpus_seed}:{index}", None
    elif place == FIXED:
        yield from ((f"fixed:{file.stem}", None) for file in sorted(FIXED_DIR.glob("*.toml")))
    elif place == SHIPPED:
        yield from ((f"shipped:{name}", None) for name in shipped())
    elif place in shipped():
        yield f"shipped:{place}", None
    elif path.is_dir():
        files = sorted(path.glob("*.toml"))
        if not files:
            raise UserError(f"--worlds {place}: no .toml file in this directory")
        yield from (("", file) for file in files)
    elif path.exists() or place.endswith(".toml"):
        yield "", path
    else:
        names = [CORPUS, FIXED, SHIPPED, *shipped()]
        raise UserError(f"--worlds: {unknown('world or directory', place, names)}")


def _known(source: str, file: Path | None) -> ListedWorld:
    """Load or generate a world and add family and shortest path."""
    world = load(file) if file else world_of(source, Path())
    family = world.family or (file.parent.resolve().name if file else SHIPPED)
    digest = digest_of(world)
    length_m = known_length_m(world)
    world = replace(world, family=family, shortest_path_m=length_m, reachable=length_m is not None)
    if file is None:
        return ListedWorld(source, digest, world)
    return ListedWorld(
        f"kept:{digest[:8]}-{file.name}", digest, world, file.read_text(encoding="utf-8")
    )


def _all_problems(problems: list[Problem]) -> WorldError:
    """Return one error in the order of the files: WorldError itself sorts by line."""
    error = WorldError(problems)
    error.args = ("\n".join(map(str, problems)),)
    return error


def _of_families(found: list[ListedWorld], families: Sequence[str] | None) -> list[ListedWorld]:
    if not families:
        return found
    present = list(dict.fromkeys(str(one.world.family) for one in found))
    for family in families:
        _check(family, present)
    return [one for one in found if one.world.family in families]


def _check(family: str, families: Sequence[str]) -> None:
    if family not in families:
        raise UserError(f"--families: {unknown('family', family, families)}")


def _distinct(found: list[ListedWorld]) -> list[ListedWorld]:
    """Return each world once; raise UserError when two of one name differ."""
    by_name: dict[str, ListedWorld] = {}
    for one in found:
        other = by_name.setdefault(one.world.name, one)
        if other.digest != one.digest:
            raise UserError(
                f"--worlds: {other.source} and {one.source} are both named {one.world.name!r} "
                "and differ; change `name` in one of them"
            )
    return list(by_name.values())


def unknown(kind: str, name: str, names: Iterable[str]) -> str:
    """Return a message for an unknown name of some `kind`, such as "no such navigator"."""
    known = list(names)
    near = get_close_matches(name, known, n=1)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"no such {kind}: {name!r}; {meant}there are {', '.join(known)}"
