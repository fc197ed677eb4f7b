#!/usr/bin/env python3
"""What the farm costs and gains (`make farm-cost`): service overhead, checkpoints, scaling.

usage: farm_cost.py [--scene NAME] [--mutations N] [--repetitions N] [--out DIR]

One coordinator with its data on disk, real workers that connect to it, chains at 320 x 180:

- Overhead: CPU time of coordinator and worker per mutation, over that of the bare worker's loop,
  minus 1. It is made of two figures, told apart: the CPU time that the worker's threads spend in
  segments per mutation, over the bare loop's (jobs and bare runs by turns: the machine's speed
  drifts by more than the overhead); and the share of all CPU time that is not spent in segments.
  The share is that of a job of 3 N mutations per pixel less one of N, which removes what a job
  costs once (start, loading, bootstrap, the last image).
- Checkpoints: their CPU time is within the overhead; told apart is the time that writing them
  takes, over the time of rendering.
- Scaling: mutations per second of rendering, of one worker with one thread, one with two and two
  with one each. "At fixed cores" is the last over the middle, "1 to 2" the last over twice the
  first.

Repetitions are interleaved and figures are medians, with lowest and highest.
Writes farm-cost.md and farm-cost.json.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench import ROOT, SCENES, WORKER, machine, run_json

sys.path.insert(0, str(ROOT / "tests" / "e2e"))
from farm import Farm

WIDTH, HEIGHT = 320, 180


@dataclass(frozen=True)
class Task:
    scene: Path
    mutations: int  # per pixel, of a short job; a long one has three times as many

    def request(self, times: int) -> dict[str, Any]:
        # The bench command's chains are those of plain pssmlt.
        return {
            "integrator": "pssmlt",
            "delayed_rejection": "off",
            "width": WIDTH,
            "height": HEIGHT,
            "seed": 7,
            "stop": {"mutations_per_pixel": times * self.mutations},
        }


def cpu_seconds(pid: int) -> float:
    """User and system time of a process and of those of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def metric(farm: Farm, name: str) -> float:
    for line in farm.get("/metrics").body.decode().splitlines():
        if line.startswith(name + " "):
            return float(line.split()[1])
    raise LookupError(f"/metrics does not tell {name}")


@dataclass(frozen=True)
class Cost:
    """Of one job."""

    mutations: int
    cpu_seconds: float  # coordinator and workers
    coordinator_seconds: float
    rendering_seconds: float  # CPU time that the workers' threads tell of segments
    checkpoint_seconds: float
    wall_seconds: float  # of rendering


def run_job(farm: Farm, task: Task, times: int) -> Cost:
    pids = [process.pid for process in (farm.coordinator, *farm.workers.values()) if process]
    before = [cpu_seconds(pid) for pid in pids]
    checkpoints = metric(farm, "metrofarm_checkpoint_seconds_sum")
    rendering = metric(farm, "metrofarm_render_cpu_seconds_total")
    ended = farm.wait(farm.submit(task.scene, **task.request(times)), timeout=1800)
    if ended["state"] != "done":
        sys.exit(f"the job is {ended['state']}: {ended.get('error')}")
    spent = [cpu_seconds(pid) - old for pid, old in zip(pids, before, strict=True)]
    return Cost(
        ended["mutations"],
        sum(spent),
        spent[0],
        metric(farm, "metrofarm_render_cpu_seconds_total") - rendering,
        metric(farm, "metrofarm_checkpoint_seconds_sum") - checkpoints,
        ended["wall_seconds"],
    )


def started(folder: Path, workers: int, threads: int) -> Farm:
    farm = Farm(folder, threads=threads)
    farm.start()
    for number in range(workers):
        farm.start_worker(f"worker-{number}")
    return farm


