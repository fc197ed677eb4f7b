"""Is blocks.py a true instrument? Its false alarms and its power, on noise of a known law."""

import numpy as np
import pytest

from blocks import FAMILY_RATE, LEVELS, Sample, Verdict, block_means, compare

REPLICAS = 12
RUNS = 32
SHAPE = (16, 16, 3)


def noisy(truth: np.ndarray, count: int, spread: float, rng: np.random.Generator) -> np.ndarray:
    """Images with gamma noise, skewed as a renderer's is."""
    shape = 1 / spread**2
    return truth * rng.gamma(shape, 1 / shape, size=(count, *truth.shape))


def judge(ours: np.ndarray, runs: np.ndarray) -> list[Verdict]:
    """At all levels, as if there were this one scene."""
    verdicts = []
    for level in LEVELS:
        reference = Sample.of_images(list(runs), level)
        sample = Sample.of_images(list(ours), level)
        verdicts.append(compare(level, sample, reference, reference.mean.size))
    return verdicts


def agrees(ours: np.ndarray, runs: np.ndarray) -> bool:
    return all(verdict.agrees for verdict in judge(ours, runs))


@pytest.fixture
def truth() -> np.ndarray:
    return np.random.default_rng(1).uniform(0.1, 1, size=SHAPE)


def test_blocks_are_means() -> None:
    image = np.arange(64.0).reshape(8, 8, 1)
    assert block_means(image, "pixel").shape == (8, 8, 1)
    assert block_means(image, "tile")[0, 1, 0] == image[:4, 4:].mean()
    assert block_means(image, "quarter").shape == (2, 2, 1)
    assert block_means(image, "whole").ravel().tolist() == [31.5]


def test_blocks_refuse_a_ragged_image() -> None:
    with pytest.raises(ValueError, match="divide"):
        block_means(np.zeros((10, 8, 3)), "tile")


def test_false_alarms_are_as_rare_as_stated(truth: np.ndarray) -> None:
    """H0 holds in 200 trials; alarms are binomial with FAMILY_RATE, 4 or more has probability
    below 1e-4."""
    rng = np.random.default_rng(2)
    alarms = sum(
        not agrees(noisy(truth, REPLICAS, 0.5, rng), noisy(truth, RUNS, 0.2, rng))
        for _ in range(200)
    )
    assert alarms < 4, f"{alarms} false alarms in 200 trials at a stated rate of {FAMILY_RATE}"


def test_a_small_factor_everywhere_is_found(truth: np.ndarray) -> None:
    """Too little for any pixel; twice what the whole image is said to reveal."""
    rng = np.random.default_rng(3)
    ours, runs = noisy(truth, REPLICAS, 0.3, rng), noisy(truth, RUNS, 0.1, rng)
    whole = judge(ours, runs)[LEVELS.index("whole")]
    verdicts = judge(ours * (1 + 2 * whole.typical_detectable), runs)
    assert verdicts[LEVELS.index("pixel")].agrees
    assert not verdicts[LEVELS.index("whole")].agrees


def test_light_that_moves_is_found(truth: np.ndarray) -> None:
    """The whole image keeps its mean."""
    rng = np.random.default_rng(4)
    ours, runs = noisy(truth, REPLICAS, 0.1, rng), noisy(truth, RUNS, 0.03, rng)
    ours[:, :4, :4] += 0.1
    ours[:, 4:8, :4] -= 0.1
    verdicts = judge(ours, runs)
    assert verdicts[LEVELS.index("whole")].agrees
    assert not verdicts[LEVELS.index("tile")].agrees


def test_one_wrong_pixel_is_found(truth: np.ndarray) -> None:
    rng = np.random.default_rng(5)
    ours, runs = noisy(truth, REPLICAS, 0.1, rng), noisy(truth, RUNS, 0.03, rng)
    ours[:, 7, 9, 1] *= 1.6
    pixel = judge(ours, runs)[LEVELS.index("pixel")]
    assert np.argwhere(pixel.p_values < pixel.threshold).tolist() == [[7, 9, 1]]


def test_rare_bright_samples_are_no_false_alarm() -> None:
    """Pixels lit by one sample in 200 only, of which some see none in all replicas: with the
    reference's error as the least, none is reported."""
    rng = np.random.default_rng(6)
    samples, reference_samples = 100, 512
    ours = 200 * rng.binomial(samples, 0.005, size=(REPLICAS, *SHAPE)) / samples
    runs = 200 * rng.binomial(reference_samples, 0.005, size=(RUNS, *SHAPE)) / reference_samples
    reference = Sample.of_images(list(runs), "pixel")
    scale = np.sqrt(RUNS * reference_samples / (REPLICAS * samples))
    sample = Sample.of_images(list(ours), "pixel").with_error_at_least(reference.error * scale)
    assert compare("pixel", sample, reference, reference.mean.size).agrees
