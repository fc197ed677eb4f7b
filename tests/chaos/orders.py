"""The jobs of the tests: what is ordered, what an undisturbed farm makes of it, and a customer who
does not give up before the farm has accepted an order.
"""

import itertools
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from farm import ENDED, SCENES, Answer, Farm, Rest, zip_folder

SCENE = SCENES / "glass-caustic" / "scene.xml"

# A few seconds of one worker each.
KINDS: dict[str, dict[str, Any]] = {
    "path": {"integrator": "path", "stop": {"samples_per_pixel": 384}},
    "bdpt": {"integrator": "bdpt", "stop": {"samples_per_pixel": 128}},
    "pssmlt": {
        "integrator": "pssmlt",
        "delayed_rejection": "on",
        "stop": {"mutations_per_pixel": 384},
    },
    "mmlt": {"integrator": "mmlt", "stop": {"mutations_per_pixel": 384}},
}
COMMON: dict[str, Any] = {"width": 96, "height": 64, "seed": 11}

# What must be as in the undisturbed run, to the bit: the film's hash, and what was counted.
RESULT = ("film_sha256", "rounds_done", "mutations", "path_evaluations", "rays", "b", "anomalies")


def request_of(kind: str, **changes: Any) -> dict[str, Any]:
    return {**COMMON, **KINDS[kind], **changes}


def result_of(snapshot: dict[str, Any]) -> dict[str, Any]:
    assert snapshot["state"] == "done", snapshot
    return {name: snapshot.get(name) for name in RESULT}


def undisturbed(folder: Path, requests: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The results of requests on a farm of one coordinator and one worker."""
    folder.mkdir()
    farm = Farm(folder, local_workers=1)
    try:
        farm.start()
        return [result_of(farm.wait(farm.submit(SCENE, **r), timeout=600)) for r in requests]
    finally:
        farm.close()


@dataclass
class Order:
    key: str
    kind: str
    job: str = ""
    tries: int = 0
    accepted: float = 0.0
    done: float = 0.0
    snapshot: dict[str, Any] = field(default_factory=dict)


class Customer:
    """Submits jobs to whichever coordinator answers, and follows them to their end."""

    def __init__(self, farm: list[Rest], prefix: str) -> None:
        self.orders: list[Order] = []
        self._farm = farm
        self._turn: Iterator[Rest] = itertools.cycle(farm)
        self._prefix = prefix
        self._scene = ""

    def order(self, kind: str, timeout: float = 120) -> Order:
        """Repeats a submission, under one key, until it is answered."""
        if not self._scene:
            bundle = zip_folder(SCENE.parent)
            uploaded = self._insist("POST", "/v1/scenes", timeout, bundle, "application/zip")
            self._scene = str(uploaded.json()["digest"])
        order = Order(f"{self._prefix}-{len(self.orders) + 1}", kind)
        document = {"scene": self._scene, "entry": SCENE.name, **request_of(kind)}
        deadline = time.monotonic() + timeout
        while not order.job:
            assert time.monotonic() < deadline, f"order {order} is not answered"
            order.tries += 1
            answer = self._ask("POST", "/v1/jobs", document, order.key)
            if answer is not None and answer.status != 503:
                assert answer.status == 201, answer.body
                order.job = str(answer.json()["id"])
            else:
                time.sleep(0.1)
        order.accepted = time.time()
        self.orders.append(order)
        return order

    def look(self) -> int:
        """Asks about all jobs that are not known to have ended; returns their number."""
        waiting = 0
        for order in self.orders:
            if order.done:
                continue
            answer = self._ask("GET", f"/v1/jobs/{order.job}")
            # 503: between two coordinators. Anything else but the job would be a loss.
            if answer is not None and answer.status != 503:
                assert answer.status == 200, (order, answer.status, answer.body)
                order.snapshot = answer.json()
                assert order.snapshot["state"] not in ("failed", "canceled"), order
                if order.snapshot["state"] in ENDED:
                    order.done = time.time()
            waiting += not order.done
        return waiting

    def jobs(self) -> list[str]:
        """All jobs that the farm knows."""
        ids: list[str] = []
        cursor = ""
        while True:
            page = self._insist("GET", f"/v1/jobs?limit=200&cursor={cursor}", 60).json()
            ids += [job["id"] for job in page["jobs"]]
            cursor = page.get("next", "")
            if not cursor:
                return ids

    def _insist(
        self, method: str, path: str, timeout: float, body: bytes | None = None, media: str = ""
    ) -> Answer:
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            try:
                answer = next(self._turn).request(method, path, body, media)
            except OSError:
                time.sleep(0.1)
                continue
            if answer.status in (200, 201):
                return answer
            assert answer.status == 503, (path, answer.status, answer.body)
            time.sleep(0.1)
        raise AssertionError(f"{method} {path}: no answer within {timeout} s")

    def _ask(self, method: str, path: str, document: Any = None, key: str = "") -> Answer | None:
        rest = next(self._turn)
        try:
            return rest.get(path) if method == "GET" else rest.post(path, document, key)
        except OSError:  # a connection that breaks off is one, too
            return None
