#!/usr/bin/env python3
"""The long form of the load test: where one coordinator saturates, and whether its memory is flat.

usage: load.py [--workers N...] [--seconds S] [--parts PART...]     writes doc/load.{md,json,png}

A real worker renders door-ajar at several sizes; its batches are recorded, and delivered again by
simulated workers that speak the real protocol and render nothing. CPU seconds are beside all wall
times: the machine that runs this may do other work, too.
"""

import argparse
import functools
import itertools
import json
import math
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from load_report import write_report
from loading import ROOT, LoadedFarm, accepted, build, farmload, growth, noise, queue_up

SIZES = {"540p": (960, 540), "1080p": (1920, 1080), "4K": (3840, 2160)}
# Sizes whose limits are measured; the smallest is for memory.
LIMITED = ["1080p", "4K"]
PARTS = ["machine", "limits", "crowd", "sweep", "memory"]
# Batches of the real worker are added up to one that took about as long to render as a worker's
# batches are meant to take (kSeconds in worker/rpc/batch_size.h), on one thread.
RENDER_SECONDS = 1.5
RECORDED = 32
# Of a batch: 400 workers then hold no more than the segments of a round.
SEGMENTS = 4
# Of the run that watches memory, at 540p: rounds close several times a minute, and the job lasts.
FEW_CHAINS = 32768
# Then all films of a job exist, and light is everywhere in them.
ROUNDS_BEFORE = 3


def machine() -> dict[str, Any]:
    commit = ["git", "describe", "--always", "--dirty"]
    models = [
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": subprocess.check_output(commit, cwd=ROOT, text=True).strip(),
        "cpu": models[0],
        "cores": os.cpu_count(),
        "memory_bytes": os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
        "kernel": platform.release(),
        "go": subprocess.check_output(["go", "env", "GOVERSION"], text=True).strip(),
        "load_average_before": os.getloadavg()[0],
    }


@dataclass
class Film:
    """A recording, and how many of its batches make one of a simulated worker."""

    path: Path
    sum: int = 1

    def options(self) -> list[str]:
        return ["-sum", str(self.sum)]


def enough(batches: list[dict[str, Any]]) -> int:
    seconds = itertools.accumulate(b["render_cpu_seconds"] for b in batches)
    return next((n for n, s in enumerate(seconds, 1) if s >= RENDER_SECONDS), len(batches))


def record(folder: Path, name: str) -> Film:
    film = Film(folder / f"{name}.rec")
    studio = LoadedFarm(folder / f"studio-{name}")
    try:
        film.sum = enough(studio.record(film.path, *SIZES[name], RECORDED))
    finally:
        studio.close()
    return film


def measure_limits(film: Film) -> Any:
    return farmload("limits", "-film", film.path, *film.options())


def step(loaded: LoadedFarm, film: Film, workers: int, seconds: int, render: str) -> dict[str, Any]:
    """One number of workers: a warm-up of half a rendering time, then what they deliver."""
    warmup = f"{max(seconds // 2, 5)}s"
    options = ["-workers", str(workers), "-render", render, "-for", f"{seconds}s"]
    options += ["-segments", str(SEGMENTS)]
    result = loaded.load(film.path, *film.options(), "-warmup", warmup, *options)
    result["accepted"] = accepted(result)
    result["batches_per_second"] = result["accepted"] / result["seconds"]
    lease = result["latency_seconds"].get("Lease", {"p99": math.nan})  # on a machine that starves
    print(
        f"{workers} workers: {result['batches_per_second']:.2f} batches/s, "
        f"{result['cpu_seconds_per_batch']:.3f} CPU s each, "
        f"lease p99 {lease['p99']:.3f} s, peak {result['peak_rss'] / 1e9:.2f} GB",
        flush=True,
    )
    return result


