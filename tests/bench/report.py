#!/usr/bin/env python3
"""The experiments of Meng's report "PSSMLT with Delayed Rejection", repeated (`make report`).

usage: report.py [--quick] [--width W] [--sequence-seeds N] [--out DIR]

1. Plates and lights at 32 mutations per pixel: PSSMLT with four widths of a Gaussian kernel, with
   and without delayed rejection, with light sampling by MIS and by BSDF sampling alone.
2. The same at growing numbers of mutations: does the error fall as the inverse root, and to zero?
3. Coordinates that chains draw per mutation, beside the dimension of the deepest path.

Writes report.md, report.json and pictures. About 25 minutes on two idle cores, --quick 2 minutes
with a quarter of the pixels and fewer mutations. The scene has 3 rows of pixels for 4 columns.
Evaluations are paths: a second stage counts as the one that it is.
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import laziness
import numpy as np
import sequence
from pictures import contact_sheet, sequence_plot
from plates import (
    REFERENCE_RUNS,
    SAMPLINGS,
    SIGMAS,
    Chains,
    Experiment,
    paths,
    prepare,
)
from rendering import provenance
from report_text import (
    Runs,
    bright_findings,
    fit_table,
    sequence_findings,
    sequence_table,
    sigma_findings,
    sigma_table,
)
from variants import all_scenes

from bench import ROOT

PER_PIXEL = 32
EXPOSURE = 1.5


@dataclass(frozen=True)
class Extent:
    """How much is rendered."""

    width: int
    height: int
    # Samples per pixel of each run of the reference.
    reference_samples: int
    sigma_seeds: int
    counts: tuple[int, ...]
    sequence_seeds: int
    laziness_per_pixel: int


FULL = Extent(96, 72, 4096, 5, (256, 1024, 2048, 5000), 8, 16)
QUICK = Extent(48, 36, 1024, 2, (64, 128, 256, 512), 2, 8)

# Name of a measure and the figure of a run that is its square.
MEASURES = {"RMSE": "mse", "RMSE elsewhere": "mse_elsewhere", "root of relMSE": "relative_mse"}

Images = dict[Chains | str, np.ndarray]


@dataclass(frozen=True)
class Results:
    """What the three experiments found."""

    extent: Extent
    runs: Runs
    rows: list[laziness.Row]
    sequences: sequence.Sequences
    fits: dict[Chains, dict[str, sequence.Fit]]
    bright_shares: list[float]


def measure_sigmas(experiment: Experiment, seeds: int) -> tuple[Runs, Images]:
    """Runs of all seeds, images of the first."""
    variants: dict[Chains | str, Any] = {sampling: paths(sampling) for sampling in SAMPLINGS}
    for sampling in SAMPLINGS:
        for sigma in SIGMAS:
            for delayed in (False, True):
                chains = Chains(sampling, sigma, delayed)
                variants[chains] = chains.variant
    runs: Runs = {key: [] for key in variants}
    images: Images = {}
    for seed in range(1, seeds + 1):
        for key, variant in variants.items():
            run, image = experiment.render(variant, PER_PIXEL, seed)
            runs[key].append(run)
            images.setdefault(key, image)
        print(f"sigmas: seed {seed}/{seeds}", file=sys.stderr)
    return runs, images


def draw_sigmas(experiment: Experiment, images: Images, out: Path) -> None:
    for sampling in SAMPLINGS:
        rows = [
            [("path tracing", images[sampling])],
            [("reference (Mitsuba)", experiment.reference.mean)],
        ]
        for row, delayed in zip(rows, (False, True), strict=True):
            name = "delayed rejection" if delayed else "PSSMLT"
            for sigma in SIGMAS:
                row.append((f"{name}, sigma {sigma:g}", images[Chains(sampling, sigma, delayed)]))
        contact_sheet(rows, EXPOSURE, out / f"report-sigma-{sampling}.png")


def draw_sequences(sequences: sequence.Sequences, out: Path) -> None:
    rows = []
    for chains, images in sequences.images.items():
        counts = [runs[0].mutations for runs in sequences.runs[chains]]
        rows.append(
            [
                (f"{chains.name}, {count:.0f} per pixel", image)
                for count, image in zip(counts, images, strict=True)
            ]
        )
    contact_sheet(rows, EXPOSURE, out / "report-sequence.png")
    panels: dict[str, dict[str, Any]] = {name: {} for name in MEASURES}
    for chains, levels in sequences.runs.items():
        for measure, figure in MEASURES.items():
            panels[measure][chains.name] = [
                (runs[0].evaluations, [getattr(run, figure) ** 0.5 for run in runs])
                for runs in levels
            ]
    sequence_plot(panels, out / "report-convergence.png")


def scene_text(extent: Extent) -> str:
    return f"""`tests/scenes/plates` without its point light, which BSDF sampling alone never finds:
all four lights have an extent, so both ways of light sampling have the same image. \
{extent.width} x {extent.height} pixels,
depth 6. The reference is Mitsuba's llvm path tracer: {REFERENCE_RUNS} runs of \
{extent.reference_samples} samples per pixel; their scatter
tells the reference's own squared error, which is subtracted from every error stated. Evaluations
are paths per pixel, with second stages and the bootstrap; CPU seconds are of all phases."""


def document_text(results: Results) -> str:
    extent, runs, sequences = results.extent, results.runs, results.sequences
    seeds = extent.sequence_seeds
    counts = ", ".join(str(count) for count in extent.counts)
    sigmas = ", ".join(f"{sigma:g}" for sigma in SIGMAS)
    saved = [row.saved for row in results.rows]
    return f"""# Meng's experiments, repeated

