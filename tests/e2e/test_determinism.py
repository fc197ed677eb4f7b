"""The film is a function of scene, spec and seed: not of workers, and not of what was killed."""

import os
import random
import time
from typing import Any

import pytest
from conftest import MakeFarm

from farm import SCENES, Farm

SCENE = SCENES / "glass-caustic" / "scene.xml"
# Long enough for several kills at random moments on a fast machine.
JOB: dict[str, Any] = {
    "integrator": "pssmlt",
    "width": 64,
    "height": 48,
    "seed": 11,
    "stop": {"mutations_per_pixel": 4096},
}
PATH_JOB: dict[str, Any] = {
    "integrator": "path",
    "width": 64,
    "height": 48,
    "seed": 11,
    "stop": {"samples_per_pixel": 256},
}
# Passes every stage of preparation and fills every layer.
FULL_JOB: dict[str, Any] = {
    **JOB,
    "integrator": "mmlt",
    "delayed_rejection": "on",
    "target": "equalized",
    "direct_apart": "on",
    "kernel_tuning": "on",
    "eye_step_probability": 0.1,
    "stop": {"mutations_per_pixel": 1024},
}
KILLS = ["coordinator", "worker-1", "coordinator", "worker-2", "everything"]


def film_of(farm: Farm, job: dict[str, Any]) -> str:
    snapshot = farm.wait(farm.submit(SCENE, **job), timeout=600)
    assert snapshot["state"] == "done", snapshot
    return str(snapshot["film_sha256"])


@pytest.mark.parametrize("job", [JOB, PATH_JOB, FULL_JOB], ids=["pssmlt", "path", "full"])
def test_same_film_with_1_2_and_7_workers(make_farm: MakeFarm, job: dict[str, Any]) -> None:
    films = {}
    for count in (1, 2, 7):
        farm = make_farm(local_workers=count)
        films[count] = film_of(farm, job)
        farm.close()
    assert len(set(films.values())) == 1, films


def test_same_film_with_other_threads_and_workers_that_connect(make_farm: MakeFarm) -> None:
    alone = make_farm(local_workers=1)
    expected = film_of(alone, JOB)
    alone.close()
    joined = make_farm(local_workers=1, threads=2)
    joined.start_worker("worker-1")
    assert film_of(joined, JOB) == expected


def victims_of(kill: str) -> list[str]:
    return ["coordinator", "worker-1", "worker-2"] if kill == "everything" else [kill]


def kill_and_restart(farm: Farm, kill: str, moments: random.Random) -> None:
    for victim in victims_of(kill):
        process = farm.coordinator if victim == "coordinator" else farm.workers[victim]
        assert process is not None
        process.kill()
    time.sleep(moments.uniform(0.0, 0.5))
    for victim in victims_of(kill):
        if victim == "coordinator":
            farm.start()
        else:
            farm.start_worker(victim)


def test_same_film_after_kills_at_random_moments(make_farm: MakeFarm) -> None:
    """SIGKILL to coordinator and workers, restarted on the same data. METROFARM_KILL_SEED repeats
    the moments of a failed run as far as a clock can repeat anything."""
    calm = make_farm(local_workers=1)
    expected = film_of(calm, JOB)
    calm.close()

    seed = int(os.environ.get("METROFARM_KILL_SEED", random.SystemRandom().randrange(2**32)))
    print(f"METROFARM_KILL_SEED={seed}")
    moments = random.Random(seed)
    farm = make_farm(local_workers=0)
    farm.start_worker("worker-1")
    farm.start_worker("worker-2")
    job_id = farm.submit(SCENE, **JOB)
    for number, kill in enumerate(KILLS):
        time.sleep(moments.uniform(0.1, 1.2))
        state = farm.job(job_id)["state"]
        assert state != "done", f"the job ended before kill {number}: it is too short for this test"
        kill_and_restart(farm, kill, moments)
    snapshot = farm.wait(job_id, timeout=600)
    assert snapshot["state"] == "done", (seed, snapshot)
    assert snapshot["film_sha256"] == expected, f"METROFARM_KILL_SEED={seed}"
