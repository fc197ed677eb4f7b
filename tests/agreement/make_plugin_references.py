#!/usr/bin/env python3
"""Renders the references of tests/scenes/plugins with Mitsuba 3 (they are committed).

usage: make_plugin_references.py [NAME ...]        all scenes without names

Without names everything is rendered anew; with names the others stay as they are stored. The llvm
variant evaluates reconstruction filters exactly, and samples beyond the film's edge as Metrofarm
does (see make_references.py).
"""

import argparse
import tempfile
import time
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path

import mitsuba
import numpy as np

mitsuba.set_variant("llvm_ad_rgb")

import mitsuba_difftrans  # noqa: E402, F401
import mitsuba_phong  # noqa: E402, F401

import plugin_references as references  # noqa: E402


def load_scene(name: str) -> "mitsuba.Scene":
    """The scene with sample_border, from a file beside the assets' folder."""
    original = references.mitsuba_file(name)
    document = ElementTree.parse(original)
    film = document.getroot().find("./sensor/film")
    if film is None:
        raise ValueError(f"{original}: no <film> in a <sensor>")
    ElementTree.SubElement(film, "boolean", name="sample_border", value="true")
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "assets").symlink_to(references.FOLDER / "assets")
        changed = Path(scratch) / original.name
        document.write(changed)
        return mitsuba.load_file(str(changed))


def render(name: str) -> references.Reference:
    scene = load_scene(name)
    # Seeds of its own: with common ones all scenes would share the noise of what they share.
    first_seed = zlib.crc32(name.encode())
    images = []
    for run in range(references.RUNS):
        seed = (first_seed + run) % 2**32
        images.append(np.array(mitsuba.render(scene, spp=references.SAMPLES_PER_PIXEL, seed=seed)))
    return references.Reference.of_runs(np.stack(images)[..., :3].astype(np.float64))


def main() -> None:
    parser = argparse.ArgumentParser(description="render the plugin scenes with Mitsuba 3")
    parser.add_argument("names", nargs="*", help="scenes to render; all by default")
    wanted = parser.parse_args().names
    known = references.scene_names()
    if unknown := set(wanted) - set(known):
        parser.error(f"no such scene: {', '.join(sorted(unknown))}")
    done = {}
    if wanted and references.FILE.exists():
        done = {name: one for name, one in references.load().items() if name in known}
    for count, name in enumerate(wanted or known, start=1):
        started = time.monotonic()
        done[name] = render(name)
        print(f"{name}: {time.monotonic() - started:.1f} s", flush=True)
        if count % 10 == 0:
            references.save(done, mitsuba.__version__)
    references.save(done, mitsuba.__version__)
    print(f"{len(done)} scenes, {references.FILE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
