"""The tiny images and meshes that the scenes use."""

import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR

SIZE = 8


def write_png(path: Path, pixels: np.ndarray) -> None:
    """8 or 16 bits per channel, (H, W, C) with C = 1 (grey), 3 or 4."""
    height, width, channels = pixels.shape
    bits = 8 * pixels.dtype.itemsize
    colour_type = {1: 0, 3: 2, 4: 6}[channels]
    big_endian = pixels.astype(pixels.dtype.newbyteorder(">"))
    rows = b"".join(b"\0" + row.tobytes() for row in big_endian)

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


def write_exr(path: Path, pixels: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as image:
        image.write(str(path))


def colours(rng: np.random.Generator) -> np.ndarray:
    """A ramp in each direction plus noise: no symmetry that could hide a flip."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / (SIZE - 1)
    base = np.stack([0.1 + 0.8 * u, 0.15 + 0.7 * v, 0.9 - 0.4 * u - 0.4 * v], axis=-1)
    return np.clip(base + rng.uniform(-0.1, 0.1, base.shape), 0, 1)


def normals() -> np.ndarray:
    """Waves; of unit length, as rgb = (n + 1) / 2."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] * (2 * np.pi / SIZE)
    n = np.stack([0.4 * np.sin(u), 0.3 * np.cos(v + 0.5), np.ones_like(u)], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return (n + 1) / 2


def sky() -> np.ndarray:
    """16 x 8, a bright patch off the axes over a gradient."""
    v, u = np.mgrid[0:8, 0:16]
    image = np.stack([0.2 + 0.03 * u, 0.5 - 0.03 * v + 0.01 * u, 0.2 + 0.05 * v], axis=-1)
    image[1:3, 10:12] = (6, 5, 3)
    return image.astype(np.float32)


def write_images(folder: Path) -> None:
    rng = np.random.default_rng(7)
    picture = colours(rng)
    as_bytes = lambda image: np.round(255 * image).astype(np.uint8)  # noqa: E731
    write_png(folder / "colours.png", as_bytes(picture))
    write_png(folder / "colours-16.png", np.round(65535 * picture).astype(np.uint16))
    alpha = rng.uniform(0.2, 1, (SIZE, SIZE, 1))
    write_png(folder / "colours-alpha.png", as_bytes(np.concatenate([picture, alpha], axis=-1)))
    write_exr(folder / "colours.exr", (0.2 + 0.7 * picture).astype(np.float16))
    write_png(folder / "grey.png", as_bytes(rng.uniform(0.15, 0.75, (SIZE, SIZE, 1))))
    v, u = np.mgrid[0:SIZE, 0:SIZE] * (2 * np.pi / SIZE)
    heights = 0.5 + 0.25 * np.sin(u) + 0.2 * np.cos(v + 0.3 * u)
    write_png(folder / "heights.png", as_bytes(heights[..., None]))
    write_png(folder / "normals.png", as_bytes(normals()))
    wide = np.concatenate([picture, picture[::-1, :, ::-1]], axis=1)
    write_png(folder / "wide.png", as_bytes(wide))
    write_exr(folder / "sky.exr", sky())


def write_wedge(path: Path) -> None:
    """A closed wedge with a normal per corner, bent off its faces, and texture coordinates."""
    points = [
        (-1, -0.8, 0.6),
        (1, -0.8, 0.6),
        (1, -0.8, -0.7),
        (-1, -0.8, -0.7),
        (-0.7, 0.9, -0.1),
        (0.8, 0.7, 0),
    ]
    uvs = [(0, 0), (1, 0), (1, 0.4), (0.1, 0.5), (0.2, 0.9), (0.9, 1)]
    faces = [(1, 2, 6), (1, 6, 5), (3, 4, 5), (3, 5, 6), (4, 1, 5), (2, 3, 6), (4, 3, 2), (4, 2, 1)]
    centre = np.mean(points, axis=0)
    lines = ["# written by make.py"]
    lines += [f"v {x} {y} {z}" for x, y, z in points]
    lines += [f"vt {u} {v}" for u, v in uvs]
    for point in points:
        n = np.array(point) - centre
        n /= np.linalg.norm(n)
        lines.append(f"vn {n[0]:.6f} {n[1]:.6f} {n[2]:.6f}")
    lines += ["f " + " ".join(f"{i}/{i}/{i}" for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def write_bare(path: Path) -> None:
    """An octahedron: positions only."""
    points = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    faces = [(5, 1, 3), (5, 3, 2), (5, 2, 4), (5, 4, 1), (6, 3, 1), (6, 2, 3), (6, 4, 2), (6, 1, 4)]
    lines = ["# written by make.py"] + [f"v {x} {y} {z}" for x, y, z in points]
    lines += ["f {} {} {}".format(*face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


VERTEX_PROPERTIES = ["x", "y", "z", "nx", "ny", "nz", "u", "v", "r", "g", "b"]

Mesh = tuple[np.ndarray, np.ndarray]


def patch() -> Mesh:
    """A bent 3 x 3 grid: x y z nx ny nz u v r g b per vertex, and its triangles."""
    rows = []
    for j in range(3):
        for i in range(3):
            x, y = i - 1.0, j - 1.0
            n = np.array([0.6 * x, 0.3 * y, 1.0])
            n /= np.linalg.norm(n)
            colour = (0.1 + 0.4 * i, 0.9 - 0.3 * j, 0.2 + 0.1 * i * j)
            rows.append((x, y, -0.3 * x * x - 0.15 * y * y, *n, i / 2, j * j / 4, *colour))
    triangles = []
    for j in range(2):
        for i in range(2):
            a = 3 * j + i
            triangles += [(a, a + 1, a + 4), (a, a + 4, a + 3)]
    return np.array(rows, dtype=np.float32), np.array(triangles, dtype=np.int32)


def write_ply(path: Path, mesh: Mesh, binary: bool) -> None:
    vertices, triangles = mesh
    form = "binary_little_endian" if binary else "ascii"
    header = [f"ply\nformat {form} 1.0\ncomment written by make.py\nelement vertex {len(vertices)}"]
    header += [f"property float {name}" for name in VERTEX_PROPERTIES]
    header += [
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    head = ("\n".join(header) + "\n").encode()
    if binary:
        faces = b"".join(b"\x03" + row.astype("<i4").tobytes() for row in triangles)
        path.write_bytes(head + vertices.astype("<f4").tobytes() + faces)
        return
    lines = [" ".join(f"{x:.6g}" for x in row) for row in vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in triangles]
    path.write_bytes(head + ("\n".join(lines) + "\n").encode())


def serialized_mesh(name: str, mesh: Mesh) -> bytes:
    """One mesh in Mitsuba's format, version 4: normals, texture coordinates, single precision."""
    vertices, triangles = mesh
    flags = 0x0001 | 0x0002 | 0x1000
    body = struct.pack("<I", flags) + name.encode() + b"\0"
    body += struct.pack("<QQ", len(vertices), len(triangles))
    for columns in (slice(0, 3), slice(3, 6), slice(6, 8)):
        body += vertices[:, columns].astype("<f4").tobytes()
    body += triangles.astype("<u4").tobytes()
    return struct.pack("<HH", 0x041C, 4) + zlib.compress(body, 9)


def write_serialized(path: Path, meshes: list[Mesh]) -> None:
    parts = [serialized_mesh(f"mesh{i}", mesh) for i, mesh in enumerate(meshes)]
    offsets = [sum(map(len, parts[:i])) for i in range(len(parts))]
    end = struct.pack(f"<{len(parts)}Q", *offsets) + struct.pack("<I", len(parts))
    path.write_bytes(b"".join(parts) + end)


INCLUDED = """<!-- Part of format-directives.xml. -->
<scene version="3.0.0">
  <shape type="cube">
    <transform name="to_world"><scale value="0.3"/><translate x="1" y="-0.6" z="0.5"/></transform>
    <ref id="paint"/>
  </shape>
</scene>
"""


def write_assets(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    write_images(folder)
    write_wedge(folder / "wedge.obj")
    write_bare(folder / "bare.obj")
    mesh = patch()
    write_ply(folder / "patch.ply", mesh, binary=False)
    write_ply(folder / "patch-binary.ply", mesh, binary=True)
    other = (mesh[0] * np.float32(0.5), mesh[1])
    write_serialized(folder / "meshes.serialized", [other, mesh])
    (folder / "included.xml").write_text(INCLUDED)
