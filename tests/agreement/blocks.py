"""Tests whether independent replicas agree with a reference, in blocks of several sizes.

H0: in every block and channel, the renderer's mean is the reference's. Blocks are single pixels,
tiles of 4 x 4, quarters of the image, and the whole: what shifts one pixel shows in the first, what
shifts many a little in the last. The whole alone would miss light that moves.

Statistic: the difference of means over its standard error, from replicas that are whole jobs of
their own (inside a job, samples are stratified) and from the reference's independent runs. It is
taken as Student-t with the degrees of freedom of the smaller sample, which errs on the safe side;
Welch's estimate of them does not, so far out in the tails (see test_blocks.py). A single pixel gets
few samples, and all replicas may miss the rare bright ones: there the standard error is at least
what the reference's samples lead to expect of as many independent ones.

Threshold: FAMILY_RATE is the probability of any false alarm in all scenes together. Each level has
an equal share; within it, Sidak's correction over scenes x blocks x channels.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

FAMILY_RATE = 1e-3
LEVELS = ("pixel", "tile", "quarter", "whole")
TILE = 4

# Mitsuba adds the 512 samples of a pixel in single precision: relative rounding up to 512 / 2^24.
ROUNDING = 512 / 2**24


def block_size(shape: tuple[int, ...], level: str) -> tuple[int, int]:
    height, width = shape[:2]
    sizes = {
        "pixel": (1, 1),
        "tile": (TILE, TILE),
        "quarter": (height // 2, width // 2),
        "whole": (height, width),
    }
    return sizes[level]


def block_means(image: np.ndarray, level: str) -> np.ndarray:
    """Means over the blocks of an (H, W, C) image whose sides are even multiples of TILE."""
    height, width, channels = image.shape
    rows, columns = block_size(image.shape, level)
    if height % rows or width % columns:
        raise ValueError(f"{width} x {height} does not divide into blocks of {columns} x {rows}")
    blocks = image.astype(np.float64).reshape(
        height // rows, rows, width // columns, columns, channels
    )
    return blocks.mean(axis=(1, 3))


@dataclass(frozen=True)
class Sample:
    """Block means with their standard error and its degrees of freedom."""

    mean: np.ndarray
    error: np.ndarray
    degrees: float

    @staticmethod
    def of_images(images: list[np.ndarray], level: str) -> "Sample":
        blocks = np.stack([block_means(image, level) for image in images])
        error = blocks.std(axis=0, ddof=1) / np.sqrt(len(images))
        return Sample(blocks.mean(axis=0), error, len(images) - 1)

    def with_error_at_least(self, least: np.ndarray) -> "Sample":
        return Sample(self.mean, np.maximum(self.error, least), self.degrees)


@dataclass(frozen=True)
class Verdict:
    """Outcome at one level; arrays are per block row, block column and channel."""

    level: str
    t: np.ndarray
    p_values: np.ndarray
    threshold: float
    difference: np.ndarray
    detectable: np.ndarray
    reference: np.ndarray

    @property
    def agrees(self) -> bool:
        return bool(np.all(self.p_values >= self.threshold))

    @property
    def typical_detectable(self) -> float:
        """Relative difference that the median block reveals with probability 1/2."""
        lit = self.reference > 0
        return float(np.median(self.detectable[lit])) if lit.any() else 0.0

    def describe(self) -> str:
        worst = np.unravel_index(np.argmin(self.p_values), self.p_values.shape)
        row, column, channel = (int(i) for i in worst)
        bad = np.count_nonzero(self.p_values < self.threshold)
        value = float(self.reference[worst])
        return (
            f"{bad} of {self.p_values.size} {self.level}-channels disagree "
            f"(p < {self.threshold:.1e}); worst: row {row}, column {column}, "
            f"{'RGB'[channel]}, t = {self.t[worst]:+.1f}, p = {self.p_values[worst]:.1e}, "
            f"ours {value + self.difference[worst]:.5g}, Mitsuba {value:.5g}"
        )


def share_of_family(tests: int) -> float:
    """Significance of one of `tests` tests at a level."""
    return float(-np.expm1(np.log1p(-FAMILY_RATE / len(LEVELS)) / tests))


def compare(level: str, ours: Sample, reference: Sample, tests: int) -> Verdict:
    """`tests` counts the block-channels of this level in all scenes."""
    variance = ours.error**2 + reference.error**2
    degrees = min(ours.degrees, reference.degrees)
    error = np.maximum(np.sqrt(variance), 1e-12)
    difference = ours.mean - reference.mean
    rounding = ROUNDING * np.abs(reference.mean)
    excess = np.sign(difference) * np.maximum(np.abs(difference) - rounding, 0)
    p_values = 2 * stats.t.sf(np.abs(excess) / error, degrees)
    threshold = share_of_family(tests)
    found = stats.t.isf(threshold / 2, degrees) * error + rounding
    detectable = found / np.maximum(np.abs(reference.mean), 1e-12)
    return Verdict(
        level, excess / error, p_values, threshold, difference, detectable, reference.mean
    )
