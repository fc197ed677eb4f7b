"""Sequences of frames: by command line and REST, through the death of the coordinator."""

import json
import time
from pathlib import Path
from typing import Any

import pytest

from farm import SCENES, Farm, run, zip_folder

CORNELL = SCENES / "cornell-box" / "scene.xml"
SMALL: dict[str, Any] = {
    "integrator": "path",
    "width": 24,
    "height": 24,
    "seed": 7,
    "stop": {"samples_per_pixel": 8},
}


def submit(farm: Farm, frames: dict[str, Any], key: str = "", **job: Any) -> dict[str, Any]:
    digest = farm.upload(zip_folder(CORNELL.parent)).json()["digest"]
    document = {"job": {"scene": digest, "entry": "scene.xml", **SMALL, **job}, "frames": frames}
    answer = farm.post("/v1/sequences", document, key)
    assert answer.status == 201, answer.body
    return dict(answer.json())


def wait(farm: Farm, sequence: dict[str, Any], timeout: float = 240) -> dict[str, Any]:
    """The sequence once all of its frames have ended."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        now = dict(farm.get(f"/v1/sequences/{sequence['id']}").json())
        if now["state"] in ("done", "failed", "canceled"):
            return now
        time.sleep(0.1)
    raise TimeoutError(str(now))


def films(sequence: dict[str, Any]) -> list[str]:
    assert sequence["state"] == "done", sequence
    hashes = [frame["film_sha256"] for frame in sequence["frames"]]
    assert all(hashes)
    return hashes


def test_seeds_are_shared_or_per_frame(farm: Farm) -> None:
    shared = wait(farm, submit(farm, {"start": 1, "end": 3}))
    assert shared["states"] == {"done": 3}
    assert len(set(films(shared))) == 1, "a still scene with one seed is one image"
    for frame in shared["frames"]:
        exr, png = (farm.get(frame["links"][kind]) for kind in ("exr", "png"))
        assert (exr.status, png.status) == (200, 200)
        assert frame["film_sha256"].encode() in exr.body

    apart = wait(farm, submit(farm, {"start": 1, "end": 3, "seeds": "per-frame"}))
    assert len(set(films(apart))) == 3
    assert [frame["seed"] for frame in apart["frames"]] == [8, 9, 10]

    # Frame 2 is what a job with its seed and shutter is.
    frame = apart["frames"][1]
    assert (frame["shutter_open"], frame["shutter_close"]) == pytest.approx((1.75 / 24, 2.25 / 24))
    alone = {name: frame[name] for name in ("seed", "shutter_open", "shutter_close")}
    single = farm.wait(farm.submit(CORNELL, **{**SMALL, **alone}))
    assert single["film_sha256"] == frame["film_sha256"]
    time_feature = next(
        feature
        for feature in farm.get(f"/v1/jobs/{single['id']}/plan").json()["features"]
        if feature["name"] == "time"
    )
    assert time_feature["state"] == "skipped"


def test_workers_load_the_scene_once(make_farm: Any) -> None:
    farm = make_farm(local_workers=0)
    farm.start_worker("only")
    done = wait(farm, submit(farm, {"start": 1, "end": 4}))
    # What a worker measured on loading the scene: another load would have taken another time.
    seconds = [farm.job(frame["job"])["load_seconds"] for frame in done["frames"]]
    assert seconds[0] > 0
    assert len(set(seconds)) == 1, seconds


def test_a_killed_coordinator_loses_and_doubles_no_frame(make_farm: Any) -> None:
    farm = make_farm(local_workers=0)
    frames = {"start": 1, "end": 12, "seeds": "per-frame"}
    first = submit(farm, frames, "the-same")
    assert farm.coordinator is not None
    farm.coordinator.kill()
    farm.start()
    again = submit(farm, frames, "the-same")
    assert again["id"] == first["id"]
    assert len(farm.get("/v1/jobs?limit=200").json()["jobs"]) == 12
    farm.start_worker("late")
    done = wait(farm, again)
    assert len(set(films(done))) == 12
    listed = farm.get("/v1/sequences").json()["sequences"]
    assert [sequence["id"] for sequence in listed] == [first["id"]]


def test_cancel_and_delete_the_whole(farm: Farm) -> None:
    endless = {"integrator": "pssmlt", "stop": {"mutations_per_pixel": 1_000_000}}
    sequence = submit(farm, {"start": 1, "end": 3}, **endless)
    path = f"/v1/sequences/{sequence['id']}"
    farm.wait_for_rounds(sequence["frames"][0]["job"], 1)
    assert farm.request("DELETE", path).status == 409
    paused = farm.post(path + "/pause").json()
    assert all(frame["paused"] for frame in paused["frames"])
    assert not any(frame["paused"] for frame in farm.post(path + "/resume").json()["frames"])
    assert farm.post(path + "/cancel").json()["states"] == {"canceled": 3}
    assert farm.get(sequence["frames"][0]["links"]["png"]).status == 200
    assert farm.request("DELETE", path).status == 204
    assert farm.get(path).status == 404
    assert farm.get("/v1/jobs").json()["jobs"] == []


def test_frames_of_the_command_line(tmp_path: Path) -> None:
    small = ["--integrator", "path", "--width", "24", "--height", "24", "--spp", "8"]
    frames = ["--frames", "9-11", "--fps", "10", "--frame-seeds", "per-frame"]
    out, stats = tmp_path / "out.####.exr", tmp_path / "####.json"
    done = run("render", CORNELL, *small, *frames, "-o", out, "--stats", stats)
    assert done.returncode == 0, done.stderr
    images = {path.name for path in tmp_path.glob("*.exr")}
    assert images == {"out.0009.exr", "out.0010.exr", "out.0011.exr"}
    documents = [json.loads(path.read_text()) for path in sorted(tmp_path.glob("*.json"))]
    assert [document["seed"] for document in documents] == [9, 10, 11]
    assert len({document["film_sha256"] for document in documents}) == 3
    resolved = documents[1]["resolved_spec"]
    assert (resolved["shutterOpen"], resolved["shutterClose"]) == pytest.approx((0.975, 1.025))


def test_a_wrong_range_is_refused(farm: Farm, tmp_path: Path) -> None:
    refused = run("render", CORNELL, "--frames", "3-1", "-o", tmp_path / "#.exr")
    assert refused.returncode == 2
    assert refused.stderr.startswith("metrofarm: --frames: end is 1")
    answer = farm.post(
        "/v1/sequences",
        {"job": {"scene": "0" * 64, "entry": "scene.xml"}, "frames": {"start": 1, "end": 2}},
    )
    assert answer.status == 422
    assert answer.json()["errors"][0]["location"] == "body.job.scene"
