"""Motion: moving scenes against the same scenes at rest, which Mitsuba 3 renders, and against
closed forms.

H0, per test: in every tile and channel, the mean of our image is that of the reference. Statistic
and threshold: see tiles.py; 16 replicas of ours with seeds 1 to 16, so a test that passes once
passes always with the same build; a false alarm has probability 1e-3 per test. References: 32 runs
of 64 random instants each for blurred images, 16 runs for each instant (make_motion_references.py);
closed forms are exact (motion_truths.py). Every test also asserts its power: the relative
difference that the median tile would reveal with probability 1/2.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from test_agreement import check

import motion_truths
from cases import SCENES
from motion_cases import HEIGHT, MOTION_CASES, WIDTH, MotionCase
from motion_truths import SIDE, Shutter
from replicas import Settings
from tiles import Estimate, compare, exact, from_replicas

Replicas = Callable[[Settings], list[np.ndarray]]


@dataclass(frozen=True)
class Way:
    """A way to render; per_pixel are its samples or mutations in the short form, a quarter of the
    long one's."""

    name: str
    integrator: str
    options: tuple[str, ...]
    per_pixel: int
    # Of blurred scenes, in the short form and in the long one.
    power: tuple[float, float]


OFF, ON = ("--delayed-rejection", "off"), ("--delayed-rejection", "on")
PATH = Way("path", "path", (), 128, (0.08, 0.04))
WAYS = [
    PATH,
    Way("bdpt", "bdpt", (), 64, (0.10, 0.06)),
    Way("pssmlt", "pssmlt", OFF, 128, (0.30, 0.12)),
    Way("delayed", "pssmlt", ON, 128, (0.30, 0.12)),
    Way("over-bdpt-delayed", "pssmlt", ("--under", "bdpt", *ON), 64, (0.40, 0.20)),
    Way("mmlt", "mmlt", OFF, 128, (0.40, 0.20)),
    Way("mmlt-delayed", "mmlt", ON, 128, (0.40, 0.20)),
]
# Pairs of the short form; the long one takes all.
SHORT_BLURS = {
    ("car", "path"),
    ("car", "delayed"),
    ("light", "bdpt"),
    ("light", "pssmlt"),
    ("light", "mmlt-delayed"),
}
SHORT_INSTANTS = {"ball"}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    long = metafunc.config.getoption("--long")
    if "blurred" in metafunc.fixturenames:
        pairs = [
            (case, way)
            for case in MOTION_CASES
            for way in WAYS
            if long or (case.name, way.name) in SHORT_BLURS
        ]
        ids = [f"{case.name}-{way.name}" for case, way in pairs]
        metafunc.parametrize(("blurred", "way"), pairs, ids=ids)
    if "posed" in metafunc.fixturenames:
        instants = [
            (case, index)
            for case in MOTION_CASES
            for index in range(len(case.times))
            if long or case.name in SHORT_INSTANTS
        ]
        ids = [f"{case.name}-{case.times[index]:g}s" for case, index in instants]
        metafunc.parametrize(("posed", "index"), instants, ids=ids)


def shutter_options(opens: float, closes: float) -> tuple[str, ...]:
    return (f"--shutter-open={opens:g}", f"--shutter-close={closes:g}")


def settings(case: MotionCase, way: Way, work: int, options: tuple[str, ...] = ()) -> Settings:
    return Settings(
        case.scene,
        way.integrator,
        WIDTH,
        HEIGHT,
        work * way.per_pixel,
        options=(*way.options, *options),
    )


def blurred_reference(case: MotionCase) -> Estimate:
    with np.load(case.reference) as stored:
        mean = exact(stored["mean"]).mean
        return Estimate(mean, stored["tile_standard_error"].astype(float), int(stored["runs"]) - 1)


def posed_reference(case: MotionCase, index: int) -> Estimate:
    with np.load(case.reference) as stored:
        assert tuple(stored["times"]) == case.times, "make_motion_references.py must run again"
        mean, error = stored["posed_mean"][index], stored["posed_standard_error"][index]
        return Estimate(mean, error, int(stored["posed_runs"]) - 1)


def test_the_blurred_image_is_the_mean_over_instants(
    blurred: MotionCase, way: Way, replicas_of: Replicas, request: pytest.FixtureRequest
) -> None:
    long = request.config.getoption("--long")
    ours = from_replicas(replicas_of(settings(blurred, way, 4 if long else 1)))
    check(compare(ours, blurred_reference(blurred)), way.power[long] * blurred.difficulty)


