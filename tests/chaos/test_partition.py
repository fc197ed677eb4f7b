"""A worker that is cut off while it renders: others render what it had leased, and what it delivers
when it is back changes nothing."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import MakeStage

from namespaces import Namespace, refusal
from orders import SCENE, request_of, result_of, undisturbed
from records import HARMLESS, Record, read_journal
from stage import Coordinator, Proxy, Stage, wait_until

REQUEST = request_of("pssmlt", stop={"mutations_per_pixel": 1536})


@pytest.fixture
def namespace() -> Iterator[Namespace]:
    if why := refusal():
        pytest.skip(why)
    with Namespace("metrofarm", 17) as made:
        yield made


def expired(stage: Stage) -> float:
    return sum(c.counter("metrofarm_leases_expired_total") for c in stage.coordinators)


def holds(rest: Coordinator, name: str) -> bool:
    workers = rest.get("/v1/workers").json()["workers"]
    return any(w["name"] == name and w["leased_segments"] > 0 for w in workers)


def delivered_by(stage: Stage, worker: str, after: float) -> list[Record]:
    records = read_journal(stage.journal)
    return [r for r in records if r.call == "deliver" and r.worker == worker and r.sent > after]


def test_a_worker_is_cut_off(make_stage: MakeStage, namespace: Namespace, tmp_path: Path) -> None:
    [expected] = undisturbed(tmp_path / "undisturbed", [REQUEST])
    stage = make_stage(
        proxy=Proxy(1, rate=0),
        proxy_host=namespace.host,
        worker_prefix={"worker-3": namespace.prefix},
    )
    stage.start()
    rest = stage.coordinators[0]
    job = rest.submit(SCENE, **REQUEST)
    rest.wait_for_rounds(job, 1)
    wait_until(lambda: holds(rest, "worker-3"), 60, "worker-3 has work")
    namespace.pull()
    cut = time.time()
    wait_until(lambda: expired(stage) > 0, 30, "its leases run out")
    rest.wait_for_rounds(job, rest.job(job)["rounds_done"] + 1)  # others have rendered its part
    # So that the job lasts until the worker is back.
    assert rest.post(f"/v1/jobs/{job}/pause").json()["paused"]
    time.sleep(max(0.0, cut + 22 - time.time()))
    plugged = time.time()
    namespace.plug()
    check_late_deliveries(stage, plugged)
    rest.post(f"/v1/jobs/{job}/resume")
    snapshot = rest.wait(job, timeout=240)
    assert result_of(snapshot) == expected
    assert stage.died() == []


def check_late_deliveries(stage: Stage, plugged: float) -> None:
    """What the worker had when it was cut off comes late, and is not counted."""
    by_name = {
        w["name"]: w["id"] for w in stage.coordinators[0].get("/v1/workers").json()["workers"]
    }
    lost = by_name["worker-3"]
    wait_until(lambda: delivered_by(stage, lost, plugged) != [], 60, "the worker delivers again")
    late = delivered_by(stage, lost, plugged)[0]
    assert late.outcome in HARMLESS, late
