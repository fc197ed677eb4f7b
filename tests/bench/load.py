#!/usr/bin/env python3
"""Measures loading of scenes: bin/metrofarm-worker inspect beside Mitsuba 3's load_file.

usage: load.py [--repetitions N] SCENE.xml...      with .tools/bench/bin/python

Each measurement is a process of its own; repetitions are interleaved (repetition outermost) and
figures are medians. Time of loading is what each program measures around it: here parsing, reading
files and building Embree's structure; there mitsuba.load_file, which does the same (the llvm
variant traces with Embree; scalar_rgb builds a tree of its own). Memory is the peak of resident
memory of the whole process, and what the process takes before it loads anything beside it.
"""

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path

WORKER = Path(__file__).parents[2] / "bin" / "metrofarm-worker"
VARIANTS = ("scalar_rgb", "llvm_ad_rgb")

LOAD = """
import json, resource, sys, time
import mitsuba
mitsuba.set_variant(sys.argv[1])
mitsuba.set_log_level(mitsuba.LogLevel.Error)
mitsuba.load_dict({"type": "scene"})
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before, started, clock = peak(), time.monotonic(), time.process_time()
scene = mitsuba.load_file(sys.argv[2])
print(json.dumps({
    "seconds": time.monotonic() - started,
    "cpu_seconds": time.process_time() - clock,
    "peak_mib": peak(),
    "before_mib": before,
}))
"""

# Runs the program below it, then reports its resources: the children of this process alone.
WATCH = """
import json, resource, subprocess, sys, time
started = time.monotonic()
out = subprocess.run(sys.argv[1:], check=True, capture_output=True, text=True).stdout
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({
    "inspected": json.loads(out),
    "wall_seconds": time.monotonic() - started,
    "cpu_seconds": used.ru_utime + used.ru_stime,
    "peak_mib": used.ru_maxrss / 1024,
}))
"""

Figures = dict[str, float]


def run_json(command: list[str]) -> dict:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{command[-1]}\n{done.stderr}")
    return json.loads(done.stdout)


def ours(scene: str) -> Figures:
    watched = run_json([sys.executable, "-c", WATCH, str(WORKER), "inspect", scene])
    inspected = watched.pop("inspected")
    seconds = inspected["load_seconds"] + inspected["build_seconds"]
    scene_mib = int(inspected["memory_bytes"]) / 2**20
    return {**watched, "seconds": seconds, "scene_mib": scene_mib}


def measure(program: str, scene: str) -> Figures:
    if program == "metrofarm":
        return ours(scene)
    return run_json([sys.executable, "-c", LOAD, program, scene])


def median(runs: list[Figures]) -> Figures:
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description="loading of scenes beside Mitsuba 3")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("scenes", nargs="+")
    arguments = parser.parse_args()
    programs = ("metrofarm", *VARIANTS)
    runs = {(scene, program): [] for scene in arguments.scenes for program in programs}
    for _ in range(arguments.repetitions):
        for scene, program in runs:
            runs[scene, program].append(measure(program, scene))
    for (scene, program), measured in runs.items():
        figures = "  ".join(f"{name} {value:.2f}" for name, value in median(measured).items())
        print(f"{Path(scene).parent.name:16} {program:12} {figures}", flush=True)


if __name__ == "__main__":
    main()
