"""Forests of three densities: trunks scattered over the floor with a passage between any two."""

from functools import partial
from typing import Final

from plant.corpus.draft import Draft, Family, on_floor, spot, stage
from plant.model.draws import Draws
from plant.model.geometry import distance_m
from plant.model.types import Circle, Point

MIN_THICKNESS_M: Final = 0.05
MAX_THICKNESS_M: Final = 0.15
MIN_PASSAGE_M: Final = 0.34
MAX_PASSAGE_M: Final = 0.42
CLEARING_M: Final = 0.30
MAX_THROWS: Final = 20_000


def forest(random: Draws, sparsest_m2: float, densest_m2: float) -> Draft | None:
    """Draw a number of trunks per square metre, each a passage away from others and the rim."""
    place = stage(random, apart_m=4.0)
    passage_m = random.uniform(MIN_PASSAGE_M, MAX_PASSAGE_M)
    wide_m, high_m = place.size_m
    count = round(random.uniform(sparsest_m2, densest_m2) * wide_m * high_m)
    trunks: list[Circle] = []
    for _ in range(MAX_THROWS):
        x_m, y_m = spot(random, place.size_m)
        radius_m = round(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M), 3)
        trunk = Circle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if _fits(trunk, trunks, passage_m, place.size_m, (place.start, place.goal)):
            trunks.append(trunk)
        if len(trunks) == count:
            return place.draft(*trunks)
    return None


sparse: Final[Family] = partial(forest, sparsest_m2=0.25, densest_m2=0.45)
medium: Final[Family] = partial(forest, sparsest_m2=0.6, densest_m2=0.85)
dense: Final[Family] = partial(forest, sparsest_m2=1.1, densest_m2=1.3)


def _fits(
    trunk: Circle, trunks: list[Circle], passage_m: float, size_m: Point, clear: tuple[Point, ...]
) -> bool:
    here, around_m = (trunk.x_m, trunk.y_m), trunk.radius_m + passage_m
    return (
        on_floor(here, size_m, around_m)
        and all(distance_m(here, point) >= trunk.radius_m + CLEARING_M for point in clear)
        and all(
            distance_m(here, (one.x_m, one.y_m)) >= around_m + one.radius_m
            for one in reversed(trunks)
        )
    )
