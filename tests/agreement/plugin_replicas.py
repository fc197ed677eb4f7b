"""Replicas of the plugin scenes, rendered by one running service."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenEXR

from farm import Farm, zip_files
from plugin_references import FOLDER


@dataclass(frozen=True)
class Work:
    """How often and how long a scene is rendered: seeds 1 to `replicas`."""

    integrator: str
    replicas: int
    # Samples per pixel of path tracing, mutations per pixel of chains.
    per_pixel: int

    def request(self, seed: int) -> dict[str, object]:
        stop = "samples_per_pixel" if self.integrator == "path" else "mutations_per_pixel"
        request = {"integrator": self.integrator, "seed": seed, "stop": {stop: self.per_pixel}}
        # Plain path tracing needs the bootstrap for its estimate of the time only.
        return request if self.integrator != "path" else {**request, "bootstrap_samples": 1024}


def scene_files() -> dict[str, bytes]:
    """All scenes and what they use, as names inside a bundle."""
    files = [*FOLDER.glob("*.xml"), *(FOLDER / "assets").iterdir()]
    return {str(path.relative_to(FOLDER)): path.read_bytes() for path in sorted(files)}


@dataclass
class Studio:
    """Renders scenes of bundles; keeps what it has rendered."""

    farm: Farm
    scratch: Path
    bundle: str = ""
    _images: dict[tuple[str, Work], list[np.ndarray]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.bundle = self.upload(scene_files())

    def upload(self, files: dict[str, bytes]) -> str:
        """The bundle's digest."""
        answer = self.farm.upload(zip_files(files))
        assert answer.status in (200, 201), answer.body
        return str(answer.json()["digest"])

    def images(self, name: str, work: Work) -> list[np.ndarray]:
        if (name, work) not in self._images:
            self._images[name, work] = self.render(self.bundle, f"{name}.xml", work)
        return self._images[name, work]

    def render(
        self, bundle: str, entry: str, work: Work, options: Mapping[str, object] | None = None
    ) -> list[np.ndarray]:
        """`options`: what else the requests ask for."""
        common = {"scene": bundle, "entry": entry, **(options or {})}
        jobs = [
            self._submit({**common, **work.request(seed)}) for seed in range(1, work.replicas + 1)
        ]
        return [self._result(job) for job in jobs]

    def _submit(self, request: dict[str, object]) -> str:
        answer = self.farm.post("/v1/jobs", request)
        assert answer.status == 201, answer.body.decode()
        return str(answer.json()["id"])

    def _result(self, job: str) -> np.ndarray:
        snapshot = self.farm.wait(job, timeout=600)
        assert snapshot["state"] == "done", snapshot.get("error", snapshot)
        answer = self.farm.get(f"/v1/jobs/{job}/image.exr")
        assert answer.status == 200, answer.body
        file = self.scratch / "image.exr"
        file.write_bytes(answer.body)
        with OpenEXR.File(str(file), separate_channels=True) as image:
            channels = image.channels()
            planes = [channels[name].pixels.astype(np.float64) for name in "RGB"]
        return np.stack(planes, axis=-1)
