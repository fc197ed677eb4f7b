"""A page whose complaints are kept."""

import json
import re
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import ConsoleMessage, Page

from farm import ROOT

AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
# What the browser says of a server that does not answer, or whose proxy does for it.
ANSWERS_OF_NOBODY = re.compile("ERR_|status of 50[234]")
MISSING = re.compile("status of 404")
# Seconds within which what should come at once must come.
PATIENCE = 60


class Watched:
    """A page whose complaints are kept.

    While the server is down, failing requests are no news; nor is it, at any time, that there is
    nothing of a job which was deleted under the page's eyes.
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.down = False
        self.deleted: set[str] = set()
        page.set_default_timeout(120_000)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("console", self._note)

    def _note(self, message: ConsoleMessage) -> None:
        if message.type not in ("error", "warning"):
            return
        if self.down and ANSWERS_OF_NOBODY.search(message.text):
            return
        source = message.location["url"]
        if MISSING.search(message.text) and any(
            f"/v1/jobs/{job}" in source for job in self.deleted
        ):
            return
        self.complaints.append(f"{message.text} ({source})")

    def wait_for_points(self, at_least: int) -> None:
        """Until the curve of the error has so many points."""
        self.page.wait_for_function(
            "(n) => Number(document.querySelector('.chart')?.dataset.points ?? 0) >= n",
            arg=at_least,
        )

    def picture(self, drawn: str) -> str:
        """The canvas once it shows what begins so: view, tone and round, as "image srgb 5"."""
        shown = self.page.wait_for_function(
            """(drawn) => {
              const canvas = document.querySelector('#image')
              return canvas?.dataset.drawn?.startsWith(drawn) ? canvas.toDataURL() : null
            }""",
            arg=drawn,
        )
        return str(shown.json_value())

    def images_asked_for(self) -> int:
        """How many images of a job's film the page asked for."""
        return sum(url.endswith("image.pfm?layer=color") for url in self.requests)

    def elsewhere(self) -> list[str]:
        """Requests to anybody but this machine."""
        return [url for url in self.requests if urlsplit(url).hostname not in (None, "127.0.0.1")]

    def check_access(self) -> None:
        """axe finds nothing that it calls serious or critical."""
        self.page.evaluate(AXE.read_text())
        found: list[dict[str, Any]] = self.page.evaluate("axe.run().then((r) => r.violations)")
        serious = [
            {"rule": v["id"], "nodes": [n["html"][:200] for n in v["nodes"]]}
            for v in found
            if v["impact"] in ("serious", "critical")
        ]
        assert not serious, json.dumps(serious, indent=1)
