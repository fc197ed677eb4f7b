"""What people change by the page: jobs, workers, and who they are."""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, Route, expect

from farm import SCENES, Farm, run
from watched import PATIENCE, Watched

SCENE = SCENES / "cornell-box" / "scene.xml"
SMALL = {"width": 96, "height": 96, "integrator": "mmlt"}


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[tuple[Farm, dict[str, str]]]:
    """A coordinator that asks for tokens, and a token of each role."""
    tokens, lines = {}, []
    for role in ("read", "submit", "admin"):
        made = run("token", role, f"{role}er")
        token, line = made.stdout.split("\n")[:2]
        tokens[role] = token
        lines.append(line)
    file = tmp_path / "tokens"
    file.write_text("\n".join(lines) + "\n")
    file.chmod(0o600)
    farm = Farm(tmp_path, options=("--tokens", str(file)))
    farm.start()
    farm.start_worker("anvil")
    yield farm, tokens
    farm.close()


def sign_in(page: Page, token: str) -> None:
    page.fill("#token", token)
    page.get_by_role("button", name="Sign in").click()


def test_signing_in(guarded: tuple[Farm, dict[str, str]], watched: Watched) -> None:
    farm, tokens = guarded
    page = watched.page
    page.goto(farm.url)
    expect(page.locator("#login")).to_be_visible()
    watched.check_access()
    sign_in(page, "mf_wrong")
    expect(page.locator("#login [role=alert]")).to_be_visible()
    expect(page.get_by_text("anvil")).to_have_count(0)
    sign_in(page, tokens["read"])
    expect(page.locator("#login")).to_be_hidden()
    expect(page.locator(".user")).to_contain_text("reader")
    expect(page.get_by_role("button", name="Drain anvil")).to_be_disabled()
    page.get_by_role("link", name="New job").first.click()
    expect(page.get_by_role("button", name="Submit")).to_be_disabled()
    page.reload()  # the session outlives it
    expect(page.locator(".user")).to_contain_text("reader")
    assert tokens["read"] not in page.evaluate("JSON.stringify(localStorage) + document.cookie")

    page.get_by_role("button", name="Sign out").click()
    expect(page.locator("#login")).to_be_visible()
    sign_in(page, tokens["admin"])
    page.get_by_role("link", name="Farm", exact=True).click()
    expect(page.get_by_role("button", name="Drain anvil")).to_be_enabled()
    watched.complaints.clear()  # the browser reports each 401


def test_draining_a_worker(farm: Farm, watched: Watched) -> None:
    farm.start_worker("anvil")
    page = watched.page
    page.goto(farm.url)
    row = page.get_by_role("row").filter(has_text="anvil")
    expect(row).to_contain_text("idle")
    page.get_by_role("button", name="Drain anvil").click()
    expect(page.get_by_role("row").filter(has_text="anvil")).to_have_count(0)
    expect(page.get_by_role("row").filter(has_text="local-1")).to_have_count(1)
    # The program ends by itself, having said that it leaves.
    assert farm.workers["anvil"].wait(60) == 0


def test_refining(farm: Farm, watched: Watched) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 3})
    fresh = farm.submit(SCENE, **SMALL, stop={"rounds": 5})
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.locator(".job-head .badge")).to_contain_text("done")
    page.get_by_role("button", name="Refine").click()
    page.get_by_label("Go on until").select_option("rounds")
    page.get_by_label("Value of the rule").fill("2")
    page.get_by_role("button", name="Go on").click()
    expect(page.locator(".message")).to_contain_text("rounds")  # which are fewer than there are
    watched.complaints.clear()  # the browser reports the refusal
    page.get_by_role("button", name="Dismiss").click()
    page.get_by_role("button", name="Refine").click()
    page.get_by_label("Go on until").select_option("rounds")
    page.get_by_label("Value of the rule").fill("5")
    page.get_by_role("button", name="Go on").click()
    watched.wait_for_points(5)
    expect(page.locator(".job-head .badge")).to_contain_text("done")
    expect(page.locator("ol.log")).to_contain_text("refine")
    assert farm.wait(job)["film_sha256"] == farm.wait(fresh)["film_sha256"]


