"""Operations as the lines that would be typed for them, for the log, the history and a shell."""

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.commands.command import OperatorCommand, number
from ground.console.app_commands import AppCommand, SetTheme, Undo
from ground.missions.files import AddWaypoint, ClearDraft, RemoveWaypoint


def line_of(operation: Operation[Outcome] | AppCommand) -> str:
    """Return the line of an operation that has a key; for any other its verb."""
    match operation:
        case OperatorCommand():
            return operation.line
        case AddWaypoint(waypoint):
            turned = () if waypoint.heading_deg is None else (waypoint.heading_deg,)
            return f"wp add {numbers(waypoint.x_m, waypoint.y_m, *turned)}"
        case ClearDraft():
            return "wp clear"
        case RemoveWaypoint(item):
            return f"wp remove {item}"
        case Undo():
            return "undo"
        case SetTheme(name=str(name)):
            return f"theme {name}"
    return getattr(operation, "verb", "")


def numbers(*values: float) -> str:
    """Format numbers with enough digits to parse them back."""
    return " ".join(map(number, values))
