"""Subdivided meshes of pbrt scenes as PLY files, for twins in Mitsuba's words.

Loop's scheme with Warren's weights, moved to the limit surface, with the limit's normals: Schroeder
and Zorin, "Subdivision for Modeling and Animation" (SIGGRAPH 2000 course notes), section 4.
At a boundary as pbrt: its curve ends at 3/5, 1/5, 1/5 of a vertex and its neighbours.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np


def read_cage(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (m, 3) of the only loopsubdiv of a pbrt file."""
    text = file.read_text()
    arrays = dict(re.findall(r'"(?:integer|point3) (\w+)"\s*\[([^\]]*)\]', text))
    points = np.array(arrays["P"].split(), dtype=float).reshape(-1, 3)
    triangles = np.array(arrays["indices"].split(), dtype=int).reshape(-1, 3)
    return points, triangles


def opposite_corners(triangles: np.ndarray) -> dict[tuple[int, int], int]:
    """The third corner of the triangle to the left of each directed edge."""
    found = {}
    for a, b, c in triangles.tolist():
        found.update({(a, b): c, (b, c): a, (c, a): b})
    return found


@dataclass(frozen=True)
class Ring:
    """The neighbours of a vertex, counter-clockwise; on a boundary from end to end of it."""

    neighbours: list[int]
    open: bool

    def average(self, vertex: int, points: np.ndarray, inner: float, ends: float) -> np.ndarray:
        """Each neighbour has the weight `inner`; where it is open, only its ends count."""
        weight = ends if self.open else inner
        chosen = [self.neighbours[0], self.neighbours[-1]] if self.open else self.neighbours
        rest = 1 - len(chosen) * weight
        return rest * points[vertex] + weight * points[chosen].sum(axis=0)

    def normal(self, vertex: int, points: np.ndarray) -> np.ndarray:
        around = points[self.neighbours]
        count = len(around)
        if not self.open:
            angles = 2 * np.pi * np.arange(count) / count
            return np.cross(np.cos(angles) @ around, np.sin(angles) @ around)
        along = around[-1] - around[0]
        if count == 2:
            across = around[0] + around[1] - 2 * points[vertex]
        elif count == 3:
            across = around[1] - points[vertex]
        else:
            step = np.pi / (count - 1)
            weights = (2 * np.cos(step) - 2) * np.sin(step * np.arange(count))
            weights[[0, -1]] = np.sin(step)
            across = -weights @ around
        return np.cross(across, along)


def rings(count: int, triangles: np.ndarray) -> list[Ring]:
    third = opposite_corners(triangles)
    start = {a: b for a, b in third}
    start.update({a: b for a, b in third if (b, a) not in third})
    result = []
    for vertex in range(count):
        ring = [start[vertex]]
        while (vertex, ring[-1]) in third and (following := third[vertex, ring[-1]]) != ring[0]:
            ring.append(following)
        result.append(Ring(ring, (vertex, ring[-1]) not in third))
    return result


def neighbour_weight(valence: int) -> float:
    return 3 / 16 if valence == 3 else 3 / (8 * valence)


def limit_weight(valence: int) -> float:
    return 1 / (valence + 3 / (8 * neighbour_weight(valence)))


def subdivide(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    third = opposite_corners(triangles)
    moved = []
    for vertex, ring in enumerate(rings(len(points), triangles)):
        weight = neighbour_weight(len(ring.neighbours))
        moved.append(ring.average(vertex, points, weight, 1 / 8))
    middle = {}
    for a, b in third:
        if (a, b) in middle:
            continue
        middle[a, b] = middle[b, a] = len(moved)
        ends = points[[a, b]].sum(axis=0)
        if (b, a) in third:
            moved.append(3 / 8 * ends + 1 / 8 * points[[third[a, b], third[b, a]]].sum(axis=0))
        else:
            moved.append(ends / 2)
    finer = []
    for a, b, c in triangles.tolist():
        ab, bc, ca = middle[a, b], middle[b, c], middle[c, a]
        finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.array(moved), np.array(finer)


def limit(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and unit normals on the limit surface."""
    around = rings(len(points), triangles)
    weights = [limit_weight(len(ring.neighbours)) for ring in around]
    places = np.stack([ring.average(i, points, weights[i], 1 / 5) for i, ring in enumerate(around)])
    normals = np.stack([ring.normal(i, places) for i, ring in enumerate(around)])
    return places, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def write_ply(cage: Path, levels: int, file: Path) -> None:
    points, triangles = read_cage(cage)
    for _ in range(levels):
        points, triangles = subdivide(points, triangles)
    places, normals = limit(points, triangles)
    names = ("x", "y", "z", "nx", "ny", "nz")
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(places)}",
        *(f"property float {name}" for name in names),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    vertices = [" ".join(f"{x:.9g}" for x in row) for row in np.hstack([places, normals])]
    faces = [f"3 {a} {b} {c}" for a, b, c in triangles.tolist()]
    file.write_text("\n".join([*header, *vertices, *faces, ""]))
