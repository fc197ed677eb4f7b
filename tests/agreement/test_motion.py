"""Motion: moving scenes against the same scenes at rest, which Mitsuba 3 renders, and against
closed forms.

H0, per test: in every tile and channel, the mean of our image is that of the reference. Statistic
and threshold: see tiles.py; replicas of ours with seeds 1 to 16, or to 8 where the reference is a
closed form or an instant, so a test that passes once passes always with the same build; a false
alarm has probability 1e-3 per test. References: 32 runs of 64 random instants each for blurred
images, 16 runs for each instant (make_motion_references.py); closed forms are exact
(motion_truths.py). Every test also asserts its power: the relative difference that the median tile
would reveal with probability 1/2.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from test_agreement import check

import motion_truths
from cases import SCENES
from motion_cases import HEIGHT, MOTION_CASES, WIDTH, MotionCase
from motion_truths import LAMP, SIDE, TOGETHER, Shutter
from replicas import Settings, render_all
from tiles import Estimate, compare, exact, from_replicas

FEW = range(1, 9)


@dataclass(frozen=True)
class Way:
    """A way to render. per_pixel: samples or mutations of blurred scenes in the short form, a
    quarter of the long one's; power: of them, in the short form and in the long one."""

    name: str
    integrator: str
    options: tuple[str, ...]
    per_pixel: int
    power: tuple[float, float]


OFF, ON = ("--delayed-rejection", "off"), ("--delayed-rejection", "on")
PATH = Way("path", "path", (), 128, (0.08, 0.04))
BDPT = Way("bdpt", "bdpt", (), 64, (0.10, 0.06))
CHAINS = Way("pssmlt", "pssmlt", OFF, 128, (0.30, 0.12))
DELAYED = Way("delayed", "pssmlt", ON, 128, (0.30, 0.12))
OVER_BDPT = Way("over-bdpt-delayed", "pssmlt", ("--under", "bdpt", *ON), 64, (0.40, 0.20))
MMLT = Way("mmlt", "mmlt", OFF, 128, (0.40, 0.20))
MMLT_DELAYED = Way("mmlt-delayed", "mmlt", ON, 128, (0.40, 0.20))
WAYS = [PATH, BDPT, CHAINS, DELAYED, OVER_BDPT, MMLT, MMLT_DELAYED]


def trapezoid(t: np.ndarray) -> np.ndarray:
    """Opens in half of the time, closes in a fifth."""
    return np.clip(np.minimum(t / 0.5, (1.0 - t) / 0.2), 0.0, 1.0)


TRAPEZOID = ("--shutter-curve", "trapezoid", "--shutter-ramp-open=0.5", "--shutter-ramp-close=0.2")


def tabulated(t: np.ndarray) -> np.ndarray:
    return np.interp(t, np.linspace(0.0, 1.0, 5), [0.0, 1.0, 0.25, 0.75, 0.5])


TABULATED = ("--shutter-curve", "0,1,0.25,0.75,0.5")
CAMERA = ("--exposure", "camera")
SHUTTERS: dict[str, tuple[Way, Shutter, tuple[str, ...]]] = {
    "box": (PATH, Shutter(), ()),
    "part": (PATH, Shutter(0.25, 0.75), ()),
    "held": (PATH, Shutter(0.5, 2.0), ()),
    "trapezoid": (PATH, Shutter(0.1, 0.9, trapezoid), TRAPEZOID),
    "trapezoid-camera": (PATH, Shutter(0.0, 1.5, trapezoid, True), (*TRAPEZOID, *CAMERA)),
    "tabulated": (PATH, Shutter(0.1, 0.9, tabulated), TABULATED),
    "tabulated-chains": (DELAYED, Shutter(0.0, 0.8, tabulated, True), (*TABULATED, *CAMERA)),
    "rolling": (PATH, Shutter(0.1, 0.3, roll=0.6), ("--rolling-shutter=0.6",)),
    "rolling-back-chains": (
        DELAYED,
        Shutter(0.6, 0.9, tabulated, True, roll=-0.5),
        (*TABULATED, *CAMERA, "--rolling-shutter=-0.5"),
    ),
}
# Instants at which the ball has turned by 0, 90, 180, 270 degrees, by some angle, and by all of its
# three turns; and times from one to another.
SPINS = [(i / 12, i / 12) for i in range(4)] + [(0.46, 0.46), (1.0, 1.0), (0.0, 1.0), (0.3, 0.5)]


@dataclass(frozen=True)
class Choice:
    """The values of a test's parameter by name, and the names that the short form takes."""

    values: dict[str, Any]
    short: set[str]


def ways(*short: Way) -> Choice:
    return Choice({way.name: way for way in WAYS}, {way.name for way in short})


