"""How errors fall with the number of samples: fitted slopes, and what is left at infinity.

On simulated errors (counts 256, 1024, 2048, 5000; five renders each; squared errors that scatter by
5 %) each of the three intervals excludes the truth in 1 % of cases. A floor of a tenth of the last
squared error is found by the slope in 50 %, by the floor in 67 %, by the gain of the mean in 94 %;
one of three tenths always.
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


def slope(counts: Sequence[float], squared_errors: Sequence[float]) -> Estimate:
    """Of log RMSE over log counts, one point per independent render; -1/2 without bias."""
    if min(squared_errors) <= 0:
        raise ValueError("an error is no larger than the reference's own: use a better reference")
    fit = stats.linregress(np.log(counts), 0.5 * np.log(squared_errors))
    return estimate(float(fit.slope), float(fit.stderr), len(counts) - 2)


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


def gain_of_mean(single: Sequence[float], of_mean: float, uncertainty: float) -> Estimate:
    """Mean squared error of K single images over that of their mean: K where all of it is noise, 1
    where all of it is bias. The mean's error is taken to scatter as much, relatively, as theirs."""
    gain = float(np.mean(single)) / of_mean
    scatter = float(np.std(single, ddof=1) / np.mean(single))
    relative = np.sqrt(scatter**2 * (1 + 1 / len(single)) + (uncertainty / of_mean) ** 2)
    return estimate(gain, gain * float(relative), len(single) - 1)
