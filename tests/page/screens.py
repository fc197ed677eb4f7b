"""Takes the pictures of the dashboard's document from a running coordinator.

usage: screens.py URL FOLDER RUNNING_JOB DONE_JOB COMPARED_JOB...
"""

import sys
from pathlib import Path

from conftest import CHROMIUM
from playwright.sync_api import Browser, Page, sync_playwright

WIDE = {"width": 1400, "height": 900}
TALL = {"width": 1400, "height": 1300}
PHONE = {"width": 390, "height": 844}


def opened(browser: Browser, size: dict[str, int], scheme: str, url: str) -> Page:
    page = browser.new_page(
        viewport={"width": size["width"], "height": size["height"]},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page.goto(url)
    page.set_default_timeout(120_000)
    page.wait_for_timeout(4000)
    page.wait_for_function("() => !document.body.innerText.includes('Reading the image')")
    page.wait_for_function("() => [...document.images].every((image) => image.complete)")
    page.wait_for_timeout(1000)
    return page


def look_at_noise(page: Page) -> None:
    page.get_by_label("View", exact=True).select_option(label="Noise")
    page.get_by_text("relative standard error").wait_for()


def main() -> None:
    url, folder, running, done, *compared = sys.argv[1:]
    target = Path(folder)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        pages = {
            "farm": (WIDE, "light", f"{url}/"),
            "job": (TALL, "light", f"{url}/#/jobs/{running}"),
            "noise": (WIDE, "dark", f"{url}/#/jobs/{done}"),
            "compare": (WIDE, "dark", f"{url}/#/compare/{','.join(compared)}"),
            "submit": (WIDE, "light", f"{url}/#/submit/{running}"),
            "phone": (PHONE, "dark", f"{url}/#/jobs/{running}"),
            "phone-farm": (PHONE, "light", f"{url}/"),
        }
        for name, (size, scheme, address) in pages.items():
            page = opened(browser, size, scheme, address)
            if name == "noise":
                look_at_noise(page)
            page.screenshot(path=target / f"{name}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
