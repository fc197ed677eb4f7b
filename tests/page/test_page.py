"""The dashboard in a browser, against the real service that renders real scenes."""

import re
import signal
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from farm import METROFARM, SCENES, Farm, zip_folder
from watched import Watched

SCENE = SCENES / "cornell-box" / "scene.xml"
SMALL = {"width": 96, "height": 96, "integrator": "mmlt"}
EXR_MAGIC = bytes([0x76, 0x2F, 0x31, 0x01])
CHART = ".chart >> nth=0"


def points(page: Page) -> int:
    return int(page.locator(CHART).get_attribute("data-points") or "0")


def submit_by_form(page: Page, bundle: Path) -> None:
    page.get_by_role("link", name="New job").first.click()
    page.set_input_files("#bundle", bundle)
    expect(page.locator("input[name=scene]:checked")).to_have_count(1)
    page.select_option("#option-integrator", "mmlt")
    page.fill("[id='option-stop.time_seconds']", "600")
    page.get_by_text("All other options").click()
    page.fill("#option-width", "96")
    page.fill("#option-height", "many")
    page.get_by_role("button", name="Submit").click()
    expect(page.locator(".problem")).to_be_visible()  # many is no height
    page.fill("#option-height", "96")
    page.get_by_role("button", name="Submit").click()
    page.wait_for_url(re.compile("#/jobs/"))


def test_a_job_from_the_form_to_the_file(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    bundle = tmp_path / "scene.zip"
    bundle.write_bytes(zip_folder(SCENE.parent))
    page.goto(farm.url)
    submit_by_form(page, bundle)
    watched.complaints.clear()  # the browser reports the refusal of the wrong height
    watched.wait_for_points(2)
    before, seen = watched.picture("image srgb"), points(page)
    watched.wait_for_points(seen + 1)
    page.wait_for_function(
        """(before) => {
          const canvas = document.querySelector('#image')
          return canvas.dataset.drawn && canvas.toDataURL() !== before
        }""",
        arg=before,
    )
    watched.check_access()

    page.reload()
    watched.wait_for_points(seen + 1)
    assert watched.picture("image srgb") != before

    seen = points(page)
    watched.down = True
    assert farm.coordinator is not None
    farm.coordinator.end(signal.SIGTERM, 60)
    expect(page.locator("#connection")).to_have_text("reconnecting")
    expect(page.locator(".stale")).to_be_visible()
    farm.start()
    expect(page.locator("#connection")).to_have_text("live")
    watched.down = False
    watched.wait_for_points(seen + 1)

    page.get_by_role("button", name="Finish now").click()
    expect(page.locator(".job-head .badge")).to_contain_text("done")
    with page.expect_download() as download:
        page.click("#exr")
    assert Path(download.value.path()).read_bytes()[:4] == EXR_MAGIC


def test_views_of_the_image(farm: Farm, watched: Watched) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 5})
    farm.wait(job)
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    shown = {watched.picture("image srgb 5")}
    for tone, name in (("False color", "false"), ("ACES", "aces")):
        page.get_by_label("Tone").select_option(label=tone)
        shown.add(watched.picture(f"image {name} 5"))
    page.get_by_label("View", exact=True).select_option(label="Noise")
    shown.add(watched.picture("noise false 5"))
    expect(page.locator(".legend")).to_contain_text("relative standard error")
    assert len(shown) == 4
    page.get_by_label("View", exact=True).select_option(label="Difference")
    reference = farm.get(f"/v1/jobs/{job}/image.pfm").body
    files = [{"name": "r.pfm", "mimeType": "image/x-portable-floatmap", "buffer": reference}]
    page.set_input_files(".file input", files)  # of itself, hence no error at all
    expect(page.locator(".legend")).to_contain_text("mean 0")
    page.locator("#image").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator(".readout")).to_contain_text("luminance")
    page.keyboard.press("+")
    watched.check_access()


def test_two_jobs_compared(farm: Farm, watched: Watched) -> None:
    jobs = [
        farm.submit(SCENE, **SMALL, stop={"rounds": 4}, delayed_rejection=choice, name=choice)
        for choice in ("off", "on")
    ]
    page = watched.page
    page.goto(farm.url)
    for name in ("off", "on"):
        page.get_by_label(f"Compare {name}", exact=True).check()
    page.get_by_role("link", name="Compare 2").click()
    watched.wait_for_points(4)
    for job in jobs:
        farm.wait(job)
    expect(page.locator(".scrolled tbody tr")).to_have_count(2)
    expect(page.locator("tbody .badge.done")).to_have_count(2)
    expect(page.locator(".u-legend")).to_contain_text("off")
    expect(page.locator(".u-legend")).to_contain_text("on")
    watched.check_access()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone(farm: Farm, watched: Watched, scheme: str) -> None:
    job = farm.submit(SCENE, **SMALL, stop={"rounds": 1})
    farm.wait(job)
    page = watched.page
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    page.set_viewport_size({"width": 390, "height": 844})
    pages = {  # with what each shows last
        "/": ".job-row .badge.done",
        f"/#/jobs/{job}": "#image[data-drawn]",
        "/#/submit": "input[name=scene]",
        f"/#/compare/{job}": ".chart[data-points='1'] canvas",
    }
    for path, last in pages.items():
        page.goto(farm.url + path)
        expect(page.locator("#connection")).to_have_text("live")
        page.wait_for_selector(last)
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= 390, f"{path} is {wide} pixels wide"
        watched.check_access()


TOO_BRIGHT = """<scene version="3.0.0">
  <sensor type="perspective"/>
  <emitter type="constant"><rgb name="radiance" value="3e38"/></emitter>
  <shape type="sphere"><point name="center" x="0" y="0" z="9"/></shape>
</scene>"""


def test_a_fault_can_be_repeated(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    scene = tmp_path / "bright" / "scene.xml"
    scene.parent.mkdir()
    scene.write_text(TOO_BRIGHT)
    job = farm.submit(scene, width=64, height=64, integrator="path", stop={"rounds": 1})
    first = farm.wait(job)
    assert first["anomalies"]["infinite"] > 0
    page = watched.page
    page.goto(f"{farm.url}/#/jobs/{job}")
    card = page.locator(".card").filter(has_text="Anomalies")
    expect(card).to_contain_text("primary sample")
    watched.check_access()
    # A copy of the page's words, but for the program and the scene.
    commands = card.locator("pre").inner_text().replace("metrofarm submit SCENE", '"$@"')
    subprocess.run(
        ["sh", "-ec", commands, "sh", METROFARM, "submit", scene], cwd=tmp_path, check=True
    )
    copy = farm.get("/v1/jobs").json()["jobs"][0]["id"]
    assert copy != job
    second = farm.wait(copy)
    assert second["film_sha256"] == first["film_sha256"]
    # Without those of the preparation, whose results the resolved spec has.
    assert 0 < second["anomalies"]["infinite"] <= first["anomalies"]["infinite"]
