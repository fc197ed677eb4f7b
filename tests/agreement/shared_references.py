"""What is stored of Mitsuba's images of the shared scenes: references/shared.npz."""

import numpy as np

from blocks import LEVELS, block_means
from cases import REFERENCES
from plugin_references import Reader, Reference

FILE = REFERENCES / "shared.npz"

# Independent runs of Mitsuba.
RUNS = 32

# Bits kept of the significands: 2^-16 of a mean is within what Mitsuba's own sums round off, and
# a standard error from 32 runs is known to 13 % only.
MEAN_BITS = 15
ERROR_BITS = 7


def rounded(values: np.ndarray, bits: int) -> np.ndarray:
    """Single precision with this many bits after the leading one; the rest is zero."""
    fraction, exponent = np.frexp(values)
    scale = 2.0 ** (bits + 1)
    return np.ldexp(np.round(fraction * scale) / scale, exponent).astype(np.float32)


def by_planes(values: np.ndarray) -> np.ndarray:
    """The bytes of each place together: deflate then sees the zeros."""
    return np.ascontiguousarray(values.view(np.uint8).reshape(-1, 4).T)


def from_planes(planes: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(planes.T).reshape(-1).view(np.float32)


def save(references: dict[str, Reference], samples: dict[str, int], version: str) -> None:
    """`samples`: per pixel, of one run, by scene."""
    names = sorted(references)
    stored = [references[name] for name in names]
    means = np.concatenate([one.mean.ravel() for one in stored])
    errors = np.concatenate(
        [one.standard_errors[level].ravel() for one in stored for level in LEVELS]
    )
    np.savez_compressed(
        FILE,
        names=np.array(names),
        sizes=np.array([one.mean.shape[:2] for one in stored], dtype=np.int32),
        mean=by_planes(rounded(means, MEAN_BITS)),
        standard_error=by_planes(rounded(errors, ERROR_BITS)),
        runs=np.int32(RUNS),
        samples_per_pixel=np.array([samples[name] for name in names], dtype=np.int32),
        mitsuba_version=np.str_(version),
    )


def load() -> tuple[dict[str, Reference], dict[str, int]]:
    """The references and the samples per pixel of one run."""
    references, samples = {}, {}
    with np.load(FILE) as stored:
        means = Reader(from_planes(stored["mean"]))
        errors = Reader(from_planes(stored["standard_error"]))
        rows = zip(stored["names"], stored["sizes"], stored["samples_per_pixel"], strict=True)
        for name, size, count in rows:
            mean = means.take((*size, 3))
            shapes = {level: block_means(mean, level).shape for level in LEVELS}
            by_level = {level: errors.take(shape) for level, shape in shapes.items()}
            references[str(name)] = Reference(mean, by_level)
            samples[str(name)] = int(count)
    return references, samples
