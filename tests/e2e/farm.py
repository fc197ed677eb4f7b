"""Drives the real programs: a coordinator, workers, and the REST interface between them."""

import io
import json
import os
import signal
import socket
import ssl
import subprocess
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
METROFARM = ROOT / "bin" / "metrofarm"
WORKER = ROOT / "bin" / "metrofarm-worker"
SCENES = ROOT / "tests" / "scenes"

ENDED = ("done", "failed", "canceled")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class Answer:
    """An HTTP answer of any status."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def media_type(self) -> str:
        return self.headers.get("Content-Type", "").split(";")[0]

    def json(self) -> Any:
        return json.loads(self.body)


class Process:
    """A program in the background whose output goes to a log file."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        self.log = log
        with log.open("ab") as out:
            self._process = subprocess.Popen(arguments, stdout=out, stderr=out)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self, number: signal.Signals, timeout: float = 20) -> int:
        self.send(number)
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise

    def wait(self, timeout: float) -> int:
        """The exit status of a program that ends by itself."""
        return self._process.wait(timeout)

    def kill(self) -> None:
        self.end(signal.SIGKILL)


class Rest:
    """The REST interface of a coordinator."""

    token: str = ""
    trust: ssl.SSLContext | None = None  # where it speaks https

    @property
    def url(self) -> str:
        raise NotImplementedError

    def request(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        media_type: str = "",
        idempotency_key: str = "",
    ) -> Answer:
        headers = {"Content-Type": media_type} if media_type else {}
        headers |= {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        headers |= {"Authorization": f"Bearer {self.token}"} if self.token else {}
        request = urllib.request.Request(self.url + path, body, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=30, context=self.trust) as reply:
                return Answer(reply.status, reply.headers, reply.read())
        except urllib.error.HTTPError as refusal:
            return Answer(refusal.code, refusal.headers, refusal.read())

    def get(self, path: str) -> Answer:
        return self.request("GET", path)

    def post(self, path: str, document: Any = None, idempotency_key: str = "") -> Answer:
        body = b"" if document is None else json.dumps(document).encode()
        return self.request("POST", path, body, "application/json", idempotency_key)

    def upload(self, bundle: bytes) -> Answer:
        return self.request("POST", "/v1/scenes", bundle, "application/zip")

    def submit(self, scene: Path, **request: Any) -> str:
        """Uploads the scene's folder and submits a job; returns the job's id."""
        uploaded = self.upload(zip_folder(scene.parent))
        assert uploaded.status in (200, 201), uploaded.body
        document = {"scene": uploaded.json()["digest"], "entry": scene.name, **request}
        answer = self.post("/v1/jobs", document)
        assert answer.status == 201, answer.body
        return str(answer.json()["id"])

    def job(self, job_id: str) -> dict[str, Any]:
        answer = self.get(f"/v1/jobs/{job_id}")
        assert answer.status == 200, answer.body
        return dict(answer.json())

    def wait(self, job_id: str, timeout: float = 300) -> dict[str, Any]:
        """The job's snapshot once it has ended."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            snapshot = self.job(job_id)
            if snapshot["state"] in ENDED:
                return snapshot
            time.sleep(0.1)
        raise TimeoutError(f"job {job_id} after {timeout} s: {self.job(job_id)}")

    def wait_for_rounds(self, job_id: str, rounds: int, timeout: float = 120) -> None:
        deadline = time.monotonic() + timeout
        while self.job(job_id)["rounds_done"] < rounds:
            assert time.monotonic() < deadline, f"no round {rounds}: {self.job(job_id)}"
            time.sleep(0.05)

    def events(self, job_id: str, after: int = 0) -> Iterator[tuple[int, str, Any]]:
        """Server-sent events as (id, kind, data); the caller stops reading."""
        url = f"{self.url}/v1/jobs/{job_id}/events"
        request = urllib.request.Request(url, headers={"Last-Event-ID": str(after)})
        with urllib.request.urlopen(request, timeout=60) as stream:
            assert stream.headers["Content-Type"].startswith("text/event-stream")
            fields: dict[str, str] = {}
            for raw in stream:
                line = raw.decode().rstrip("\r\n")
                if line and not line.startswith(":"):
                    name, _, value = line.partition(":")
                    fields[name] = value.removeprefix(" ")
                elif not line and "data" in fields:
                    yield int(fields["id"]), fields["event"], json.loads(fields["data"])
                    fields = {}


@dataclass
class Farm(Rest):
    """A coordinator with fixed ports and data folder, so that it can be killed and come back."""

    folder: Path
    local_workers: int = 0
    threads: int = 1
    port: int = field(default_factory=free_port)
    farm_port: int = field(default_factory=free_port)
    options: tuple[str, ...] = ()
    token: str = ""
    trust: ssl.SSLContext | None = None
    coordinator: Process | None = None
    workers: dict[str, Process] = field(default_factory=dict)

    @property
    def url(self) -> str:
        return f"{'https' if self.trust else 'http'}://127.0.0.1:{self.port}"

    def start(self) -> None:
        arguments = [str(METROFARM), "serve", "--listen", f"127.0.0.1:{self.port}"]
        arguments += ["--farm-listen", f"127.0.0.1:{self.farm_port}"]
        arguments += ["--data", str(self.folder / "data"), "--workers", str(self.local_workers)]
        arguments += ["--threads", str(self.threads), *self.options]
        self.coordinator = Process(arguments, self.folder / "coordinator.log")
        self._wait_until_ready()

    def _wait_until_ready(self, timeout: float = 60) -> None:
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if self.coordinator is None or not self.coordinator.alive:
                break
            try:
                if self.get("/readyz").status == 200:
                    return
            except OSError:
                pass
            time.sleep(0.05)
        log = (self.folder / "coordinator.log").read_text(errors="replace")
        raise RuntimeError(f"the coordinator is not ready:\n{log[-4000:]}")

    def start_worker(self, name: str, *options: str) -> None:
        arguments = [str(WORKER), "--coordinator", f"127.0.0.1:{self.farm_port}", "--name", name]
        arguments += ["--threads", str(self.threads), "--cache", str(self.folder / f"cache-{name}")]
        arguments += options
        self.workers[name] = Process(arguments, self.folder / f"{name}.log")

    def close(self) -> None:
        for process in [*self.workers.values(), self.coordinator]:
            if process is not None and process.alive:
                process.kill()


def zip_files(files: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def zip_folder(folder: Path) -> bytes:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return zip_files({str(path.relative_to(folder)): path.read_bytes() for path in files})


def run(*arguments: str | Path, timeout: float = 300) -> subprocess.CompletedProcess[str]:
    """bin/metrofarm with these arguments, to its end."""
    environment = {**os.environ, "NO_COLOR": "1"}
    return subprocess.run(
        [str(METROFARM), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        env=environment,
    )
