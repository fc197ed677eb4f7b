#!/usr/bin/env python3
"""What motion costs: time per ray and memory, beside the same scene standing still.

usage: motion_cost.py [--repeat N] [--worker FILE]

First a room with 25 bumpy balls of 28,800 triangles each, as instances of one group, or each ball a
mesh of its own. They stand; or they drift and turn, between 2 keys or through 32. Then the small
scenes of tests/scenes/motion, beside themselves posed by hand at 0.4 s. Prints for each, beside
standing still: time per ray of the whole path tracer and of the bare ray tracer on the same paths
(CPU time, medians of N runs taken in turn), and the bytes that the scene holds.
Sources: `metrofarm-worker bench`, which says what its figures are.
"""

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "agreement"))

from poses import write_posed  # noqa: E402

SCENES = ROOT / "tests" / "scenes" / "motion"
SMALL = ("car", "ball", "light", "camera", "caustic", "curves", "cloth")
POSED_AT = 0.4
ACROSS, DOWN = 240, 60
SIDE = 5
SPACING = 2.5
VARIANTS = {"still": 0, "2 keys": 2, "32 keys": 32}


def write_ball(path: Path) -> None:
    """A sphere with bumps, with vertex normals left to the reader."""
    vertices, faces = [], []
    for j in range(DOWN + 1):
        for i in range(ACROSS + 1):
            theta, phi = math.pi * j / DOWN, 2 * math.pi * i / ACROSS
            radius = 1 + 0.05 * math.sin(9 * phi) * math.sin(theta)
            vertices.append(
                f"{radius * math.sin(theta) * math.cos(phi):.6f} "
                f"{radius * math.cos(theta):.6f} {radius * math.sin(theta) * math.sin(phi):.6f}"
            )
    for j in range(DOWN):
        for i in range(ACROSS):
            a = j * (ACROSS + 1) + i
            c = a + ACROSS + 1
            faces += [f"3 {a} {a + 1} {c}", f"3 {a + 1} {c + 1} {c}"]
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    path.write_text(header + "\n".join(vertices + faces) + "\n")


def placed(index: int, keys: int) -> str:
    """The transform of a ball, or its motion: half a radius aside and 40 degrees around."""
    x, z = SPACING * (index % SIDE - SIDE // 2), SPACING * (index // SIDE - SIDE // 2)

    def pose(share: float) -> str:
        bend = 0.1 * math.sin(2 * math.pi * share) if keys > 2 else 0
        aside = 0.5 * math.cos(index) * share + bend
        return (
            f'<rotate y="1" angle="{40 * share + 15 * index}"/>'
            f'<translate x="{x + aside}" y="{0.5 * math.sin(index) * share}" z="{z}"/>'
        )

    if keys == 0:
        return f'<transform name="to_world">{pose(0)}</transform>'
    frames = "".join(
        f'<transform time="{k / (keys - 1)}">{pose(k / (keys - 1))}</transform>'
        for k in range(keys)
    )
    return f'<animation name="to_world">{frames}</animation>'


def scene(keys: int, instanced: bool) -> str:
    ball = '<shape type="ply"><string name="filename" value="ball.ply"/>'
    parts = []
    if instanced:
        parts.append(f'<shape type="shapegroup" id="ball">{ball}</shape></shape>')
    for index in range(SIDE * SIDE):
        where = placed(index, keys)
        parts.append(
            f'<shape type="instance"><ref id="ball"/>{where}</shape>'
            if instanced
            else f"{ball}{where}</shape>"
        )
    return f"""<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="6"/></integrator>
<sensor type="perspective"><float name="fov" value="50"/>
<float name="shutter_close" value="{1 if keys else 0}"/>
<transform name="to_world"><lookat origin="0, 7, -14" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="256"/><integer name="height" value="192"/></film>
</sensor>
<shape type="cube"><boolean name="flip_normals" value="true"/><transform name="to_world">
<scale x="16" y="9" z="16"/><translate y="7"/></transform></shape>
<shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate x="1" angle="90"/>
<translate y="15"/></transform>
<emitter type="area"><rgb name="radiance" value="9, 9, 9"/></emitter></shape>
{"".join(parts)}
</scene>"""


def bench(worker: Path, path: Path, *options: str) -> dict[str, float]:
    command = [str(worker), "bench", str(path), "--integrator", "path", *options]
    figures: dict[str, float] = json.loads(subprocess.check_output(command))
    return {
        "path": figures["cpu_seconds"] / figures["rays"],
        "ray": 1 / figures["raw_rays_per_cpu_second"],
        "bytes": figures["memory_bytes"],
    }


def compare(
    scene_name: str, files: dict[str, Path], *options: str, worker: Path, repeat: int
) -> None:
    """A row of the table for each file, beside the first."""
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in files}
    for _ in range(repeat):
        for name, path in files.items():
            runs[name].append(bench(worker, path, *options))
    middle = {
        name: {k: statistics.median(run[k] for run in of) for k in of[0]}
        for name, of in runs.items()
    }
    still = next(iter(middle.values()))
    for name, m in middle.items():
        print(
            f"| {scene_name} | {name} "
            f"| {1e9 * m['path']:.0f} | {m['path'] / still['path']:.2f} "
            f"| {1e9 * m['ray']:.0f} | {m['ray'] / still['ray']:.2f} "
            f"| {m['bytes'] / 2**10:.0f} | {m['bytes'] / still['bytes']:.2f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--worker", type=Path, default=ROOT / "bin" / "metrofarm-worker")
    options = parser.parse_args()
    how = {"worker": options.worker, "repeat": options.repeat}
    print("| scene | motion | ns per ray | | bare ns per ray | | KiB | |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_ball(folder / "ball.ply")
        for instanced in (True, False):
            files = {name: folder / f"{keys}-{instanced}.xml" for name, keys in VARIANTS.items()}
            for name, keys in VARIANTS.items():
                files[name].write_text(scene(keys, instanced))
            kind = "25 instances" if instanced else "25 meshes"
            compare(kind, files, "--per-pixel", "4", **how)
        size = ("--per-pixel", "32", "--width", "160", "--height", "120")
        for small in SMALL:
            moving = SCENES / f"{small}.xml"
            files = {"still": write_posed(moving, POSED_AT, folder), "moves": moving}
            compare(small, files, *size, **how)


if __name__ == "__main__":
    main()