def wait_until_quiet(farm: Farm, watched: Watched, job: str) -> None:
    """Until a paused job's last segments are in and the page shows its last round."""

    def busy() -> bool:
        workers = farm.get("/v1/workers").json()["workers"]
        if any(worker["leased_segments"] for worker in workers):
            return True
        snapshot = farm.job(job)  # a round with all its segments is about to be closed
        return bool(snapshot["round_segments_done"] == snapshot["round_segments"] > 0)

    deadline = time.monotonic() + PATIENCE
    while busy():
        assert time.monotonic() < deadline, "the segments of a paused job do not end"
        time.sleep(0.1)
    snapshot = farm.job(job)
    rounds, state = snapshot["rounds_done"], snapshot["state"]
    if rounds > 0:
        watched.picture(f"image srgb {rounds}")
    told = f"round {rounds + 1}" if state == "rendering" else state
    expect(watched.page.locator("#progress-text")).to_contain_text(told)


def requests_of_a_while(watched: Watched, seconds: int) -> list[str]:
    """What the page asks for on its own account while its clock goes on so far at once."""
    asked = len(watched.requests)
    watched.page.clock.fast_forward(1000 * seconds)
    watched.page.evaluate("() => fetch('/healthz')")  # comes after whatever was asked before it
    *own, last = watched.requests[asked:]
    assert last.endswith("/healthz")
    return own


def test_pause_priority_clone_and_keys(farm: Farm, watched: Watched) -> None:
    job = farm.submit(SCENE, **SMALL, name="first", stop={"time_seconds": 600})
    page = watched.page
    page.clock.install()
    page.goto(farm.url)
    link = page.get_by_role("link", name="first", exact=True)
    link.focus()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Pause").click()
    expect(page.locator(".job-head .badge")).to_contain_text("paused")
    page.get_by_label("Priority").fill("7")
    page.keyboard.press("Tab")
    expect(page.locator("ol.log")).to_contain_text("priority changed from 0 to 7")
    assert farm.job(job)["request"]["priority"] == 7

    wait_until_quiet(farm, watched, job)
    # Less than the silence after which a stream counts as lost.
    assert requests_of_a_while(watched, 20) == [], "the page asks although nothing happens"
    streams = [url for url in watched.requests if url.endswith(f"/{job}/events")]
    assert len(streams) == 1

    page.get_by_role("button", name="Resume").click()
    page.get_by_role("link", name="Clone").click()
    expect(page.locator("#option-name")).to_have_value("first")
    expect(page.locator("[id='option-stop.time_seconds']")).to_have_value("600")
    watched.check_access()
    page.fill("#option-name", "second")
    page.fill("[id='option-stop.target_error']", "0.0001")
    page.fill("#option-priority", "0")  # so that it waits until the first is canceled
    page.get_by_role("button", name="Submit").click()
    expect(page.locator("h1")).to_have_text("second")
    expect(page.locator("#estimate")).to_contain_text("told after round 2")
    farm.post(f"/v1/jobs/{job}/cancel")
    expect(page.locator("#estimate")).to_contain_text(re.compile("target 0.0001 in about .* to "))
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".job-head .badge")).to_contain_text("canceled")
    request = farm.job(page.url.rpartition("/")[2])["request"]
    assert request["name"] == "second"
    assert request["stop"] == {**farm.job(job)["request"]["stop"], "target_error": 0.0001}


def test_a_bundle_that_is_dropped(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    page.goto(f"{farm.url}/#/submit")
    text = "<scene version='3.0.0'/>"
    page.wait_for_selector(".drop")
    page.evaluate(
        """(text) => {
          const files = new DataTransfer()
          files.items.add(new File([text], 'scene.zip'))
          document.querySelector('.drop').dispatchEvent(
            new DragEvent('drop', { dataTransfer: files, bubbles: true, cancelable: true }))
        }""",
        text,
    )
    expect(page.locator(".drop output")).to_contain_text("archive")  # which this is not
    watched.complaints.clear()
    expect(page.locator("input[name=scene]:checked")).to_have_count(0)


def test_a_picture_tells_its_own_round(farm: Farm, watched: Watched) -> None:
    """The job goes on between the news of a round and the answer with the image."""
    job = farm.submit(SCENE, **SMALL, stop={"time_seconds": 600})
    page, asked = watched.page, []

    def late(route: Route) -> None:
        asked.append(farm.job(job)["rounds_done"])
        if len(asked) == 1:  # what is asked for after that could mend a wrong label
            farm.wait_for_rounds(job, asked[0] + 2)
            farm.post(f"/v1/jobs/{job}/finish")
            farm.wait(job)
            route.continue_()

    page.route("**/image.pfm*", late)
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.locator(".job-head .badge")).to_contain_text("done")
    ended = farm.job(job)
    assert asked[0] < ended["rounds_done"]
    watched.picture(f"image srgb {ended['rounds_done']}")
    title = page.locator(".card.image h2")
    expect(title).to_contain_text(
        re.compile(f"^Image after round {ended['rounds_done']}, .* mutations$")
    )