CHOICES = {
    "blurred": Choice(
        {f"{case.name}-{way.name}": (case, way) for case in MOTION_CASES for way in WAYS},
        {"car-path", "car-delayed", "car-mmlt-delayed", "light-bdpt", "light-pssmlt"},
    ),
    "instant": Choice(
        {
            f"{case.name}-{at:g}s": (case, i)
            for case in MOTION_CASES
            for i, at in enumerate(case.times)
        },
        {f"ball-{at:g}s" for at in MOTION_CASES[0].times},
    ),
    "shutter": Choice(SHUTTERS, {"trapezoid-camera", "tabulated", "rolling-back-chains"}),
    "spin": Choice(
        {f"{a:.2f}-{b:.2f}": (a, b) for a, b in SPINS}, {"0.08-0.08", "0.46-0.46", "0.00-1.00"}
    ),
    "flux": ways(PATH, MMLT_DELAYED),
    "rolling": ways(BDPT),
    "together": ways(BDPT, DELAYED),
    "furnace": ways(PATH, BDPT, DELAYED),
}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    long = metafunc.config.getoption("--long")
    for name in CHOICES.keys() & set(metafunc.fixturenames):
        choice = CHOICES[name]
        assert choice.short <= choice.values.keys()
        ids = [key for key in choice.values if long or key in choice.short]
        metafunc.parametrize(name, [choice.values[key] for key in ids], ids=ids)


def shutter_options(opens: float, closes: float) -> tuple[str, ...]:
    return (f"--shutter-open={opens!r}", f"--shutter-close={closes!r}")


def of_case(case: MotionCase, way: Way, work: int, options: tuple[str, ...] = ()) -> Settings:
    """Settings for the size of the references."""
    options = (*way.options, *options)
    return Settings(
        case.scene, way.integrator, WIDTH, HEIGHT, work * way.per_pixel, options=options
    )


def closed_form(name: str, way: Way, per_pixel: int, options: tuple[str, ...] = ()) -> Settings:
    scene = SCENES / "motion" / f"{name}.xml"
    options = (*way.options, *options)
    return Settings(scene, way.integrator, SIDE, SIDE, per_pixel, options=options)


def blurred_reference(case: MotionCase) -> Estimate:
    with np.load(case.reference) as stored:
        mean = exact(stored["mean"]).mean
        return Estimate(mean, stored["tile_standard_error"].astype(float), int(stored["runs"]) - 1)


def posed_reference(case: MotionCase, index: int) -> Estimate:
    with np.load(case.reference) as stored:
        assert tuple(stored["times"]) == case.times, "make_motion_references.py must run again"
        mean, error = stored["posed_mean"][index], stored["posed_standard_error"][index]
        return Estimate(mean, error, int(stored["posed_runs"]) - 1)


def check_exact(settings: Settings, truth: np.ndarray, power: float) -> None:
    check(compare(from_replicas(render_all(settings, FEW)), exact(truth)), power)


def test_the_blurred_image_is_the_mean_over_instants(
    blurred: tuple[MotionCase, Way], request: pytest.FixtureRequest
) -> None:
    case, way = blurred
    long = bool(request.config.getoption("--long"))
    ours = from_replicas(render_all(of_case(case, way, 4 if long else 1)))
    check(compare(ours, blurred_reference(case)), way.power[long] * case.difficulty)


def test_an_instant_is_the_scene_at_rest(instant: tuple[MotionCase, int]) -> None:
    case, index = instant
    options = shutter_options(case.times[index], case.times[index])
    ours = from_replicas(render_all(of_case(case, PATH, 1, options), FEW))
    check(compare(ours, posed_reference(case, index)), PATH.power[0] * case.difficulty)


def test_the_shutter_weighs_the_light(shutter: tuple[Way, Shutter, tuple[str, ...]]) -> None:
    way, times, options = shutter
    options = (*options, *shutter_options(times.opens, times.closes))
    independent = way in (PATH, BDPT)
    settings = closed_form("wiper", way, 64 if independent else 256, options)
    check_exact(settings, motion_truths.wiper(times), 0.03 if independent else 0.15)


def test_a_moving_emitter_keeps_its_flux(flux: Way) -> None:
    work = 64 if flux in (PATH, BDPT) else 256
    check_exact(closed_form("lamp", flux, work), motion_truths.lamp(LAMP, Shutter()), 0.20)


def test_rows_see_the_emitter_at_their_own_times(rolling: Way) -> None:
    """Light that reaches the camera from the other side too, where the row comes after the time."""
    work = 64 if rolling in (PATH, BDPT) else 256
    shutter = Shutter(0.2, 0.35, roll=0.6)
    options = (*shutter_options(shutter.opens, shutter.closes), f"--rolling-shutter={shutter.roll}")
    check_exact(
        closed_form("lamp", rolling, work, options), motion_truths.lamp(LAMP, shutter), 0.25
    )


def test_camera_and_emitter_have_one_time(together: Way) -> None:
    work = 64 if together in (PATH, BDPT) else 256
    truth = motion_truths.lamp(TOGETHER, Shutter())
    check_exact(closed_form("together", together, work), truth, 0.20)


def test_a_turning_ball_does_not_shrink(spin: tuple[float, float]) -> None:
    check_exact(closed_form("spin", PATH, 64, shutter_options(*spin)), motion_truths.spin(), 0.01)


@pytest.mark.parametrize("seconds", [0.2, 0.4])
def test_twice_as_long_is_twice_the_light(seconds: float) -> None:
    settings = closed_form("spin", PATH, 64, (*CAMERA, *shutter_options(0.3, 0.3 + seconds)))
    check_exact(settings, seconds * motion_truths.spin(), 0.01)


def test_a_furnace_stays_even_whatever_moves(furnace: Way) -> None:
    work = 64 if furnace in (PATH, BDPT) else 1024 if furnace in (MMLT, MMLT_DELAYED) else 256
    check_exact(closed_form("furnace", furnace, work), motion_truths.furnace(), 0.10)
