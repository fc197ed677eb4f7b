#!/usr/bin/env python3
"""Writes the generated meshes of the scenes in this directory (surfaces of revolution, and lamps).

usage: make_meshes.py            writes every mesh; the output is committed and does not change
                                 between runs

One mesh per file format that the importer reads, so that the scenes exercise all of them:
ring.ply (text PLY), vase.obj (OBJ with normals) and goblet.serialized (Mitsuba's own, version 4).
"""

import itertools
import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

Point = tuple[float, float]
Vector = tuple[float, float, float]

HERE = Path(__file__).parent


@dataclass
class Mesh:
    positions: list[Vector]
    normals: list[Vector]
    triangles: list[tuple[int, int, int]]


def arc(center: Point, radius: float, start: float, stop: float, steps: int) -> list[Point]:
    """Points on a circle from angle start to stop, both included, in degrees."""
    angles = [math.radians(start + (stop - start) * i / steps) for i in range(steps + 1)]
    return [(center[0] + radius * math.cos(a), center[1] + radius * math.sin(a)) for a in angles]


def smooth(profile: list[Point], rounds: int) -> list[Point]:
    """Chaikin's corner cutting; the two ends stay where they are."""
    for _ in range(rounds):
        cut = [profile[0]]
        for (r0, y0), (r1, y1) in itertools.pairwise(profile):
            cut.append((0.75 * r0 + 0.25 * r1, 0.75 * y0 + 0.25 * y1))
            cut.append((0.25 * r0 + 0.75 * r1, 0.25 * y0 + 0.75 * y1))
        profile = [*cut, profile[-1]]
    return profile


def profile_normals(profile: list[Point], closed: bool) -> list[Point]:
    """Normals in the (r, y) half plane, to the right of the direction of travel.

    Each is the mean over the adjoining segments weighted by their length, so that a long straight
    wall keeps its direction up to a small bevel.
    """
    count = len(profile)
    normals = []
    for i in range(count):
        before = profile[(i - 1) % count] if closed or i > 0 else profile[i]
        after = profile[(i + 1) % count] if closed or i + 1 < count else profile[i]
        r, y = after[0] - before[0], after[1] - before[1]
        length = math.hypot(r, y)
        normals.append((y / length, -r / length))
    return normals


def revolve(profile: list[Point], segments: int, closed: bool) -> Mesh:
    """Turns a profile around the y axis. Travelling up the outside gives outward normals."""
    mesh = Mesh([], [], [])
    normals = profile_normals(profile, closed)
    for s in range(segments):
        angle = 2 * math.pi * s / segments
        c, n = math.cos(angle), math.sin(angle)
        mesh.positions += [(r * c, y, r * n) for r, y in profile]
        mesh.normals += [(r * c, y, r * n) for r, y in normals]
    rows = len(profile)
    for s in range(segments):
        a, b = s * rows, (s + 1) % segments * rows
        for i in range(rows if closed else rows - 1):
            j = (i + 1) % rows
            # On the axis a quad collapses to one triangle.
            if profile[j][0] > 0:
                mesh.triangles.append((a + i, a + j, b + j))
            if profile[i][0] > 0:
                mesh.triangles.append((a + i, b + j, b + i))
    return mesh


def write_ply(path: Path, mesh: Mesh) -> None:
    """With normals, if the mesh has any."""
    with path.open("w", encoding="ascii", newline="\n") as out:
        out.write("ply\nformat ascii 1.0\ncomment made by make_meshes.py\n")
        out.write(f"element vertex {len(mesh.positions)}\n")
        for name in ["x", "y", "z"] + ["nx", "ny", "nz"] * bool(mesh.normals):
            out.write(f"property float {name}\n")
        out.write(f"element face {len(mesh.triangles)}\n")
        out.write("property list uchar int vertex_indices\nend_header\n")
        for p, n in itertools.zip_longest(mesh.positions, mesh.normals, fillvalue=()):
            out.write(" ".join(f"{v:.5g}" for v in (*p, *n)) + "\n")
        for a, b, c in mesh.triangles:
            out.write(f"3 {a} {b} {c}\n")


def write_obj(path: Path, mesh: Mesh) -> None:
    with path.open("w", encoding="ascii", newline="\n") as out:
        out.write("# made by make_meshes.py\n")
        for p in mesh.positions:
            out.write("v " + " ".join(f"{v:.5g}" for v in p) + "\n")
        for n in mesh.normals:
            out.write("vn " + " ".join(f"{v:.4g}" for v in n) + "\n")
        for triangle in mesh.triangles:
            out.write("f " + " ".join(f"{i + 1}//{i + 1}" for i in triangle) + "\n")


def write_serialized(path: Path, mesh: Mesh, name: str) -> None:
    has_normals, single_precision = 0x0001, 0x1000
    body = struct.pack("<I", has_normals | single_precision) + name.encode() + b"\0"
    body += struct.pack("<QQ", len(mesh.positions), len(mesh.triangles))
    for vectors in (mesh.positions, mesh.normals):
        body += b"".join(struct.pack("<3f", *v) for v in vectors)
    body += b"".join(struct.pack("<3I", *t) for t in mesh.triangles)
    header = struct.pack("<HH", 0x041C, 4)
    # After the meshes: where each begins (8 bytes each), then how many there are.
    trailer = struct.pack("<QI", 0, 1)
    path.write_bytes(header + zlib.compress(body, 9) + trailer)