def test_what_cannot_be_read_is_read_again(farm: Farm, watched: Watched) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 2})
    farm.wait(job)
    page = watched.page
    failing = {"image.pfm": 2, "convergence": 2, "plan": 2}

    def refuse(route: Route) -> None:
        kind = route.request.url.partition("?")[0].rpartition("/")[2]
        failing[kind] -= 1
        if failing[kind] >= 0:
            route.fulfill(status=503, json={"detail": "try again"})
        else:
            route.continue_()

    for kind in failing:
        page.route(f"**/v1/jobs/{job}/{kind}*", refuse)
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.locator(".stale")).to_contain_text("Could not read")
    watched.picture("image srgb 2")
    watched.wait_for_points(2)
    expect(page.locator(".plan")).to_be_visible()
    expect(page.locator(".stale")).to_have_count(0)
    expect(page.locator(".message")).to_have_count(0)
    assert max(failing.values()) < 0, failing
    watched.complaints.clear()  # the browser reports each refusal


def test_jobs_that_are_deleted_elsewhere(farm: Farm, watched: Watched) -> None:
    """Ended before the page was opened: no stream of jobs under way tells of them."""
    jobs = {name: farm.submit(SCENE, **SMALL, name=name, stop={"rounds": 1}) for name in "abc"}
    for job in jobs.values():
        farm.wait(job)
    watched.deleted.update((jobs["a"], jobs["b"]))
    page = watched.page
    page.goto(farm.url)
    expect(page.locator(".job-row:not(.head)")).to_have_count(3)
    page.get_by_label("Compare a", exact=True).check()
    assert farm.request("DELETE", f"/v1/jobs/{jobs['a']}").status == 204
    expect(page.get_by_role("link", name="a", exact=True)).to_have_count(0)
    expect(page.locator(".job-row:not(.head)")).to_have_count(2)
    page.get_by_role("link", name="b", exact=True).click()
    watched.picture("image srgb 1")
    assert farm.request("DELETE", f"/v1/jobs/{jobs['b']}").status == 204
    expect(page.locator("#deleted")).to_be_visible()
    expect(page.get_by_role("button", name="Refine")).to_have_count(0)
    watched.check_access()
    page.get_by_role("link", name="Farm", exact=True).click()
    expect(page.locator(".job-row:not(.head)")).to_have_count(1)


@pytest.mark.parametrize("kind", ["plan", "image.pfm"])
def test_a_job_that_is_deleted_while_it_is_read(farm: Farm, watched: Watched, kind: str) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 1})
    farm.wait(job)
    watched.deleted.add(job)
    page = watched.page

    def late(route: Route) -> None:
        farm.request("DELETE", f"/v1/jobs/{job}")
        route.continue_()

    page.route(f"**/v1/jobs/{job}/{kind}*", late)
    # What tells of the deletion otherwise is silent, so that the answer alone has to.
    page.route(f"**/v1/jobs/{job}/events*", lambda route: route.abort())
    watched.down = True
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.locator("#deleted")).to_be_visible()
    expect(page.locator(".message")).to_have_count(0)


def test_a_job_that_is_refined_elsewhere(farm: Farm, watched: Watched) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 1})
    farm.wait(job)
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    watched.picture("image srgb 1")
    assert farm.post(f"/v1/jobs/{job}/refine", {"rounds": 3}).status == 200
    watched.picture("image srgb 3")
    watched.wait_for_points(3)
    expect(page.locator(".job-head .badge")).to_contain_text("done")
