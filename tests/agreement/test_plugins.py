"""Every plugin and parameter variant against Mitsuba 3, by plain path tracing and by chains.

H0, statistic, threshold and false-alarm rate: see blocks.py. Sample size: WORK against a reference
of 32 runs of 512 samples per pixel. Seeds are fixed, so what passes once passes always with the
same build. Each test states its power: what the whole image and the median tile would reveal with
probability 1/2 must be below the bounds here, or the test is too weak to say anything.
"""

from collections.abc import Iterator

import numpy as np
import pytest

import plugin_references
from blocks import LEVELS, Sample, Verdict, block_means, compare
from farm import Farm
from figures import ROWS, row
from plugin_references import Reference, scene_names
from plugin_replicas import Studio, Work, scene_files

WORK = Work("path", replicas=10, per_pixel=128)
# Scenes whose noise asks for more, by the factor.
NOISY = {"bsdf-dielectric-tinted": 4, "emitter-several": 4, "sensor-hide-emitters": 4}
WHOLE_POWER = 0.02
TILE_POWER = 0.10

# One of each way in which light is scattered or emitted.
CHAIN_SCENES = [
    "bsdf-diffuse-textured",
    "bsdf-roughconductor-ggx-anisotropic",
    "bsdf-dielectric-tinted",
    "bsdf-roughdielectric-ggx",
    "bsdf-roughplastic-ggx-nonlinear",
    "bsdf-principled-spec-trans",
    "bsdf-principledthin-diff-trans",
    "bsdf-mask-texture",
    "bsdf-normalmap-rough",
    "emitter-envmap-rotated",
    "emitter-several",
    "sensor-thinlens",
]
CHAIN_WORK = Work("pssmlt", replicas=16, per_pixel=512)
CHAIN_POWER = 0.15

REFERENCES = plugin_references.load() if plugin_references.FILE.exists() else {}


def count_tests(level: str, names: list[str]) -> int:
    """Block-channels in these scenes."""
    return sum(REFERENCES[name].standard_errors[level].size for name in names)


def work_for(name: str) -> Work:
    return Work(WORK.integrator, WORK.replicas, WORK.per_pixel * NOISY.get(name, 1))


def stored(reference: Reference, level: str) -> Sample:
    mean = block_means(reference.mean, level)
    return Sample(mean, reference.standard_errors[level], plugin_references.RUNS - 1)


def judge_level(level: str, name: str, images: list[np.ndarray], names: list[str]) -> Verdict:
    reference = stored(REFERENCES[name], level)
    ours = Sample.of_images(images, level)
    if level == "pixel":
        counts = plugin_references.RUNS * plugin_references.SAMPLES_PER_PIXEL
        scale = np.sqrt(counts / (len(images) * work_for(name).per_pixel))
        ours = ours.with_error_at_least(reference.error * scale)
    return compare(level, ours, reference, count_tests(level, names))


def judge(name: str, images: list[np.ndarray]) -> dict[str, Verdict]:
    names = list(REFERENCES)
    return {level: judge_level(level, name, images, names) for level in LEVELS}


@pytest.fixture(scope="session")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    folder = tmp_path_factory.mktemp("farm")
    farm = Farm(folder, local_workers=1, threads=2)
    try:
        farm.start()
        yield Studio(farm, folder)
    finally:
        farm.close()


def test_references_are_of_these_scenes() -> None:
    """A new scene needs its reference: make_plugin_references.py NAME."""
    assert set(REFERENCES) == set(scene_names())


@pytest.mark.parametrize("name", scene_names())
def test_path_tracing_agrees(name: str, studio: Studio, pytestconfig: pytest.Config) -> None:
    work = work_for(name)
    verdicts = judge(name, studio.images(name, work))
    pytestconfig.stash[ROWS].append(row(name, verdicts, work))
    report = "\n".join(verdict.describe() for verdict in verdicts.values())
    assert all(verdict.agrees for verdict in verdicts.values()), report
    assert verdicts["whole"].typical_detectable < WHOLE_POWER, "too weak:\n" + report
    assert verdicts["tile"].typical_detectable < TILE_POWER, "too weak:\n" + report


@pytest.mark.parametrize("name", CHAIN_SCENES)
def test_chains_agree(name: str, studio: Studio, pytestconfig: pytest.Config) -> None:
    verdict = judge_level("tile", name, studio.images(name, CHAIN_WORK), CHAIN_SCENES)
    pytestconfig.stash[ROWS].append(row(f"{name} (pssmlt)", {"tile": verdict}, CHAIN_WORK))
    assert verdict.agrees, verdict.describe()
    assert verdict.typical_detectable < CHAIN_POWER, "too weak: " + verdict.describe()


# Each a scene, what stands in it, and a value that is slightly wrong.
FAULTS = {
    "reflectance": (
        "bsdf-diffuse-default",
        '<bsdf type="diffuse"></bsdf>',
        '<bsdf type="diffuse"><rgb name="reflectance" value="0.51"/></bsdf>',
    ),
    "index of refraction": (
        "bsdf-dielectric-tinted",
        '<float name="int_ior" value="1.5"/>',
        '<float name="int_ior" value="1.52"/>',
    ),
    "field of view": (
        "sensor-fov-x",
        '<float name="fov" value="38"/>',
        '<float name="fov" value="38.4"/>',
    ),
    "one texel row": ("texture-bitmap-repeat", 'y="0.4"', 'y="0.42"'),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_slightly_wrong_value_is_found(fault: str, studio: Studio) -> None:
    """The instrument's power, shown: the scene with a wrong value against the true reference."""
    name, right, wrong = FAULTS[fault]
    files = scene_files()
    text = files[f"{name}.xml"].decode()
    assert text.count(right) == 1, f"{name}.xml has changed: {right} is not in it once"
    files[f"{name}.xml"] = text.replace(right, wrong).encode()
    images = studio.render(studio.upload(files), f"{name}.xml", work_for(name))
    verdicts = judge(name, images)
    assert not all(verdict.agrees for verdict in verdicts.values()), "\n".join(
        verdict.describe() for verdict in verdicts.values()
    )
