"""The scene of plates and lights: what is rendered of it, and how far off that is."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rendering import by_metrofarm, by_mitsuba
from scoring import Reference, read_reference
from variants import DELAYED, PLAIN, SCENES, BenchScene, Variant, ours

SAMPLINGS = ("mis", "bsdf")
SIGMAS = (0.02, 0.01, 0.005, 0.002)
REFERENCE_RUNS = 10
MITSUBA_LLVM = Variant("mitsuba-llvm", mitsuba="llvm_ad_rgb")


@dataclass(frozen=True)
class Chains:
    """PSSMLT over path tracing with a Gaussian kernel."""

    sampling: str
    sigma: float
    delayed: bool

    @property
    def name(self) -> str:
        return f"{self.sampling}, {'delayed rejection' if self.delayed else 'PSSMLT'}"

    @property
    def variant(self) -> Variant:
        words = ("--light-sampling", self.sampling, "--kernel", "gaussian")
        words += ("--sigma", f"{self.sigma:g}", *(DELAYED if self.delayed else PLAIN))
        return ours(self.name, "pssmlt", *words)


def paths(sampling: str) -> Variant:
    return ours(f"{sampling}, path tracing", "path", "--light-sampling", sampling)


@dataclass(frozen=True)
class Run:
    """One render. Mutations (samples of path tracing) and path evaluations are per pixel;
    evaluations include second stages and the bootstrap."""

    mutations: float
    evaluations: float
    cpu_seconds: float
    mse: float
    mse_elsewhere: float
    relative_mse: float
    acceptance: dict[str, float | None]
    anomalies: int


@dataclass(frozen=True)
class Experiment:
    """The scene at one size and the image that it converges to."""

    scene: BenchScene
    reference: Reference

    def render(self, variant: Variant, per_pixel: int, seed: int) -> tuple[Run, np.ndarray]:
        image, stats = by_metrofarm(self.scene, variant, per_pixel, seed)
        pixels = self.scene.width * self.scene.height
        run = Run(
            stats["mutations"] / pixels,
            stats["path_evaluations"] / pixels,
            stats["cpu_seconds"],
            self.reference.mse(image),
            self.reference.mse_elsewhere(image),
            self.reference.relative_mse(image),
            stats["acceptance"],
            sum(stats["anomalies"].values()),
        )
        return run, image


def without_point_light(folder: Path) -> Path:
    """A copy of the scene that BSDF sampling alone can render: it never finds a point."""
    document = ElementTree.parse(SCENES / "plates" / "scene.xml")
    root = document.getroot()
    for emitter in root.findall("emitter[@type='point']"):
        root.remove(emitter)
    path = folder / "plates-area-lights.xml"
    document.write(path)
    return path


def prepare(folder: Path, width: int, height: int, samples: int) -> Experiment:
    """samples per pixel of each of the reference's runs. A reference once made is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    stored = folder / f"plates-area-lights-{width}x{height}-{samples}.npz"
    scene = BenchScene("plates", without_point_light(folder), stored, width, height)
    if not stored.exists():
        images = np.stack(
            [by_mitsuba(scene, MITSUBA_LLVM, samples, run)[0] for run in range(REFERENCE_RUNS)]
        )
        error = images.std(axis=0, ddof=1) / np.sqrt(REFERENCE_RUNS)
        np.savez_compressed(stored, mean=images.mean(axis=0), standard_error=error)
    return Experiment(scene, read_reference(stored))
