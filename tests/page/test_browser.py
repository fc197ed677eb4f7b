"""What the page asks of the browser: its memory, and leave to load things."""

from typing import Any

import pytest
from playwright.sync_api import expect

from farm import SCENES, Farm
from watched import Watched

SCENE = SCENES / "cornell-box" / "scene.xml"
SMALL = {"width": 96, "height": 96, "integrator": "mmlt"}
SAMPLES = 20
# Of the largest heap in the first half of the time, for what the second half may hold.
GROWTH = 1.25
# Of the images' bytes that were read since, for what buffers may come to hold: one copy of each is
# kept for comparisons, a leak holds two. What is being read or drawn takes some more.
COPIES = 1.4
SLACK = 2.5
ROUNDS = 16
MIB = 1 << 20


def test_the_policy_is_strict_and_kept(farm: Farm, watched: Watched) -> None:
    page = watched.page
    answer = page.goto(farm.url)
    assert answer is not None
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "*" not in policy
    expect(page.locator("#connection")).to_have_text("live")
    assert watched.complaints == [], "the page wants what its policy forbids"
    assert watched.elsewhere() == []
    refused = page.evaluate(
        """async (elsewhere) => {
          const told = new Promise((resolve) =>
            addEventListener('securitypolicyviolation', (e) => resolve(e.effectiveDirective)))
          await fetch(elsewhere).catch(() => undefined)
          return told
        }""",
        "http://127.0.0.1:9/",
    )
    assert refused == "connect-src"
    watched.complaints.clear()


class Memory:
    """What a page holds after a full collection."""

    def __init__(self, watched: Watched, size: dict[str, Any]) -> None:
        self.watched = watched
        self.page = watched.page
        self.image = 4 * 3 * int(size["width"]) * int(size["height"])  # bytes of one
        self.tools = self.page.context.new_cdp_session(self.page)
        self.heap: list[float] = []
        self.nodes: list[int] = []
        self.images: list[int] = []
        self.buffers: list[int] = []

    def measure(self) -> None:
        usages = []
        for _ in range(3):  # between two, the page may have drawn
            self.tools.send("HeapProfiler.collectGarbage")
            usages.append(self.tools.send("Runtime.getHeapUsage"))
        self.heap.append(min(u["usedSize"] + u["embedderHeapUsedSize"] for u in usages) / MIB)
        self.buffers.append(min(u["backingStorageSize"] for u in usages))
        self.nodes.append(self.page.evaluate("document.getElementsByTagName('*').length"))
        self.images.append(self.watched.images_asked_for())

    def buffers_too_many(self) -> bool:
        """Whether buffers grew by more than one copy of each image that was read since."""
        allowed = (COPIES * (self.images[-1] - self.images[0]) + SLACK) * self.image
        return self.buffers[-1] - self.buffers[0] > allowed

    def __str__(self) -> str:
        lines = {
            "heap in MiB": [f"{size:.2f}" for size in self.heap],
            "buffers in MiB": [f"{size / MIB:.2f}" for size in self.buffers],
            "elements": self.nodes,
            "images": self.images,
        }
        return "\n".join(f"{name}: {' '.join(map(str, row))}" for name, row in lines.items())


def test_the_heap_stays(farm: Farm, watched: Watched, request: pytest.FixtureRequest) -> None:
    """With --heap-minutes 10, as long as it is asked for; the stage takes a short look."""
    minutes = request.config.getoption("--heap-minutes")
    job = farm.submit(SCENE, **SMALL, stop={"time_seconds": 60 * minutes + 600})
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    watched.picture("image")
    watched.wait_for_points(6)
    memory = Memory(watched, SMALL)
    for _ in range(SAMPLES):
        # The time is what is measured against: no condition ends it.
        page.wait_for_timeout(60_000 * minutes / SAMPLES)
        memory.measure()
    print(memory)
    half = SAMPLES // 2
    assert max(memory.heap[half:]) < GROWTH * max(memory.heap[:half])
    assert max(memory.nodes[half:]) < GROWTH * max(memory.nodes[:half]) + 50
    assert not memory.buffers_too_many()


@pytest.mark.parametrize("leaks", [False, True])
def test_buffers_that_leak_are_seen(farm: Farm, watched: Watched, leaks: bool) -> None:
    """A page that keeps what it read of each image, beside the image, holds twice as much."""
    size = {**SMALL, "width": 192, "height": 192}
    job = farm.submit(SCENE, **size, stop={"time_seconds": 600})
    page = watched.page
    if leaks:
        page.add_init_script(
            """window.leaked = []
            const read = Response.prototype.arrayBuffer
            Response.prototype.arrayBuffer = async function () {
              const buffer = await read.call(this)
              window.leaked.push(buffer)
              return buffer
            }"""
        )
    page.goto(f"{farm.url}/#/jobs/{job}")
    watched.picture("image")
    memory = Memory(watched, size)
    memory.measure()
    for _ in range(ROUNDS):  # each with its image, also where rounds are faster than the page
        seen = watched.picture("image")
        page.wait_for_function(
            """(seen) => {
              const canvas = document.querySelector('#image')
              return canvas.dataset.drawn && canvas.toDataURL() !== seen
            }""",
            arg=seen,
        )
    memory.measure()
    print(memory)
    assert memory.buffers_too_many() == leaks
