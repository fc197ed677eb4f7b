"""bin/metrofarm render: statistics, repeatability, interruption."""

import json
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from farm import METROFARM, SCENES, Farm, run

CORNELL = SCENES / "cornell-box" / "scene.xml"
SMALL = ["--width", "32", "--height", "32", "--seed", "5"]
# Names that scripts rely on.
KEYS = {
    "integrator",
    "seed",
    "width",
    "height",
    "mutations",
    "path_evaluations",
    "rays",
    "rounds",
    "cpu_seconds",
    "wall_seconds",
    "load_seconds",
    "b",
    "b_standard_error",
    "acceptance",
    "rel_mse_estimate",
    "anomalies",
    "film_sha256",
    "plan",
}
BUDGETS = {"path": ["--spp", "32"], "pssmlt": ["--mutations-per-pixel", "64"]}


def render(folder: Path, *flags: str) -> dict[str, Any]:
    """Renders the Cornell box and returns the statistics."""
    stats = folder / "stats.json"
    done = run("render", CORNELL, "-o", folder / "out.exr", "--stats", stats, *SMALL, *flags)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(stats.read_text()))


@pytest.mark.parametrize("integrator", BUDGETS)
def test_statistics_are_complete(integrator: str, tmp_path: Path) -> None:
    stats = render(tmp_path, "--integrator", integrator, *BUDGETS[integrator])
    assert stats.keys() >= KEYS
    assert (stats["width"], stats["height"], stats["seed"]) == (32, 32, 5)
    assert stats["integrator"] == integrator
    assert stats["anomalies"] == {}
    assert stats["b"] > 0
    assert stats["rays"] >= stats["path_evaluations"] > 0
    estimate = stats["rel_mse_estimate"]
    assert 0 < estimate["low"] <= estimate["value"] <= estimate["high"]
    if integrator == "pssmlt":
        assert 0 < stats["acceptance"]["large"] < stats["acceptance"]["small"] < 1


def test_auto_decides_by_counts_and_says_so(tmp_path: Path) -> None:
    stats = render(tmp_path, "--spp", "16")
    plan = stats["plan"]
    assert stats["integrator"] == plan["auto"]["integrator"] == "path"
    assert plan["auto"]["pilot_samples"] == 16384
    assert plan["auto"]["top_share"] < 0.03
    features = {feature["name"]: feature for feature in plan["features"]}
    assert features["lens"]["state"] == "skipped"
    assert features["light sampling"]["state"] == "used"
    assert all(feature["evidence"] for feature in plan["features"])

    resolved = tmp_path / "resolved.json"
    resolved.write_text(json.dumps(stats["resolved_spec"]))
    repeated = render(tmp_path, "--resolved", str(resolved), "--spp", "16")
    assert repeated["film_sha256"] == stats["film_sha256"]
    assert repeated["path_evaluations"] == repeated["mutations"], "the pilot ran again"
    asked = render(tmp_path, "--integrator", "path", "--spp", "16")
    assert asked["film_sha256"] == stats["film_sha256"]


@pytest.mark.parametrize("integrator", BUDGETS)
def test_images_repeat(integrator: str, tmp_path: Path) -> None:
    flags = ["--integrator", integrator]
    first = render(tmp_path, *flags, *BUDGETS[integrator])
    same = render(tmp_path, *flags, *BUDGETS[integrator], "--workers", "2", "--threads", "1")
    assert same["film_sha256"] == first["film_sha256"]

    by_rounds = render(tmp_path, *flags, "--rounds", str(first["rounds"]), *BUDGETS[integrator])
    assert by_rounds["film_sha256"] == first["film_sha256"]

    resolved = tmp_path / "resolved.json"
    resolved.write_text(json.dumps(first["resolved_spec"]))
    repeated = render(tmp_path, "--resolved", str(resolved), "--rounds", str(first["rounds"]))
    assert repeated["film_sha256"] == first["film_sha256"]

    other = render(tmp_path, *flags, *BUDGETS[integrator], "--seed", "6")
    assert other["film_sha256"] != first["film_sha256"]


def test_what_pilots_found_repeats(tmp_path: Path) -> None:
    flags = ["--integrator", "mmlt", "--mutations-per-pixel", "64", "--target", "equalized"]
    flags += ["--direct-apart", "on", "--kernel-tuning", "on"]
    first = render(tmp_path, *flags)
    plan = first["plan"]
    features = {feature["name"]: feature["state"] for feature in plan["features"]}
    assert features["equalized target"] == features["direct light apart"] == "used"
    assert len(plan["tuning"]["factors"]) == len(plan["tuning"]["acceptances"]) > 3
    assert plan["tuning"]["acceptances"] == sorted(plan["tuning"]["acceptances"], reverse=True)

    resolved = tmp_path / "resolved.json"
    resolved.write_text(json.dumps(first["resolved_spec"]))
    repeated = render(tmp_path, "--resolved", str(resolved), "--mutations-per-pixel", "64")
    assert repeated["film_sha256"] == first["film_sha256"]
    assert repeated["path_evaluations"] < first["path_evaluations"], "the pilots ran again"


