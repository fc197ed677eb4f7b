"""The REST interface as a user meets it: upload, submit, watch, fetch, stop."""

import json
import struct
import urllib.request
from typing import Any

from farm import SCENES, Farm, zip_folder

CORNELL = SCENES / "cornell-box" / "scene.xml"
SMALL: dict[str, Any] = {"integrator": "pssmlt", "width": 32, "height": 32, "seed": 7}
ENDLESS: dict[str, Any] = {**SMALL, "stop": {"mutations_per_pixel": 1_000_000}}


def short_job(mutations_per_pixel: int = 64) -> dict[str, Any]:
    return {**SMALL, "stop": {"mutations_per_pixel": mutations_per_pixel}}


def test_job_from_upload_to_image(farm: Farm) -> None:
    job_id = farm.submit(CORNELL, **short_job())
    snapshot = farm.wait(job_id)
    assert snapshot["state"] == "done", snapshot
    assert snapshot["progress"] == 1
    assert snapshot["integrator"] == "pssmlt"
    assert snapshot["mutations"] >= 64 * 32 * 32
    assert snapshot["b"] > 0
    assert snapshot["anomalies"] in ({}, None)

    exr = farm.get(f"/v1/jobs/{job_id}/image.exr")
    assert (exr.status, exr.media_type) == (200, "image/x-exr")
    assert exr.body[:4] == struct.pack("<I", 20000630)
    assert snapshot["film_sha256"].encode() in exr.body, "the film's hash is an EXR attribute"

    png = farm.get(f"/v1/jobs/{job_id}/image.png")
    assert (png.status, png.media_type) == (200, "image/png")
    assert png.body[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", png.body[16:24]) == (32, 32)

    points = farm.get(f"/v1/jobs/{job_id}/convergence").json()["points"]
    assert len(points) == snapshot["rounds_done"]
    assert [point["mutations"] for point in points] == sorted(p["mutations"] for p in points)
    assert points[-1]["film_sha256"] == snapshot["film_sha256"]
    assert points[-1]["rel_mse"] > 0

    assert farm.get(f"/v1/jobs/{job_id}/plan").json()["choices"]
    assert farm.get(f"/v1/jobs/{job_id}/anomalies").json()["total"] == 0
    assert farm.get(f"/v1/jobs/{job_id}/log").media_type == "text/plain"


def test_scenes_are_named_by_their_content(farm: Farm) -> None:
    bundle = zip_folder(CORNELL.parent)
    first, again = farm.upload(bundle), farm.upload(bundle)
    assert first.status == 201
    assert again.json()["digest"] == first.json()["digest"]
    listed = farm.get(f"/v1/scenes/{first.json()['digest']}").json()
    assert [file["path"] for file in listed["files"]] == ["scene.xml"]
    assert listed["entries"] == ["scene.xml"]


def test_events_tell_the_story_in_order_and_go_on_after_an_id(farm: Farm) -> None:
    job_id = farm.submit(CORNELL, **short_job())
    seen: list[tuple[int, str]] = []
    states: list[str] = []
    for number, kind, data in farm.events(job_id):
        seen.append((number, kind))
        if kind == "state":
            states.append(data["job"]["state"])
        if states and states[-1] == "done":
            break
    numbers = [number for number, _ in seen]
    assert numbers == sorted(set(numbers))
    assert states[-1] == "done"
    order = ["queued", "inspecting", "bootstrapping", "rendering", "done"]
    assert [state for state in order if state in states] == list(dict.fromkeys(states))
    rounds = [number for number, kind in seen if kind == "round"]
    assert len(rounds) == farm.job(job_id)["rounds_done"]

    # Progress and image events are for live readers; all others can be read again.
    kept = [number for number, kind in seen if kind not in ("progress", "image")]
    later = kept[len(kept) // 2 :]
    again = farm.events(job_id, after=later[0] - 1)
    assert [next(again)[0] for _ in later] == later


def test_idempotency_key_submits_once(farm: Farm) -> None:
    digest = farm.upload(zip_folder(CORNELL.parent)).json()["digest"]
    document = {"scene": digest, "entry": "scene.xml", **short_job()}

    def submit(changed: dict[str, Any]) -> Any:
        request = urllib.request.Request(
            farm.url + "/v1/jobs",
            json.dumps({**document, **changed}).encode(),
            {"Content-Type": "application/json", "Idempotency-Key": "the-same"},
            method="POST",
        )
        with urllib.request.urlopen(request, timeout=30) as reply:
            return json.load(reply)

    assert submit({})["id"] == submit({})["id"]
    assert len(farm.get("/v1/jobs").json()["jobs"]) == 1


def test_finish_ends_on_a_round_that_can_be_repeated(farm: Farm) -> None:
    job_id = farm.submit(CORNELL, **ENDLESS)
    farm.wait_for_rounds(job_id, 2)
    assert farm.post(f"/v1/jobs/{job_id}/finish").status == 200
    finished = farm.wait(job_id)
    assert finished["state"] == "done"

    again = farm.submit(CORNELL, **{**ENDLESS, "stop": {"rounds": finished["rounds_done"]}})
    repeated = farm.wait(again)
    assert repeated["rounds_done"] == finished["rounds_done"]
    assert repeated["film_sha256"] == finished["film_sha256"]


def test_cancel_keeps_the_image_so_far(farm: Farm) -> None:
    job_id = farm.submit(CORNELL, **ENDLESS)
    farm.wait_for_rounds(job_id, 1)
    assert farm.post(f"/v1/jobs/{job_id}/cancel").status == 200
    assert farm.wait(job_id)["state"] == "canceled"
    assert farm.get(f"/v1/jobs/{job_id}/image.png").status == 200
    assert farm.request("DELETE", f"/v1/jobs/{job_id}").status == 204
    assert farm.get(f"/v1/jobs/{job_id}").status == 404


def test_pause_stops_and_resume_goes_on(farm: Farm) -> None:
    job_id = farm.submit(CORNELL, **ENDLESS)
    farm.wait_for_rounds(job_id, 1)
    assert farm.post(f"/v1/jobs/{job_id}/pause").json()["paused"]
    assert farm.post(f"/v1/jobs/{job_id}/resume").json()["paused"] is False
    farm.wait_for_rounds(job_id, farm.job(job_id)["rounds_done"] + 1)


def test_service_describes_itself(farm: Farm) -> None:
    assert farm.get("/healthz").status == 200
    assert farm.get("/openapi.json").json()["openapi"].startswith("3.1")
    assert b"metrofarm_" in farm.get("/metrics").body
    farm.wait(farm.submit(CORNELL, **short_job()))  # by then the worker has said who it is
    workers = farm.get("/v1/workers").json()["workers"]
    assert [worker["name"] for worker in workers] == ["local-1"]
    page = farm.get("/")
    assert (page.status, page.media_type) == (200, "text/html")
