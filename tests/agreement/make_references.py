#!/usr/bin/env python3
"""Renders the reference images with Mitsuba 3 (`make references`; they are committed).

usage: make_references.py [NAME ...]        all cases without names

Each reference is the mean of RUNS independent runs, stored with the standard error of the mean per
pixel and per tile. The error of a tile cannot be derived from its pixels': a filter wider than a
pixel correlates neighbours.

Mitsuba by default loses what a wide filter gathers from beyond the film's edge and divides by the
weight that is left; with sample_border it samples the enlarged domain, as Metrofarm does.
The llvm variant evaluates filters exactly; scalar_rgb looks them up in a table of 31 entries, which
is visible at the precision wanted here. It needs Debian's libllvm19.
"""

import argparse
import shutil
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mitsuba
import numpy as np

from cases import REFERENCE_CASES, ReferenceCase
from tiles import tile_means

RUNS = 32
# The llvm variant keeps every sample of a pass in memory.
PASS_SPP = 512


def with_film(document: ElementTree.ElementTree, width: int, height: int) -> None:
    """Sets the film's size and sample_border in a parsed scene."""
    film = document.getroot().find("./sensor/film")
    if film is None:
        raise ValueError("the scene has no <film> in its <sensor>")
    for name, value in (("width", width), ("height", height)):
        for old in film.findall(f"integer[@name='{name}']"):
            film.remove(old)
        ElementTree.SubElement(film, "integer", name=name, value=str(value))
    ElementTree.SubElement(film, "boolean", name="sample_border", value="true")


def load(case: ReferenceCase) -> "mitsuba.Scene":
    """Loads a copy of the scene, so that files it names are found beside the changed XML."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / case.name
        shutil.copytree(case.scene.parent, folder)
        document = ElementTree.parse(case.scene)
        with_film(document, case.width, case.height)
        document.write(folder / "scene.xml")
        return mitsuba.load_file(str(folder / "scene.xml"))


def render_run(scene: "mitsuba.Scene", run: int, spp: int) -> np.ndarray:
    passes = max(1, spp // PASS_SPP)
    total = None
    for index in range(passes):
        seed = 1_000_003 * (run + 1) + index
        image = np.array(mitsuba.render(scene, spp=spp // passes, seed=seed), dtype=np.float64)
        total = image if total is None else total + image
    return total[:, :, :3] / passes


def make_reference(case: ReferenceCase) -> None:
    started = time.monotonic()
    scene = load(case)
    runs = np.stack([render_run(scene, run, case.reference_spp) for run in range(RUNS)])
    tiles = np.stack([tile_means(image) for image in runs])
    scale = 1.0 / np.sqrt(RUNS)
    tile_mean = tiles.mean(axis=0)
    tile_error = tiles.std(axis=0, ddof=1) * scale
    np.savez_compressed(
        case.reference,
        mean=runs.mean(axis=0).astype(np.float32),
        standard_error=(runs.std(axis=0, ddof=1) * scale).astype(np.float32),
        tile_standard_error=tile_error.astype(np.float32),
        runs=np.int32(RUNS),
        samples_per_pixel=np.int64(RUNS * case.reference_spp),
        mitsuba_version=np.str_(mitsuba.__version__),
    )
    relative = np.median(tile_error / np.maximum(tile_mean, 1e-12))
    print(
        f"{case.name}: {time.monotonic() - started:.0f} s, {case.reference.stat().st_size} bytes, "
        f"median relative standard error of a tile {relative:.2e}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="render the reference images with Mitsuba 3")
    parser.add_argument("names", nargs="*", help="cases to make; all by default")
    names = parser.parse_args().names
    unknown = set(names) - {case.name for case in REFERENCE_CASES}
    if unknown:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    mitsuba.set_variant("llvm_ad_rgb")
    for case in REFERENCE_CASES:
        if not names or case.name in names:
            make_reference(case)


if __name__ == "__main__":
    main()
