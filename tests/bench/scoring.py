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
    """mean: (height, width, 3). noise: relMSE that the reference's own error adds to any image."""

    mean: np.ndarray
    noise: float

    def scale(self) -> np.ndarray:
        return self.mean**2 + 0.01 * self.mean.mean() ** 2

    def relative_mse(self, image: np.ndarray) -> float:
        """mean of (x - ref)^2 / (ref^2 + 0.01 mean(ref)^2), less the reference's own noise."""
        return float(((image - self.mean) ** 2 / self.scale()).mean() - self.noise)


def read_reference(path: Path) -> Reference:
    """An .npz with mean and standard error, or an .exr whose own noise is unknown: taken as 0, so
    that errors are stated too large."""
    if path.suffix == ".exr":
        return Reference(read_rgb(path), 0.0)
    stored = np.load(path)
    bare = Reference(stored["mean"].astype(np.float64), 0.0)
    noise = float((stored["standard_error"].astype(np.float64) ** 2 / bare.scale()).mean())
    return Reference(bare.mean, noise)