def bare_rate(task: Task) -> float:
    """Mutations per CPU second of the worker's loop."""
    answer = run_json(
        [
            *(str(WORKER), "bench", str(task.scene), "--integrator", "pssmlt", "--threads", "2"),
            *("--per-pixel", str(task.mutations)),
            *("--width", str(WIDTH), "--height", str(HEIGHT)),
        ]
    )
    return float(answer["samples_per_cpu_second"])


def measure_overhead(task: Task) -> dict[str, float]:
    rates = [bare_rate(task)]
    with tempfile.TemporaryDirectory() as scratch:
        farm = started(Path(scratch), workers=1, threads=2)
        try:
            short = run_job(farm, task, 1)
            rates.append(bare_rate(task))
            long = run_job(farm, task, 3)
        finally:
            farm.close()
    rates.append(bare_rate(task))
    rendering = (short.rendering_seconds + long.rendering_seconds) * statistics.harmonic_mean(rates)
    segments = rendering / (short.mutations + long.mutations)
    spent = long.cpu_seconds - short.cpu_seconds
    outside = 1 - (long.rendering_seconds - short.rendering_seconds) / spent
    return {
        "overhead": segments / (1 - outside) - 1,
        "segments": segments - 1,
        "outside": outside,
        "coordinator": (long.coordinator_seconds - short.coordinator_seconds) / spent,
        "checkpoints": long.checkpoint_seconds / long.wall_seconds,
    }


def measure_scaling(task: Task) -> dict[str, float]:
    rates = {}
    for workers, threads in ((1, 1), (1, 2), (2, 1)):
        with tempfile.TemporaryDirectory() as scratch:
            farm = started(Path(scratch), workers, threads)
            try:
                cost = run_job(farm, task, 1)
            finally:
                farm.close()
        rates[workers, threads] = cost.mutations / cost.wall_seconds
    return {
        "fixed_cores": rates[2, 1] / rates[1, 2],
        "one_to_two": rates[2, 1] / (2 * rates[1, 1]),
    }


NAMES = {
    "overhead": "CPU time beyond the bare worker's",
    "segments": "in segments alone, beyond the bare worker's",
    "outside": "of all CPU time, outside of segments",
    "coordinator": "of all CPU time, the coordinator's",
    "checkpoints": "time of writing checkpoints, of rendering",
    "fixed_cores": "rate of 2 workers with 1 thread, over 1 with 2",
    "one_to_two": "rate of 2 workers, over twice that of 1",
}


def table(task: Task, figures: dict[str, list[float]]) -> str:
    lines = [
        f"{machine()}; {task.scene.parent.name}, pssmlt, {WIDTH} x {HEIGHT}, "
        f"{task.mutations} and {3 * task.mutations} mutations per pixel; "
        f"medians of {len(figures['overhead'])} (lowest to highest)",
        "",
        "| figure | |",
        "| --- | ---: |",
    ]
    for name, text in NAMES.items():
        values = [100 * value for value in figures[name]]
        middle = statistics.median(values)
        lines.append(f"| {text} | {middle:.2f} % ({min(values):.2f} to {max(values):.2f}) |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="What the farm costs and gains")
    parser.add_argument("--scene", default="door-ajar")
    parser.add_argument("--mutations", type=int, default=256)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "bench")
    arguments = parser.parse_args()
    task = Task(SCENES / arguments.scene / "scene.xml", arguments.mutations)
    figures: dict[str, list[float]] = {name: [] for name in NAMES}
    for repetition in range(arguments.repetitions):
        for name, value in (measure_overhead(task) | measure_scaling(task)).items():
            figures[name].append(value)
        print(f"repetition {repetition + 1}/{arguments.repetitions}", file=sys.stderr)
    text = table(task, figures)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "farm-cost.md").write_text(text)
    document = {"machine": machine(), "scene": arguments.scene, "figures": figures}
    (arguments.out / "farm-cost.json").write_text(json.dumps(document, indent=2) + "\n")
    print(text)


if __name__ == "__main__":
    main()
