"""What the benchmark compares: Metrofarm's ways to render, Mitsuba's, and the scenes."""

import os
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"


@dataclass(frozen=True)
class Variant:
    """One way to render. Metrofarm's are named by command line words, Mitsuba's by its variant."""

    name: str
    words: tuple[str, ...] = ()
    mitsuba: str = ""

    @property
    def chains(self) -> bool:
        return any(word in ("pssmlt", "mmlt") for word in self.words)


def ours(name: str, *words: str) -> Variant:
    return Variant(name, ("--integrator", *words))


DELAYED = ("--delayed-rejection", "on")
PLAIN = ("--delayed-rejection", "off")
# Equal relative error all over the image, light that bounces at most once apart.
EQUALIZED = ("--target", "equalized", "--direct-apart", "on")

VARIANTS = [
    Variant("mitsuba-scalar", mitsuba="scalar_rgb"),
    Variant("mitsuba-llvm", mitsuba="llvm_ad_rgb"),
    ours("path", "path"),
    ours("bdpt", "bdpt"),
    ours("pssmlt", "pssmlt", *PLAIN),
    ours("pssmlt-dr", "pssmlt", *DELAYED),
    ours("pssmlt-bsdf", "pssmlt", "--light-sampling", "bsdf", *PLAIN),
    ours("pssmlt-bsdf-dr", "pssmlt", "--light-sampling", "bsdf", *DELAYED),
    ours("pssmlt-bdpt", "pssmlt", "--under", "bdpt", *PLAIN),
    ours("pssmlt-bdpt-dr", "pssmlt", "--under", "bdpt", *DELAYED),
    ours("mmlt", "mmlt", *PLAIN),
    ours("mmlt-dr", "mmlt", *DELAYED),
    ours("pssmlt-eq", "pssmlt", *EQUALIZED),
    ours("pssmlt-eq-dr", "pssmlt", *EQUALIZED, *DELAYED),
    ours("pssmlt-bdpt-eq", "pssmlt", "--under", "bdpt", *EQUALIZED),
    ours("mmlt-eq", "mmlt", *EQUALIZED),
    ours("mmlt-eq-dr", "mmlt", *EQUALIZED, *DELAYED),
]


@dataclass(frozen=True)
class BenchScene:
    """A scene and the image that it converges to."""

    name: str
    scene: Path
    reference: Path
    width: int
    height: int
    # Has lights without extent, which sampling by the BSDF alone never finds.
    points: bool = False
    # Has motion, which Mitsuba does not know.
    moves: bool = False

    def takes(self, variant: Variant) -> bool:
        if self.moves and variant.mitsuba:
            return False
        return not (self.points and "bsdf" in variant.words)


def stored(name: str, width: int, height: int, points: bool = False) -> BenchScene:
    reference = HERE.parent / "agreement" / "references" / f"{name}.npz"
    return BenchScene(name, SCENES / name / "scene.xml", reference, width, height, points)


def moving(name: str, points: bool = False) -> BenchScene:
    """One of tests/agreement/motion_cases.py."""
    reference = HERE.parent / "agreement" / "references" / f"motion-{name}.npz"
    scene = SCENES / "motion" / f"{name}.xml"
    return BenchScene(f"motion-{name}", scene, reference, 48, 32, points, moves=True)


def peer_scenes(folder: Path) -> list[BenchScene]:
    """Scenes with references of 256 x 256 pixels, as `refs/NAME.exr`."""
    names = sorted(file.stem for file in (folder / "refs").glob("*.exr"))
    return [
        BenchScene(
            f"peer-{name}-256",
            folder / "scenes" / name / "scene.xml",
            folder / "refs" / f"{name}.exr",
            256,
            256,
        )
        for name in names
    ]


def all_scenes() -> list[BenchScene]:
    """Those of the repository, and where METROFARM_PEERS names a folder those in it."""
    scenes = [
        stored("cornell-box", 48, 48),
        stored("plates", 64, 48, points=True),
        stored("door-ajar", 64, 48),
        stored("ring-caustic", 64, 48),
        stored("glass-caustic", 64, 48),
        stored("shared-veach-mis", 64, 40),
        stored("peer-veach-door", 48, 48),
        moving("ball"),
        moving("car"),
        moving("light", points=True),
        moving("camera"),
        moving("cloth"),
        moving("caustic"),
    ]
    folder = os.environ.get("METROFARM_PEERS")
    return scenes + (peer_scenes(Path(folder)) if folder else [])
