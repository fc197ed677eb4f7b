"""The proxy's journal: what was done to deliveries and what coordinators said."""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HARMLESS = ("duplicate", "superseded")
REFUSED = ("rejected", "conflict")


@dataclass
class Record:
    """One message to a coordinator; see entry in proxy/journal.go."""

    time: float
    sent: float
    number: int
    call: str
    fault: str
    step: str
    upstream: str
    job: str
    worker: str
    round: int
    outcome: str
    detail: str = ""
    message: str = ""
    task: str = ""
    segments: tuple[int, ...] = ()


def read_journal(path: Path) -> list[Record]:
    return [Record(**json.loads(line)) for line in path.read_text().splitlines()]


def tally(records: Iterable[Record]) -> dict[tuple[str, str, str, str], int]:
    """How often each fault at each step of a call had which answer."""
    return dict(
        sorted(
            Counter((r.call, r.fault, r.step, r.outcome or "no answer") for r in records).items()
        )
    )


def wrongly_taken(records: list[Record]) -> list[Record]:
    """Damaged deliveries that were taken: nothing may ever be."""
    return [
        r for r in records if r.step == "damaged" and r.outcome not in (*REFUSED, "superseded", "")
    ]


def counted_again(records: list[Record], upheavals: list[float]) -> list[Record]:
    """Copies that were taken although nothing was lost between the first answer and theirs. When a
    coordinator or the store was killed meanwhile, the first may be lost with it, as no checkpoint
    had it yet; then the copy is taken in its place."""
    first = {r.number: r.time for r in records if r.step == "intact"}
    return [
        r
        for r in records
        if r.step == "copy"
        and r.outcome not in (*HARMLESS, "")
        and not any(first[r.number] - UNSURE < t < r.time for t in upheavals)
    ]


# A coordinator that was killed lost what it counted since its last checkpoint, and is missed for as
# long as its ownership lasts: what was answered so long before or after is unsure.
UNSURE = 20.0
