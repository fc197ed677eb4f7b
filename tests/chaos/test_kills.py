"""Whatever dies, whatever happens to deliveries: nothing that was accepted is lost, nothing is
counted twice, and each film is that of an undisturbed farm.

    pytest tests/chaos/test_kills.py --kills 50 --seed N --record FILE

repeats a run as far as clocks can repeat anything.
"""

import random
import time
from collections import Counter
from typing import Any

import pytest
from conftest import MakeStage

from killer import Killer, plan
from orders import KINDS, Customer, result_of
from records import counted_again, read_journal, tally, wrongly_taken
from run_record import Run, write
from stage import Proxy, Stage

UNDER_WAY = 3  # jobs at a time
# Longer than everything that the farm waits for: leases, ownership, deliveries held back.
PATIENCE = 300.0


def test_same_films_whatever_dies(
    make_stage: MakeStage,
    references: dict[str, dict[str, Any]],
    seed: int,
    request: pytest.FixtureRequest,
) -> None:
    option = request.config.getoption
    stage = make_stage(proxy=Proxy(seed, rate=0.4))
    stage.start()
    mortals = [name for name in stage.parts if name != "proxy"]
    killer = Killer(stage, plan(seed, option("--kills"), mortals, option("--pause")))
    customer = Customer(list(stage.coordinators), f"chaos-{seed}")
    started = time.time()
    try:
        keep_ordering(customer, killer, random.Random(seed))
    finally:
        killer.stop()
        run = Run(seed, started, time.time(), killer.kills, customer.orders, stage)
        write(run, references, option("--record"))
    assert killer.problems == [], "processes ended that nobody killed"
    assert stage.died() == []
    check_orders(customer, references)
    check_journal(stage, killer)


def keep_ordering(customer: Customer, killer: Killer, choice: random.Random) -> None:
    """Some jobs are always under way until the last kill; then the last ones end."""
    kinds = list(KINDS)
    customer.order(choice.choice(kinds))
    killer.start()
    waiting = 1
    while not killer.done:
        if waiting < UNDER_WAY:
            customer.order(kinds[len(customer.orders) % len(kinds)])
        time.sleep(0.2)
        waiting = customer.look()
    assert waiting > 0, "the last kill disturbed no job"
    deadline = time.monotonic() + PATIENCE
    while customer.look() > 0:
        unfinished = [order for order in customer.orders if not order.done]
        assert time.monotonic() < deadline, f"not done in {PATIENCE} s: {unfinished}"
        time.sleep(0.2)


def check_orders(customer: Customer, references: dict[str, dict[str, Any]]) -> None:
    for order in customer.orders:
        assert result_of(order.snapshot) == references[order.kind], order
    accepted = [order.job for order in customer.orders]
    assert max(Counter(accepted).values()) == 1
    # Neither lost nor made twice by a repeated submission.
    assert sorted(customer.jobs()) == sorted(accepted)


def check_journal(stage: Stage, killer: Killer) -> None:
    records = read_journal(stage.journal)
    upheavals = [k.when for k in killer.kills if not k.victim.startswith("worker")]
    assert wrongly_taken(records) == []
    assert counted_again(records, upheavals) == []
    for what, times in tally(records).items():
        print(*what, times, sep=" | ")
