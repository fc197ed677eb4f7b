"""Independent replicas of a picture, rendered by bin/metrofarm."""

import os
import subprocess
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

PROGRAM = Path(__file__).parents[2] / "bin" / "metrofarm"
SEEDS = range(1, 17)


@dataclass(frozen=True)
class Settings:
    """What all replicas of a picture have in common."""

    scene: Path
    integrator: str
    width: int
    height: int
    # Samples per pixel of path tracing, mutations per pixel of chains.
    per_pixel: int
    max_depth: int | None = None
    # Further options of the command line.
    options: tuple[str, ...] = ()

    def arguments(self) -> list[str]:
        budget = "--spp" if self.integrator in ("path", "bdpt") else "--mutations-per-pixel"
        words = [str(self.scene), "--integrator", self.integrator, budget, str(self.per_pixel)]
        words += ["--width", str(self.width), "--height", str(self.height)]
        if self.max_depth is not None:
            words += ["--max-depth", str(self.max_depth)]
        return [*words, *self.options]


def read_rgb(path: Path) -> np.ndarray:
    with OpenEXR.File(str(path), separate_channels=True) as image:
        channels = image.channels()
        return np.stack([channels[name].pixels.astype(np.float64) for name in "RGB"], axis=-1)


def render(settings: Settings, seed: int) -> np.ndarray:
    """One replica. Raises with the program's own words when it fails."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "image.exr"
        command = [str(PROGRAM), "render", *settings.arguments()]
        command += ["-o", str(out), "--seed", str(seed), "--threads", "1"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=3600, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}\nexit {done.returncode}: {done.stderr}")
        return read_rgb(out)


def render_all(settings: Settings, seeds: Iterable[int] = SEEDS) -> list[np.ndarray]:
    """All replicas, one thread each, as many at a time as there are processors."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda seed: render(settings, seed), seeds))
