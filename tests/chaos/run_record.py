"""What a run with kills was like, as JSON and as a page."""

import json
import statistics
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from killer import Kill
from orders import Order, result_of
from records import read_journal, tally
from stage import Stage


@dataclass
class Run:
    seed: int
    started: float
    ended: float
    kills: list[Kill]
    orders: list[Order]
    stage: Stage


def document_of(run: Run, references: dict[str, dict[str, Any]]) -> dict[str, Any]:
    done = [o for o in run.orders if o.done]
    same = [o for o in done if result_of(o.snapshot) == references[o.kind]]
    seconds = [o.done - o.accepted for o in done] or [0.0]
    return {
        "seed": run.seed,
        "seconds": round(run.ended - run.started, 1),
        "kills": {
            "all": sum(k.when > 0 for k in run.kills),
            "by_victim": dict(sorted(Counter(k.victim for k in run.kills if k.when).items())),
        },
        "jobs": {
            "accepted": len(run.orders),
            "submissions": sum(o.tries for o in run.orders),
            "done": len(done),
            "as_undisturbed": len(same),
            "by_kind": dict(sorted(Counter(o.kind for o in run.orders).items())),
            "median_seconds": round(
                statistics.median([o.done - o.accepted for o in done] or [0]), 1
            ),
            "longest_seconds": round(max(seconds), 1),
        },
        "undisturbed": {kind: result["film_sha256"] for kind, result in references.items()},
        "messages": [
            {"call": call, "fault": fault, "step": step, "answer": answer, "times": times}
            for (call, fault, step, answer), times in tally(read_journal(run.stage.journal)).items()
        ],
        "schedule": [
            {"at": round(k.when - run.started, 2), **asdict(k)} for k in run.kills if k.when
        ],
    }


def write(run: Run, references: dict[str, dict[str, Any]], path: Path | None) -> None:
    if path is None:
        return
    document = document_of(run, references)
    path.parent.mkdir(parents=True, exist_ok=True)
    for kill in document["schedule"]:
        del kill["when"], kill["back"]
        kill["pause"], kill["away"] = round(kill["pause"], 2), round(kill["away"], 2)
    path.with_suffix(".json").write_text(json.dumps(document, indent=1) + "\n")
    path.with_suffix(".md").write_text(page_of(document))


def page_of(d: dict[str, Any]) -> str:
    kills, jobs = d["kills"], d["jobs"]
    lines = [
        "# A run of the chaos test",
        "",
        f"`make chaos CHAOS_ARGS='--seed {d['seed']}'`: Redis, coordinators and workers",
        f"are killed (SIGKILL) and come back; {d['seconds']} s.",
        "",
        "| | |",
        "| --- | --- |",
        f"| kills | {kills['all']}: "
        + ", ".join(f"{victim} {n}" for victim, n in kills["by_victim"].items()),
        f"| jobs accepted | {jobs['accepted']}, by {jobs['submissions']} submissions with keys",
        f"| jobs done | {jobs['done']}",
        f"| film, counts and b as undisturbed | {jobs['as_undisturbed']}",
        f"| seconds per job | median {jobs['median_seconds']}, longest {jobs['longest_seconds']}",
        "",
        "What the proxy did to messages and what coordinators answered. `intact` is a message as",
        "the worker sent it, `copy` the same once more, `stale` one whose leases had run out.",
        "No answer: the coordinator was dead or away, or did not know the worker yet.",
        "",
        "| call | fault | message | answer | times |",
        "| --- | --- | --- | --- | --- |",
    ]
    for m in d["messages"]:
        lines.append(f"| {m['call']} | {m['fault']} | {m['step']} | {m['answer']} | {m['times']} |")
    lines = [
        line + " |" if line.startswith("|") and not line.endswith("|") else line for line in lines
    ]
    return "\n".join(lines) + "\n"
