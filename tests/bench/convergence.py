"""How errors fall with the number of samples: fitted slopes, and what is left at infinity.

On simulated errors (counts 256, 1024, 2048, 5000; eight renders each) that scatter by 5 %, the
intervals of slope and floor exclude the truth in at most 1 % of cases. A floor of a tenth of the
last squared error is found by the slope in 52 %, by the floor in 85 %; one of three tenths always.
Errors that scatter by half or more hide such floors from both (found in 2 to 6 %, false alarms
still at most 1 %); the error of the mean image, which does not compare counts, finds them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scoring import Reference

LEVEL = 0.99


@dataclass(frozen=True)
class Estimate:
    """A fitted value and its confidence interval at LEVEL."""

    value: float
    standard_error: float
    low: float
    high: float

    def contains(self, value: float) -> bool:
        return self.low <= value <= self.high


def estimate(value: float, standard_error: float, degrees: int) -> Estimate:
    reach = float(stats.t.ppf(0.5 + LEVEL / 2, degrees)) * standard_error
    return Estimate(value, standard_error, value - reach, value + reach)


def slope(counts: Sequence[float], squared_errors: Sequence[Sequence[float]]) -> Estimate:
    """Of log RMSE over log counts; -1/2 without bias. One list of squared errors per count, one
    error per independent render. The RMSE is the root of their mean: where rare bright samples skew
    squared errors, the mean of their logarithms falls at another rate than the error itself."""
    means = np.array([np.mean(errors) for errors in squared_errors])
    if means.min() <= 0:
        raise ValueError("an error is no larger than the reference's own: use a better reference")
    scatter = np.array([stats.sem(errors) for errors in squared_errors]) / means
    x = np.log(counts) - np.mean(np.log(counts))
    weights = x / (x**2).sum()
    error = float(np.sqrt(((weights * 0.5 * scatter) ** 2).sum()))
    return estimate(float((weights * 0.5 * np.log(means)).sum()), error, len(squared_errors[0]) - 1)


def floor(counts: Sequence[float], squared_errors: Sequence[float], uncertainty: float) -> Estimate:
    """F of squared error = a / n + F; 0 without bias. n times the error, which is a + F n, scatters
    alike at all n, so a plain line is the best fit. `uncertainty`: standard error of what has been
    subtracted for the reference, which all points share."""
    n = np.asarray(counts)
    fit = stats.linregress(n, n * np.asarray(squared_errors))
    return estimate(float(fit.slope), float(np.hypot(fit.stderr, uncertainty)), len(n) - 2)


def noise_uncertainty(reference: Reference, weights: np.ndarray) -> float:
    """Standard error of a weighted mean square of the reference's own error, which is stated by its
    expectation. Pixels are independent (box filter), channels taken as fully dependent."""
    per_pixel = (weights * reference.standard_error**2).sum(axis=-1)
    return float(np.sqrt(2 * (per_pixel**2).sum()) / weights.size)


def share_of_mean(single: Sequence[float], of_mean: float, uncertainty: float) -> Estimate:
    """Squared error of the mean of K images over that of one: 1 / K where all of it is noise, 1
    where all of it is bias. The mean's error is taken to scatter as much, relatively, as theirs,
    and no less than noise would."""
    count, mean = len(single), float(np.mean(single))
    share = of_mean / mean
    scatter = float(np.std(single, ddof=1)) / mean * np.sqrt(1 + 1 / count)
    error = np.hypot(max(share, 1 / count) * scatter, uncertainty / mean)
    return estimate(share, float(error), count - 1)
