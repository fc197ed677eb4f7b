"""The compose cluster renders what one machine renders, also when it loses containers."""

import json
import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest

from containers import ROOT, Cluster, docker

SCENE = ROOT / "tests" / "scenes" / "cornell-box" / "scene.xml"
# Enough rounds that workers and coordinators can be lost in the middle of them.
REQUEST: dict[str, Any] = {
    "integrator": "pssmlt",
    "width": 96,
    "height": 96,
    "seed": 7,
    "stop": {"mutations_per_pixel": 512},
}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The film's hash of the same job on one machine."""
    folder = tmp_path_factory.mktemp("alone")
    subprocess.run(
        [
            ROOT / "bin" / "metrofarm",
            *("render", SCENE, "-o", folder / "image.exr", "--stats", folder / "stats.json"),
            *("--integrator", "pssmlt", "--width", "96", "--height", "96", "--seed", "7"),
            *("--mutations-per-pixel", "512"),
        ],
        check=True,
    )
    return json.loads((folder / "stats.json").read_text())["film_sha256"]


def until(condition: Callable[[], bool], seconds: float, what: str) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"{what}: not within {seconds} s"
        time.sleep(1)


def test_loses_a_worker_and_renders_the_same(cluster: Cluster, alone: str) -> None:
    workers = cluster.containers("worker")
    assert len(workers) == 3
    job = cluster.submit(SCENE, **REQUEST)
    cluster.wait(job, rounds=1)
    docker("kill", "--signal", "KILL", workers[0])
    ended = cluster.wait(job)
    assert ended["state"] == "done", ended
    assert ended["film_sha256"] == alone


def test_loses_the_coordinator_that_owns_the_job(cluster: Cluster, alone: str) -> None:
    job = cluster.submit(SCENE, **REQUEST)
    cluster.wait(job, rounds=1)
    docker("kill", "--signal", "KILL", cluster.containers("coordinator-1")[0])
    time.sleep(5)
    docker("restart", cluster.containers("coordinator-2")[0])
    ended = cluster.wait(job)
    assert ended["state"] == "done", ended
    assert ended["film_sha256"] == alone


def test_containers_are_confined(cluster: Cluster) -> None:
    for service in ("coordinator-1", "coordinator-2", "worker", "redis", "proxy", "prometheus"):
        for container in cluster.containers(service):
            state = json.loads(docker("inspect", container))[0]
            assert state["HostConfig"]["ReadonlyRootfs"], service
            assert state["HostConfig"]["CapDrop"] == ["ALL"], service
            assert "no-new-privileges:true" in state["HostConfig"]["SecurityOpt"], service
            identity = docker("exec", container, "id", "-u").strip()
            assert identity == "10001", f"{service} runs as {identity}"
            written = subprocess.run(["docker", "exec", container, "touch", "/usr/x"], check=False)
            assert written.returncode != 0, f"{service} writes to its root"


def test_prometheus_sees_every_container(cluster: Cluster) -> None:
    def scraped() -> bool:
        counts = {
            result["metric"]["job"]: int(result["value"][1])
            for result in cluster.prometheus('sum by (job) (up{job=~"metrofarm-.*"})')
        }
        return counts == {"metrofarm-coordinator": 2, "metrofarm-worker": 3}

    until(scraped, 60, "all coordinators and workers scraped")


def test_script_renders_by_curl(cluster: Cluster, alone: str) -> None:
    members = json.dumps(REQUEST)[1:-1]
    told = cluster.script("demo", CLUSTER_SCENE=str(SCENE), CLUSTER_REQUEST=members)
    assert alone in told
    assert (cluster.folder / "cornell-box.exr").stat().st_size > 1000
    assert (cluster.folder / "cornell-box.png").read_bytes().startswith(b"\x89PNG")
