"""A browser for the tests of the dashboard, and farms that are gone when their tests end."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from farm import Farm
from watched import PATIENCE, Watched

CHROMIUM = "/usr/bin/chromium"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--heap-minutes",
        type=float,
        default=0.5,
        help="how long to watch the heap of a running job",
    )


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium, without a window."""
    expect.set_options(timeout=1000 * PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM,
            args=["--no-sandbox"],
        )
        yield browser
        browser.close()


@pytest.fixture
def watched(browser: Browser) -> Iterator[Watched]:
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, accept_downloads=True)
    watched = Watched(context.new_page())
    yield watched
    context.close()
    assert not watched.complaints
    assert not watched.elsewhere()


@pytest.fixture
def farm(tmp_path: Path) -> Iterator[Farm]:
    """A coordinator with one local worker."""
    farm = Farm(tmp_path, local_workers=1)
    farm.start()
    yield farm
    farm.close()
