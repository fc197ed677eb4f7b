"""The error of chains at growing numbers of mutations."""

import sys
from dataclasses import dataclass, field

import numpy as np
from convergence import Estimate, estimate, floor, noise_uncertainty, share_of_mean, slope
from plates import SAMPLINGS, Chains, Experiment, Run

SIGMA = 0.01
ALL_CHAINS = [
    Chains(sampling, SIGMA, delayed) for sampling in SAMPLINGS for delayed in (False, True)
]


@dataclass(frozen=True)
class Sequences:
    """Runs by count and seed, the first seed's image at each count, and the mean image of all seeds
    at the last."""

    runs: dict[Chains, list[list[Run]]] = field(default_factory=dict)
    images: dict[Chains, list[np.ndarray]] = field(default_factory=dict)
    means: dict[Chains, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Fit:
    """How one measure of the squared error falls with the path evaluations, the bootstrap's, which
    place the seeds, among them. floor_share: relative to the last squared error.
    of_mean: see convergence.share_of_mean()."""

    slope: Estimate
    floor_share: Estimate
    of_mean: Estimate


def measure(experiment: Experiment, counts: tuple[int, ...], seeds: int) -> Sequences:
    """Every render has a seed of its own, so that all are independent."""
    out = Sequences()
    shape = experiment.reference.mean.shape
    for chains in ALL_CHAINS:
        out.runs[chains] = [[] for _ in counts]
        out.images[chains] = []
        out.means[chains] = np.zeros(shape)
    for number in range(1, seeds + 1):
        for level, count in enumerate(counts):
            for chains in ALL_CHAINS:
                seed = 1000 * (level + 1) + number
                run, image = experiment.render(chains.variant, count, seed)
                out.runs[chains][level].append(run)
                if number == 1:
                    out.images[chains].append(image)
                if count == counts[-1]:
                    out.means[chains] += image / seeds
        print(f"sequence: seed {number}/{seeds}", file=sys.stderr)
    return out


def fit(experiment: Experiment, sequences: Sequences, chains: Chains) -> dict[str, Fit]:
    reference = experiment.reference
    ones = np.ones_like(reference.mean)
    return {
        "RMSE": fit_one(
            sequences.runs[chains],
            [[run.mse for run in runs] for runs in sequences.runs[chains]],
            reference.mse(sequences.means[chains]),
            noise_uncertainty(reference, ones),
        ),
        "RMSE elsewhere": fit_one(
            sequences.runs[chains],
            [[run.mse_elsewhere for run in runs] for runs in sequences.runs[chains]],
            reference.mse_elsewhere(sequences.means[chains]),
            noise_uncertainty(reference, ones * ~reference.bright()[..., None]),
        ),
        "root of relMSE": fit_one(
            sequences.runs[chains],
            [[run.relative_mse for run in runs] for runs in sequences.runs[chains]],
            reference.relative_mse(sequences.means[chains]),
            noise_uncertainty(reference, 1 / reference.scale()),
        ),
    }


def bright_shares(experiment: Experiment, sequences: Sequences) -> list[float]:
    """Of the squared error at the last count: what the brightest hundredth of pixels carries."""
    mean = experiment.reference.mean
    bright = experiment.reference.bright()
    squares = [((images[-1] - mean) ** 2).sum(axis=-1) for images in sequences.images.values()]
    return [float(s[bright].sum() / s.sum()) for s in squares]


def fit_one(
    levels: list[list[Run]], errors: list[list[float]], of_mean: float, uncertainty: float
) -> Fit:
    flat = [error for of_level in errors for error in of_level]
    last = float(np.mean(errors[-1]))
    left = floor([run.evaluations for runs in levels for run in runs], flat, uncertainty)
    share = estimate(left.value / last, left.standard_error / last, len(flat) - 2)
    falling = slope([runs[0].evaluations for runs in levels], errors)
    return Fit(falling, share, share_of_mean(errors[-1], of_mean, uncertainty))
