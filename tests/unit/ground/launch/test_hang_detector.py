"""Who is silent hangs, but never for the silence of the hub that it is heard through."""

from ground.launch.hang_detector import ROUTER, SILENT_NS, STARTING_NS, HangDetector

ROBOT, PLANT = "robot r1", "plant"
MS = 1_000_000
SECOND = 1000 * MS


class Link:
    """Whether there is one."""

    def __init__(self) -> None:
        self.there = True

    def __call__(self) -> bool:
        return self.there


class Watched(HangDetector):
    """Looked at all the time."""

    def until(self, now_ns: int, *beating: str) -> list[str]:
        """Who was found to hang until then, while these were heard."""
        found = []
        for at_ns in (*range(self._looked_ns, now_ns, 100 * MS), now_ns):
            for role in beating:
                self.heard(role, at_ns)
            found += self.silent(at_ns)
        return found


def hearts_of(hub: str, link: Link | None = None) -> Watched:
    """Everybody was heard at one second."""
    hearts = Watched(hub, [ROBOT, PLANT], link or Link(), SECOND - 200 * MS)
    for role in (ROBOT, PLANT):
        hearts.heard(role, SECOND)
    return hearts


QUIET_NS = SECOND + SILENT_NS


def test_who_is_heard_does_not_hang() -> None:
    hearts = hearts_of(ROBOT)
    assert hearts.until(QUIET_NS) == []
    assert hearts.until(60 * SECOND, ROBOT, PLANT) == []


def test_a_silent_plant_hangs_and_is_named_once() -> None:
    assert hearts_of(ROBOT).until(60 * SECOND, ROBOT) == [PLANT]


def test_when_all_are_silent_it_is_the_hub() -> None:
    assert hearts_of(ROBOT).until(QUIET_NS + 1) == [ROBOT]


def test_a_router_hangs_when_there_is_no_link_to_it() -> None:
    link = Link()
    link.there = False
    hearts = hearts_of(ROUTER, link)
    assert hearts.until(QUIET_NS) == []
    assert hearts.until(QUIET_NS + 1) == [ROUTER]


def test_with_a_router_that_answers_everybody_speaks_for_himself() -> None:
    assert hearts_of(ROUTER).until(QUIET_NS + 1, PLANT) == [ROBOT]


def test_while_the_hub_is_gone_nobody_is_judged_and_after_it_they_may_dial_again() -> None:
    hearts = hearts_of(ROBOT)
    hearts.gone(ROBOT)
    assert hearts.until(60 * SECOND) == []
    hearts.started(ROBOT, 60 * SECOND)
    assert hearts.until(60 * SECOND + STARTING_NS) == []
    assert hearts.until(60 * SECOND + STARTING_NS + 1, ROBOT) == [PLANT]


def test_who_was_started_has_time_until_it_is_first_heard_and_no_more() -> None:
    hearts = hearts_of(ROBOT)
    hearts.gone(PLANT)
    hearts.started(PLANT, 2 * SECOND)
    assert hearts.until(2 * SECOND + STARTING_NS, ROBOT) == []
    assert hearts.until(2 * SECOND + STARTING_NS + 1, ROBOT) == [PLANT]


def test_who_did_not_look_has_not_listened_and_begins_to_wait_only_then() -> None:
    hearts = hearts_of(ROBOT)
    assert hearts.silent(30 * SECOND) == []
    assert hearts.until(30 * SECOND + SILENT_NS) == []
    assert hearts.until(30 * SECOND + SILENT_NS + 1) == [ROBOT]


def test_what_was_still_on_its_way_from_the_one_before_is_no_sign_of_life() -> None:
    hearts = hearts_of(ROBOT)
    hearts.gone(ROBOT)
    hearts.heard(ROBOT, 2 * SECOND)
    assert hearts.back_ns(ROBOT) is None
    hearts.started(ROBOT, 2 * SECOND)
    hearts.heard(ROBOT, 2 * SECOND + MS)
    assert hearts.back_ns(ROBOT) is None
    hearts.heard(ROBOT, 3 * SECOND)
    assert hearts.back_ns(ROBOT) == 3 * SECOND
