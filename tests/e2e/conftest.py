"""Farms for tests; each is gone when its test ends, however it ends."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from farm import Farm

MakeFarm = Callable[..., Farm]


@pytest.fixture
def make_farm(tmp_path: Path) -> Iterator[MakeFarm]:
    farms: list[Farm] = []

    def make(**options: Any) -> Farm:
        folder = tmp_path / f"farm-{len(farms)}"
        folder.mkdir()
        farms.append(Farm(folder, **options))
        farms[-1].start()
        return farms[-1]

    yield make
    for farm in farms:
        farm.close()


@pytest.fixture
def farm(make_farm: MakeFarm) -> Farm:
    """A coordinator with one local worker."""
    return make_farm(local_workers=1)
