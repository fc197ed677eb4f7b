"""Deliveries and reports that are repeated, late, out of order, cut short or corrupted, where
nobody dies: each answer is the one that the protocol names, and the films are as undisturbed.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from conftest import MakeStage

from orders import SCENE, Customer, request_of, result_of, undisturbed
from records import HARMLESS, REFUSED, Record, read_journal
from stage import Proxy, Stage, wait_until

FLIPS = ("flip segment", "flip state", "flip sums", "flip report")
DAMAGES = ("truncate", "flip packed", "flip digest", "flip value", *FLIPS)
FAULTS = ("repeat", "repeat later", "delay", "reorder", "stale", "break off", *DAMAGES)


def await_workers(stage: Stage) -> None:
    """Until every worker is known to every coordinator."""

    def registered() -> bool:
        return all(
            worker.logged("registered with a coordinator") >= len(stage.coordinators)
            for worker in stage.workers
        )

    wait_until(registered, 60, "all workers are registered")


def wait_for_all(customer: Customer, timeout: float = 240) -> None:
    wait_until(lambda: customer.look() == 0, timeout, "all jobs have ended")


def of(records: list[Record], true: Callable[[Record], bool]) -> set[str]:
    return {record.outcome for record in records if true(record)}


def test_every_fault_of_deliveries_has_its_answer(
    make_stage: MakeStage, references: dict[str, dict[str, Any]], seed: int
) -> None:
    stage = make_stage(proxy=Proxy(seed, rate=0.5))
    stage.start()
    await_workers(stage)
    customer = Customer(list(stage.coordinators), f"deliveries-{seed}")
    deadline = time.monotonic() + 240
    while not set(FAULTS) <= {r.fault for r in read_journal(stage.journal)}:
        assert time.monotonic() < deadline, f"faults that never came, --seed {seed}"
        for kind in ("bdpt", "pssmlt"):
            customer.order(kind)
        wait_for_all(customer)
    for order in customer.orders:
        assert result_of(order.snapshot) == references[order.kind], order
    records = read_journal(stage.journal)
    check_answers(records)
    # Copies that come seconds later may be under way still.
    assert sum(r.step == "damaged" and r.outcome == "conflict" for r in records) > 0
    assert stage.died() == []


def check_answers(records: list[Record]) -> None:
    for record in records:
        allowed = {
            "copy": ("superseded",) if record.call == "report" else HARMLESS,
            "damaged": ("superseded", *REFUSED),  # superseded: its job had ended
            "broken off": ("",),
            # Nobody may have rendered it instead within the time that the proxy waits.
            "stale": ("superseded",) if record.call == "report" else (*HARMLESS, "committed"),
            "intact": (*HARMLESS, "committed"),
        }[record.step]
        assert record.outcome in allowed, record
    assert of(records, lambda r: r.fault in ("flip digest", "flip value")) <= {
        "conflict",
        "superseded",
    }
    assert of(records, lambda r: r.fault == "truncate") <= {"rejected", "superseded"}
    # What is no film has a checksum, which is looked at first where the job is still there.
    for record in records:
        if record.fault in FLIPS and record.message != "no such job":
            assert record.outcome in REFUSED, record
    refused = {r.fault for r in records if r.outcome in REFUSED}
    assert set(FLIPS) <= refused, f"never refused: {set(FLIPS) - refused}"


def mix(x: int) -> int:
    """One step of SplitMix64."""
    mask = 2**64 - 1
    x = (x + 0x9E3779B97F4A7C15) & mask
    x = ((x ^ x >> 30) * 0xBF58476D1CE4E5B9) & mask
    x = ((x ^ x >> 27) * 0x94D049BB133111EB) & mask
    return x ^ x >> 31


def seed_that_checks(number: int, segment: int) -> int:
    """The first job seed with which this segment is rendered twice on purpose: package check."""
    return next(s for s in range(1, 10**6) if mix(mix(mix(s) + number) + segment) % 1000 == 0)


def test_a_worker_that_renders_wrong_is_excluded(make_stage: MakeStage, tmp_path: Path) -> None:
    """Its digests fit its film, so that only the segment that is rendered twice tells."""
    request = request_of("pssmlt", seed=seed_that_checks(1, 5))
    [expected] = undisturbed(tmp_path / "undisturbed", [request])
    stage = make_stage(proxy=Proxy(1, rate=0, forge="1/5"))
    stage.start()
    await_workers(stage)
    rest = stage.coordinators[0]
    job = rest.submit(SCENE, **request)
    assert result_of(rest.wait(job, timeout=240)) == expected
    [forged] = [r for r in read_journal(stage.journal) if r.step == "forged"]
    # Held until another worker confirms it, which none does.
    assert forged.outcome == "committed" and "another worker" in forged.message, forged
    assert sum(c.counter("metrofarm_workers_excluded_total") for c in stage.coordinators) == 1
    assert f"({forged.worker}) is excluded" in rest.get(f"/v1/jobs/{job}/log").body.decode()
    # It is asked to leave, and does.
    wait_until(lambda: sum(not w.alive for w in stage.workers) == 1, 30, "one worker is gone")
