"""The film in the memory of a running worker, found by the vector that holds it."""

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np

WORD = 8


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
    """Where the values of films of this size begin. The process stands still.

    A vector is three pointers: to its values, to their end, to the end of what it has room for.
    Those of a film are as far apart as the film is large, and lead to memory of the process.
    """
    regions = list(anonymous(pid))
    found = set()
    with Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
        for first, last in regions:
            memory.seek(first)
            words = np.frombuffer(memory.read(last - first), dtype=np.uint64)
            ends = words[1:-1]
            apart = (ends - words[:-2] == size) & (words[2:] == ends)
            found.update(int(start) for start in words[:-2][apart])
    return sorted(
        start
        for start in found
        if start % WORD == 0 and any(a <= start and start + size <= b for a, b in regions)
    )


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
