"""TLS on both sides between the real programs: it changes no bit, and strangers are refused."""

import ssl
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import MakeFarm

from farm import SCENES, Farm, run

SCENE = SCENES / "glass-caustic" / "scene.xml"
JOB: dict[str, Any] = {
    "integrator": "pssmlt",
    "width": 32,
    "height": 24,
    "seed": 5,
    "stop": {"mutations_per_pixel": 64},
}


def made_certificates(folder: Path) -> Path:
    made = run("certs", folder)
    assert made.returncode == 0, made.stderr
    return folder


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """Certificates of the farm's own authority."""
    return made_certificates(tmp_path / "known")


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Certificates of an authority that the farm does not know."""
    return made_certificates(tmp_path / "foreign")


@pytest.fixture
def guarded(make_farm: MakeFarm, known: Path, tmp_path: Path) -> Farm:
    """A coordinator that speaks TLS only, knows workers by certificates and people by tokens."""
    token, line = run("token", "submit", "painter").stdout.splitlines()[:2]
    tokens = tmp_path / "tokens"
    tokens.write_text(f"{line}\n")
    tokens.chmod(0o600)
    certificate = (str(known / "server.crt"), str(known / "server.key"))
    return make_farm(
        options=(
            *("--tls-cert", certificate[0], "--tls-key", certificate[1]),
            *("--farm-tls-cert", certificate[0], "--farm-tls-key", certificate[1]),
            *("--farm-tls-ca", str(known / "ca.crt"), "--tokens", str(tokens)),
        ),
        token=token,
        trust=ssl.create_default_context(cafile=str(known / "ca.crt")),
    )


def tls_options(authority: Path, own: Path) -> list[str]:
    """Of a worker that trusts an authority and shows its own certificate."""
    options = ["--tls-ca", str(authority / "ca.crt")]
    return [*options, "--tls-cert", str(own / "worker.crt"), "--tls-key", str(own / "worker.key")]


def film_of(farm: Farm) -> str:
    snapshot = farm.wait(farm.submit(SCENE, **JOB))
    assert snapshot["state"] == "done", snapshot
    return str(snapshot["film_sha256"])


def test_same_film_with_tls_and_tokens(make_farm: MakeFarm, guarded: Farm, known: Path) -> None:
    plain = make_farm(local_workers=1)
    guarded.start_worker("known", *tls_options(known, known))
    assert film_of(guarded) == film_of(plain)
    assert replace(guarded, token="").get("/v1/jobs").status == 401


def wait_for_line(log: Path, words: str, timeout: float = 120) -> str:
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        for line in log.read_text(errors="replace").splitlines():
            if words in line:
                return line
        time.sleep(0.1)
    raise TimeoutError(f"no {words!r} in {log.read_text(errors='replace')!r}")


@pytest.mark.parametrize("stranger", ["worker", "coordinator", "without-tls"])
def test_strangers_are_refused(guarded: Farm, known: Path, foreign: Path, stranger: str) -> None:
    options = {
        "worker": tls_options(known, foreign),
        "coordinator": tls_options(foreign, known),
        "without-tls": [],
    }[stranger]
    guarded.start_worker("stranger", *options)
    line = wait_for_line(guarded.folder / "stranger.log", "waiting for a coordinator")
    assert "or the TLS options here do not fit those there" in line
    assert f"server.address=127.0.0.1:{guarded.farm_port}" in line
    assert guarded.get("/v1/workers").json()["workers"] == []
    assert guarded.workers["stranger"].alive
