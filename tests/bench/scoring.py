"""Errors against references, in the project's one measure."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR


def read_rgb(path: Path) -> np.ndarray:
    """(height, width, 3), linear."""
    with OpenEXR.File(str(path), separate_channels=True) as image:
        channels = image.channels()
        return np.stack([channels[name].pixels.astype(np.float64) for name in "RGB"], axis=-1)


@dataclass(frozen=True)
class Reference:
    """What an image converges to, and the standard error of that: (height, width, 3) each. Errors
    against it are stated less what its own noise adds to them."""

    mean: np.ndarray
    standard_error: np.ndarray

    def scale(self) -> np.ndarray:
        return self.mean**2 + 0.01 * self.mean.mean() ** 2

    def mse(self, image: np.ndarray) -> float:
        """mean of (x - ref)^2."""
        return float(((image - self.mean) ** 2 - self.standard_error**2).mean())

    def bright(self) -> np.ndarray:
        """The brightest hundredth of the pixels: (height, width)."""
        brightness = self.mean.mean(axis=-1)
        return brightness >= np.quantile(brightness, 0.99)

    def mse_elsewhere(self, image: np.ndarray) -> float:
        """The same of all but the brightest hundredth of the pixels."""
        squares = (image - self.mean) ** 2 - self.standard_error**2
        return float(squares[~self.bright()].mean())

    def relative_mse(self, image: np.ndarray) -> float:
        """mean of (x - ref)^2 / (ref^2 + 0.01 mean(ref)^2)."""
        squares = (image - self.mean) ** 2 - self.standard_error**2
        return float((squares / self.scale()).mean())


def read_reference(path: Path) -> Reference:
    """An .npz with mean and standard error, or an .exr whose own noise is unknown: taken as 0, so
    that errors are stated too large."""
    if path.suffix == ".exr":
        mean = read_rgb(path)
        return Reference(mean, np.zeros_like(mean))
    stored = np.load(path)
    return Reference(stored["mean"].astype(float), stored["standard_error"].astype(float))
