"""Takes the pictures of the dashboard's document from a running coordinator.

usage: PYTHONPATH=tests/e2e screens.py URL FOLDER RUNNING_JOB DONE_JOB COMPARED_JOB...
"""

import sys
from pathlib import Path

from conftest import CHROMIUM
from playwright.sync_api import Browser, Page, sync_playwright

WIDE = {"width": 1400, "height": 900}
TALL = {"width": 1400, "height": 1300}
PHONE = {"width": 390, "height": 844}


# What the pages show last.
ROWS = ".job-row .badge"
IMAGE = "#image[data-drawn]"
CHART = ".chart canvas"
SCENE = "input[name=scene]:checked"


def opened(browser: Browser, size: dict[str, int], scheme: str, url: str, last: str) -> Page:
    page = browser.new_page(
        viewport={"width": size["width"], "height": size["height"]},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page.set_default_timeout(120_000)
    page.goto(url)
    page.wait_for_selector("#connection.live")
    page.wait_for_selector(last)
    page.wait_for_function("() => [...document.images].every((image) => image.complete)")
    return page


def look_at_noise(page: Page) -> None:
    page.get_by_label("View", exact=True).select_option(label="Noise")
    page.wait_for_selector("#image[data-drawn^=noise]")


def main() -> None:
    url, folder, running, done, *compared = sys.argv[1:]
    target = Path(folder)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        job = f"{url}/#/jobs/{running}"
        pages = {
            "farm": (WIDE, "light", f"{url}/", ROWS),
            "job": (TALL, "light", job, IMAGE),
            "noise": (WIDE, "dark", f"{url}/#/jobs/{done}", IMAGE),
            "compare": (WIDE, "dark", f"{url}/#/compare/{','.join(compared)}", CHART),
            "submit": (WIDE, "light", f"{url}/#/submit/{running}", SCENE),
            "phone": (PHONE, "dark", job, IMAGE),
            "phone-farm": (PHONE, "light", f"{url}/", ROWS),
        }
        for name, (size, scheme, address, last) in pages.items():
            page = opened(browser, size, scheme, address, last)
            if name == "noise":
                look_at_noise(page)
            page.screenshot(path=target / f"{name}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
