"""What is compared: scenes, their small test size, and how much work each form of the test does."""

from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
REFERENCES = HERE / "references"

# Pixels along the side of a tile; every width and height below is a multiple of it.
TILE = 8


@dataclass(frozen=True)
class Budget:
    """Work of one replica and the relative difference of a typical tile that it must reveal."""

    samples_per_pixel: int
    mutations_per_pixel: int
    path_power: float
    chain_power: float


@dataclass(frozen=True)
class ReferenceCase:
    """A scene with a reference image made by Mitsuba 3."""

    name: str
    width: int
    height: int
    # Samples per pixel of one of the reference's independent runs.
    reference_spp: int
    short: Budget | None
    long: Budget

    @property
    def scene(self) -> Path:
        return SCENES / self.name / "scene.xml"

    @property
    def reference(self) -> Path:
        return REFERENCES / f"{self.name}.npz"


@dataclass(frozen=True)
class FurnaceCase:
    """A scene whose every pixel has a radiance known in closed form (see the scene's comment)."""

    name: str
    radiance: tuple[float, float, float]
    max_depth: int | None = None
    width: int = 32
    height: int = 32

    @property
    def scene(self) -> Path:
        return SCENES / "furnace-sphere" / f"{self.name}.xml"

    @property
    def label(self) -> str:
        return self.name if self.max_depth is None else f"{self.name}-depth-{self.max_depth}"


REFERENCE_CASES = [
    ReferenceCase(
        "cornell-box", 48, 48, 2048, Budget(256, 512, 0.03, 0.08), Budget(1024, 4096, 0.02, 0.04)
    ),
    ReferenceCase(
        "plates", 64, 48, 2048, Budget(256, 512, 0.05, 0.12), Budget(1024, 4096, 0.02, 0.05)
    ),
    ReferenceCase("ring-caustic", 64, 48, 4096, None, Budget(2048, 8192, 0.06, 0.06)),
    ReferenceCase("glass-caustic", 64, 48, 4096, None, Budget(4096, 8192, 0.10, 0.10)),
    ReferenceCase("door-ajar", 64, 48, 8192, None, Budget(4096, 16384, 0.20, 0.15)),
    ReferenceCase(
        "shared-cornell-box",
        48,
        48,
        2048,
        Budget(256, 512, 0.03, 0.08),
        Budget(1024, 4096, 0.02, 0.04),
    ),
    ReferenceCase(
        "shared-veach-mis",
        64,
        40,
        2048,
        Budget(256, 512, 0.05, 0.12),
        Budget(1024, 4096, 0.02, 0.05),
    ),
    ReferenceCase(
        "peer-cornell-diffuse",
        48,
        48,
        2048,
        Budget(256, 512, 0.03, 0.08),
        Budget(1024, 4096, 0.02, 0.04),
    ),
    ReferenceCase(
        "peer-veach-mis", 48, 48, 2048, Budget(256, 512, 0.05, 0.12), Budget(1024, 4096, 0.02, 0.05)
    ),
    ReferenceCase("peer-veach-door", 48, 48, 2048, None, Budget(4096, 16384, 0.20, 0.15)),
]

FURNACE_CASES = [
    FurnaceCase("emissive", (1.0, 1.5, 1.0 / 3.0)),
    FurnaceCase("point-light", (1.0, 0.25, 3.0)),
    FurnaceCase("point-light", (0.5, 0.2, 0.75), max_depth=2),
    FurnaceCase("environment-diffuse", (0.5, 1.0, 2.0)),
    FurnaceCase("environment-mirror", (0.5, 1.0, 2.0)),
    FurnaceCase("environment-glass", (0.5, 1.0, 2.0)),
]
