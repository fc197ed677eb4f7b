"""Renders by Metrofarm and by Mitsuba, in processes of their own."""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scoring import read_rgb
from variants import BenchScene, Variant

from bench import ROOT, machine

METROFARM = ROOT / "bin" / "metrofarm"
MITSUBA = ROOT / ".tools" / "bench" / "bin" / "python"


def run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
    return done.stdout


def by_mitsuba(scene: BenchScene, variant: Variant, per_pixel: int, seed: int) -> tuple[Any, Any]:
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "image.npy"
        command = [str(MITSUBA), str(Path(__file__).parent / "mitsuba_image.py"), variant.mitsuba]
        command += [str(scene.scene), str(per_pixel), str(scene.width), str(scene.height)]
        stats = json.loads(run([*command, str(seed), str(out)]))
        return np.load(out), stats


def by_metrofarm(scene: BenchScene, variant: Variant, per_pixel: int, seed: int) -> tuple[Any, Any]:
    budget = "--mutations-per-pixel" if variant.chains else "--spp"
    with tempfile.TemporaryDirectory() as scratch:
        out, stats = Path(scratch) / "image.exr", Path(scratch) / "stats.json"
        command = [str(METROFARM), "render", str(scene.scene), "-o", str(out), *variant.words]
        command += [budget, str(per_pixel), "--seed", str(seed), "--threads", "2"]
        command += ["--width", str(scene.width), "--height", str(scene.height)]
        run([*command, "--stats", str(stats)])
        return read_rgb(out), json.loads(stats.read_text())


def provenance() -> str:
    """Machine, versions and commit."""
    commit = run(["git", "-C", str(ROOT), "describe", "--always", "--dirty"]).strip()
    version = run([str(METROFARM), "version"]).strip()
    return f"{machine()}; {version}, commit {commit}; Mitsuba 3.9.1"
