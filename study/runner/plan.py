"""Plan the trials of a study: its worlds, and tasks whose order stays balanced.

Each task has an identity, and `world_source` makes its world again.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from hashlib import sha256
from math import ceil
from pathlib import Path
from typing import Any, Final, NamedTuple

import plant.corpus
from plant.corpus import EVERY_FAMILY, FAMILIES, generate
from plant.model.configuration import LEVELS, body_of
from plant.model.errors import WorldError, WorldProblem
from plant.shortest_path import known_length_m
from plant.world.file import load, shipped
from plant.world.writer import dumps
from protocol.navigators import NAVIGATORS, is_own, name_of, own_source
from protocol.world import World
from robot.own_navigator import digest_of as digest_of_navigator
from runtime.errors import UserError
from study.trial.trial import ALL_NAVIGATORS, SIDES

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
    problems: list[WorldProblem] = []
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
    elif place and path.is_dir():
        files = sorted(path.glob("*.toml"))
        if not files:
            raise UserError(f"--worlds {place}: no .toml file in this directory")
        yield from (("", file) for file in files)
    elif (place and path.exists()) or place.endswith(".toml"):
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


def _all_problems(problems: list[WorldProblem]) -> WorldError:
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


SEED_STRIDE: Final = 1000
MIN_TIMEOUT_S: Final = 120.0
START_UP_S: Final = 30.0
DETOUR_FACTOR: Final = 40.0
UNREACHABLE_TIMEOUT_S: Final = 1200.0
ROUND_S: Final = 10.0
BOTH_SIDES: Final = "bug"
"""The paper's bug passes obstacles on a given side, so it runs once per side."""
EVERY_NAVIGATOR: Final = tuple(
    f"{name}:{side}" for name in NAVIGATORS for side in (SIDES if name == BOTH_SIDES else ("left",))
)


class OwnFile(NamedTuple):
    """A navigator of the user's own in a study: its reference, and the SHA-256 of its file."""

    reference: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySettings:
    """Settings that apply to every world of a study.

    `navigators` are NAME:SIDE, with a reference instead of a name for one of the user's own;
    `timeout_s` None depends on the world.
    """

    navigators: Sequence[str] = EVERY_NAVIGATOR
    noise: Sequence[str] = tuple(LEVELS)
    seeds: int = 1
    timeout_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True

    def own(self) -> dict[str, OwnFile]:
        """Return the user's own navigators by name; UserError if two have one name."""
        found: dict[str, OwnFile] = {}
        for reference, _ in map(split_side, self.navigators):
            if is_own(reference):
                name, file = name_of(reference), OwnFile(reference, digest_of_navigator(reference))
                other = found.setdefault(name, file)
                if other.reference != reference:
                    raise UserError(
                        f"{other.reference} and {reference} are both named {name}; give one of"
                        " them another name"
                    )
        return found


def split_side(navigator: str) -> tuple[str, str]:
    """Split NAME:SIDE or NAME, where a reference to an own navigator may have a colon, too."""
    name, _, side = navigator.rpartition(":")
    return (name, side) if name and side in SIDES else (navigator, "")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialTask:
    """A trial to run; `place` is the index of its world in the study's list."""

    trial_id: str
    place: int
    world_source: str
    world_digest: str
    navigator: str
    side: str
    seed: int
    noise: str
    timeout_s: float
    parameters: str
    calibrated: bool


def tasks_of(
    worlds: Sequence[ListedWorld], settings: StudySettings, version: str
) -> list[TrialTask]:
    """Return all trials of a study, seed by seed.

    For one seed the order is independent of world, navigator and noise, so that an interrupted
    study has covered every part equally.
    """
    own = settings.own()
    tasks = [
        task for place, one in enumerate(worlds) for task in _of(place, one, settings, own, version)
    ]
    return sorted(tasks, key=lambda task: (task.seed % SEED_STRIDE, task.trial_id))


def _of(
    place: int,
    one: ListedWorld,
    settings: StudySettings,
    own: Mapping[str, OwnFile],
    version: str,
) -> Iterator[TrialTask]:
    """Yield all trials in one world; without noise a seed changes nothing, so there is one."""
    timeout_s = settings.timeout_s or time_for(one.world)
    for navigator in settings.navigators:
        reference, side = split_side(navigator)
        name = name_of(reference)
        of_file = {"file": own[name].digest} if name in own else {}
        for noise in settings.noise:
            for number in range(1 if noise == "none" else settings.seeds):
                identity: dict[str, Any] = {
                    "world_digest": one.digest,
                    "navigator": name,
                    "side": side,
                    "seed": seed_of(one.digest, number),
                    "noise": noise,
                    "timeout_s": timeout_s,
                    "parameters": json.dumps(dict(sorted(settings.parameters.items()))),
                    "calibrated": settings.calibrated,
                }
                trial_id = id_of({**identity, **of_file}, version)
                yield TrialTask(trial_id=trial_id, place=place, world_source=one.source, **identity)


def seed_of(world_digest: str, number: int) -> int:
    """Return a seed of this world alone.

    The random wheel errors depend on the seed only: with the same seeds in all worlds a study would
    measure the same errors repeatedly. Navigators and noise levels share seeds, to be compared in
    pairs.
    """
    return int(world_digest[:5], 16) * SEED_STRIDE + number


def id_of(identity: Mapping[str, Any], version: str) -> str:
    """Return a hash that is equal for equal trials, independent of machine and time."""
    text = json.dumps({**identity, "version": version}, sort_keys=True)
    return sha256(text.encode()).hexdigest()[:32]


def time_for(world: World) -> float:
    """Return the time limit in s, rounded up to 10 s.

    It is enough for a path of `DETOUR_FACTOR` times the shortest at the robot's full speed.
    """
    if world.shortest_path_m is None:
        return UNREACHABLE_TIMEOUT_S
    needed_s = START_UP_S + DETOUR_FACTOR * world.shortest_path_m / body_of(world).max_speed_m_s
    return max(MIN_TIMEOUT_S, ceil(needed_s / ROUND_S) * ROUND_S)


def navigator_of(text: str) -> str:
    """Return NAME or NAME:SIDE as NAME:SIDE; raise UserError for an unknown one.

    A reference to a navigator of the user's own is made valid in any folder.
    """
    name, side = split_side(text)
    if is_own(name) and name.partition(":")[0] not in ALL_NAVIGATORS:
        return f"{own_source(name)}:{side or 'left'}"
    name, _, side = text.partition(":")
    if name not in ALL_NAVIGATORS:
        raise UserError(f"--navigators: {unknown('navigator', name, ALL_NAVIGATORS)}")
    if side and side not in SIDES:
        raise UserError(f"--navigators {text}: {unknown('side', side, SIDES)}")
    return f"{name}:{side or 'left'}"


def noise_of(text: str) -> str:
    """Return the noise level; raise UserError for an unknown one."""
    if text not in LEVELS:
        raise UserError(f"--noise: {unknown('noise level', text, LEVELS)}")
    return text
