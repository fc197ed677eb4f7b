"""Poses of moving scenes by hand: what a scene of Mitsuba 3 shows at one instant, without motion.

Every <animation> becomes a <transform> with one matrix and every deforming mesh a .ply file, so
that the result loads in Mitsuba too. Written from what worker/doc/scene-format.md says of motion,
with SciPy's polar decomposition and rotations: nothing is shared with the renderer.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.linalg import polar
from scipy.spatial.transform import Rotation, Slerp

Element = ElementTree.Element


@dataclass(frozen=True, eq=False)
class Key:
    """A <transform time="..."> of an animation."""

    time: float
    matrix: np.ndarray
    # Axis and degrees of each <rotate>, in order.
    turns: tuple[tuple[tuple[float, ...], float], ...]
    # Control points of a Bezier curve before and after the key.
    arriving: np.ndarray
    leaving: np.ndarray

    @property
    def offset(self) -> np.ndarray:
        return self.matrix[:3, 3]

    def parts(self) -> tuple[Rotation, np.ndarray]:
        """Rotation and stretch of the linear part; stretch mirrors where the matrix does."""
        rotation, stretch = polar(self.matrix[:3, :3])
        sign = np.sign(np.linalg.det(rotation))
        return Rotation.from_matrix(sign * rotation), sign * stretch


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.replace(",", " ").split()])


def triple(step: Element, otherwise: float) -> np.ndarray:
    if "value" in step.attrib:
        return np.broadcast_to(numbers(step.attrib["value"]), 3)
    return np.array([float(step.get(axis, otherwise)) for axis in "xyz"])


def look_at(step: Element) -> np.ndarray:
    origin, target, up = (numbers(step.attrib[name]) for name in ("origin", "target", "up"))
    forward = (target - origin) / np.linalg.norm(target - origin)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([left, np.cross(forward, left), forward, origin])
    return matrix


def turn(axis: np.ndarray, degrees: float) -> Rotation:
    return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))


def step_matrix(step: Element) -> np.ndarray:
    matrix = np.eye(4)
    match step.tag:
        case "translate":
            matrix[:3, 3] = triple(step, 0)
        case "scale":
            matrix[:3, :3] = np.diag(triple(step, 1))
        case "rotate":
            matrix[:3, :3] = turn(triple(step, 0), float(step.attrib["angle"])).as_matrix()
        case "lookat":
            matrix = look_at(step)
        case _:
            raise ValueError(f"<{step.tag}> is not known here")
    return matrix


def read_key(transform: Element) -> Key:
    matrix = np.eye(4)
    for step in transform:
        matrix = step_matrix(step) @ matrix
    turns = tuple(
        (tuple(triple(step, 0)), float(step.attrib["angle"])) for step in transform.iter("rotate")
    )
    arriving, leaving = (
        numbers(transform.attrib[name]) if name in transform.attrib else matrix[:3, 3]
        for name in ("in", "out")
    )
    return Key(float(transform.attrib["time"]), matrix, turns, arriving, leaving)


def rotation_between(a: Key, b: Key, u: float) -> Rotation:
    """Along the shorter arc, or all the way where the angle of one and the same turn differs."""
    differs = [i for i, (s, t) in enumerate(zip(a.turns, b.turns, strict=False)) if s != t]
    if len(a.turns) == len(b.turns) and len(differs) == 1:
        changed = differs[0]
        if a.turns[changed][0] == b.turns[changed][0]:
            angle = b.turns[changed][1] - a.turns[changed][1]
            # About the axis as the later turns leave it, from where the first key stands.
            later = Rotation.identity()
            for axis, degrees in a.turns[changed + 1 :]:
                later = turn(np.array(axis), degrees) * later
            axis = later.apply(np.array(a.turns[changed][0]))
            return turn(axis, u * angle) * a.parts()[0]
    ends = Rotation.concatenate([a.parts()[0], b.parts()[0]])
    return Slerp([0, 1], ends)(u)


def hermite(a: np.ndarray, b: np.ndarray, slopes: np.ndarray, u: float) -> np.ndarray:
    """The cubic from a to b with these two derivatives with respect to u."""
    return (
        (2 * u**3 - 3 * u**2 + 1) * a
        + (u**3 - 2 * u**2 + u) * slopes[0]
        + (3 * u**2 - 2 * u**3) * b
        + (u**3 - u**2) * slopes[1]
    )


def velocity(keys: list[Key], i: int) -> np.ndarray:
    """Of a Catmull-Rom curve at a key: that of the parabola through it and its neighbours, and at
    the ends that of the straight way to the next."""
    stretches = [(a, b) for a, b in pairwise(keys) if keys[i] in (a, b)]
    spans = np.array([b.time - a.time for a, b in stretches])
    speeds = np.array([(b.offset - a.offset) / (b.time - a.time) for a, b in stretches])
    # The nearer neighbour weighs more.
    weights = spans[::-1] / spans.sum()
    return weights @ speeds


def offset_between(keys: list[Key], i: int, u: float, interpolation: str) -> np.ndarray:
    a, b = keys[i], keys[i + 1]
    match interpolation:
        case "linear":
            return (1 - u) * a.offset + u * b.offset
        case "bezier":
            points = np.stack([a.offset, a.leaving, b.arriving, b.offset])
            return np.array([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3]) @ points
        case "catmullrom":
            slopes = (b.time - a.time) * np.stack([velocity(keys, i), velocity(keys, i + 1)])
            return hermite(a.offset, b.offset, slopes, u)
    raise ValueError(f"interpolation {interpolation} is not known here")


def pose(animation: Element, time: float) -> np.ndarray:
    """4 x 4, at a time in seconds; before the first key and after the last it is theirs."""
    keys = [read_key(transform) for transform in animation.findall("transform")]
    if time <= keys[0].time:
        return keys[0].matrix
    if time >= keys[-1].time:
        return keys[-1].matrix
    i = max(j for j, key in enumerate(keys) if key.time <= time)
    a, b = keys[i], keys[i + 1]
    u = (time - a.time) / (b.time - a.time)
    stretch = (1 - u) * a.parts()[1] + u * b.parts()[1]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_between(a, b, u).as_matrix() @ stretch
    matrix[:3, 3] = offset_between(keys, i, u, animation.get("interpolation", "linear"))
    return matrix


def read_ply(path: Path) -> tuple[list[str], np.ndarray, list[str]]:
    """Header lines, vertices (rows of positions and normals) and lines of faces of a text file."""
    lines = path.read_text().splitlines()
    body = lines.index("end_header") + 1
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    vertices = np.array([numbers(line) for line in lines[body : body + count]])
    return lines[:body], vertices, lines[body + count :]


def pose_mesh(shape: Element, time: float, source: Path, target: Path) -> None:
    """Makes a deforming mesh one that stands still: vertices and normals on straight lines."""
    names = shape.find("string[@name='filename']").attrib["value"].replace(",", " ").split()
    times_element = shape.find("string[@name='times']")
    times = numbers(times_element.attrib["value"])
    time = float(np.clip(time, times[0], times[-1]))
    i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
    u = (time - times[i]) / (times[i + 1] - times[i])
    header, a, faces = read_ply(source / names[i])
    b = read_ply(source / names[i + 1])[1]
    vertices = (1 - u) * a + u * b
    vertices[:, 3:] /= np.linalg.norm(vertices[:, 3:], axis=1, keepdims=True)
    name = f"posed-{names[0]}"
    rows = [" ".join(f"{value:.9g}" for value in row) for row in vertices]
    (target / name).write_text("\n".join([*header, *rows, *faces]) + "\n")
    shape.set("type", "ply")
    shape.find("string[@name='filename']").set("value", name)
    shape.remove(times_element)


def write_posed(scene: Path, time: float, folder: Path) -> Path:
    """Writes the scene as it is at a time, with what it needs, into a folder; returns its path."""
    document = ElementTree.parse(scene)
    root = document.getroot()
    for element in root.iter():
        for animation in element.findall("animation"):
            matrix = pose(animation, time)
            text = " ".join(f"{value:.12g}" for value in matrix.ravel())
            animation[:] = [ElementTree.Element("matrix", value=text)]
            animation.tag = "transform"
            animation.attrib.pop("interpolation", None)
    for shape in root.iter("shape"):
        if shape.get("type") == "deformable":
            pose_mesh(shape, time, scene.parent, folder)
    sensor = root.find("sensor")
    for name in ("shutter_open", "shutter_close"):
        sensor.remove(sensor.find(f"float[@name='{name}']"))
    path = folder / f"{scene.stem}-posed.xml"
    document.write(path)
    return path


def stratified_times(
    opening: float, closing: float, count: int, rng: np.random.Generator
) -> np.ndarray:
    """One random time in each of count equal parts: the mean over them is unbiased."""
    return opening + (closing - opening) * (np.arange(count) + rng.random(count)) / count


def shutter_of(scene: Path) -> tuple[float, float]:
    sensor = ElementTree.parse(scene).getroot().find("sensor")
    names = ("shutter_open", "shutter_close")
    opening, closing = (float(sensor.find(f"float[@name='{n}']").attrib["value"]) for n in names)
    return opening, closing
