"""Makes the files in files/: one small picture in many formats.

usage: make_files.py        needs mitsuba 3.9.1 (for JPEG and compressed OpenEXR)

Channel c of pixel (x, y), counted from the upper left corner, is byte(x, y, c) in integer formats
and number(x, y, c) in those of floating point.
"""

import pathlib
import struct
import zlib

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

FILES = pathlib.Path(__file__).parent / "files"
WIDTH, HEIGHT = 5, 4


def byte(x, y, c):
    return 40 * x + 20 * y + 7 * c


def number(x, y, c):
    return x * 0.5 + y * 4 + c * 0.125


def picture(value, channels, dtype):
    return np.array(
        [[[value(x, y, c) for c in range(channels)] for x in range(WIDTH)] for y in range(HEIGHT)],
        dtype=dtype,
    )


def save(name, data):
    (FILES / name).write_bytes(data)


# ---- PNG ----


def png(colour_type, bits, rows, palette=b""):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, bits, colour_type, 0, 0, 0)
    out = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    if palette:
        out += chunk(b"PLTE", palette)
    pixels = b"".join(b"\0" + row for row in rows)
    return out + chunk(b"IDAT", zlib.compress(pixels, 9)) + chunk(b"IEND", b"")


def make_png():
    for name, colour_type, channels in (("grey", 0, 1), ("rgb", 2, 3), ("grey_alpha", 4, 2), ("rgba", 6, 4)):
        save(f"{name}8.png", png(colour_type, 8, [r.tobytes() for r in picture(byte, channels, np.uint8)]))
        words = picture(lambda x, y, c: 257 * byte(x, y, c) + 1, channels, ">u2")
        save(f"{name}16.png", png(colour_type, 16, [r.tobytes() for r in words]))
    palette = picture(byte, 3, np.uint8).tobytes()
    rows = [bytes(range(WIDTH * y, WIDTH * (y + 1))) for y in range(HEIGHT)]
    save("palette8.png", png(3, 8, rows, palette))
    save("grey1.png", png(0, 1, [bytes([0b10100000 >> (y % 2)]) for y in range(HEIGHT)]))


# ---- BMP and TGA ----


def bgr(channels):
    pixels = picture(byte, channels, np.uint8)
    pixels[..., :3] = pixels[..., 2::-1]
    return pixels


def bmp(bits, rows, height, palette=b""):
    rows = b"".join(r + b"\0" * (-len(r) % 4) for r in rows)
    start = 54 + len(palette)
    header = b"BM" + struct.pack("<IHHI", start + len(rows), 0, 0, start)
    colours = len(palette) // 4
    info = struct.pack("<IiiHHIIiiII", 40, WIDTH, height, 1, bits, 0, len(rows), 0, 0, colours, 0)
    return header + info + palette + rows


def tga(kind, bits, pixels, descriptor):
    return struct.pack("<BBBHHBHHHHBB", 0, 0, kind, 0, 0, 0, 0, 0, WIDTH, HEIGHT, bits, descriptor) + pixels


def tga_packets(pixels):
    """Runs of one pixel, and every second row as one literal packet."""
    out = b""
    for y, row in enumerate(pixels):
        if y % 2:
            out += bytes([WIDTH - 1]) + row.tobytes()
        else:
            out += b"".join(b"\x80" + p.tobytes() for p in row)
    return out


def make_bmp_and_tga():
    save("rgb.bmp", bmp(24, [r.tobytes() for r in bgr(3)[::-1]], HEIGHT))
    save("top_down.bmp", bmp(24, [r.tobytes() for r in bgr(3)], -HEIGHT))
    palette = b"".join(p.tobytes() + b"\0" for p in bgr(3).reshape(-1, 3))
    rows = [bytes(range(WIDTH * y, WIDTH * (y + 1))) for y in range(HEIGHT)]
    save("palette.bmp", bmp(8, rows[::-1], HEIGHT, palette))
    save("rgb.tga", tga(2, 24, bgr(3)[::-1].tobytes(), 0))
    save("rgba_rle.tga", tga(10, 32, tga_packets(bgr(4)), 0x28))
    save("grey.tga", tga(3, 8, picture(byte, 1, np.uint8).tobytes(), 0x20))


# ---- HDR and PFM ----


def rgbe(x, y, c):
    """Mantissas and exponent of a pixel: mantissa times 2^-4."""
    return byte(x, y, c) if c < 3 else 128 + 8 - 4


def hdr(rows, width=WIDTH):
    header = b"#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n\n"
    return header + f"-Y {HEIGHT} +X {width}\n".encode() + b"".join(rows)


def packed_row(y, width):
    out = struct.pack(">BBH", 2, 2, width)
    for c in range(3):
        out += bytes([width]) + bytes(rgbe(x % WIDTH, y, c) for x in range(width))
    return out + bytes([128 + width, rgbe(0, y, 3)])


