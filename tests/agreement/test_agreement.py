"""bin/metrofarm against Mitsuba 3, against itself, and against closed forms.

H0, statistic and threshold: see tiles.py. Sample size: 16 replicas of bin/metrofarm with seeds
1 to 16 against a reference from 32 runs; a false alarm has probability 1e-3 per test. The seeds are
fixed, so a test that passes once passes always with the same build.
Every test also states its power: the relative difference that the median tile would reveal with
probability 1/2 must be below the case's bound, or the test is too weak to say anything.
"""

from collections.abc import Callable

import numpy as np
import pytest

from cases import FURNACE_CASES, REFERENCE_CASES, Budget, FurnaceCase, ReferenceCase
from replicas import Settings
from tiles import Estimate, Verdict, compare, exact, from_replicas

Replicas = Callable[[Settings], list[np.ndarray]]

INTEGRATORS = ("path", "pssmlt")
# Per pixel, and the power wanted of the median tile.
FURNACE_BUDGETS = {"path": (64, 0.02), "pssmlt": (256, 0.05)}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "case" not in metafunc.fixturenames:
        return
    long = metafunc.config.getoption("--long")
    budgets = [(case, case.long if long else case.short) for case in REFERENCE_CASES]
    chosen = [pair for pair in budgets if pair[1] is not None]
    metafunc.parametrize("case, budget", chosen, ids=[case.name for case, _ in chosen])


def settings(case: ReferenceCase, budget: Budget, integrator: str) -> Settings:
    counts = {"path": budget.samples_per_pixel, "pssmlt": budget.mutations_per_pixel}
    return Settings(case.scene, integrator, case.width, case.height, counts[integrator])


def reference_of(case: ReferenceCase) -> Estimate:
    with np.load(case.reference) as stored:
        mean = exact(stored["mean"]).mean
        return Estimate(mean, stored["tile_standard_error"].astype(float), int(stored["runs"]) - 1)


def check(verdict: Verdict, power: float) -> None:
    print(verdict.describe())
    assert verdict.typical_detectable < power, "too weak: " + verdict.describe()
    assert verdict.agrees, verdict.describe()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_agrees_with_mitsuba(
    case: ReferenceCase, budget: Budget, integrator: str, replicas_of: Replicas
) -> None:
    ours = from_replicas(replicas_of(settings(case, budget, integrator)))
    power = budget.path_power if integrator == "path" else budget.chain_power
    check(compare(ours, reference_of(case)), power)


def test_chains_agree_with_path_tracing(
    case: ReferenceCase, budget: Budget, replicas_of: Replicas
) -> None:
    chains = from_replicas(replicas_of(settings(case, budget, "pssmlt")))
    paths = from_replicas(replicas_of(settings(case, budget, "path")))
    check(compare(chains, paths), budget.path_power + budget.chain_power)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("furnace", FURNACE_CASES, ids=lambda case: case.label)
def test_furnace(furnace: FurnaceCase, integrator: str, replicas_of: Replicas) -> None:
    per_pixel, power = FURNACE_BUDGETS[integrator]
    images = replicas_of(
        Settings(
            furnace.scene, integrator, furnace.width, furnace.height, per_pixel, furnace.max_depth
        )
    )
    truth = np.broadcast_to(furnace.radiance, (furnace.height, furnace.width, 3))
    check(compare(from_replicas(images), exact(truth)), power)
