"""The scenes of tests/scenes/plugins and what is stored of Mitsuba's images of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blocks import LEVELS, block_means
from cases import REFERENCES, SCENES

FOLDER = SCENES / "plugins"
FILE = REFERENCES / "plugins.npz"

# Independent runs of Mitsuba, and the samples per pixel of each.
RUNS = 32
SAMPLES_PER_PIXEL = 512


def scene_names() -> list[str]:
    files = FOLDER.glob("*.xml")
    return sorted(path.stem for path in files if not path.stem.endswith(".twin"))


def mitsuba_file(name: str) -> Path:
    """What Mitsuba renders: the scene itself or, where Mitsuba does not load it, its twin."""
    twin = FOLDER / f"{name}.twin.xml"
    return twin if twin.exists() else FOLDER / f"{name}.xml"


@dataclass(frozen=True)
class Reference:
    """Mean image (H, W, 3), and the standard error of the mean of each block, level by level."""

    mean: np.ndarray
    standard_errors: dict[str, np.ndarray]

    @staticmethod
    def of_runs(runs: np.ndarray) -> "Reference":
        """From independent images, (run, H, W, 3)."""
        errors = {}
        for level in LEVELS:
            blocks = np.stack([block_means(image, level) for image in runs])
            errors[level] = blocks.std(axis=0, ddof=1) / np.sqrt(len(runs))
        return Reference(runs.mean(axis=0), errors)


def save(references: dict[str, Reference], version: str) -> None:
    """One file, of few arrays: each costs its headers."""
    names = sorted(references)
    stored = [references[name] for name in names]
    np.savez_compressed(
        FILE,
        names=np.array(names),
        sizes=np.array([reference.mean.shape[:2] for reference in stored], dtype=np.int32),
        mean=np.concatenate([r.mean.ravel() for r in stored]).astype(np.float32),
        standard_error=np.concatenate(
            [r.standard_errors[level].ravel() for r in stored for level in LEVELS]
        ).astype(np.float32),
        runs=np.int32(RUNS),
        samples_per_pixel=np.int32(SAMPLES_PER_PIXEL),
        mitsuba_version=np.str_(version),
    )


class Reader:
    """Takes arrays off the front of a flat one."""

    def __init__(self, values: np.ndarray) -> None:
        self._values = values.astype(np.float64)

    def take(self, shape: tuple[int, ...]) -> np.ndarray:
        count = int(np.prod(shape))
        taken, self._values = self._values[:count], self._values[count:]
        return taken.reshape(shape)


def load() -> dict[str, Reference]:
    references = {}
    with np.load(FILE) as stored:
        means, errors = Reader(stored["mean"]), Reader(stored["standard_error"])
        for name, size in zip(stored["names"], stored["sizes"], strict=True):
            mean = means.take((*size, 3))
            shapes = {level: block_means(mean, level).shape for level in LEVELS}
            by_level = {level: errors.take(shape) for level, shape in shapes.items()}
            references[str(name)] = Reference(mean, by_level)
    return references


def stored_version() -> str:
    with np.load(FILE) as stored:
        return str(stored["mitsuba_version"])
