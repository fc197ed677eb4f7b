"""The scenes of others against Mitsuba 3, by plain path tracing and, on three, by chains.

H0, statistic, threshold and false-alarm rate: see blocks.py; the family here is all shared scenes.
Sample size: REPLICAS replicas of the case's samples against a reference of 32 runs. Seeds are
fixed. Each test states its power, as in test_plugins.py: the bounds are the case's.
Skipped unless METROFARM_SHARED_SCENES names the folder that contains `scenes`.
"""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import shared_references
from blocks import LEVELS, Sample, Verdict, block_means, compare
from farm import WORKER, Farm
from figures import ROWS, row
from plugin_replicas import Studio, Work
from shared_cases import CASES, TWINS, VARIABLE, SharedCase, shared_folder

REPLICAS = 16

CHAIN_CASES = {"mitsuba-cbox": 0.15, "veach-mis": 0.20, "torus": 0.30}
CHAIN_WORK = Work("pssmlt", replicas=16, per_pixel=512)

REFERENCES, SAMPLES = shared_references.load() if shared_references.FILE.exists() else ({}, {})

pytestmark = pytest.mark.skipif(
    shared_folder() is None, reason=f"{VARIABLE} is not set: the scenes are not in the repository"
)


def count_tests(level: str, names: list[str]) -> int:
    """Block-channels in these scenes."""
    return sum(REFERENCES[name].standard_errors[level].size for name in names)


def work_for(case: SharedCase) -> Work:
    return Work("path", REPLICAS, case.samples)


def judge_level(level: str, case: SharedCase, images: list[np.ndarray], tests: int) -> Verdict:
    stored = REFERENCES[case.name]
    mean, error = block_means(stored.mean, level), stored.standard_errors[level]
    reference = Sample(mean, error, shared_references.RUNS - 1)
    ours = Sample.of_images(images, level)
    if level == "pixel":
        counts = shared_references.RUNS * SAMPLES[case.name]
        ours = ours.with_error_at_least(error * np.sqrt(counts / (len(images) * case.samples)))
    return compare(level, ours, reference, tests)


def judge(case: SharedCase, images: list[np.ndarray]) -> dict[str, Verdict]:
    names = list(REFERENCES)
    return {level: judge_level(level, case, images, count_tests(level, names)) for level in LEVELS}


def scene_files(case: SharedCase, file: str) -> dict[str, bytes]:
    """What the worker says the scene uses, as names inside a bundle."""
    folder = shared_folder()
    assert folder is not None
    scenes = (folder / "scenes").resolve()
    command = [str(WORKER), "files", str(scenes / file), *(["--lenient"] * case.lenient)]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")
    # Folders end in a slash.
    names = [line for line in listed if line and not line.endswith("/")]
    paths = {Path(line) for line in names} | {scenes / file}
    files = {str(path.resolve().relative_to(scenes)): path.read_bytes() for path in paths}
    if case.replaced:
        old, new = (text.encode() for text in case.replaced)
        assert files[file].count(old) == 1, f"{file} has changed"
        files[file] = files[file].replace(old, new)
    return files


class SharedStudio(Studio):
    """Renders shared scenes: a bundle each."""

    def __post_init__(self) -> None:
        self._seen: dict[tuple[str, Work], list[np.ndarray]] = {}

    def of(self, case: SharedCase, file: str, work: Work) -> list[np.ndarray]:
        if (file, work) not in self._seen:
            bundle = self.upload(scene_files(case, file))
            options = {"width": case.width, "height": case.height}
            if case.lenient:
                options["lenient"] = True
            self._seen[file, work] = self.render(bundle, file, work, options)
        return self._seen[file, work]


@pytest.fixture(scope="session")
def shared_studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedStudio]:
    folder = tmp_path_factory.mktemp("shared-farm")
    farm = Farm(folder, local_workers=1, threads=2)
    try:
        farm.start()
        yield SharedStudio(farm, folder)
    finally:
        farm.close()


def check(verdicts: dict[str, Verdict]) -> None:
    report = "\n".join(verdict.describe() for verdict in verdicts.values())
    assert all(verdict.agrees for verdict in verdicts.values()), report


def test_references_are_of_these_scenes() -> None:
    """A new scene needs its reference: make_shared_references.py NAME."""
    assert set(REFERENCES) == {case.name for case in CASES}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_path_tracing_agrees(
    case: SharedCase, shared_studio: SharedStudio, pytestconfig: pytest.Config
) -> None:
    work = work_for(case)
    verdicts = judge(case, shared_studio.of(case, case.file, work))
    pytestconfig.stash[ROWS].append(row(case.name, verdicts, work))
    check(verdicts)
    assert verdicts["whole"].typical_detectable < case.power.whole, verdicts["whole"].describe()
    assert verdicts["tile"].typical_detectable < case.power.tile, verdicts["tile"].describe()


@pytest.mark.parametrize("case", [case for case in CASES if case.older], ids=lambda case: case.name)
def test_older_form_is_the_same_image(case: SharedCase, shared_studio: SharedStudio) -> None:
    """Same seeds, so not only the same mean."""
    work = Work("path", 2, 16)
    newer = shared_studio.of(case, case.file, work)
    older = shared_studio.of(case, str(case.older), work)
    for one, other in zip(newer, older, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", CHAIN_CASES)
def test_chains_agree(name: str, shared_studio: SharedStudio, pytestconfig: pytest.Config) -> None:
    case = next(case for case in CASES if case.name == name)
    images = shared_studio.of(case, case.file, CHAIN_WORK)
    tests = count_tests("tile", list(CHAIN_CASES))
    verdict = judge_level("tile", case, images, tests)
    pytestconfig.stash[ROWS].append(row(f"{name} (pssmlt)", {"tile": verdict}, CHAIN_WORK))
    assert verdict.agrees, verdict.describe()
    assert verdict.typical_detectable < CHAIN_CASES[name], verdict.describe()


def test_twins_are_all_used() -> None:
    used = {case.twin for case in CASES if case.twin}
    assert used == {path.name for path in TWINS.glob("*.xml")}
