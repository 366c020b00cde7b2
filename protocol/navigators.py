"""The navigators by name, and references to a navigator of the user's own.

Every list of navigators is made from the enumeration of the dialect. A reference is a file or a
module with the name of its function, which is `step` unless it is given: `my_nav.py`,
`my_nav.py:turn`, `package.module:step`.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.wire.enums import Navigator
from runtime.errors import UserError

NAVIGATORS: Final[Mapping[str, Navigator]] = MappingProxyType(
    {one.name.lower(): one for one in Navigator if one is not Navigator.OWN}
)
"""Those of the robot."""
USUAL_NAVIGATOR: Final = Navigator.VGM_MEMORY.name.lower()
"""The robot's default."""
STEP: Final = "step"
DEFINED: Final = "python"
"""The place of functions that a program has given itself, as in a notebook."""

SUFFIX: Final = ".py"
OWN_HELP: Final = "a navigator, or a file of your own such as my_nav.py"


class OwnSource(NamedTuple):
    """Where a navigator of the user's own is: in a file, or in a module; and its function."""

    place: str
    function: str = STEP

    @property
    def is_file(self) -> bool:
        """True for the path of a file."""
        return self.place.endswith(SUFFIX)

    @property
    def name(self) -> str:
        """The name in tables: that of the file or module, or that of another function."""
        if self.function != STEP or self.place == DEFINED:
            return self.function
        return Path(self.place).stem if self.is_file else self.place.rpartition(".")[2]

    def __str__(self) -> str:
        return self.place if self.function == STEP else f"{self.place}:{self.function}"


def is_own(reference: str) -> bool:
    """Return whether this is a reference, and not the name of a navigator of the robot."""
    return "." in reference or ":" in reference[1:]


def named_by(reference: str) -> OwnSource:
    """Return what a reference names, whether it is there or not."""
    place, colon, function = reference.rpartition(":")
    return OwnSource(place, function) if colon else OwnSource(reference)


def own_source(reference: str) -> OwnSource:
    """Return what a reference names; the path of a file becomes absolute.

    Raises UserError for a file that is not there, and for a name that a navigator has already.
    """
    found = named_by(reference)
    if found.place in NAVIGATORS:
        raise UserError(
            f"{reference}: {found.place} is a navigator of the robot: give its name alone, and its"
            " side with --side"
        )
    if found.is_file:
        path = Path(found.place).expanduser()
        if not path.is_file():
            raise UserError(
                f"{found.place}: there is no such file; `sidestep navigators new"
                f" {path.stem or 'my_nav'}` writes one to begin with"
            )
        found = found._replace(place=str(path.resolve()))
    if found.name in NAVIGATORS:
        raise UserError(
            f"{reference}: {found.name} is the name of a navigator of the robot; give yours another"
        )
    return found


def name_of(reference: str) -> str:
    """Return the name of a navigator for tables and texts."""
    return named_by(reference).name


class NavigatorChoices(tuple[str, ...]):
    """Names for an option, which takes references to own navigators, too."""

    __slots__ = ()

    def __contains__(self, text: object) -> bool:
        return super().__contains__(text) or (isinstance(text, str) and is_own(text))


CHOICES: Final = NavigatorChoices(NAVIGATORS)
