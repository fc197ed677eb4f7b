"""The compose cluster, really started; skipped with a word where no container engine can run."""

import os
import subprocess
from collections.abc import Iterator

import pytest

from containers import PREPARE, Cluster


@pytest.fixture(scope="session")
def engine() -> Iterator[None]:
    answer = subprocess.run([PREPARE, "engine"], stdout=subprocess.PIPE, text=True, check=True)
    verdict = answer.stdout.strip().splitlines()[-1]
    if verdict != "ready":
        pytest.skip(verdict)
    yield
    subprocess.run([PREPARE, "stop"], check=True)


@pytest.fixture(scope="session")
def images(engine: None) -> None:
    subprocess.run([PREPARE, "images"], check=True)


@pytest.fixture(scope="session")
def started(images: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("cluster"), workers=3)
    try:
        yield cluster
    finally:
        if os.environ.get("METROFARM_KEEP_CLUSTER") is None:
            cluster.destroy()


@pytest.fixture
def cluster(started: Cluster) -> Cluster:
    """One cluster for all tests; what an earlier one killed is started again."""
    started.up()
    return started
