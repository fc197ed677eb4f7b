#!/usr/bin/env python3
"""Measures bin/metrofarm beside Mitsuba 3 in one run (`make bench`).

usage: bench.py [--repetitions N] [--scenes NAME,...] [--out DIR]

- Plain path tracing in samples per CPU second of the render loop, on scenes both can read:
  Metrofarm, Mitsuba scalar_rgb and llvm_ad_rgb, same size, same depth.
- Rays per CPU second of the worker beside the same rays on bare Embree; mutations per CPU second.
- What the service costs: mutations per CPU second through coordinator and REST-side merging beside
  the worker alone.

Repetitions are interleaved (repetition outermost), figures are medians, and time is CPU time of all
threads, because other programs may run on the machine. Scene load, compilation and the first pass
of Mitsuba's just-in-time compiler are not counted.
Writes bench.md and bench.json.
"""

import argparse
import json
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "tests" / "scenes"
METROFARM = ROOT / "bin" / "metrofarm"
WORKER = ROOT / "bin" / "metrofarm-worker"
SIZE = 256
THREADS = 2


@dataclass(frozen=True)
class Scene:
    name: str
    # Samples per pixel of one measurement; mutations per pixel are four times that.
    spp: int

    @property
    def path(self) -> Path:
        return SCENES / self.name / "scene.xml"


BENCH_SCENES = [
    Scene("shared-cornell-box", 64),
    Scene("shared-veach-mis", 128),
    Scene("peer-cornell-diffuse", 128),
    Scene("peer-veach-mis", 128),
    Scene("peer-veach-door", 32),
]


def run_json(command: list[str]) -> Any:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads(done.stdout)


def worker_alone(scene: Scene, integrator: str, per_pixel: int) -> dict[str, float]:
    return run_json(
        [
            *(str(WORKER), "bench", str(scene.path), "--integrator", integrator),
            *("--per-pixel", str(per_pixel), "--threads", str(THREADS)),
            *("--width", str(SIZE), "--height", str(SIZE)),
        ]
    )


def through_the_service(scene: Scene, integrator: str, per_pixel: int) -> dict[str, float]:
    budget = "--spp" if integrator == "path" else "--mutations-per-pixel"
    with tempfile.TemporaryDirectory() as scratch:
        stats = Path(scratch) / "stats.json"
        command = [str(METROFARM), "render", str(scene.path), "-o", str(Path(scratch) / "out.exr")]
        command += ["--integrator", integrator, budget, str(per_pixel), "--stats", str(stats)]
        command += ["--threads", str(THREADS), "--width", str(SIZE), "--height", str(SIZE)]
        subprocess.run(command, capture_output=True, check=True)
        return json.loads(stats.read_text())


def mitsuba(scene: Scene, variant: str) -> float:
    """Samples per CPU second, in a process of its own: a variant stays chosen for its lifetime."""
    command = [sys.executable, str(Path(__file__).parent / "mitsuba_rate.py")]
    command += [variant, str(scene.path), str(scene.spp), str(SIZE), str(THREADS)]
    return float(run_json(command)["samples_per_cpu_second"])


def metrofarm_rate(scene: Scene) -> float:
    stats = through_the_service(scene, "path", scene.spp)
    return stats["mutations"] / stats["cpu_seconds"]


def children_cpu_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def service_overhead(scene: Scene) -> float:
    """CPU time per mutation of everything that `metrofarm render` starts, over that of the bare
    worker's loop, minus 1. It contains start, bootstrap, transport, merging and output."""
    alone = worker_alone(scene, "pssmlt", 4 * scene.spp)["samples_per_cpu_second"]
    before = children_cpu_seconds()
    served = through_the_service(scene, "pssmlt", 4 * scene.spp)
    return alone * (children_cpu_seconds() - before) / served["mutations"] - 1.0


MEASURES: dict[str, Callable[[Scene], float]] = {
    "metrofarm_samples": metrofarm_rate,
    "mitsuba_scalar_samples": lambda scene: mitsuba(scene, "scalar_rgb"),
    "mitsuba_llvm_samples": lambda scene: mitsuba(scene, "llvm_ad_rgb"),
    "rays": lambda scene: worker_alone(scene, "path", scene.spp)["rays_per_cpu_second"],
    "embree_rays": lambda scene: worker_alone(scene, "path", 1)["raw_rays_per_cpu_second"],
    "mutations": lambda scene: worker_alone(scene, "pssmlt", 4 * scene.spp)[
        "samples_per_cpu_second"
    ],
    "service_overhead": service_overhead,
}


def measure(scenes: list[Scene], repetitions: int) -> dict[str, dict[str, list[float]]]:
    figures: dict[str, dict[str, list[float]]] = {
        scene.name: {name: [] for name in MEASURES} for scene in scenes
    }
    for repetition in range(repetitions):
        for scene in scenes:
            for name, take in MEASURES.items():
                figures[scene.name][name].append(take(scene))
            print(f"repetition {repetition + 1}/{repetitions}: {scene.name}", file=sys.stderr)
    return figures


def machine() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return f"{line.partition(':')[2].strip()}, {platform.system()} {platform.release()}"
    return platform.platform()


def millions(value: float) -> str:
    return f"{value / 1e6:.2f}"


def table(figures: dict[str, dict[str, list[float]]], repetitions: int) -> str:
    lines = [
        f"{machine()}; {SIZE}x{SIZE}, {THREADS} threads, medians of {repetitions}; "
        "millions per CPU second",
        "",
        "| scene | path: Metrofarm | Mitsuba scalar | Mitsuba llvm | ours / llvm | rays | "
        "rays, bare Embree | mutations | service overhead |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for scene, measured in figures.items():
        m = {name: statistics.median(values) for name, values in measured.items()}
        ratio = m["metrofarm_samples"] / m["mitsuba_llvm_samples"]
        cells = [scene, millions(m["metrofarm_samples"]), millions(m["mitsuba_scalar_samples"])]
        cells += [millions(m["mitsuba_llvm_samples"]), f"{ratio:.2f}", millions(m["rays"])]
        cells += [millions(m["embree_rays"]), millions(m["mutations"])]
        cells.append(f"{100 * m['service_overhead']:+.1f} %")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="Metrofarm beside Mitsuba 3")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "bench")
    parser.add_argument("--scenes", default=",".join(scene.name for scene in BENCH_SCENES))
    arguments = parser.parse_args()
    chosen = arguments.scenes.split(",")
    scenes = [scene for scene in BENCH_SCENES if scene.name in chosen]
    if len(scenes) != len(chosen):
        parser.error(f"--scenes: choose from {', '.join(scene.name for scene in BENCH_SCENES)}")
    figures = measure(scenes, arguments.repetitions)
    text = table(figures, arguments.repetitions)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "bench.md").write_text(text)
    document = {"machine": machine(), "size": SIZE, "threads": THREADS, "figures": figures}
    (arguments.out / "bench.json").write_text(json.dumps(document, indent=2) + "\n")
    print(text)


if __name__ == "__main__":
    main()
