#!/usr/bin/env python3
"""Renders what the motion tests compare with, by Mitsuba 3 (`make references`; committed).

usage: make_motion_references.py [NAME ...]        all cases without names

The Mitsuba that is installed knows no motion. Every image here is of scenes that stand still, posed
by poses.py: one for each of a case's five times, and for the blurred image INSTANTS of them in each
run, at a random time in each of so many equal parts of the shutter's time. Their mean over the runs
has the blurred image as its expectation, whatever lies between the instants; what the choice of
times adds to the error is between the runs like all other noise.

scalar_rgb: a scene of 48 x 32 pixels is rendered before the llvm variant has traced its program.
The scenes have box filters, which it evaluates exactly.
"""

import argparse
import tempfile
import time
from pathlib import Path

import mitsuba
import numpy as np

from motion_cases import HEIGHT, MOTION_CASES, WIDTH, MotionCase
from poses import shutter_of, stratified_times, write_posed
from tiles import tile_means

RUNS = 32
INSTANTS = 64
POSED_RUNS = 16
# Samples per pixel of one run at one of the five times, in those of an instant.
POSED_INSTANTS = 8


def render_at(case: MotionCase, at: float, spp: int, seed: int) -> np.ndarray:
    with tempfile.TemporaryDirectory() as scratch:
        posed = write_posed(case.scene, at, Path(scratch))
        scene = mitsuba.load_file(str(posed), resx=WIDTH, resy=HEIGHT)
    return np.array(mitsuba.render(scene, spp=spp, seed=seed), dtype=np.float64)[:, :, :3]


def blurred_run(case: MotionCase, run: int) -> np.ndarray:
    times = stratified_times(*shutter_of(case.scene), INSTANTS, np.random.default_rng(run))
    seeds = INSTANTS * (run + 1) + np.arange(INSTANTS)
    images = [
        render_at(case, float(at), case.instant_spp, int(seed))
        for at, seed in zip(times, seeds, strict=True)
    ]
    return np.mean(images, axis=0)


def posed_tiles(case: MotionCase, at: float) -> np.ndarray:
    """(runs, tile rows, tile columns, 3)."""
    spp = POSED_INSTANTS * case.instant_spp
    images = [render_at(case, at, spp, 1_000_003 + run) for run in range(POSED_RUNS)]
    return np.stack([tile_means(image) for image in images])


def mean_and_error(runs: np.ndarray, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
    error = runs.std(axis=axis, ddof=1) / np.sqrt(runs.shape[axis])
    return runs.mean(axis=axis), error


def make_reference(case: MotionCase) -> None:
    started = time.monotonic()
    runs = np.stack([blurred_run(case, run) for run in range(RUNS)])
    mean, error = mean_and_error(runs)
    tile_mean, tile_error = mean_and_error(np.stack([tile_means(image) for image in runs]))
    posed = np.stack([posed_tiles(case, at) for at in case.times])
    posed_mean, posed_error = mean_and_error(posed, axis=1)
    np.savez_compressed(
        case.reference,
        mean=mean.astype(np.float32),
        standard_error=error.astype(np.float32),
        tile_standard_error=tile_error.astype(np.float32),
        runs=np.int32(RUNS),
        times=np.array(case.times),
        posed_mean=posed_mean,
        posed_standard_error=posed_error,
        posed_runs=np.int32(POSED_RUNS),
        mitsuba_version=np.str_(mitsuba.__version__),
    )
    relative = np.median(tile_error / np.maximum(tile_mean, 1e-12))
    print(
        f"{case.name}: {time.monotonic() - started:.0f} s, {case.reference.stat().st_size} bytes, "
        f"median relative standard error of a tile {relative:.2e}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="render the motion references with Mitsuba 3")
    parser.add_argument("names", nargs="*", help="cases to make; all by default")
    names = parser.parse_args().names
    unknown = set(names) - {case.name for case in MOTION_CASES}
    if unknown:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    mitsuba.set_variant("scalar_rgb")
    for case in MOTION_CASES:
        if not names or case.name in names:
            make_reference(case)


if __name__ == "__main__":
    main()
