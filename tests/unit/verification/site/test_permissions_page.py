"""The table of who can do what says what the rules do, and no more."""

from checks.site import protocol_page
from checks.site.protocol_page import COLUMNS, rows
from tests.support.each import each

OPERATORS = {"`ground`", "`ground-NAME`"}
COMMANDERS = OPERATORS | {"`gateway`"}
ROUTER = {"`router`"}
OWN_ROBOT = {"`robot-NAME, of NAME`"}


def able(says: str) -> set[str]:
    """What the table calls the certificates that can do this; on an open bus everybody can."""
    (row,) = [row for row in rows() if row[0].startswith(says)]
    assert row[1] == "yes"
    cells = zip(protocol_page.head()[2:], row[2:], strict=True)
    return {name for name, cell in cells if cell == "yes"}


@each(
    ("says", "who"),
    [
        ("stop the robot and receive", COMMANDERS | ROUTER),
        ("take or seize", COMMANDERS | ROUTER),
        ("command as another operator", ROUTER),
        ("fetch missed commands", OPERATORS | ROUTER | OWN_ROBOT | {"`recorder`"}),
        ("fetch missed texts", COMMANDERS | ROUTER | OWN_ROBOT | {"`recorder`", "`viewer`"}),
        ("receive ground truth", OPERATORS | ROUTER | {"`recorder`", "`viewer`", "`plant`"}),
        ("pause or score", OPERATORS | ROUTER),
        ("publish sensor data of the robot", ROUTER | {"`plant`"}),
        ("command the wheels", ROUTER | OWN_ROBOT),
        ("be accepted by a robot", ROUTER),
        ("be accepted by the plant", ROUTER | OWN_ROBOT),
    ],
)
def test_a_cell_says_yes_only_to_whom_the_rules_let(says: str, who: set[str]) -> None:
    assert able(says) == who


def test_certificate_without_a_role_has_no_permission() -> None:
    assert COLUMNS[-1][0] == "stranger"
    assert {row[-1] for row in rows()} == {"no"}
