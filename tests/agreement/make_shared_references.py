#!/usr/bin/env python3
"""Renders the references of the shared scenes with Mitsuba 3 (they are committed).

usage: METROFARM_SHARED_SCENES=FOLDER make_shared_references.py [NAME ...]     all without names

FOLDER contains `scenes`. With names, the others stay as they are stored. For the variant and
sample_border see make_references.py.
"""

import argparse
import tempfile
import time
import zlib
from pathlib import Path

import mitsuba
import numpy as np

mitsuba.set_variant("llvm_ad_rgb")

import mitsuba_phong  # noqa: E402, F401

import shared_references as references  # noqa: E402
from loop_mesh import write_ply  # noqa: E402
from plugin_references import Reference  # noqa: E402
from shared_cases import CASES, VARIABLE, SharedCase, shared_folder  # noqa: E402

# The llvm variant keeps every sample of a pass in memory.
PASS_SAMPLES = 1 << 20


def load_scene(case: SharedCase, meshes: Path) -> "mitsuba.Scene":
    """The scene, or its twin, in the test's size and with sample_border.

    `meshes`: what twins need and no file of the shared scenes has.
    """
    config = mitsuba.parser.ParserConfig(mitsuba.variant())
    config.unused_parameters = mitsuba.LogLevel.Debug
    shared = shared_folder()
    file = case.mitsuba_file(shared)
    # The parser forgets where files are looked for; here is also <path value="../../../common"/>.
    # In front, as many scenes have textures of the same names.
    resolver = mitsuba.file_resolver()
    for folder in (shared / "scenes" / "mitsuba-tests" / "common", file.parent):
        resolver.prepend(str(folder))
    parameters = {"shared": str(shared / "scenes"), "meshes": str(meshes)}
    state = mitsuba.parser.parse_file(config, str(file), **parameters)
    mitsuba.parser.transform_all(config, state)
    films = [node for node in state.nodes if node.type == mitsuba.ObjectType.Film]
    if len(films) != 1:
        raise ValueError(f"{case.name}: {len(films)} films")
    for name, value in (("width", case.width), ("height", case.height), ("sample_border", True)):
        films[0].props[name] = value
    made = mitsuba.parser.instantiate(config, state)
    return made[0] if isinstance(made, list) else made


def render_run(scene: "mitsuba.Scene", case: SharedCase, seed: int) -> np.ndarray:
    passes = -(-case.width * case.height * case.reference_samples // PASS_SAMPLES)
    total = np.zeros((case.height, case.width, 3))
    for index in range(passes):
        one = mitsuba.render(
            scene, spp=case.reference_samples // passes, seed=(seed + index) % 2**32
        )
        total += np.array(one)[..., :3]
    return total / passes


def write_meshes(folder: Path) -> None:
    cage = shared_folder() / "scenes/killeroo-moving/geometry/killeroo.pbrt"
    write_ply(cage, 1, folder / "killeroo.ply")


def render(case: SharedCase) -> Reference:
    with tempfile.TemporaryDirectory() as folder:
        write_meshes(Path(folder))
        scene = load_scene(case, Path(folder))
    # Seeds of its own: with common ones all scenes would share the noise of what they share.
    first = zlib.crc32(case.name.encode())
    runs = [render_run(scene, case, first + 1000 * run) for run in range(references.RUNS)]
    return Reference.of_runs(np.stack(runs))


def main() -> None:
    parser = argparse.ArgumentParser(description="render the shared scenes with Mitsuba 3")
    parser.add_argument("names", nargs="*", help="scenes to render; all by default")
    wanted = parser.parse_args().names
    known = {case.name: case for case in CASES}
    if unknown := set(wanted) - set(known):
        parser.error(f"no such scene: {', '.join(sorted(unknown))}")
    if shared_folder() is None:
        parser.error(f"{VARIABLE} is not set: the folder that contains `scenes`")
    done, samples = references.load() if references.FILE.exists() else ({}, {})
    done = {name: one for name, one in done.items() if name in known}
    for name in wanted or known:
        started = time.monotonic()
        done[name] = render(known[name])
        samples[name] = known[name].reference_samples
        references.save(done, samples, mitsuba.__version__)
        print(f"{name}: {time.monotonic() - started:.1f} s", flush=True)
    print(f"{len(done)} scenes, {references.FILE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
