"""What the page asks of the browser: its memory, and leave to load things."""

import pytest
from playwright.sync_api import expect

from farm import SCENES, Farm
from watched import Watched

SCENE = SCENES / "cornell-box" / "scene.xml"
SMALL = {"width": 96, "height": 96, "integrator": "mmlt"}
SAMPLES = 20
# Of the largest heap in the first half of the time, for what the second half may hold.
GROWTH = 1.25
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


def test_the_heap_stays(farm: Farm, watched: Watched, request: pytest.FixtureRequest) -> None:
    """With --heap-minutes 10, as long as it is asked for; the stage takes a short look."""
    minutes = request.config.getoption("--heap-minutes")
    job = farm.submit(SCENE, **SMALL, stop={"time_seconds": 60 * minutes + 600})
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    page.wait_for_selector("#image")
    watched.wait_for_points(6)
    tools = page.context.new_cdp_session(page)
    sizes, nodes = [], []
    for _ in range(SAMPLES):
        # The time is what is measured against: no condition ends it.
        page.wait_for_timeout(60_000 * minutes / SAMPLES)
        tools.send("HeapProfiler.collectGarbage")
        sizes.append(tools.send("Runtime.getHeapUsage")["usedSize"] / MIB)
        nodes.append(page.evaluate("document.getElementsByTagName('*').length"))
    print("heap in MiB:", " ".join(f"{size:.2f}" for size in sizes), "nodes:", *nodes)
    half = SAMPLES // 2
    assert max(sizes[half:]) < GROWTH * max(sizes[:half])
    assert max(nodes[half:]) < GROWTH * max(nodes[:half]) + 50
