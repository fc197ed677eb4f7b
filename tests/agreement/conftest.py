"""The long form, a cache of replicas that several tests look at, and a table of figures."""

from collections.abc import Callable

import numpy as np
import pytest

from figures import HEADINGS, ROWS
from replicas import Settings, render_all


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="all scenes, many samples: hours")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = []


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if config.stash[ROWS]:
        terminalreporter.section("figures")
        terminalreporter.write_line(HEADINGS)
        terminalreporter.write_line("\n".join(config.stash[ROWS]))


@pytest.fixture(scope="session")
def replicas_of() -> Callable[[Settings], list[np.ndarray]]:
    cache: dict[Settings, list[np.ndarray]] = {}

    def find(settings: Settings) -> list[np.ndarray]:
        if settings not in cache:
            cache[settings] = render_all(settings)
        return cache[settings]

    return find