{provenance()}. Written by
`tests/bench/report.py {" ".join(sys.argv[1:])}` (`make report`).

{scene_text(extent)}

## Widths of the kernel at {PER_PIXEL} mutations per pixel

Asked: the noise of PSSMLT with a Gaussian kernel of sigma {sigmas},
and with delayed rejection. Medians of {extent.sigma_seeds} seeds; acceptance of the first.

![light sampling by MIS](report-sigma-mis.png)

![BSDF sampling alone](report-sigma-bsdf.png)

{sigma_table(runs)}

{sigma_findings(runs)}

## Growing numbers of mutations

Asked: does the error approach zero at the Monte Carlo rate, RMSE falling as n^(-1/2), at n =
{counts} mutations per pixel? Sigma {sequence.SIGMA:g}; {seeds} seeds at each count, every \
render with a seed of its own.

![convergence](report-convergence.png)

![images](report-sequence.png)

{sequence_table(sequences)}

Slopes of log error over log n, where n counts all path evaluations: the bootstrap's too, which find
the seeds. The error is the root of the mean squared error of the {seeds} images. The floor is F of
squared error = a / n + F. The error of the mean is the squared error of the mean of all {seeds} \
images at the last
count over that of one: {100 / seeds:.1f} % if it is noise, 100 % if it is bias.
± is half a 99 % interval; the floor's holds the
uncertainty of what is subtracted for the reference. Elsewhere: without the brightest hundredth of
the pixels.

{fit_table(results.fits)}

{bright_findings(results.bright_shares)}

{sequence_findings(sequences, results.fits, seeds)}

## What lazy evaluation saves

Asked: coordinates drawn per mutation beside the dimension of the deepest path that the scene's
depth allows, which is what a sampler that fills all coordinates draws for every proposal.
Coordinates are counted in pairs, as they are drawn. The dimension of a multiplexed path is that of
its largest technique. Scenes as they are, {extent.laziness_per_pixel} mutations per pixel, \
default kernel, one seed.

{laziness.table(results.rows)}

Saved: {min(saved):.0%} to {max(saved):.0%}.
"""


def named(by_key: dict[Any, Any]) -> dict[str, Any]:
    """Keys of JSON."""
    return {
        key if isinstance(key, str) else f"{key.name}, sigma {key.sigma:g}": value
        for key, value in by_key.items()
    }


def document(results: Results) -> Any:
    return {
        "provenance": provenance(),
        "extent": asdict(results.extent),
        "sigmas": named({key: [asdict(run) for run in of] for key, of in results.runs.items()}),
        "sequences": named(
            {
                key: [[asdict(run) for run in level] for level in levels]
                for key, levels in results.sequences.runs.items()
            }
        ),
        "fits": named(
            {
                key: {name: asdict(fit) for name, fit in by.items()}
                for key, by in results.fits.items()
            }
        ),
        "laziness": [asdict(row) for row in results.rows],
    }


def measure_laziness(per_pixel: int) -> list[laziness.Row]:
    rows = []
    for scene in all_scenes():
        rows += [laziness.row(scene, chains, per_pixel) for chains in laziness.CHAINS]
        print(f"laziness: {scene.name}", file=sys.stderr)
    return rows


def chosen_extent(arguments: argparse.Namespace) -> Extent:
    extent = QUICK if arguments.quick else FULL
    width = arguments.width or extent.width
    seeds = arguments.sequence_seeds or extent.sequence_seeds
    return replace(extent, width=width, height=3 * width // 4, sequence_seeds=seeds)


def main() -> None:
    parser = argparse.ArgumentParser(description="The report's experiments, repeated")
    parser.add_argument("--quick", action="store_true", help="fewer pixels, seeds and mutations")
    parser.add_argument("--width", type=int, default=0, help="of the image; default 96, quick 48")
    parser.add_argument("--sequence-seeds", type=int, default=0, help="default 5, quick 2")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "bench")
    arguments = parser.parse_args()
    extent = chosen_extent(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    experiment = prepare(
        ROOT / "build" / "bench" / "plates", extent.width, extent.height, extent.reference_samples
    )
    runs, images = measure_sigmas(experiment, extent.sigma_seeds)
    draw_sigmas(experiment, images, arguments.out)
    rows = measure_laziness(extent.laziness_per_pixel)
    sequences = sequence.measure(experiment, extent.counts, extent.sequence_seeds)
    draw_sequences(sequences, arguments.out)
    fits = {chains: sequence.fit(experiment, sequences, chains) for chains in sequences.runs}
    bright = sequence.bright_shares(experiment, sequences)
    results = Results(extent, runs, rows, sequences, fits, bright)
    text = document_text(results)
    (arguments.out / "report.md").write_text(text)
    (arguments.out / "report.json").write_text(json.dumps(document(results), indent=1) + "\n")
    print(text)


if __name__ == "__main__":
    main()
