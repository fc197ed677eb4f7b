"""A refined job has, bit by bit, the image of one that asked for it at once."""

import json
from typing import Any

import pytest
from conftest import MakeFarm

from farm import SCENES, Farm, run

SCENE = SCENES / "glass-caustic" / "scene.xml"
SMALL: dict[str, Any] = {"width": 64, "height": 48, "seed": 11}
CHAINS = {**SMALL, "integrator": "pssmlt"}
FULL = {
    **SMALL,
    "integrator": "mmlt",
    "delayed_rejection": "on",
    "target": "equalized",
    "direct_apart": "on",
}
PATHS = {**SMALL, "integrator": "path"}
# Every first stop cuts a round short, and so do those in the middle, some the same round again.
STEPS: dict[str, tuple[dict[str, Any], list[dict[str, int]]]] = {
    "pssmlt": (CHAINS, [{"mutations_per_pixel": n} for n in (50, 131, 140, 150, 700)]),
    "full": (FULL, [{"mutations_per_pixel": n} for n in (50, 131, 140, 150, 700)]),
    "path": (PATHS, [{"samples_per_pixel": n} for n in (3, 7, 20, 25, 30, 60)]),
}


def done(farm: Farm, job_id: str) -> dict[str, Any]:
    snapshot = farm.wait(job_id, timeout=600)
    assert snapshot["state"] == "done", snapshot
    return snapshot


@pytest.mark.parametrize("name", list(STEPS))
def test_same_image_as_a_fresh_job(make_farm: MakeFarm, name: str) -> None:
    farm = make_farm(local_workers=2)
    job, stops = STEPS[name]
    refined = farm.submit(SCENE, **job, stop=stops[0])
    done(farm, refined)
    for stop in stops[1:]:
        answer = farm.post(f"/v1/jobs/{refined}/refine", stop)
        assert answer.status == 200, answer.body
        assert answer.json()["state"] == "rendering"
        fresh = done(farm, farm.submit(SCENE, **job, stop=stop))
        again = done(farm, refined)
        for key in ("film_sha256", "mutations", "rounds_done", "b", "rel_mse", "rays"):
            assert again[key] == fresh[key], key
        assert json.loads(again["resolved"]) == json.loads(fresh["resolved"])


def test_refusals_name_the_field_and_the_log_tells(make_farm: MakeFarm) -> None:
    farm = make_farm(local_workers=1)
    job_id = farm.submit(SCENE, **PATHS, stop={"samples_per_pixel": 10})
    done(farm, job_id)
    refused = farm.post(f"/v1/jobs/{job_id}/refine", {"samples_per_pixel": 10})
    assert refused.status == 422, refused.body
    assert refused.json()["errors"][0]["location"] == "body.samples_per_pixel"
    text = run(
        "refine",
        job_id,
        "--spp",
        "30",
        "--wait",
        "--server",
        farm.url,
        "-o",
        farm.folder / "out.exr",
    )
    assert text.returncode == 0, text.stderr
    assert (farm.folder / "out.exr").stat().st_size > 0
    log = farm.get(f"/v1/jobs/{job_id}/log?format=json")
    assert log.media_type == "application/x-ndjson"
    records = [json.loads(line) for line in log.body.splitlines()]
    said = [record["body"] for record in records]
    for what in (
        "worker joins",
        "planned",
        "checkpoint",
        "refined: goes on to samples_per_pixel 30",
    ):
        assert what in said, said
    last = records[-2]["sequence"]
    later = farm.get(f"/v1/jobs/{job_id}/log?after={last}").body.decode().splitlines()
    assert len(later) == 1, later
