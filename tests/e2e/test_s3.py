"""Scenes and checkpoints in a bucket of a real S3 server, which is away for a while."""

import os
import signal
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import MakeFarm

from farm import SCENES, Farm, Process, free_port

SCENE = SCENES / "cornell-box" / "scene.xml"
JOB = {
    "width": 48,
    "height": 48,
    "integrator": "pssmlt",
    "stop": {"mutations_per_pixel": 2048},
}
SECRETS = {"AWS_ACCESS_KEY_ID": "access-key", "AWS_SECRET_ACCESS_KEY": "a-secret-of-tests"}


class Bucket:
    """A bucket named farm on a server that can be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("buckets/farm", "metadata", "users"):
            (folder / name).mkdir(parents=True)
        self.url = f"http://127.0.0.1:{free_port()}"
        self.server: Process | None = None

    def start(self) -> None:
        words = ["versitygw", "--port", self.url.removeprefix("http://"), "--region", "us-east-1"]
        words += ["--iam-dir", str(self.folder / "users"), "--health", "/health", "--quiet"]
        words += ["posix", "--sidecar", str(self.folder / "metadata"), str(self.folder / "buckets")]
        self.server = Process(words, self.folder / "s3.log")
        deadline = time.monotonic() + 60
        while not self._answers():
            assert time.monotonic() < deadline, (self.folder / "s3.log").read_text()
            time.sleep(0.05)

    def _answers(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.url}/health", timeout=5) as answer:
                return answer.status == 200
        except (urllib.error.URLError, OSError):
            return False

    def kill(self) -> None:
        if self.server is not None and self.server.alive:
            self.server.kill()

    def names(self) -> list[str]:
        """Of all blobs."""
        farm = self.folder / "buckets" / "farm"
        return [str(file.relative_to(farm)) for file in farm.rglob("*") if file.is_file()]


@pytest.fixture
def bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("ROOT_ACCESS_KEY", SECRETS["AWS_ACCESS_KEY_ID"])
    monkeypatch.setenv("ROOT_SECRET_KEY", SECRETS["AWS_SECRET_ACCESS_KEY"])
    bucket = Bucket(tmp_path / "s3")
    bucket.start()
    yield bucket
    bucket.kill()


def wait_for_line(farm: Farm, job: str, words: str) -> None:
    """Until the job's log has the words."""
    deadline = time.monotonic() + 60
    while words not in (log := farm.get(f"/v1/jobs/{job}/log").body.decode()):
        assert time.monotonic() < deadline, log
        time.sleep(0.05)


def test_a_job_goes_on_from_a_bucket(make_farm: MakeFarm, bucket: Bucket) -> None:
    alone = make_farm(local_workers=1)
    expected = alone.wait(alone.submit(SCENE, **JOB))["film_sha256"]
    alone.close()

    options = ("--blobs", "s3://farm/one", "--s3-endpoint", bucket.url, "--s3-region", "us-east-1")
    farm = make_farm(local_workers=1, options=options)
    job = farm.submit(SCENE, **JOB)
    farm.wait_for_rounds(job, 1)
    bucket.kill()
    farm.wait_for_rounds(job, farm.job(job)["rounds_done"] + 1)  # nothing waits for checkpoints
    bucket.start()
    assert farm.coordinator is not None
    farm.coordinator.end(signal.SIGTERM, timeout=60)  # it writes a checkpoint
    assert any("checkpoint" in name for name in bucket.names()), bucket.names()
    farm.start()
    wait_for_line(farm, job, "goes on with the job")
    assert farm.job(job)["rounds_done"] >= 2, "it began again"
    snapshot = farm.wait(job)
    assert snapshot["state"] == "done", snapshot
    assert snapshot["film_sha256"] == expected
    image = farm.get(f"/v1/jobs/{job}/image.exr")
    assert expected.encode() in image.body
    assert not list((farm.folder / "data").rglob("checkpoint*")), "kept beside the bucket"
    assert os.environ["AWS_SECRET_ACCESS_KEY"] not in farm.coordinator.log.read_text()
