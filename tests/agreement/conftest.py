"""The long form and a cache of replicas, which several tests look at."""

from collections.abc import Callable

import numpy as np
import pytest

from replicas import Settings, render_all


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="all scenes, many samples: hours")


@pytest.fixture(scope="session")
def replicas_of() -> Callable[[Settings], list[np.ndarray]]:
    cache: dict[Settings, list[np.ndarray]] = {}

    def find(settings: Settings) -> list[np.ndarray]:
        if settings not in cache:
            cache[settings] = render_all(settings)
        return cache[settings]

    return find
