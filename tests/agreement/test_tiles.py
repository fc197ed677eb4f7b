"""Is the instrument true? Its false alarms and its power, on noise of a known law."""

import numpy as np
import pytest

from tiles import FAMILY_RATE, compare, exact, from_replicas, tile_means

REPLICAS = 16
SHAPE = (48, 48, 3)


def noisy(truth: np.ndarray, rng: np.random.Generator, spread: float) -> list[np.ndarray]:
    """Replicas whose pixels have gamma noise, skewed as a renderer's is, and a common factor
    as from a shared normalization."""
    shape = 1.0 / spread**2
    common = rng.normal(1.0, 0.02, size=REPLICAS)
    return [c * truth * rng.gamma(shape, 1.0 / shape, size=truth.shape) for c in common]


@pytest.fixture
def truth() -> np.ndarray:
    return np.random.default_rng(1).uniform(0.05, 2.0, size=SHAPE)


def test_tile_means_average_blocks() -> None:
    image = np.zeros((16, 8, 1))
    image[8:, :, 0] = 3.0
    assert tile_means(image).tolist() == [[[0.0]], [[3.0]]]


def test_tile_means_refuse_a_ragged_image() -> None:
    with pytest.raises(ValueError, match="multiple"):
        tile_means(np.zeros((10, 8, 3)))


def test_false_alarms_are_as_rare_as_stated(truth: np.ndarray) -> None:
    """H0 holds in 400 trials; alarms are binomial with FAMILY_RATE, 5 or more has probability
    below 1e-4. The common factor makes tiles dependent, for which Sidak is conservative."""
    rng = np.random.default_rng(2)
    alarms = sum(
        not compare(from_replicas(noisy(truth, rng, 0.5)), exact(truth)).agrees for _ in range(400)
    )
    assert alarms < 5, f"{alarms} false alarms in 400 trials at a stated rate of {FAMILY_RATE}"


def test_one_biased_tile_is_found(truth: np.ndarray) -> None:
    """Bias of twice the stated detectable difference, in one tile and one channel only."""
    rng = np.random.default_rng(3)
    images = noisy(truth, rng, 0.5)
    verdict = compare(from_replicas(images), exact(truth))
    assert verdict.agrees
    factor = 1.0 + 2.0 * verdict.detectable[2, 4, 1]
    for image in images:
        image[16:24, 32:40, 1] *= factor
    biased = compare(from_replicas(images), exact(truth))
    assert not biased.agrees
    assert np.argwhere(biased.p_values < biased.threshold).tolist() == [[2, 4, 1]]


def test_bias_that_keeps_the_image_mean_is_found(truth: np.ndarray) -> None:
    """What a chain with a wrong acceptance rule does: light moves, the mean stays."""
    images = noisy(truth, np.random.default_rng(4), 0.5)
    verdict = compare(from_replicas(images), exact(truth))
    shift = 2.0 * float(verdict.detectable.max()) * float(tile_means(truth).max())
    for image in images:
        image[0:8, 0:8] += shift
        image[8:16, 8:16] -= shift
    assert not compare(from_replicas(images), exact(truth)).agrees


def test_exact_images_must_agree_to_rounding(truth: np.ndarray) -> None:
    same = [truth.astype(np.float32)] * REPLICAS
    assert compare(from_replicas(same), exact(truth)).agrees
    off = [1.0001 * truth] * REPLICAS
    assert not compare(from_replicas(off), exact(truth)).agrees
