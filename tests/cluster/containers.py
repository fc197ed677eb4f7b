"""Drives the compose cluster by its script, by REST and by the docker command."""

import json
import os
import ssl
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PREPARE = Path(__file__).with_name("cluster.sh")
SCRIPT = ROOT / "deploy" / "compose" / "cluster.sh"
ENDED = ("done", "failed", "canceled")


def docker(*arguments: str) -> str:
    return subprocess.run(
        ["docker", *arguments], stdout=subprocess.PIPE, text=True, check=True
    ).stdout


@dataclass
class Cluster:
    """A cluster under a project name of its own, on ports of its own."""

    folder: Path
    workers: int
    project: str = "metrofarm-test"
    port: int = 18443
    prometheus_port: int = 19091

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {
            "CLUSTER_PROJECT": self.project,
            "CLUSTER_OUT": str(self.folder),
            "CLUSTER_WORKERS": str(self.workers),
            "METROFARM_PORT": str(self.port),
            "PROMETHEUS_PORT": str(self.prometheus_port),
            "METROFARM_PROGRAMS": "prebuilt",
            "METROFARM_THREADS": "1",
        }

    def script(self, *arguments: str, **environment: str) -> str:
        return subprocess.run(
            [SCRIPT, *arguments],
            env=self.environment | environment,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        ).stdout

    def up(self) -> None:
        self.script("up")

    def destroy(self) -> None:
        self.script("destroy")

    def containers(self, service: str) -> list[str]:
        labels = (
            f"com.docker.compose.project={self.project}",
            f"com.docker.compose.service={service}",
        )
        filters = [word for label in labels for word in ("--filter", f"label={label}")]
        return docker("ps", "--quiet", *filters).split()

    def request(self, method: str, path: str, body: bytes | None = None, kind: str = "") -> Any:
        """The answer's JSON. Coordinators may be lost in between: what is safe to repeat is."""
        token = (self.folder / "token").read_text().strip()
        headers = {"Authorization": f"Bearer {token}"} | ({"Content-Type": kind} if kind else {})
        trust = ssl.create_default_context(cafile=str(self.folder / "ca.crt"))
        for attempt in range(30):
            request = urllib.request.Request(
                f"https://localhost:{self.port}{path}", data=body, headers=headers, method=method
            )
            try:
                with urllib.request.urlopen(request, timeout=30, context=trust) as answer:
                    return json.load(answer)
            except urllib.error.HTTPError as error:
                if method != "GET" or error.code not in (502, 503, 504) or attempt == 29:
                    raise AssertionError(f"{path}: {error.code} {error.read()!r}") from error
            except (ConnectionError, urllib.error.URLError):
                if method != "GET" or attempt == 29:
                    raise
            time.sleep(1)
        raise AssertionError("unreachable")

    def submit(self, scene: Path, **request: Any) -> str:
        archive = subprocess.run(
            ["tar", "--create", "--directory", str(scene.parent), "."],
            stdout=subprocess.PIPE,
            check=True,
        ).stdout
        digest = self.request("POST", "/v1/scenes", archive, "application/x-tar")["digest"]
        job = {"scene": digest, "entry": scene.name, **request}
        return self.request("POST", "/v1/jobs", json.dumps(job).encode(), "application/json")["id"]

    def job(self, name: str) -> dict[str, Any]:
        return self.request("GET", f"/v1/jobs/{name}")

    def wait(self, name: str, seconds: float = 300, rounds: int | None = None) -> dict[str, Any]:
        """Until the job has ended, or has completed some rounds."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            job = self.job(name)
            if job["state"] in ENDED or (rounds is not None and job["rounds_done"] >= rounds):
                return job
            time.sleep(0.5)
        raise AssertionError(f"{name} is still {job['state']} after {seconds} s: {job}")

    def prometheus(self, query: str) -> list[dict[str, Any]]:
        url = f"http://127.0.0.1:{self.prometheus_port}/api/v1/query?" + urllib.parse.urlencode(
            {"query": query}
        )
        with urllib.request.urlopen(url, timeout=10) as answer:
            return json.load(answer)["data"]["result"]
