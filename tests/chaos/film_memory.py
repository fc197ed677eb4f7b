"""The film in the memory of a running worker.

A film is one allocation that is large enough for the C library to map it by itself: a chunk at the
start of a page whose header has the length of the mapping and the flag for that.
"""

import random
import struct
from collections.abc import Iterator
from pathlib import Path

PAGE = 4096
HEADER = 16  # of a chunk
MAPPED = 2  # flag of a chunk with a mapping of its own
# Makes the C library map whatever is as large, whatever was freed before.
ENVIRONMENT = {"MALLOC_MMAP_THRESHOLD_": str(1 << 20)}


def film_bytes(width: int, height: int, layers: int) -> int:
    """Two halves of three channels of 64 bits; see worker/film/film.h."""
    return width * height * layers * 2 * 3 * 8


def anonymous(pid: int) -> Iterator[tuple[int, int]]:
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        words = line.split()
        if words[1].startswith("rw-p") and len(words) == 5:
            first, _, last = words[0].partition("-")
            yield int(first, 16), int(last, 16)


def films(pid: int, size: int) -> list[int]:
    """Where the values of films of this size begin. The process stands still."""
    wanted = ((size + HEADER + PAGE - 1) // PAGE * PAGE) | MAPPED
    found = []
    with Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
        for first, last in anonymous(pid):
            for page in range(first, last - (wanted - MAPPED) + PAGE, PAGE):
                memory.seek(page)
                if struct.unpack("<QQ", memory.read(HEADER))[1] == wanted:
                    found.append(page + HEADER)
    return found


def flip_a_bit(pid: int, size: int, choice: random.Random) -> str:
    """Flips one bit of one value that is not zero; says which, nothing if there is none."""
    for start in films(pid, size):
        with Path(f"/proc/{pid}/mem").open("r+b", buffering=0) as memory:
            memory.seek(start)
            values = memory.read(size)
            used = [i for i in range(0, size, 8 * 61) if any(values[i : i + 8])]
            if not used:
                continue
            at, bit = choice.choice(used), choice.randrange(64)
            memory.seek(start + at + bit // 8)
            memory.write(bytes([values[at + bit // 8] ^ 1 << bit % 8]))
            return f"bit {bit} of value {at // 8}"
    return ""