def test_an_instant_is_the_scene_at_rest(
    posed: MotionCase, index: int, replicas_of: Replicas
) -> None:
    instant = shutter_options(posed.times[index], posed.times[index])
    ours = from_replicas(replicas_of(settings(posed, PATH, 1, instant)))
    check(compare(ours, posed_reference(posed, index)), PATH.power[0] * posed.difficulty)


def closed_form(name: str, way: Way, per_pixel: int, options: tuple[str, ...] = ()) -> Settings:
    return Settings(
        SCENES / "motion" / f"{name}.xml",
        way.integrator,
        SIDE,
        SIDE,
        per_pixel,
        options=(*way.options, *options),
    )


def trapezoid(opening: float, closing: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: np.clip(np.minimum(t / opening, (1.0 - t) / closing), 0.0, 1.0)


def tabulated(t: np.ndarray) -> np.ndarray:
    return np.interp(t, np.linspace(0.0, 1.0, 5), [0.0, 1.0, 0.25, 0.75, 0.5])


TRAPEZOID = ("--shutter-curve", "trapezoid", "--shutter-ramp-open", "0.5")
TRAPEZOID = (*TRAPEZOID, "--shutter-ramp-close", "0.2")
TABULATED = ("--shutter-curve", "0,1,0.25,0.75,0.5")
CAMERA = ("--exposure", "camera")
CHAINS = next(way for way in WAYS if way.name == "delayed")
SHUTTERS: dict[str, tuple[Way, Shutter, tuple[str, ...]]] = {
    "box": (PATH, Shutter(), ()),
    "part": (PATH, Shutter(0.25, 0.75), ()),
    "hold": (PATH, Shutter(0.5, 2.0), ()),
    "trapezoid": (PATH, Shutter(0.1, 0.9, trapezoid(0.5, 0.2)), TRAPEZOID),
    "trapezoid-camera": (PATH, Shutter(0.0, 1.5, trapezoid(0.5, 0.2), True), (*TRAPEZOID, *CAMERA)),
    "tabulated": (PATH, Shutter(0.1, 0.9, tabulated), TABULATED),
    "tabulated-chains": (CHAINS, Shutter(0.0, 0.8, tabulated, True), (*TABULATED, *CAMERA)),
    "rolling": (PATH, Shutter(0.1, 0.3, roll=0.6), ("--rolling-shutter", "0.6")),
    "rolling-back": (
        CHAINS,
        Shutter(0.6, 0.9, tabulated, True, roll=-0.5),
        (*TABULATED, *CAMERA, "--rolling-shutter=-0.5"),
    ),
}


@pytest.mark.parametrize("name", SHUTTERS)
def test_the_shutter_weighs_the_light(name: str, replicas_of: Replicas) -> None:
    way, shutter, options = SHUTTERS[name]
    options = (*options, *shutter_options(shutter.opens, shutter.closes))
    per_pixel = 64 if way is PATH else 256
    ours = from_replicas(replicas_of(closed_form("wiper", way, per_pixel, options)))
    check(compare(ours, exact(motion_truths.wiper(shutter))), 0.02 if way is PATH else 0.15)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_a_moving_emitter_keeps_its_flux(way: Way, replicas_of: Replicas) -> None:
    ours = from_replicas(replicas_of(closed_form("lamp", way, 64)))
    check(compare(ours, exact(motion_truths.lamp())), 0.20)


# Times of the instants at which the ball has turned by 0, 90, 180, 270 degrees, somewhere between,
# and after all turns.
SPINS = [(t, t) for t in (0.0, 1 / 12, 2 / 12, 3 / 12, 0.46, 1.0)] + [(0.0, 1.0), (0.3, 0.5)]


@pytest.mark.parametrize("shutter", SPINS, ids=lambda s: f"{s[0]:.3g}-{s[1]:.3g}")
def test_a_turning_ball_does_not_shrink(
    shutter: tuple[float, float], replicas_of: Replicas
) -> None:
    ours = from_replicas(replicas_of(closed_form("spin", PATH, 64, shutter_options(*shutter))))
    check(compare(ours, exact(motion_truths.spin())), 0.01)


@pytest.mark.parametrize("seconds", [0.2, 0.4])
def test_twice_as_long_is_twice_the_light(seconds: float, replicas_of: Replicas) -> None:
    options = (*CAMERA, *shutter_options(0.3, 0.3 + seconds))
    ours = from_replicas(replicas_of(closed_form("spin", PATH, 64, options)))
    check(compare(ours, exact(seconds * motion_truths.spin())), 0.01)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_a_furnace_stays_even_whatever_moves(way: Way, replicas_of: Replicas) -> None:
    ours = from_replicas(replicas_of(closed_form("furnace", way, 64)))
    check(compare(ours, exact(motion_truths.furnace())), 0.10)
