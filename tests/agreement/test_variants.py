"""Every estimator, kernel, second stage and weight against path tracing, on scenes of each kind.

H0: both have the same mean in every tile. Statistic as in test_agreement.py: 16 replicas each, tile
t-tests with Sidak's correction, 1e-3 per test. Hundreds of pairs at that rate give a false alarm in
one run of three, and more where rare bright samples skew the tile means; so a pair that seems to
differ is decided by a second sample of 48 other replicas, again at 1e-3: 1e-6 per pair, while a
bias that the first sample could see cannot hide from one three times as large. The power of the
first is asserted as in test_agreement.py. A clean scene reports no anomaly, and b of all chains
agrees with that of the chains over path tracing within the intervals that both state.
"""

import json
import math
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from test_agreement import check

from cases import SCENES
from replicas import PROGRAM, SEEDS, Settings, render_all
from tiles import Verdict, compare, from_replicas

Replicas = Callable[[Settings], list[np.ndarray]]

OFF, ON = ("--delayed-rejection", "off"), ("--delayed-rejection", "on")
APART = ("--direct-apart", "on")
TUNED = ("--kernel-tuning", "on")
SUBPATHS = ("--eye-step-probability", "0.2", "--light-step-probability", "0.1")


@dataclass(frozen=True)
class Variant:
    """A way to render; the short form of the tests takes only some."""

    name: str
    integrator: str
    options: tuple[str, ...] = ()
    short: bool = False
    # Its b is no luminance, or not that of all light.
    own_b: bool = False
    # Meets lights by chance alone: never a point, and an area so rarely that it takes more work.
    by_chance: bool = False


VARIANTS = [
    Variant("bdpt", "bdpt", short=True),
    Variant("emitter", "pssmlt", ("--light-sampling", "emitter", *OFF)),
    Variant("bsdf", "pssmlt", ("--light-sampling", "bsdf", *OFF), by_chance=True),
    Variant("bsdf-delayed", "pssmlt", ("--light-sampling", "bsdf", *ON), by_chance=True),
    Variant("delayed", "pssmlt", ON, short=True),
    Variant("delayed-von-mises", "pssmlt", (*ON, "--second-stage", "von-mises")),
    Variant("delayed-local", "pssmlt", (*ON, "--second-stage", "local", "--after-large-steps")),
    Variant(
        "delayed-green-mira",
        "pssmlt",
        (*ON, "--second-stage", "local", "--acceptance-rule", "green-mira"),
    ),
    Variant("delayed-cauchy-kernel", "pssmlt", (*ON, "--kernel", "wrapped-cauchy")),
    Variant("gaussian", "pssmlt", (*OFF, "--kernel", "gaussian")),
    Variant("uniform", "pssmlt", (*OFF, "--kernel", "uniform")),
    Variant("kelemen-weights", "pssmlt", (*OFF, "--layer-weights", "kelemen")),
    Variant("over-bdpt", "pssmlt", ("--under", "bdpt", *OFF)),
    Variant("over-bdpt-delayed", "pssmlt", ("--under", "bdpt", *ON), short=True),
    Variant("mmlt", "mmlt", OFF),
    Variant("mmlt-mutated", "mmlt", (*OFF, "--technique-coordinate", "mutated")),
    Variant("mmlt-delayed", "mmlt", ON, short=True),
    Variant("equalized", "pssmlt", (*OFF, "--target", "equalized"), own_b=True),
    Variant("direct-apart", "pssmlt", (*OFF, *APART), own_b=True),
    Variant(
        "mmlt-all", "mmlt", (*ON, *APART, "--target", "equalized", *TUNED), short=True, own_b=True
    ),
    Variant("over-bdpt-subpaths", "pssmlt", ("--under", "bdpt", *SUBPATHS, *TUNED)),
    Variant("over-bdpt-apart", "pssmlt", ("--under", "bdpt", *APART, *SUBPATHS), own_b=True),
    Variant("mmlt-subpaths", "mmlt", SUBPATHS),
]


@dataclass(frozen=True)
class VariantScene:
    """A scene, how much work a replica is, and the power wanted of the median tile."""

    name: str
    file: str
    spp: int
    mutations: int
    power: float
    short: bool = False
    # Times the work that the variants take which meet lights by chance; 0: they cannot.
    by_chance: int = 4

    @property
    def path(self) -> Path:
        return SCENES / self.file


