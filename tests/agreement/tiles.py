"""Tests whether independent replicas of an image agree with a reference, tile by tile.

H0: in every tile and channel, the mean of the renderer's tile mean equals the reference's.
Statistic, per tile and channel: the difference of means over its standard error, from the variance
between the replicas (each a whole run of its own, so noise that is correlated inside a run, as in
Markov chains or through a shared normalization, is accounted for) and the reference's standard
error. It is Student-t with Welch's degrees of freedom.
Threshold: Sidak's correction over tiles x channels, for a false-alarm rate of FAMILY_RATE per test.

The image mean is never the criterion: it is fixed by the normalization whatever the chains do.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from cases import TILE

FAMILY_RATE = 1e-3


@dataclass(frozen=True)
class Estimate:
    """Tile means with their standard errors; degrees is infinite for exact values."""

    mean: np.ndarray
    standard_error: np.ndarray
    degrees: float


@dataclass(frozen=True)
class Verdict:
    """Outcome of a test; the arrays are per tile row, tile column and channel."""

    p_values: np.ndarray
    threshold: float
    relative_difference: np.ndarray
    detectable: np.ndarray

    @property
    def agrees(self) -> bool:
        return bool(np.all(self.p_values >= self.threshold))

    @property
    def typical_detectable(self) -> float:
        """Relative difference that the median tile would reveal with probability 1/2."""
        return float(np.median(self.detectable))

    def describe(self) -> str:
        worst = np.unravel_index(np.argmin(self.p_values), self.p_values.shape)
        row, column, channel = (int(i) for i in worst)
        return (
            f"{np.count_nonzero(self.p_values < self.threshold)} of {self.p_values.size} "
            f"tile-channels disagree (p < {self.threshold:.1e}); worst: tile row {row}, column "
            f"{column}, channel {'RGB'[channel]}, p = {self.p_values[worst]:.1e}, difference "
            f"{100 * self.relative_difference[worst]:+.2f} %; the median tile reveals "
            f"{100 * self.typical_detectable:.2f} %"
        )


def tile_means(image: np.ndarray) -> np.ndarray:
    """Means over TILE x TILE pixels of an (H, W, C) image, both sides multiples of TILE."""
    height, width, channels = image.shape
    if height % TILE or width % TILE:
        raise ValueError(f"{width} x {height} is not a multiple of {TILE}")
    blocks = image.astype(np.float64).reshape(height // TILE, TILE, width // TILE, TILE, channels)
    return blocks.mean(axis=(1, 3))


def from_replicas(images: list[np.ndarray]) -> Estimate:
    tiles = np.stack([tile_means(image) for image in images])
    error = tiles.std(axis=0, ddof=1) / np.sqrt(len(images))
    return Estimate(tiles.mean(axis=0), error, len(images) - 1)


def exact(image: np.ndarray) -> Estimate:
    means = tile_means(image)
    return Estimate(means, np.zeros_like(means), np.inf)


def compare(ours: Estimate, reference: Estimate) -> Verdict:
    variance = ours.standard_error**2 + reference.standard_error**2
    # Tiles without any variance (black, or exact on both sides) still must agree to rounding.
    rounding = 1e-6 * np.abs(reference.mean) + 1e-12
    error = np.maximum(np.sqrt(variance), rounding)
    degrees = error**4 / np.maximum(
        ours.standard_error**4 / ours.degrees + reference.standard_error**4 / reference.degrees,
        1e-300,
    )
    degrees = np.clip(degrees, 1.0, 1e9)
    difference = ours.mean - reference.mean
    p_values = 2.0 * stats.t.sf(np.abs(difference) / error, degrees)
    threshold = -np.expm1(np.log1p(-FAMILY_RATE) / p_values.size)
    scale = np.maximum(np.abs(reference.mean), 1e-12)
    detectable = stats.t.isf(threshold / 2.0, degrees) * error / scale
    return Verdict(p_values, threshold, difference / scale, detectable)
