"""Layers of the image file that tell how chains explore."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from farm import SCENES, run

CORNELL = SCENES / "cornell-box" / "scene.xml"
SMALL = ["--width", "32", "--height", "32", "--seed", "5", "--mutations-per-pixel", "32"]
TECHNIQUES = [f"technique.s{s}" for s in range(5)]


def render(folder: Path, *flags: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The statistics and the channels of the image file."""
    stats, image = folder / "stats.json", folder / "out.exr"
    done = run("render", CORNELL, "-o", image, "--stats", stats, *SMALL, *flags)
    assert done.returncode == 0, done.stderr
    with OpenEXR.File(str(image), separate_channels=True) as file:
        channels = {name: np.array(c.pixels, np.float64) for name, c in file.channels().items()}
    return json.loads(stats.read_text()), channels


@pytest.mark.parametrize("apart", ["off", "on"])
def test_images_by_technique_sum_to_the_image(apart: str, tmp_path: Path) -> None:
    flags = ["--integrator", "mmlt", "--direct-apart", apart]
    layers = ["--layers", "techniques,acceptance"]
    stats, channels = render(tmp_path, *flags, *layers)
    plain_stats, plain = render(tmp_path, *flags)
    assert {name for name in channels if "." in name} == {
        *(f"{layer}.{c}" for layer in [*TECHNIQUES, "variance"] for c in "RGB"),
        "acceptance.proposals",
        "acceptance.accepted",
        "acceptance.large",
    }
    for c in "RGB":
        assert np.array_equal(channels[c], plain[c]), "the layers change the image"
        total = sum(channels[f"{layer}.{c}"] for layer in TECHNIQUES)
        rest = channels[c] - total
        if apart == "off":
            # Six values, each rounded to 24 bits.
            assert np.all(np.abs(rest) <= 6 * 2.0**-24 * channels[c].max())
        else:
            assert np.all(rest > -1e-5 * channels[c].max())
            assert rest.mean() > 0.1 * channels[c].mean(), "direct light is not apart"
        assert all(channels[f"{layer}.{c}"].mean() > 0 for layer in TECHNIQUES)
    assert stats["film_sha256"] != plain_stats["film_sha256"], "the hash leaves the layers out"
    assert stats["acceptance"] == plain_stats["acceptance"]


def test_acceptance_by_pixel_length_and_technique(tmp_path: Path) -> None:
    flags = ["--integrator", "mmlt", "--layers", "acceptance"]
    stats, channels = render(tmp_path, *flags)
    acceptance = stats["acceptance"]
    mean = 0.3 * acceptance["large"] + 0.7 * acceptance["small"]
    proposals = channels["acceptance.proposals"]
    # Proposals that land nowhere, or on the border of the film, are missing.
    assert 0.5 < proposals.mean() <= 1.6
    found = (proposals * channels["acceptance.accepted"]).sum() / proposals.sum()
    assert found == pytest.approx(mean, abs=0.15)
    for name in ("acceptance.accepted", "acceptance.large"):
        assert channels[name].min() >= 0 and channels[name].max() <= 1

    for kind in ("lengths", "techniques"):
        proposed = [entry["proposed"] for entry in stats[kind]]
        assert sum(proposed) == pytest.approx(1)
        accepted = [entry["proposed"] * entry.get("acceptance", 0) for entry in stats[kind]]
        assert sum(accepted) == pytest.approx(mean, abs=0.01)
    assert stats["lengths"][0]["edges"] == 1
    assert stats["techniques"][0]["light_vertices"] == 0
    assert 0 < stats["effective_samples_per_mutation"] < 1
    assert stats["effective_samples"] == pytest.approx(
        stats["effective_samples_per_mutation"] * stats["mutations"]
    )
    assert 0 < stats["longest_stay"] < 2000
    assert stats["trapped_chains"] == 0


def test_techniques_belong_to_mmlt(tmp_path: Path) -> None:
    command = ["render", CORNELL, "-o", tmp_path / "out.exr", "--integrator"]
    refused = run(*command, "pssmlt", "--layers", "techniques")
    assert refused.returncode == 2
    assert "--layers: techniques belong to mmlt" in refused.stderr
    unknown = run(*command, "mmlt", "--layers", "acceptance", "--layers", "depth")
    assert unknown.returncode == 2
    assert '"depth"' in unknown.stderr
