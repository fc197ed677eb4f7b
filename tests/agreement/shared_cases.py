"""The scenes of others that are compared with Mitsuba 3, and how much work each takes.

They are not in the repository: METROFARM_SHARED_SCENES names the folder that contains `scenes`.
Where Mitsuba 3 does not load a scene, a twin in tests/scenes/twins says the same in its words.
"""

import os
from dataclasses import dataclass
from pathlib import Path

from cases import SCENES

TWINS = SCENES / "twins"
VARIABLE = "METROFARM_SHARED_SCENES"


def shared_folder() -> Path | None:
    """What the environment names; with `scenes` inside."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named else None


@dataclass(frozen=True)
class Power:
    """Relative difference of the whole image and of the median tile that must be found."""

    whole: float
    tile: float


EASY = Power(0.02, 0.10)
# What path tracing affords in these sizes; rare bright paths reach the whole image's mean.
HARD = Power(0.04, 0.55)


@dataclass(frozen=True)
class SharedCase:
    """A scene, its small test size (even multiples of 4) and its work."""

    name: str
    # Inside `scenes`.
    file: str
    width: int
    height: int
    # Samples per pixel of each of our replicas, and of each of the reference's runs.
    samples: int = 96
    reference_samples: int = 96
    power: Power = EASY
    # The same scene in the older generation's words: rendered against the same reference.
    older: str | None = None
    twin: str | None = None
    lenient: bool = False
    # Text that is replaced before we render, where the two have no filter in common.
    replaced: tuple[str, str] | None = None

    def mitsuba_file(self, shared: Path) -> Path:
        return TWINS / self.twin if self.twin else shared / "scenes" / self.file


def mitsuba_test(name: str, file: str, width: int = 32, height: int = 32) -> SharedCase:
    return SharedCase(name, f"mitsuba-tests/tests/scenes/{file}.xml", width, height)


def masked_spheres(name: str, file: str) -> SharedCase:
    """With masks before nothing, which Mitsuba darkens: see the twin."""
    path = f"mitsuba-tests/tests/scenes/bsdf_spheres/{file}.xml"
    power = Power(0.08, 0.20)
    return SharedCase(name, path, 32, 32, 384, 512, power, twin=f"{name}.xml")


# pbrt cuts its Gaussian off at 1.5 pixels; Mitsuba only at multiples of the deviation.
PBRT_BOX = ("WorldBegin", 'PixelFilter "box" "float xradius" 0.5 "float yradius" 0.5\nWorldBegin')


def pbrt_cornell(name: str, samples: int, power: Power = EASY) -> SharedCase:
    return SharedCase(
        f"pbrt-{name}",
        f"pbrt-cornell/{name}.pbrt",
        40,
        40,
        samples,
        power=power,
        twin=f"pbrt-{name}.xml",
        replaced=PBRT_BOX,
    )


CASES = [
    SharedCase("cornell-box", "cornell-box/scene.xml", 40, 40, older="cornell-box/scene_v0.6.xml"),
    SharedCase("mitsuba-cbox", "mitsuba-cbox/cbox.xml", 40, 40),
    SharedCase("mitsuba-cbox-rgb", "mitsuba-cbox/cbox-rgb.xml", 40, 40),
    SharedCase("mitsuba-cbox-spectral", "mitsuba-cbox/cbox-spectral.xml", 40, 40),
    SharedCase("classroom", "classroom/scene.xml", 64, 36, 256, 256, HARD),
    SharedCase("staircase", "staircase/scene.xml", 36, 64, 256, 256),
    SharedCase("staircase2", "staircase2/scene.xml", 40, 40, 256, 256),
    SharedCase(
        "veach-ajar",
        "veach-ajar/scene.xml",
        64,
        36,
        256,
        256,
        HARD,
        older="veach-ajar/scene_v0.6.xml",
    ),
    SharedCase(
        "veach-bidir",
        "veach-bidir/scene.xml",
        40,
        40,
        256,
        256,
        HARD,
        older="veach-bidir/scene_v0.6.xml",
    ),
    SharedCase(
        "veach-mis",
        "veach-mis/scene.xml",
        64,
        36,
        384,
        512,
        Power(0.06, 0.05),
        older="veach-mis/scene_v0.6.xml",
    ),
    SharedCase("torus", "torus/scene.xml", 48, 36, 256, 256, Power(0.08, 0.45), twin="torus.xml"),
    SharedCase(
        "cornell-box-motion", "cornell-box-motion/scene.xml", 40, 40, twin="cornell-box-motion.xml"
    ),
    SharedCase(
        "volumetric-caustic",
        "volumetric-caustic/scene.xml",
        40,
        40,
        256,
        256,
        # Path tracing almost never finds the tiny light through the glass: the whole says nothing.
        Power(3.0, 0.03),
        twin="volumetric-caustic.xml",
        lenient=True,
    ),
    pbrt_cornell("cornell-box", 96),
    pbrt_cornell("cornell-box-specular", 256, Power(0.02, 0.18)),
    pbrt_cornell("smallpt", 256),
    SharedCase(
        "pbrt-veach-ajar",
        "veach-ajar/veach-ajar.pbrt",
        64,
        36,
        256,
        256,
        HARD,
        twin="pbrt-veach-ajar.xml",
    ),
    SharedCase(
        "pbrt-volumetric-caustic",
        "volumetric-caustic/volumetric-caustic.pbrt",
        40,
        40,
        256,
        256,
        # As in the Mitsuba file.
        Power(3.0, 0.03),
        twin="pbrt-volumetric-caustic.xml",
        lenient=True,
    ),
    SharedCase(
        "pbrt-killeroo-moving",
        "killeroo-moving/killeroo-moving.pbrt",
        40,
        40,
        # Paths that chance on the small and bright light dominate the whole.
        power=Power(0.10, 0.06),
        twin="pbrt-killeroo-moving.xml",
        replaced=PBRT_BOX,
    ),
    masked_spheres("test-arealight", "test_arealight_path"),
    mitsuba_test("test-constant", "bsdf_spheres/test_constant_path"),
    masked_spheres("test-pointlight", "test_pointlight_path"),
    mitsuba_test("test-directional", "floating_sphere/test_directional_direct"),
    mitsuba_test("test-instancing", "instancing/test_instancing_path"),
    mitsuba_test("test-orthographic", "orthographic_sensor/test_orthographic_path", 40, 24),
    # Two lights of very different power.
    SharedCase(
        "test-spot",
        "mitsuba-tests/tests/scenes/spot_light/test_spot_direct.xml",
        32,
        32,
        1536,
        power=Power(0.03, 0.15),
    ),
    mitsuba_test("test-texture", "texture_interp/test_texture_interp_direct"),
]
