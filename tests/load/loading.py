"""One coordinator under the load of simulated workers (services/cmd/farmload)."""

import json
import os
import socket
import statistics
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from farm import ROOT, SCENES, WORKER, Farm, Process, free_port, zip_folder

FARMLOAD = ROOT / "bin" / "farmload"
SCENE = SCENES / "door-ajar" / "scene.xml"
# 2048 chain groups: two rounds of segments for 400 workers are more than they can hold.
CHAINS = 131072
MIB = 2**20


def build() -> None:
    """farmload is a tool of this test, so make build leaves it out."""
    subprocess.run(
        ["go", "build", "-o", FARMLOAD, "./cmd/farmload"], cwd=ROOT / "services", check=True
    )


def farmload(*arguments: str | Path) -> Any:
    command = [str(FARMLOAD), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    return json.loads(done.stdout)


Sizes = list[tuple[float, float]]  # seconds, bytes


@dataclass
class Sample:
    """What a process has at a time."""

    seconds: float
    rss: int
    cpu_seconds: float
    live: float = 0


def sample(pid: int) -> Sample:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    ticks = int(fields[11]) + int(fields[12])
    rss = int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    return Sample(time.monotonic(), rss, ticks / os.sysconf("SC_CLK_TCK"))


class Sampler:
    """Samples a process twice a second while it is a context.

    What lives on its heap is known to the process alone."""

    def __init__(self, pid: int, live: Callable[[], float] = lambda: 0) -> None:
        self._pid = pid
        self._live = live
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.samples: list[Sample] = []

    def _run(self) -> None:
        while not self._stop.wait(0.5):
            taken = sample(self._pid)
            taken.live = self._live()
            self.samples.append(taken)

    def __enter__(self) -> "Sampler":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def peak(self) -> int:
        return max(s.rss for s in self.samples)


def growth(sizes: Sizes) -> float:
    """How much sizes at seconds grow over all that time, relative to their median.

    Theil and Sen's slope, the median over all pairs, which single collections do not move."""
    slopes = [(b - a) / (t - s) for i, (s, a) in enumerate(sizes) for t, b in sizes[i + 1 :]]
    span = sizes[-1][0] - sizes[0][0]
    return statistics.median(slopes) * span / statistics.median(size for _, size in sizes)


def noise(sizes: Sizes, block: float = 20, draws: int = 200) -> float:
    """What growth() stays below in 99 of 100 cases where nothing grows.

    H0: sizes come and go, correlated over less than a block (seconds). Blocks of the sizes, at
    random, have no trend left."""
    length = max(1, round(block * (len(sizes) - 1) / (sizes[-1][0] - sizes[0][0])))
    random = Random(1)
    grown = []
    for _ in range(draws):
        drawn: list[float] = []
        while len(drawn) < len(sizes):
            start = random.randrange(len(sizes) - length + 1)
            drawn += [size for _, size in sizes[start : start + length]]
        grown.append(growth([(s, size) for (s, _), size in zip(sizes, drawn, strict=False)]))
    return sorted(grown)[-max(1, draws // 100)]


def film_bytes(width: int, height: int) -> int:
    """Sums of a film of chains where every tile has light: 2 halves, 2 layers, 128 bits a value."""
    tiles = -(-width // 32) * -(-height // 32)
    return 2 * 2 * tiles * 32 * 32 * 3 * 16


@dataclass
class LoadedFarm:
    """A coordinator without workers of its own."""

    folder: Path
    farm: Farm = field(init=False)
    scene: str = ""

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        # A thousand jobs at once are more than one client may submit by default.
        self.farm = Farm(self.folder, options=("--max-rate", "10000"))
        self.farm.start()

    def close(self) -> None:
        self.farm.close()

    @property
    def pid(self) -> int:
        assert self.farm.coordinator is not None
        return self.farm.coordinator.pid

    def submit(self, width: int, height: int, **request: Any) -> str:
        if not self.scene:
            self.scene = self.farm.upload(zip_folder(SCENE.parent)).json()["digest"]
        document = {"scene": self.scene, "entry": SCENE.name, "width": width, "height": height}
        answer = self.farm.post("/v1/jobs", {**document, "integrator": "pssmlt", **request})
        assert answer.status == 201, answer.body
        return str(answer.json()["id"])

    def submit_long(self, width: int, height: int, chains: int = CHAINS) -> str:
        """A job that does not end."""
        many = {"mutations_per_pixel": 2**20}
        return self.submit(width, height, chains=chains, bootstrap_samples=2**20, stop=many)

    def record(self, out: Path, width: int, height: int, batches: int) -> Any:
        """Has a real worker with one thread render, and keeps what it delivers."""
        port = free_port()
        job = self.submit(
            width, height, bootstrap_samples=2**18, stop={"mutations_per_pixel": 1000}
        )
        command = [str(FARMLOAD), "record", "-coordinator", f"127.0.0.1:{self.farm.farm_port}"]
        command += ["-listen", f"127.0.0.1:{port}", "-out", str(out), "-batches", str(batches)]
        recorder = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        command = [str(WORKER), "--coordinator", f"127.0.0.1:{port}", "--threads", "1"]
        command += ["--cache", str(self.folder / "cache")]
        worker = self.farm.workers["recorded"] = Process(command, self.folder / "worker.log")
        output, _ = recorder.communicate(timeout=400)
        worker.kill()
        assert self.farm.post(f"/v1/jobs/{job}/cancel").status in (200, 202)
        return json.loads(output)["batches"]

    def load(self, film: Path, *options: str) -> Any:
        """Simulated workers, and what they cost the coordinator over all their time."""
        address = f"127.0.0.1:{self.farm.farm_port}"
        before, batches = sample(self.pid), self.counted("metrofarm_batches_total")
        with Sampler(self.pid, self.live) as sampler:
            result = farmload("run", "-coordinator", address, "-film", film, *options)
        after = sample(self.pid)
        answered = self.counted("metrofarm_batches_total") - batches
        result["peak_rss"] = sampler.peak
        result["coordinator_cpu_seconds"] = after.cpu_seconds - before.cpu_seconds
        result["cpu_seconds_per_batch"] = result["coordinator_cpu_seconds"] / max(answered, 1)
        return result | {"samples": sampler.samples}

    def live(self) -> float:
        """What survived the last collection: Go's next one is due at twice that."""
        return self.counted("go_memstats_next_gc_bytes") / 2

    def counted(self, metric: str) -> float:
        """The sum of a metric over its labels."""
        lines = self.farm.get("/metrics").body.decode().splitlines()
        return sum(float(line.split()[-1]) for line in lines if line.startswith(metric))


def accepted(result: Any) -> int:
    """Batches, all of which must have been counted; a segment that is checked comes twice."""
    batches = dict(result["batches"])
    good = batches.pop("OUTCOME_COMMITTED", 0) + batches.pop("OUTCOME_DUPLICATE", 0)
    assert not batches and not result["failures"], result
    return good


def timed(call: Callable[[], object]) -> float:
    start = time.monotonic()
    call()
    return time.monotonic() - start


def watch(stack: ExitStack, farm: Farm, jobs: list[str]) -> None:
    """Opens an event stream of each job, and reads what comes first."""
    for job in jobs:
        client = stack.enter_context(socket.create_connection(("127.0.0.1", farm.port)))
        client.settimeout(30)
        request = f"GET /v1/jobs/{job}/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
        client.sendall(request.encode())
        answer = client.recv(65536)
        assert b" 200 " in answer.splitlines()[0], answer


def queue_up(stack: ExitStack, loaded: LoadedFarm, jobs: int, clients: int) -> dict[str, Any]:
    """What queued jobs and idle event streams cost a fresh coordinator; the streams stay open as
    long as the stack does."""
    farm = loaded.farm
    farm.get("/v1/jobs")
    before = sample(loaded.pid).rss
    started = time.monotonic()
    small = {"bootstrap_samples": 4096, "chains": 1024, "stop": {"mutations_per_pixel": 1}}
    with Sampler(loaded.pid) as sampler:
        queued = [loaded.submit(64, 64, **small) for _ in range(jobs)]
        submitted = time.monotonic() - started
        watch(stack, farm, queued[:clients])
        lists = sorted(timed(lambda: farm.get("/v1/jobs?limit=100")) for _ in range(20))
        time.sleep(2)
    return {
        "jobs": jobs,
        "clients": clients,
        "submit_seconds_per_job": submitted / jobs,
        "idle_rss": before,
        "peak_rss": sampler.peak,
        "list_seconds_p50": lists[len(lists) // 2],
        "list_seconds_longest": lists[-1],
    }
