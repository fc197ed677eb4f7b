"""500 jobs: queued at the real service, and made up ones that change every second."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, Route, expect

from farm import SCENES, Farm, zip_folder
from watched import Watched

JOBS = 500
WORKERS = 200
PAGE = 200
SCENE = SCENES / "cornell-box" / "scene.xml"
UPDATES = 4
# Milliseconds for which one update of everything may keep the page from answering.
LONGEST_TASK = 1500


def job(n: int, progress: float) -> dict[str, Any]:
    return {
        "id": f"job-{n:04}",
        "request": {"scene": "aa", "entry": "scene.xml", "name": f"shot {n:04}"},
        "state": "rendering" if n % 2 else "done",
        "paused": False,
        "created_at": f"2026-01-01T{n // 60:02}:{n % 60:02}:00Z",
        "seed": 0,
        "rounds_done": 3,
        "round_segments": 16,
        "round_segments_done": 4,
        "progress": progress,
        "mutations_per_second": 1e5 * n,
        "mutations": 1e6,
        "rays": 1e7,
        "cpu_seconds": 10,
        "wall_seconds": 10,
        "b": 1,
        "b_standard_error": 0.1,
        "rel_mse": 1 / (n + 1),
        "acceptance": {},
        "anomalies": {},
    }


def worker(n: int) -> dict[str, Any]:
    return {
        "id": f"w-{n}",
        "name": f"node-{n:03}",
        "version": "1",
        "threads": 64,
        "state": "busy",
        "last_contact": "2026-01-01T00:00:00Z",
        "leased_segments": n % 7,
        "mutations_per_second": 1e6,
        "conflicts": 0,
    }


class Synthetic:
    """The lists, and the stream: it ends after each message and is asked again."""

    def __init__(self) -> None:
        self.messages = 0

    def jobs(self, route: Route) -> None:
        cursor = route.request.url.partition("cursor=")[2]
        newest = int(cursor[4:]) - 1 if cursor else JOBS - 1
        oldest = max(-1, newest - PAGE)
        answer: dict[str, Any] = {"jobs": [job(n, 0.5) for n in range(newest, oldest, -1)]}
        if oldest >= 0:
            answer["next"] = f"job-{oldest + 1:04}"
        route.fulfill(json=answer)

    def events(self, route: Route) -> None:
        self.messages += 1
        change = {
            "full": self.messages == 1,
            "jobs": [job(n, min(0.9, 0.1 * self.messages)) for n in range(1, JOBS, 2)],
            "workers": [worker(n) for n in range(WORKERS)],
            "gone": [],
        }
        body = f"id: x-{self.messages}\nevent: farm\ndata: {json.dumps(change)}\n\n"
        route.fulfill(body=body, content_type="text/event-stream")


def watch_tasks(page: Page) -> None:
    """From the next load on, notes how long the page does not answer."""
    page.add_init_script(
        "window.longest = 0; new PerformanceObserver((list) => {"
        "for (const e of list.getEntries()) window.longest = Math.max(window.longest, e.duration)"
        "}).observe({type: 'longtask', buffered: true})"
    )


def longest_task(page: Page) -> float:
    longest = float(page.evaluate("window.longest"))
    print(f"longest task: {longest:.0f} ms")
    return longest


def test_many_jobs_and_workers(farm: Farm, watched: Watched) -> None:
    page, synthetic = watched.page, Synthetic()
    page.route("**/v1/jobs?*", synthetic.jobs)
    page.route("**/v1/jobs/*/image.png*", lambda route: route.fulfill(status=204))
    page.route("**/v1/events", synthetic.events)
    watch_tasks(page)
    page.goto(farm.url)
    expect(page.get_by_role("heading", name="Jobs (500)")).to_be_visible()
    expect(page.get_by_role("heading", name="Workers (200)")).to_be_visible()
    page.wait_for_function("document.querySelector('.totals').innerText.includes('12800')")
    rows = page.locator(".job-row:not(.head)")
    assert rows.count() < 60, "rows that nobody sees are in the document"
    expect(rows.first).to_contain_text("shot 0499")
    page.eval_on_selector(".rows", "(rows) => rows.scrollTo(0, rows.scrollHeight)")
    expect(rows.last).to_contain_text("shot 0000")
    page.get_by_label("Find jobs").fill("0123")
    expect(rows).to_have_count(1)
    page.get_by_label("Find jobs").fill("")
    page.get_by_role("button", name="relMSE").click()
    page.eval_on_selector(".rows", "(rows) => rows.scrollTo(0, 0)")
    expect(rows.first).to_contain_text("shot 0499")
    page.get_by_role("button", name="relMSE").click()
    expect(rows.first).to_contain_text("shot 0000")
    for _ in range(UPDATES):
        page.wait_for_event("response", lambda answer: answer.url.endswith("/v1/events"))
    assert longest_task(page) < LONGEST_TASK
    watched.check_access()


def test_jobs_that_are_queued(tmp_path: Path, watched: Watched) -> None:
    farm = Farm(tmp_path, options=("--max-rate", "10000", "--max-burst", "10000"))
    farm.start()
    try:
        queue_and_look(farm, watched)
    finally:
        watched.down = True
        farm.close()


def queue_and_look(farm: Farm, watched: Watched) -> None:
    scene = farm.upload(zip_folder(SCENE.parent)).json()["digest"]
    page = watched.page
    watch_tasks(page)
    page.goto(farm.url)

    def submit(n: int) -> str:
        request = {"scene": scene, "entry": SCENE.name, "name": f"shot-{n:03}"}
        return str(farm.post("/v1/jobs", request).json()["id"])

    with ThreadPoolExecutor(8) as people:
        ids = list(people.map(submit, range(JOBS)))
    expect(page.get_by_role("heading", name=f"Jobs ({JOBS})")).to_be_visible()  # by the stream
    page.reload()
    expect(page.get_by_role("heading", name=f"Jobs ({JOBS})")).to_be_visible()  # by the list
    page.get_by_label("Find jobs").fill("shot-250")
    rows = page.locator(".job-row:not(.head)")
    expect(rows).to_have_count(1)
    farm.post(f"/v1/jobs/{ids[250]}/cancel")
    expect(rows.locator(".badge")).to_contain_text("canceled")
    page.get_by_label("Find jobs").fill("")
    page.get_by_label("Show").select_option("queued")
    expect(page.get_by_role("heading", name=f"Jobs ({JOBS - 1} of {JOBS})")).to_be_visible()
    assert longest_task(page) < LONGEST_TASK