def sweep(folder: Path, film: Film, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    loaded = LoadedFarm(folder / "sweep")
    try:
        job = loaded.submit_long(*SIZES["1080p"])
        steps = []
        for workers in arguments.workers:
            result = step(loaded, film, workers, arguments.seconds, arguments.render)
            del result["samples"]
            steps.append(result)
            assert loaded.farm.job(job)["state"] == "rendering", loaded.farm.job(job)
        return steps
    finally:
        loaded.close()


def watch_memory(folder: Path, film: Film, seconds: int) -> dict[str, Any]:
    """Memory over several minutes at saturation; the samples are kept for the plot."""
    loaded = LoadedFarm(folder / "memory")
    try:
        job = loaded.submit_long(*SIZES["540p"], chains=FEW_CHAINS)
        while (rounds := loaded.farm.job(job)["rounds_done"]) < ROUNDS_BEFORE:
            step(loaded, film, 50, 20, "5s")
            assert loaded.farm.job(job)["state"] == "rendering", loaded.farm.job(job)
        result = step(loaded, film, 50, seconds, "5s")
        samples = result.pop("samples")
        start = samples[0].seconds
        for name in ("rss", "live"):
            sizes = [(round(s.seconds - start, 1), float(getattr(s, name))) for s in samples[::4]]
            result[f"{name}_growth"], result[f"{name}_noise"] = growth(sizes), noise(sizes)
            result[name] = sizes
        result["rounds_before"] = rounds
        after = loaded.farm.job(job)
        assert after["state"] == "rendering", after
        result["rounds_after"] = after["rounds_done"]
        result["machine"] = machine()
        return result
    finally:
        loaded.close()


def measure_crowd(folder: Path, film: Film) -> dict[str, Any]:
    loaded = LoadedFarm(folder / "crowd")
    try:
        loaded.submit_long(*SIZES["1080p"])
        with ExitStack() as stack:
            crowd = queue_up(stack, loaded, jobs=1000, clients=200)
            loaded.load(
                film.path, "-workers", "4", "-render", "100ms", "-warmup", "0s", "-for", "10s"
            )
            result = loaded.load(film.path, "-workers", "20", "-render", "10s", "-for", "30s")
        return crowd | {"latency_seconds": result["latency_seconds"]}
    finally:
        loaded.close()


def main() -> None:
    parser = argparse.ArgumentParser(description="load of one coordinator")
    parser.add_argument("--workers", type=int, nargs="+", default=[10, 50, 100, 200, 400])
    parser.add_argument(
        "--seconds", type=int, default=60, help="counted for each number of workers"
    )
    parser.add_argument("--memory-seconds", type=int, default=240)
    parser.add_argument("--render", default="20s", help="from a lease to its batch")
    parser.add_argument("--folder", type=Path, help="of the farms' data; default: a temporary one")
    parser.add_argument(
        "--parts",
        nargs="+",
        choices=PARTS,
        default=PARTS,
        help="others stay as they are in load.json",
    )
    arguments = parser.parse_args()
    build()
    folder = Path(tempfile.mkdtemp(dir=arguments.folder))
    doc = Path(__file__).parent / "doc"
    figures = json.loads((doc / "load.json").read_text()) if arguments.parts != PARTS else {}
    try:
        film = functools.cache(functools.partial(record, folder))
        measures: dict[str, Callable[[], Any]] = {
            "machine": machine,
            "limits": lambda: {name: measure_limits(film(name)) for name in LIMITED},
            "crowd": lambda: measure_crowd(folder, film("1080p")),
            "sweep": lambda: sweep(folder, film("1080p"), arguments),
            "memory": lambda: watch_memory(folder, film("540p"), arguments.memory_seconds),
        }
        figures |= {part: measures[part]() for part in arguments.parts}
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    doc.mkdir(exist_ok=True)
    (doc / "load.json").write_text(json.dumps(figures, indent=1) + "\n")
    write_report(figures, doc)
    memory = figures["memory"]
    if memory["live_growth"] > memory["live_noise"]:
        raise SystemExit("memory grows, see doc/load.md")


if __name__ == "__main__":
    main()