DEPTH = 8
SIZE = 32
SECOND_SEEDS = range(SEEDS.stop, SEEDS.stop + 3 * len(SEEDS))

VARIANT_SCENES = [
    VariantScene("cornell-box", "cornell-box/scene.xml", 128, 256, 0.20, short=True),
    VariantScene("plates", "plates/scene.xml", 256, 512, 0.30, by_chance=0),
    VariantScene("smooth-sphere", "plugins/shape-coarse-smooth.xml", 128, 256, 0.20, short=True),
    VariantScene("environment", "plugins/emitter-envmap.xml", 256, 512, 0.15),
    VariantScene("furnace-glass", "furnace-sphere/environment-glass.xml", 64, 256, 0.10),
    VariantScene("furnace-point", "furnace-sphere/point-light.xml", 64, 256, 0.10, by_chance=0),
    VariantScene("ring-caustic", "ring-caustic/scene.xml", 1024, 512, 0.30),
    VariantScene("glass-caustic", "glass-caustic/scene.xml", 2048, 512, 0.40),
    VariantScene("door-ajar", "door-ajar/scene.xml", 4096, 2048, 0.40, by_chance=32),
    VariantScene("veach-door", "peer-veach-door/scene.xml", 4096, 2048, 0.40, by_chance=8),
]


def applies(scene: VariantScene, variant: Variant) -> bool:
    return scene.by_chance > 0 or not variant.by_chance


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Pairs of scene and variant; those that make no sense do not exist."""
    long = metafunc.config.getoption("--long")
    pairs = [
        (scene, variant)
        for scene in VARIANT_SCENES
        for variant in VARIANTS
        if (long or (scene.short and variant.short)) and applies(scene, variant)
    ]
    ids = [f"{scene.name}-{variant.name}" for scene, variant in pairs]
    if "variant" in metafunc.fixturenames:
        metafunc.parametrize(("scene", "variant"), pairs, ids=ids)


PATHS = Variant("path", "path")
CHAINS = Variant("pssmlt", "pssmlt", OFF)


def settings(scene: VariantScene, variant: Variant) -> Settings:
    per_pixel = scene.spp if variant.integrator in ("path", "bdpt") else scene.mutations
    work = scene.by_chance if variant.by_chance else 1
    return Settings(
        scene.path, variant.integrator, SIZE, SIZE, work * per_pixel, DEPTH, variant.options
    )


def verdict_on(pair: tuple[Settings, Settings], replicas_of: Replicas) -> Verdict:
    ours, paths = (from_replicas(replicas_of(one)) for one in pair)
    return compare(ours, paths)


def test_agrees_with_path_tracing(
    scene: VariantScene, variant: Variant, replicas_of: Replicas
) -> None:
    pair = settings(scene, variant), settings(scene, PATHS)
    verdict = verdict_on(pair, replicas_of)
    if verdict.agrees:
        check(verdict, scene.power)
    else:
        print(verdict.describe(), "- deciding by other replicas")
        check(verdict_on(pair, lambda one: render_all(one, SECOND_SEEDS)), scene.power)


def statistics_of(arguments: Settings) -> dict:
    with tempfile.TemporaryDirectory() as scratch:
        stats = Path(scratch) / "stats.json"
        command = [str(PROGRAM), "render", *arguments.arguments(), "--stats", str(stats)]
        command += ["-o", str(Path(scratch) / "image.exr"), "--seed", "77"]
        subprocess.run(command, capture_output=True, text=True, check=True)
        return json.loads(stats.read_text())


def test_b_agrees_and_nothing_is_bad(scene: VariantScene, variant: Variant) -> None:
    """H0: both b have the same mean; z-test with the errors that both state, 1e-4 per test."""
    ours = statistics_of(settings(scene, variant))
    assert ours["anomalies"] == {}
    if variant.integrator in ("path", "bdpt") or variant.own_b:
        return
    chains = statistics_of(settings(scene, CHAINS))
    error = math.hypot(ours["b_standard_error"], chains["b_standard_error"])
    assert abs(ours["b"] - chains["b"]) < 3.9 * error, (ours["b"], chains["b"], error)