def ring() -> Mesh:
    """A polished band, 0.3 high, inner radius 0.82, with rounded edges."""
    inner, outer, height, bevel = 0.82, 0.88, 0.30, 0.015
    profile = []
    corners = [
        (outer, 0.0, -90.0),
        (outer, height, 0.0),
        (inner, height, 90.0),
        (inner, 0.0, 180.0),
    ]
    for r, y, start in corners:
        center = (r - bevel if r == outer else r + bevel, y + bevel if y == 0.0 else y - bevel)
        profile += arc(center, bevel, start, start + 90.0, 2)
    return revolve(profile, 160, closed=True)


def vase() -> Mesh:
    """A thick-walled vase about 0.5 high: a closed solid, as refraction needs."""
    outside = [
        (0.0, 0.0),
        (0.12, 0.0),
        (0.2, 0.1),
        (0.19, 0.24),
        (0.07, 0.34),
        (0.075, 0.42),
        (0.13, 0.5),
    ]
    inside = [
        (0.11, 0.5),
        (0.055, 0.42),
        (0.05, 0.34),
        (0.165, 0.23),
        (0.17, 0.12),
        (0.1, 0.04),
        (0.0, 0.04),
    ]
    return revolve(smooth(outside + inside, 2), 36, closed=False)


def goblet() -> Mesh:
    """A metal cup on a foot, 0.42 high, open at the top with a wall of its own."""
    outside = [
        (0.0, 0.0),
        (0.14, 0.0),
        (0.13, 0.02),
        (0.03, 0.05),
        (0.025, 0.17),
        (0.12, 0.22),
        (0.145, 0.42),
    ]
    inside = [(0.135, 0.42), (0.11, 0.23), (0.0, 0.2)]
    return revolve(smooth(outside + inside, 2), 64, closed=False)


GOLDEN = (1 + math.sqrt(5)) / 2
ICOSAHEDRON = [
    *((0.0, a, b * GOLDEN) for a in (-1.0, 1.0) for b in (-1.0, 1.0)),
    *((a, b * GOLDEN, 0.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)),
    *((b * GOLDEN, 0.0, a) for a in (-1.0, 1.0) for b in (-1.0, 1.0)),
]


def icosahedron_faces() -> list[tuple[int, int, int]]:
    """The twenty triangles of neighbours, counterclockwise from outside."""
    faces = []
    for a, b, c in itertools.combinations(range(12), 3):
        p, q, r = (ICOSAHEDRON[i] for i in (a, b, c))
        if any(abs(math.dist(s, t) - 2) > 1e-9 for s, t in ((p, q), (q, r), (r, p))):
            continue
        u, v = ([q[k] - p[k] for k in range(3)], [r[k] - p[k] for k in range(3)])
        normal = [u[k - 2] * v[k - 1] - u[k - 1] * v[k - 2] for k in range(3)]
        outward = sum(n * x for n, x in zip(normal, p, strict=True)) > 0
        faces.append((a, b, c) if outward else (a, c, b))
    return faces


def lamps(room: int) -> Mesh:
    """Twenty-five icosahedra on a grid of 5 x 5 under the ceiling of one of four rooms."""
    mesh = Mesh([], [], [])
    left, near = 6.0 * (room % 2) - 6.0, 6.0 * (room // 2) - 6.0
    for lamp in range(25):
        # Radii from 2 to 6 cm and heights from 1.4 to 2.4 m, in no order that a row repeats.
        radius = 0.02 + 0.01 * (lamp * 7 % 5)
        center = (left + 1 + lamp % 5, 1.4 + 0.25 * (lamp * 3 % 5), near + 1 + lamp // 5)
        first = len(mesh.positions)
        scale = radius / math.hypot(1, GOLDEN)
        for vertex in ICOSAHEDRON:
            position = [c + scale * v for c, v in zip(center, vertex, strict=True)]
            mesh.positions.append((position[0], position[1], position[2]))
        mesh.triangles += [(a + first, b + first, c + first) for a, b, c in icosahedron_faces()]
    return mesh


def cloth(key: int) -> Mesh:
    """A sheet, 2 wide and 1.3 high, at one of five keys of a wave that runs and swells."""
    columns, rows = 24, 12
    mesh = Mesh([], [], [])
    phase, swing = 0.5 * math.pi * key, 0.2 + 0.03 * key
    for row in range(rows + 1):
        for column in range(columns + 1):
            x, y = 2 * column / columns - 1, 1.3 * row / rows - 0.6
            angle = 4 * x + y - phase
            slope = swing * math.cos(angle)
            scale = 1 / math.sqrt(1 + 17 * slope * slope)
            mesh.positions.append((x, y, swing * math.sin(angle)))
            mesh.normals.append((-4 * slope * scale, -slope * scale, scale))
    for row in range(rows):
        for column in range(columns):
            a = row * (columns + 1) + column
            b = a + columns + 1
            mesh.triangles += [(a, a + 1, b + 1), (a, b + 1, b)]
    return mesh


def main() -> None:
    write_ply(HERE / "ring-caustic" / "ring.ply", ring())
    write_obj(HERE / "door-ajar" / "vase.obj", vase())
    write_serialized(HERE / "door-ajar" / "goblet.serialized", goblet(), "goblet")
    for room in range(4):
        write_ply(HERE / "many-lights" / f"lamps{room}.ply", lamps(room))
    for key in range(5):
        write_ply(HERE / "motion" / f"cloth{key}.ply", cloth(key))


if __name__ == "__main__":
    main()
