"""A bit that flips in the film of a running worker: the digests of its segments tell."""

import random
import time
from pathlib import Path

from conftest import MakeStage

from film_memory import film_bytes, flip_a_bit
from orders import SCENE, request_of, result_of, undisturbed
from stage import Coordinator, Part, Stage, go_on, stop

REQUEST = request_of("path", width=480, height=360, stop={"samples_per_pixel": 32})
FLIPS = 3


def conflicts(rest: Coordinator) -> int:
    return sum(w.get("conflicts", 0) for w in rest.get("/v1/workers").json()["workers"])


def flip(worker: Part, size: int, choice: random.Random) -> str:
    stop(worker)
    try:
        return flip_a_bit(worker.pid, size, choice)
    finally:
        go_on(worker)


def flip_until_told(stage: Stage, job: str, choice: random.Random) -> list[str]:
    """Flips bits while the job runs. A flip after a tile was packed changes nothing."""
    rest = stage.coordinators[0]
    size = film_bytes(REQUEST["width"], REQUEST["height"], layers=1)
    flipped: list[str] = []
    while conflicts(rest) < FLIPS and rest.job(job)["state"] != "done":
        if what := flip(choice.choice(stage.workers), size, choice):
            flipped.append(what)
        time.sleep(0.4)
    return flipped


def test_a_bit_flips_in_a_workers_film(make_stage: MakeStage, tmp_path: Path, seed: int) -> None:
    [expected] = undisturbed(tmp_path / "undisturbed", [REQUEST])
    stage = make_stage()
    stage.start()
    rest = stage.coordinators[0]
    job = rest.submit(SCENE, **REQUEST)
    flipped = flip_until_told(stage, job, random.Random(seed))
    assert result_of(rest.wait(job, timeout=240)) == expected
    told = sum(worker.logged("digests disagree") for worker in stage.workers)
    assert 0 < told <= len(flipped), (told, flipped)
    assert conflicts(rest) == told
    for counter in ("metrofarm_conflicts_total", "metrofarm_quarantines_total"):
        assert sum(c.counter(counter) for c in stage.coordinators) == told