def make_hdr_and_pfm():
    rows = [r.tobytes() for r in picture(rgbe, 4, np.uint8)]
    save("flat.hdr", hdr(rows))
    save("packed.hdr", hdr([packed_row(y, 2 * WIDTH) for y in range(HEIGHT)], 2 * WIDTH))
    # Each row: one pixel and that pixel again, four times.
    save("repeats.hdr", hdr([row[:4] + b"\1\1\1\4" for row in rows]))
    save("rgb.pfm", b"PF\n5 4\n-1.0\n" + picture(number, 3, "<f4")[::-1].tobytes())
    save("grey.pfm", b"Pf\n5 4\n1.0\n" + picture(number, 1, ">f4")[::-1].tobytes())


# ---- OpenEXR ----


def exr_header(channels, window, **attributes):
    """channels: names and pixel types (0 uint, 1 half, 2 float)."""
    def attribute(name, kind, data):
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(data)) + data

    sampling = attributes.pop("sampling", 1)
    entries = b"".join(n.encode() + b"\0" + struct.pack("<iiii", t, 0, sampling, sampling) for n, t in channels)
    out = attribute("channels", "chlist", entries + b"\0")
    out += attribute("compression", "compression", b"\0")
    out += attribute("dataWindow", "box2i", struct.pack("<iiii", *window))
    out += attribute("displayWindow", "box2i", struct.pack("<iiii", 0, 0, 9, 9))
    out += attribute("lineOrder", "lineOrder", b"\0")
    out += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    out += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    out += attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    for name, (kind, data) in attributes.items():
        out += attribute(name, kind, data)
    return out + b"\0"


def exr_row(pixels, channels):
    dtypes = {0: "<u4", 1: "<f2", 2: "<f4"}
    index = {"R": 0, "G": 1, "B": 2, "A": 3, "Y": 0, "RY": 1, "BY": 2}
    return b"".join(pixels[:, index[n]].astype(dtypes[t]).tobytes() for n, t in channels)


def exr(channels, chunks, version=2, corner=(-3, 7), **attributes):
    channels = sorted(channels)
    x, y = corner
    window = (x, y, x + WIDTH - 1, y + HEIGHT - 1)
    head = b"\x76\x2f\x31\x01" + struct.pack("<i", version) + exr_header(channels, window, **attributes)
    parts = chunks(channels, y)
    offsets, at = b"", len(head) + 8 * len(parts)
    for part in parts:
        offsets += struct.pack("<Q", at)
        at += len(part)
    return head + offsets + b"".join(parts)


def scanlines(value):
    def chunks(channels, first):
        rows = picture(value, 4, np.float32)
        data = [exr_row(row, channels) for row in rows]
        return [struct.pack("<ii", first + y, len(d)) + d for y, d in enumerate(data)]

    return chunks


def tiles(value, size):
    def chunks(channels, _):
        rows = picture(value, 4, np.float32)
        out = []
        for ty in range(-(-HEIGHT // size)):
            for tx in range(-(-WIDTH // size)):
                tile = rows[ty * size : (ty + 1) * size, tx * size : (tx + 1) * size]
                data = b"".join(exr_row(row, channels) for row in tile)
                out.append(struct.pack("<iiiii", tx, ty, 0, 0, len(data)) + data)
        return out

    return chunks


def make_exr():
    rgb = lambda t: [("R", t), ("G", t), ("B", t)]
    save("half.exr", exr(rgb(1), scanlines(number)))
    save("float_alpha.exr", exr(rgb(2) + [("A", 1)], scanlines(number)))
    save("uint.exr", exr(rgb(0), scanlines(byte)))
    save("grey.exr", exr([("Y", 2)], scanlines(number)))
    tile = ("tiledesc", struct.pack("<IIB", 3, 3, 0))
    save("tiled.exr", exr(rgb(1), tiles(number, 3), version=2 | 0x200, tiles=tile))
    # XYZ in the guise of primaries.
    xyz = struct.pack("<8f", 1, 0, 0, 1, 0, 0, 1 / 3, 1 / 3)
    save("primaries.exr", exr(rgb(2), scanlines(number), chromaticities=("chromaticities", xyz)))
    save("luminance_chroma.exr", exr([("Y", 1), ("RY", 1), ("BY", 1)], scanlines(number)))
    deep = ("string", b"deepscanline")
    save("deep.exr", exr(rgb(1), scanlines(number), version=2 | 0x800, type=deep))
    save("subsampled.exr", exr(rgb(1), scanlines(number), corner=(0, 0), sampling=2))


def make_with_mitsuba():
    for channels, name in ((3, "rgb"), (1, "grey")):
        mi.Bitmap(picture(byte, channels, np.uint8)).write(str(FILES / f"{name}.jpg"), quality=100)
    half = mi.Bitmap(picture(number, 3, np.float32)).convert(component_format=mi.Struct.Type.Float16)
    half.write(str(FILES / "compressed.exr"))


FILES.mkdir(exist_ok=True)
make_png()
make_bmp_and_tga()
make_hdr_and_pfm()
make_exr()
make_with_mitsuba()
