"""Options and fixtures of the chaos tests; every process is gone when its test ends."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from orders import KINDS, request_of, undisturbed
from stage import Stage, build_proxy

MakeStage = Callable[..., Stage]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=8, help="how many processes are killed")
    parser.addoption("--seed", type=int, help="of kills and faults; default: another each time")
    parser.addoption("--pause", type=float, default=4.0, help="mean seconds between two kills")
    parser.addoption("--record", type=Path, help="where the run's figures go, without ending")


@pytest.fixture(scope="session")
def seed(request: pytest.FixtureRequest) -> int:
    given = request.config.getoption("--seed")
    seed = random.SystemRandom().randrange(2**32) if given is None else int(given)
    print(f"--seed {seed}")
    return seed


@pytest.fixture(scope="session")
def references(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What an undisturbed farm makes of each kind of job."""
    folder = tmp_path_factory.mktemp("undisturbed") / "farm"
    results = undisturbed(folder, [request_of(kind) for kind in KINDS])
    return dict(zip(KINDS, results, strict=True))


@pytest.fixture(scope="session")
def _proxy() -> None:
    build_proxy()


@pytest.fixture
def make_stage(tmp_path: Path, _proxy: None) -> Iterator[MakeStage]:
    stages: list[Stage] = []

    def make(**options: Any) -> Stage:
        folder = tmp_path / f"stage-{len(stages)}"
        folder.mkdir()
        stages.append(Stage(folder, **options))
        return stages[-1]

    yield make
    for stage in stages:
        stage.close()
