"""The processes of a farm that is disturbed: Redis, coordinators, the proxy, workers.

Each has its port and folder for good, so that any of them can be killed at any moment and come
back as what it was.
"""

import random
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from farm import METROFARM, ROOT, WORKER, Process, Rest

PROXY_SOURCE = Path(__file__).parent / "proxy"
PROXY = ROOT / "build" / "chaos-proxy"


def port_for_good() -> int:
    """A free port that no outgoing connection takes while its owner is away."""
    first = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    for _ in range(100):
        port = random.SystemRandom().randrange(max(2048, first - 12000), first)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise RuntimeError("no free port")


def build_proxy() -> None:
    PROXY.parent.mkdir(exist_ok=True)
    subprocess.run(["go", "build", "-o", str(PROXY), "."], cwd=PROXY_SOURCE, check=True)


class Part:
    """A process that can be killed and started again."""

    def __init__(self, name: str, folder: Path, arguments: list[str]) -> None:
        self.name = name
        self.arguments = arguments
        self.log = folder / f"{name}.log"
        self.process: Process | None = None

    def start(self) -> None:
        assert not self.alive, self.name
        self.process = Process(self.arguments, self.log)

    @property
    def alive(self) -> bool:
        return self.process is not None and self.process.alive

    @property
    def pid(self) -> int:
        assert self.process is not None
        return self.process.pid

    def kill(self) -> None:
        if self.process is not None and self.process.alive:
            self.process.kill()

    def logged(self, text: str) -> int:
        """How many lines of the log have this text."""
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        return sum(text in line for line in lines)


class Coordinator(Part, Rest):
    """A coordinator and its REST interface."""

    rest_port = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.rest_port}"

    def ready(self) -> bool:
        try:
            return self.get("/readyz").status == 200
        except OSError:
            return False

    def counter(self, name: str) -> float:
        """A counter's sum over its labels; it begins at 0 with the process."""
        total = 0.0
        for line in self.get("/metrics").body.decode().splitlines():
            if line.startswith((name + " ", name + "{")):
                total += float(line.rsplit(" ", 1)[1])
        return total


@dataclass
class Proxy:
    """How the proxy disturbs what workers deliver; see proxy/main.go."""

    seed: int
    rate: float = 0.5
    faults: str = ""
    forge: str = ""

    def arguments(self, routes: list[tuple[str, str]], journal: Path) -> list[str]:
        words = [str(PROXY), "--seed", str(self.seed), "--rate", str(self.rate)]
        words += ["--journal", str(journal)]
        words += ["--faults", self.faults] if self.faults else []
        words += ["--forge", self.forge] if self.forge else []
        for listen, upstream in routes:
            words += ["--route", f"{listen}={upstream}"]
        return words


@dataclass
class Stage:
    """A farm of one Redis, coordinators that share it, and workers that know all coordinators."""

    folder: Path
    coordinator_count: int = 2
    worker_count: int = 3
    proxy: Proxy | None = None
    proxy_host: str = "127.0.0.1"
    worker_prefix: dict[str, list[str]] = field(default_factory=dict)
    parts: dict[str, Part] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.journal = self.folder / "journal.jsonl"
        self._add_redis()
        upstreams = [self._add_coordinator(i + 1) for i in range(self.coordinator_count)]
        if self.proxy is not None:
            routes = [(f"{self.proxy_host}:{port_for_good()}", upstream) for upstream in upstreams]
            self._add("proxy", self.proxy.arguments(routes, self.journal))
            upstreams = [listen for listen, _ in routes]
        for i in range(self.worker_count):
            self._add_worker(f"worker-{i + 1}", upstreams)

    def _add(self, name: str, arguments: list[str]) -> None:
        self.parts[name] = Part(name, self.folder, arguments)

    def _add_redis(self) -> None:
        self.redis_port = port_for_good()
        data = self.folder / "redis"
        data.mkdir()
        words = ["redis-server", "--bind", "127.0.0.1", "--port", str(self.redis_port)]
        words += ["--dir", str(data), "--save", "", "--appendonly", "yes"]
        words += ["--appendfsync", "always", "--maxmemory-policy", "noeviction"]
        self._add("redis", words)

    def _add_coordinator(self, number: int) -> str:
        name = f"coordinator-{number}"
        rest, farm = port_for_good(), f"127.0.0.1:{port_for_good()}"
        words = [str(METROFARM), "serve", "--listen", f"127.0.0.1:{rest}"]
        words += ["--farm-listen", farm, "--store", f"redis://127.0.0.1:{self.redis_port}/0"]
        words += ["--data", str(self.folder / name), "--blobs", str(self.folder / "blobs")]
        words += ["--advertise", f"127.0.0.1:{rest}", "--workers", "0"]
        coordinator = Coordinator(name, self.folder, words)
        coordinator.rest_port = rest
        self.parts[name] = coordinator
        return farm

    def _add_worker(self, name: str, upstreams: list[str]) -> None:
        words = [*self.worker_prefix.get(name, []), str(WORKER), "--name", name, "--threads", "1"]
        words += ["--coordinator", ",".join(upstreams), "--cache", str(self.folder / name)]
        words += [] if self.proxy_host == "127.0.0.1" else ["--insecure"]
        self._add(name, words)

    @property
    def coordinators(self) -> list[Coordinator]:
        return [part for part in self.parts.values() if isinstance(part, Coordinator)]

    @property
    def workers(self) -> list[Part]:
        return [part for name, part in self.parts.items() if name.startswith("worker-")]

    def start(self) -> None:
        self.parts["redis"].start()
        wait_until(self.redis_answers, 20, "redis answers")
        for name, part in self.parts.items():
            if name != "redis":
                part.start()
        for coordinator in self.coordinators:
            wait_until(coordinator.ready, 60, f"{coordinator.name} is ready", coordinator)

    def redis_answers(self) -> bool:
        try:
            with socket.create_connection(("127.0.0.1", self.redis_port), timeout=1) as redis:
                redis.sendall(b"PING\r\n")
                return redis.recv(16).startswith(b"+PONG")
        except OSError:
            return False

    def close(self) -> None:
        for part in reversed(self.parts.values()):
            part.kill()

    def died(self) -> list[str]:
        """Parts that ended by themselves: nobody but the test may end one."""
        return [
            f"{part.name}: {part.log.read_text(errors='replace')[-2000:]}"
            for part in self.parts.values()
            if part.process is not None and not part.alive
        ]


def wait_until(
    true: Callable[[], bool], timeout: float, what: str, part: Part | None = None
) -> None:
    deadline = time.monotonic() + timeout
    while not true():
        if time.monotonic() > deadline or (part is not None and not part.alive):
            log = part.log.read_text(errors="replace")[-4000:] if part is not None else ""
            raise AssertionError(f"not within {timeout} s: {what}\n{log}")
        time.sleep(0.05)


def stop(part: Part) -> None:
    """Holds a process still; what it has in memory can be changed meanwhile."""
    assert part.process is not None
    part.process.send(signal.SIGSTOP)


def go_on(part: Part) -> None:
    assert part.process is not None
    part.process.send(signal.SIGCONT)
