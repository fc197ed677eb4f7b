#!/usr/bin/env python3
"""Run time against error: every way to render, ours and Mitsuba's, on every scene (`make bench`).

usage: efficiency.py [--seconds S] [--seeds N] [--scenes NAME,...] [--variants NAME,...] [--out DIR]

Each variant renders every scene at a quarter, a half and all of S CPU seconds, so many as a short
trial says it needs samples; seeds outermost, so that other load on the machine hits all alike. The
error is relMSE against a reference that Mitsuba rendered (see tests/agreement), whose own noise is
subtracted. An unbiased renderer's error falls as C / t: C, relMSE times CPU seconds, is stated at
the largest budget, as the median over seeds with the smallest and largest; the ratio of two
variants' C is the ratio of the times that they need to the same error.

CPU seconds are those of the render (Metrofarm: all its phases, bootstrap included), of all threads.
Second stages of delayed rejection count as the path evaluations that they are: their time is in it.
Writes efficiency.json, efficiency.md and a log-log plot per scene.
"""

import argparse
import json
import statistics
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import matplotlib
from rendering import by_metrofarm, by_mitsuba, provenance
from scoring import Reference, read_reference
from variants import VARIANTS, BenchScene, Variant, all_scenes

from bench import ROOT

matplotlib.use("Agg")
from matplotlib import pyplot

FRACTIONS = (0.25, 0.5, 1.0)
TRIAL_PER_PIXEL = 16


@dataclass(frozen=True)
class Run:
    """One render: what it was asked for, what it took and how far off it is."""

    per_pixel: int
    cpu_seconds: float
    relative_mse: float
    anomalies: int


def render(
    scene: BenchScene, variant: Variant, reference: Reference, budget: int, seed: int
) -> Run:
    renderer = by_mitsuba if variant.mitsuba else by_metrofarm
    image, stats = renderer(scene, variant, budget, seed)
    anomalies = sum(stats.get("anomalies", {}).values())
    return Run(budget, stats["cpu_seconds"], reference.relative_mse(image), anomalies)


def budgets(scene: BenchScene, variant: Variant, reference: Reference, seconds: float) -> list[int]:
    """Samples or mutations per pixel that take each fraction of the seconds. Two trials tell what
    grows with them from what does not."""
    few = render(scene, variant, reference, TRIAL_PER_PIXEL, 1)
    many = render(scene, variant, reference, 4 * TRIAL_PER_PIXEL, 1)
    each = max(many.cpu_seconds - few.cpu_seconds, 1e-4) / (3 * TRIAL_PER_PIXEL)
    fixed = max(few.cpu_seconds - each * TRIAL_PER_PIXEL, 0.0)
    return [max(8, round((seconds * part - fixed) / each / 8) * 8) for part in FRACTIONS]


Figures = dict[str, dict[str, list[list[Run]]]]  # scene, variant, budget, seed


def measure(
    scenes: list[BenchScene], variants: list[Variant], seconds: float, seeds: int
) -> Figures:
    references = {scene.name: read_reference(scene.reference) for scene in scenes}
    plan: dict[tuple[str, str], list[int]] = {}
    for scene in scenes:
        for variant in filter(scene.takes, variants):
            plan[scene.name, variant.name] = budgets(
                scene, variant, references[scene.name], seconds
            )
        print(f"trials: {scene.name}", file=sys.stderr)
    figures: Figures = {
        s.name: {v.name: [[] for _ in FRACTIONS] for v in filter(s.takes, variants)} for s in scenes
    }
    for seed in range(1, seeds + 1):
        for scene in scenes:
            for variant in filter(scene.takes, variants):
                for level, per_pixel in enumerate(plan[scene.name, variant.name]):
                    figures[scene.name][variant.name][level].append(
                        render(scene, variant, references[scene.name], per_pixel, seed)
                    )
            print(f"seed {seed}/{seeds}: {scene.name}", file=sys.stderr)
    return figures


def constants(runs: list[Run]) -> list[float]:
    return sorted(r.relative_mse * r.cpu_seconds for r in runs)


def cell(figures: Figures, scene: str, variant: str) -> str:
    if variant not in figures[scene]:
        return ""
    c = {name: constants(levels[-1]) for name, levels in figures[scene].items()}
    best = min(c, key=lambda name: statistics.median(c[name]))
    text = f"{statistics.median(c[variant]):.3g}"
    text = f"**{text}**" if variant == best else text
    return f"{text} ({c[variant][0]:.2g}..{c[variant][-1]:.2g})"


def table(figures: Figures, header: str) -> str:
    """A row for each variant, a column for each scene."""
    names = list(dict.fromkeys(name for by_variant in figures.values() for name in by_variant))
    lines = [header, "", "| | " + " | ".join(figures) + " |", "| --- |" + " ---: |" * len(figures)]
    for name in names:
        cells = [cell(figures, scene, name) for scene in figures]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def plot(scene: str, by_variant: dict[str, list[list[Run]]], out: Path) -> None:
    figure, axes = pyplot.subplots(figsize=(8.5, 5))
    styles = ["-", "--", ":"]
    for number, (name, levels) in enumerate(by_variant.items()):
        seconds = [statistics.median(r.cpu_seconds for r in runs) for runs in levels]
        errors = [statistics.median(r.relative_mse for r in runs) for runs in levels]
        axes.loglog(seconds, errors, styles[number // 10], marker="o", markersize=3, label=name)
    axes.set_xlabel("CPU seconds")
    axes.set_ylabel("relMSE")
    axes.set_title(scene)
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.tight_layout()
    figure.savefig(out, dpi=120)
    pyplot.close(figure)


def header(arguments: argparse.Namespace) -> str:
    return (
        f"C = relMSE x CPU seconds (smaller is better; bold: the scene's best), median (smallest.."
        f"largest) of {arguments.seeds} seeds at {arguments.seconds:g} CPU seconds; {provenance()}"
    )


def choose(kind: str, names: str, available: list[Any]) -> list[Any]:
    wanted = names.split(",") if names else [item.name for item in available]
    unknown = set(wanted) - {item.name for item in available}
    if unknown:
        sys.exit(
            f"--{kind}: {', '.join(sorted(unknown))}: choose from "
            f"{', '.join(item.name for item in available)}"
        )
    return [item for item in available if item.name in wanted]


def main() -> None:
    parser = argparse.ArgumentParser(description="Run time against error")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--scenes", default="")
    parser.add_argument("--variants", default="")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "bench")
    arguments = parser.parse_args()
    scenes = choose("scenes", arguments.scenes, all_scenes())
    variants = choose("variants", arguments.variants, VARIANTS)
    figures = measure(scenes, variants, arguments.seconds, arguments.seeds)
    arguments.out.mkdir(parents=True, exist_ok=True)
    text = table(figures, header(arguments))
    (arguments.out / "efficiency.md").write_text(text)
    document = {
        "header": header(arguments),
        "runs": {
            scene: {
                name: [[asdict(r) for r in runs] for runs in levels] for name, levels in by.items()
            }
            for scene, by in figures.items()
        },
    }
    (arguments.out / "efficiency.json").write_text(json.dumps(document, indent=1) + "\n")
    for scene, by_variant in figures.items():
        plot(scene, by_variant, arguments.out / f"efficiency-{scene}.png")
    print(text)


if __name__ == "__main__":
    main()