def test_defaults_of_the_scene_can_be_set(tmp_path: Path) -> None:
    done = run(
        *("render", CORNELL, "-o", tmp_path / "out.exr", "--stats", tmp_path / "stats.json"),
        *("--set", "resx=24", "--set", "resy=16", "--integrator", "path", "--spp", "4"),
    )
    assert done.returncode == 0, done.stderr
    stats = json.loads((tmp_path / "stats.json").read_text())
    assert (stats["width"], stats["height"]) == (24, 16)


def start_endless(folder: Path, side: int) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [
            *(str(METROFARM), "render", str(CORNELL), "-o", str(folder / "out.exr")),
            *("--integrator", "pssmlt", "--mutations-per-pixel", "100000000"),
            *("--width", str(side), "--height", str(side)),
            *("--stats", str(folder / "stats.json")),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    read_on_to(process, "round ")
    return process


def read_on_to(process: subprocess.Popen[str], words: str) -> None:
    """Reads a line of progress that has the words."""
    assert process.stderr is not None
    read = []
    for line in process.stderr:
        read.append(line)
        if words in line:
            return
    raise AssertionError(f"ended without {words!r}: {read}")


def test_one_interrupt_finishes_the_round_and_writes(tmp_path: Path) -> None:
    process = start_endless(tmp_path, 32)
    process.send_signal(signal.SIGINT)
    _, words = process.communicate(timeout=120)
    assert process.returncode == 0, words
    assert (tmp_path / "out.exr").stat().st_size > 0
    rounds = json.loads((tmp_path / "stats.json").read_text())["rounds"]
    assert rounds >= 1


def test_two_interrupts_abort_and_leave_nothing(tmp_path: Path) -> None:
    # Large, so that the round under way outlasts the second interrupt.
    process = start_endless(tmp_path, 1024)
    process.send_signal(signal.SIGINT)
    read_on_to(process, "interrupt again to abort")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode != 0
    assert list(tmp_path.iterdir()) == []


def test_target_error_and_time_stop(tmp_path: Path) -> None:
    stats = render(tmp_path, "--integrator", "path", "--target-error", "0.02")
    assert stats["rel_mse_estimate"]["value"] < 0.02
    stats = render(tmp_path, "--integrator", "pssmlt", "--time", "2")
    assert stats["rounds"] >= 1


def test_scenes_may_look_for_files_in_folders_elsewhere(tmp_path: Path) -> None:
    """One folder above the scene gives nothing, the other a mesh: both are within the bundle."""
    (tmp_path / "common" / "empty").mkdir(parents=True)
    (tmp_path / "common" / "meshes").mkdir()
    triangle = "v -1 -1 4\nv 1 -1 4\nv 0 1 4\nf 1 2 3\n"
    (tmp_path / "common" / "meshes" / "triangle.obj").write_text(triangle)
    scene = tmp_path / "scenes" / "one" / "scene.xml"
    scene.parent.mkdir(parents=True)
    scene.write_text("""<scene version="3.0.0">
<path value="../../common/empty"/>
<path value="../../common/meshes"/>
<sensor type="perspective"/>
<emitter type="constant"/>
<shape type="obj"><string name="filename" value="triangle.obj"/></shape>
</scene>
""")
    assert run("inspect", scene).returncode == 0
    done = run("render", scene, "-o", tmp_path / "out.exr", *SMALL, *BUDGETS["path"], "--spp", "1")
    assert done.returncode == 0, done.stderr


def test_pbrt_scenes_are_submitted_like_others(farm: Farm, tmp_path: Path) -> None:
    scene = tmp_path / "ball" / "ball.pbrt"
    scene.parent.mkdir()
    scene.write_text(
        'Camera "perspective" "float fov" 40\n'
        'Film "rgb" "integer xresolution" 16 "integer yresolution" 16\n'
        "WorldBegin\n"
        'LightSource "infinite"\n'
        "Translate 0 0 5\n"
        'Shape "sphere"\n'
    )
    sent = run(
        "submit", scene, "--server", farm.url, "--integrator", "path", "--spp", "4", "--wait"
    )
    assert sent.returncode == 0, sent.stderr
    assert farm.job(sent.stdout.strip())["state"] == "done"
