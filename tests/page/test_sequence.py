"""A sequence in the dashboard: its frames as they come."""

import re

from playwright.sync_api import expect

from farm import SCENES, Farm, zip_folder
from watched import Watched


def test_a_sequence_fills_with_its_frames(farm: Farm, watched: Watched) -> None:
    digest = farm.upload(zip_folder(SCENES / "cornell-box")).json()["digest"]
    stop = {"samples_per_pixel": 16}
    small = {"integrator": "path", "width": 32, "height": 24, "name": "film", "stop": stop}
    document = {
        "job": {"scene": digest, "entry": "scene.xml", **small},
        "frames": {"start": 9, "end": 11},
    }
    answer = farm.post("/v1/sequences", document)
    assert answer.status == 201, answer.body
    page = watched.page
    page.goto(farm.url)
    page.get_by_role("link", name="sequence", exact=True).first.click()
    page.wait_for_url(re.compile("#/sequences/" + answer.json()["id"]))
    expect(page.locator(".card h2")).to_have_text("film: 3 of 3 done")
    pictures = page.locator(".strip img")
    expect(pictures).to_have_count(3)
    alternatives = pictures.evaluate_all("images => images.map((image) => image.alt)")
    assert alternatives == ["Frame 9", "Frame 10", "Frame 11"]
    page.wait_for_function(
        "() => [...document.querySelectorAll('.strip img')].every((image) => image.naturalWidth)"
    )
    watched.check_access()
    page.locator(".strip a").nth(1).click()
    page.wait_for_url(re.compile("#/jobs/" + answer.json()["frames"][1]["job"]))
