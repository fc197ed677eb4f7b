"""The moving scenes whose images are compared with Mitsuba's of what stands still."""

from dataclasses import dataclass
from pathlib import Path

from cases import REFERENCES, SCENES

WIDTH, HEIGHT = 48, 32


@dataclass(frozen=True)
class MotionCase:
    """A scene, and five times (seconds) at which it is compared with the same scene at rest."""

    name: str
    times: tuple[float, ...]
    # Samples per pixel of one of the reference's renders of one instant.
    instant_spp: int = 16
    # What the power asserted is multiplied by, where light is hard to find.
    difficulty: float = 1.0

    @property
    def scene(self) -> Path:
        return SCENES / "motion" / f"{self.name}.xml"

    @property
    def reference(self) -> Path:
        """Made by make_motion_references.py: `mean` and `standard_error` (HEIGHT, WIDTH, 3) and
        `tile_standard_error` of the blurred image from `runs`; by time in the first index
        `posed_mean` and `posed_standard_error` of tiles from `posed_runs`."""
        return REFERENCES / f"motion-{self.name}.npz"


MOTION_CASES = [
    # The ball has turned by 0, 90, 180, 270 degrees, and by two turns and an eighth.
    MotionCase("ball", (0.0, 0.125, 0.25, 0.375, 1.5)),
    MotionCase("car", (-1.0, 0.7, 1.5, 2.0, 2.8)),
    MotionCase("light", (0.0, 0.2, 0.5, 0.7, 1.0), difficulty=2.0),
    MotionCase("camera", (0.0, 0.3, 0.5, 0.9, 2.0)),
    MotionCase("cloth", (0.0, 0.1, 0.5, 0.6, 1.0)),
    MotionCase("curves", (0.2, 0.7, 1.2, 1.6, 2.1)),
    MotionCase("caustic", (0.0, 0.3, 0.5, 0.8, 1.0), instant_spp=32, difficulty=4.0),
]
